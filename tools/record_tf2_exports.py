"""Write the names that ROS 2's tf2 packages export into tests/tf2/exports.json.

`python tools/record_tf2_exports.py CHECKOUT [BRANCH ...]`: CHECKOUT is a clone of geometry2, and
each BRANCH (default: humble, jazzy, rolling) adds its names. The file has the public names of each
module, and the module that each name comes from ("" for the module's own).
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from pathlib import Path

FILE = Path(__file__).resolve().parents[1] / "tests" / "tf2" / "exports.json"
BRANCHES = ("humble", "jazzy", "rolling")
SOURCES = re.compile(r"(?:tf2_ros_py|\w+/src|(?:tf2_py|tf2_sensor_msgs))/((?:tf2_\w+)/\w+)\.py")
# ROS 1's, left behind in the branch.
STALE = {"humble": ("tf2_sensor_msgs",)}
NATIVE = re.compile(r'(?:PyModule_AddObject\(m, |const_cast<char \*>\()"(?:tf2\.)?([A-Z]\w+)"')

Names = dict[str, str]


def git(checkout: str, *arguments: str) -> str:
    """What git prints."""
    command = ["git", "-C", checkout, *arguments]
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def names_of(source: str, package: str) -> tuple[Names, list[str]]:
    """Names that a module's source binds, and the modules of which it imports all names."""
    found: Names = {}
    stars: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            for each in node.names:
                found[each.asname or each.name.partition(".")[0]] = each.name
        elif isinstance(node, ast.ImportFrom):
            module = f"{package}.{node.module}" if node.level else str(node.module)
            for each in node.names:
                if each.name == "*":
                    stars.append(module)
                else:
                    found[each.asname or each.name] = module
    for node in ast.parse(source).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found[node.name] = ""
        elif isinstance(node, ast.Assign):
            found |= {each.id: "" for each in node.targets if isinstance(each, ast.Name)}
    return {name: module for name, module in found.items() if not name.startswith("_")}, stars


def record(checkout: str, branch: str) -> dict[str, Names]:
    """Names of each module of a branch."""
    own: dict[str, Names] = {}
    stars: dict[str, list[str]] = {}
    for path in git(checkout, "ls-tree", "-r", "--name-only", branch).splitlines():
        match = SOURCES.fullmatch(path)
        if match is None or match[1].startswith(("tf2_tools/", *STALE.get(branch, ()))):
            continue
        package, _, file = match[1].partition("/")
        module = package if file == "__init__" else f"{package}.{file}"
        own[module], stars[module] = names_of(git(checkout, "show", f"{branch}:{path}"), package)
    native = git(checkout, "show", f"{branch}:tf2_py/src/tf2_py.cpp")
    own["tf2_py._tf2_py"] = dict.fromkeys(NATIVE.findall(native), "")

    def everything(module: str) -> Names:
        found: Names = {}
        for star in stars.get(module, ()):
            found |= everything(star)
        return found | own[module]

    return {module: everything(module) for module in own}


def main() -> None:
    """Record the branches."""
    checkout, *branches = sys.argv[1:]
    found: dict[str, Names] = {}
    for branch in branches or BRANCHES:
        for module, names in record(checkout, branch).items():
            found[module] = {**found.get(module, {}), **names}
    FILE.write_text(json.dumps(found, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

"""Write what is generated of src/tfdb; `--check` only compares.

`_core.pyi` comes from the built extension, `recordings/selected.py` from the fields of `Selection`.
"""

from __future__ import annotations

import argparse
import ast
import difflib
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
STUB = ROOT / "src" / "tfdb" / "_core.pyi"
# Signatures of the methods that bypass nanobind, which stubgen cannot see.
PATTERNS = ROOT / "bindings" / "stubs.pattern"
SELECTION = ROOT / "src" / "tfdb" / "recordings" / "selection.py"
SELECTED = SELECTION.with_name("selected.py")
SELECTED_HEAD = '''"""The fields of `Selection` as keywords. Written by tools/make_stubs.py."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Mapping
    from typing import Literal

    from tfdb.data.stamps import StampLike
    from tfdb.data.types import PoseTopics, Topics
    from tfdb.robots.robot_model import RobotModel


class Selected(TypedDict, total=False):
    """Keywords that make a `Selection`."""

'''
# What a stub of the extension calls the types of fields.
QUALIFIED = {"RobotModel": "tfdb.robots.RobotModel"} | {
    name: f"tfdb.types.{name}" for name in ("PoseTopics", "StampLike", "Topics")
}
# stubgen takes what says that it is of `tfdb` for an import from there.
PROGRAM = """
from nanobind import stubgen
import tfdb._core
for kind in vars(tfdb._core).values():
    if isinstance(kind, type) and kind.__module__ == "tfdb" and kind is not tfdb._core.Transform:
        kind.__module__ = "tfdb._core"
        for name, method in list(vars(kind).items()):
            if type(method).__name__ == "Method":
                setattr(kind, name, method.__wrapped__)
def get(thing, name, *default):
    found = getattr(thing, name, *default)
    return "tfdb._core" if name == "__module__" and found == "tfdb" else found
stubgen.getattr = get
stubgen.main()
"""


def fields() -> list[tuple[str, str, str]]:
    """Return the name, type and default of each field of `Selection`."""
    tree = ast.parse(SELECTION.read_text(encoding="utf-8"))
    found = next(n for n in tree.body if isinstance(n, ast.ClassDef) and n.name == "Selection")
    return [
        (
            ast.unparse(each.target),
            ast.unparse(each.annotation).replace("'", '"'),
            next(ast.unparse(k.value) for k in each.value.keywords if k.arg == "default").replace(
                "'", '"'
            ),
        )
        for each in found.body
        if isinstance(each, ast.AnnAssign) and isinstance(each.value, ast.Call)
    ]


def selected() -> str:
    """Return the module of keywords."""
    return SELECTED_HEAD + "".join(f"    {name}: {kind}\n" for name, kind, _ in fields())


def patterns() -> str:
    """Return the patterns of stubgen, the fields of `Selection` in their place."""

    def qualified(kind: str) -> str:
        return re.sub(r"\b\w+\b", lambda word: QUALIFIED.get(word[0], word[0]), kind)

    given = [f"        {name}: {qualified(kind)} = {value}," for name, kind, value in fields()]
    text = PATTERNS.read_text(encoding="utf-8")
    return text.replace("        \\selection", "\n".join(given))


def generated() -> str:
    """Return the stub of the installed `tfdb._core`."""
    with tempfile.TemporaryDirectory() as folder:
        output, found = Path(folder) / "_core.pyi", Path(folder) / "stubs.pattern"
        found.write_text(patterns(), encoding="utf-8")
        command = [sys.executable, "-c", PROGRAM, "-q", "-m", "tfdb._core"]
        command += ["-o", str(output), "-p", str(found)]
        subprocess.run(command, check=True, cwd=folder)
        return output.read_text(encoding="utf-8")


def _undented(text: str) -> list[str]:
    """Lines without their margins: Python 3.13 takes the indentation out of docstrings itself."""
    return [line.strip() for line in text.splitlines()]


def main() -> int:
    """Return 0, or 1 when `--check` finds a difference."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare, write nothing")
    check = parser.parse_args().check
    stale = 0
    for path, new in ((STUB, generated()), (SELECTED, selected())):
        if not check:
            path.write_text(new, encoding="utf-8")
            continue
        old = path.read_text(encoding="utf-8") if path.is_file() else ""
        if _undented(old) != _undented(new):
            lines = old.splitlines(keepends=True), new.splitlines(keepends=True)
            sys.stdout.writelines(difflib.unified_diff(*lines, "committed", "generated"))
            print(f"{path.relative_to(ROOT)} is stale: run `make stubs`")
            stale = 1
    return stale


if __name__ == "__main__":
    sys.exit(main())

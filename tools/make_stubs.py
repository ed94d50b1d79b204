"""Write what is generated of src/tfdb; `--check` only compares.

`_core.pyi` comes from the built extension, `recordings/selected.py` from the fields of `Selection`.
"""

from __future__ import annotations

import argparse
import ast
import difflib
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
# stubgen takes what says that it is of `tfdb` for an import from there, as Python's classes are.
PROGRAM = """
from nanobind import stubgen
import tfdb._core
NATIVE = ("Policy", "StoreReader", "NativeBuffer", "NativeSnapshot", "NativeTransaction",
          "Transform", "Watch", "Clock")
# Types of C cannot say that they are of another module.
bases = ()
for name in ("CoreCalls", "BufferCalls"):
    bases = (type(name, bases, dict(vars(getattr(tfdb._core, name)), __module__="tfdb._core")),)
    setattr(tfdb._core, name, bases[0])
for kind in vars(tfdb._core).values():
    if isinstance(kind, type) and kind.__name__ in NATIVE:
        kind.__module__ = "tfdb._core"
        for name, method in list(vars(kind).items()):
            if type(method).__name__ == "Method":
                setattr(kind, name, method.__wrapped__)
tfdb._core.Transform.__nb_signature__ = "@typing.final\\nclass Transform"
def get(thing, name, *default):
    found = getattr(thing, name, *default)
    return "tfdb._core" if name == "__module__" and found == "tfdb" else found
stubgen.getattr = get
stubgen.main()
"""


def selected() -> str:
    """Return the module of keywords: name and type of each field of `Selection`."""
    tree = ast.parse(SELECTION.read_text(encoding="utf-8"))
    found = next(n for n in tree.body if isinstance(n, ast.ClassDef) and n.name == "Selection")
    kinds = {
        ast.unparse(each.target): ast.unparse(each.annotation).replace("'", '"')
        for each in found.body
        if isinstance(each, ast.AnnAssign) and isinstance(each.value, ast.Call)
    }
    return SELECTED_HEAD + "".join(f"    {name}: {kind}\n" for name, kind in kinds.items())


def generated() -> str:
    """Return the stub of the installed `tfdb._core`."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "_core.pyi"
        command = [sys.executable, "-c", PROGRAM, "-q", "-P", "-m", "tfdb._core"]
        command += ["-o", str(output), "-p", str(PATTERNS)]
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

"""Write src/tfdb/_core.pyi from the built extension; `--check` only compares."""

from __future__ import annotations

import argparse
import difflib
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
STUB = ROOT / "src" / "tfdb" / "_core.pyi"
# Signatures of the methods that bypass nanobind, which stubgen cannot see.
PATTERNS = ROOT / "bindings" / "stubs.pattern"
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


def generated() -> str:
    """Return the stub of the installed `tfdb._core`."""
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "_core.pyi"
        command = [sys.executable, "-c", PROGRAM, "-q", "-m", "tfdb._core"]
        command += ["-o", str(output)]
        if PATTERNS.is_file():
            command += ["-p", str(PATTERNS)]
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
    new = generated()
    if not check:
        STUB.write_text(new, encoding="utf-8")
        return 0
    old = STUB.read_text(encoding="utf-8") if STUB.is_file() else ""
    if _undented(old) == _undented(new):
        return 0
    sys.stdout.writelines(
        difflib.unified_diff(
            old.splitlines(keepends=True), new.splitlines(keepends=True), "committed", "generated"
        )
    )
    print("src/tfdb/_core.pyi is stale: run `make stubs`")
    return 1


if __name__ == "__main__":
    sys.exit(main())

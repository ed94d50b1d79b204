"""Run clang-tidy on our files in a build folder's compile commands, several at a time.

Without `--all` on the library alone, and without the analyser: in a fifth of the time.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def is_program(source: Path) -> bool:
    """Whether it is `x.test.cpp` or its kin."""
    return "." in source.stem


def tidy(build: Path, source: Path, analyse: bool) -> tuple[Path, int, str]:
    """Return the file, clang-tidy's exit status and what it said."""
    command = ["clang-tidy", "-quiet", "-p", str(build)]
    # The compiler's warnings are the compiler's: clang does not know all of gcc's, nor may it fail
    # on its own.
    command += ["--extra-arg=-Wno-unknown-warning-option", "--extra-arg=-Wno-error"]
    if not analyse:
        command.append("--checks=-clang-analyzer-*")
    done = subprocess.run([*command, str(source)], capture_output=True, text=True, check=False)
    return source, done.returncode, done.stdout


def main() -> int:
    """Return 0, or 1 when any file has a finding."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("build", type=Path)
    parser.add_argument("--all", action="store_true", help="every file, the library's analysed")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 2)
    arguments = parser.parse_args()
    commands = json.loads((arguments.build / "compile_commands.json").read_text(encoding="utf-8"))
    sources = sorted({Path(entry["file"]) for entry in commands})
    ours = [
        path
        for path in sources
        if path.is_relative_to(ROOT / "core") and (arguments.all or not is_program(path))
    ]
    bad = 0
    with ThreadPoolExecutor(arguments.jobs) as pool:
        # The analyser walks the paths of what ships; tests and their kin are run.
        runs = pool.map(
            lambda path: tidy(arguments.build, path, arguments.all and not is_program(path)), ours
        )
        for source, status, text in runs:
            if status:
                bad += 1
                print(f"{source.relative_to(ROOT)}\n{text}")
    print(f"clang-tidy: {len(ours)} files, {bad} with findings")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())

"""Run clang-tidy on our files in a build folder's compile commands, several at a time.

Without `--all`: on the library alone, without the analyser, and on all files of a room at once.
Headers are then read once, in a tenth of the time. Checks of a main file alone need `--all`.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import groupby
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def is_program(source: Path) -> bool:
    """Whether it is `x.test.cpp` or its kin."""
    return "." in source.stem


def join_rooms(commands: dict[Path, list[str]], folder: Path) -> dict[Path, list[str]]:
    """Write a file for each room and way to compile it; return their compile commands."""

    def kind(source: Path) -> tuple[Path, list[str]]:
        return source.parent, commands[source]

    found: dict[Path, list[str]] = {}
    for (room, options), sources in groupby(sorted(commands, key=kind), kind):
        joined = folder / f"{room.name}{len(found)}.cpp"
        joined.write_text("".join(f'#include "{each}"\n' for each in sources), encoding="utf-8")
        found[joined] = options
    return found


def write_commands(commands: dict[Path, list[str]], folder: Path) -> None:
    """Write compile commands for clang-tidy."""
    entries = [
        {"directory": str(folder), "file": str(path), "arguments": [*options, "-c", str(path)]}
        for path, options in commands.items()
    ]
    (folder / "compile_commands.json").write_text(json.dumps(entries), encoding="utf-8")


def tidy(build: Path, source: Path, checks: str) -> tuple[Path, int, str]:
    """Return the file, clang-tidy's exit status and its output."""
    command = ["clang-tidy", "-quiet", "-p", str(build), f"--checks={checks}"]
    # The compiler's warnings are the compiler's: clang does not know all of gcc's, nor may it fail
    # on its own.
    command += ["--extra-arg=-Wno-unknown-warning-option", "--extra-arg=-Wno-error"]
    done = subprocess.run([*command, str(source)], capture_output=True, text=True, check=False)
    return source, done.returncode, done.stdout


def main() -> int:
    """Return 0, or 1 when any file has a finding."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("build", type=Path)
    parser.add_argument("--all", action="store_true", help="every file, the library's analysed")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 2)
    arguments = parser.parse_args()
    build = arguments.build.resolve()
    ours = {
        Path(entry["file"]): options_of(entry)
        for entry in json.loads((build / "compile_commands.json").read_text(encoding="utf-8"))
        if Path(entry["file"]).is_relative_to(ROOT / "core")
    }
    library = {path: options for path, options in ours.items() if not is_program(path)}
    folder = build / "tidy"
    folder.mkdir(exist_ok=True)
    # The analyser walks the paths of what ships; tests and their kin are run.
    rest = "-clang-analyzer-*"
    if arguments.all:
        given = ours
        runs = [(folder, each, "" if each in library else rest) for each in ours]
    else:
        given = join_rooms(library, folder)
        runs = [(folder, each, f"{rest},-bugprone-suspicious-include") for each in given]
    write_commands(given, folder)
    bad = 0
    with ThreadPoolExecutor(arguments.jobs) as pool:
        for source, status, text in pool.map(lambda run: tidy(*run), runs):
            if status:
                bad += 1
                print(f"{source.relative_to(ROOT)}\n{text}")
    print(f"clang-tidy: {len(ours if arguments.all else library)} files, {bad} runs with findings")
    return 1 if bad else 0


def options_of(entry: dict[str, str]) -> list[str]:
    """Return a compile command without its file, its output, and a flag of GCC alone."""
    words = shlex.split(entry["command"])
    at = words.index("-o")
    del words[at : at + 2]
    return [
        each
        for each in words
        if each not in ("-c", entry["file"]) and not each.startswith("-mmemset-strategy")
    ]


if __name__ == "__main__":
    sys.exit(main())

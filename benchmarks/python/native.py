"""Builds and runs the C++ programs of benchmarks/cpp."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
SOURCE = HERE.parent / "cpp"


def build(folder: Path, jobs: int) -> Path:
    """Compiles; returns the folder of the programs."""
    subprocess.run(
        ["cmake", "-S", SOURCE, "-B", folder, "-DCMAKE_BUILD_TYPE=Release"],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    subprocess.run(
        ["cmake", "--build", folder, "--parallel", str(jobs)], check=True, stdout=subprocess.DEVNULL
    )
    return folder / "bin"


def rows(programs: Path, rounds: int, groups: list[str]) -> list[dict[str, Any]]:
    """Runs against_tf2; one dictionary per row, as it prints them."""
    command: list[str | Path] = [programs / "against_tf2", "--rounds", str(rounds), *groups]
    result = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
    return [json.loads(line) for line in result.stdout.splitlines()]


def torn_pairs(programs: Path, rounds: int, seconds: float) -> dict[str, list[dict[str, Any]]]:
    """Runs torn_pair for both stores in turns."""
    counts: dict[str, list[dict[str, Any]]] = {"tf2": [], "tfdb": []}
    for _ in range(rounds):
        for store, found in counts.items():
            command: list[str | Path] = [programs / "torn_pair", store, str(seconds)]
            result = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
            found.append(json.loads(result.stdout))
    return counts


def instructions(programs: Path, operation: str, chain: int) -> float:
    """Instructions per operation: callgrind on two counts of operations, differenced."""
    few, many = 1_000, 4_000
    collected = [callgrind(programs, operation, chain, count) for count in (few, many)]
    return (collected[1] - collected[0]) / (many - few)


def callgrind(programs: Path, operation: str, chain: int, count: int) -> int:
    """All instructions of one run of the program."""
    command: list[str | Path] = ["valgrind", "--tool=callgrind"]
    command += ["--callgrind-out-file=/dev/null", programs / "against_tf2"]
    command += ["--count", operation, str(chain), str(count)]
    result = subprocess.run(command, check=True, stderr=subprocess.PIPE, text=True)
    found = re.search(r"Collected : (\d+)", result.stderr)
    assert found, result.stderr
    return int(found[1])

"""The engines, and the program that records operations of their threads."""

from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING

import pytest

from tfdb_measure import programs
from tfdb_measure.verify import check, load_history

if TYPE_CHECKING:
    from pathlib import Path

    from tfdb_measure.verify import History, Verdict

ATOMIC = ("snapshot", "giant", "2pl-no-wait", "2pl-wait-die", "2pl-wound-wait", "silo")
ENGINES = (*ATOMIC, "fine")

every_engine = pytest.mark.parametrize("engine", ENGINES)
atomic_engines = pytest.mark.parametrize("engine", ATOMIC)


def record(folder: Path, **options: str | int | bool) -> History:
    """Record one run with these options of the recorder."""
    path = folder / "history.jsonl"
    command = [str(programs.find("tfdb_recorder")), "--out", str(path)]
    for name, value in options.items():
        if value is False:
            continue
        command.append("--" + name.replace("_", "-"))
        if not isinstance(value, bool):
            command.append(str(value))
    print(" ".join(command[1:]))
    subprocess.run(command, check=True, timeout=300)
    return load_history(path)


def judge(folder: Path, **options: str | int | bool) -> Verdict:
    """Record one run and judge it, and say what it did wrong."""
    verdict = check(record(folder, **options))
    for anomaly in verdict.anomalies:
        print(f"{anomaly.name} ({anomaly.count}):", *anomaly.steps, sep="\n    ")
    return verdict

"""The engines, and the program that records what their threads do."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import tfdb
from tfdb import _core
from tfdb.verify import check, load_history

if TYPE_CHECKING:
    from tfdb.verify import Verdict

ATOMIC = ("snapshot", "giant", "2pl-no-wait", "2pl-wait-die", "2pl-wound-wait", "silo")
ENGINES = (*ATOMIC, "fine")

every_engine = pytest.mark.parametrize("engine", ENGINES)
atomic_engines = pytest.mark.parametrize("engine", ATOMIC)


def recorder() -> Path:
    """The installed recorder, or the one in $TFDB_DRIVERS."""
    folders = [Path(module.__file__ or "").parent / "bin" for module in (tfdb, _core)]
    if os.environ.get("TFDB_DRIVERS"):
        folders = [Path(os.environ["TFDB_DRIVERS"])]
    for folder in folders:
        if os.access(folder / "tfdb_recorder", os.X_OK):
            return folder / "tfdb_recorder"
    pytest.fail(f"no tfdb_recorder in {' or '.join(map(str, folders))}: install tfdb again")


def judge(folder: Path, **options: str | int | bool) -> Verdict:
    """Record one run with these options of the recorder and judge it; a good one is not kept."""
    path = folder / "history.jsonl"
    command = [str(recorder()), "--out", str(path)]
    for name, value in options.items():
        if value is False:
            continue
        command.append("--" + name.replace("_", "-"))
        if not isinstance(value, bool):
            command.append(str(value))
    print(" ".join(command[1:]))
    subprocess.run(command, check=True, timeout=300)
    verdict = check(load_history(path))
    for anomaly in verdict.anomalies:
        print(f"{anomaly.name} ({anomaly.count}):", *anomaly.steps, sep="\n    ")
    return verdict

"""The protocol as a SPIN model: all states of a small model, and seeded faults."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

MODEL = Path(__file__).with_name("replication.pml")
pytestmark = pytest.mark.skipif(
    shutil.which("spin") is None and "CI" not in os.environ, reason="spin is not installed"
)


def search(folder: Path, **bounds: int) -> tuple[int, int]:
    """Search all states of the model; returns the numbers of errors and of states."""
    defined = [f"-D{name}={value}" for name, value in bounds.items()]
    subprocess.run(["spin", *defined, "-a", str(MODEL)], cwd=folder, check=True)
    options = ["-O2", "-DSAFETY", "-DCOLLAPSE", "-DMEMLIM=2000", "-w", "-o", "pan", "pan.c"]
    subprocess.run(["cc", *options], cwd=folder, check=True)
    done = subprocess.run(
        ["./pan", "-E", "-m1000000", "-w22"], cwd=folder, check=True, capture_output=True, text=True
    )
    assert "max search depth too small" not in done.stdout
    assert "Search not completed" not in done.stdout or "errors: 0" not in done.stdout, done.stdout
    errors = re.search(r"errors: (\d+)", done.stdout)
    states = re.search(r"(\d+) states, stored", done.stdout)
    assert errors is not None
    assert states is not None
    return int(errors[1]), int(states[1])


@pytest.mark.parametrize(
    "bounds", [{"N": 2, "MAXE": 2, "CH": 2}, {"N": 3, "MAXE": 2, "CH": 1, "KILLS": 0}]
)
def test_no_state_of_the_protocol_breaks_a_promise(tmp_path: Path, bounds: dict[str, int]) -> None:
    errors, states = search(tmp_path, **bounds)
    assert errors == 0
    assert states > 1000


@pytest.mark.parametrize(
    "fault", ["NOEPOCH", "GAP", "NORESYNC", "OLDSTATE", "FORK", "TWICE", "EQUALEPOCH"]
)
def test_faults_are_found(tmp_path: Path, fault: str) -> None:
    bounds = {"N": 3, "MAXE": 3, "CH": 1} if fault == "EQUALEPOCH" else {"N": 2, "MAXE": 3}
    errors, _ = search(tmp_path, **bounds, **{f"BUG_{fault}": 1})
    assert errors == 1

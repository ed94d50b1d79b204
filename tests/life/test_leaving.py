"""The interpreter ends while daemon threads are inside a call: quietly, with status 0."""

from __future__ import annotations

import subprocess
import sys

import pytest

from . import leave

TIMES = 3


@pytest.mark.parametrize("concurrency", ["snapshot", "giant", "2pl-wait-die", "silo"])
def test_threads_inside_every_call(concurrency: str) -> None:
    done = subprocess.run(
        [sys.executable, leave.__file__, concurrency, str(TIMES), *leave.CALLS],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.stderr == ""
    assert done.returncode == 0
    ends = dict(line.split() for line in done.stdout.splitlines())
    assert ends == dict.fromkeys(leave.CALLS, ",".join("0" * TIMES))

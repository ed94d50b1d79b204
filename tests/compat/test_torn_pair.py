"""Two static edges revised as a pair at full speed: readers never see half of a revision.

The same program runs the real tf2, whose rate of torn reads is printed: it has no batch to offer.
"""

from __future__ import annotations

import json
import subprocess

import pytest

from compat.tf2_oracle import program

SECONDS = 1.0


def race(store: str) -> dict[str, int]:
    command = [str(program("tfdb_torn_pair")), store, str(SECONDS)]
    result = subprocess.run(command, check=True, capture_output=True, text=True)
    counts: dict[str, int] = json.loads(result.stdout)
    print(result.stdout.strip())
    return counts


@pytest.mark.slow
def test_no_torn_reads() -> None:
    theirs, ours = race("tf2"), race("tfdb")
    assert theirs["reads"] > 0
    assert ours["reads"] > 0
    assert ours["writes"] > 0
    assert ours["torn"] == 0

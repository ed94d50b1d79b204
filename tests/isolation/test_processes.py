"""Random operations of several processes in one shared store, recorded and judged."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from isolation.engines import judge

if TYPE_CHECKING:
    from pathlib import Path


@pytest.mark.parametrize("seed", [1, 2])
def test_processes_that_share_a_store_are_strictly_serializable(seed: int, tmp_path: Path) -> None:
    verdict = judge(tmp_path, processes=4, writers=2, operations=500, seed=seed)
    assert verdict.serializable is True, verdict
    assert verdict.counts["committed"] > 1000


def test_so_they_are_without_the_numbers_of_the_commits(tmp_path: Path) -> None:
    """The order of the writes is then searched for, and does not rest on what the store says."""
    verdict = judge(tmp_path, processes=3, writers=3, operations=300, seed=4, no_commits=True)
    assert verdict.serializable is True, verdict


def test_single_writes_of_processes_tear_pairs(tmp_path: Path) -> None:
    """So the judge sees what goes wrong among processes, too."""
    for seed in range(1, 50):
        options = {"single_writes": True, "no_transactions": True, "no_commits": True}
        verdict = judge(tmp_path, processes=3, writers=1, operations=1500, seed=seed, **options)
        assert "garbage_read" not in verdict.names
        if "torn_batch" in verdict.names:
            return
    pytest.fail("50 runs showed no torn batch")

"""Errors found by random operations, in a few lines each."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

import tfdb
from chain import TURN


def write(buffer: tfdb.Buffer, parent: str, child: str, stamp: int) -> None:
    """One moving sample."""
    buffer.set_transform(parent, child, stamp, (stamp, 1, 2), TURN)


def with_a_reused_slot() -> tfdb.Buffer:
    """`cup` was in `hand`, which is gone, and is in `map` since; `table` may have hand's slot."""
    buffer = tfdb.Buffer(history=None)
    write(buffer, "hand", "cup", 10)
    write(buffer, "map", "cup", 20)
    buffer.remove_frames("hand")
    return buffer


@pytest.mark.parametrize("stamps", [[12, 20, 5], [20, 12, 5], [5, 20, 12]])
def test_rows_without_a_path_are_nan_in_any_order(stamps: list[int]) -> None:
    """Whatever else is asked with them: also where no stamp joins the frames."""
    buffer = with_a_reused_slot()
    found = buffer.lookup_transforms("map", "cup", stamps, missing="nan")
    assert np.isfinite(found).all(axis=1).tolist() == [stamp == 20 for stamp in stamps]
    for stamp, row in zip(stamps, found, strict=True):
        alone = buffer.lookup_transforms("map", "cup", [stamp], missing="nan")
        np.testing.assert_array_equal(alone[0], row)


def test_no_limit_is_reported_unless_one_was_passed() -> None:
    buffer = tfdb.Buffer()
    write(buffer, "map", "base", 10)
    for policy, limit in ((None, None), (tfdb.Interpolate(max_gap_ns=3), 3)):
        with pytest.raises(tfdb.Extrapolation) as caught:
            buffer.lookup_transform("map", "base", 11, policy)
        assert caught.value.limit == limit


class Node:
    """What robots' programs look like: a store, its clock and a snapshot in one object."""

    def __init__(self) -> None:
        self.buffer = tfdb.Buffer(clock=self.now)
        self.snapshot = self.buffer.snapshot()

    def now(self) -> int:
        return 5


def test_a_clock_and_a_snapshot_in_a_circle_are_collected() -> None:
    node = Node()
    gone = weakref.ref(node)
    del node
    gc.collect()
    assert gone() is None

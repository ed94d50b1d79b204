"""What random operations found, in a few lines each."""

from __future__ import annotations

import gc
import weakref

import numpy as np
import pytest

import tfdb

from .poses import random_pose


def write(buffer: tfdb.Buffer, parent: str, child: str, stamp: int) -> None:
    """One moving sample with a pose of its own."""
    pose = random_pose(stamp)
    buffer.set_transform(parent, child, stamp, pose[:3], pose[3:])


def with_a_reused_slot() -> tfdb.Buffer:
    """`cup` was in `hand`, which is gone, and is in `map` since; `table` may have hand's slot."""
    buffer = tfdb.Buffer(history=None)
    write(buffer, "hand", "cup", 10)
    write(buffer, "map", "cup", 20)
    buffer.remove_frame("hand")
    return buffer


def test_a_new_frame_in_an_old_slot_is_another_parent() -> None:
    """A late sample is not mixed with one of a frame that had the parent's slot before."""
    buffer = with_a_reused_slot()
    write(buffer, "table", "cup", 5)
    assert buffer.samples("cup")[2] == ["table", "", "map"]
    for policy in (tfdb.Interpolate(), tfdb.Extrapolate(max_ns=10)):
        found = buffer.lookup_transform("table", "cup", 7, policy)
        assert found.report.edges[0].used == "held"
        np.testing.assert_array_equal(found.pose, buffer.samples("cup")[1][0])
    before = buffer.lookup_transform("table", "cup", 1, tfdb.Extrapolate(max_ns=10))
    np.testing.assert_array_equal(before.pose, buffer.samples("cup")[1][0])
    with pytest.raises(tfdb.Disconnected):
        buffer.lookup_transform("table", "cup", 12)


def test_a_new_frame_in_an_old_slot_closes_no_cycle() -> None:
    """`cup` is in `table` until 10 only, so `table` may be in `cup` from 12 on."""
    buffer = with_a_reused_slot()
    write(buffer, "map", "table", 1)
    write(buffer, "cup", "table", 12)
    write(buffer, "table", "cup", 5)
    assert buffer.lookup_transform("map", "cup", 5).report.edges[0].parent == "table"
    assert buffer.lookup_transform("cup", "table", 12).report.edges[0].parent == "cup"


@pytest.mark.parametrize("stamps", [[12, 20, 5], [20, 12, 5], [5, 20, 12]])
def test_rows_without_a_path_are_nan_in_any_order(stamps: list[int]) -> None:
    """Whatever else is asked with them: also where no stamp joins the frames."""
    buffer = with_a_reused_slot()
    found = buffer.lookup_transforms("map", "cup", stamps, missing="nan")
    assert np.isfinite(found).all(axis=1).tolist() == [stamp == 20 for stamp in stamps]
    for stamp, row in zip(stamps, found, strict=True):
        alone = buffer.lookup_transforms("map", "cup", [stamp], missing="nan")
        np.testing.assert_array_equal(alone[0], row)


def test_no_limit_is_told_where_none_was_passed() -> None:
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

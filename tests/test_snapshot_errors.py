"""Errors of a held snapshot: no later commit changes their text."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import tfdb
from oracle import quaternion

if TYPE_CHECKING:
    from collections.abc import Callable

TURN = quaternion((1, -2, 0.5), 0.9)
STAMPS = (None, 3, 4, 10, 18, 60)
POLICIES = (tfdb.Interpolate(), tfdb.Previous(), tfdb.Nearest(), tfdb.Extrapolate(max_ns=3))


def write(buffer: tfdb.Buffer, parent: str, child: str, *stamps: int) -> None:
    buffer.set_transforms(
        [tfdb.TransformStamped(parent, child, stamp, (1, 2, 3), TURN) for stamp in stamps]
    )


def said(question: Callable[[], object]) -> tuple[object, ...]:
    try:
        return (repr(question()),)
    except tfdb.TfdbError as error:
        return type(error), str(error), vars(error)


def everything(reads: tfdb._core.StoreReader) -> list[tuple[object, ...]]:
    """The answer to every question about every pair of frames, errors included."""
    names = reads.frames()
    answers: list[tuple[object, ...]] = [(name, repr(reads.samples(name))) for name in names]
    for target in names:
        for source in names:
            pair = target, source
            answers += [
                said(lambda pair=pair: reads.common_times(*pair)),  # type: ignore[misc]
                said(lambda pair=pair: reads.lookup_latest_transform(*pair)),  # type: ignore[misc]
            ]
            answers += [
                said(lambda ask=(*pair, stamp, policy): reads.lookup_transform(*ask))  # type: ignore[misc]
                for stamp in STAMPS
                for policy in POLICIES
            ]
    return answers


def test_samples_that_were_cleared_before() -> None:
    buffer = tfdb.Buffer(history=None)
    write(buffer, "map", "base", 10, 12, 14, 15)
    write(buffer, "arm", "hand", 18)
    write(buffer, "ship", "arm", 19)
    buffer.clear()
    write(buffer, "map", "base", 13)
    held = buffer.snapshot()
    before = everything(held)
    assert any(tfdb.Disconnected in answer for answer in before)
    write(buffer, "arm", "hand", 43, 51)
    write(buffer, "arm", "hand", *range(87, 110, 2))
    assert everything(held) == before


def test_policies_that_choose_a_circle() -> None:
    """`a` is in `c` until 8, and from then on `c` in `a`: nearest to 4 each would be in the other.

    By samples that came later: both are roots.
    """
    buffer = tfdb.Buffer(history=None)
    write(buffer, "c", "a", 6)
    buffer.set_transforms(
        [
            tfdb.TransformStamped("a", "c", 8, (2, 0, 1), TURN),
            tfdb.TransformStamped("g", "a", 8, (3, 0, 1), TURN),
        ]
    )
    held = buffer.snapshot()
    before = everything(held)
    error = said(lambda: held.lookup_transform("a", "g", 4, tfdb.Nearest()))
    assert error[0] is tfdb.Disconnected
    assert isinstance(error[2], dict)
    assert error[2]["frames"] == ("a", "g")
    for count in range(1, 4):  # another frame makes a walk in a circle one step longer
        write(buffer, "f", f"new{count}", 12)
        assert everything(held) == before
    buffer.clear()
    buffer.remove_frames("a")
    write(buffer, "f", "a", 12)
    assert everything(held) == before


def test_a_parent_that_was_removed_before() -> None:
    buffer = tfdb.Buffer(history=None)
    write(buffer, "a", "e", 5)
    write(buffer, "b", "e", 8)
    write(buffer, "c", "x", 8)
    older = buffer.snapshot()
    buffer.remove_frames("a")
    held = buffer.snapshot()
    before = everything(held)
    error = said(lambda: held.lookup_transform("c", "e", 3))
    assert isinstance(error[2], dict)
    assert (error[2]["edge"], error[2]["parent"], error[2]["reason"]) == ("e", "(removed)", "past")
    older.close()
    write(buffer, "c", "new", 5)
    buffer.remove_frames("e")
    assert everything(held) == before


def test_a_later_commit_must_exist_and_not_be_older() -> None:
    buffer = tfdb.Buffer()
    write(buffer, "map", "base", 10)
    write(buffer, "map", "base", 12)
    held = buffer.snapshot()
    write(buffer, "map", "base", 14)
    write(buffer, "map", "base", 16)
    with held.at(3) as later:
        assert type(later) is tfdb.Snapshot
        assert (later.commit, later.frame_info("base").newest) == (3, 14)
        assert held.at(2).frame_info("base").newest == 12
        held.close()
        assert later.at(4).frame_info("base").newest == 16
        with pytest.raises(tfdb.InvalidArgument, match="commit 2: it is of commit 3"):
            later.at(2)
        with pytest.raises(tfdb.InvalidArgument, match="commit 5: the newest is 4"):
            later.at(5)
        with pytest.raises(tfdb.InvalidArgument, match="commit"):
            later.at(-1)
        buffer.close()
        assert later.at(4).frame_info("base").newest == 16
    with pytest.raises(tfdb.errors.SnapshotClosed):
        later.at(3)

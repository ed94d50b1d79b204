"""What a transaction loses against: every change of what it read, and no other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from chain import BACK, TURN, chain, contents
from elsewhere import elsewhere

if TYPE_CHECKING:
    from collections.abc import Callable

# What is read, and what somebody else then commits that would change the answer.
LOST: dict[str, tuple[Callable[[Any], object], Callable[[tfdb.Buffer], object]]] = {
    "newest": (
        lambda tx: tx.lookup_transform("map", "base"),
        lambda b: b.set_transform("map", "base", 40, (1, 2, 3), TURN),
    ),
    "newest, other way": (
        lambda tx: tx.lookup_transform("camera", "map"),
        lambda b: b.set_transform("map", "base", 40, (1, 2, 3), TURN),
    ),
    "latest": (
        lambda tx: tx.lookup_latest_transform("map", "camera"),
        lambda b: b.set_transform("map", "base", 40, (1, 2, 3), TURN),
    ),
    "common time": (
        lambda tx: tx.latest_common_time("map", "camera"),
        lambda b: b.set_transform("map", "base", 40, (1, 2, 3), TURN),
    ),
    "between": (
        lambda tx: tx.lookup_transform("map", "base", 15),
        lambda b: b.set_transform("map", "base", 16, (1, 2, 3), TURN),
    ),
    "replaced": (
        lambda tx: tx.lookup_transform("base", "map", 20),
        lambda b: b.set_transform("map", "base", 20, (1, 2, 3), BACK),
    ),
    "in a batch": (
        lambda tx: tx.lookup_transforms("map", "base", [12, 28]),
        lambda b: b.set_transform("map", "base", 27, (1, 2, 3), TURN),
    ),
    "phantom sample": (
        lambda tx: tx.can_transform("map", "base", 35),
        lambda b: b.set_transform("map", "base", 40, (1, 2, 3), TURN),
    ),
    "phantom frame": (
        lambda tx: tx.frame_exists("cup"),
        lambda b: b.set_transform("map", "cup", 1, (1, 2, 3), TURN),
    ),
    "phantom frame looked up": (
        lambda tx: tx.can_transform("map", "cup"),
        lambda b: b.set_transform("map", "cup", 1, (1, 2, 3), TURN),
    ),
    "phantom path": (
        lambda tx: tx.can_transform("other", "camera", 20),
        lambda b: b.set_transform("other", "map", 20, (1, 2, 3), TURN),
    ),
    "removed": (
        lambda tx: tx.lookup_transform("base", "camera"),
        lambda b: b.remove_frame("camera"),
    ),
    "static revised": (
        lambda tx: tx.lookup_transform("camera", "base"),
        lambda b: b.set_static_transform("base", "camera", (1, 2, 3), TURN),
    ),
    "new parent": (
        lambda tx: tx.lookup_transform("map", "base", 25),
        lambda b: b.set_transform("other", "base", 24, (1, 2, 3), TURN),
    ),
    "cleared": (
        lambda tx: tx.lookup_transform("map", "base", 15),
        lambda b: b.clear(),
    ),
}


@pytest.mark.parametrize(("read", "change"), LOST.values(), ids=LOST.keys())
def test_a_change_of_what_was_read_is_a_conflict(
    read: Callable[[Any], object], change: Callable[[tfdb.Buffer], object]
) -> None:
    buffer = chain()
    buffer.set_static_transform("other", "thing", (1, 2, 3), TURN)
    tx = buffer.transaction()
    after: object = None

    def work() -> None:
        nonlocal after
        with tx:
            read(tx)
            tx.set_static_transform("map", "decided", (1, 2, 3), TURN)
            elsewhere(lambda: change(buffer))
            after = elsewhere(lambda: contents(buffer))

    with pytest.raises(tfdb.Conflict) as caught:
        work()
    assert contents(buffer) == after
    assert not buffer.frame_exists("decided")
    assert not tx.is_open
    assert repr(tx) == "<tfdb.Transaction, lost>"
    assert caught.value.reason
    assert caught.value.commit == 5
    assert "run it again" in str(caught.value)
    assert (buffer.counters().conflicts, buffer.counters().aborts) == (1, 1)


# What is read, and what somebody else then commits that cannot change the answer.
KEPT: dict[str, tuple[Callable[[Any], object], Callable[[tfdb.Buffer], object]]] = {
    "appended": (
        lambda tx: tx.lookup_transform("map", "base", 25),
        lambda b: b.set_transform("map", "base", 40, (1, 2, 3), TURN),
    ),
    "elsewhere in the past": (
        lambda tx: tx.lookup_transform("map", "base", 25),
        lambda b: b.set_transform("map", "base", 15, (1, 2, 3), TURN),
    ),
    "another edge": (
        lambda tx: tx.lookup_transform("map", "base"),
        lambda b: b.set_static_transform("base", "camera", (1, 2, 3), TURN),
    ),
    "another frame": (
        lambda tx: tx.frame_exists("cup"),
        lambda b: b.set_transform("map", "plate", 1, (1, 2, 3), TURN),
    ),
    "nothing read": (
        lambda tx: None,
        lambda b: b.set_transform("map", "base", 40, (1, 2, 3), TURN),
    ),
}


@pytest.mark.parametrize(("read", "change"), KEPT.values(), ids=KEPT.keys())
def test_other_changes_are_none(
    read: Callable[[Any], object], change: Callable[[tfdb.Buffer], object]
) -> None:
    buffer = chain()
    with buffer.transaction() as tx:
        read(tx)
        tx.set_transform("map", "robot", 50, (5, 1, 2), TURN)
        elsewhere(lambda: change(buffer))
    assert buffer.frame_info("robot").newest == 50
    assert tx.commit_number == buffer.commit == 6


def test_two_that_write_the_same_from_what_they_read() -> None:
    """A lost update: the second to commit must not win."""
    buffer = chain()

    def grow(tx: tfdb.Transaction) -> None:
        x = tx.lookup_transform("base", "camera").translation[0]
        tx.set_static_transform("base", "camera", (x + 1, 0, 0), BACK)

    def first() -> None:
        with buffer.transaction() as tx:
            grow(tx)

    def second() -> None:
        with buffer.transaction() as tx:
            grow(tx)
            elsewhere(first)

    with pytest.raises(tfdb.Conflict):
        second()
    assert buffer.lookup_transform("base", "camera").translation[0] == 1


def test_a_conflict_that_was_swallowed_comes_again() -> None:
    buffer = chain()
    tx = buffer.transaction()

    def work() -> None:
        with tx:
            tx.lookup_transform("map", "base")
            tx.set_transform("map", "robot", 50, (5, 1, 2), TURN)
            elsewhere(lambda: buffer.set_transform("map", "base", 40, (1, 2, 3), TURN))
            with pytest.raises(tfdb.Conflict):
                tx.__exit__(None, None, None)

    with pytest.raises(tfdb.Conflict):
        work()
    assert not buffer.frame_exists("robot")

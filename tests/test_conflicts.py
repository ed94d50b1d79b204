"""Conflicts of transactions in Python: each read counts, and errors name the cause."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from another_thread import in_another_thread
from chain import BACK, TURN, chain, contents

if TYPE_CHECKING:
    from collections.abc import Callable


def append(buffer: tfdb.Buffer) -> None:
    """A change that affects every read of the newest state."""
    buffer.set_transform("map", "base", 40, (1, 2, 3), TURN)


def make_cup(buffer: tfdb.Buffer) -> None:
    buffer.set_transform("map", "cup", 1, (1, 2, 3), TURN)


READS: dict[str, tuple[Callable[[Any], object], Callable[[tfdb.Buffer], object], str]] = {
    "lookup": (lambda tx: tx.lookup_transform("camera", "map"), append, "base"),
    "latest": (lambda tx: tx.lookup_latest_transform("map", "camera"), append, "base"),
    "common time": (lambda tx: tx.latest_common_time("map", "camera"), append, "base"),
    "common times": (lambda tx: tx.common_times("map", "camera"), append, "base"),
    "parent": (
        lambda tx: tx.parent_of("base"),
        lambda b: b.set_transform("other", "base", 40, (1, 2, 3), TURN),
        "base",
    ),
    "full": (
        lambda tx: tx.lookup_transform_full("base", 15, "camera", None, "map"),
        append,
        "base",
    ),
    "batch": (
        lambda tx: tx.lookup_transforms("map", "base", [12, 28]),
        lambda b: b.set_transform("map", "base", 27, (1, 2, 3), TURN),
        "base",
    ),
    "can": (lambda tx: tx.can_transform("map", "base", 35), append, "base"),
    "frame exists": (lambda tx: tx.frame_exists("cup"), make_cup, "cup"),
    "an error": (lambda tx: tx.can_transform("map", "cup"), make_cup, "cup"),
}


@pytest.mark.parametrize(("read", "change", "what"), READS.values(), ids=READS.keys())
def test_every_read_can_conflict(
    read: Callable[[Any], object], change: Callable[[tfdb.Buffer], object], what: str
) -> None:
    buffer = chain()
    tx = buffer.transaction()
    after: object = None

    def work() -> None:
        nonlocal after
        with tx:
            read(tx)
            tx.set_static_transform("map", "decided", (1, 2, 3), TURN)
            in_another_thread(lambda: change(buffer))
            after = in_another_thread(lambda: contents(buffer))

    with pytest.raises(tfdb.Conflict) as caught:
        work()
    assert contents(buffer) == after
    assert tx.closed
    assert repr(tx) == "<tfdb.Transaction, lost>"
    assert what in (caught.value.edge, caught.value.frame)
    assert caught.value.reason
    assert caught.value.commit == 4
    assert "run it again" in str(caught.value)
    assert (buffer.counters().conflicts, buffer.counters().aborts) == (1, 1)


def test_unread_data_does_not_conflict() -> None:
    buffer = chain()
    with buffer.transaction() as tx:
        tx.lookup_transform("map", "base", 25)
        tx.frame_exists("cup")
        tx.set_transform("map", "robot", 50, (5, 1, 2), TURN)
        in_another_thread(lambda: append(buffer))
        in_another_thread(lambda: buffer.set_static_transform("base", "camera", (1, 2, 3), BACK))
    assert buffer.frame_info("robot").newest == 50
    assert tx.commit == buffer.commit == 7


def test_a_conflict_that_was_swallowed_comes_again() -> None:
    buffer = chain()
    tx = buffer.transaction()

    def work() -> None:
        with tx:
            tx.lookup_transform("map", "base")
            tx.set_transform("map", "robot", 50, (5, 1, 2), TURN)
            in_another_thread(lambda: append(buffer))
            with pytest.raises(tfdb.Conflict):
                tx.__exit__(None, None, None)

    with pytest.raises(tfdb.Conflict):
        work()
    assert not buffer.frame_exists("robot")

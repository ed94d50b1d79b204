"""`Transaction.clear`: all moving samples go, and new ones come, in one commit."""

from __future__ import annotations

import threading
import typing

import pytest

import tfdb
from another_thread import in_another_thread

ENGINES: tuple[tfdb.types.Concurrency, ...] = typing.get_args(tfdb.types.Concurrency)
SECOND = 1_000_000_000


def robot(concurrency: tfdb.types.Concurrency = "snapshot") -> tfdb.Buffer:
    buffer = tfdb.Buffer(history=None, concurrency=concurrency)
    buffer.set_transform("map", "base", 2 * SECOND, (1, 0, 0), authority="odometry")
    buffer.set_transform("base", "tip", 2 * SECOND, (2, 0, 0))
    buffer.set_static_transform("base", "camera", (0, 0, 3))
    return buffer


@pytest.mark.parametrize("engine", ENGINES)
def test_it_clears_and_stores_at_once(engine: tfdb.types.Concurrency) -> None:
    buffer = robot(engine)
    before = buffer.commit
    with buffer.transaction() as tx:
        tx.set_transform("map", "base", 3 * SECOND, (9, 0, 0))
        tx.clear()
        assert not tx.can_transform("map", "base")
        assert tx.frame_info("base").cleared
        assert tx.lookup_transform("base", "camera").translation.tolist() == [0, 0, 3]
        tx.set_transform("map", "base", SECOND, (5, 0, 0), authority="anew")
        assert tx.lookup_transform("map", "camera").translation.tolist() == [5, 0, 3]
    assert tx.commit == buffer.commit == before + 1
    assert buffer.samples("base")[0].tolist() == [SECOND]
    assert buffer.frame_info("base").authority == "anew"
    assert buffer.frame_info("tip").cleared
    assert buffer.frames() == ["base", "camera", "map", "tip"]


def test_the_feed_lists_cleared_and_stored_edges() -> None:
    buffer = robot()
    with buffer.transaction() as tx:
        tx.clear()
        tx.set_transform("map", "base", SECOND, (5, 0, 0))
        tx.set_static_transform("map", "tip", (6, 0, 0))
    (changes,) = buffer.changes(buffer.commit - 1)
    assert changes.cleared == ("base", "tip")
    assert changes.stored.children == ["base"]
    assert changes.stored_static.children == ["tip"]
    assert changes.moved == ("tip",)


def test_no_reader_finds_the_store_empty() -> None:
    buffer = robot()
    done = threading.Event()

    def start_anew() -> None:
        for number in range(300):
            with buffer.transaction() as tx:
                tx.clear()
                tx.set_transform("map", "base", SECOND + number % 7, (number, 0, 0))
                tx.set_transform("base", "tip", SECOND + number % 7, (number, 0, 0))
        done.set()

    with_new = threading.Thread(target=start_anew)
    with_new.start()
    seen = 0
    while not done.is_set() or seen == 0:
        with buffer.snapshot() as snapshot:
            base = snapshot.lookup_transform("map", "base").translation[0]
            tip = snapshot.lookup_transform("base", "tip").translation[0]
        assert base == tip or (base, tip) == (1, 2)
        seen += 1
    with_new.join()
    assert buffer.frame_info("base").samples == 1


def test_samples_that_others_store_meanwhile_do_not_conflict() -> None:
    buffer = robot()
    with buffer.transaction() as tx:
        tx.clear()
        in_another_thread(lambda: buffer.set_transform("map", "base", 3 * SECOND, (4, 0, 0)))
        tx.set_transform("base", "tip", SECOND, (5, 0, 0))
    assert buffer.frame_info("base").cleared


def test_a_transaction_that_read_a_cleared_edge_has_a_conflict() -> None:
    buffer = robot()

    def clear() -> None:
        with buffer.transaction() as other:
            other.clear()

    def read_and_write() -> None:
        with buffer.transaction() as tx:
            tx.lookup_transform("map", "base")
            in_another_thread(clear)
            tx.set_static_transform("map", "door", (1, 0, 0))

    with pytest.raises(tfdb.Conflict, match="cleared") as error:
        read_and_write()
    assert error.value.edge == "base"


def test_kinds_are_free_after_it() -> None:
    buffer = robot()
    with buffer.transaction() as tx:
        with pytest.raises(tfdb.errors.StaticConflict):
            tx.set_static_transform("map", "base", (1, 0, 0))
        tx.clear()
        tx.set_static_transform("map", "base", (1, 0, 0))
        with pytest.raises(tfdb.errors.StaticConflict):
            tx.set_transform("base", "camera", SECOND, (1, 0, 0))
    assert buffer.frame_info("base").is_static


def test_a_closed_transaction_clears_nothing() -> None:
    buffer = robot()
    with buffer.transaction() as tx:
        tx.clear()
        tx.abort()
    with pytest.raises(tfdb.errors.TransactionClosed):
        tx.clear()
    assert buffer.can_transform("map", "base")

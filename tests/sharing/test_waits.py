"""Waits across processes: another process's commit or removal of the store ends them."""

from __future__ import annotations

import asyncio
import os
import signal
from collections import deque
from typing import TYPE_CHECKING

import pytest

import tfdb
from tests.another_thread import Call

from . import child
from .child import Child
from .wait_cycles import COROUTINES, THREADS, wait_cycles

if TYPE_CHECKING:
    from collections.abc import Callable

LONG = 60.0


def put(buf: tfdb.Buffer, frame: str, stamp: int) -> None:
    buf.set_transform("map", frame, stamp, (1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8))


def test_another_process_is_woken_by_each_commit(name: str) -> None:
    buf = tfdb.Buffer.open(name)
    with Child("wait_for", name, 50) as waiter:
        for stamp in range(50):
            assert waiter.says() == f"waits for {stamp}"
            put(buf, "a", stamp)
            assert waiter.says() == f"has {stamp}"
        assert waiter.end() == 0


def test_waits_here_end_by_the_commits_of_another_process(name: str) -> None:
    buf = tfdb.Buffer.open(name)
    child.move_arm(buf, 1)
    calls = [Call(lambda: buf.wait_for_transform("map", "hand", 5000, LONG)) for _ in range(4)]
    with Child("write_on", name) as writer:
        for call in calls:
            assert call.result().stamp == 5000
        newest = buf.commit
        assert buf.wait_for_commit(newest, LONG) > newest
        assert asyncio.run(buf.wait_for_commit_async(newest, LONG)) > newest
        writer.send(signal.SIGKILL)
        assert writer.end() == -signal.SIGKILL


def test_ten_thousand_waits_of_two_processes_end_once_each(name: str) -> None:
    buf = tfdb.Buffer.open(name)
    child.move_arm(buf, 1)
    rounds, seed = 250, 7
    print("seed", seed)
    with Child("write_on", name), Child("wait_often", name, rounds, seed + 1) as other:
        ends = wait_cycles(name, rounds, seed)
        total = rounds * (THREADS + COROUTINES)
        assert total + int(other.says()) == 2 * total == 10_000
        assert other.end() == 0
    assert ends.total() == total
    assert set(ends) == {"came", "late", "cancelled", "closed"}


def test_waiting_processes_may_be_killed(name: str) -> None:
    buf = tfdb.Buffer.open(name)
    with Child("wait_for", name, 1) as killed, Child("wait_for", name, 1) as other:
        assert killed.says() == "waits for 0"
        assert other.says() == "waits for 0"
        killed.send(signal.SIGKILL)
        assert killed.end() == -signal.SIGKILL
        call = Call(lambda: buf.wait_for_transform("map", "a", 0, LONG))
        put(buf, "a", 0)
        assert other.says() == "has 0"
        assert call.result().stamp == 0


def test_the_removal_of_a_store_ends_the_waits_that_are_under_way(name: str) -> None:
    with (
        tfdb.Buffer.open(name),
        Child("wait_for", name, 1) as waiter,
        Child("wait_for", name, 1) as other,
    ):
        for process in (waiter, other):
            assert process.says() == "waits for 0"
            process.wait_until_asleep()
        tfdb.Buffer.unlink(name)
        for process in (waiter, other):
            assert process.says() == f"NoSuchStore /dev/shm/tfdb.{name}"
            assert process.end() == 0


def test_a_wait_that_starts_after_the_removal_ends_at_once(name: str) -> None:
    buf = tfdb.Buffer.open(name)
    put(buf, "a", 0)
    watch = buf.watch("a")
    tfdb.Buffer.unlink(name)
    for wait in (
        lambda: buf.wait_for_commit(1, LONG),
        lambda: buf.wait_for_commit(1, 0),
        lambda: buf.wait_for_transform("map", "a", 5, LONG),
        lambda: buf.lookup_transform("map", "b", timeout=LONG),
        lambda: asyncio.run(buf.wait_for_commit_async(1, LONG)),
        lambda: asyncio.run(buf.wait_for_transform_async("map", "a", 5, LONG)),
        lambda: watch.next(1, LONG),
        lambda: buf.clock.sleep(LONG),
    ):
        with pytest.raises(tfdb.errors.NoSuchStore, match="was removed"):
            wait()
    # Reads continue, but commits after the removal was noticed are for no follower.
    put(buf, "a", 5)
    assert buf.wait_for_transform("map", "a", 5, LONG).stamp == 5
    assert buf.clock.sleep_until(0, LONG)
    assert watch.next(1, 0) == []
    with pytest.raises(tfdb.errors.NoSuchStore, match="was removed"):
        buf.wait_for_commit(1, LONG)
    assert buf.wait_for_commit(0, LONG) == 2


def by_waits(buf: tfdb.Buffer) -> Callable[[], object]:
    commit = buf.commit

    def step() -> None:
        nonlocal commit
        commit = buf.wait_for_commit(commit, LONG)

    return step


def by_coroutines(buf: tfdb.Buffer) -> Callable[[], object]:
    commit = buf.commit

    def step() -> None:
        nonlocal commit
        commit = asyncio.run(buf.wait_for_commit_async(commit, LONG))

    return step


def by_watch(buf: tfdb.Buffer) -> Callable[[], object]:
    watch, commit = buf.watch("a"), buf.commit

    def step() -> None:
        nonlocal commit
        commit = watch.next(commit, LONG)[-1].commit

    return step


FOLLOWERS = {
    "waits": by_waits,
    "coroutines": by_coroutines,
    "a watch": by_watch,
    "samples": lambda buf: buf.follow().__next__,
    "samples of a frame": lambda buf: buf.follow("a").__next__,
    "batches": lambda buf: buf.follow().batches().__next__,
    "changes": lambda buf: buf.follow().changes().__next__,
    "a pair": lambda buf: buf.follow(pair=("map", "a")).__next__,
}


@pytest.mark.parametrize("follower", FOLLOWERS)
def test_followers_of_a_removed_store_end_although_another_writes(name: str, follower: str) -> None:
    with tfdb.Buffer.open(name) as buf, tfdb.Buffer.open(name) as writer:
        put(writer, "a", 0)
        step = FOLLOWERS[follower](buf)
        tfdb.Buffer.unlink(name)

        def write_and_step(stamp: int) -> None:
            put(writer, "a", stamp)
            put(writer, "b", stamp)
            step()

        with pytest.raises(tfdb.errors.NoSuchStore, match="was removed"):
            deque(map(write_and_step, range(1, 10)), maxlen=0)


@pytest.mark.parametrize("follower", FOLLOWERS)
def test_a_commit_just_before_the_removal_is_returned(name: str, follower: str) -> None:
    with tfdb.Buffer.open(name) as buf:
        put(buf, "a", 0)
        step = FOLLOWERS[follower](buf)
        call = Call(step)
        put(buf, "a", 1)
        tfdb.Buffer.unlink(name)
        call.result()
        with pytest.raises(tfdb.errors.NoSuchStore, match="was removed"):
            step()


@pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")
def test_a_reader_without_write_permission_cannot_wait(name: str) -> None:
    buf = tfdb.Buffer.open(name, permissions=0o644)
    put(buf, "a", 5)
    with Child("wait_as", 65534, name) as reader:
        assert reader.says() == "5"
        assert reader.says() == f"NotSupported /dev/shm/tfdb.{name}"
        assert reader.end() == 0

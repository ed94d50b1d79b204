"""Processes that are killed or stopped in a store do not stop the others."""

from __future__ import annotations

import os
import signal

import pytest

import tfdb

from . import child
from .child import Child


def test_readers_go_on_while_writers_are_killed(name: str) -> None:
    buffer = tfdb.Buffer.open(name, max_frames=1000)
    child.move_arm(buffer, 1)
    last = 10**8
    with Child("follow", name, last) as reader:
        assert reader.says() == "ready"
        for _ in range(3):
            with Child("write_on", name) as writer:
                until = buffer.commit + 40
                while buffer.commit < until:
                    child.arm_in(buffer)
                writer.send(signal.SIGKILL)
                assert writer.end() == -signal.SIGKILL
            child.move_arm(buffer, child.arm_in(buffer) + 1)
        child.move_arm(buffer, last)
        assert reader.says() == f"read {last}"
        assert reader.end() == 0
    assert buffer.shared is not None
    assert buffer.shared.processes == 1


def test_a_writer_that_is_stopped_is_named(name: str) -> None:
    buffer = tfdb.Buffer.open(name, lock_timeout=0.1)
    child.move_arm(buffer, 1)
    with Child("hold_lock", name) as writer:
        writer.wait_until_stopped()
        seen = child.arm_in(buffer)
        with pytest.raises(
            tfdb.errors.LockTimeout, match=rf"{writer.pid} has held.*for 0\.1.* s"
        ) as caught:
            child.move_arm(buffer, 100)
        assert caught.value.pid == writer.pid
        assert caught.value.limit == 100_000_000
        assert caught.value.path == f"/dev/shm/tfdb.{name}"
        with pytest.raises(tfdb.errors.LockTimeout):
            buffer.run(lambda tx: tx.set_transform("map", "x", 5, **child.pose_of(1)))
        message = tfdb.encode_tf_message([tfdb.TransformStamped("map", "x", 5, **child.pose_of(1))])
        with pytest.raises(tfdb.errors.LockTimeout):
            buffer.ingest_many([message] * 1000, encoding="cdr")
        with pytest.raises(tfdb.errors.LockTimeout):
            tfdb.Buffer.open(name, lock_timeout=0).remove_frames("hand")
        assert child.arm_in(buffer) == seen
        assert "x" not in buffer.frames()
        writer.send(signal.SIGCONT)
        assert writer.says() == "committed"
    child.move_arm(buffer, 100)
    assert child.arm_in(tfdb.Buffer.open(name, mode="r")) == 100
    assert buffer.lookup_transform("map", "mark").translation[0] == seen
    assert buffer.shared is not None
    assert buffer.shared.repairs == 0


def test_a_stopped_writer_that_is_ended_frees_the_store(name: str) -> None:
    buffer = tfdb.Buffer.open(name)
    child.move_arm(buffer, 1)
    with Child("hold_lock", name) as writer:
        writer.wait_until_stopped()
        seen = child.arm_in(buffer)
        writer.send(signal.SIGKILL)
        assert writer.end() == -signal.SIGKILL
    assert child.arm_in(buffer) == seen
    child.move_arm(buffer, 100)
    assert "mark" not in buffer.frames()
    assert buffer.shared is not None
    assert buffer.shared.repairs == 1
    child.move_arm(tfdb.Buffer.open(name), 101)
    assert buffer.shared.repairs == 1


def test_ctrl_c_ends_the_wait(name: str) -> None:
    child.move_arm(tfdb.Buffer.open(name), 1)
    with Child("hold_lock", name) as writer:
        writer.wait_until_stopped()
        with Child("write_when_free", name) as waiter:
            assert waiter.says() == "ready"
            waiter.wait_until_asleep()
            waiter.send(signal.SIGINT)
            assert waiter.says() == "interrupted"
            assert waiter.end() == 0


def test_ctrl_c_ends_the_wait_of_a_transaction(name: str) -> None:
    buffer = tfdb.Buffer.open(name)
    child.move_arm(buffer, 1)
    with Child("hold_lock", name) as writer:
        writer.wait_until_stopped()
        with Child("commit_when_free", name) as waiter:
            assert waiter.says() == "ready"
            waiter.wait_until_asleep()
            waiter.send(signal.SIGINT)
            assert waiter.says() == "interrupted aborted 5"
            assert waiter.says() == "ready"
            waiter.wait_until_asleep()
            waiter.send(signal.SIGINT)
            assert waiter.says() == "interrupted"
            assert waiter.end() == 0
        writer.send(signal.SIGCONT)
        assert writer.says() == "committed"
    assert not {"interrupted", "never"} & set(buffer.frames())
    child.move_arm(buffer, 2)


def test_memory_of_a_snapshot_stays_until_its_process_dies(name: str) -> None:
    buffer = tfdb.Buffer.open(name, history=1e-3)
    child.move_arm(buffer, 1)

    def write_much() -> int:
        for number in range(child.arm_in(buffer) + 1, child.arm_in(buffer) + 6000):
            child.move_arm(buffer, number)
        return buffer.memory().samples

    with Child("hold_snapshot", name) as holder:
        assert holder.says() == "1"
        assert write_much() == 12_000
        holder.tell("go on")
        assert holder.says() == "1"
    assert write_much() < 6000


def test_a_child_lets_the_snapshots_of_its_parent_be(name: str) -> None:
    buffer = tfdb.Buffer.open(name, history=1e-3)
    child.move_arm(buffer, 1)
    snapshot = buffer.snapshot()
    forked = os.fork()
    if forked == 0:
        seen = child.arm_in(snapshot)
        snapshot.close()
        child.move_arm(buffer, 2)
        os._exit(seen)
    assert os.waitstatus_to_exitcode(os.waitpid(forked, 0)[1]) == 1
    assert child.arm_in(buffer) == 2
    for number in range(3, 6000):
        child.move_arm(buffer, number)
    assert child.arm_in(snapshot) == 1
    snapshot.close()


def test_snapshots_of_a_forked_child_end_with_it(name: str) -> None:
    """It has a place of its own to say what it reads: its parent's stays clean."""
    buffer = tfdb.Buffer.open(name, history=1e-3)
    child.move_arm(buffer, 1)
    here, there = os.pipe()
    forked = os.fork()
    if forked == 0:
        snapshot = buffer.snapshot()
        os.write(there, b"x")
        signal.pause()
        os._exit(child.arm_in(snapshot))
    os.read(here, 1)
    assert buffer.shared is not None
    assert buffer.shared.processes == 2
    for number in range(2, 6000):
        child.move_arm(buffer, number)
    assert buffer.memory().samples == 2 * 5999
    os.kill(forked, signal.SIGKILL)
    os.waitpid(forked, 0)
    assert buffer.shared.processes == 1
    for number in range(6000, 9000):
        child.move_arm(buffer, number)
    assert buffer.memory().samples < 6000

"""Snapshots of later commits beside other processes."""

from __future__ import annotations

import os
import signal
from contextlib import suppress

import tfdb

from .child import Child, move_arm

LONG = 60.0


def put(buffer: tfdb.Buffer, parent: str, child: str, stamp: int) -> int:
    return buffer.set_transform(parent, child, stamp, (1.0, 2.0, 3.0), (0.6, 0, 0, 0.8))


def test_a_snapshot_opens_later_commits_of_another_process(name: str) -> None:
    with tfdb.Buffer.open(name, history=1e-7) as buffer:
        move_arm(buffer, 1)
        with buffer.snapshot() as held, Child("write_on", name) as writer:
            seen = buffer.wait_for_commit(held.commit + 1000, LONG)
            for commit in range(held.commit, seen, 97):
                with held.at(commit) as later:
                    assert later.commit == commit
                    assert later.frame_info("hand").newest == 1000 * commit
            writer.send(signal.SIGKILL)
            assert writer.end() == -signal.SIGKILL


def test_a_child_opens_later_commits_by_a_copy(name: str) -> None:
    with tfdb.Buffer.open(name) as buffer:
        put(buffer, "map", "arm", 1)
        held = buffer.snapshot()
        put(buffer, "map", "arm", 2)
        child = os.fork()
        if child == 0:
            code = 1
            with suppress(tfdb.TfdbError), held.at(2) as later:
                code = 0 if later.frame_info("arm").newest == 2 else 2
            os._exit(code)
        assert os.waitpid(child, 0)[1] == 0
        with held.at(2) as later:
            held.close()
            assert later.frame_info("arm").newest == 2

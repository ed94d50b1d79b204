"""Copies that are killed at any moment: their state is that of their position, and they go on."""

from __future__ import annotations

import bisect
import os
import random
import signal
import time

import pytest

import tfdb
from tests.test_changes import Writer, assert_same

KILLS = int(os.environ.get("TFDB_KILLS", "200"))
"""Deaths of one run. 1,000 take ten seconds."""


def recorded(seed: int) -> tuple[tfdb.Buffer, list[bytes], list[int], list[bytes]]:
    """Make a store's life: samples of some commits, and states, their ends; single commits."""
    source = tfdb.Buffer(history=60e-9)
    writer = Writer(seed)
    samples: list[bytes] = []
    ends: list[int] = []
    singles: list[bytes] = []
    rng = random.Random(seed)
    while len(samples) < 4000:
        with source.snapshot() as held:
            for _ in range(1 + rng.randrange(3)):
                writer.act(source)
            singles += [
                source.commits_bytes(commit, max_commits=1)
                for commit in range(held.commit, source.commit)
            ]
            if source.commit > held.commit:
                samples.append(source.commits_bytes(held.commit))
                ends.append(source.commit)
        if rng.randrange(40) == 0:
            with source.snapshot() as snap:
                samples[-1:] = [snap.state_bytes()]
    return source, samples, ends, singles


def apply_rest(name: str, samples: list[bytes], ends: list[int], begun: int) -> None:
    """Apply what the copy lacks, from the sample on in which it was killed."""
    copy = opened(name)
    os.write(begun, b"!")
    for data in samples[bisect.bisect_right(ends, position_of(copy)) :]:
        copy.apply(data, source="home")


def opened(name: str) -> tfdb.Buffer:
    return tfdb.Buffer.open(name, max_frames=64, history=60e-9)


def position_of(copy: tfdb.Buffer) -> int:
    return copy.positions()[0].commit if copy.positions() else 0


def test_a_killed_copy_has_the_state_of_its_position(name: str) -> None:
    seed = 11
    print(f"seed {seed}, {KILLS} kills")
    source, samples, ends, singles = recorded(seed)
    rng = random.Random(seed)
    judge = tfdb.Buffer(history=60e-9)
    opened(name)
    died = 0
    seen = set()
    while died < KILLS:
        heard, begun = os.pipe()
        pid = os.fork()
        if pid == 0:
            try:
                apply_rest(name, samples, ends, begun)
            finally:
                os._exit(0)
        os.close(begun)
        assert os.read(heard, 1) == b"!"
        time.sleep(rng.random() * 0.003)
        os.kill(pid, signal.SIGKILL)
        died += os.WIFSIGNALED(os.waitpid(pid, 0)[1])
        os.close(heard)
        copy = opened(name)
        position = position_of(copy)
        seen.add(position)
        for single in singles[position_of(judge) : position]:
            judge.apply(single, source="home")
        assert position_of(judge) == position
        assert_same(copy, judge)
        # The next writer takes back what the dead one had not committed.
        copy.set_static_transform("by", "stander", (1, 2, 3))
        copy.remove_frames(["by", "stander"])
        assert position_of(copy) == position
        assert_same(copy, judge)
        if position == source.commit:
            tfdb.Buffer.unlink(name)
            opened(name)
            judge = tfdb.Buffer(history=60e-9)
    print(f"{len(seen)} positions at {died} deaths")
    assert len(seen) > 3
    heard, begun = os.pipe()
    apply_rest(name, samples, ends, begun)
    os.close(heard)
    os.close(begun)
    assert_same(opened(name), source)


def test_a_source_is_forgotten_by_all_processes(name: str) -> None:
    source = tfdb.Buffer()
    source.set_transform("map", "base", 10, (1, 2, 3), (0, 0, 0.6, 0.8))
    with tfdb.Buffer.open(name) as one, tfdb.Buffer.open(name) as other:
        one.apply(source.commits_bytes(0))
        assert other.forget_source("")
        assert one.positions() == []
        source.set_transform("map", "base", 20, (2, 3, 4), (0, 0, 0.6, 0.8))
        with pytest.raises(tfdb.errors.OutOfOrder, match="was forgotten"):
            one.apply(source.commits_bytes(1))
        with source.snapshot() as snap:
            one.apply(snap.state_bytes())
        assert [p.commit for p in other.positions()] == [2]
        with tfdb.Buffer.open(name, mode="r") as reader:
            for known in ("", "x"):
                with pytest.raises(tfdb.errors.ReadOnly, match="opened for reading only"):
                    reader.forget_source(known)
            assert reader.positions() == one.positions()

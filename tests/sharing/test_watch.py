"""Watches of shared stores."""

from __future__ import annotations

import subprocess
import sys

import pytest

import tfdb
from tests.another_thread import Call
from tfdb import errors

LONG = 60.0


def put(buffer: tfdb.Buffer, parent: str, child: str, stamp: int) -> int:
    return buffer.set_transform(parent, child, stamp, (1.0, 2.0, 3.0), (0.6, 0, 0, 0.8))


CHILD = """
import sys, tfdb
with tfdb.Buffer.open(sys.argv[1]) as buffer:
    seen = 0
    watch = buffer.watch(frames=["arm"], pairs=[("map", "hand")])
    held = buffer.snapshot()  # however late this process is, it can read the path of each commit
    print("ready", flush=True)
    while True:
        for commit, what in watch.next(seen, 60):
            print(commit, *what, sep=";", flush=True)
            seen = commit
            if what == ("arm",):
                sys.exit()
"""


def test_processes_watch_a_shared_store(name: str) -> None:
    with tfdb.Buffer.open(name) as buffer:
        command = [sys.executable, "-c", CHILD, name]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
            assert child.stdout is not None
            assert child.stdout.readline() == "ready\n"
            expected = []
            put(buffer, "map", "base", 1)
            for stamp in range(1, 300):
                expected.append(f"{put(buffer, 'base', 'hand', stamp)};('map', 'hand')")
                put(buffer, "map", "other", stamp)
                if stamp % 100 == 0:
                    expected.append(f"{buffer.remove_frames('hand')};('map', 'hand')")
            expected.append(f"{put(buffer, 'world', 'arm', 1)};arm")
            assert child.stdout.read().splitlines() == expected
            assert child.wait() == 0


def test_removing_the_store_ends_next(name: str) -> None:
    with tfdb.Buffer.open(name) as buffer:
        watch = buffer.watch("arm")
        assert watch.next(0, 0) == []
        call = Call(lambda: watch.next(0, LONG))
        tfdb.Buffer.unlink(name)
        with pytest.raises(errors.NoSuchStore, match="removed"):
            call.result()


NAMES = tuple("abcdefgh")
PAIRS = (("a", "h"), ("d", "e"), ("b", "b"), ("h", "g"), ("c", "nowhere"))
WRITER = """
import random, sys, tfdb
rng = random.Random(int(sys.argv[2]))
with tfdb.Buffer.open(sys.argv[1]) as buffer:
    for step in range(600):
        stamp = 1_000 + 2 * step - (rng.randrange(40) if rng.random() < 0.2 else 0)
        child = rng.randrange(8)
        parent = (child - 1) // 2 if child and rng.random() < 0.9 else rng.randrange(8)
        try:
            if rng.random() < 0.1:
                buffer.remove_frames("abcdefgh"[child])
            elif rng.random() < 0.01:
                buffer.clear()
            else:
                pose = (rng.random(), 0.0, 0.0), (0.6, 0, 0, 0.8)
                buffer.set_transform("abcdefgh"[parent], "abcdefgh"[child], stamp, *pose)
        except tfdb.TfdbError:
            continue  # a cycle, or a frame that is missing: nothing is stored
"""


def test_a_watch_beside_writing_processes_agrees_with_changes(name: str) -> None:
    print("seeds 1, 2")
    with tfdb.Buffer.open(name, history=6e-8) as buffer, buffer.snapshot() as held:
        watch = buffer.watch(NAMES, PAIRS)
        told: dict[int, tuple[object, ...]] = {}
        seen = 0
        command = [sys.executable, "-c", WRITER, name]
        writers = [subprocess.Popen([*command, seed]) for seed in "12"]
        while any(writer.poll() is None for writer in writers) or seen < buffer.commit:
            newest = buffer.commit
            records = watch.next(seen, 0.01)
            for commit, what in records:
                assert commit > seen
                seen = commit
                told[commit] = what
            if not records:
                seen = max(seen, newest)
        assert [writer.wait() for writer in writers] == [0, 0]
        before = [path(held, *pair) for pair in PAIRS]
        for changes in buffer.changes(0):
            touched = {*changes.made, *changes.moved, *changes.cleared, *changes.removed}
            touched |= {*changes.stored.children, *changes.stored_static.children}
            with held.at(changes.commit) as state:
                after = [path(state, *pair) for pair in PAIRS]
            expected = {frame for frame in NAMES if frame in touched}
            found = {what for what in told.get(changes.commit, ()) if isinstance(what, str)}
            assert found == expected, changes.commit
            for pair, was, now in zip(PAIRS, before, after, strict=True):
                if touched & (was | now):
                    assert pair in told[changes.commit], changes.commit
            before = after
        assert buffer.commit > 500


def path(reads: tfdb.Snapshot, target: str, source: str) -> set[str]:
    """The frames between two frames, by the newest parents; none if one is missing."""
    if not (reads.frame_exists(target) and reads.frame_exists(source)):
        return set()
    down, up = chain(reads, target), chain(reads, source)
    meeting = set(down) & set(up)
    return {frame for frame in (*down, *up) if frame not in meeting} or {target}


def chain(reads: tfdb.Snapshot, name: str) -> list[str]:
    frames = [name]
    while (parent := reads.parent_of(frames[-1])) is not None and parent not in frames:
        frames.append(parent)
    return frames

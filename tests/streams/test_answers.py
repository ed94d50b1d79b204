"""A stream of a pair gives the answers of one lookup, each once."""

from __future__ import annotations

import threading

import numpy as np
import pytest

import tfdb
from tfdb import errors


def put(buf: tfdb.Buffer, parent: str, child: str, stamp: int, x: float) -> None:
    buf.set_transform(parent, child, stamp, (x, 2.0, 3.0), (0.5, 0.5, 0.5, 0.5))


def test_each_commit_that_changes_the_answer_gives_one() -> None:
    buf = tfdb.Buffer()
    put(buf, "map", "base", 10, 1.0)
    buf.set_static_transform("base", "camera", (0.5, 0, 0))
    with buf.follow(pair=("map", "camera")) as stream:
        put(buf, "map", "other", 11, 5.0)
        put(buf, "map", "base", 20, 2.0)
        at = buf.commit
        buf.set_static_transform("base", "camera", (0.75, 0, 0))
        put(buf, "map", "base", 15, 9.0)  # late: the newest common time stays
        put(buf, "map", "base", 30, 3.0)
        found = [stream.read_next() for _ in range(4)]
    assert found[3] is None
    answers = [t for t in found if t is not None]
    assert [(t.commit, t.stamp) for t in answers] == [(at, 20), (at + 1, 20), (at + 3, 30)]
    assert answers[2] == buf.lookup_transform("map", "camera")


def test_the_path_is_that_of_each_commit() -> None:
    buf = tfdb.Buffer()
    with buf.follow(pair=("a", "c")) as stream:
        put(buf, "a", "b", 10, 1.0)
        put(buf, "b", "c", 10, 1.0)  # now there is an answer
        first = stream.read_next()
        put(buf, "a", "d", 20, 1.0)
        put(buf, "d", "c", 20, 7.0)  # another parent
        second = stream.read_next()
        put(buf, "a", "b", 30, 1.0)  # off the path now
        assert stream.read_next() is None
        buf.remove_frames(["c"])
        assert stream.read_next() is None
        put(buf, "d", "c", 20, 7.0)
        third = stream.read_next()
    assert first is not None
    assert second is not None
    assert third is not None
    assert [t.commit for t in (first, second, third)] == [2, 4, 7]


def test_held_streams_begin_with_the_answer_that_is_there() -> None:
    buf = tfdb.Buffer()
    put(buf, "map", "base", 10, 1.0)
    with buf.follow(pair=("map", "base"), since="held") as stream:
        put(buf, "map", "base", 20, 2.0)
        found = [stream.read_next(timeout=0) for _ in range(3)]
    assert [None if t is None else t.stamp for t in found] == [10, 20, None]


def test_read_new_skips_answers() -> None:
    buf = tfdb.Buffer()
    put(buf, "map", "base", 10, 1.0)
    with buf.follow(pair=("map", "base")) as stream:
        assert stream.read_new() is None
        for stamp in (20, 30, 40):
            put(buf, "map", "base", stamp, 1.0)
        newest = stream.read_new()
        assert newest is not None
        assert newest.stamp == 40
        assert stream.read_new() is None
        assert stream.read_next() is None


def test_min_separation_is_by_the_stamp_of_the_answer() -> None:
    buf = tfdb.Buffer()
    with buf.follow(pair=("map", "base"), min_separation=25e-9) as stream:
        for stamp in range(10, 110, 10):
            put(buf, "map", "base", stamp, 1.0)
        found = []
        while (answer := stream.read_next()) is not None:
            found.append(answer.stamp)
    assert found == [10, 40, 70, 100]


def test_without_hold_the_newest_state_is_asked() -> None:
    buf = tfdb.Buffer()
    with buf.follow(pair=("map", "base"), hold=False) as stream:
        for stamp in (10, 20, 30):
            put(buf, "map", "base", stamp, 1.0)
        answer = stream.read_next()
        assert answer is not None
        assert answer.stamp == 30
        assert stream.read_next() is None


def test_answers_are_those_of_the_states_under_writers() -> None:
    """Two writers and re-parenting; the log of each commit's answer is the oracle."""
    buf = tfdb.Buffer(history=None)
    put(buf, "map", "base", 1, 0.0)
    put(buf, "map", "other", 1, 0.0)
    buf.set_static_transform("base", "tool", (0.5, 0, 0))
    held = buf.snapshot()
    stream = buf.follow(pair=("map", "tool"))
    answers: list[tfdb.Transform] = []
    reader = threading.Thread(target=lambda: answers.extend(stream))
    reader.start()

    def write(seed: int) -> None:
        random = np.random.default_rng(seed)
        for step in range(400):
            stamp = int(random.integers(2, 10_000))
            choice = random.random()
            if choice < 0.6:
                put(buf, "map", "base", stamp, float(step))
            elif choice < 0.8:
                put(buf, "map", "other", stamp, float(step))
            else:
                parent = "other" if random.random() < 0.5 else "base"
                buf.set_static_transform(parent, "tool", (float(step), 0, 0))

    writers = [threading.Thread(target=write, args=(seed,)) for seed in (1, 2)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    put(buf, "map", "base", 20_000, 1.0)
    put(buf, "map", "other", 20_000, 1.0)
    buf.set_static_transform("base", "tool", (0.25, 0, 0))
    last = buf.lookup_transform("map", "tool")
    expected = []
    before = held.lookup_transform("map", "tool")
    for commit in range(held.commit + 1, buf.commit + 1):
        with held.at(commit) as state:
            now = state.lookup_transform("map", "tool")
        if now != before:
            expected.append((commit, now))
        before = now
    while stream.commit < buf.commit:
        buf.wait_for_commit(0)
    stream.close()
    reader.join()
    held.close()
    assert expected[-1][1] == last
    assert [(t.commit, t) for t in answers] == expected


def test_bad_pairs_are_refused() -> None:
    buf = tfdb.Buffer()
    for pair in (("map",), ("map", "base", "tool"), "ab", 3):
        with pytest.raises((TypeError, tfdb.InvalidArgument)):
            buf.follow(pair=pair)  # type: ignore[call-overload]
    with pytest.raises(errors.InvalidName):
        buf.follow(pair=("", "base"))

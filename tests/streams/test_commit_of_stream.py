"""`Stream.commit` while another thread reads, and reads of several kinds by one stream."""

from __future__ import annotations

import sys
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tfdb.streams import cursor, stream

if TYPE_CHECKING:
    from collections.abc import Callable
    from types import FrameType

READING = {cursor.__file__, stream.__file__}


def commits_at_every_line(read: Callable[[], object], opened: tfdb.streams.Stream) -> list[int]:
    """Read, and ask for `commit` at each line that the read runs, as another thread could."""
    asks: list[int] = []

    def trace(frame: FrameType, event: str, arg: Any) -> Any:
        if frame.f_code.co_filename not in READING:
            return None
        asks.append(opened.commit)
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        read()
    finally:
        sys.settrace(before)
    return asks


def store(buf: tfdb.Buffer, count: int) -> None:
    """Commit `count` times: samples of two edges, of one edge, and a removed frame, in turn."""
    for _ in range(count):
        number = buf.commit + 1
        if number % 7 == 0 and buf.frame_exists("gone"):
            buf.remove_frames("gone")
            continue
        names = [["a", "b"], ["a"], ["gone"]][number % 3]
        poses = np.tile([1.0, 2, 3, 0.5, 0.5, 0.5, 0.5], (len(names), 1))
        buf.set_transforms(tfdb.Columns(["map"] * len(names), names, [number] * len(names), poses))


READS: dict[str, Callable[[tfdb.streams.Stream], object]] = {
    "next": lambda s: s.read_next(),
    "the third": lambda s: s.read_next(3),
    "new": lambda s: s.read_new(),
    "last": lambda s: s.read_last(),
    "iteration": next,
    "batch": lambda s: next(s.batches(5, 0)),
    "change": lambda s: next(s.changes()),
}


@pytest.mark.parametrize("frames", [None, ["a"], ["b", "gone"]], ids=str)
@pytest.mark.parametrize("seed", range(4))
def test_it_never_goes_back_nor_passes_an_unread_sample(
    frames: list[str] | None, seed: int
) -> None:
    random = np.random.default_rng(seed)
    buf = tfdb.Buffer()
    opened = buf.follow(frames)
    for _ in range(150):
        store(buf, int(random.integers(0, 6)))
        before = opened.commit
        if next_sample(buf, before, frames) is None:  # some reads would wait for it
            assert opened.read_next() is None
            continue
        read = READS[sorted(READS)[random.integers(len(READS))]]
        asks = commits_at_every_line(partial(read, opened), opened)
        asks = [before, *asks, opened.commit]
        assert asks == sorted(asks)
        following = next_sample(buf, opened.commit, frames)
        sample = opened.read_next()
        assert (None if sample is None else sample.commit) == following
    opened.close()


def next_sample(buf: tfdb.Buffer, since: int, frames: list[str] | None) -> int | None:
    """The first commit after `since` with samples of the frames."""
    records = buf.changes(since, frames=frames)
    return next((record.commit for record in records if len(record.stored)), None)


@pytest.mark.parametrize("n", [1, 2, 70])
def test_samples_follow_records_that_were_read(n: int) -> None:
    buf = tfdb.Buffer()
    opened = buf.follow()
    for stamp in range(1, 151):
        buf.set_transform("map", "base", stamp, (1, 2, 3), (0, 0, 0, 1))
    records = opened.changes()
    assert [next(records).commit for _ in range(n)] == list(range(1, n + 1))
    assert opened.commit == n
    back = opened.read_back()
    assert back is not None
    assert back.stamp == n
    sample = opened.read_next()
    assert sample is not None
    assert sample.stamp == n + 1
    assert opened.commit == n + 1
    assert next(opened.changes()).commit == n + 2
    newest = opened.read_new()
    assert newest is not None
    assert newest.stamp == 150
    assert opened.read_next() is None


def test_a_sample_before_the_last_record_is_in_no_later_record_twice() -> None:
    buf = tfdb.Buffer()
    opened = buf.follow()
    for stamp in range(1, 11):
        buf.set_transform("map", "base", stamp, (1, 2, 3), (0, 0, 0, 1))
    assert [next(opened.changes()).commit for _ in range(3)] == [1, 2, 3]
    back = opened.read_back(2)
    assert back is not None
    assert back.stamp == 2
    assert opened.commit == 2
    assert next(opened.changes()).commit == 3
    sample = opened.read_next()
    assert sample is not None
    assert sample.stamp == 4

"""Streams give each committed sample once, in the order of commits."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tfdb import errors
from tfdb.streams.rows import stretches_of_bytes, stretches_of_changes

if TYPE_CHECKING:
    from tfdb.streams.rows import Stretch
    from tfdb.types import Sample


def pose(x: float) -> list[float]:
    return [x, 2.0, 3.0, 0.5, 0.5, 0.5, 0.5]


def store(buf: tfdb.Buffer, names: list[str], stamp: int, authority: str = "") -> int:
    rows = [pose(stamp + place) for place in range(len(names))]
    columns = tfdb.Columns(["map"] * len(names), names, [stamp] * len(names), rows)
    buf.set_transforms(columns, authority=authority)
    return buf.commit


def flat(samples: list[Sample]) -> list[tuple[int, str, int | None, float]]:
    return [
        (s.commit, s.transform.source, s.stamp, float(s.transform.translation[0])) for s in samples
    ]


def recorded(buf: tfdb.Buffer, since: int = 0) -> list[tuple[int, str, int | None, float]]:
    """All samples as `changes` tells them, an independent way to read."""
    found = []
    for record in buf.changes(since):
        stamps = record.stored.stamps
        assert isinstance(stamps, np.ndarray)
        for child, stamp, row in zip(
            record.stored.children, stamps.tolist(), record.stored.poses.tolist(), strict=True
        ):
            found.append((record.commit, child, stamp, row[0]))
        static = record.stored_static
        for child, row in zip(static.children, static.poses.tolist(), strict=True):
            found.append((record.commit, child, None, row[0]))
    return found


def read_all(stream: tfdb.streams.Stream) -> list[Sample]:
    samples = []
    while (sample := stream.read_next()) is not None:
        samples.append(sample)
    return samples


def mixed_buffer() -> tfdb.Buffer:
    """Commits of several edges, static ones, late data, a removal and a clear."""
    buf = tfdb.Buffer(history=None)
    store(buf, ["a", "b"], 10, "one")
    buf.set_static_transform("a", "camera", (0.5, 0, 0), authority="two")
    store(buf, ["b", "a"], 30)
    store(buf, ["a"], 20, "late")
    buf.remove_frames(["camera"])
    buf.clear()
    store(buf, ["a", "c"], 40)
    return buf


def test_samples_are_those_of_changes_in_their_order() -> None:
    buf = mixed_buffer()
    with buf.snapshot(), buf.follow(since=0, hold=False) as stream:
        samples = read_all(stream)
    # What was removed or cleared before the stream began is gone, and counted.
    assert flat(samples) == recorded(buf)
    assert stream.gone == sum(sum(record.gone.values()) for record in buf.changes(0)) > 0


def test_a_sample_has_the_transform_and_its_writer() -> None:
    buf = tfdb.Buffer()
    stream = buf.follow()
    store(buf, ["a"], 10, "one")
    buf.set_static_transform("a", "camera", (0.5, 0, 0), authority="two")
    moving, static = read_all(stream)
    assert (moving.transform.target, moving.transform.source) == ("map", "a")
    assert moving.transform == buf.lookup_transform("map", "a", 10)
    assert (moving.stamp, moving.commit, moving.authority) == (10, 1, "one")
    assert (static.stamp, static.commit, static.authority) == (None, 2, "two")
    assert static.transform.pose.tolist() == buf.lookup_transform("a", "camera", 0).pose.tolist()
    stream.close()


@pytest.mark.parametrize("hold", [True, False])
def test_a_held_stream_loses_nothing_to_eviction_and_removal(hold: bool) -> None:
    buf = tfdb.Buffer(history=1e-6)
    with buf.follow(hold=hold) as stream:
        expected = []
        for stamp in range(1000, 60_000, 100):
            commit = store(buf, ["a"], stamp)
            expected.append((commit, "a", stamp, float(stamp)))
        buf.remove_frames(["a"])
        read = flat(read_all(stream))
        assert stream.gone + len(read) == len(expected)
        assert read == [row for row in expected if row in read]
        assert (stream.gone == 0) == hold


@pytest.mark.parametrize("frames", [None, ["a"], "a", ["a", "missing"], ["missing"]])
def test_frames_choose_the_samples(frames: list[str] | str | None) -> None:
    buf = tfdb.Buffer()
    stream = buf.follow(frames)
    store(buf, ["a", "b"], 10)
    store(buf, ["b"], 20)
    buf.set_static_transform("a", "missing", (0.5, 0, 0))
    chosen = {frames} if isinstance(frames, str) else frames
    expected = [row for row in recorded(buf) if chosen is None or row[1] in chosen]
    assert flat(read_all(stream)) == expected
    assert stream.commit == buf.commit
    stream.close()


def test_since_held_has_no_seam() -> None:
    buf = tfdb.Buffer()
    store(buf, ["a", "b"], 10, "one")
    store(buf, ["a"], 20, "two")
    buf.set_static_transform("a", "camera", (0.5, 0, 0))
    at = buf.commit
    with buf.follow(since="held") as stream:
        store(buf, ["b"], 30)
        samples = flat(read_all(stream))
    held, later = samples[:4], samples[4:]
    assert sorted(held) == sorted(
        [(at, "a", 10, 10.0), (at, "a", 20, 20.0), (at, "b", 10, 11.0), (at, "camera", None, 0.5)],
        key=str,
    ) or {row[1:] for row in held} == {
        ("a", 10, 10.0), ("a", 20, 20.0), ("b", 10, 11.0), ("camera", None, 0.5),
    }  # fmt: skip
    assert {row[0] for row in held} == {at}
    assert later == [(at + 1, "b", 30, 30.0)]


def test_since_a_commit_goes_on_where_another_stream_ended() -> None:
    buf = tfdb.Buffer()
    first = buf.follow()
    for stamp in range(10, 60, 10):
        store(buf, ["a", "b"], stamp)
    read = [first.read_next() for _ in range(4)]
    first.close()
    second = buf.follow(since=first.commit)
    rest = flat(read_all(second))
    second.close()
    assert flat([s for s in read if s is not None]) + rest == recorded(buf)


def test_read_new_skips_and_read_last_repeats() -> None:
    buf = tfdb.Buffer()
    stream = buf.follow()
    assert stream.read_new() is None
    assert stream.read_last() is None
    for stamp in (10, 20, 30):
        store(buf, ["a"], stamp)
    newest = stream.read_new()
    assert newest is not None
    assert newest.stamp == 30
    assert stream.read_new() is None
    assert stream.read_next() is None
    assert stream.read_last() == newest
    store(buf, ["a"], 40)
    last = stream.read_last()
    assert last is not None
    assert last.stamp == 40
    assert stream.read_new() is None
    stream.close()


def test_read_last_finds_samples_from_before_the_stream() -> None:
    buf = tfdb.Buffer()
    store(buf, ["a"], 10, "one")
    store(buf, ["b"], 20, "two")
    with buf.follow() as stream:
        last = stream.read_last()
        assert last is not None
        assert (last.transform.source, last.stamp, last.authority) == ("b", 20, "two")


def test_read_next_and_read_back_count_samples() -> None:
    buf = tfdb.Buffer()
    store(buf, ["a"], 5)
    stream = buf.follow(["a"])
    for stamp in range(10, 100, 10):
        store(buf, ["a"], stamp)
        store(buf, ["b"], stamp)

    def stamp_of(sample: Sample | None) -> int | None:
        return None if sample is None else sample.stamp

    assert stamp_of(stream.read_back()) == 5  # what was stored last before the stream
    assert stamp_of(stream.read_next()) == 10
    assert stamp_of(stream.read_next(3)) == 40
    assert stamp_of(stream.read_back()) == 30
    assert stamp_of(stream.read_back(2)) == 10
    assert stamp_of(stream.read_back(5)) is None
    assert stamp_of(stream.read_next()) == 20
    assert stamp_of(stream.read_next(70)) is None
    assert stamp_of(stream.read_next(7)) == 90
    assert stamp_of(stream.read_back(9)) == 5
    assert [s.stamp for s in read_all(stream)] == list(range(10, 100, 10))
    stream.close()


def test_read_back_crosses_commits_that_were_cut() -> None:
    buf = tfdb.Buffer()
    names = [f"f{place}" for place in range(7)]
    stream = buf.follow()
    for stamp in range(10, 3000, 10):
        store(buf, names, stamp)
    expected = recorded(buf)
    random = np.random.default_rng(20)
    place = 0  # samples read
    for _ in range(300):
        step = int(random.integers(1, 60))
        if random.random() < 0.6:
            sample = stream.read_next(step)
            if place + step > len(expected):
                assert sample is None
                continue
            place += step
        else:
            sample = stream.read_back(step)
            if place - step < 1:
                assert sample is None
                continue
            place -= step
        assert sample is not None
        assert flat([sample]) == [expected[place - 1]]
    stream.close()


def test_read_at_finds_the_sample_at_or_before() -> None:
    buf = tfdb.Buffer()
    stream = buf.follow(["a", "b"])
    for stamp in (10, 20, 30):
        store(buf, ["a"], stamp)
    store(buf, ["b"], 25)
    store(buf, ["c"], 27)
    found = [stream.read_at(stamp) for stamp in (5, 10, 19, 26, 99)]
    assert [None if s is None else (s.transform.source, s.stamp) for s in found] == [
        None, ("a", 10), ("a", 10), ("b", 25), ("a", 30),
    ]  # fmt: skip
    first = stream.read_next()
    assert first is not None
    assert first.stamp == 10
    stream.close()


def test_batches_are_columns_with_commits_and_authorities() -> None:
    buf = tfdb.Buffer()
    stream = buf.follow()
    store(buf, ["a", "b"], 10, "one")
    buf.set_static_transform("a", "camera", (0.5, 0, 0), authority="two")
    store(buf, ["a", "b"], 20, "three")
    batches = stream.batches(max_rows=4, max_wait=0)
    first = next(batches)
    assert list(first.stored.children) == ["a", "b", "a"]
    assert list(first.stored_static.children) == ["camera"]
    assert first.commits.tolist() == [1, 1, 3, 2]
    assert first.authorities == ("one", "one", "three", "two")
    second = next(batches)
    assert list(second.stored.children) == ["b"]
    copy = tfdb.Buffer()
    copy.set_transforms(first.stored)
    copy.set_transforms(first.stored_static, static=True)
    copy.set_transforms(second.stored)
    assert [copy.samples(n)[1].tolist() for n in copy.frames() if copy.parent_of(n)] == [
        buf.samples(n)[1].tolist() for n in buf.frames() if buf.parent_of(n)
    ]
    stream.close()
    assert list(batches) == []


def test_changes_are_whole_commits() -> None:
    buf = mixed_buffer()
    at = buf.commit
    stream = buf.follow()
    store(buf, ["a", "b"], 50)
    store(buf, ["c"], 60)
    buf.remove_frames(["c"])
    store(buf, ["a"], 70)
    part = stream.read_next()
    assert part is not None
    assert part.commit == at + 1
    told = stream.changes()
    assert [next(told).commit for _ in range(3)] == [at + 2, at + 3, at + 4]
    assert stream.commit == at + 4
    stream.close()
    assert list(told) == []


def test_changes_of_a_held_stream_begin_with_one_record() -> None:
    buf = tfdb.Buffer()
    store(buf, ["a", "b"], 10, "one")
    store(buf, ["a"], 20, "two")
    with buf.follow(since="held") as stream:
        store(buf, ["b"], 30)
        told = stream.changes()
        held, later = next(told), next(told)
    assert (held.commit, held.made, len(held.stored)) == (2, ("a", "b", "map"), 3)
    assert (later.commit, len(later.stored)) == (3, 1)


def test_min_separation_thins_each_edge_by_stamp() -> None:
    buf = tfdb.Buffer()
    stream = buf.follow(min_separation=25e-9)
    for stamp in range(10, 110, 10):
        store(buf, ["a"], stamp)
    store(buf, ["b"], 12)
    store(buf, ["b"], 20)
    samples = read_all(stream)
    assert [(s.transform.source, s.stamp) for s in samples] == [
        ("a", 10), ("a", 40), ("a", 70), ("a", 100), ("b", 12),
    ]  # fmt: skip
    with pytest.raises(tfdb.InvalidArgument, match="min_separation"):
        stream.read_back()
    stream.close()


def fill_the_feed(buf: tfdb.Buffer, commits: int) -> None:
    for _ in range(commits):
        buf.set_transform("map", "a", buf.commit + 1, (1, 2, 3), (0, 0, 0, 1))


def test_a_lapped_stream_raises_once_and_goes_on() -> None:
    buf = tfdb.Buffer(history=1e-6)
    stream = buf.follow(hold=False)
    fill_the_feed(buf, 40_000)
    with pytest.raises(errors.FeedLapped) as caught:
        stream.read_next()
    assert stream.missed == caught.value.commit == stream.commit
    sample = stream.read_next()
    assert sample is not None
    assert sample.commit > stream.missed
    batches = buf.follow(since=1, hold=False).batches(max_wait=0)
    with pytest.raises(errors.FeedLapped):
        next(batches)
    assert len(next(batches).stored) > 0
    stream.close()


def test_a_stream_that_may_miss_commits_only_counts_them() -> None:
    buf = tfdb.Buffer(history=1e-6)
    with buf.follow(hold=False, lapped="skip") as stream, buf.follow(hold=False) as newest:
        fill_the_feed(buf, 40_000)
        assert stream.read_next() is not None
        assert stream.missed > 0
        sample = newest.read_new()
        assert sample is not None
        assert sample.commit == buf.commit
        assert newest.missed > 0


def test_a_stream_of_quiet_frames_is_not_lapped_by_other_commits() -> None:
    buf = tfdb.Buffer(history=1e-6)
    store(buf, ["quiet", "a"], 1)
    with buf.follow(["quiet"], hold=False) as stream:
        for _ in range(10):
            fill_the_feed(buf, 5_000)
            assert stream.read_next() is None
            assert stream.commit == buf.commit
        store(buf, ["quiet"], 60_000)
        sample = stream.read_next()
        assert sample is not None
        assert sample.commit == buf.commit
        assert stream.missed == 0


def test_close_ends_reads_in_other_threads() -> None:
    buf = tfdb.Buffer()
    for read in (list, lambda s: list(s.batches()), lambda s: list(s.changes())):
        stream = buf.follow()
        ended: list[object] = []
        thread = threading.Thread(target=lambda r, s, e: e.append(r(s)), args=(read, stream, ended))
        thread.start()
        stream.close()
        thread.join()
        assert ended == [[]]
        assert stream.closed
        with pytest.raises(errors.StreamClosed):
            stream.read_next()


def test_a_closed_buffer_ends_its_streams_with_an_error() -> None:
    buf = tfdb.Buffer()
    stream = buf.follow()
    caught: list[Exception] = []

    def read() -> None:
        try:
            next(stream)
        except errors.BufferClosed as error:
            caught.append(error)

    thread = threading.Thread(target=read)
    thread.start()
    buf.close()
    thread.join()
    assert len(caught) == 1
    stream.close()


def test_an_idle_stream_keeps_no_memory() -> None:
    """Its snapshot is renewed by each look, though no commit concerns it."""
    buf = tfdb.Buffer(history=1e-6)
    store(buf, ["quiet"], 0)
    stamps = iter(range(10, 10**9, 10))

    def write(commits: int) -> int:
        for _ in range(commits):
            store(buf, ["busy"], next(stamps))
        return buf.memory().used_bytes

    write(2000)
    with buf.follow("quiet") as stream:
        sizes = []
        for _ in range(20):
            assert stream.read_next() is None
            sizes.append(write(1000))
        assert max(sizes[10:]) <= max(sizes[:10])
        assert write(5000) > max(sizes) + 1000 * 72  # without a look: 72 bytes for each sample
        store(buf, ["quiet"], next(stamps))
        sample = stream.read_next()
        assert sample is not None
        assert sample.transform.source == "quiet"


def test_bad_arguments_are_refused() -> None:
    buf = tfdb.Buffer()
    store(buf, ["a"], 10)
    for arguments in (
        {"since": "hold"},
        {"since": 7},
        {"since": -1},
        {"lapped": "never"},
        {"min_separation": -1.0},
        {"hold": "no"},
        {"poll": -1},
        {"frames": "a", "pair": ("map", "a")},
        {"pair": ("map", "a"), "since": 1},
    ):
        with pytest.raises(tfdb.InvalidArgument):
            buf.follow(**arguments)
    with pytest.raises(errors.InvalidName):
        buf.follow([""])
    stream = buf.follow()
    for n in (0, -1, 1.5, True):
        with pytest.raises(tfdb.InvalidArgument, match="n must be an integer of at least 1"):
            stream.read_next(n)  # type: ignore[arg-type]
    with pytest.raises(tfdb.InvalidArgument):
        stream.batches(max_rows=0)
    stream.close()
    assert buf.memory().used_bytes > 0


def table(stretches: list[Stretch]) -> list[tuple[Any, ...]]:
    return [
        row
        for stretch in stretches
        for row in zip(*(list(map(str, column)) for column in stretch.rows.columns()), strict=True)
    ]


def test_stretches_of_bytes_are_those_of_changes() -> None:
    """Bytes of commits and records of changes tell the same samples, and the same clears."""
    buf = mixed_buffer()
    store(buf, ["a", "b"], 60)
    with buf.snapshot() as held:
        buf.remove_frames(["b"])
        store(buf, ["a"], 70)
        buf.clear()
        store(buf, ["a", "b"], 80)
        last, found = stretches_of_bytes(buf.commits_bytes(held.commit))
        told = stretches_of_changes(buf.changes(held.commit))
    assert last == buf.commit
    assert [stretch.cleared for stretch in found if stretch.cleared] == [
        stretch.cleared for stretch in told if stretch.cleared
    ]
    assert table(found) == table(told)
    assert [len(stretch.rows) for stretch in found] == [0, 1, 2]


def test_next_is_the_same_as_read_next() -> None:
    buf = mixed_buffer()
    at = buf.commit
    iterated, read, mixed = (buf.follow(since=at) for _ in range(3))
    for stamp in range(50, 90, 10):
        store(buf, ["a", "b", "c"], stamp, f"writer {stamp}")
        buf.set_static_transform("a", f"camera{stamp}", (0.5, 0, 0))
    expected = read_all(read)
    assert flat(expected) == recorded(buf, at)
    commits = [sample.commit for sample in expected]
    for place, sample in zip(range(len(expected)), iterated, strict=False):
        assert (sample, type(sample)) == (expected[place], type(expected[place]))
        assert (sample.transform.commit, hash(sample)) == (sample.commit, hash(expected[place]))
        is_cut = commits[place + 1 : place + 2] == [sample.commit]
        assert iterated.commit == sample.commit - is_cut
    for place in range(0, len(expected), 2):
        assert next(mixed) == expected[place]
        assert mixed.read_next() == expected[place + 1]
    assert mixed.read_back() == expected[-2]
    assert next(mixed) == expected[-1]
    for stream in (iterated, read, mixed):
        stream.close()


def test_close_ends_an_iteration_though_samples_are_unread() -> None:
    buf = tfdb.Buffer()
    stream = buf.follow()
    store(buf, ["a", "b"], 10)
    for sample in stream:
        assert sample.transform.source == "a"
        stream.close()
    assert list(stream) == []
    assert stream.commit == 0


def test_an_iteration_goes_on_behind_an_error() -> None:
    buf = tfdb.Buffer(history=1e-6)
    with buf.follow(hold=False) as stream:
        fill_the_feed(buf, 40_000)
        with pytest.raises(errors.FeedLapped):
            next(stream)
        assert next(stream).commit > stream.missed > 0


def test_threads_share_an_iteration() -> None:
    buf = tfdb.Buffer()
    names = [f"f{place}" for place in range(10)]
    with buf.follow() as stream:
        found: list[list[Sample]] = []

        def read() -> None:
            mine: list[Sample] = []
            found.append(mine)
            with suppress(errors.StreamClosed):
                for sample in stream:
                    mine.append(sample)
                    if (more := stream.read_next()) is not None:
                        mine.append(more)

        threads = [threading.Thread(target=read) for _ in range(3)]
        for thread in threads:
            thread.start()
        for stamp in range(10, 10_000, 10):
            store(buf, names, stamp)
        expected = recorded(buf)
        while sum(map(len, found)) < len(expected):
            buf.wait_for_commit(0)
        stream.close()
        for thread in threads:
            thread.join()
    rows = [row for mine in found for row in flat(mine)]
    assert sorted(rows) == sorted(expected)
    for mine in found:
        commits = [sample.commit for sample in mine]
        assert commits == sorted(commits)


def test_dropped_samples_keep_no_names() -> None:
    buf = tfdb.Buffer()
    with buf.follow() as stream:
        store(buf, ["arm"], 10)
        sample = next(stream)
        parent, child = sample.transform.target, sample.transform.source
        del sample
        store(buf, ["head"], 10)
        next(stream)  # the rows before it go
    assert (sys.getrefcount(parent), sys.getrefcount(child)) == (2, 2)


@pytest.mark.parametrize("pair", [None, ("map", "base")])
def test_a_signal_handler_ends_the_iteration_of_its_thread(pair: tuple[str, str] | None) -> None:
    buf = tfdb.Buffer()
    store(buf, ["base"], 1)
    stream = buf.follow(pair=pair, since="held")
    before = signal.signal(signal.SIGUSR1, lambda *_: stream.close())
    try:
        read = 0
        for _ in stream:
            read += 1
            threading.Timer(0.01, os.kill, (os.getpid(), signal.SIGUSR1)).start()
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert read == 1
    assert stream._held is not None
    assert stream._held.closed


def test_a_cancelled_read_of_a_closed_stream_stays_cancelled() -> None:
    async def read(stream: Any) -> None:
        async for _ in stream:
            pass

    async def cancel(stream: Any) -> None:
        task = asyncio.create_task(read(stream))
        while not stream._ends:
            await asyncio.sleep(0)
        task.cancel()
        stream.close()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(cancel(tfdb.Buffer().follow()))


def test_close_ends_a_read_that_waits_with_an_error() -> None:
    buf = tfdb.Buffer()
    for stream in (buf.follow(), buf.follow(pair=("map", "base"))):
        caught: list[type[BaseException]] = []

        def read(stream: Any = stream, caught: list[type[BaseException]] = caught) -> None:
            try:
                stream.read_next(timeout=None)
            except errors.StreamClosed as error:
                caught.append(type(error))

        thread = threading.Thread(target=read)
        thread.start()
        while not stream._lock.locked():
            buf.wait_for_commit(0)
        stream.close()
        thread.join()
        assert caught == [errors.StreamClosed]


def test_read_back_does_not_reach_samples_from_before_the_stream() -> None:
    buf = tfdb.Buffer()
    store(buf, ["base", "camera"], 1)
    stream = buf.follow(since="held")
    assert [stream.read_next() is not None for _ in range(3)] == [True, True, False]
    assert stream.read_back() is None
    store(buf, ["base", "camera"], 5)
    assert flat([s for s in (stream.read_next(2), stream.read_back()) if s]) == [
        (2, "camera", 5, 6.0),
        (2, "base", 5, 5.0),
    ]
    assert stream.read_back() is None


@pytest.mark.parametrize("frames", [5, [], ()])
def test_frames_that_are_none_are_refused(frames: Any) -> None:
    with pytest.raises(errors.InvalidArgument, match="frames must be a frame name or several"):
        tfdb.Buffer().follow(frames)

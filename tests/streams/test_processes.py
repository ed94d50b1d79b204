"""Streams of shared stores, in other processes and coroutines."""

from __future__ import annotations

import asyncio
import multiprocessing
import os
import threading
from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb
from tfdb import errors

if TYPE_CHECKING:
    from multiprocessing.connection import Connection

SPAWN = multiprocessing.get_context("spawn")


def write(name: str, seed: int, commits: int) -> None:
    buf = tfdb.Buffer.open(name)
    random = np.random.default_rng(seed)
    for step in range(1, commits + 1):
        count = int(random.integers(1, 6))
        rows = np.tile([float(step), 0, 0, 0.5, 0.5, 0.5, 0.5], (count, 1))
        children = [f"w{seed}_{place}" for place in range(count)]
        buf.set_transforms(tfdb.Columns(["map"] * count, children, [step] * count, rows))


@pytest.mark.parametrize("how", ["samples", "batches", "changes"])
def test_processes_miss_nothing_and_read_nothing_twice(name: str, how: str) -> None:
    commits = 3_000
    buf = tfdb.Buffer.open(name, create=True, history=None)
    stream = buf.follow()
    writers = [SPAWN.Process(target=write, args=(name, seed, commits)) for seed in (1, 2)]
    for writer in writers:
        writer.start()
    found: list[tuple[int, str, int]] = []
    done = 2 * commits
    if how == "samples":
        for sample in stream:
            assert sample.stamp is not None
            found.append((sample.commit, sample.transform.source, sample.stamp))
            if stream.commit == done:
                break
    elif how == "batches":
        for batch in stream.batches(max_rows=1000, max_wait=0.01):
            assert isinstance(batch.stored.stamps, np.ndarray)
            rows = zip(
                batch.commits.tolist(), batch.stored.children, batch.stored.stamps.tolist(),
                strict=True,
            )  # fmt: skip
            found.extend(rows)
            if stream.commit == done:
                break
    else:
        for change in stream.changes():
            assert isinstance(change.stored.stamps, np.ndarray)
            for child, stamp in zip(
                change.stored.children, change.stored.stamps.tolist(), strict=True
            ):
                found.append((change.commit, child, stamp))
            if stream.commit == done:
                break
    for writer in writers:
        writer.join()
    assert stream.missed == stream.gone == 0
    stream.close()
    assert found == sorted(found, key=lambda row: row[0])
    for seed in (1, 2):
        random = np.random.default_rng(seed)
        mine: dict[int, set[str]] = {}
        for _, child, stamp in found:
            if child.startswith(f"w{seed}_"):
                assert child not in mine.setdefault(stamp, set())
                mine[stamp].add(child)
        for step in range(1, commits + 1):
            assert len(mine[step]) == int(random.integers(1, 6))


def test_a_coroutine_reads_the_commits_of_threads() -> None:
    buf = tfdb.Buffer()

    async def read(stream: tfdb.streams.Stream) -> list[int | None]:
        return [sample.stamp async for sample in stream]

    async def run() -> list[int | None]:
        stream = buf.follow()
        reader = asyncio.create_task(read(stream))

        def commit() -> None:
            for stamp in range(1, 200):
                buf.set_transform("map", "base", stamp, (1, 2, 3), (0, 0, 0, 1))
            while stream.commit < 199:
                buf.wait_for_commit(0)
            stream.close()

        writer = threading.Thread(target=commit)
        writer.start()
        stamps = await reader
        writer.join()
        return stamps

    assert asyncio.run(run()) == list(range(1, 200))


def test_a_cancelled_coroutine_leaves_the_stream_as_it_was() -> None:
    buf = tfdb.Buffer()

    async def run() -> int | None:
        with buf.follow() as stream:
            reader = asyncio.create_task(anext(stream))
            await asyncio.sleep(0)
            reader.cancel()
            with pytest.raises(asyncio.CancelledError):
                await reader
            buf.set_transform("map", "base", 7, (1, 2, 3), (0, 0, 0, 1))
            return (await anext(stream)).stamp

    assert asyncio.run(run()) == 7


def in_child(end: Connection, stream: tfdb.streams.Stream) -> None:
    try:
        stream.read_next()
    except errors.StreamClosed:
        end.send((stream.closed, list(stream)))
    finally:
        end.close()
        os._exit(0)


def test_a_child_of_fork_finds_the_stream_closed(name: str) -> None:
    buf = tfdb.Buffer.open(name, create=True)
    with buf.follow() as stream:
        here, there = multiprocessing.Pipe()
        child = os.fork()
        if child == 0:
            in_child(there, stream)
        there.close()
        assert here.recv() == (True, [])
        os.waitpid(child, 0)
        buf.set_transform("map", "base", 7, (1, 2, 3), (0, 0, 0, 1))
        sample = stream.read_next()
        assert sample is not None
        assert sample.stamp == 7


def test_a_reader_that_may_not_wait_polls_with_a_warning(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = tfdb.Buffer.open(name, create=True)

    def refuse(*_: object, **__: object) -> None:
        raise errors.NotSupported("no control file")

    monkeypatch.setattr(tfdb.Buffer, "watch", refuse, raising=False)
    reader = tfdb.Buffer.open(name)
    with pytest.warns(tfdb.TfdbWarning, match=r"every 0\.001 s"):
        stream = reader.follow(poll=0.001)
    writer.set_transform("map", "base", 7, (1, 2, 3), (0, 0, 0, 1))
    assert next(stream).stamp == 7
    assert stream.read_next() is None
    stream.close()


def test_a_store_that_is_removed_ends_the_stream(name: str) -> None:
    buf = tfdb.Buffer.open(name, create=True)
    stream = buf.follow()
    tfdb.Buffer.unlink(name)
    with pytest.raises((errors.NoSuchStore, errors.BufferClosed)):
        next(stream)
    stream.close()

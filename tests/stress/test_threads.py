"""Python threads write and read one store at once: no read sees half a commit."""

from __future__ import annotations

import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb

from .test_transactions import ISOLATING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

TILT = (0.5, -0.5, 0.5, 0.5)
UPRIGHT = (-0.5, 0.5, -0.5, 0.5)


@contextmanager
def running(*bodies: Callable[[int], None]) -> Iterator[None]:
    """Call each body with 1, 2, 3, ... in a thread of its own; their errors are raised here."""
    done = threading.Event()
    errors: list[BaseException] = []

    def run(body: Callable[[int], None]) -> None:
        count = 0
        try:
            while not done.is_set():
                count += 1
                body(count)
        except BaseException as error:
            errors.append(error)

    threads = [threading.Thread(target=run, args=(body,)) for body in bodies]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        done.set()
        for thread in threads:
            thread.join()
    if errors:
        raise errors[0]


# T[b<-a] turns the axis x of `a` onto this one, exactly: the quaternion is a third of a turn.
ALONG = tfdb.Transform("a", "b", (0, 0, 0), TILT).inverse().apply([1.0, 0.0, 0.0])


def pair(value: float) -> list[tfdb.TransformStamped]:
    """Two edges that cancel out: T[a<-c] stays the same whatever the value."""
    return [
        tfdb.TransformStamped("a", "b", 0, (value, 1, 2), TILT),
        tfdb.TransformStamped("b", "c", 0, -value * ALONG, UPRIGHT),
    ]


@pytest.mark.parametrize("engine", ISOLATING)
def test_a_pair_is_never_torn(engine: str) -> None:
    """Static edges revised as a pair: tf2 shows half of it in every second read."""
    buffer = tfdb.Buffer(concurrency=engine)  # type: ignore[arg-type]
    reads = 4000 if engine == "snapshot" else 1000
    buffer.set_transforms(pair(0.0), static=True)

    def write(count: int) -> None:
        buffer.set_transforms(pair(float(count % 1000)), static=True)

    with running(write, write):
        for _ in range(reads):
            found = buffer.lookup_transform("a", "c").translation
            np.testing.assert_array_equal(found, [0, 1, 2])
        for _ in range(reads // 8):
            with buffer.snapshot() as snapshot:
                first = snapshot.lookup_transform("a", "b").translation
                second = snapshot.lookup_transform("b", "c").translation
                np.testing.assert_array_equal(second, -first[0] * ALONG)
    assert buffer.commit > 100


def test_moving_pairs_written_from_columns_and_bytes() -> None:
    buffer = tfdb.Buffer(history=None)
    stamps = np.arange(40) * 1000
    rest = np.tile([1.0, 2.0, *TILT], (40, 1))

    def columns(child: str, value: float) -> tfdb.Columns:
        poses = np.concatenate([np.full((40, 1), value), rest], axis=1)
        return tfdb.Columns("a", child, stamps, poses)

    def write_columns(count: int) -> None:
        buffer.set_transforms(columns("by_columns", float(count)))

    def write_bytes(count: int) -> None:
        batch = [
            tfdb.TransformStamped("a", "by_bytes", int(stamp), (count, 1, 2), TILT)
            for stamp in stamps
        ]
        buffer.ingest_many([tfdb.encode_tf_message(batch)] * 3, encoding="cdr")

    write_columns(0)
    write_bytes(0)
    with running(write_columns, write_bytes):
        for _ in range(150):
            for child in ("by_columns", "by_bytes"):
                rows = buffer.lookup_transforms("a", child, stamps)
                assert len(np.unique(rows[:, 0])) == 1, "a batch of one commit read in two"


def test_frames_come_and_go_under_readers() -> None:
    buffer = tfdb.Buffer()
    buffer.set_static_transform("map", "base", (1, 2, 3), TILT)

    def come_and_go(count: int) -> None:
        name = f"tool_{count % 5}"
        buffer.set_transform("base", name, count, (count % 5, 1, 2), TILT)
        buffer.remove_frames(name)

    seen = 0
    with running(come_and_go):
        for i in range(20_000):
            number = i % 5
            try:
                found = buffer.lookup_transform("base", f"tool_{number}")
            except tfdb.UnknownFrame:
                continue
            seen += 1
            assert found.translation[0] == number, "a reused slot answered for its old frame"
    print(f"found {seen} of 20000")


def test_a_snapshot_may_be_closed_under_a_batch() -> None:
    buffer = tfdb.Buffer(history=None)
    for stamp in range(1000):
        buffer.set_transform("map", "base", stamp, (stamp, 2, 3), TILT)
    stamps = np.tile(np.arange(1000), 50)
    for _ in range(30):
        snapshot = buffer.snapshot()
        closer = threading.Thread(target=snapshot.close)
        closer.start()
        try:
            rows = snapshot.lookup_transforms("map", "base", stamps)
            np.testing.assert_array_equal(rows[:, 0], stamps)
        except tfdb.errors.SnapshotClosed:
            pass
        closer.join()
        assert snapshot.closed


def test_writers_take_turns_and_lose_nothing() -> None:
    buffer = tfdb.Buffer(history=None)
    each = 20_000

    def write(name: str) -> None:
        for stamp in range(each):
            buffer.set_transform("map", name, stamp, (stamp, 2, 3), TILT, authority=name)

    names = ["one", "two", "three"]
    threads = [threading.Thread(target=write, args=(name,)) for name in names]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert buffer.commit == each * len(names)
    for name in names:
        info = buffer.frame_info(name)
        assert (info.samples, info.newest, info.authority) == (each, each - 1, name)
        np.testing.assert_array_equal(buffer.samples(name)[1][:, 0], np.arange(each))

"""Snapshots are closed while other threads read through them."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

ENGINES = ["snapshot", "giant", "fine", "2pl-no-wait", "2pl-wait-die", "2pl-wound-wait", "silo"]
TURNED = (0.0, 0.0, 0.6, 0.8)


def filled(concurrency: str, clock: Callable[[], int] | None = None) -> tfdb.Buffer:
    """Make a store with a static and a moving edge."""
    buf = tfdb.Buffer(None, concurrency=concurrency, clock=clock)  # type: ignore[arg-type]
    buf.set_static_transform("map", "base", (1, 2, 3), TURNED)
    for stamp in range(100, 2_000, 100):
        buf.set_transform("base", "arm", stamp, (stamp, 0, 0), TURNED)
    return buf


class Closing:
    """Closes a snapshot when its value is read."""

    def __init__(self, snapshot: tfdb.Snapshot, value: float) -> None:
        self._snapshot = snapshot
        self._value = value

    def read(self) -> Any:
        """Close, and give the value."""
        self._snapshot.close()
        # What was freed is put to another use.
        self._other = [bytearray(size) for size in range(16, 256, 8)]
        return self._value


class Number(Closing):
    """A number that does."""

    def __index__(self) -> int:
        return int(self.read())

    def __float__(self) -> float:
        return float(self.read())


class Message(Closing):
    """A message with sec and nanosec that does."""

    @property
    def sec(self) -> int:
        """Whole seconds."""
        return 0

    @property
    def nanosec(self) -> int:
        """Nanoseconds."""
        return int(self.read())


def reads(snapshot: tfdb.Snapshot, stamp: Any, one: Any) -> Iterator[Callable[[], Any]]:
    """Every read that runs code of the caller's."""
    yield lambda: snapshot.lookup_transform("map", "arm", stamp)
    yield lambda: snapshot.can_transform("map", "arm", stamp)
    yield lambda: snapshot.lookup_latest_transform("map", "arm", one, 200)
    yield lambda: snapshot.lookup_latest_transform("map", "arm", 1.0, stamp)
    yield lambda: snapshot.lookup_latest_transform("map", "arm", 1.0)
    yield lambda: snapshot.lookup_transform_full("map", stamp, "arm", stamp, "base")
    yield lambda: snapshot.can_transform_full("map", stamp, "arm", stamp, "base")
    yield lambda: snapshot.lookup_transforms("map", "arm", [stamp])
    yield lambda: snapshot.transform_points("map", "arm", [[one, 2, 3]], stamp)
    yield lambda: snapshot.lookup_velocity("arm", "map", stamp, 1e-7, point=(one, 2, 3))
    yield lambda: snapshot._path_stamps("map", "arm", stamp, stamp)
    yield lambda: snapshot.tree(stamp)
    yield lambda: snapshot.explain("map", "arm", stamp)
    yield lambda: snapshot.trajectory("map", "arm", 10.0, stamp, 500)


@pytest.mark.parametrize("concurrency", ENGINES)
@pytest.mark.parametrize("kind", [Number, Message])
def test_closed_by_an_argument(concurrency: str, kind: type[Number | Message]) -> None:
    held: list[tfdb.Snapshot] = []

    def clock() -> int:
        return int(Closing(held[-1], 200).read())

    buf = filled(concurrency, clock)
    count = len(list(reads(buf.snapshot(), 0, 0)))
    for i in range(count):
        held.append(buf.snapshot())
        call = list(reads(held[-1], kind(held[-1], 150), Number(held[-1], 1)))[i]
        try:
            call()
        except tfdb.errors.SnapshotClosed as error:
            assert error.commit == buf.commit
        assert held[-1].closed


@pytest.mark.parametrize("concurrency", ENGINES)
def test_closed_by_another_thread(concurrency: str) -> None:
    buf = filled(concurrency)
    tools = [f"tool{i}" for i in range(200)]
    for tool in tools:
        buf.set_static_transform("arm", tool, (0, 0, 0), (0, 0, 0, 1))
    stamps = np.full(10_000, 150, dtype=np.int64)
    wanted = buf.lookup_transforms("map", "arm", stamps)
    snapshots = [buf.snapshot() for _ in tools]
    begin = threading.Barrier(3)
    wrong: list[object] = []

    def read(many: bool) -> None:
        begin.wait()
        for snapshot, tool in zip(snapshots, tools, strict=True):
            try:
                # Each time another tool: the names of a path are made at its first lookup.
                if many:
                    same = np.array_equal(snapshot.lookup_transforms("map", "arm", stamps), wanted)
                else:
                    same = snapshot.lookup_transform("map", tool, 150).pose[0] == wanted[0, 0]
            except tfdb.errors.SnapshotClosed:
                continue
            except BaseException as error:
                wrong.append(error)
            else:
                if not same:
                    wrong.append(snapshot)

    def close() -> None:
        begin.wait()
        for snapshot in snapshots:
            buf.set_transform("base", "arm", 150, (9, 9, 9), TURNED)
            snapshot.close()

    threads = [threading.Thread(target=read, args=(many,)) for many in (False, True)]
    threads.append(threading.Thread(target=close))
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []

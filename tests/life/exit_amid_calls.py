"""Ends the interpreter while daemon threads are inside calls.

Run as `exit_amid_calls.py CONCURRENCY TIMES CALL...`; prints how each call's children ended. They
are forked from this process, which has no thread of its own.
"""

from __future__ import annotations

import itertools
import os
import sys
import threading
from typing import TYPE_CHECKING, Any

import numpy as np

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

THREADS = 4
STAMPS = np.arange(1, 20_001, dtype=np.int64)
TURNED = (0.0, 0.0, 0.6, 0.8)


def filled(concurrency: str = "snapshot") -> tfdb.Buffer:
    """Make a store with one moving edge."""
    buf = tfdb.Buffer(None, concurrency=concurrency)
    buf.set_transforms(columns(2_000))
    return buf


def columns(count: int) -> tfdb.Columns:
    """Make samples map <- base."""
    poses = np.tile(np.array([1.0, 2.0, 3.0, *TURNED]), (count, 1))
    return tfdb.Columns("map", "base", STAMPS[:count] * 10, poses)


MESSAGE = tfdb.encode_tf_message([tfdb.TransformStamped("map", "base", 5, (1.0, 2.0, 3.0), TURNED)])


class SlowStamp:
    """A stamp whose attributes are Python code."""

    @property
    def sec(self) -> int:
        """Whole seconds."""
        return sum(range(50)) * 0

    @property
    def nanosec(self) -> int:
        """Nanoseconds."""
        return 100


def generated() -> Iterator[bytes]:
    """Give messages for ever, from Python code."""
    while True:
        yield MESSAGE


def run(buf: tfdb.Buffer) -> None:
    """Read and write in a transaction."""

    def work(tx: tfdb.Transaction) -> None:
        stamp = tx.latest_common_time("map", "base")
        tx.set_transform("map", "base", stamp + 1, (1, 2, 3), TURNED)

    buf.run(work)


def transaction(buf: tfdb.Buffer) -> None:
    """Read through an open transaction, and write at its end."""
    try:
        with buf.transaction() as tx:
            tx.lookup_transforms("map", "base", STAMPS[100:9_000])
            tx.set_transforms(columns(100))
    except tfdb.Conflict:
        return


def remove(buf: tfdb.Buffer) -> None:
    """Make a frame and remove it."""
    name = f"of {threading.get_ident()}"
    buf.set_static_transform("map", name, (1, 2, 3), TURNED)
    buf.remove_frames(name)


def refused(buf: tfdb.Buffer) -> None:
    """Look up what is not there."""
    try:
        buf.lookup_transform("map", "nowhere", 5)
    except tfdb.UnknownFrame:
        return


CALLS: dict[str, Callable[[tfdb.Buffer], Any]] = {
    "clear": lambda buf: buf.clear(),
    "explain": lambda buf: buf.explain("map", "base", 100),
    "generator": lambda buf: buf.ingest_many(generated(), encoding="cdr"),
    "ingest_many": lambda buf: buf.ingest_many([MESSAGE] * 3_000, encoding="cdr"),
    "latest": lambda buf: buf.lookup_latest_transform("map", "base", 1e9, SlowStamp()),
    "lookup_transform": lambda buf: buf.lookup_transform("map", "base", SlowStamp()),
    "lookup_transforms": lambda buf: buf.lookup_transforms("map", "base", STAMPS[10:]),
    "memory": lambda buf: buf.memory(),
    "refused": refused,
    "remove_frames": remove,
    "report": lambda buf: repr(buf.lookup_transform("map", "base", 100).report),
    "run": run,
    "samples": lambda buf: buf.samples("base"),
    "set_transforms": lambda buf: buf.set_transforms(columns(2_000)),
    "set_objects": lambda buf: buf.set_transforms(
        [tfdb.TransformStamped("map", "base", t, (1, 2, 3), TURNED) for t in range(10, 500)]
    ),
    "snapshot": lambda buf: buf.snapshot().lookup_transforms("map", "base", STAMPS[10:]),
    "trajectory": lambda buf: buf.trajectory("map", "base"),
    "transaction": transaction,
    "transform_points": lambda buf: buf.transform_points(
        "map", "base", np.ones((9_000, 3)), STAMPS[10:9_010]
    ),
}


def child(call: Callable[[tfdb.Buffer], Any], concurrency: str) -> None:
    """Begin daemon threads that do nothing else than the call, and return amid it."""
    buf = filled(concurrency)
    inside = threading.Barrier(THREADS + 1)

    def work() -> None:
        inside.wait()
        for _ in itertools.count():
            call(buf)

    for _ in range(THREADS):
        threading.Thread(target=work, daemon=True).start()
    inside.wait()


def main() -> None:
    """Leave many times amid each call, and say how."""
    concurrency, times = sys.argv[1], int(sys.argv[2])
    for name in sys.argv[3:]:
        ends = []
        for _ in range(times):
            pid = os.fork()
            if pid == 0:
                child(CALLS[name], concurrency)
                return
            _, status = os.waitpid(pid, 0)
            ends.append(str(os.waitstatus_to_exitcode(status)))
        print(name, ",".join(ends), flush=True)


if __name__ == "__main__":
    main()

"""Forks a process while its threads are at work in a store, and asks everything of the copy.

Run as `fork.py CONCURRENCY TIMES QUIET`; prints as JSON how each child ended and what became
of each call: `ok`, or the name of the error. A child that hangs is ended by its alarm.
"""

from __future__ import annotations

import itertools
import json
import os
import signal
import sys
import threading
from typing import TYPE_CHECKING, Any

import numpy as np

import tfdb

# What calls import when they are first used is imported before any thread is there: a module that
# another thread was importing at the fork can never be imported in the child.
import tfdb.store.explain
import tfdb.store.report
import tfdb.store.sampling
import tfdb.store.transactions
import tfdb.types

if TYPE_CHECKING:
    from collections.abc import Callable

ALARM_S = 60
STAMPS = np.arange(10, 2_000, 10, dtype=np.int64)
TURNED = (0.0, 0.0, 0.6, 0.8)


def filled(concurrency: str) -> tfdb.Buffer:
    """Make a store of two moving edges and a static one."""
    buf = tfdb.Buffer(None, concurrency=concurrency)
    poses = np.tile(np.array([1.0, 2.0, 3.0, *TURNED]), (len(STAMPS), 1))
    buf.set_transforms(tfdb.Columns("map", "odom", STAMPS, poses), authority="first")
    buf.set_transforms(tfdb.Columns("odom", "base", STAMPS, poses), authority="first")
    buf.set_static_transform("base", "eye", (1, 2, 3), TURNED, authority="first")
    return buf


def batch(stamp: int) -> list[tfdb.TransformStamped]:
    """Make one sample of each moving edge."""
    return [
        tfdb.TransformStamped("map", "odom", stamp, (1, 2, 3), TURNED),
        tfdb.TransformStamped("odom", "base", stamp, (4, 5, 6), TURNED),
    ]


def transaction(buf: tfdb.Buffer) -> None:
    """Read and write in one."""
    with buf.transaction() as tx:
        tx.lookup_transform("map", "base", 500)
        tx.set_transform("odom", "base", 505, (4, 5, 6), TURNED)


READS: dict[str, Callable[[tfdb.Buffer], Any]] = {
    "can_transform": lambda buf: buf.can_transform("map", "base", 500),
    "can_transform_full": lambda buf: buf.can_transform_full("map", 500, "base", 510, "odom"),
    "commit": lambda buf: buf.commit,
    "counters": lambda buf: buf.counters(),
    "explain": lambda buf: buf.explain("map", "eye", 500),
    "frame_exists": lambda buf: buf.frame_exists("base"),
    "frame_info": lambda buf: buf.frame_info("base"),
    "frames": lambda buf: buf.frames(),
    "latest": lambda buf: buf.lookup_latest_transform("map", "eye"),
    "latest_common_time": lambda buf: buf.latest_common_time("map", "base"),
    "lookup_transform": lambda buf: buf.lookup_transform("map", "eye", 500),
    "lookup_transform_full": lambda buf: buf.lookup_transform_full("map", 500, "eye", 510, "odom"),
    "lookup_transforms": lambda buf: buf.lookup_transforms("map", "eye", STAMPS),
    "lookup_velocity": lambda buf: buf.lookup_velocity("map", "base", 500, 1e-8),
    "samples": lambda buf: buf.samples("base"),
    "trajectory": lambda buf: buf.trajectory("map", "base"),
    "transform_points": lambda buf: buf.transform_points("map", "eye", np.ones((9, 3)), 500),
    "tree": lambda buf: buf.tree(500),
}
# What waits for those who are at work, and what writes.
WRITES: dict[str, Callable[[tfdb.Buffer], Any]] = {
    "memory": lambda buf: buf.memory(),
    "snapshot": lambda buf: buf.snapshot().lookup_transform("map", "eye", 500),
    "set_transform": lambda buf: buf.set_transform("map", "odom", 505, (1, 2, 3), TURNED),
    "set_static_transform": lambda buf: buf.set_static_transform("base", "eye", (1, 2, 3), TURNED),
    "set_transforms": lambda buf: buf.set_transforms(batch(507)),
    "set_many": lambda buf: buf.set_transforms(batch(508) * 1_000),
    "set_partly": lambda buf: buf.set_transforms(batch(509), partial=True),
    "ingest": lambda buf: buf.ingest(tfdb.encode_tf_message(batch(511))),
    "new_frame": lambda buf: buf.set_transform("base", "new", 505, (1, 2, 3), TURNED),
    "remove_frames": lambda buf: buf.remove_frames("eye"),
    "reparent": lambda buf: buf.reparent("base", "map", 505),
    "transaction": transaction,
    "run": lambda buf: buf.run(lambda tx: tx.set_transform("map", "odom", 3, (1, 2, 3), TURNED)),
    "clear": lambda buf: buf.clear(),
}


def use(name: str, call: Callable[[tfdb.Buffer], Any], buf: tfdb.Buffer, out: int) -> None:
    """Call it, and tell the parent."""
    os.write(out, f"{name} ".encode())
    try:
        call(buf)
        result = "ok"
    except tfdb.TfdbError as error:
        result = type(error).__name__
    os.write(out, f"{result}\n".encode())


def child(buf: tfdb.Buffer, held: tfdb.Snapshot, out: int) -> None:
    """Ask everything of the copy of a store, and of a store of its own."""
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    signal.alarm(ALARM_S)
    for name, call in (READS | WRITES).items():
        use(name, call, buf, out)
    use("held", lambda _: held.lookup_transform("map", "eye", 500), buf, out)
    own = filled(buf.concurrency)
    for name, call in (READS | WRITES).items():
        use(f"own_{name}", call, own, out)


def forked(buf: tfdb.Buffer, held: tfdb.Snapshot, depth: int = 0) -> dict[str, str]:
    """Fork, `depth` times more in the child; tell how that ended, and what became of each call."""
    there, here = os.pipe()
    pid = os.fork()
    if pid == 0:
        try:
            if depth > 0:
                os.write(here, json.dumps(forked(buf, held, depth - 1)).encode())
            else:
                child(buf, held, here)
        except BaseException as error:
            os.write(here, f"broken {error!r}\n".encode())
            os._exit(1)
        os._exit(0)
    os.close(here)
    with os.fdopen(there) as pipe:
        told = pipe.read()
    _, status = os.waitpid(pid, 0)
    if told.startswith("{"):
        return json.loads(told)
    lines = (line.partition(" ") for line in told.splitlines())
    results = {name: result for name, _, result in lines}
    return {"end": str(os.waitstatus_to_exitcode(status)), **results}


def work(buf: tfdb.Buffer, stop: threading.Event) -> None:
    """Write and read at full speed."""
    name = f"of {threading.get_ident()}"
    for stamp in itertools.count(2_001):
        if stop.is_set():
            return
        buf.set_transforms(batch(stamp), authority=f"{name} at {stamp}")
        buf.set_transforms(batch(stamp - 700))
        buf.set_static_transform("map", name, (1, 2, 3), TURNED)
        buf.tree()
        buf.samples("odom")
        buf.remove_frames(name)
        buf.run(lambda tx, at=stamp: tx.set_transform("odom", "base", at, (1, 2, 3), TURNED))


def main() -> None:
    """Fork many times, and print what became of it."""
    concurrency, times, quiet = sys.argv[1], int(sys.argv[2]), sys.argv[3] == "quiet"
    buf = filled(concurrency)
    held = buf.snapshot()
    stop = threading.Event()
    threads = [threading.Thread(target=work, args=(buf, stop)) for _ in range(0 if quiet else 3)]
    for thread in threads:
        thread.start()
    try:
        results = [forked(buf, held, depth % 2 if quiet else 0) for depth in range(times)]
    finally:
        stop.set()
        for thread in threads:
            thread.join()
    for call in (READS | WRITES).values():
        call(buf)  # the parent has lost nothing
    print(json.dumps(results))


if __name__ == "__main__":
    main()

"""Runs one long call after the other until a signal ends it; run as `interrupted.py CALL`.

Says that it is ready, then calls again and again; the parent sends SIGINT at an instant of its own.
"""

from __future__ import annotations

import signal
import sys
from typing import TYPE_CHECKING, Any

import numpy as np

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable

TURNED = (0.0, 0.0, 0.6, 0.8)
SAMPLES = 20_000
ROWS = 1_500_000
MANY = 100_000
STAMPS = np.linspace(1_000, 19_000_000, ROWS).astype(np.int64)


def filled() -> tfdb.Buffer:
    """Make a store with a chain of moving edges, the last one under another parent half-way."""
    buf = tfdb.Buffer(None)
    poses = np.tile(np.array([1.0, 2.0, 3.0, *TURNED]), (SAMPLES, 1))
    stamps = np.arange(SAMPLES, dtype=np.int64) * 1_000
    for parent, child in (("map", "odom"), ("odom", "base"), ("base", "arm")):
        buf.set_transforms(tfdb.Columns(parent, child, stamps, poses))
    half = SAMPLES // 2
    buf.set_transforms(tfdb.Columns("odom", "moved", stamps[:half], poses[:half]))
    buf.set_transforms(tfdb.Columns("base", "moved", stamps[half:], poses[half:]))
    return buf


def objects(count: int) -> list[tfdb.TransformStamped]:
    """Make a batch of objects."""
    return [
        tfdb.TransformStamped("arm", f"tool {i % 7}", i, (1, 2, 3), TURNED) for i in range(count)
    ]


def calls(buf: tfdb.Buffer) -> dict[str, Callable[[], Any]]:
    """Every call that may take long."""
    many = objects(MANY)
    message = tfdb.encode_tf_message(objects(2))
    messages = [message] * MANY
    points = np.ones((ROWS, 3))
    out = np.empty((ROWS, 7))
    held = buf.snapshot()
    return {
        "lookup_transforms": lambda: buf.lookup_transforms("map", "arm", STAMPS, out=out),
        "snapshot": lambda: held.lookup_transforms("map", "arm", STAMPS, out=out),
        "re-parented": lambda: buf.lookup_transforms("map", "moved", STAMPS, out=out),
        "missing": lambda: buf.lookup_transforms(
            "map", "arm", STAMPS + 5_000_000, out=out, missing="nan"
        ),
        "transform_points": lambda: buf.transform_points("map", "arm", points, STAMPS),
        "stamps of a list": lambda: buf.lookup_transforms("map", "arm", STAMPS.tolist(), out=out),
        "set_transforms": lambda: buf.set_transforms(many),
        "partial": lambda: buf.set_transforms(many, partial=True),
        "ingest_many": lambda: buf.ingest_many(messages, encoding="cdr"),
        "trajectory": lambda: buf.trajectory("map", "arm", 1e8),
        "transaction": lambda: in_transaction(buf),
    }


NAMES = (
    "lookup_transforms",
    "snapshot",
    "re-parented",
    "missing",
    "transform_points",
    "stamps of a list",
    "set_transforms",
    "partial",
    "ingest_many",
    "trajectory",
    "transaction",
)


def in_transaction(buf: tfdb.Buffer) -> None:
    """Look up through a transaction."""
    with buf.transaction() as tx:
        tx.lookup_transforms("map", "moved", STAMPS)


def main() -> None:
    """Call until interrupted, then say what is left."""
    # A parent in the background of a shell has it ignored.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    buf = filled()
    name = sys.argv[1]
    call = calls(buf)[name]
    # This imports modules. Python ends with SIGINT's status if `exec` of a text was interrupted, of
    # which dataclasses are made, although the interrupt was handled.
    buf.trajectory("map", "arm", 1.0)
    commit = buf.commit
    print("ready", flush=True)
    try:
        while True:
            commit = buf.commit
            call()
    except KeyboardInterrupt:
        # A batch is all there or not at all; messages are commits of their own.
        if name in ("set_transforms", "partial"):
            tools = {info.name: info.samples for info in buf.tree() if "tool" in info.name}
            assert buf.commit in (commit, commit + 1), (commit, buf.commit)
            assert len(tools) in (0, 7), tools
            assert sum(tools.values()) in (0, MANY), tools
        elif name != "ingest_many":
            assert buf.commit == commit
        # All goes on as before.
        assert buf.lookup_transform("map", "arm", 5_500).stamp == 5_500
        again = buf.lookup_transforms("map", "arm", STAMPS[:9_000])
        assert np.isfinite(again).all()
        buf.set_static_transform("map", "beside", (1, 2, 3))
        buf.run(lambda tx: tx.set_static_transform("map", "besides", (1, 2, 3)))
        print("ended", flush=True)


if __name__ == "__main__":
    main()

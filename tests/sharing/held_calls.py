"""Every public call on a shared store whose lock for writers is held by a process that is stopped.

Run as `held_calls STORE FOLDER`: it prints the name of each call, then how the call ended. A second
thread answers each line of stdin, which it can only where the call does not keep the GIL.
"""

from __future__ import annotations

import asyncio
import signal
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tfdb

from .child import move_arm, pose_of, say

if TYPE_CHECKING:
    from collections.abc import Callable

RECORDING = Path(__file__).resolve().parents[2] / "examples" / "data" / "pr2.mcap"
CLASSES = (tfdb.Buffer, tfdb.Snapshot, tfdb.Transaction, tfdb.Watch)
STAMP = 1_500  # between the two of the arm
NEVER = 10**9  # no frame has data there

READS: dict[str, Callable[[Any], object]] = {
    "lookup_edges": lambda reads: reads.lookup_edges(["base", "hand"]),
    "tree_columns": lambda reads: reads.tree_columns(),
    "can_transform": lambda reads: reads.can_transform("map", "hand", STAMP),
    "can_transform_full": lambda reads: reads.can_transform_full(
        "map", STAMP, "hand", 1_000, "base"
    ),
    "children": lambda reads: reads.children("map"),
    "closed": lambda reads: reads.closed,
    "commit": lambda reads: reads.commit,
    "common_times": lambda reads: reads.common_times("map", "hand"),
    "descendants": lambda reads: reads.descendants("map"),
    "explain": lambda reads: reads.explain("map", "hand", STAMP),
    "frame_exists": lambda reads: reads.frame_exists("hand"),
    "frame_info": lambda reads: reads.frame_info("hand"),
    "frames": lambda reads: reads.frames(),
    "latest_common_time": lambda reads: reads.latest_common_time("map", "hand"),
    "lookup_latest_transform": lambda reads: reads.lookup_latest_transform("map", "hand"),
    "lookup_transform": lambda reads: reads.lookup_transform("map", "hand", STAMP),
    "lookup_transform_full": lambda reads: reads.lookup_transform_full(
        "map", STAMP, "hand", 1_000, "base"
    ),
    "lookup_transforms": lambda reads: reads.lookup_transforms("map", "hand", [STAMP] * 10_000),
    "lookup_velocity": lambda reads: reads.lookup_velocity("map", "hand", STAMP, 1e-6),
    "parent_of": lambda reads: reads.parent_of("hand"),
    "path": lambda reads: reads.path("map", "hand"),
    "samples": lambda reads: reads.samples("hand"),
    "trajectory": lambda reads: reads.trajectory("map", "hand"),
    "transform_points": lambda reads: reads.transform_points(
        "map", "hand", [[1.0, 2, 3]] * 10_000, STAMP
    ),
    "tree": lambda reads: reads.tree(),
}

# Further calls, by class and name; a word after the name tells two ways to call it apart.
Table = dict[str, "Callable[[], object]"]


def calls_that_wait(buffer: tfdb.Buffer) -> Table:
    """Calls that need the lock, or data that no writer can store meanwhile."""
    pose = pose_of(3)
    one = tfdb.TransformStamped("map", "base", 3_000, **pose)
    many = [one] * 5_000
    message = tfdb.encode_tf_message([one])
    columns = tfdb.Columns("map", "base", [3_000], [[1.0, 2, 3, 0, 0, 0.6, 0.8]])
    path = tfdb.Trajectory("map", "base", [3_000], columns.poses)

    def commit(write: Callable[[tfdb.Transaction], object]) -> None:
        with buffer.transaction() as tx:
            write(tx)

    def run_alone() -> None:
        with buffer._attempt(0, alone=True, age=0) as tx:
            tx.set_transform("map", "base", 3_000, **pose)

    async def wait_for_commit() -> None:
        await buffer.wait_for_commit_async(buffer.commit)

    async def wait_for_transform() -> None:
        await buffer.wait_for_transform_async("map", "hand", NEVER)

    other = tfdb.Buffer()
    other.set_transform("world", "map", 3_000, **pose)
    commits = other.commits_bytes(0)
    return {
        "Buffer.apply": lambda: buffer.apply(commits),
        "Buffer.clear": buffer.clear,
        "Buffer.compact": buffer.compact,
        "Buffer.forget_source": lambda: buffer.forget_source("missing"),
        "Buffer.ingest": lambda: buffer.ingest(message),
        "Buffer.ingest_many": lambda: buffer.ingest_many([message] * 3, encoding="cdr"),
        "Buffer.load": lambda: buffer.load(RECORDING),
        "Buffer.memory": buffer.memory,
        "Buffer.remove_frames": lambda: buffer.remove_frames("hand"),
        "Buffer.remove_frames many": lambda: buffer.remove_frames(["hand", "base"]),
        "Buffer.reparent": lambda: buffer.reparent("hand", "map", 3_000),
        "Buffer.run": lambda: buffer.run(lambda tx: tx.set_transform("map", "base", 9, **pose)),
        "Buffer.set_static_transform": lambda: buffer.set_static_transform("map", "new", **pose),
        "Buffer.set_transform": lambda: buffer.set_transform("map", "base", 3_000, **pose),
        "Buffer.set_trajectory": lambda: buffer.set_trajectory("map", "base", path),
        "Buffer.set_transforms": lambda: buffer.set_transforms([one]),
        "Buffer.set_transforms many": lambda: buffer.set_transforms(many),
        "Buffer.set_transforms columns": lambda: buffer.set_transforms(columns),
        "Buffer.set_transforms partial": lambda: buffer.set_transforms([one], partial=True),
        "Buffer.set_transforms partial columns": lambda: buffer.set_transforms(
            columns, partial=True
        ),
        "Watch.next": lambda: buffer.watch("hand").next(buffer.commit),
        "Buffer.wait_for_commit": lambda: buffer.wait_for_commit(buffer.commit),
        "Buffer.wait_for_commit_async": lambda: asyncio.run(wait_for_commit()),
        "Buffer.wait_for_transform": lambda: buffer.wait_for_transform("map", "hand", NEVER),
        "Buffer.wait_for_transform_async": lambda: asyncio.run(wait_for_transform()),
        "Transaction.set_transform committed": lambda: commit(
            lambda tx: tx.set_transform("map", "base", 3_000, **pose)
        ),
        "Transaction.remove_frames committed": lambda: commit(lambda tx: tx.remove_frames("hand")),
        "Transaction.set_transform alone": run_alone,
    }


def inside(buffer: tfdb.Buffer, call: Callable[[Any], object]) -> Callable[[], object]:
    """The call on a transaction, which is then aborted."""

    def attempt() -> None:
        with buffer.transaction() as tx:
            call(tx)
            tx.abort()

    return attempt


def on_snapshot(buffer: tfdb.Buffer, call: Callable[[Any], object]) -> Callable[[], object]:
    """The call on a snapshot."""

    def ask() -> None:
        with buffer.snapshot() as snapshot:
            call(snapshot)

    return ask


def calls_of_transactions() -> dict[str, Callable[[tfdb.Transaction], object]]:
    """What a transaction keeps until its commit, and so needs no lock before."""
    pose = pose_of(3)
    one = tfdb.TransformStamped("map", "base", 3_000, **pose)
    return {
        "abort": lambda tx: tx.abort(),
        "clear": lambda tx: tx.clear(),
        "commit": lambda tx: tx.commit,
        "closed": lambda tx: tx.closed,
        "remove_frames": lambda tx: tx.remove_frames("hand"),
        "reparent": lambda tx: tx.reparent("hand", "map", 2_000),
        "set_static_transform": lambda tx: tx.set_static_transform("map", "new", **pose),
        "set_transform": lambda tx: tx.set_transform("map", "base", 3_000, **pose),
        "set_transforms": lambda tx: tx.set_transforms([one]),
    }


def calls_that_answer(buffer: tfdb.Buffer, name: str, folder: Path) -> Table:
    """What needs no lock, and so is not kept from its answer."""
    own = f"{name}-own"

    def remove() -> None:
        tfdb.Buffer.open(own, size=1 << 25, max_frames=100).close()
        tfdb.Buffer.unlink(own)

    table: Table = {
        "Buffer.add_rule": lambda: buffer.add_rule(print, "base").remove(),
        "Buffer.changes": lambda: buffer.changes(0),
        "Buffer.clock": buffer.clock.now,
        "Buffer.close": lambda: tfdb.Buffer.open(name).close(),
        "Buffer.commits_bytes": lambda: buffer.commits_bytes(0),
        "Buffer.concurrency": lambda: buffer.concurrency,
        "Buffer.counters": buffer.counters,
        "Buffer.epoch": lambda: buffer.epoch,
        "Buffer.events": lambda: buffer.events().close(),
        "Buffer.expect": lambda: buffer.expect("map", "base", deadline=1).remove(),
        "Buffer.expectations": lambda: len(buffer.expectations),
        "Buffer.follow": lambda: buffer.follow().close(),
        "Buffer.freeze": lambda: buffer.freeze(folder / "buffer.tfdb"),
        "Buffer.frozen": lambda: buffer.frozen,
        "Buffer.history": lambda: buffer.history,
        "Buffer.open": lambda: tfdb.Buffer.open(name),
        "Buffer.positions": buffer.positions,
        "Buffer.rule": lambda: buffer.rule("base")(print),
        "Buffer.rules": lambda: len(buffer.rules),
        "Buffer.shared": lambda: buffer.shared,
        "Buffer.snapshot": buffer.snapshot,
        "Buffer.transaction": buffer.transaction,
        "Buffer.unlink": remove,
        "Buffer.watch": lambda: buffer.watch("hand"),
        "Snapshot.at": on_snapshot(buffer, lambda reads: reads.at(reads.commit)),
        "Snapshot.close": on_snapshot(buffer, lambda reads: reads.close()),
        "Snapshot.freeze": on_snapshot(
            buffer, lambda reads: reads.freeze(folder / "snapshot.tfdb")
        ),
        "Watch.close": lambda: buffer.watch("hand").close(),
        "Watch.closed": lambda: buffer.watch("hand").closed,
        "Watch.frames": lambda: buffer.watch("hand").frames,
        "Watch.pairs": lambda: buffer.watch("hand").pairs,
        "Watch.next at once": lambda: buffer.watch("hand").next(0),
        "Snapshot.state_bytes": on_snapshot(buffer, lambda reads: reads.state_bytes()),
    }
    for called, call in READS.items():
        table[f"Buffer.{called}"] = lambda call=call: call(buffer)
        table[f"Snapshot.{called}"] = on_snapshot(buffer, call)
        if hasattr(tfdb.Transaction, called):
            table[f"Transaction.{called}"] = inside(buffer, call)
    for called, change in calls_of_transactions().items():
        table[f"Transaction.{called}"] = inside(buffer, change)
    return table


def public() -> set[str]:
    """The public names of the classes."""
    return {f"{each.__name__}.{name}" for each in CLASSES for name in dir(each) if name[0] != "_"}


def answer_lines() -> None:
    for line in sys.stdin:
        say("heard", line.strip())


def ready(buffer: tfdb.Buffer) -> None:
    """Store what the calls ask for."""
    move_arm(buffer, 1)
    move_arm(buffer, 2)


def main(name: str, folder: str) -> None:
    signal.signal(signal.SIGINT, signal.default_int_handler)
    threading.Thread(target=answer_lines, daemon=True).start()
    buffer = tfdb.Buffer.open(name, create=False, lock_timeout=None)
    answers = calls_that_answer(buffer, name, Path(folder))
    for called, call in (answers | calls_that_wait(buffer)).items():
        say(called)
        try:
            call()
        except KeyboardInterrupt:
            say("interrupted")
        else:
            say("answered")


if __name__ == "__main__":
    main(*sys.argv[1:])

"""tfdb itself, through its public Python API."""

from __future__ import annotations

import random
import sys
import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scenario

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable

BATCH = 100_000
COLUMNS = 10_000
CALLS = 64  # of few stamps each, which a loop cycles through


def status(field: str) -> int:
    """Bytes of this process, as the kernel has them: VmRSS, or VmHWM since it was last reset."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{field}:"):
            return 1024 * int(line.split()[1])
    raise ValueError(field)


class Contender:
    """Holds one chain; `operations` are the loops that are timed."""

    def setup(self, chain: int, samples: int) -> None:
        self.names = scenario.names(chain)
        self.buffer = self.empty_buffer()
        for i, stamp in enumerate(scenario.samples(samples)):
            for edge in range(chain):
                pose = scenario.moving_pose(edge, 1e-3 * i)
                parent, child = self.names[edge], self.names[edge + 1]
                self.buffer.set_transform(parent, child, stamp, pose[:3], pose[3:])
        self.mid = scenario.mid_stamps(samples)
        self.next = scenario.START + samples * scenario.PERIOD
        self.out = np.empty((BATCH, 7))
        self.operations: dict[str, Callable[[int], int | None]] = {
            "lookup mid": self.lookup_mid,
            "lookup mid, matrix": self.lookup_mid_matrix,
            "lookup latest": self.lookup_latest,
            "newest of each edge": self.newest_of_each,
            "newest of each edge, matrix": self.newest_of_each_matrix,
            "can_transform": self.can_transform,
            "set_transform": self.set_transform,
            "set_transform, numpy": self.set_transform_numpy,
        }
        for title, span, is_sorted in (
            ("batch sorted", samples, True),
            ("batch unsorted", samples, False),
            ("batch sorted, 0.1 s scan", 100, True),
            ("batch unsorted, 0.1 s scan", 100, False),
        ):
            stamps = np.array(
                scenario.spread_stamps(10_000, BATCH, span=span, is_sorted=is_sorted), np.int64
            )
            stamps += (samples - 10_000) * scenario.PERIOD
            self.operations[title] = self.batch(stamps)
        for count in scenario.FEW:
            for title, span in scenario.SPANS:
                stamps = np.array(
                    scenario.spread_stamps(samples, CALLS * count, span=span, is_sorted=False),
                    np.int64,
                ).reshape(CALLS, count)
                stamps.sort(axis=1)
                row = f"{count} stamps in one call{title}"
                self.operations[row] = self.few(list(stamps))
                self.operations[f"{row}, one by one"] = self.one_by_one(stamps.ravel().tolist())
        self.columns_of = np.array(scenario.poses(0, samples, COLUMNS))
        self.operations["columns"] = self.columns
        self.operations["adaptive"] = self.adaptive

    def empty_buffer(self) -> tfdb.Buffer:
        return tfdb.Buffer(history=10.0)

    def pose(self, stamp: int) -> Any:
        return self.buffer.lookup_transform(self.names[0], self.names[-1], stamp).pose

    def lookup_mid(self, count: int) -> None:
        lookup, target, source = self.buffer.lookup_transform, self.names[0], self.names[-1]
        for _ in range(count // len(self.mid)):
            for stamp in self.mid:
                lookup(target, source, stamp)

    def lookup_mid_matrix(self, count: int) -> None:
        lookup, target, source = self.buffer.lookup_transform, self.names[0], self.names[-1]
        for _ in range(count // len(self.mid)):
            for stamp in self.mid:
                lookup(target, source, stamp).matrix  # noqa: B018 - what transform-tree returns

    def lookup_latest(self, count: int) -> None:
        lookup, target, source = self.buffer.lookup_transform, self.names[0], self.names[-1]
        for _ in range(count):
            lookup(target, source)

    def newest_of_each(self, count: int) -> None:
        lookup, target, source = self.buffer.lookup_latest_transform, self.names[0], self.names[-1]
        for _ in range(count):
            lookup(target, source)

    def newest_of_each_matrix(self, count: int) -> None:
        lookup, target, source = self.buffer.lookup_latest_transform, self.names[0], self.names[-1]
        for _ in range(count):
            lookup(target, source).matrix  # noqa: B018 - what transform-tree returns

    def can_transform(self, count: int) -> None:
        can, target, source = self.buffer.can_transform, self.names[0], self.names[-1]
        for _ in range(count // len(self.mid)):
            for stamp in self.mid:
                can(target, source, stamp)

    def write(self, count: int, translation: Any, rotation: Any) -> None:
        store, parent, child = self.buffer.set_transform, self.names[0], self.names[1]
        first, self.next = self.next, self.next + count * scenario.PERIOD
        for stamp in range(first, self.next, scenario.PERIOD):
            store(parent, child, stamp, translation, rotation)

    def set_transform(self, count: int) -> None:
        pose = scenario.moving_pose(0, 0.5)
        self.write(count, pose[:3], pose[3:])

    def set_transform_numpy(self, count: int) -> None:
        pose = np.array(scenario.moving_pose(0, 0.5))
        self.write(count, pose[:3].copy(), pose[3:].copy())

    def batch(self, stamps: np.ndarray) -> Callable[[int], int]:
        def run(count: int) -> int:
            repeats = max(1, count // BATCH)
            for _ in range(repeats):
                self.buffer.lookup_transforms(self.names[0], self.names[-1], stamps, out=self.out)
            return repeats * BATCH

        return run

    def few(self, calls: list[np.ndarray]) -> Callable[[int], int]:
        out = np.empty((len(calls[0]), 7))

        def run(count: int) -> int:
            lookup, target, source = self.buffer.lookup_transforms, self.names[0], self.names[-1]
            repeats = max(1, count // (len(calls) * len(out)))
            for _ in range(repeats):
                for stamps in calls:
                    lookup(target, source, stamps, out=out)
            return repeats * len(calls) * len(out)

        return run

    def one_by_one(self, stamps: list[int]) -> Callable[[int], int]:
        def run(count: int) -> int:
            lookup, target, source = self.buffer.lookup_transform, self.names[0], self.names[-1]
            repeats = max(1, count // len(stamps))
            for _ in range(repeats):
                for stamp in stamps:
                    lookup(target, source, stamp)
            return repeats * len(stamps)

        return run

    def columns(self, count: int) -> int:
        """Samples of the first edge, 10,000 in each call."""
        calls = max(1, count // COLUMNS)
        parent, child = self.names[0], self.names[1]
        for _ in range(calls):
            stamps = self.next + scenario.PERIOD * np.arange(COLUMNS)
            self.buffer.set_transforms(tfdb.Columns(parent, child, stamps, self.columns_of))
            self.next += COLUMNS * scenario.PERIOD
        return calls * COLUMNS

    def adaptive(self, count: int) -> int:
        """As few poses as do, of 1,000 samples."""
        newest = self.mid[0] // scenario.PERIOD * scenario.PERIOD
        oldest = newest - 1_000 * scenario.PERIOD
        calls = max(1, count // 1_000)
        for _ in range(calls):
            path = self.buffer.trajectory(self.names[0], self.names[-1], start=oldest, end=newest)
            path.simplify(scenario.NEAR, scenario.NEAR)
        return calls * 1_000

    def near_the_newest(self, samples: int) -> list[int]:
        """Stamps at which contenders are compared."""
        return scenario.mid_stamps(samples, 64)

    def all_over(self, oldest: int, newest: int) -> list[int]:
        """Stamps at which loaded recordings are compared."""
        rng = random.Random(5)
        return [rng.randrange(oldest, newest) for _ in range(64)]

    def long_recording(self, samples: int) -> dict[str, float]:
        """Sorted batches over one edge of many samples: time a stamp, memory while they run."""
        buffer = tfdb.Buffer(history=None)
        pose = np.array(scenario.poses(0, 0, COLUMNS))
        for first in range(0, samples, COLUMNS):
            count = min(COLUMNS, samples - first)
            stamps = scenario.START + scenario.PERIOD * np.arange(first, first + count)
            buffer.set_transforms(tfdb.Columns("map", "base", stamps, pose[:count]))
        found: dict[str, float] = {}
        for name, span in (("ns", samples - 1), ("ns_of_10_s", min(10_000, samples - 1))):
            stamps = np.array(
                scenario.spread_stamps(samples, BATCH, span=span, is_sorted=True), np.int64
            )
            out = np.empty((BATCH, 7))
            took = []
            for _ in range(8):
                start = time.process_time_ns()
                buffer.lookup_transforms("map", "base", stamps, out=out)
                took.append((time.process_time_ns() - start) / BATCH)
            found[name] = sorted(took[1:])[3]
        for name, count in (("working_bytes", BATCH), ("working_bytes_of_many", samples)):
            stamps = np.array(
                scenario.spread_stamps(samples, count, span=samples - 1, is_sorted=True), np.int64
            )
            found[name] = _working_bytes(buffer, stamps)
        return found

    def many_frames(self, count: int) -> dict[str, float]:
        """Edges of many frames at one stamp, and their facts: the time of each of them."""
        buffer = tfdb.Buffer(history=None)
        names = tuple(f"frame_{i}" for i in range(count))
        for k in range(100):
            stamps = np.full(count, scenario.START + k * scenario.PERIOD)
            poses = np.array(scenario.poses(0, k * count, count))
            buffer.set_transforms(tfdb.Columns("map", names, stamps, poses))
        stamp = scenario.START + 50 * scenario.PERIOD + scenario.PERIOD // 3
        out = np.empty((count, 7))

        def one_by_one() -> None:
            for i, name in enumerate(names):
                out[i] = buffer.lookup_transform("map", name, stamp).pose

        one_by_one()
        if not np.array_equal(out, buffer.lookup_edges(names, stamp)):
            sys.exit("the edges at one stamp are not those of single lookups")
        calls: dict[str, Callable[[], object]] = {
            "lookup_edges": lambda: buffer.lookup_edges(names, stamp, out=out),
            "lookup_edges, each one's newest": lambda: buffer.lookup_edges(names, out=out),
            "lookup_transform": one_by_one,
            "tree_columns": buffer.tree_columns,
            "tree": buffer.tree,
        }
        return {name: _best(call) / count for name, call in calls.items()}

    def batch_poses(self, stamps: list[int]) -> list[list[float]]:
        """For comparing the batch's values with the others'."""
        where = self.names[0], self.names[-1]
        poses: list[list[float]] = self.buffer.lookup_transforms(*where, np.array(stamps)).tolist()
        return poses

    def load(self, path: str) -> dict[str, float]:
        """Seconds of CPU that a recording takes, and the memory of the process afterwards."""
        before = status("VmRSS")
        start = time.process_time()
        buffer = tfdb.load(path)
        seconds = time.process_time() - start
        infos = [info for info in buffer.tree() if info.oldest is not None]
        self.buffer = buffer
        return {
            "seconds": seconds,
            "samples": sum(info.samples for info in infos),
            "resident": status("VmRSS") - before,
            "oldest": max(info.oldest or 0 for info in infos),
            "newest": min(info.newest or 0 for info in infos),
        }

    def poses_at(self, target: str, source: str, stamps: list[int]) -> list[list[float]]:
        lookup = self.buffer.lookup_transform
        return [lookup(target, source, stamp).pose.tolist() for stamp in stamps]


def _best(call: Callable[[], object]) -> float:
    """Nanoseconds of CPU of the median of a few calls."""
    took = []
    for _ in range(9):
        start = time.process_time_ns()
        call()
        took.append(time.process_time_ns() - start)
    return float(sorted(took)[4])


def _working_bytes(buffer: tfdb.Buffer, stamps: np.ndarray) -> float:
    """How far a batch in a fresh thread takes the process's memory, its output aside."""
    out = np.ones((len(stamps), 7))  # its pages are there already
    grown: list[float] = []

    def work() -> None:
        Path("/proc/self/clear_refs").write_text("5")  # the high-water mark starts anew
        before = status("VmRSS")
        buffer.lookup_transforms("map", "base", stamps, out=out)
        grown.append(max(0, status("VmHWM") - before))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    return grown[0]

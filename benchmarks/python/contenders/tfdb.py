"""tfdb itself, through its public Python API."""

from __future__ import annotations

import resource
import time
from typing import TYPE_CHECKING, Any

import numpy as np
import scenario

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable

BATCH = 100_000


class Contender:
    """Holds one chain; `operations` are the loops that are timed."""

    def setup(self, chain: int, samples: int) -> None:
        self.names = scenario.names(chain)
        self.buffer = tfdb.Buffer(history=10.0)
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

    def batch_poses(self, stamps: list[int]) -> list[list[float]]:
        """For comparing the batch's values with the others'."""
        where = self.names[0], self.names[-1]
        poses: list[list[float]] = self.buffer.lookup_transforms(*where, np.array(stamps)).tolist()
        return poses

    def load(self, path: str) -> dict[str, float]:
        """Seconds of CPU and bytes of memory that a recording takes."""
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        start = time.process_time()
        buffer = tfdb.load(path)
        seconds = time.process_time() - start
        grown = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
        stored = sum(buffer.frame_info(name).samples for name in buffer.frames())
        self.buffer = buffer
        return {"seconds": seconds, "samples": stored, "grown": grown}

    def poses_at(self, target: str, source: str, stamps: list[int]) -> list[list[float]]:
        lookup = self.buffer.lookup_transform
        return [lookup(target, source, stamp).pose.tolist() for stamp in stamps]

"""PyPI transform-tree (imported as tf_tree): compiled plans, and lookups by name."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import scenario
import tf_tree

if TYPE_CHECKING:
    from collections.abc import Callable

BATCH = 100_000
COLUMNS = 10_000
CALLS = 64


def resident() -> int:
    """Bytes of memory that this process has."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096


class Contender:
    """Holds one chain; `operations` are the loops that are timed."""

    def setup(self, chain: int, samples: int) -> None:
        self.names = scenario.names(chain)
        edges = list(zip(self.names, self.names[1:], strict=False))
        self.tree = self.empty_tree(edges, samples)
        self.publishers = []
        stamps = np.array(scenario.samples(samples), np.int64)
        for edge in range(chain):
            publisher = self.tree.publisher(self.names[edge + 1], self.names[edge])
            self.publishers.append(publisher.__enter__())
            publisher.push_many(stamps, self._rows(scenario.poses(edge, 0, samples)))
        self.plan = self.tree.plan(self.names[0], self.names[-1])
        self.mid = scenario.mid_stamps(samples)
        self.next = scenario.START + samples * scenario.PERIOD
        self.out = np.empty((BATCH, 7))
        self.operations: dict[str, Callable[[int], int | None]] = {
            "lookup mid": self.plan_at,
            "lookup mid by name": self.lookup,
            "lookup latest": self.latest,
            "set_transform": self.push,
        }
        for title, span, is_sorted in (
            ("batch sorted", samples, True),
            ("batch unsorted", samples, False),
            ("batch sorted, 0.1 s scan", 100, True),
            ("batch unsorted, 0.1 s scan", 100, False),
        ):
            queries = np.array(
                scenario.spread_stamps(10_000, BATCH, span=span, is_sorted=is_sorted), np.int64
            )
            queries += (samples - 10_000) * scenario.PERIOD
            self.operations[title] = self.batch(queries)
        for count in scenario.FEW:
            for title, span in scenario.SPANS:
                few = np.array(
                    scenario.spread_stamps(samples, CALLS * count, span=span, is_sorted=False),
                    np.int64,
                ).reshape(CALLS, count)
                few.sort(axis=1)
                self.operations[f"{count} stamps in one call{title}"] = self.few(list(few))
        self.columns_of = self._rows(scenario.poses(0, samples, COLUMNS))
        self.operations["columns"] = self.columns
        self.operations["adaptive"] = self.adaptive

    def empty_tree(self, edges: list[tuple[str, str]], samples: int) -> tf_tree.Tree:
        # "lerpslerp" is the interpolation of tf2 and of tfdb.
        return tf_tree.build(edges, capacity=samples + 1, interp="lerpslerp")

    @staticmethod
    def _rows(poses: list[scenario.Pose]) -> np.ndarray:
        """Poses in this library's order."""
        return np.array(poses)[:, [6, 3, 4, 5, 0, 1, 2]].copy()

    def pose(self, stamp: int) -> Any:
        qw, qx, qy, qz, x, y, z = self.plan.at(stamp, layout="quat")
        return x, y, z, qx, qy, qz, qw

    def plan_at(self, count: int) -> None:
        at = self.plan.at
        for _ in range(count // len(self.mid)):
            for stamp in self.mid:
                at(stamp)

    def lookup(self, count: int) -> None:
        lookup, target, source = self.tree.lookup, self.names[0], self.names[-1]
        for _ in range(count // len(self.mid)):
            for stamp in self.mid:
                lookup(target, source, stamp)

    def latest(self, count: int) -> None:
        latest = self.plan.latest
        for _ in range(count):
            latest()

    def push(self, count: int) -> None:
        push = self.publishers[0].push
        x, y, z, qx, qy, qz, qw = scenario.moving_pose(0, 0.5)
        pose = [qw, qx, qy, qz, x, y, z]
        first, self.next = self.next, self.next + count * scenario.PERIOD
        for stamp in range(first, self.next, scenario.PERIOD):
            push(stamp, pose)

    def few(self, calls: list[np.ndarray]) -> Callable[[int], int]:
        out = np.empty((len(calls[0]), 7))

        def run(count: int) -> int:
            repeats = max(1, count // (len(calls) * len(out)))
            for _ in range(repeats):
                for stamps in calls:
                    self.plan.at_into(stamps, out, layout="quat")
            return repeats * len(calls) * len(out)

        return run

    def columns(self, count: int) -> int:
        """Samples of the first edge, 10,000 in each call."""
        calls = max(1, count // COLUMNS)
        for _ in range(calls):
            stamps = self.next + scenario.PERIOD * np.arange(COLUMNS)
            self.publishers[0].push_many(stamps, self.columns_of)
            self.next += COLUMNS * scenario.PERIOD
        return calls * COLUMNS

    def adaptive(self, count: int) -> int:
        """As few poses as do, of 1,000 samples."""
        newest = self.mid[0] // scenario.PERIOD * scenario.PERIOD
        oldest = newest - 1_000 * scenario.PERIOD
        calls = max(1, count // 1_000)
        for _ in range(calls):
            self.plan.adaptive(oldest, newest, lin=scenario.NEAR, ang=scenario.NEAR)
        return calls * 1_000

    def resident(self, samples: int) -> float:
        """Bytes of memory a sample, of ten edges that hold so many together."""
        each = samples // 10
        names = scenario.names(10)
        before = resident()
        tree = tf_tree.build(list(itertools.pairwise(names)), capacity=each + 1, interp="lerpslerp")
        pose = self._rows(scenario.poses(0, 0, COLUMNS))
        for edge in range(10):
            with tree.publisher(names[edge + 1], names[edge]) as publisher:
                for first in range(0, each, COLUMNS):
                    count = min(COLUMNS, each - first)
                    stamps = scenario.START + scenario.PERIOD * np.arange(first, first + count)
                    publisher.push_many(stamps, pose[:count])
        self.tree = tree
        return (resident() - before) / (10 * each)

    def batch(self, stamps: np.ndarray) -> Callable[[int], int]:
        def run(count: int) -> int:
            repeats = max(1, count // BATCH)
            for _ in range(repeats):
                self.plan.at_into(stamps, self.out, layout="quat")
            return repeats * BATCH

        return run

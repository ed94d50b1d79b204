"""PyPI transform-tree (imported as tf_tree): compiled plans, and lookups by name."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import scenario
import tf_tree

if TYPE_CHECKING:
    from collections.abc import Callable

BATCH = 100_000


class Contender:
    """Holds one chain; `operations` are the loops that are timed."""

    def setup(self, chain: int, samples: int) -> None:
        self.names = scenario.names(chain)
        edges = list(zip(self.names, self.names[1:], strict=False))
        # "lerpslerp" is the interpolation of tf2 and of tfdb.
        self.tree = tf_tree.build(edges, capacity=samples + 1, interp="lerpslerp")
        self.publishers = []
        stamps = np.array(scenario.samples(samples), np.int64)
        for edge in range(chain):
            publisher = self.tree.publisher(self.names[edge + 1], self.names[edge])
            self.publishers.append(publisher.__enter__())
            poses = [scenario.moving_pose(edge, 1e-3 * i) for i in range(samples)]
            x, y, z, qx, qy, qz, qw = np.array(poses).T
            publisher.push_many(stamps, np.stack([qw, qx, qy, qz, x, y, z], axis=1).copy())
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

    def batch(self, stamps: np.ndarray) -> Callable[[int], int]:
        def run(count: int) -> int:
            repeats = max(1, count // BATCH)
            for _ in range(repeats):
                self.plan.at_into(stamps, self.out, layout="quat")
            return repeats * BATCH

        return run

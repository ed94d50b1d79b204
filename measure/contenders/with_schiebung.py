"""PyPI schiebung; its wheels need Python 3.12, so this runs in an environment of its own."""

from __future__ import annotations

from typing import Any

import scenario
import schiebung


class Contender:
    """Holds one chain; `operations` are the loops that are timed."""

    def setup(self, chain: int, samples: int) -> None:
        self.names = scenario.names(chain)
        self.buffer = schiebung.BufferTree()
        moving = schiebung.TransformType.Dynamic
        for i, stamp in enumerate(scenario.samples(samples)):
            updates = []
            for edge in range(chain):
                pose = scenario.moving_pose(edge, 1e-3 * i)
                isometry = schiebung.StampedIsometry(list(pose[:3]), list(pose[3:]), stamp)
                updates.append((self.names[edge], self.names[edge + 1], isometry, moving))
            self.buffer.update_batch(updates)
        self.mid = scenario.mid_stamps(samples)
        self.operations = {"lookup mid": self.lookup_mid, "lookup latest": self.lookup_latest}

    def pose(self, stamp: int) -> Any:
        # Its "from" is our target: the transform maps points of `to` into `from`.
        result = self.buffer.lookup_transform(self.names[0], self.names[-1], stamp)
        return [*result.translation(), *result.rotation()]

    def lookup_mid(self, count: int) -> None:
        lookup, target, source = self.buffer.lookup_transform, self.names[0], self.names[-1]
        for _ in range(count // len(self.mid)):
            for stamp in self.mid:
                lookup(target, source, stamp)

    def lookup_latest(self, count: int) -> None:
        lookup = self.buffer.lookup_latest_transform
        target, source = self.names[0], self.names[-1]
        for _ in range(count):
            lookup(target, source)

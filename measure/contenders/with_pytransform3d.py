"""PyPI pytransform3d's TemporalTransformManager; interpolates by screw motions (ScLERP)."""

from __future__ import annotations

from typing import Any

import numpy as np
import scenario
from pytransform3d import rotations, transformations
from pytransform3d.transform_manager import NumpyTimeseriesTransform, TemporalTransformManager

BATCH = 1_000


class Contender:
    """Holds one chain; `operations` are the loops that are timed. Times are seconds there."""

    def setup(self, chain: int, samples: int) -> None:
        self.names = scenario.names(chain)
        self.manager = TemporalTransformManager()
        times = np.array(scenario.samples(samples)) * 1e-9
        for edge in range(chain):
            poses = np.array([scenario.moving_pose(edge, 1e-3 * i) for i in range(samples)])
            order = [0, 1, 2, 6, 3, 4, 5]  # x y z, then w first
            series = NumpyTimeseriesTransform(times, poses[:, order])
            self.manager.add_transform(self.names[edge + 1], self.names[edge], series)
        self.mid = [stamp * 1e-9 for stamp in scenario.mid_stamps(samples)]
        stamps = scenario.spread_stamps(10_000, BATCH, span=samples, is_sorted=True)
        self.batch_times = np.array(stamps) * 1e-9 + (samples - 10_000) * 1e-9 * scenario.PERIOD
        self.operations = {"lookup mid": self.lookup_mid, "batch sorted": self.batch}

    def pose(self, stamp: int) -> Any:
        matrix = self.manager.get_transform_at_time(self.names[-1], self.names[0], stamp * 1e-9)
        pq = transformations.pq_from_transform(matrix)
        return [*pq[:3], *rotations.quaternion_xyzw_from_wxyz(pq[3:])]

    def lookup_mid(self, count: int) -> int:
        get, target, source = self.manager.get_transform_at_time, self.names[0], self.names[-1]
        for i in range(count):
            get(source, target, self.mid[i % len(self.mid)])
        return count

    def batch(self, count: int) -> int:
        repeats = max(1, count // BATCH)
        for _ in range(repeats):
            self.manager.get_transform_at_time(self.names[-1], self.names[0], self.batch_times)
        return repeats * BATCH

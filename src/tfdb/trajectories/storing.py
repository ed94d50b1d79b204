"""Stores trajectories in buffers."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tfdb.data.argument_checks import refuse_without
from tfdb.data.poses import missing
from tfdb.data.types import Columns
from tfdb.store.forgotten import missing_samples, warn_of_forgotten

if TYPE_CHECKING:
    from tfdb._core import Buffer
    from tfdb.data.types import TrajectoryLike


__all__: list[str] = []


def store_trajectory(
    buffer: Buffer, parent: str, child: str, trajectory: TrajectoryLike, authority: str
) -> int:
    """Implements `Buffer.set_trajectory`."""
    refuse_without(trajectory, "trajectory", "one with stamps and poses", "stamps", "poses")
    stamps = trajectory.stamps
    columns = Columns(parent, child, stamps, trajectory.poses)
    there = ~missing(columns.poses)
    if len(stamps) == len(columns) and not there.all():
        stamps = np.asarray(stamps)[there]
        columns = Columns(parent, child, stamps, columns.poses[there])
    commit = buffer.set_transforms(columns, authority=authority)
    if buffer.history is not None:
        forgotten = missing_samples(buffer, child, stamps)
        if forgotten:
            warn_of_forgotten(buffer, forgotten, 4)
    return commit

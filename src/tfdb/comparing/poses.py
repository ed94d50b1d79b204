"""Rows of poses `[x y z qx qy qz qw]`: relative to each other, and at other stamps."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from tfdb.data import poses as geometry
from tfdb.data.policies import Interpolate
from tfdb.data.stamps import MAX_STAMP

if TYPE_CHECKING:
    from tfdb.trajectories.trajectory import Trajectory

Array: TypeAlias = npt.NDArray[np.float64]
Stamps: TypeAlias = npt.NDArray[np.int64]
Rows: TypeAlias = npt.NDArray[np.intp]
Mask: TypeAlias = npt.NDArray[np.bool_]


def relative(a: Array, b: Array) -> Array:
    """Return T_a^-1 T_b, row by row."""
    back = geometry.conjugate(a[:, 3:])
    moved = geometry.rotate(back, b[:, :3] - a[:, :3])
    return np.hstack((moved, geometry.multiply(back, b[:, 3:])))


def angles(poses: Array) -> Array:
    """Return the rotation angle of each pose: radians, 0 to pi."""
    angle: Array = 2.0 * np.arctan2(np.linalg.norm(poses[:, 3:6], axis=1), np.abs(poses[:, 6]))
    return angle


def distances(poses: Array) -> Array:
    """Return the length of each pose's translation: metres."""
    distance: Array = np.linalg.norm(poses[:, :3], axis=1)
    return distance


def there(trajectory: Trajectory) -> Mask:
    """Return for each row whether it holds a pose."""
    return geometry.found(trajectory.poses)


def poses_at(trajectory: Trajectory, stamps: Stamps, max_gap: int) -> Array:
    """Interpolate poses (M, 7) as a store does.

    NaN outside of the data, and in gaps of more than `max_gap` nanoseconds.
    """
    made = np.full((len(stamps), 7), np.nan)
    # An offset may lead to negative stamps, at which no lookup is possible.
    inside = (stamps >= trajectory.stamps[0]) & (stamps <= trajectory.stamps[-1])
    policy = Interpolate(max_gap_ns=min(max_gap, MAX_STAMP))
    if inside.any():
        made[inside] = trajectory.at(stamps[inside], policy, missing="nan")
    return made

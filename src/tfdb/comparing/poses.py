"""Rows of poses `[x y z qx qy qz qw]`: chained, relative to each other, at other stamps."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from .._core import Buffer
from ..types import Columns

if TYPE_CHECKING:
    from ..trajectory import Trajectory

Array: TypeAlias = npt.NDArray[np.float64]
Stamps: TypeAlias = npt.NDArray[np.int64]
Rows: TypeAlias = npt.NDArray[np.intp]
Mask: TypeAlias = npt.NDArray[np.bool_]


def rotations_product(a: Array, b: Array) -> Array:
    """Quaternions (N, 4) of the rotations a after b."""
    ax, ay, az, aw = a.T
    bx, by, bz, bw = b.T
    rows = (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )
    return np.stack(rows, axis=1)


def turned_back(quaternions: Array, vectors: Array) -> Array:
    """Vectors (N, 3) in the frames whose orientations the quaternions are."""
    axis, w = -quaternions[:, :3], quaternions[:, 3:]
    twice = 2.0 * np.cross(axis, vectors)
    return vectors + w * twice + np.cross(axis, twice)


def relative(a: Array, b: Array) -> Array:
    """T_a^-1 T_b, row by row."""
    back = a[:, 3:] * (-1.0, -1.0, -1.0, 1.0)
    moved = turned_back(a[:, 3:], b[:, :3] - a[:, :3])
    return np.hstack((moved, rotations_product(back, b[:, 3:])))


def angles(poses: Array) -> Array:
    """By how much each pose rotates: radians, 0 to pi."""
    angle: Array = 2.0 * np.arctan2(np.linalg.norm(poses[:, 3:6], axis=1), np.abs(poses[:, 6]))
    return angle


def distances(poses: Array) -> Array:
    """By how much each pose translates: metres."""
    distance: Array = np.linalg.norm(poses[:, :3], axis=1)
    return distance


def there(trajectory: Trajectory) -> Mask:
    """Which rows hold a pose."""
    mask: Mask = np.asarray(np.isfinite(trajectory.poses).all(axis=1))
    return mask


def poses_at(trajectory: Trajectory, stamps: Stamps, max_gap: int) -> Array:
    """Poses (M, 7) interpolated as a store does it.

    NaN where a neighbour is not there, or both are more than `max_gap` nanoseconds apart.
    """
    made = np.full((len(stamps), 7), np.nan)
    good = there(trajectory)
    last = len(trajectory.stamps) - 1
    after = np.searchsorted(trajectory.stamps, stamps)
    inside = (after <= last) & (stamps >= trajectory.stamps[0])
    after = np.minimum(after, last)
    before = np.where(trajectory.stamps[after] == stamps, after, np.maximum(after - 1, 0))
    near = trajectory.stamps[after] - trajectory.stamps[before] <= max_gap
    known = inside & good[before] & good[after] & near
    if known.any():
        store = Buffer(history=None)
        store.set_transforms(
            Columns("target", "source", trajectory.stamps[good], trajectory.poses[good])
        )
        made[known] = store.lookup_transforms("target", "source", stamps[known])
    return made

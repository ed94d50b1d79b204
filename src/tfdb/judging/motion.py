"""How an edge moves between its samples: jumps, and poses that go there and back.

Pure functions over columns, as in `doctor`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Rows = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]

JUMP_SPEED = 300.0
"""Metres per second. No robot drives or flies faster between two samples."""
JUMP_DISTANCE = 10.0
"""Metres. A shorter jump may be a correction of a localization."""
JUMP_FACTOR = 20.0
"""A jump is so many times faster than the edge usually moves."""

TURN_DISTANCE = 0.1
"""Metres between two publishers that disagree."""
TURN_ANGLE = np.radians(5)
"""Radians between two publishers that disagree."""
HALF_TURN = np.radians(150)
"""Radians. A wheel that turns half round between two samples seems to go there and back."""
TURN_FACTOR = 10.0
"""The distance there is so many times the usual distance between every other sample."""
TURN_RETURN = 0.2
"""The samples before and after are nearer to each other than this part of the distance there."""
TURN_COUNT = 5
"""At least so many samples go there and back."""
TURN_SHARE = 0.01
"""At least this part of the samples goes there and back."""


@dataclass(frozen=True)
class Turns:
    """Rows of samples that go there and back, and the largest distance: metres or radians."""

    rows: Rows
    furthest: float
    is_angle: bool


def jump_rows(stamps: Rows, positions: Floats) -> Rows:
    """Find the rows after which the position jumps. The stamps are sorted."""
    seconds = np.diff(stamps) / 1e9
    if not len(seconds):
        return np.zeros(0, dtype=np.int64)
    distance = length(np.diff(positions, axis=0))
    speed = np.divide(distance, seconds, out=np.zeros_like(distance), where=seconds > 0)
    usual = float(np.median(speed))
    limit = max(JUMP_SPEED, JUMP_FACTOR * usual)
    return np.flatnonzero((speed > limit) & (distance > JUMP_DISTANCE))


def turns(poses: Floats) -> Turns | None:
    """Find poses that jump there and back, as those of two publishers in turns.

    The samples before and after such a pose are near each other, and the pose is far from both. It
    is much further than the usual distance between every other sample, which noise never is.
    """
    if len(poses) < 3:
        return None
    ways = length(np.diff(poses[:, :3], axis=0)), angle(poses[1:], poses[:-1])
    backs = length(poses[2:, :3] - poses[:-2, :3]), angle(poses[2:], poses[:-2])
    least, most = (TURN_DISTANCE, TURN_ANGLE), (np.inf, HALF_TURN)
    for is_angle in (False, True):
        way, back = ways[is_angle], backs[is_angle]
        shorter = np.minimum(way[1:], way[:-1])
        usual = float(np.quantile(back, 0.25))
        limit = max(least[is_angle], TURN_FACTOR * usual)
        away = (shorter > limit) & (shorter < most[is_angle]) & (back < TURN_RETURN * shorter)
        rows = np.flatnonzero(away) + 1
        if len(rows) >= max(TURN_COUNT, TURN_SHARE * len(poses)):
            return Turns(rows, float(shorter[rows - 1].max()), is_angle)
    return None


def length(vectors: Floats) -> Floats:
    """Return the length of each row."""
    found: Floats = np.sqrt((vectors**2).sum(axis=1))
    return found


def angle(one: Floats, other: Floats) -> Floats:
    """Return the radians between the rotations of poses, row by row."""
    cosine = np.abs((one[:, 3:] * other[:, 3:]).sum(axis=1))
    found: Floats = 2 * np.arccos(np.minimum(cosine, 1.0))
    return found

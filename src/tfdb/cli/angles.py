"""Rotations for people."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Sequence


def roll_pitch_yaw(rotation: Sequence[float] | Any) -> list[float]:
    """Degrees about the fixed x, y and z axes of a quaternion x y z w, as ROS means it.

    Where the pitch is 90 degrees only the sum of roll and yaw is determined; the yaw takes it.
    """
    x, y, z, w = (float(value) for value in rotation)
    sine = max(-1.0, min(1.0, 2 * (w * y - z * x)))
    if abs(sine) > 1 - 1e-12:
        yaw = -2 * math.copysign(1.0, sine) * math.atan2(x, w)
        return [0.0, math.degrees(math.copysign(math.pi / 2, sine)), math.degrees(_wrap(yaw))]
    roll = math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return [math.degrees(roll), math.degrees(math.asin(sine)), math.degrees(yaw)]


def _wrap(angle: float) -> float:
    return math.atan2(math.sin(angle), math.cos(angle))


def quaternion_of(roll: float, pitch: float, yaw: float) -> list[float]:
    """Quaternion x y z w of turns about the fixed x, then y, then z axis, in radians."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in (roll, pitch, yaw))
    return [
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ]

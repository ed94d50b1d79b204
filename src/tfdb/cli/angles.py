"""Printed rotations."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import tfdb

if TYPE_CHECKING:
    from collections.abc import Sequence


def roll_pitch_yaw(rotation: Sequence[float] | Any) -> list[float]:
    """`Transform.rpy` of a quaternion x y z w, in degrees."""
    rpy = tfdb.Transform("fixed", "turned", (0.0, 0.0, 0.0), rotation).rpy
    return [math.degrees(angle) for angle in rpy]


def quaternion_of(roll: float, pitch: float, yaw: float) -> list[float]:
    """Quaternion x y z w of turns about the fixed x, then y, then z axis, in radians."""
    turned: list[float] = tfdb.Transform(
        "fixed", "turned", (0.0, 0.0, 0.0), rpy=(roll, pitch, yaw)
    ).rotation.tolist()
    return turned

"""Printed rotations."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import tfdb

if TYPE_CHECKING:
    from tfdb import Transform


def pose_body(pose: Transform) -> dict[str, Any]:
    """Return a pose as JSON; `lookup` and `echo` use the same keys."""
    translation, rotation, rpy, matrix = pose._numbers()
    return {
        "translation": translation,
        "rotation_xyzw": rotation,
        "rpy_deg": list(map(math.degrees, rpy)),
        "matrix": matrix,
    }


def quaternion_of(roll: float, pitch: float, yaw: float) -> list[float]:
    """Return the quaternion x y z w of rotations about the fixed axes x, then y, then z."""
    turned: list[float] = tfdb.Transform(
        "fixed", "turned", (0.0, 0.0, 0.0), rpy=(roll, pitch, yaw)
    ).rotation.tolist()
    return turned

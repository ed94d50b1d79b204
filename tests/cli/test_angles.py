"""Printed roll, pitch and yaw describe the looked-up rotation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tfdb
from tfdb.cli.angles import pose_body


def quaternion(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """Return the quaternion of Rz(yaw) Ry(pitch) Rx(roll), angles in degrees."""
    result = np.array([0.0, 0.0, 0.0, 1.0])
    for axis, angle in ((2, yaw), (1, pitch), (0, roll)):
        step = np.zeros(4)
        step[axis], step[3] = math.sin(math.radians(angle) / 2), math.cos(math.radians(angle) / 2)
        x, y, z, w = result
        a, b, c, d = step
        result = np.array(
            [
                w * a + x * d + y * c - z * b,
                w * b - x * c + y * d + z * a,
                w * c + x * b - y * a + z * d,
                w * d - x * a - y * b - z * c,
            ]
        )
    return result


def roll_pitch_yaw(rotation: np.ndarray) -> list[float]:
    """Return the printed angles in degrees."""
    found: list[float] = pose_body(tfdb.Transform("a", "b", (1, 2, 3), rotation))["rpy_deg"]
    return found


angles = st.floats(-179.0, 179.0)


@given(angles, st.floats(-89.9, 89.9), angles)
def test_there_and_back(roll: float, pitch: float, yaw: float) -> None:
    found = roll_pitch_yaw(quaternion(roll, pitch, yaw))
    assert np.allclose(found, (roll, pitch, yaw), atol=1e-4)


@pytest.mark.parametrize("pitch", [90.0, -90.0])
@given(roll=angles, yaw=angles)
def test_straight_up_and_down_is_the_same_rotation(pitch: float, roll: float, yaw: float) -> None:
    wanted = quaternion(roll, pitch, yaw)
    found = quaternion(*roll_pitch_yaw(wanted))
    assert abs(float(wanted @ found)) == pytest.approx(1.0, abs=1e-9)


def test_a_pose_as_json_has_the_numbers_of_the_arrays() -> None:
    pose = tfdb.Transform("a", "b", (0.1, -2 / 3, 1e9), quaternion(10, 20, 30))
    body = pose_body(pose)
    assert list(body["translation"]) == pose.translation.tolist()
    assert list(body["rotation_xyzw"]) == pose.rotation.tolist()
    assert [list(row) for row in body["matrix"]] == pose.matrix.tolist()
    assert body["rpy_deg"] == [math.degrees(angle) for angle in pose.rpy]

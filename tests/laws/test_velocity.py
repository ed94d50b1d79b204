"""Velocities of rigid motions whose answer is known."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import tfdb

from .motions import (
    SECOND,
    START,
    Array,
    Pose,
    Vector,
    about,
    axes,
    matrix_of,
    multiply,
    poses,
    same_matrix,
    translations,
    vectors,
)

RATE = 50
PERIOD = SECOND // RATE
COUNT = 101
MIDDLE = START + COUNT // 2 * PERIOD
speeds = st.floats(0.1, 3.0)


def moving(velocity: Vector, axis: Vector, speed: float, begin: Pose) -> tfdb.Buffer:
    """`base` drifts in `map` with `velocity` and turns about `axis` at `speed`, for two seconds."""
    buffer = tfdb.Buffer(history=None)
    place, rotation = begin
    for i in range(COUNT):
        time = i / RATE
        moved = [p + v * time for p, v in zip(place, velocity, strict=True)]
        turned = multiply(about(axis, speed * time), rotation)
        buffer.set_transform("map", "base", START + i * PERIOD, moved, turned)
    return buffer


def unit(axis: Vector) -> Array:
    return np.array(axis, dtype=np.float64) / math.hypot(*axis)


@given(translations, axes, speeds, poses)
def test_constant_velocity_is_found_exactly(
    velocity: Vector, axis: Vector, speed: float, begin: Pose
) -> None:
    buffer = moving(velocity, axis, speed, begin)
    found = buffer.lookup_velocity("map", "base", MIDDLE)
    np.testing.assert_allclose(found.linear, velocity, atol=1e-9)
    np.testing.assert_allclose(found.angular, speed * unit(axis), atol=1e-9)


@given(translations, axes, speeds, poses, vectors)
def test_a_point_of_the_body_swings_round(
    velocity: Vector, axis: Vector, speed: float, begin: Pose, point: Vector
) -> None:
    """v(p) = v + w x (p - origin): the lever arm is that of the point, in the same axes."""
    buffer = moving(velocity, axis, speed, begin)
    found = buffer.lookup_velocity("map", "base", MIDDLE, point=point)
    base = buffer.lookup_transform("map", "base", MIDDLE)
    omega = speed * unit(axis)
    lever = base.apply(np.array(point)) - base.translation
    np.testing.assert_allclose(found.linear, velocity + np.cross(omega, lever), atol=1e-7)
    distance = np.linalg.norm(lever - (lever @ unit(axis)) * unit(axis))
    swing = np.linalg.norm(found.linear - np.array(velocity))
    np.testing.assert_allclose(swing, speed * distance, atol=1e-7)
    in_map = base.apply(np.array(point))
    same = buffer.lookup_velocity("map", "base", MIDDLE, point=in_map, point_frame="map")
    np.testing.assert_allclose(same.linear, found.linear, atol=1e-7)


@given(translations, axes, speeds, poses, poses)
def test_the_reference_frame_only_turns_the_axes(
    velocity: Vector, axis: Vector, speed: float, begin: Pose, other: Pose
) -> None:
    buffer = moving(velocity, axis, speed, begin)
    buffer.set_static_transform("map", "other", *other)
    plain = buffer.lookup_velocity("map", "base", MIDDLE)
    turned = buffer.lookup_velocity("map", "base", MIDDLE, reference="other")
    rotation = matrix_of(other)[:3, :3].T
    same_matrix(turned.linear, rotation @ plain.linear, 1e-9)
    same_matrix(turned.angular, rotation @ plain.angular, 1e-9)


@given(translations, axes, speeds, poses)
def test_seen_from_the_body_the_world_turns_the_other_way(
    velocity: Vector, axis: Vector, speed: float, begin: Pose
) -> None:
    buffer = moving(velocity, axis, speed, begin)
    there = buffer.lookup_velocity("map", "base", MIDDLE)
    back = buffer.lookup_velocity("base", "map", MIDDLE, reference="map")
    np.testing.assert_allclose(back.angular, -there.angular, atol=1e-9)


@given(translations, axes, speeds, poses)
def test_the_window_stays_within_the_data(
    velocity: Vector, axis: Vector, speed: float, begin: Pose
) -> None:
    """At the newest stamp the same motion has the same velocity."""
    buffer = moving(velocity, axis, speed, begin)
    found = buffer.lookup_velocity("map", "base")
    np.testing.assert_allclose(found.linear, velocity, atol=1e-9)
    np.testing.assert_allclose(found.angular, speed * unit(axis), atol=1e-9)

"""Between two samples: a straight line at constant speed, a turn about one axis likewise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import tfdb

from .motions import (
    SECOND,
    START,
    Pose,
    Vector,
    about,
    angle_between,
    axes,
    between,
    poses,
    quaternions,
    same_matrix,
    spans,
    translations,
)

even_spans = spans.map(lambda span: 4 * span)


def clearly_shorter_one_way(first: Pose, second: Pose) -> bool:
    """At half a turn apart both ways are equally short, and rounding decides."""
    return abs(float(np.dot(first[1], second[1]))) > 1e-6


@given(poses, poses, spans)
def test_the_ends_are_the_samples(first: Pose, second: Pose, span: int) -> None:
    buffer = between(first, second, START, span)
    for pose, stamp in ((first, START), (second, START + span)):
        found = buffer.lookup_transform("map", "base", stamp)
        np.testing.assert_array_equal(found.translation, pose[0])
        np.testing.assert_allclose(found.rotation, pose[1], atol=1e-15)
        assert found.report.edges[0].used == "exact"


@given(poses, poses, even_spans)
def test_halfway_is_the_mean_and_the_half_turn(first: Pose, second: Pose, span: int) -> None:
    assume(clearly_shorter_one_way(first, second))
    found = between(first, second, START, span).lookup_transform("map", "base", START + span // 2)
    mean = (np.array(first[0]) + np.array(second[0])) / 2
    same_matrix(found.translation, mean, 1e-14)
    whole = angle_between(first[1], second[1])
    assert angle_between(first[1], found.rotation) == pytest.approx(whole / 2, abs=1e-9)
    assert angle_between(found.rotation, second[1]) == pytest.approx(whole / 2, abs=1e-9)


@given(poses, poses, spans, st.floats(0.0, 1.0))
def test_speed_is_constant_and_quaternions_stay_unit(
    first: Pose, second: Pose, span: int, share: float
) -> None:
    assume(clearly_shorter_one_way(first, second))
    offset = round(share * span)
    found = between(first, second, START, span).lookup_transform("map", "base", START + offset)
    share = offset / span
    line = np.array(first[0]) + share * (np.array(second[0]) - np.array(first[0]))
    same_matrix(found.translation, line, 1e-13)
    whole = angle_between(first[1], second[1])
    assert angle_between(first[1], found.rotation) == pytest.approx(share * whole, abs=1e-9)
    assert np.linalg.norm(found.rotation) == pytest.approx(1.0, abs=1e-14)


@given(poses, poses, spans, st.floats(0.0, 1.0))
def test_time_can_run_backwards(first: Pose, second: Pose, span: int, share: float) -> None:
    """The samples exchanged, and the stamp mirrored: the same pose."""
    assume(clearly_shorter_one_way(first, second))
    offset = round(share * span)
    there = between(first, second, START, span).lookup_transform("map", "base", START + offset)
    back = between(second, first, START, span)
    mirrored = back.lookup_transform("map", "base", START + span - offset)
    same_matrix(there.matrix, mirrored.matrix, 1e-12)


@given(poses, quaternions, translations, spans, st.floats(0.0, 1.0))
def test_the_sign_of_a_quaternion_means_nothing(
    first: Pose, rotation: tuple[float, ...], translation: Vector, span: int, share: float
) -> None:
    second: Pose = (translation, rotation)  # type: ignore[assignment]
    assume(clearly_shorter_one_way(first, second))
    other: Pose = (translation, tuple(-q for q in rotation))  # type: ignore[assignment]
    time = START + round(share * span)
    one = between(first, second, START, span).lookup_transform("map", "base", time)
    same_matrix(
        between(first, other, START, span).lookup_transform("map", "base", time).matrix,
        one.matrix,
        1e-13,
    )


@given(axes, st.floats(0.2, 3.0), translations, st.integers(1, 10))
def test_extrapolation_goes_on_at_the_same_speed(
    axis: Vector, turn: float, velocity: Vector, seconds: int
) -> None:
    """Constant velocity and constant turn: beyond the ends the pose is where it would be."""

    def pose_at(time: float) -> Pose:
        place = tuple(v * time for v in velocity)
        return place, about(axis, 0.3 + turn * time)  # type: ignore[return-value]

    buffer = between(pose_at(0.0), pose_at(1.0), START, SECOND)
    policy = tfdb.Extrapolate(max=float(seconds))
    for time in (-seconds, 1 + seconds):
        found = buffer.lookup_transform("map", "base", START + time * SECOND, policy)
        place, rotation = pose_at(float(time))
        same_matrix(found.translation, place, 1e-12)
        assert angle_between(found.rotation, rotation) < 1e-9
        assert found.report.extrapolated
        with pytest.raises(tfdb.Extrapolation):
            buffer.lookup_transform("map", "base", START + time * SECOND)


@given(poses, poses, spans, st.floats(0.0, 1.0))
def test_policies_that_pick_take_one_of_the_samples(
    first: Pose, second: Pose, span: int, share: float
) -> None:
    buffer = between(first, second, START, span)
    offset = round(share * span)
    at_first = buffer.lookup_transform("map", "base", START).pose.tobytes()
    at_second = buffer.lookup_transform("map", "base", START + span).pose.tobytes()
    held = buffer.lookup_transform("map", "base", START + offset, tfdb.Previous())
    nearest = buffer.lookup_transform("map", "base", START + offset, tfdb.Nearest())
    assert held.pose.tobytes() == (at_first if offset < span else at_second)
    assert nearest.pose.tobytes() == (at_first if 2 * offset <= span else at_second)

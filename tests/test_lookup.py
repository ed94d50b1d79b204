"""Single lookups against numpy, their policies, reports and explanations."""

from __future__ import annotations

import itertools
from array import array
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from oracle import interpolate, matrix, quaternion
from robot import COUNT, MOVING, PERIOD, SECOND, STATIC, Robot, make_robot, stamp_of

if TYPE_CHECKING:
    from collections.abc import Callable

FRAMES = sorted({*MOVING, *MOVING.values(), *STATIC})
TURN = quaternion((1, -2, 0.5), 0.9)
BACK = quaternion((0, 1, 3), -1.4)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return make_robot()


def ramp() -> tfdb.Buffer:
    """One edge with samples at 10, 20 and 40 s."""
    buffer = tfdb.Buffer(history=None)
    for seconds, rotation in ((10, TURN), (20, BACK), (40, TURN)):
        buffer.set_transform("map", "base", seconds * SECOND, (seconds, 2, -3), rotation)
    return buffer


# -- values ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("target", "source"), list(itertools.product(FRAMES, FRAMES)))
def test_every_pair_of_frames_agrees_with_numpy(robot: Robot, target: str, source: str) -> None:
    for index in (0, 0.25, 7, 11.5, 38.999, COUNT - 1):
        stamp = stamp_of(index)
        found = robot.buffer.lookup_transform(target, source, stamp)
        expected = robot.oracle.lookup(target, source, stamp)
        np.testing.assert_allclose(found.matrix, expected, atol=1e-12)
        assert (found.target, found.source, found.stamp) == (target, source, stamp)
        assert found.commit == robot.buffer.commit
        assert robot.buffer.can_transform(target, source, stamp)


def test_arguments_may_be_named(robot: Robot) -> None:
    stamp = stamp_of(3.5)
    found = robot.buffer.lookup_transform(
        policy=tfdb.Interpolate(), stamp=stamp, source="camera", target="map"
    )
    assert found == robot.buffer.lookup_transform("map", "camera", stamp)
    assert robot.buffer.can_transform("map", source="camera", stamp=stamp)
    latest = robot.buffer.lookup_latest_transform(target="map", source="camera", max_age=None)
    assert latest == robot.buffer.lookup_latest_transform("map", "camera")


def test_names_are_compared_by_value(robot: Robot) -> None:
    """The cache of names compares objects, and stays right for equal and new ones."""
    stamp = stamp_of(3.5)
    expected = robot.buffer.lookup_transform("map", "camera", stamp)
    for i in range(2000):
        name = "".join(["cam", "era"])
        missing = f"camera{i}"
        assert robot.buffer.lookup_transform("map", name, stamp) == expected
        assert not robot.buffer.can_transform("map", missing, stamp)


def test_no_time_is_the_latest_common_time(robot: Robot) -> None:
    buffer = tfdb.Buffer()
    buffer.set_transform("map", "odom", 10, (1, 2, 3), TURN)
    buffer.set_transform("map", "odom", 30, (4, 2, 3), TURN)
    buffer.set_transform("odom", "base", 20, (1, 2, 3), BACK)
    found = buffer.lookup_transform("map", "base")
    assert found.stamp == buffer.latest_common_time("map", "base") == 20
    assert (
        found
        == buffer.lookup_transform("map", "base", 20)
        != buffer.lookup_transform("map", "odom")
    )
    assert buffer.latest_common_time("odom", "odom") == 30
    assert robot.buffer.latest_common_time("lidar", "base") == 0
    assert robot.buffer.latest_common_time("map", "camera") == stamp_of(COUNT - 1)


def test_latest_takes_each_edges_own_newest() -> None:
    buffer = tfdb.Buffer(clock=lambda: 10 * SECOND)
    buffer.set_transform("map", "odom", 9 * SECOND, (1, 2, 3), TURN)
    buffer.set_transform("odom", "base", 7 * SECOND, (-1, 2, 3), BACK)
    buffer.set_static_transform("base", "camera", (0, 0, 1), TURN)
    found = buffer.lookup_latest_transform("map", "camera")
    expected = matrix([1, 2, 3, *TURN]) @ matrix([-1, 2, 3, *BACK]) @ matrix([0, 0, 1, *TURN])
    np.testing.assert_allclose(found.matrix, expected, atol=1e-14)
    assert found.stamp == 7 * SECOND
    assert [edge.age for edge in found.report.edges] == [0, 2 * SECOND, 0]
    assert found.report.limiting_edge is not None
    assert found.report.limiting_edge.child == "base"
    assert buffer.lookup_latest_transform("base", "camera").stamp == 0
    assert buffer.lookup_latest_transform("map", "camera", 3.0) == found
    with pytest.raises(tfdb.errors.Stale) as caught:
        buffer.lookup_latest_transform("map", "camera", max_age=2.5)
    assert caught.value.edge == "base"
    assert caught.value.limit == 2_500_000_000
    assert buffer.lookup_latest_transform("map", "camera", 2.5, now=9 * SECOND) == found


def test_the_same_frame_is_the_identity(robot: Robot) -> None:
    found = robot.buffer.lookup_transform("camera", "camera", 7)
    np.testing.assert_array_equal(found.matrix, np.eye(4))
    assert found.stamp == 7
    assert found.report.edges == ()
    assert robot.buffer.lookup_transform("odom", "odom").stamp == stamp_of(COUNT - 1)


def test_a_long_chain_agrees_with_numpy() -> None:
    buffer = tfdb.Buffer()
    expected = np.eye(4)
    for i in range(300):
        pose = (0.01 * i, 0.02, -0.03, *quaternion((i, 1, 2), 0.1))
        buffer.set_transform(f"f{i}", f"f{i + 1}", 10, pose[:3], pose[3:])
        expected = expected @ matrix(pose)
    found = buffer.lookup_transform("f0", "f300", 10)
    np.testing.assert_allclose(found.matrix, expected, atol=1e-11)
    assert len(found.report.edges) == 300


def test_a_fixed_frame_joins_two_times(robot: Robot) -> None:
    then, now = stamp_of(4.25), stamp_of(20.5)
    found = robot.buffer.lookup_transform_full("base", now, "camera", then, "map")
    expected = robot.oracle.lookup("base", "map", now) @ robot.oracle.lookup("map", "camera", then)
    np.testing.assert_allclose(found.matrix, expected, atol=1e-12)
    assert (found.target, found.source) == ("base", "camera")
    assert robot.buffer.can_transform_full("base", now, "camera", then, "map")
    assert not robot.buffer.can_transform_full("base", now, "camera", 5, "map")
    with pytest.raises(tfdb.UnknownFrame) as caught:
        robot.buffer.lookup_transform_full("base", now, "camera", then, "world")
    assert caught.value.frame == "world"


# -- policies --------------------------------------------------------------------------------------


def test_interpolate_refuses_wide_gaps() -> None:
    buffer = ramp()
    first, second = ([10, 2, -3, *TURN], [20, 2, -3, *BACK])
    found = buffer.lookup_transform("map", "base", 12_500_000_000, tfdb.Interpolate(10.0))
    np.testing.assert_allclose(found.matrix, matrix(interpolate(first, second, 0.25)), atol=1e-14)
    with pytest.raises(tfdb.errors.GapTooLarge) as caught:
        buffer.lookup_transform("map", "base", 30 * SECOND, tfdb.Interpolate(10.0))
    error = caught.value
    assert (error.edge, error.parent, error.stamp) == ("base", "map", 30 * SECOND)
    assert (error.before, error.after, error.limit) == (20 * SECOND, 40 * SECOND, 10 * SECOND)
    assert buffer.can_transform("map", "base", 40 * SECOND, tfdb.Interpolate(0.0))


def test_exact_takes_stored_stamps_only() -> None:
    buffer = ramp()
    found = buffer.lookup_transform("map", "base", 20 * SECOND, tfdb.Exact())
    assert found.pose == pytest.approx([20, 2, -3, *BACK], abs=0)
    with pytest.raises(tfdb.errors.NoSampleNear) as caught:
        buffer.lookup_transform("map", "base", 20 * SECOND + 1, tfdb.Exact())
    assert caught.value.edge == "base"


def test_previous_holds() -> None:
    buffer = ramp()
    found = buffer.lookup_transform("map", "base", 39 * SECOND, tfdb.Previous())
    assert found.pose == pytest.approx([20, 2, -3, *BACK], abs=0)
    assert found.report.edges[0].used == "held"
    assert found.report.age == 19 * SECOND
    assert buffer.can_transform("map", "base", 100 * SECOND, tfdb.Previous(60.0))
    with pytest.raises(tfdb.errors.Stale) as caught:
        buffer.lookup_transform("map", "base", 39 * SECOND, tfdb.Previous(max_age=18.0))
    assert caught.value.limit == 18 * SECOND
    with pytest.raises(tfdb.Extrapolation) as past:
        buffer.lookup_transform("map", "base", 9 * SECOND, tfdb.Previous())
    assert past.value.reason == "past"


def test_nearest_takes_the_closest() -> None:
    buffer = ramp()
    for seconds, expected in ((5, 10), (15, 10), (16, 20), (31, 40), (99, 40)):
        found = buffer.lookup_transform("map", "base", seconds * SECOND, tfdb.Nearest())
        assert found.translation[0] == expected
        assert found.report.edges[0].before == expected * SECOND
    with pytest.raises(tfdb.errors.NoSampleNear) as caught:
        buffer.lookup_transform("map", "base", 30 * SECOND, tfdb.Nearest(tolerance=9.0))
    assert caught.value.limit == 9 * SECOND


def test_extrapolate_goes_on_at_constant_velocity() -> None:
    buffer = ramp()
    policy = tfdb.Extrapolate(max=5.0)
    found = buffer.lookup_transform("map", "base", 44 * SECOND, policy)
    assert found.translation == pytest.approx([44, 2, -3])
    assert found.report.extrapolated
    assert not found.report.interpolated
    before = buffer.lookup_transform("map", "base", 8 * SECOND, policy)
    assert before.translation == pytest.approx([8, 2, -3])
    inside = buffer.lookup_transform("map", "base", 14 * SECOND, policy)
    assert inside == buffer.lookup_transform("map", "base", 14 * SECOND)
    with pytest.raises(tfdb.Extrapolation):
        buffer.lookup_transform("map", "base", 46 * SECOND, policy)


@pytest.mark.parametrize(("seconds", "reason"), [(9, "past"), (41, "future")])
def test_nothing_is_extrapolated_unasked(seconds: int, reason: str) -> None:
    with pytest.raises(tfdb.Extrapolation) as caught:
        ramp().lookup_transform("map", "base", seconds * SECOND)
    error = caught.value
    assert (error.reason, error.stamp) == (reason, seconds * SECOND)
    assert (error.oldest, error.newest) == (10 * SECOND, 40 * SECOND)
    assert (error.target, error.source, error.edge) == ("map", "base", "base")


def test_disconnected_names_both_roots(robot: Robot) -> None:
    buffer = make_robot().buffer
    buffer.set_static_transform("world", "table", (1, 2, 3), TURN)
    with pytest.raises(tfdb.Disconnected) as caught:
        buffer.lookup_transform("table", "camera")
    assert set(caught.value.frames or ()) == {"world", "map"}
    assert "world" in str(caught.value)
    assert "map" in str(caught.value)


# -- velocity --------------------------------------------------------------------------------------


def spinning() -> tfdb.Buffer:
    """A base that moves along x at 2 m/s and rotates about z at 0.5 rad/s, on a tilted map."""
    buffer = tfdb.Buffer(history=None)
    buffer.set_static_transform("world", "map", (5, 6, 7), TURN)
    for i in range(101):
        time = i / 100
        rotation = quaternion((0, 0, 1), 0.5 * time)
        buffer.set_transform("map", "base", i * SECOND // 100, (2 * time, 1, 0), rotation)
    buffer.set_static_transform("base", "tip", (0, 3, 0), BACK)
    return buffer


def test_velocity_in_the_axes_of_the_observer() -> None:
    twist = spinning().lookup_velocity("map", "base", SECOND // 2, 0.2)
    assert twist.linear == pytest.approx([2, 0, 0], abs=1e-9)
    assert twist.angular == pytest.approx([0, 0, 0.5], abs=1e-9)


def test_velocity_of_a_point_and_in_other_axes() -> None:
    buffer = spinning()
    angle = 0.25
    lever = np.array([-3 * np.sin(angle), 3 * np.cos(angle), 0])
    expected = np.array([2.0, 0, 0]) + np.cross([0, 0, 0.5], lever)
    at_point = buffer.lookup_velocity("map", "base", SECOND // 2, 0.02, point=(0, 3, 0))
    assert at_point.linear == pytest.approx(expected, abs=1e-4)
    same = buffer.lookup_velocity("map", "base", SECOND // 2, 0.02, point_frame="tip")
    assert same.linear == pytest.approx(at_point.linear, abs=1e-12)
    turned = buffer.lookup_velocity(
        "map", "base", SECOND // 2, 0.02, reference="world", point=(0, 3, 0)
    )
    rotation = matrix([5, 6, 7, *TURN])[:3, :3]
    assert turned.linear == pytest.approx(rotation @ at_point.linear, abs=1e-12)
    assert turned.angular == pytest.approx(rotation @ at_point.angular, abs=1e-12)


# -- reports and explanations ----------------------------------------------------------------------


def test_the_report_lists_the_edges_as_they_were_used(robot: Robot) -> None:
    report = robot.buffer.lookup_transform("camera", "lidar", stamp_of(11.25)).report
    assert [(edge.child, edge.parent, edge.inverted) for edge in report.edges] == [
        ("lidar", "base", False),
        ("camera", "left_hand", True),
        ("left_hand", "left_arm", True),
        ("left_arm", "base", True),
    ]
    assert [edge.used for edge in report.edges] == ["static", "static", *["interpolated"] * 2]
    moving = report.edges[2]
    assert (moving.before, moving.after) == (stamp_of(11), stamp_of(12))
    assert (moving.gap, moving.age) == (PERIOD, PERIOD // 4)
    assert (report.max_gap, report.age, report.oldest) == (PERIOD, PERIOD // 4, stamp_of(11))
    assert report.interpolated
    assert "T[left_arm<-left_hand] inverted: interpolated" in str(report)
    exact = robot.buffer.lookup_transform("camera", "lidar", stamp_of(11)).report
    assert [edge.used for edge in exact.edges] == ["static", "static", "exact", "exact"]
    assert (exact.max_gap, exact.age, exact.interpolated) == (0, 0, False)


def test_a_report_of_static_edges_has_no_limits(robot: Robot) -> None:
    report = robot.buffer.lookup_transform("base", "lidar").report
    assert (report.age, report.max_gap, report.oldest, report.limiting_edge) == (0, 0, None, None)


def test_a_report_keeps_the_names_of_removed_frames() -> None:
    buffer = tfdb.Buffer()
    buffer.set_transform("map", "base", 5, (1, 2, 3), TURN)
    found = buffer.lookup_transform("map", "base")
    buffer.remove_frames("base")
    for i in range(8):
        buffer.set_transform("map", f"other{i}", 5, (1, 2, 3), TURN)
    assert found.report.edges[0].child in ("base", "(removed)")
    assert (found.target, found.source) == ("map", "base")


def test_explain_walks_the_path(robot: Robot) -> None:
    good = robot.buffer.explain("map", "camera", stamp_of(3.5))
    assert good
    assert good.error is None
    assert [edge.child for edge in good.edges] == [
        "camera",
        "left_hand",
        "left_arm",
        "base",
        "odom",
    ]
    robot.buffer.set_transform("left_hand", "finger", stamp_of(0), (1, 2, 3), TURN)
    bad = robot.buffer.explain("map", "finger", stamp_of(3.5))
    robot.buffer.remove_frames("finger")
    assert not bad
    assert isinstance(bad.error, tfdb.Extrapolation)
    assert [edge.child for edge in bad.edges if not edge.ok] == ["finger"]
    assert "is after its last sample" in bad.edges[0].text
    assert "whole path has data" in str(bad)


def test_explain_has_advice(robot: Robot) -> None:
    assert "did you mean 'camera'" in str(robot.buffer.explain("map", "camrea"))
    assert "The store has no frames" in str(tfdb.Buffer().explain("map", "base"))
    buffer = tfdb.Buffer(history=None)
    buffer.set_transform("map", "odom", 10 * SECOND, (1, 2, 3), TURN)
    buffer.set_transform("odom", "base", 30 * SECOND, (1, 2, 3), TURN)
    text = str(buffer.explain("map", "base", 20 * SECOND))
    assert "have no stamp in common" in text
    buffer.set_static_transform("world", "table", (1, 2, 3), TURN)
    apart = buffer.explain("table", "base")
    assert isinstance(apart.error, tfdb.Disconnected)
    assert "The frames are in two trees" in str(apart)


@pytest.mark.parametrize(
    "policy", [tfdb.Exact(), tfdb.Interpolate(0.01), tfdb.Previous(0.01), tfdb.Nearest(0.01)]
)
def test_explain_names_every_edge_that_fails(robot: Robot, policy: tfdb.types.Policy) -> None:
    found = robot.buffer.explain("map", "lidar", stamp_of(3.5), policy)
    assert [edge.ok for edge in found.edges] == [True, False, False]


# -- transforms ------------------------------------------------------------------------------------


def test_transforms_chain_and_invert(robot: Robot) -> None:
    stamp = stamp_of(7.7)
    first = robot.buffer.lookup_transform("map", "base", stamp)
    second = robot.buffer.lookup_transform("base", "camera", stamp)
    product = first @ second
    np.testing.assert_allclose(product.matrix, first.matrix @ second.matrix, atol=1e-14)
    assert (product.target, product.source, product.stamp) == ("map", "camera", stamp)
    back = product.inverse()
    assert (back.target, back.source) == ("camera", "map")
    np.testing.assert_allclose(back.matrix, np.linalg.inv(product.matrix), atol=1e-13)
    whole = robot.buffer.lookup_transform("map", "camera", stamp)
    turned = whole.inverse().report.edges
    assert [edge.child for edge in turned] == [e.child for e in reversed(whole.report.edges)]
    assert all(edge.inverted for edge in turned)


def test_only_frames_that_meet_chain(robot: Robot) -> None:
    first = robot.buffer.lookup_transform("map", "base")
    with pytest.raises(tfdb.InvalidArgument, match="do not chain"):
        first @ first
    with pytest.raises(TypeError):
        first @ 3


def test_the_product_holds_at_the_older_stamp() -> None:
    first = tfdb.Transform("a", "b", (1, 2, 3), TURN, stamp=5)
    second = tfdb.Transform("b", "c", (1, 2, 3), BACK, stamp=3)
    always = tfdb.Transform("c", "d", (1, 2, 3), BACK)
    assert (first @ second).stamp == 3
    assert (first @ second @ always).stamp == 3
    assert (first @ second).report.edges == ()


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int64])
def test_apply_maps_points(robot: Robot, dtype: type) -> None:
    found = robot.buffer.lookup_transform("map", "camera", stamp_of(7.7))
    points = np.arange(30).reshape(10, 3).astype(dtype)
    expected = points @ found.matrix[:3, :3].T + found.matrix[:3, 3]
    moved = found.apply(points)
    assert moved.dtype == (np.float32 if dtype == np.float32 else np.float64)
    np.testing.assert_allclose(moved, expected, atol=1e-5 if dtype == np.float32 else 1e-13)
    np.testing.assert_array_equal(found.apply(points[::2]), moved[::2])
    np.testing.assert_array_equal(found.apply(points[3]), moved[3])
    np.testing.assert_array_equal(found.apply(np.asfortranarray(points)), moved)
    assert found.apply(np.empty((0, 3))).shape == (0, 3)


@pytest.mark.parametrize("lend", [lambda made: made, memoryview])
def test_arrays_of_the_standard_library_are_read(
    robot: Robot, lend: Callable[[array[Any]], Any]
) -> None:
    """Their buffers store shape and strides inside the caller's view."""
    found = robot.buffer.lookup_transform("map", "camera", stamp_of(7.7))
    for letter in "df":
        point = np.arange(3).astype(letter)
        moved = found.apply(lend(array(letter, point)))
        np.testing.assert_array_equal(moved, found.apply(point))
    stamps = [stamp_of(7.7), stamp_of(3.1)]
    rows = robot.buffer.lookup_transforms("map", "camera", lend(array("q", stamps)))
    np.testing.assert_array_equal(rows, robot.buffer.lookup_transforms("map", "camera", stamps))


def test_transforms_are_made_by_hand() -> None:
    made = tfdb.Transform("map", "base", (1, 2, 3), TURN, stamp=12_500_000_000)
    np.testing.assert_allclose(made.matrix, matrix([1, 2, 3, *TURN]), atol=1e-15)
    assert repr(made).startswith("T[map<-base] at 12.5 s: translation [1, 2, 3], rotation [0.")
    assert (made.commit, made.report.edges) == (0, ())
    assert made.pose == pytest.approx([1, 2, 3, *TURN])

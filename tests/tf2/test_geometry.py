"""Conversions of geometry against matrices, their laws and errors."""

from __future__ import annotations

import math

import numpy as np
import pytest

import tfdb
from tf2 import conversions
from tf2.conversions import fill, plain
from tfdb import tf2
from tfdb.tf2 import geometry, msgs, tf2_geometry_msgs, tf2_sensor_msgs

STAMP = msgs.Time(1_700_000_000, 123_456_789)


def of(seed: int) -> conversions.Geometry:
    return conversions.Geometry(msgs, STAMP, np.random.default_rng(seed))


def as_tfdb(target: str, source: str, message: msgs.TransformStamped) -> tfdb.Transform:
    inside = message.transform
    return tfdb.Transform(target, source, inside.translation, inside.rotation)


def same_pose(a: msgs.Pose, b: msgs.Pose) -> bool:
    return np.allclose(conversions.of_pose(a), conversions.of_pose(b), rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", conversions.CHECKS)
def test_against_matrices(name: str) -> None:
    conversions.check(name, msgs, STAMP)


def test_there_and_back_and_by_way_of_another() -> None:
    every = of(7)
    first, second = every.transform(), every.transform()
    pose = every.new("PoseStamped", "a")
    every.pose(pose.pose)
    stepwise = geometry.do_transform_pose(geometry.do_transform_pose(pose, first), second)
    at_once = as_tfdb("c", "b", second) @ as_tfdb("b", "a", first)
    direct = geometry.do_transform_pose(pose, at_once)
    assert same_pose(stepwise.pose, direct.pose)
    assert direct.header == msgs.Header(msgs.Time(0, 0), "c")
    back = geometry.do_transform_pose(direct, at_once.inverse())
    assert same_pose(back.pose, pose.pose)
    assert back.header.frame_id == "a"


def test_moments_and_velocities_of_another_point() -> None:
    """The power of a wrench on a twist is the same about whichever point both are."""
    every = of(8)
    turn = every.transform()
    wrench, twist = every.new("WrenchStamped"), every.new("TwistStamped")
    for vector in (wrench.wrench.force, wrench.wrench.torque):
        fill(vector, every.random.normal(size=3))
    for vector in (twist.twist.linear, twist.twist.angular):
        fill(vector, every.random.normal(size=3))

    def power(wrench: msgs.WrenchStamped, twist: msgs.TwistStamped) -> float:
        on, of_body = wrench.wrench, twist.twist
        straight = conversions.xyz(on.force) @ conversions.xyz(of_body.linear)
        return straight + conversions.xyz(on.torque) @ conversions.xyz(of_body.angular)

    for about_target in (False, True):
        turned = geometry.do_transform_wrench(wrench, turn, about_target=about_target)
        moving = geometry.do_transform_twist(twist, turn, about_target=about_target)
        assert power(turned, moving) == pytest.approx(power(wrench, twist), rel=1e-12)
    mixed = geometry.do_transform_wrench(wrench, turn)
    assert abs(power(mixed, moving) - power(wrench, twist)) > 0.1


def test_messages_without_a_header() -> None:
    """Parts of messages alone, and a Transform, which says nothing of frames."""
    every = of(9)
    turn = every.transform()
    place = fill(msgs.Point(), every.random.normal(size=3))
    stamped = every.new("PointStamped")
    stamped.point = place
    expected = geometry.do_transform_point(stamped, turn)
    assert geometry.do_transform_point(place, turn) == expected.point
    unnamed = geometry.do_transform_point(stamped, turn.transform)
    assert unnamed.point == expected.point
    assert unnamed.header == stamped.header
    assert unnamed.header is not stamped.header
    pose = every.new("PoseWithCovarianceStamped")
    every.pose(pose.pose.pose)
    found = geometry.do_transform_pose_with_covariance_stamped(pose.pose, turn)
    whole = geometry.do_transform_pose_with_covariance_stamped(pose, turn)
    assert found == whole.pose


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_poses_of_ros_2_have_a_positive_w(sign: float) -> None:
    every = of(17)
    for _ in range(20):
        turn, pose = every.transform(), every.new("PoseWithCovarianceStamped")
        every.pose(pose.pose.pose)
        orientation = pose.pose.pose.orientation
        for name in "xyzw":
            setattr(orientation, name, sign * getattr(orientation, name))
        stamped = msgs.PoseStamped(pose.header, pose.pose.pose)
        whole = geometry.do_transform_pose_with_covariance_stamped(pose, turn).pose.pose
        assert whole.orientation.w > 0
        assert geometry.do_transform_pose_stamped(stamped, turn).pose == whole
        assert geometry.do_transform_pose(pose.pose.pose, turn) == whole


@pytest.mark.parametrize("length", [0.0, 1e-3, 5.0])
def test_orientations_of_any_length(length: float) -> None:
    every = of(10)
    turn = every.transform()
    pose = every.new("PoseStamped")
    every.pose(pose.pose)
    expected = geometry.do_transform_pose(pose, turn)
    orientation = pose.pose.orientation
    for name in "xyzw":
        setattr(orientation, name, getattr(orientation, name) * length)
    found = geometry.do_transform_pose(pose, turn).pose
    if not length:
        orientation = expected.pose.orientation = turn.transform.rotation
        assert found.orientation.w == pytest.approx(orientation.w, abs=1e-15)
    assert same_pose(found, expected.pose)


def test_not_a_number_stays() -> None:
    every = of(11)
    turn = every.transform()
    point = every.new("PointStamped")
    point.point.y = math.nan
    assert math.isnan(geometry.do_transform_point(point, turn).point.x)
    pose = every.new("PoseStamped")
    pose.pose.orientation.x = math.nan
    made = geometry.do_transform_pose(pose, turn).pose
    assert math.isnan(made.orientation.w)
    assert math.isfinite(made.position.x)


@pytest.mark.parametrize("spoilt", [{"w": 9.0}, {"x": math.nan}, dict.fromkeys("xyzw", 0.0)])
@pytest.mark.parametrize("name", conversions.CHECKS)
def test_transforms_that_are_none(name: str, spoilt: dict[str, float]) -> None:
    every = of(12)
    turn = every.transform()
    by = conversions.matrix(turn.transform.translation, turn.transform.rotation)
    given, function, _ = conversions.CHECKS[name](every, turn, by)
    for member, value in spoilt.items():
        setattr(turn.transform.rotation, member, value)
    before = plain(given)
    with pytest.raises(tf2.InvalidArgumentException, match="unit quaternion"):
        function(given, turn)
    assert plain(given) == before


def test_points() -> None:
    every = of(13)
    turn = every.transform()
    points = every.random.normal(size=(50, 3))
    by = conversions.matrix(turn.transform.translation, turn.transform.rotation)
    expected = points @ by[:3, :3].T + by[:3, 3]
    for given in (turn, turn.transform, as_tfdb("t", "s", turn)):
        assert np.allclose(geometry.transform_points(points, given), expected, rtol=0, atol=1e-12)
    assert geometry.transform_points([(1, 2, 3)], turn).dtype == np.float64
    assert geometry.transform_points(np.empty((0, 3)), turn).shape == (0, 3)
    for bad in ([1, 2, 3], [[1, 2]], [["a", "b", "c"]]):
        with pytest.raises(tf2.InvalidArgumentException, match="points must"):
            geometry.transform_points(bad, turn)


def test_tfdb_transforms_both_ways() -> None:
    message = of(14).transform()
    found = tf2.convert(message, tfdb.Transform)
    assert (found.target, found.source, found.stamp) == ("target", "source", STAMP.nanoseconds)
    back = tf2.convert(found, msgs.TransformStamped)
    assert plain(back.header) == plain(message.header)
    assert back.child_frame_id == "source"
    by = conversions.matrix(message.transform.translation, message.transform.rotation)
    assert np.allclose(found.matrix, by, rtol=0, atol=1e-15)
    again = conversions.matrix(back.transform.translation, back.transform.rotation)
    assert np.allclose(again, by, rtol=0, atol=1e-15)


def test_registered_types() -> None:
    transforms, converts = tf2.TransformRegistration(), tf2.ConvertRegistration()
    for name in ("PointStamped", "Vector3Stamped", "PoseStamped"):
        kind = getattr(msgs, name)
        message = kind()
        assert converts.get_to_msg(kind)(message) is message
        assert converts.get_from_msg(kind)(message) is message
        copied = tf2.convert(message, kind)
        assert copied == message
        assert copied is not message
    with pytest.raises(tf2.TypeException, match="is not loaded or supported"):
        transforms.get(msgs.Point)


def test_through_a_buffer() -> None:
    """Without an import of any conversion, and into a new type."""
    every = of(16)
    turn, point = every.transform(), every.new("PointStamped")
    fill(point.point, every.random.normal(size=3))
    buffer = tf2.Buffer(flavor="ros2")
    buffer.set_transform(turn, "me")
    made = buffer.transform(point, "target")
    by = conversions.matrix(turn.transform.translation, turn.transform.rotation)
    expected = (by @ [*conversions.xyz(point.point), 1])[:3]
    assert np.allclose(conversions.xyz(made.point), expected, rtol=0, atol=1e-12)
    assert made.header.frame_id == "target"
    full = buffer.transform_full(point, "target", STAMP, "source")
    assert full == made


def test_a_users_function_takes_precedence() -> None:
    class Mine(msgs.PointStamped):
        pass

    every = of(15)
    turn, point = every.transform(), Mine(every.new("PointStamped").header)
    looking = conversions.Looking(turn)
    assert type(looking.transform(point, "target")) is Mine
    registry = tf2.TransformRegistration()
    registry.add(Mine, lambda given, transform: "mine")
    try:
        assert looking.transform(point, "target") == "mine"
    finally:
        del registry._functions[Mine]


def test_names_of_the_packages() -> None:
    for module in (tf2_geometry_msgs, tf2_sensor_msgs):
        assert all(callable(getattr(module, name)) for name in module.__all__)
    assert tf2_geometry_msgs.PoseStamped is msgs.PoseStamped
    with pytest.raises(AttributeError):
        tf2_geometry_msgs.Header  # noqa: B018

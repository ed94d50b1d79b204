"""Conversions beside Debian's tf2_geometry_msgs and tf2_sensor_msgs, and of real messages."""

from __future__ import annotations

import dataclasses
import json
import subprocess
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tfdb
from compat.tf2_oracle import unavailable
from tf2 import conversions, real_tf2
from tf2.real_ros import run_with_ros1, run_with_ros2
from tf2.test_clouds import expected, matrix, random_cloud, simple
from tfdb import tf2
from tfdb.ros.times import nanoseconds
from tfdb.tf2 import clouds, covariance, geometry, msgs

CHILD = Path(__file__).with_name("conversions_child.py")
STAMP = msgs.Time(1_700_000_000, 123_456_789)
NUMBERS = ("x", "y", "z", "w")


def as_json(value: Any) -> Any:
    """One of our messages as the child reads it."""
    if isinstance(value, bytes):
        return value.decode("latin-1")
    if isinstance(value, list):
        return [as_json(each) for each in value]
    if isinstance(value, msgs.Time):
        return {"secs": value.sec, "nsecs": value.nanosec}
    if not dataclasses.is_dataclass(value):
        return value
    members = {each.name: as_json(getattr(value, each.name)) for each in dataclasses.fields(value)}
    return {"type": type(value).__name__, **members}


def theirs(operations: list[list[Any]]) -> list[dict[str, Any]]:
    """What Debian's functions make of [function, message, transform]."""
    done = subprocess.run(
        [real_tf2.PYTHON, CHILD],
        env=real_tf2.ENVIRONMENT,
        input="".join(json.dumps([each[0], *map(as_json, each[1:])]) + "\n" for each in operations),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]


@cache
def missing() -> str:
    """Return why the packages to compare with are missing; empty: they are installed."""
    command = [real_tf2.PYTHON, "-c", "import tf2_geometry_msgs, tf2_sensor_msgs"]
    done = subprocess.run(
        command, env=real_tf2.ENVIRONMENT, capture_output=True, text=True, check=False
    )
    return "" if done.returncode == 0 else done.stderr.strip().splitlines()[-1]


@pytest.fixture(autouse=True)
def packages(request: pytest.FixtureRequest) -> None:
    needed = "theirs" in request.node.name or "difference" in request.node.name
    if needed and (real_tf2.missing() or missing()):
        names = "python3-tf2-geometry-msgs python3-tf2-sensor-msgs"
        unavailable(f"{real_tf2.missing() or missing()}; apt-get install {names}")


def numbers(value: Any) -> np.ndarray:
    """All x, y, z, w of a message in a fixed order; quaternions with a positive w."""
    if dataclasses.is_dataclass(value):
        value = as_json(value)
    found: list[float] = []
    for name in sorted(value):
        inside = value[name]
        if isinstance(inside, dict) and name != "header":
            found += list(numbers(inside))
    own = np.array([value[name] for name in NUMBERS if name in value])
    if len(own) == 4 and own[3] < 0:
        own = -own
    return np.array([*own, *found])


def test_geometry_beside_theirs() -> None:
    every = conversions.Geometry(msgs, STAMP, np.random.default_rng(21))
    operations, ours = [], []
    for name in ("point", "vector3", "pose", "wrench"):
        for _ in range(25):
            turn = every.transform()
            by = matrix(turn)
            given, function, _ = conversions.CHECKS[name](every, turn, by)
            operations.append([f"do_transform_{name}", given, turn])
            ours.append(function(given, turn))
    for mine, answer in zip(ours, theirs(operations), strict=True):
        found = numbers(answer["made"])
        assert len(found) >= 3
        assert np.allclose(numbers(mine), found, rtol=0, atol=1e-12)
        header = answer["made"]["header"]
        assert header["frame_id"] == mine.header.frame_id == "target"
        assert (header["stamp"]["secs"], header["stamp"]["nsecs"]) == (STAMP.sec, STAMP.nanosec)


class Ros1Pose(msgs.Pose):
    """Has what tells a message of ROS 1."""

    _md5sum = "e45d45a5a1ce597b249e23fb30fc871f"


def test_signs_beside_theirs() -> None:
    """Of the two quaternions of a rotation ours is the one that PyKDL gives."""
    every = conversions.Geometry(msgs, STAMP, np.random.default_rng(29))
    operations, ours = [], []
    for _ in range(100):
        turn, given = every.transform(), every.new("PoseStamped")
        every.pose(given.pose)
        operations.append(["do_transform_pose", given, turn])
        pose = Ros1Pose(given.pose.position, given.pose.orientation)
        ours.append(geometry.do_transform_pose(pose, turn).orientation)
    assert any(turned.w < 0 for turned in ours)
    for mine, answer in zip(ours, theirs(operations), strict=True):
        found = answer["made"]["pose"]["orientation"]
        for name in NUMBERS:
            assert getattr(mine, name) == pytest.approx(found[name], abs=1e-12)


def test_clouds_beside_theirs() -> None:
    """Of the one layout that theirs keeps: x, y, z first, nothing between, one row."""
    turn = conversions.Geometry(msgs, STAMP, np.random.default_rng(22)).transform()
    given = [simple(100), simple(100, msgs.PointField.FLOAT64), simple(0)]
    answers = theirs([["do_transform_cloud", cloud, turn] for cloud in given])
    for cloud, answer in zip(given, answers, strict=True):
        mine = clouds.do_transform_cloud(cloud, turn)
        kind = "<f4" if cloud.point_step == 16 else "<f8"
        found, real = (
            np.frombuffer(data, kind)
            for data in (mine.data, answer["made"]["data"].encode("latin-1"))
        )
        assert np.allclose(found, real, rtol=0, atol=1e-6 if kind == "<f4" else 1e-12)
        for name in ("height", "width", "point_step", "row_step", "is_bigendian", "is_dense"):
            assert answer["made"][name] == getattr(mine, name)


def random_transform(seed: int) -> msgs.TransformStamped:
    made: msgs.TransformStamped
    made = conversions.Geometry(msgs, STAMP, np.random.default_rng(seed)).transform()
    return made


def both_clouds(cloud: msgs.PointCloud2, turn: Any) -> tuple[np.ndarray, np.ndarray]:
    """The float32 numbers that theirs and ours make of a cloud."""
    [answer] = theirs([["do_transform_cloud", cloud, turn]])
    data = answer["made"]["data"].encode("latin-1"), clouds.do_transform_cloud(cloud, turn).data
    found, mine = (np.frombuffer(each, "<f4") for each in data)
    return found, mine


# What `tfdb.tf2.differences` says of conversions, each by a test of its name.


def test_difference_conversion_header() -> None:
    turn = random_transform(23)
    point = msgs.PointStamped(msgs.Header(STAMP, "source"))
    [answer] = theirs([["do_transform_point", point, turn]])
    assert answer["aliased"]
    made = geometry.do_transform_point(point, turn)
    assert made.header == turn.header
    assert made.header is not turn.header


def test_difference_conversion_transform() -> None:
    turn = msgs.TransformStamped()
    turn.transform.rotation.w = 2.0
    point = msgs.PointStamped(point=msgs.Point(1.0, 2.0, 3.0))
    [answer] = theirs([["do_transform_point", point, turn]])
    assert list(numbers(answer["made"])) == [4.0, 8.0, 12.0]
    with pytest.raises(tf2.InvalidArgumentException, match="unit quaternion"):
        geometry.do_transform_point(point, turn)


def test_difference_conversion_orientation() -> None:
    turn = random_transform(24)
    pose = msgs.PoseStamped(pose=msgs.Pose(msgs.Point(), msgs.Quaternion(w=0.0)))
    [answer] = theirs([["do_transform_pose", pose, turn]])
    orientation = answer["made"]["pose"]["orientation"]
    assert np.linalg.norm([orientation[name] for name in NUMBERS]) == 0.5
    assert geometry.do_transform_pose(pose, turn).pose.orientation == turn.transform.rotation


def test_difference_conversion_type() -> None:
    point = msgs.PointStamped(point=msgs.Point(1.0, 2.0, 3.0))
    [answer] = theirs([["as_vector", point, random_transform(27)]])
    assert set(answer["made"]) == {"header", "point"}
    with pytest.raises(tf2.TypeException, match=r"PointStamped'> does not convert to .*Vector3"):
        tf2.convert(point, msgs.Vector3Stamped)


def test_difference_cloud_layout() -> None:
    turn = random_transform(25)
    padded = simple(2)
    padded.point_step, padded.row_step, padded.data = 20, 40, bytes(40)
    found, mine = both_clouds(padded, turn)
    assert (found.nbytes, mine.nbytes) == (32, 40)
    time_first = simple(2)
    for each, offset in zip(time_first.fields, (4, 8, 12, 0), strict=True):
        each.offset = offset
    given = np.frombuffer(time_first.data, "<f4").reshape(2, 4)
    found, mine = both_clouds(time_first, turn)
    assert np.array_equal(found.reshape(2, 4)[:, 3], given[:, 3])
    assert np.array_equal(mine.reshape(2, 4)[:, 0], given[:, 0])
    by = matrix(turn)
    expected = given[:, 1:] @ by[:3, :3].T + by[:3, 3]
    assert np.allclose(mine.reshape(2, 4)[:, 1:], expected, rtol=0, atol=1e-5)


def test_difference_cloud_normals() -> None:
    turn = random_transform(26)
    cloud = simple(1)
    names = ("normal_x", "normal_y", "normal_z")
    cloud.fields += [msgs.PointField(n, 16 + 4 * i, 7, 1) for i, n in enumerate(names)]
    cloud.point_step, cloud.row_step = 28, 28
    cloud.data = np.arange(7, dtype="<f4").tobytes()
    found, mine = both_clouds(cloud, turn)
    assert list(found[4:]) == [4, 5, 6]
    assert np.allclose(mine[4:], matrix(turn)[:3, :3] @ [4, 5, 6], rtol=0, atol=1e-5)


def test_difference_cloud_refused() -> None:
    cloud = simple(2)
    cloud.fields[0].name = "u"
    turn = random_transform(27)
    [answer] = theirs([["do_transform_cloud", cloud, turn]])
    assert answer["made"]["width"] == 2
    with pytest.raises(tf2.InvalidArgumentException, match="Point cloud needs the fields x, y"):
        clouds.do_transform_cloud(cloud, turn)


def test_difference_covariance() -> None:
    """What it does is sampled in test_covariance.py."""
    pose = msgs.PoseWithCovarianceStamped()
    pose.pose.covariance = np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).ravel().tolist()
    turn = random_transform(28)
    made = geometry.do_transform_pose_with_covariance_stamped(pose, turn)
    found = np.reshape(made.pose.covariance, (6, 6))
    assert np.trace(found) == pytest.approx(21)
    assert found[0, 1] != 0
    farther = covariance.transform_covariance(found, turn, lever_arm=(1, 2, 3))
    assert np.trace(farther) > 30


SHOWN = {name.removeprefix("test_difference_") for name in globals() if "_difference_" in name}


PROGRAM = """
import numpy as np
import geometry_msgs.msg
import sensor_msgs.msg
from tf2 import conversions
from tf2.test_real_conversions import of_two_libraries, real_cloud
{time}
for name in conversions.CHECKS:
    conversions.check(name, geometry_msgs.msg, stamp)
for seed in range(20):
    real_cloud(sensor_msgs.msg, geometry_msgs.msg, stamp, seed)
of_two_libraries(geometry_msgs.msg, stamp)
from tfdb.tf2 import tf2_geometry_msgs
assert tf2_geometry_msgs.PoseStamped is geometry_msgs.msg.PoseStamped
print("done")
"""


def real_cloud(sensor: Any, geometry_classes: Any, stamp: Any, seed: int) -> None:
    """A random cloud as a real message: the same bytes as of ours, on a real transform."""
    random = np.random.default_rng(seed)
    layout, cloud = random_cloud(random)
    made = sensor.PointCloud2()
    for name in ("height", "width", "is_bigendian", "point_step", "row_step", "is_dense"):
        setattr(made, name, getattr(cloud, name))
    made.header.stamp, made.header.frame_id = stamp, "source"
    made.data = type(made.data)("B", cloud.data) if made.data != b"" else cloud.data
    for each in cloud.fields:
        field = sensor.PointField()
        for name in ("name", "offset", "datatype", "count"):
            setattr(field, name, getattr(each, name))
        made.fields.append(field)
    turn = conversions.Geometry(geometry_classes, stamp, random).transform()
    before = conversions.plain(made), conversions.plain(turn)
    found = conversions.Looking(turn).transform(made, "target")
    assert (conversions.plain(made), conversions.plain(turn)) == before
    conversions.check_own(found, made, turn)
    assert type(found.data) is type(made.data)
    ours = clouds.do_transform_cloud(cloud, turn)
    assert bytes(found.data) == ours.data
    assert len(expected(layout, cloud, matrix(turn))) == len(ours.data)


def of_two_libraries(classes: Any, stamp: Any) -> None:
    """A real point by a transform of ours; a real transform as a `tfdb.Transform`, a KDL frame."""
    turn = random_transform(29)
    real = conversions.Geometry(classes, stamp, np.random.default_rng(30))
    point = real.new("PointStamped")
    made = geometry.do_transform_point(point, turn)
    assert type(made) is type(point)
    assert made.header.frame_id == "target"
    assert nanoseconds(made.header.stamp) == STAMP.nanoseconds
    assert np.allclose(conversions.xyz(made.point), matrix(turn)[:3, 3], rtol=0, atol=1e-12)
    message = real.transform()
    found = tf2.convert(message, tfdb.Transform)
    assert np.allclose(found.matrix, matrix(message), rtol=0, atol=1e-12)
    back = tf2.convert(found, type(message))
    assert type(back) is type(message)
    assert nanoseconds(back.header.stamp) == STAMP.nanoseconds
    if hasattr(classes.Point, "_md5sum"):
        import PyKDL

        frame = geometry.transform_to_kdl(message)
        place = frame * PyKDL.Vector(1, 2, 3)
        assert np.allclose(list(place), found.apply((1, 2, 3)), rtol=0, atol=1e-12)


def test_messages_of_ros1() -> None:
    time = "import rospy; stamp = rospy.Time(1_700_000_000, 123_456_789)"
    run_with_ros1(PROGRAM.format(time=time))


def test_messages_of_ros2() -> None:
    time = "from builtin_interfaces.msg import Time; "
    time += "stamp = Time(sec=1_700_000_000, nanosec=123_456_789)"
    run_with_ros2(PROGRAM.format(time=time))

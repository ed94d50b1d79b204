"""Conversions of random messages of any library, against 4 x 4 matrices.

Run by the tests on our own messages, and in a process of its own on those of a real ROS.
"""

from __future__ import annotations

import copy
import math
from typing import Any

import numpy as np

from tfdb import tf2
from tfdb.tf2 import covariance, geometry

SEED = 20260811
Random = np.random.Generator


def matrix(translation: Any, rotation: Any) -> np.ndarray:
    """The homogeneous matrix of x, y, z and x, y, z, w, by the textbook."""
    x, y, z, w = rotation.x, rotation.y, rotation.z, rotation.w
    made = np.eye(4)
    made[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    made[:3, 3] = xyz(translation)
    return made


def xyz(value: Any) -> np.ndarray:
    return np.array([value.x, value.y, value.z])


def fill(target: Any, values: Any, names: str = "xyz") -> Any:
    for name, value in zip(names, values, strict=True):
        setattr(target, name, float(value))
    return target


def unit(random: Random) -> np.ndarray:
    made = random.normal(size=4)
    return made / np.linalg.norm(made)


def plain(value: Any) -> Any:
    """Message as nested tuples, which hold no object of it."""
    if isinstance(value, bool | int | float | str | bytes):
        return value
    if hasattr(value, "tobytes"):
        return value.tobytes()
    if isinstance(value, list | tuple):
        return tuple(plain(each) for each in value)
    if hasattr(value, "to_nsec"):
        return value.to_nsec()
    return tuple((name, plain(getattr(value, name))) for name in members(value))


def members(value: Any) -> list[str]:
    if hasattr(value, "get_fields_and_field_types"):
        return list(value.get_fields_and_field_types())
    return [name for name in value.__slots__ if not name.startswith("_check")]


def parts(value: Any) -> set[int]:
    """Ids of all objects in a message that can be changed."""
    if isinstance(value, bool | int | float | str | bytes | np.generic):
        return set()
    if hasattr(value, "tobytes"):
        return {id(value)}
    if isinstance(value, list | tuple):
        inner = set().union(*(parts(each) for each in value))
        return inner | ({id(value)} if isinstance(value, list) else set())
    return {id(value)}.union(*(parts(getattr(value, name)) for name in members(value)))


def check_own(result: Any, given: Any, transform: Any) -> None:
    """The result shares nothing with what was given, and has the class and the header it must."""
    assert type(result) is type(given)
    assert not parts(result) & (parts(given) | parts(transform))
    assert plain(result.header) == plain(transform.header)


class Geometry:
    """Random messages of a library's geometry_msgs."""

    def __init__(self, classes: Any, stamp: Any, random: Random) -> None:
        self.classes, self.stamp, self.random = classes, stamp, random

    def new(self, name: str, frame: str = "source") -> Any:
        made = getattr(self.classes, name)()
        made.header.frame_id = frame
        made.header.stamp = copy.copy(self.stamp)
        return made

    def pose(self, pose: Any) -> None:
        fill(pose.position, self.random.normal(size=3))
        fill(pose.orientation, unit(self.random), "xyzw")

    def transform(self) -> Any:
        made = self.new("TransformStamped", "target")
        made.child_frame_id = "source"
        fill(made.transform.translation, self.random.normal(size=3) * 5)
        fill(made.transform.rotation, unit(self.random), "xyzw")
        return made


def of_pose(pose: Any) -> np.ndarray:
    return matrix(pose.position, pose.orientation)


def check_point(all_of: Geometry, turn: Any, by: np.ndarray) -> tuple[Any, Any, Any]:
    given = all_of.new("PointStamped")
    fill(given.point, all_of.random.normal(size=3))
    return (
        given,
        geometry.do_transform_point,
        lambda made: (
            xyz(made.point),
            (by @ [*xyz(given.point), 1])[:3],
        ),
    )


def check_vector3(all_of: Geometry, turn: Any, by: np.ndarray) -> tuple[Any, Any, Any]:
    given = all_of.new("Vector3Stamped")
    fill(given.vector, all_of.random.normal(size=3))
    return (
        given,
        geometry.do_transform_vector3,
        lambda made: (
            xyz(made.vector),
            by[:3, :3] @ xyz(given.vector),
        ),
    )


def check_quaternion(all_of: Geometry, turn: Any, by: np.ndarray) -> tuple[Any, Any, Any]:
    given = all_of.new("QuaternionStamped")
    fill(given.quaternion, unit(all_of.random), "xyzw")
    zero = all_of.classes.Point()
    return (
        given,
        geometry.do_transform_quaternion,
        lambda made: (
            matrix(zero, made.quaternion)[:3, :3],
            by[:3, :3] @ matrix(zero, given.quaternion)[:3, :3],
        ),
    )


def check_pose(all_of: Geometry, turn: Any, by: np.ndarray) -> tuple[Any, Any, Any]:
    given = all_of.new("PoseStamped")
    all_of.pose(given.pose)
    inner = geometry.do_transform_pose(given.pose, turn)
    assert type(inner) is type(given.pose)
    assert np.allclose(of_pose(inner), by @ of_pose(given.pose), atol=1e-12)
    return (
        given,
        geometry.do_transform_pose,
        lambda made: (
            of_pose(made.pose),
            by @ of_pose(given.pose),
        ),
    )


def check_pose_stamped(all_of: Geometry, turn: Any, by: np.ndarray) -> tuple[Any, Any, Any]:
    given, _, judged = check_pose(all_of, turn, by)
    return given, geometry.do_transform_pose_stamped, judged


def check_covariance(all_of: Geometry, turn: Any, by: np.ndarray) -> tuple[Any, Any, Any]:
    given = all_of.new("PoseWithCovarianceStamped")
    all_of.pose(given.pose.pose)
    root = all_of.random.normal(size=(6, 6))
    given.pose.covariance = (root @ root.T).ravel().tolist()
    both = np.kron(np.eye(2), by[:3, :3])

    def judged(made: Any) -> tuple[Any, Any]:
        assert np.allclose(of_pose(made.pose.pose), by @ of_pose(given.pose.pose), atol=1e-12)
        found = np.reshape(made.pose.covariance, (6, 6))
        assert type(made.pose.covariance) is type(given.pose.covariance)
        plainly = covariance.transform_covariance(given.pose.covariance, turn)
        assert np.array_equal(plainly, found.ravel())
        return found, both @ root @ root.T @ both.T

    return given, geometry.do_transform_pose_with_covariance_stamped, judged


def check_wrench(all_of: Geometry, turn: Any, by: np.ndarray) -> tuple[Any, Any, Any]:
    given = all_of.new("WrenchStamped")
    fill(given.wrench.force, all_of.random.normal(size=3))
    fill(given.wrench.torque, all_of.random.normal(size=3))
    force, torque = (by[:3, :3] @ xyz(given.wrench.force), by[:3, :3] @ xyz(given.wrench.torque))
    about = geometry.do_transform_wrench(given, turn, about_target=True).wrench
    assert np.allclose(xyz(about.torque), torque + np.cross(by[:3, 3], force), atol=1e-12)
    assert np.allclose(xyz(about.force), force, atol=1e-12)
    return (
        given,
        geometry.do_transform_wrench,
        lambda made: (
            [xyz(made.wrench.force), xyz(made.wrench.torque)],
            [force, torque],
        ),
    )


def check_twist(all_of: Geometry, turn: Any, by: np.ndarray) -> tuple[Any, Any, Any]:
    given = all_of.new("TwistStamped")
    fill(given.twist.linear, all_of.random.normal(size=3))
    fill(given.twist.angular, all_of.random.normal(size=3))
    linear, angular = (by[:3, :3] @ xyz(given.twist.linear), by[:3, :3] @ xyz(given.twist.angular))
    about = geometry.do_transform_twist(given, turn, about_target=True).twist
    assert np.allclose(xyz(about.linear), linear + np.cross(by[:3, 3], angular), atol=1e-12)
    assert np.allclose(xyz(about.angular), angular, atol=1e-12)
    return (
        given,
        geometry.do_transform_twist,
        lambda made: (
            [xyz(made.twist.linear), xyz(made.twist.angular)],
            [linear, angular],
        ),
    )


def check_polygon(all_of: Geometry, turn: Any, by: np.ndarray) -> tuple[Any, Any, Any]:
    given = all_of.new("PolygonStamped")
    corners = all_of.random.normal(size=(5, 3)).astype(np.float32)
    given.polygon.points = [fill(all_of.classes.Point32(), corner) for corner in corners]
    return (
        given,
        geometry.do_transform_polygon_stamped,
        lambda made: (
            [xyz(corner) for corner in made.polygon.points],
            [(by @ [*corner, 1])[:3] for corner in corners],
        ),
    )


CHECKS = {
    name.removeprefix("check_"): function
    for name, function in list(globals().items())
    if name.startswith("check_") and name != "check_own"
}


def check(name: str, classes: Any, stamp: Any) -> None:
    """Transform random messages of one kind by random transforms and judge the results."""
    all_of = Geometry(classes, stamp, np.random.default_rng(SEED))
    for _ in range(20):
        turn = all_of.transform()
        by = matrix(turn.transform.translation, turn.transform.rotation)
        given, function, judged = CHECKS[name](all_of, turn, by)
        before = plain(given), plain(turn)
        made = function(given, turn)
        assert (plain(given), plain(turn)) == before
        check_own(made, given, turn)
        found, expected = judged(made)
        assert np.allclose(found, expected, rtol=0, atol=1e-12), (SEED, found, expected)
        found_too = Looking(turn).transform(given, "target")
        assert plain(found_too) == plain(made)


class Looking(tf2.BufferInterface):
    """Has one transform to give, out of a BufferCore."""

    def __init__(self, transform: Any) -> None:
        super().__init__()
        self.core = tf2.BufferCore()
        self.core.set_transform(transform, "me")
        self.known = transform

    def lookup_transform(self, target: str, source: str, time: Any, timeout: Any = None) -> Any:
        found = self.core.lookup_transform_core(target, source, time)
        move, same = found.transform.translation, self.known.transform.translation
        assert math.dist(xyz(move), xyz(same)) < 1e-12
        return self.known

"""Transforms points, vectors, poses, wrenches and twists, as tf2_geometry_msgs does.

Each function takes a message of ROS 1, ROS 2 or `tfdb.tf2.msgs`, with or without a header. It takes
T[target<-source] as a TransformStamped of any of these, a Transform, or a `tfdb.Transform`. It
returns a new message of the same class, which shares no data with the arguments. The arguments stay
unchanged. The header of the result is a copy of the transform's header, or of the message's if the
transform has none. Numbers that are not finite are accepted.

All raise InvalidArgumentException for a transform that is not finite, or whose quaternion does not
have unit length. They raise `tfdb.errors.InvalidTransform` if the result for a finite point is not
finite.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from tfdb import _core
from tfdb.data.lazy_names import belong_to
from tfdb.data.stamps import shown
from tfdb.ros.ros_messages import installed, makers

from .buffer_interface import ConvertRegistration, TransformRegistration
from .covariance import transform_covariance
from .exceptions import InvalidArgumentException
from .message_checks import refuse_unlike
from .transform_argument import fill_result_header, rigid

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = [
    "do_transform_point",
    "do_transform_polygon_stamped",
    "do_transform_pose",
    "do_transform_pose_stamped",
    "do_transform_pose_with_covariance_stamped",
    "do_transform_quaternion",
    "do_transform_twist",
    "do_transform_vector3",
    "do_transform_wrench",
    "from_msg_msg",
    "to_msg_msg",
    "transform_from_msg",
    "transform_points",
    "transform_to_kdl",
    "transform_to_msg",
]

KDL_EPSILON = 1e-12
"""Trace of a rotation matrix beyond which KDL divides by w."""


KINDS = {
    "point": ("Point", "x", "y", "z"),
    "vector3": ("Vector3", "x", "y", "z"),
    "quaternion": ("Quaternion", "x", "y", "z", "w"),
    "pose": ("Pose", "position", "orientation"),
    "pose with covariance": ("PoseWithCovariance", "pose", "covariance"),
    "wrench": ("Wrench", "force", "torque"),
    "twist": ("Twist", "linear", "angular"),
    "polygon": ("Polygon", "points"),
}
"""Convertible messages, with their name and members."""


def _begin(given: Any, kind: str, transform: Any) -> tuple[_core.Transform, Any, Any, Any]:
    """Begin a result.

    Returns the transform, the result, and the parts of the given message and of the result that
    hold the numbers.
    """
    turn = rigid(transform)
    argument = kind.partition(" ")[0]
    stamped = hasattr(given, "header")
    member = argument.removesuffix("3")
    inside = getattr(given, member, None) if stamped else given
    name, *members = KINDS[kind]
    refuse_unlike(inside, argument, f"a {name} or a {name}Stamped", *members)
    made = type(given)()
    if not stamped:
        return turn, made, given, made
    fill_result_header(made, given, transform)
    return turn, made, inside, getattr(made, member)


def rotation_of(transform: _core.Transform) -> _core.Transform:
    """The rotation of a transform alone."""
    return _core.Transform("target", "source", (0.0, 0.0, 0.0), transform.rotation)


def _apply(transform: _core.Transform, given: Any, made: Any) -> None:
    """Store the transformed x, y, z of one object in another."""
    made.x, made.y, made.z = transform.apply((given.x, given.y, given.z)).tolist()


def _rotate_orientation(transform: _core.Transform, given: Any, made: Any) -> None:
    """Store a rotated orientation in another; an orientation of length 0 counts as the identity."""
    x, y, z, w = given.x, given.y, given.z, given.w
    length = math.hypot(x, y, z, w)
    if length == 0.0:
        x, y, z, w = 0.0, 0.0, 0.0, 1.0
    else:
        x, y, z, w = x / length, y / length, z / length, w / length
    a, b, c, d = transform.rotation.tolist()
    made.x = d * x + a * w + b * z - c * y
    made.y = d * y - a * z + b * w + c * x
    made.z = d * z + a * y - b * x + c * w
    made.w = d * w - a * x - b * y - c * z


def _move_pose(transform: _core.Transform, given: Any, made: Any) -> None:
    """Store the transformed pose in another."""
    _apply(transform, given.position, made.position)
    turned = made.orientation
    _rotate_orientation(transform, given.orientation, turned)
    if _leading(turned, ros1=hasattr(type(given), "_md5sum")) < 0:
        turned.x, turned.y, turned.z, turned.w = -turned.x, -turned.y, -turned.z, -turned.w


def _leading(turn: Any, *, ros1: bool) -> float:
    """Return the member that upstream makes positive: w in ROS 2, KDL's choice in ROS 1."""
    x, y, z, w = turn.x, turn.y, turn.z, turn.w
    if not ros1 or 4 * w * w - 1 > KDL_EPSILON:
        leading = w
    elif abs(x) > max(abs(y), abs(z)):
        leading = x
    else:
        leading = y if abs(y) > abs(z) else z
    return float(leading)


def _shift(transform: _core.Transform, turned: Any, moved: Any) -> None:
    """Add t x `turned` to `moved`: the change of a moment or velocity with its reference point."""
    x, y, z = transform.translation.tolist()
    moved.x += y * turned.z - z * turned.y
    moved.y += z * turned.x - x * turned.z
    moved.z += x * turned.y - y * turned.x


def do_transform_point(point: Any, transform: Any) -> Any:
    """Transform a PointStamped, Point or Point32 into the target frame: p_target = T p_source."""
    turn, made, source, target = _begin(point, "point", transform)
    _apply(turn, source, target)
    return made


def do_transform_vector3(vector3: Any, transform: Any) -> Any:
    """Rotate a Vector3Stamped or Vector3 to the axes of the target frame, without translation."""
    turn, made, source, target = _begin(vector3, "vector3", transform)
    _apply(rotation_of(turn), source, target)
    return made


def do_transform_quaternion(quaternion: Any, transform: Any) -> Any:
    """Rotate a QuaternionStamped or Quaternion into the target frame.

    The result has unit length. A quaternion of length 0 counts as the identity.
    """
    turn, made, source, target = _begin(quaternion, "quaternion", transform)
    _rotate_orientation(turn, source, target)
    return made


def do_transform_pose(pose: Any, transform: Any) -> Any:
    """Transform a PoseStamped (ROS 1) or a Pose (ROS 2) into the target frame.

    The length of the orientation is as in `do_transform_quaternion`. Its sign is upstream's: w >= 0
    in ROS 2, that of PyKDL's `GetQuaternion` in ROS 1.
    """
    turn, made, source, target = _begin(pose, "pose", transform)
    _move_pose(turn, source, target)
    return made


def do_transform_pose_stamped(pose: Any, transform: Any) -> Any:
    """Transform a PoseStamped into the target frame, as `do_transform_pose`."""
    return do_transform_pose(pose, transform)


def do_transform_pose_with_covariance_stamped(pose: Any, transform: Any) -> Any:
    """Transform a PoseWithCovarianceStamped or PoseWithCovariance into the target frame.

    The covariance is that of `transform_covariance`: of the same pose, on the target's axes. Raises
    InvalidArgumentException if the covariance does not have 36 numbers.
    """
    turn, made, source, target = _begin(pose, "pose with covariance", transform)
    _move_pose(turn, source.pose, target.pose)
    target.covariance = transform_covariance(source.covariance, turn).tolist()
    return made


def do_transform_wrench(wrench: Any, transform: Any, *, about_target: bool = False) -> Any:
    """Rotate a WrenchStamped or Wrench to the axes of the target frame.

    Parameters
    ----------
    wrench
        Force and torque on the source's axes.
    transform
        T[target<-source], with rotation R and translation t.
    about_target
        False, as in tf2: force' = R force and torque' = R torque, about the same point as before.
        True: the given torque is about the source's origin, the result is about the target's
        origin: torque' = R torque + t x force' (as tf2_kdl transforms a KDL Wrench).
    """
    turn, made, source, target = _begin(wrench, "wrench", transform)
    rotation = rotation_of(turn)
    _apply(rotation, source.force, target.force)
    _apply(rotation, source.torque, target.torque)
    if about_target:
        _shift(turn, target.force, target.torque)
    return made


def do_transform_twist(twist: Any, transform: Any, *, about_target: bool = False) -> Any:
    """Rotate a TwistStamped or Twist to the axes of the target frame.

    The result is relative to the same reference as before: motions of the frames are not added.

    Parameters
    ----------
    twist
        Linear and angular velocity on the source's axes.
    transform
        T[target<-source], with rotation R and translation t.
    about_target
        False: linear' = R linear and angular' = R angular, of the same point as before. True: the
        given velocity is that of the body's point at the source's origin, the result that of its
        point at the target's origin: linear' = R linear + t x angular' (as tf2_kdl transforms a KDL
        Twist).
    """
    turn, made, source, target = _begin(twist, "twist", transform)
    rotation = rotation_of(turn)
    _apply(rotation, source.linear, target.linear)
    _apply(rotation, source.angular, target.angular)
    if about_target:
        _shift(turn, target.angular, target.linear)
    return made


def do_transform_polygon_stamped(polygon: Any, transform: Any) -> Any:
    """Transform the corners of a PolygonStamped or Polygon into the target frame."""
    turn, made, source, target = _begin(polygon, "polygon", transform)
    for given in source.points:
        corner = type(given)()
        _apply(turn, given, corner)
        target.points.append(corner)
    return made


def transform_points(point_cloud: npt.ArrayLike, transform: Any) -> npt.NDArray[np.float64]:
    """Transform points into the target frame: p_target[i] = T p_source[i].

    Parameters
    ----------
    point_cloud
        (N, 3), metres.
    transform
        T[target<-source].

    Returns
    -------
    numpy.ndarray
        (N, 3) float64, new.

    Raises InvalidArgumentException for another shape.
    """
    import numpy as np

    try:
        points = np.asarray(point_cloud, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentException(f"points must be numbers: {error}") from error
    if points.ndim != 2 or points.shape[1] != 3:
        raise InvalidArgumentException(f"points must have the shape (N, 3), got {points.shape}")
    return rigid(transform).apply(points)


def transform_to_kdl(t: Any) -> Any:
    """Make a PyKDL.Frame of a TransformStamped. Raises ImportError if PyKDL is missing."""
    refuse_unlike(t, "t", "a TransformStamped", "transform")
    import PyKDL  # noqa: PLC0415 - ROS 1's alone

    move, turn = t.transform.translation, t.transform.rotation
    rotation = PyKDL.Rotation.Quaternion(turn.x, turn.y, turn.z, turn.w)
    return PyKDL.Frame(rotation, PyKDL.Vector(move.x, move.y, move.z))


def to_msg_msg(msg: Any) -> Any:
    """Return the message itself."""
    return msg


def from_msg_msg(msg: Any) -> Any:
    """Return the message itself."""
    return msg


def transform_to_msg(transform: _core.Transform) -> Any:
    """Make a TransformStamped of a `tfdb.Transform`, of the installed ROS or of tfdb."""
    make, _ = makers(installed() or "ros2")
    if not isinstance(transform, _core.Transform):
        raise TypeError(f"transform must be a tfdb.Transform, got {shown(transform)}")
    pose = transform.pose.tolist()
    return make(transform.target, transform.source, transform.stamp, pose)


def transform_from_msg(message: Any) -> _core.Transform:
    """Make a `tfdb.Transform` of a TransformStamped; raises the errors of its constructor."""
    what = "a TransformStamped"
    refuse_unlike(message, "message", what, "header", "child_frame_id", "transform")
    header, inside = message.header, message.transform
    names = (header.frame_id, message.child_frame_id)
    return _core.Transform(*names, inside.translation, inside.rotation, header.stamp)


_TRANSFORMS = {
    "PointStamped": do_transform_point,
    "Vector3Stamped": do_transform_vector3,
    "QuaternionStamped": do_transform_quaternion,
    "PoseStamped": do_transform_pose_stamped,
    "PoseWithCovarianceStamped": do_transform_pose_with_covariance_stamped,
    "WrenchStamped": do_transform_wrench,
    "TwistStamped": do_transform_twist,
    "PolygonStamped": do_transform_polygon_stamped,
}
for _name, _function in _TRANSFORMS.items():
    TransformRegistration().add(f"geometry_msgs/{_name}", _function)
for _name in (*_TRANSFORMS, "TransformStamped"):
    ConvertRegistration().add_to_msg(f"geometry_msgs/{_name}", to_msg_msg)
    ConvertRegistration().add_from_msg(f"geometry_msgs/{_name}", from_msg_msg)
ConvertRegistration().add_to_msg(_core.Transform, transform_to_msg)
ConvertRegistration().add_from_msg(_core.Transform, transform_from_msg)

belong_to(__name__, globals(), __all__)

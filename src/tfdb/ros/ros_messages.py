"""Message classes of results: real ones if ROS is installed, otherwise tfdb's."""

# ruff: noqa: PLC0415  (ROS may be missing, and takes long to import)

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any

from tfdb._core import MessageMaker

from . import msgs
from .times import SECOND, Flavor, nanoseconds

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


@cache
def installed() -> Flavor | None:
    """Return whether geometry_msgs of ROS 1 or ROS 2 is installed; None: neither."""
    try:
        from geometry_msgs.msg import TransformStamped
    except ImportError:
        return None
    return "ros1" if hasattr(TransformStamped, "_md5sum") else "ros2"


def clear_import_caches() -> None:
    """Forget which ROS packages are installed."""
    for remembered in (installed, makers, message_class):
        remembered.cache_clear()


@cache
def message_name(kind: type) -> str | None:
    """Name of a message's class, such as `geometry_msgs/PointStamped`; None for other classes."""
    name = getattr(kind, "_type", None)
    if isinstance(name, str):
        return name
    package, _, rest = kind.__module__.partition(".")
    return f"{package}/{kind.__name__}" if rest.startswith("msg.") else None


@cache
def message_class(name: str) -> type:
    """Return a class of geometry_msgs, of the installed ROS or of tfdb. Raises AttributeError."""
    if installed() is None:
        return getattr(msgs, name)  # type: ignore[no-any-return]
    import geometry_msgs.msg

    return getattr(geometry_msgs.msg, name)  # type: ignore[no-any-return]


def tf_message_class(flavor: Flavor) -> type:
    """Return the class TFMessage of the installed ROS if that has the flavor, otherwise tfdb's."""
    if installed() == flavor:
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError:
            return msgs.TFMessage
        return TFMessage  # type: ignore[no-any-return]
    return msgs.TFMessage


def real_tf_message(data: bytes, flavor: Flavor) -> Any:
    """Make a TFMessage of the installed ROS from bytes; None: tfdb's class is used."""
    kind: Any = tf_message_class(flavor)
    if kind is msgs.TFMessage:
        return None
    if flavor == "ros1":
        return kind().deserialize(data)
    from rclpy.serialization import deserialize_message

    return deserialize_message(data, kind)


def lookup_action_client(ns: str) -> Any:
    """Make actionlib's client of an action LookupTransform in ROS 1."""
    import actionlib
    from tf2_msgs.msg import LookupTransformAction

    return actionlib.SimpleActionClient(ns, LookupTransformAction)


def new_group() -> Any:
    """Make a callback group of rclpy whose callbacks may run at the same time."""
    from rclpy.callback_groups import ReentrantCallbackGroup

    return ReentrantCallbackGroup()


def fill_stamp(header: Any, stamp: Any) -> None:
    """Set the time in a header of any library to a time of any library."""
    made = header.stamp
    sec, nanosec = divmod(nanoseconds(stamp), SECOND)
    if hasattr(made, "nanosec"):
        made.sec, made.nanosec = sec, nanosec
    else:
        made.secs, made.nsecs = sec, nanosec


def fill_header(header: Any, given: Any) -> None:
    """Copy a header into another, both of any library."""
    header.frame_id = given.frame_id
    fill_stamp(header, given.stamp)
    if hasattr(header, "seq") and hasattr(given, "seq"):
        header.seq = given.seq


def make_header(stamp: Any, frame_id: str) -> Any:
    """Make a std_msgs/Header of the installed ROS, or of tfdb."""
    if installed() is None:
        return msgs.Header(stamp, frame_id)
    from std_msgs.msg import Header

    return Header(stamp=stamp, frame_id=frame_id)


@cache
def makers(flavor: Flavor) -> tuple[MessageMaker, Callable[[int], Any]]:
    """Return two functions that make messages of a flavor.

    One makes a TransformStamped from (target, source, nanoseconds, x y z qx qy qz qw), the other a
    time from nanoseconds.
    """
    if installed() != flavor:
        return MessageMaker(make_ours), msgs.Time.from_nanoseconds
    if flavor == "ros1":
        return MessageMaker(make_ros1), ros1_time
    return MessageMaker(make_ros2), ros2_time


def make_ours(target: str, source: str, stamp: int, pose: Sequence[float]) -> msgs.TransformStamped:
    """T[target<-source] as a message of tfdb."""
    x, y, z, qx, qy, qz, qw = pose
    return msgs.TransformStamped(
        msgs.Header(msgs.Time(stamp // SECOND, stamp % SECOND), target),
        source,
        msgs.Transform(msgs.Vector3(x, y, z), msgs.Quaternion(qx, qy, qz, qw)),
    )


def ros1_time(stamp: int) -> Any:
    """Make a rospy.Time."""
    from rospy import Time

    return Time(stamp // SECOND, stamp % SECOND)


def ros2_time(stamp: int) -> Any:
    """Make an rclpy.time.Time."""
    from rclpy.time import Time

    return Time(nanoseconds=stamp)


def make_ros1(target: str, source: str, stamp: int, pose: Sequence[float]) -> Any:
    """T[target<-source] as a message of ROS 1."""
    from geometry_msgs.msg import TransformStamped

    message = TransformStamped()
    message.header.stamp = ros1_time(stamp)
    return fill(message, target, source, pose)


def make_ros2(target: str, source: str, stamp: int, pose: Sequence[float]) -> Any:
    """T[target<-source] as a message of ROS 2."""
    from geometry_msgs.msg import TransformStamped

    message = TransformStamped()
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, SECOND)
    return fill(message, target, source, pose)


def fill(message: Any, target: str, source: str, pose: Sequence[float]) -> Any:
    """Set the names and the numbers of a TransformStamped."""
    message.header.frame_id = target
    message.child_frame_id = source
    move, turn = message.transform.translation, message.transform.rotation
    move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w = pose
    return message

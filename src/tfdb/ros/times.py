"""Times of any ROS library as integer nanoseconds, and whether they are of ROS 1 or ROS 2."""

from __future__ import annotations

import operator
from datetime import timedelta
from numbers import Real
from typing import Any

from tfdb._core import duration_to_nanoseconds

from . import Flavor

__all__ = ["SECOND", "Flavor", "duration", "flavor_of", "nanoseconds"]

SECOND = 1_000_000_000
WANTED = {
    "ros1": "{} must have a to_sec method, e.g. rospy.Time or rospy.Duration",
    "ros2": "{} must have sec and nanosec, or nanoseconds.",
}


def nanoseconds(time: Any, flavor: Flavor | None = None, role: str = "time") -> int:
    """Return the nanoseconds of a time or duration. A float is used only if no exact value exists.

    Takes integers (nanoseconds), and times and durations of `builtin_interfaces`, rclpy, rospy,
    genpy and tfdb. Raises TypeError with tf2's text for other objects, and for times whose parts
    are not integers: stamps are exact, so they are not rounded.
    """
    if type(time) is int:
        return time
    try:
        # Fields of a message of ROS 2 or tfdb.
        sec, nanosec = time.sec, time.nanosec
    except AttributeError:
        found = _of_object(time)
    else:
        return _whole(sec, "sec") * SECOND + _whole(nanosec, "nanosec")
    if found is None:
        raise TypeError(WANTED[flavor or "ros2"].format(role))
    return found


def duration(value: Any, flavor: Flavor | None = None, role: str = "duration") -> int:
    """Return the nanoseconds of a duration of any ROS or tfdb; numbers are in seconds.

    Raises TypeError with tf2's text for other objects; InvalidArgument for a number that is
    negative or not finite.
    """
    if not isinstance(value, bool) and isinstance(value, Real):
        return duration_to_nanoseconds(float(value), role)
    return nanoseconds(value, flavor, role)


def _whole(value: Any, part: str) -> int:
    """Return a part of a time, which must be an integer."""
    if isinstance(value, bool) or not hasattr(value, "__index__"):
        raise TypeError(f"{part} of a time must be an integer, got {value!r}")
    return operator.index(value)


def _of_object(time: Any) -> int | None:
    """Return the nanoseconds of an object that is not a ROS 2 message; None if it is not a time."""
    if isinstance(time, bool | timedelta):
        return None
    if hasattr(time, "secs") and hasattr(time, "nsecs"):
        return _whole(time.secs, "secs") * SECOND + _whole(time.nsecs, "nsecs")
    if hasattr(time, "to_nsec"):
        return _whole(time.to_nsec(), "to_nsec()")
    if hasattr(time, "nanoseconds"):
        return _whole(time.nanoseconds, "nanoseconds")
    if hasattr(time, "to_sec"):
        rounded: int = round(time.to_sec() * SECOND)
        return rounded
    try:
        found: int = operator.index(time)
    except TypeError:
        return None
    return found


def flavor_of(time: object) -> Flavor | None:
    """Return whether a time is of ROS 1 or ROS 2; None: it may be of both, like an integer."""
    ros1 = hasattr(time, "secs") or hasattr(time, "to_sec")
    ros2 = hasattr(time, "nanosec") or hasattr(time, "nanoseconds")
    if ros1 == ros2:
        return None
    return "ros1" if ros1 else "ros2"

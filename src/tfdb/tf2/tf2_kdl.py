"""The names of the package tf2_kdl: vectors, frames, twists and wrenches of PyKDL.

Importing it registers PyKDL's types for `Buffer.transform` and `convert`. Each function takes
T[target<-source] as a TransformStamped, and returns a new PyKDL object with the transform's header.
Raises ImportError if PyKDL is not installed.
"""

from __future__ import annotations

from typing import Any

import PyKDL

from tfdb.ros.ros_messages import fill_header, message_class

from .buffer_interface import ConvertRegistration, Stamped, TransformRegistration, with_header
from .geometry import transform_to_kdl

__all__ = [
    "convert_vector",
    "do_transform_frame",
    "do_transform_twist",
    "do_transform_vector",
    "do_transform_wrench",
    "from_msg_vector",
    "to_msg_vector",
    "transform_to_kdl",
]


def _transformed(given: Any, transform: Any) -> Any:
    return with_header(transform_to_kdl(transform) * given, transform.header)


def do_transform_vector(vector: Any, transform: Any) -> Any:
    """Transform a PyKDL.Vector, a point in metres, into the target frame: p_target = T p_source."""
    return _transformed(vector, transform)


def do_transform_frame(frame: Any, transform: Any) -> Any:
    """Transform a PyKDL.Frame into the target frame: T * frame."""
    return _transformed(frame, transform)


def do_transform_twist(twist: Any, transform: Any) -> Any:
    """Transform a PyKDL.Twist into the target frame, about the target's origin: m/s and rad/s."""
    return _transformed(twist, transform)


def do_transform_wrench(wrench: Any, transform: Any) -> Any:
    """Transform a PyKDL.Wrench into the target frame, about the target's origin: N and N m."""
    return _transformed(wrench, transform)


def to_msg_vector(vector: Any) -> Any:
    """Make a PointStamped of a PyKDL.Vector with a header."""
    message: Any = message_class("PointStamped")()
    fill_header(message.header, vector.header)
    message.point.x, message.point.y, message.point.z = vector[0], vector[1], vector[2]
    return message


def from_msg_vector(msg: Any) -> Any:
    """Make a PyKDL.Vector with a header of a PointStamped."""
    vector = PyKDL.Vector(msg.point.x, msg.point.y, msg.point.z)
    return Stamped(vector, msg.header.stamp, msg.header.frame_id)


def convert_vector(vector: Any) -> Any:
    """Copy a PyKDL.Vector with its header."""
    return Stamped(PyKDL.Vector(vector), vector.header.stamp, vector.header.frame_id)


for _kind, _function in (
    (PyKDL.Vector, do_transform_vector),
    (PyKDL.Frame, do_transform_frame),
    (PyKDL.Twist, do_transform_twist),
    (PyKDL.Wrench, do_transform_wrench),
):
    TransformRegistration().add(_kind, _function)
ConvertRegistration().add_to_msg(PyKDL.Vector, to_msg_vector)
ConvertRegistration().add_from_msg(PyKDL.Vector, from_msg_vector)
ConvertRegistration().add_convert((PyKDL.Vector, PyKDL.Vector), convert_vector)

"""Debian's python3-tf2-ros (ROS 1), run by the system's Python."""

from __future__ import annotations

import io
from typing import Any

import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped
from tf2_calls import Tf2Calls
from tf2_msgs.msg import TFMessage


def encode(transforms: list[Any]) -> bytes:
    """Make the bytes of a message on /tf."""
    data = io.BytesIO()
    TFMessage(transforms).serialize(data)
    return data.getvalue()


def receive(buffer: tf2_ros.Buffer, data: bytes) -> None:
    """Store such bytes, as rospy and tf2_ros.TransformListener do."""
    for transform in TFMessage().deserialize(data).transforms:
        buffer.set_transform(transform, "bench")


class Contender(Tf2Calls):
    """What tf2_ros does."""

    def __init__(self) -> None:
        super().__init__(
            lambda: tf2_ros.Buffer(rospy.Duration(10), debug=False),
            lambda stamp: rospy.Time(stamp // 10**9, stamp % 10**9),
            TransformStamped,
            encode,
            receive,
        )

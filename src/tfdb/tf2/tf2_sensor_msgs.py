"""The names of the package tf2_sensor_msgs of ROS 1 and ROS 2."""

from __future__ import annotations

from .clouds import do_transform_cloud
from .geometry import from_msg_msg, to_msg_msg, transform_points, transform_to_kdl

__all__ = [
    "do_transform_cloud",
    "from_msg_msg",
    "to_msg_msg",
    "transform_points",
    "transform_to_kdl",
]

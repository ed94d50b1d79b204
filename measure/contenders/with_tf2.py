"""Debian's python3-tf2-ros (ROS 1), run by the system's Python."""

from __future__ import annotations

import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped
from tf2_calls import Tf2Calls


class Contender(Tf2Calls):
    """What tf2_ros does."""

    def __init__(self) -> None:
        super().__init__(
            lambda: tf2_ros.Buffer(rospy.Duration(10), debug=False),
            lambda stamp: rospy.Time(stamp // 10**9, stamp % 10**9),
            TransformStamped,
        )

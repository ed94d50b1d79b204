"""The listener of ROS 2's tf2_ros, written by hand: PyPI's wheels of rclpy bring no tf2_ros.

Subscriptions, qualities, callback group and what is done with a message are tf2_ros's of Jazzy. The
store below is tf2's own in C++, Debian's of ROS 1: its stamps go through one method more than in
ROS 2. `deserialised` does nothing with a message: what a listener in Python costs at least.
"""

from __future__ import annotations

import sys
import threading
import types
from typing import Any

import builtin_interfaces.msg
import geometry_msgs.msg  # noqa: F401 - before Debian's, which would be found for it
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile
from ros2_live import ListensInRos2
from tf2_msgs.msg import TFMessage

Time = builtin_interfaces.msg.Time
Time.to_sec = lambda self: self.sec + 1e-9 * self.nanosec
# What tf2_py looks for when it is imported, and needs for its answers alone.
rospy = types.ModuleType("rospy")
rospy.Time, rospy.Duration = Time, builtin_interfaces.msg.Duration
sys.modules["rospy"] = rospy
sys.path.append("/usr/lib/python3/dist-packages")

import tf2_py  # noqa: E402


class Buffer(tf2_py.BufferCore):
    """What tf2_ros.Buffer of ROS 2 does for each transform."""

    def __init__(self) -> None:
        super().__init__()
        self._new_data_callbacks: list[Any] = []
        self._callbacks_lock = threading.RLock()

    def set_transform(self, *given: Any) -> None:
        super().set_transform(*given)
        self._call_new_data_callbacks()

    def set_transform_static(self, *given: Any) -> None:
        super().set_transform_static(*given)
        self._call_new_data_callbacks()

    def _call_new_data_callbacks(self) -> None:
        with self._callbacks_lock:
            for called in self._new_data_callbacks:
                called()


class Contender(ListensInRos2):
    """A node."""

    def begin(self) -> None:
        self.buffer = Buffer()
        group = ReentrantCallbackGroup()
        moving = QoSProfile(depth=100, history=HistoryPolicy.KEEP_LAST)
        static = QoSProfile(
            depth=100,
            durability=DurabilityPolicy.TRANSIENT_LOCAL,
            history=HistoryPolicy.KEEP_LAST,
        )
        take = self.callback if self.way == "stored" else self.nothing
        self.open = [
            self.node.create_subscription(TFMessage, topic, called, quality, callback_group=group)
            for topic, called, quality in (
                ("/tf", take, moving),
                ("/tf_static", self.static_callback, static),
            )
        ]

    def callback(self, data: TFMessage) -> None:
        who = "default_authority"
        for transform in data.transforms:
            self.buffer.set_transform(transform, who)
        self.nothing(data)

    def static_callback(self, data: TFMessage) -> None:
        who = "default_authority"
        for transform in data.transforms:
            self.buffer.set_transform_static(transform, who)

    def nothing(self, data: TFMessage) -> None:
        stamp = data.transforms[0].header.stamp
        self.stored(stamp.sec * 10**9 + stamp.nanosec)

    def leave(self) -> None:
        """Unsubscribe, in the executor: destroyed under it, it would fail."""
        while self.open:
            self.node.executor.create_task(self.node.destroy_subscription, self.open.pop())

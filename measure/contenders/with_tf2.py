"""Debian's python3-tf2-ros (ROS 1), run by the system's Python."""

from __future__ import annotations

from typing import Any

import rospy
import scenario
import tf2_ros
from geometry_msgs.msg import TransformStamped


def ros_time(stamp: int) -> rospy.Time:
    return rospy.Time(stamp // 10**9, stamp % 10**9)


def message(parent: str, child: str, time: rospy.Time, pose: Any) -> TransformStamped:
    """A fresh message, as a node makes it."""
    result = TransformStamped()
    result.header.stamp, result.header.frame_id, result.child_frame_id = time, parent, child
    t, q = result.transform.translation, result.transform.rotation
    t.x, t.y, t.z, q.x, q.y, q.z, q.w = pose
    return result


class Contender:
    """Holds one chain; `operations` are the loops that are timed."""

    def setup(self, chain: int, samples: int) -> None:
        self.names = scenario.names(chain)
        self.buffer = tf2_ros.Buffer(rospy.Duration(10), debug=False)
        for i, stamp in enumerate(scenario.samples(samples)):
            for edge in range(chain):
                pose = scenario.moving_pose(edge, 1e-3 * i)
                parent, child = self.names[edge], self.names[edge + 1]
                self.buffer.set_transform(message(parent, child, ros_time(stamp), pose), "bench")
        self.mid = [ros_time(stamp) for stamp in scenario.mid_stamps(samples)]
        self.next = scenario.START + samples * scenario.PERIOD
        self.operations = {
            "lookup mid": self.lookup_mid,
            "lookup latest": self.lookup_latest,
            "can_transform": self.can_transform,
            "set_transform": self.set_transform,
        }

    def pose(self, stamp: int) -> tuple[float, ...]:
        result = self.buffer.lookup_transform(self.names[0], self.names[-1], ros_time(stamp))
        t, q = result.transform.translation, result.transform.rotation
        return (t.x, t.y, t.z, q.x, q.y, q.z, q.w)

    def lookup_mid(self, count: int) -> None:
        lookup, target, source = self.buffer.lookup_transform, self.names[0], self.names[-1]
        for _ in range(count // len(self.mid)):
            for stamp in self.mid:
                lookup(target, source, stamp)

    def lookup_latest(self, count: int) -> None:
        lookup, target, source = self.buffer.lookup_transform, self.names[0], self.names[-1]
        latest = rospy.Time(0)
        for _ in range(count):
            lookup(target, source, latest)

    def can_transform(self, count: int) -> None:
        can, target, source = self.buffer.can_transform, self.names[0], self.names[-1]
        for _ in range(count // len(self.mid)):
            for stamp in self.mid:
                can(target, source, stamp)

    def set_transform(self, count: int) -> None:
        store, parent, child = self.buffer.set_transform, self.names[0], self.names[1]
        pose = scenario.moving_pose(0, 0.5)
        for _ in range(count):
            store(message(parent, child, ros_time(self.next), pose), "bench")
            self.next += scenario.PERIOD

"""Debian's tf2_ros.TransformListener in a live graph of ROS 1, with TCP_NODELAY as ours has it."""

from __future__ import annotations

import rospy
import tf2_ros
from live import Waits
from with_tf2_live import Contender as Node
from with_tf2_live import Listener, ros_time, wait_for

LATEST = rospy.Time(0)


class Contender(Waits):
    """A node that listens."""

    def join(self, uri: str) -> None:
        """Become a node of that master."""
        Node().join(uri, 1)

    def listen(self, target: str, source: str) -> None:
        """Subscribe; return when lookups are answered."""
        self.buffer = tf2_ros.Buffer(rospy.Duration(10), debug=False)
        self.listener = Listener(self.buffer, tcp_nodelay=True)
        self.ends = target, source
        wait_for("transform", lambda: self.buffer.can_transform(*self.ends, LATEST))

    def look_up(self) -> None:
        self.buffer.lookup_transform(*self.ends, LATEST)

    def received(self) -> int:
        """Messages since it listens."""
        return self.listener.received

    def wait_at(self, stamp: int) -> None:
        """Wait for the first edge's transform at a stamp."""
        self.buffer.lookup_transform("frame_0", "frame_1", ros_time(stamp), rospy.Duration(1))

    def newest(self) -> int:
        """Newest stamp of the first edge."""
        newest: int = self.buffer.get_latest_common_time("frame_0", "frame_1").to_nsec()
        return newest

    def leave(self) -> None:
        """Unsubscribe."""
        self.listener.unregister()

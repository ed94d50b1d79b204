"""tfdb's listener in a graph over DDS, without rclpy."""

from __future__ import annotations

from ros2_live import ListensInRos2
from with_tfdb_in_ros2 import timed

from tfdb import tf2
from tfdb.ros import DdsNode


class Contender(ListensInRos2):
    """A node."""

    def join(self, way: str) -> None:
        """Become a node when it listens."""
        self.way = way
        self.late: list[int] = []

    def begin(self) -> None:
        self.ours = timed(DdsNode, self.stored)()
        self.buffer = tf2.Buffer()
        self.listener = tf2.TransformListener(self.buffer, self.ours)

    def leave(self) -> None:
        """Unsubscribe."""
        self.listener.unregister()
        self.ours.close()

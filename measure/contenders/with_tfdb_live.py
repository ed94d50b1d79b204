"""tfdb's listener in a live graph of ROS 1: in a node of its own, without any package of ROS."""

from __future__ import annotations

import os
import time

from live import Listens

from tfdb import tf2
from tfdb.ros.tcpros_node import TcprosNode


class Contender(Listens):
    """A node that listens."""

    def join(self, uri: str) -> None:
        """Become a node of that master."""
        os.environ |= {"ROS_MASTER_URI": uri, "ROS_IP": "127.0.0.1"}
        self.node = TcprosNode(arguments=[])

    def listen(self, target: str, source: str) -> None:
        """Subscribe; return when lookups are answered."""
        self.buffer = tf2.Buffer(flavor="ros1", debug=False)
        self.listener = tf2.TransformListener(self.buffer, self.node)
        while not self.buffer.can_transform(target, source, 0):
            time.sleep(0.01)

    def received(self) -> int:
        """Messages since it listens."""
        return self.buffer.buffer.commit

    def leave(self) -> None:
        """Unsubscribe."""
        self.listener.unregister()

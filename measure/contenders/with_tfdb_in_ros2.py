"""tfdb's listener in a node of rclpy: in a thread of its own, or in the node's executor."""

from __future__ import annotations

import struct
from typing import Any

from ros2_live import ListensInRos2

from tfdb import tf2
from tfdb.ros.rclpy_node import RclpyNode

STAMP_AT = 8  # behind the encapsulation header and the count


class Contender(ListensInRos2):
    """A node."""

    def begin(self) -> None:
        stored = self.stored

        class Timed(RclpyNode):
            """Tells when a message is stored."""

            def subscribe(self, topic: str, kind: str, on_message: Any, **more: Any) -> Any:
                def timed(data: bytes, publisher: str) -> None:
                    on_message(data, publisher)
                    seconds, rest = struct.unpack_from("<iI", data, STAMP_AT)
                    stored(seconds * 10**9 + rest)

                return super().subscribe(topic, kind, timed, **more)

        self.ours = Timed(self.node, own_thread=self.way == "own thread")
        self.buffer = tf2.Buffer()
        self.listener = tf2.TransformListener(self.buffer, self.ours)

    def leave(self) -> None:
        """Unsubscribe."""
        self.listener.unregister()
        self.ours.close()

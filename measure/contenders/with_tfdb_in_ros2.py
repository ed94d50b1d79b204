"""tfdb's listener in a node of rclpy: in a thread of its own, or in the node's executor."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

from ros2_live import ListensInRos2

from tfdb import tf2
from tfdb.ros.rclpy_node import RclpyNode

if TYPE_CHECKING:
    from collections.abc import Callable

STAMP_AT = 8  # behind the encapsulation header and the count


def timed(kind: Any, stored: Callable[[int], None]) -> Any:
    """Return the class of nodes that tells the stamp of each message that is stored."""

    class Timed(kind):
        """Such a node."""

        def subscribe(self, topic: str, kind: str, on_message: Any, **more: Any) -> Any:
            def noted(data: bytes, publisher: str) -> None:
                on_message(data, publisher)
                seconds, rest = struct.unpack_from("<iI", data, STAMP_AT)
                stored(seconds * 10**9 + rest)

            return super().subscribe(topic, kind, noted, **more)

    return Timed


class Contender(ListensInRos2):
    """A node."""

    def begin(self) -> None:
        node = timed(RclpyNode, self.stored)
        self.ours = node(self.node, own_thread=self.way == "own thread")
        self.buffer = tf2.Buffer()
        self.listener = tf2.TransformListener(self.buffer, self.ours)

    def leave(self) -> None:
        """Unsubscribe."""
        self.listener.unregister()
        self.ours.close()

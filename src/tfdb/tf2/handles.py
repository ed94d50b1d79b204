"""Attributes of listeners, broadcasters and clients: objects of rclpy or rospy.

If a node has no ROS library, a topic has an object with rospy's calls instead.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tfdb import _core

if TYPE_CHECKING:
    from tfdb.ros import Encoding, Node

__all__ = ["handle_of", "native_node"]


def native_node(node: Node) -> Any:
    """Return the rclpy node below a node, otherwise the node itself."""
    return getattr(node, "given", node)


def handle_of(opened: Any, encoding: Encoding) -> Any:
    """Return the ROS library's object for a topic, otherwise an object with rospy's calls."""
    return opened.native or _Topic(opened, encoding)


class _Topic:
    """A subscription or publisher of TFMessages in a node without a ROS library. Threads: any."""

    def __init__(self, opened: Any, encoding: Encoding) -> None:
        self._opened, self._encoding = opened, encoding

    def publish(self, data: Any) -> None:
        """Send a TFMessage."""
        self._opened.publish(_core.encode_tf_message(data.transforms, self._encoding))

    def get_num_connections(self) -> int:
        """Number of connected nodes."""
        opened = self._opened
        connected = opened.subscribers if hasattr(opened, "publish") else opened.publishers
        return len(connected)

    def unregister(self) -> None:
        """Unregister the topic."""
        self._opened.close()

"""`TransformBroadcaster`: publishes transforms on /tf."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tfdb import _core
from tfdb.data.stamps import shown
from tfdb.ros import node_for

from .handles import handle_of
from .message_checks import WrongMessageError, refuse_unlike

if TYPE_CHECKING:
    from tfdb.ros import Node

__all__ = ["TransformBroadcaster"]

KIND = "tf2_msgs/TFMessage"


class TransformBroadcaster:
    """Publishes transforms on /tf. Any thread may send.

    Parameters
    ----------
    node
        A node of rclpy or `tfdb.ros`. None: rospy's node; after `rclpy.init` a new rclpy node;
        otherwise a node without ROS.
    qos
        In an rclpy node: a QoS profile in place of tf2's.
    """

    def __init__(self, node: Any = None, qos: Any = None) -> None:
        self.node: Node = node_for(node)
        """The publishing node."""
        self._publisher = self.node.advertise("/tf", KIND, depth=100, qos=qos)
        self.pub_tf: Any = handle_of(self._publisher, self.node.encoding)
        """The publisher of rclpy or rospy: `publish` sends a TFMessage."""

    def sendTransform(self, transform: Any) -> None:  # noqa: N802 - tf2's name
        """Send one or several transforms in one message.

        Each is a `geometry_msgs/TransformStamped` of any library: T[header.frame_id<-
        child_frame_id] at header.stamp. Raises InvalidStamp or InvalidName, and then sends nothing.
        """
        self._publisher.publish(_core.encode_tf_message(members(transform), self.node.encoding))

    def close(self) -> None:
        """Unregister the topic."""
        self._publisher.close()


def members(transform: Any) -> list[Any]:
    """Return one or many transforms as a list."""
    if hasattr(transform, "child_frame_id"):
        return [transform]
    if isinstance(transform, str) or not hasattr(transform, "__iter__"):
        text = f"transform must be a TransformStamped or several, got {shown(transform)}"
        raise WrongMessageError(text)
    found = list(transform)
    for i, each in enumerate(found):
        refuse_unlike(each, f"transform[{i}]", "a TransformStamped", "header", "child_frame_id")
    return found

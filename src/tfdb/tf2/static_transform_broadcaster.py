"""`StaticTransformBroadcaster`: publishes static transforms on /tf_static, also to late joiners."""

from __future__ import annotations

import threading
from copy import deepcopy
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

import tfdb
from tfdb.ros import node_for

from .transform_broadcaster import KIND, members

if TYPE_CHECKING:
    from tfdb.ros import Node

__all__ = ["StaticTransformBroadcaster"]


class _Sent:
    """What was sent by the broadcasters that share a latched topic."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.by_child: dict[str, Any] = {}


# A node of ROS 1 has one latched message for each topic, whoever publishes it.
_sent_by: WeakValueDictionary[str, _Sent] = WeakValueDictionary()


class StaticTransformBroadcaster:
    """Publishes static transforms on /tf_static. Any thread may send.

    Who joins late gets all that was sent by the node's broadcasters, the newest of each child.

    Parameters
    ----------
    node
        A node of rclpy or `tfdb.ros`; None: that of the process, in rospy or without any ROS.
    qos
        In a node of rclpy: a QoS profile instead of tf2's.
    """

    def __init__(self, node: Any = None, qos: Any = None) -> None:
        self.node: Node = node_for(node)
        """The node that it publishes in."""
        self._publisher = self.node.advertise("/tf_static", KIND, latched=True, depth=1, qos=qos)
        self._sent = _Sent()
        if self.node.flavor == "ros1":
            self._sent = _sent_by.setdefault(self.node.name, self._sent)

    def sendTransform(self, transform: Any) -> None:  # noqa: N802 - tf2's name
        """Send one static transform, or any number of them, together with those sent before.

        Each is a `geometry_msgs/TransformStamped` of any library, and says
        T[header.frame_id<-child_frame_id] at all times, until the next for the same
        child. Raises InvalidStamp, InvalidName; nothing was sent.
        """
        new = {one.child_frame_id: deepcopy(one) for one in members(transform)}
        with self._sent.lock:
            sent = {**self._sent.by_child, **new}
            self._publisher.publish(tfdb.encode_tf_message(sent.values(), self.node.encoding))
            self._sent.by_child = sent

    def close(self) -> None:
        """Take the topic back."""
        self._publisher.close()

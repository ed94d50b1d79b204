"""`StaticTransformBroadcaster`: publishes static transforms on the latched /tf_static."""

from __future__ import annotations

import threading
from copy import deepcopy
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

from tfdb import _core
from tfdb.data import errors
from tfdb.ros import node_for
from tfdb.ros.ros_messages import tf_message_class

from .handles import handle_of
from .transform_broadcaster import KIND, members

if TYPE_CHECKING:
    from tfdb.ros import Node

__all__ = ["StaticTransformBroadcaster"]


class _Latched:
    """A latched topic, and its transforms. Threads: `lock` is held."""

    def __init__(self, node: Node, qos: Any) -> None:
        self.node = node
        self.lock = threading.Lock()
        self.users = 0
        self._publisher = node.advertise("/tf_static", KIND, latched=True, depth=1, qos=qos)
        self.handle: Any = handle_of(self._publisher, node.encoding)
        self.message: Any = tf_message_class(node.flavor)()

    def send(self, transforms: dict[str, Any]) -> None:
        """Send transforms, by child, together with those sent before."""
        sent = {one.child_frame_id: one for one in self.message.transforms} | transforms
        self._publisher.publish(_core.encode_tf_message(sent.values(), self.node.encoding))
        self.message.transforms[:] = sent.values()

    def close(self) -> None:
        """Unregister the topic."""
        self._publisher.close()


# A ROS 1 node latches one message per topic, so all broadcasters of a node share it.
_latched: WeakValueDictionary[Node, _Latched] = WeakValueDictionary()
_lock = threading.Lock()


def _latched_by(node: Node, qos: Any) -> _Latched:
    with _lock:
        shared = _latched.get(node) if node.flavor == "ros1" else None
        if shared is None or shared.users == 0:
            shared = _Latched(node, qos)
            if node.flavor == "ros1":
                _latched[node] = shared
        shared.users += 1
        return shared


class StaticTransformBroadcaster:
    """Publishes static transforms on /tf_static. Any thread may send.

    Nodes that join later get the newest transform of each child, from all broadcasters of this
    node.

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
        self._latched: _Latched | None = _latched_by(self.node, qos)
        self.pub_tf: Any = self._latched.handle
        """The publisher of rclpy or rospy: `publish` sends a TFMessage."""
        self.net_message: Any = self._latched.message
        """A TFMessage with all sent transforms; each `sendTransform` updates and sends it."""

    def sendTransform(self, transform: Any) -> None:  # noqa: N802 - tf2's name
        """Send one or several static transforms, together with those sent before.

        Each is a `geometry_msgs/TransformStamped` of any library: T[header.frame_id<-
        child_frame_id] at all times, until another for the same child. Raises InvalidStamp,
        InvalidName or NodeClosed, and then sends nothing.
        """
        new = {one.child_frame_id: deepcopy(one) for one in members(transform)}
        latched = self._latched
        if latched is None:
            raise errors.NodeClosed("the broadcaster was closed", reason="it was closed")
        with latched.lock:
            latched.send(new)

    def close(self) -> None:
        """Unregister the topic unless another broadcaster of the node uses it."""
        latched, self._latched = self._latched, None
        if latched is None:
            return
        with _lock:
            latched.users -= 1
            last = latched.users == 0
        if last:
            latched.close()

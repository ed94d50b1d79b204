"""Chooses the node of a program: a given one, rospy's, or a new one."""

# ruff: noqa: PLC0415  (a ROS is imported only by those who use it)

from __future__ import annotations

import os
import sys
import threading
from typing import TYPE_CHECKING, Any

from tfdb.data.errors import NoMaster

if TYPE_CHECKING:
    from .node import Flavor, Node

__all__ = ["node_for"]

_lock = threading.Lock()
_own: dict[Flavor, Node] = {}
os.register_at_fork(after_in_child=_own.clear)


def node_for(given: Any = None, *, own_thread: bool = False) -> Node:
    """Return the node for an argument.

    Parameters
    ----------
    given
        A node of `tfdb.ros`: itself. A node of rclpy: a `RclpyNode` on it. None: a `RospyNode` if
        the process has called `rospy.init_node`. Otherwise a node that the process creates once: a
        `RclpyNode` after `rclpy.init`, or a `TcprosNode`.
    own_thread
        Whether messages of an rclpy node arrive in a separate thread instead of its executor.

    Raises TypeError for an object that is not a node, NoMaster if a `TcprosNode` finds no master.
    """
    if given is None:
        return _of_the_process()
    if hasattr(given, "subscribe") and hasattr(given, "encoding"):
        node: Node = given
        return node
    if hasattr(given, "create_subscription"):
        from .rclpy_node import RclpyNode

        return RclpyNode(given, own_thread=own_thread)
    raise TypeError(f"node must be of tfdb.ros or rclpy, or None, got {type(given).__name__}")


def in_rospy() -> bool:
    """Whether the process is a node of rospy."""
    rospy = sys.modules.get("rospy")
    return rospy is not None and rospy.core.is_initialized()


def in_rclpy() -> bool:
    """Whether the process has called `rclpy.init`, and not `rclpy.shutdown` since."""
    rclpy = sys.modules.get("rclpy")
    # The stand-in for machines without ROS has only times.
    return rclpy is not None and hasattr(rclpy, "ok") and rclpy.ok()


def _of_the_process() -> Node:
    if in_rospy():
        from .rospy_node import RospyNode

        return RospyNode()
    flavor: Flavor = "ros2" if in_rclpy() else "ros1"
    with _lock:
        if flavor not in _own or _own[flavor].closed:
            _own[flavor] = _make(flavor, f"tfdb_{os.getpid()}")
        return _own[flavor]


def _make(flavor: Flavor, name: str) -> Node:
    if flavor == "ros2":
        from .rclpy_node import own_node

        return own_node(name)
    from .tcpros_node import TcprosNode

    try:
        return TcprosNode(name)
    except NoMaster as error:
        raise NoMaster(
            f"{error}. For ROS 2, call rclpy.init() first, or pass a node",
            uri=error.uri,
            reason=error.reason,
        ) from error

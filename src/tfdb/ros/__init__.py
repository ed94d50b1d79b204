"""Live ROS: nodes that carry bytes between a graph and a store.

A message stays the bytes that it came as: `Buffer.ingest` decodes them natively. `TcprosNode` is a
node of ROS 1 without any package of ROS, `RospyNode` one within rospy, `RclpyNode` one of ROS 2.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from .node import Encoding, Flavor, Node, Publisher, Service, Subscription
from .which import node_for

if TYPE_CHECKING:
    from .rclpy_node import RclpyNode
    from .rospy_node import RospyNode
    from .tcpros_node import TcprosNode

__all__ = [
    "Encoding",
    "Flavor",
    "Node",
    "Publisher",
    "RclpyNode",
    "RospyNode",
    "Service",
    "Subscription",
    "TcprosNode",
    "node_for",
]

_FILES = {"TcprosNode": "tcpros_node", "RospyNode": "rospy_node", "RclpyNode": "rclpy_node"}


def __getattr__(name: str) -> Any:
    # Two of them need a ROS, and each takes its time to import.
    if name not in _FILES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_FILES[name]}", __name__), name)

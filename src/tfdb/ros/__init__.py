"""Live ROS: nodes that carry bytes between a graph and a store.

Messages stay serialized until `Buffer.ingest` decodes them natively. `TcprosNode` is a ROS 1 node
without ROS packages, `RospyNode` the node of a rospy process, `RclpyNode` a node of rclpy.
`ZenohNode` is a ROS 2 node in a graph of rmw_zenoh, `DdsNode` one in a graph over DDS, both without
ROS packages.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.lazy_names import belong_to
from tfdb.data.lazy_names import on_demand as _offer

from .choose_node import node_for
from .node import Encoding, Flavor, Node, Publisher, Service, Subscription

if TYPE_CHECKING:
    from .dds_node import DdsNode
    from .rclpy_node import RclpyNode
    from .rospy_node import RospyNode
    from .tcpros_node import TcprosNode
    from .zenoh_node import ZenohNode

__all__ = [
    "DdsNode",
    "Encoding",
    "Flavor",
    "Node",
    "Publisher",
    "RclpyNode",
    "RospyNode",
    "Service",
    "Subscription",
    "TcprosNode",
    "ZenohNode",
    "node_for",
]

belong_to(__name__, globals(), ("Node", "Publisher", "Service", "Subscription", "node_for"))

if not TYPE_CHECKING:  # otherwise type checkers would find every name
    # Two of these classes need ROS, and importing each takes time.
    __getattr__, __dir__ = _offer(
        __name__,
        {
            "dds_node": ("DdsNode",),
            "rclpy_node": ("RclpyNode",),
            "rospy_node": ("RospyNode",),
            "tcpros_node": ("TcprosNode",),
            "zenoh_node": ("ZenohNode",),
        },
        needs={"rclpy_node": "rclpy", "rospy_node": "rospy"},
    )

"""Live ROS: nodes that carry bytes between a graph and a store.

A message stays the bytes that it came as: `Buffer.ingest` decodes them natively.
"""

from __future__ import annotations

from .node import Encoding, Flavor, Node, Publisher, Service, Subscription
from .which import node_for

__all__ = ["Encoding", "Flavor", "Node", "Publisher", "Service", "Subscription", "node_for"]

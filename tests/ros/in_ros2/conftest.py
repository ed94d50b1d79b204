"""Nodes in one graph, and waiting without sleeping."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ros.in_ros2.graph import Graph


@pytest.fixture
def graph() -> Iterator[Graph]:
    """Nodes that end with the test."""
    # A process that collects all tests has no ROS 2.
    import rclpy

    from ros.in_ros2.graph import Graph

    made = Graph(rclpy.Context())
    yield made
    made.end()

"""Commands on a live graph of ROS 2."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

import tfdb
from ros.commands import Command, tfdb_json, tfdb_says
from ros.in_ros2.graph import LIMIT, connected, message

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ros.in_ros2.graph import Graph

S = 1_000_000_000


@pytest.fixture
def moving(graph: Graph) -> Any:
    """A publisher on /tf, beside one that has published on /tf_static."""
    node = graph.node("theirs")
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    graph.static = node.create_publisher(TFMessage, "/tf_static", latched)
    graph.static.publish(message(7, parent="map"))
    return node.create_publisher(TFMessage, "/tf", 100)


@pytest.fixture
def store() -> Iterator[str]:
    name = f"test-commands-{os.getpid()}"
    yield name
    with suppress(tfdb.NoSuchStore):
        tfdb.Buffer.unlink(name)


def test_a_lookup_listens(moving: Any) -> None:
    found = tfdb_json("lookup", "ros2:", "map", "frame0", "--for", "20")
    assert found["translation"][0] == 7


def test_graphs_that_are_none() -> None:
    assert "is no domain" in tfdb_says("tree", "ros2:233", code=2)
    assert "is no name" in tfdb_says("tree", "ros2:", "--node-name", "a b", code=2)
    assert "does not start" in tfdb_says("tree", "ros2:", "--ros-args", "-r", "bad", code=2)


def test_serve(moving: Any, store: str) -> None:
    remapped = ("--ros-args", "-r", "__node:=serving")
    with Command("serve", "ros2", "--into", store, *remapped) as serving:
        assert f"ros2: as /serving into shm:{store}" in serving.line()
        connected(moving)
        moving.publish(message(8, frames=2, parent="frame9"))
        shared = tfdb.Buffer.open(store, mode="r")
        found = shared.lookup_transform("frame9", "frame1", None, timeout=LIMIT)
        assert found.stamp == 108 * S + 1
        assert shared.frame_info("frame1").authority == "/theirs"
        code, _ = serving.end(signal.SIGTERM)
    assert code == 143

"""Commands on a live graph of ROS 2."""

from __future__ import annotations

import json
import os
import queue
import signal
from contextlib import suppress
from itertools import count
from typing import TYPE_CHECKING, Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from tf2_msgs.msg import TFMessage

import tfdb
from ros.commands import Command, tfdb_json, tfdb_says
from ros.in_ros2.graph import LIMIT, Heard, connected, message, until
from tfdb import tf2

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from ros.in_ros2.graph import Graph

S = 1_000_000_000
UNKNOWN = "default_authority"  # until the graph knows the node of a publisher


@pytest.fixture
def moving(graph: Graph) -> Any:
    """A publisher on /tf, and one that has published on /tf_static."""
    node = graph.node("theirs")
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    graph.static = node.create_publisher(TFMessage, "/tf_static", latched)
    graph.static.publish(message(7, parent="map"))
    return node.create_publisher(TFMessage, "/tf", 100)


@pytest.fixture
def store() -> Iterator[str]:
    name = f"test-commands-{os.getpid()}"
    yield name
    with suppress(tfdb.errors.NoSuchStore):
        tfdb.Buffer.unlink(name)


def test_a_lookup_listens(moving: Any) -> None:
    found = tfdb_json("lookup", "ros2:", "map", "frame0", "--for", "20")
    assert found["translation"][0] == 7


def test_graphs_that_are_none() -> None:
    assert "is not a ROS 2 domain" in tfdb_says("tree", "ros2:233", code=2)
    assert "is not a valid node name" in tfdb_says("tree", "ros2:", "--node-name", "a b", code=2)
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
        assert shared.frame_info("frame1").authority in {"/theirs", UNKNOWN}
        code, _ = serving.end(signal.SIGTERM)
    assert code == 143


def monitored(monitor: Command, name: str) -> dict[str, Any]:
    """Return the entry of a frame in the monitor's next line; empty if it has none."""
    told = json.loads(monitor.line())
    return next((each for each in told["frames"] if each["frame"] == name), {})


def test_echo_and_monitor(moving: Any) -> None:
    ends = ("map", "frame1", "--json")
    with (
        Command("monitor", "ros2:", *ends, "--every", "0.1") as monitor,
        Command("echo", "ros2:", *ends, "--each") as echo,
    ):
        connected(moving, 2)
        moving.publish(message(9, frames=2, parent="map"))
        while "error" in (echoed := json.loads(echo.line())):
            pass
        assert (echoed["stamp_ns"], echoed["translation"][0]) == (109 * S + 1, 9)
        # The monitor counts messages after its start, which may be later than its subscription.
        while not (frame := monitored(monitor, "frame1")).get("messages"):
            moving.publish(message(9, frames=2, parent="map"))
        assert frame["authorities"][0] in {"/theirs", UNKNOWN}
        # Stamps of 1970 come from another clock.
        assert frame["delay_ns"] is None
        assert echo.end()[0] == 130
        assert monitor.end(signal.SIGTERM)[0] == 143


def test_record(moving: Any, tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with Command("record", "ros2:", "-o", path, "--flush", "0.01") as recording:
        recording.line()
        connected(moving)
        part, numbers = tmp_path / "drive.mcap.part", count(8)

        def recorded() -> int:
            try:
                return len(list(tfdb.recorded_commits(part, salvage=True)))
            except tfdb.errors.RecordingError:
                return 0  # the file has no state yet

        until(
            lambda: recorded() > 10,
            meanwhile=lambda: moving.publish(message(next(numbers), frames=2, parent="map")),
        )
        code, said = recording.end()
    assert code == 0
    assert "commits" in said
    copy = tfdb.Buffer(history=None)
    for each in tfdb.recorded_commits(path):
        copy.apply(each.data)
    assert copy.parent_of("frame0") == "map"
    assert copy.frame_info("frame1").authority in {"/theirs", UNKNOWN}
    samples = copy.frame_info("frame1").samples
    assert samples > 1
    assert tfdb.load(path, exclude="frame0").frame_info("frame1").samples == samples


def test_watch_publishes_diagnostics(graph: Graph, tmp_path: Path) -> None:
    file = tmp_path / "e.toml"
    file.write_text('version = 1\n[[edge]]\nparent = "odom"\nchild = "base"\n')
    heard: queue.Queue[DiagnosticArray] = queue.Queue()
    node = graph.node("theirs", spin=True)
    node.create_subscription(DiagnosticArray, "/diagnostics", heard.put, 10)
    with Command("watch", "ros2:", "--expect", file, "--diagnostics") as watching:
        while len((found := heard.get(timeout=LIMIT)).status) < 2:
            assert (found.status[0].level, found.status[0].message) == (b"\0", "OK")
        assert watching.end(signal.SIGTERM)[0] == 143
    _, edge = found.status
    assert (edge.level, edge.name) == (b"\2", "tfdb: odom -> base")
    assert edge.message == "missing 1 s (limit 1 s)"
    assert [(each.key, each.value) for each in edge.values] == [("missing", "1")]


def test_static_publisher(graph: Graph) -> None:
    """A node that joins later gets the transform."""
    flags = ("--x", "1", "--yaw", "0.4", "--frame-id", "map", "--child-frame-id", "base")
    with Command("static-publisher", "ros2:", *flags, "--node-name", "ours") as publisher:
        assert "ros2: as /ours" in publisher.line()
        heard = Heard()
        node = graph.ours(graph.node("late"), own_thread=True)
        node.subscribe("/tf_static", "tf2_msgs/TFMessage", heard, latched=True)
        heard.until(lambda h: len(h.messages) == 1)
        (one,) = tfdb.decode_tf_message(heard.messages[0], "cdr")
        assert (one.parent, one.child, one.translation[0]) == ("map", "base", 1)
        assert publisher.end() == (130, "")


def test_buffer_server(graph: Graph, store: str) -> None:
    filled = tfdb.Buffer.open(store)
    filled.set_transform("map", "base", 5 * S, (5, 2, -3), (0.6, 0, 0, 0.8))
    with Command("buffer-server", "ros2:", "--store", store) as server:
        assert "tf2_buffer_server" in server.line()
        client = tf2.BufferClient(graph.node("asking", spin=True), "tf2_buffer_server")
        assert client.wait_for_server(Duration(seconds=LIMIT))
        found = client.lookup_transform(
            "map", "base", Time(seconds=5), timeout=Duration(seconds=LIMIT)
        )
        assert found.transform.translation.x == 5
        assert server.end(signal.SIGTERM)[0] == 143

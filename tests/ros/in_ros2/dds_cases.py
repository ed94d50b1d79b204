"""Our node over DDS and nodes of the real rclpy, in one graph."""

from __future__ import annotations

import importlib.util
import os
from typing import TYPE_CHECKING, Any

import pytest
from rclpy.node import NodeNameNonExistentError
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

import tfdb
from ros import hearing
from ros.hearing import LIMIT
from ros.in_ros2.graph import TF, Graph, as_bytes, message, numbers, until

if TYPE_CHECKING:
    from collections.abc import Iterator

if importlib.util.find_spec("cyclonedds") is None and "CI" not in os.environ:
    pytest.skip("cyclonedds is not installed", allow_module_level=True)

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
COUNT = 50


@pytest.fixture
def ours() -> Iterator[Any]:
    from tfdb.ros import DdsNode

    with DdsNode("ours", arguments=[]) as node:
        yield node


def test_tf_from_rclpy(graph: Graph, ours: Any) -> None:
    publisher = graph.node("theirs").create_publisher(TFMessage, "/tf", 100)
    heard = hearing.Heard()
    ours.subscribe("/tf", TF, heard)
    until(lambda: not heard.messages.empty(), meanwhile=lambda: publisher.publish(message(0)))
    for number in range(1, COUNT):
        publisher.publish(message(number, frames=10))
    found = []
    while not found or found[-1] != COUNT - 1:
        data, sender = heard.next()
        assert len(bytes.fromhex(sender)) == 16
        found += numbers([data])
    assert found[found.index(1) :] == [*range(1, COUNT)]
    assert ours.refused == 0


def test_tf_to_rclpy(graph: Graph, ours: Any) -> None:
    heard: list[bytes] = []
    node = graph.node("theirs", spin=True)
    node.create_subscription(TFMessage, "/tf", heard.append, 100, raw=True)
    publisher = ours.advertise("/tf", TF, depth=COUNT)
    until(lambda: bool(heard), meanwhile=lambda: publisher.publish(as_bytes(0)))
    for number in range(1, COUNT):
        publisher.publish(as_bytes(number, frames=10))
    until(lambda: numbers(heard[-1:]) == [COUNT - 1])
    found = numbers(heard)
    assert found[found.index(1) :] == [*range(1, COUNT)]


@pytest.mark.parametrize("first", ["publisher", "subscriber"])
def test_statics_from_rclpy(graph: Graph, ours: Any, first: str) -> None:
    node, heard = graph.node("theirs"), hearing.Heard()
    if first == "publisher":
        publisher = node.create_publisher(TFMessage, "/tf_static", LATCHED)
        publisher.publish(message(7, frames=3))
    ours.subscribe("/tf_static", TF, heard, latched=True)
    if first == "subscriber":
        publisher = node.create_publisher(TFMessage, "/tf_static", LATCHED)
        publisher.publish(message(7, frames=3))
    assert numbers([heard.next()[0]]) == [7]


@pytest.mark.parametrize("first", ["publisher", "subscriber"])
def test_statics_to_rclpy(graph: Graph, ours: Any, first: str) -> None:
    node = graph.node("theirs", spin=True)
    heard: list[bytes] = []

    def listen() -> None:
        node.create_subscription(TFMessage, "/tf_static", heard.append, LATCHED, raw=True)

    if first == "subscriber":
        listen()
    ours.advertise("/tf_static", TF, latched=True, depth=1).publish(as_bytes(8, frames=3))
    if first == "publisher":
        listen()
    until(lambda: numbers(heard) == [8])


def test_a_bridge_with_rclpy(graph: Graph, ours: Any) -> None:
    from tfdb.bridge import Bridge

    theirs, store = graph.node("theirs", spin=True), tfdb.Buffer(history=None)
    moving: list[bytes] = []
    fixed: list[bytes] = []
    theirs.create_subscription(TFMessage, "/tf", moving.append, 100, raw=True)
    theirs.create_subscription(TFMessage, "/tf_static", fixed.append, LATCHED, raw=True)
    at_tf = theirs.create_publisher(TFMessage, "/tf", 100)
    at_static = theirs.create_publisher(TFMessage, "/tf_static", LATCHED)
    at_static.publish(hearing.message(1, child="theirs_fixed"))

    def of(heard: list[bytes], child: str) -> list[int]:
        found = [each for each in heard if tfdb.decode_tf_message(each)[0].child == child]
        return numbers(found)

    def store_ours(number: int) -> None:
        store.ingest(hearing.message(number, child="ours", stamp=number))

    store.ingest(hearing.message(2, child="ours_fixed"), static=True)
    with Bridge(store, ours) as bridge:
        until(lambda: of(fixed, "theirs_fixed") == [1] and of(fixed, "ours_fixed") == [2])
        assert store.lookup_transform("map", "theirs_fixed", None, timeout=LIMIT).translation[0]
        assert bridge.stats.received == 1
        begun = iter(range(1, 1000))
        until(lambda: bool(of(moving, "ours")), meanwhile=lambda: store_ours(next(begun)))
        until(
            lambda: bridge.stats.received > 1,
            meanwhile=lambda: at_tf.publish(hearing.message(0, child="theirs")),
        )
        for number in range(1000, 1000 + COUNT):
            at_tf.publish(hearing.message(number, child="theirs", stamp=number))
            store_ours(number)
        store.lookup_transform("map", "theirs", 999 + COUNT, timeout=LIMIT)
        until(lambda: of(moving, "ours")[-1] == 999 + COUNT)
        for child in ("theirs", "ours"):
            found = of(moving, child)
            assert found[found.index(1000) :] == [*range(1000, 1000 + COUNT)]
        # The store has each received message once: one commit per message.
        written = bridge.stats.sent + 1
        assert store.commit == written + bridge.stats.received
        assert len(of(fixed, "theirs_fixed")) == len(of(fixed, "ours_fixed")) == 1


def test_simulated_time_from_rclpy(graph: Graph) -> None:
    from rosgraph_msgs.msg import Clock

    from tfdb.ros import DdsNode

    publisher = graph.node("theirs").create_publisher(Clock, "/clock", 1)
    sent = Clock()
    sent.clock.sec, sent.clock.nanosec = 12, 5
    with DdsNode("ours", arguments=["--ros-args", "-p", "use_sim_time:=true"]) as ours:
        until(lambda: ours.now() > 0, meanwhile=lambda: publisher.publish(sent))
        assert ours.now() == 12 * hearing.S + 5


def test_rclpy_shows_the_node_and_its_endpoints(graph: Graph) -> None:
    from tfdb.ros import DdsNode

    theirs = graph.node("theirs", spin=True)
    arguments = ["--ros-args", "-r", "__ns:=/robot"]
    shown = [("/tf", ["tf2_msgs/msg/TFMessage"])]

    def topics(role: str, name: str = "ours") -> list[tuple[str, list[str]]]:
        try:
            asked = getattr(theirs, f"get_{role}_names_and_types_by_node")
            return list(asked(name, "/robot"))
        except NodeNameNonExistentError:
            return []

    with DdsNode("ours", arguments=arguments) as ours, DdsNode("idle", arguments=arguments):
        publisher = ours.advertise("/tf", TF)
        subscription = ours.subscribe("/tf", TF, hearing.Heard())
        nodes = {("ours", "/robot"), ("idle", "/robot"), ("theirs", "/")}
        until(lambda: nodes <= set(theirs.get_node_names_and_namespaces()))
        until(lambda: topics("publisher") == topics("subscriber") == shown)
        (info,) = theirs.get_publishers_info_by_topic("/tf")
        assert (info.node_name, info.node_namespace) == ("ours", "/robot")
        publisher.close()
        until(lambda: topics("publisher") == [] and topics("subscriber") == shown)
        subscription.close()
        until(lambda: topics("subscriber") == [])
        assert topics("publisher", "idle") == []
    until(lambda: not nodes & {*theirs.get_node_names_and_namespaces()} - {("theirs", "/")})


def test_rclpy_shows_the_type_hash(graph: Graph, ours: Any) -> None:
    from tfdb.ros.ros2_names import kind_of

    ours.advertise("/tf", TF)
    node = graph.node("theirs", spin=True)
    until(lambda: bool(node.get_publishers_info_by_topic("/tf")))
    (info,) = node.get_publishers_info_by_topic("/tf")
    assert bytes(info.topic_type_hash.value).hex() == kind_of(TF).hash.removeprefix("RIHS01_")

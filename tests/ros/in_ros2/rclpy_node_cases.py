"""RclpyNode against rclpy: receiving, sending, services, and its end."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from builtin_interfaces.msg import Time
from rclpy.exceptions import InvalidTopicNameException
from rclpy.executors import MultiThreadedExecutor
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from tf2_msgs.msg import TFMessage
from tf2_msgs.srv import FrameGraph

import tfdb
from ros.in_ros2.graph import TF, Heard, as_bytes, connected, message, numbers, until

if TYPE_CHECKING:
    from ros.in_ros2.graph import Graph

CHILD = Path(__file__).with_name("publishing_child.py")
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)

both_ways = pytest.mark.parametrize("own_thread", [True, False], ids=["own thread", "executor"])


@both_ways
def test_messages_come_in_order_as_rclpy_sent_them(graph: Graph, own_thread: bool) -> None:
    node = graph.node("listener", spin=True)
    heard = Heard()
    graph.ours(node, own_thread=own_thread).subscribe("/tf", TF, heard, depth=1000)
    publisher = graph.node("robot").create_publisher(TFMessage, "/tf", 1000)
    connected(publisher)
    for number in range(500):
        publisher.publish(message(number, frames=3))
    heard.until(lambda it: len(it.messages) == 500)
    assert numbers(heard.messages) == list(range(500))
    assert deserialize_message(heard.messages[7], TFMessage) == message(7, frames=3)
    threads = set(heard.threads)
    # With a receiving thread, the spinning executor receives none of the messages.
    assert threads == ({"tfdb listener"} if own_thread else {"spinner"})


@both_ways
def test_other_executors(graph: Graph, own_thread: bool) -> None:
    publisher = graph.node("robot").create_publisher(TFMessage, "/tf", 100)
    for executor in (
        EventsExecutor(context=graph.context),
        MultiThreadedExecutor(4, context=graph.context),
    ):
        node = graph.node("listener")
        executor.add_node(node)
        heard = Heard()
        opened = graph.ours(node, own_thread=own_thread).subscribe("/tf", TF, heard)
        connected(publisher)
        for number in range(50):
            publisher.publish(message(number))
        until(
            lambda heard=heard: len(heard.messages) == 50,
            meanwhile=lambda executor=executor: executor.spin_once(timeout_sec=0.001),
        )
        assert numbers(heard.messages) == list(range(50))
        opened.close()
        until(
            lambda: publisher.get_subscription_count() == 0,
            meanwhile=lambda executor=executor: executor.spin_once(timeout_sec=0.001),
        )
        executor.remove_node(node)
        executor.shutdown()


def test_ours_come_to_rclpy(graph: Graph) -> None:
    came: list[Any] = []
    listener = graph.node("listener", spin=True)
    listener.create_subscription(TFMessage, "/tf", came.append, 100)
    ours = graph.ours(graph.node("ours"), own_thread=True)
    publisher = ours.advertise("/tf", TF)
    until(lambda: listener.count_publishers("/tf") == 1)
    sent = [tfdb.TransformStamped("odom", "base", 5 * 10**9, (1, 2, 3), (0, 0, 0.6, 0.8))]
    until(lambda: bool(came), meanwhile=lambda: publisher.publish(tfdb.encode_tf_message(sent)))
    (transform,) = came[0].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("odom", "base")
    assert transform.header.stamp == Time(sec=5)
    assert (transform.transform.translation.y, transform.transform.rotation.w) == (2.0, 0.8)


@both_ways
def test_a_late_joiner_gets_the_message_of_each_latched_publisher(
    graph: Graph, own_thread: bool
) -> None:
    ours = graph.ours(graph.node("ours"), own_thread=True)
    ours.advertise("/tf_static", TF, latched=True, depth=1).publish(as_bytes(1, frames=20))
    theirs = graph.node("theirs").create_publisher(TFMessage, "/tf_static", LATCHED)
    theirs.publish(message(2, frames=10))
    heard = Heard()
    late = graph.ours(graph.node("late", spin=True), own_thread=own_thread)
    late.subscribe("/tf_static", TF, heard, latched=True)
    heard.until(lambda it: len(it.messages) == 2)
    assert sorted(numbers(heard.messages)) == [1, 2]


def test_quality_of_service_is_tf2s_or_the_one_given(graph: Graph) -> None:
    node = graph.node("ours")
    ours = graph.ours(node, own_thread=True)
    ours.subscribe("/tf", TF, Heard())
    ours.subscribe("/tf_static", TF, Heard(), latched=True)
    given = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
    ours.subscribe("/mine", TF, Heard(), qos=given)
    ours.advertise("/other", TF, qos=given)

    def found(topic: str) -> Any:
        (info,) = node.get_subscriptions_info_by_topic(topic)
        return info.qos_profile

    until(lambda: all(map(node.count_subscribers, ["/tf", "/tf_static", "/mine"])))
    assert found("/tf").reliability == ReliabilityPolicy.RELIABLE
    assert found("/tf").durability == DurabilityPolicy.VOLATILE
    assert found("/tf_static").reliability == ReliabilityPolicy.RELIABLE
    assert found("/tf_static").durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert found("/mine").reliability == ReliabilityPolicy.BEST_EFFORT
    until(lambda: node.count_publishers("/other") == 1)
    (info,) = node.get_publishers_info_by_topic("/other")
    assert info.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT


@both_ways
def test_a_publisher_that_cannot_be_heard_is_warned_of(
    graph: Graph, own_thread: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    ours = graph.ours(graph.node("ours", spin=True), own_thread=own_thread)
    heard = Heard()
    ours.subscribe("/tf_static", TF, heard, latched=True)
    volatile = graph.node("mistaken").create_publisher(TFMessage, "/tf_static", 10)
    said: list[str] = []

    def is_said() -> bool:
        said.append(capfd.readouterr().err)
        return "topic '/tf_static', offering incompatible QoS" in "".join(said)

    until(is_said)
    assert "[ours]" in "".join(said)
    assert "Last incompatible policy: DURABILITY" in "".join(said)
    volatile.publish(message(1))
    assert not heard.messages


@both_ways
def test_names_are_resolved_and_remapped(graph: Graph, own_thread: bool) -> None:
    arguments = ["--ros-args", "-r", "/tf:=mine/tf"]
    node = graph.node("ours", spin=True, namespace="/robot1", cli_args=arguments)
    ours = graph.ours(node, own_thread=own_thread)
    assert ours.name == "/robot1/ours"
    heard = Heard()
    ours.subscribe("/tf", TF, heard)
    publisher = graph.node("other").create_publisher(TFMessage, "/robot1/mine/tf", 10)
    connected(publisher)
    publisher.publish(message(3))
    heard.until(lambda it: numbers(it.messages) == [3])


@both_ways
def test_the_publisher_is_named_while_it_is_the_only_one(graph: Graph, own_thread: bool) -> None:
    node = graph.node("ours", spin=True)
    heard = Heard()
    graph.ours(node, own_thread=own_thread).subscribe("/tf", TF, heard)
    first = graph.node("first", namespace="/robot1").create_publisher(TFMessage, "/tf", 10)
    connected(first)
    until(lambda: "/robot1/first" in heard.publishers, meanwhile=lambda: first.publish(message(1)))
    second_node = graph.node("second")
    second = second_node.create_publisher(TFMessage, "/tf", 10)
    connected(second)
    until(lambda: node.count_publishers("/tf") == 2)
    second.publish(message(2))
    heard.until(lambda it: 2 in numbers(it.messages))
    # rclpy does not report which of the two sent the message.
    assert heard.publishers[numbers(heard.messages).index(2)] == ""
    second_node.destroy_publisher(second)
    until(lambda: node.count_publishers("/tf") == 1)
    known = heard.publishers.count("/robot1/first")
    until(
        lambda: heard.publishers.count("/robot1/first") > known,
        meanwhile=lambda: first.publish(message(3)),
    )
    assert set(heard.publishers) == {"", "/robot1/first"}


def test_a_publisher_dies_and_comes_back(graph: Graph) -> None:
    heard = Heard()
    ours = graph.ours(graph.node("ours"), own_thread=True)
    ours.subscribe("/tf", TF, heard)
    for number in (1, 2):
        with subprocess.Popen([sys.executable, CHILD, str(number)]) as child:
            heard.until(lambda it, number=number: number in numbers(it.messages))
            child.send_signal(signal.SIGKILL)


@both_ways
def test_damaged_bytes_are_refused_and_the_next_message_is_stored(
    graph: Graph, own_thread: bool
) -> None:
    whole = as_bytes(1, frames=4)
    store = tfdb.Buffer()
    refused: list[Exception] = []
    stored = threading.Event()

    def on_message(data: bytes | memoryview, publisher: str) -> None:
        try:
            store.ingest(data, authority=publisher)
        except tfdb.errors.CorruptMessage as error:
            refused.append(error)
            raise
        stored.set()

    ours = graph.ours(graph.node("ours", spin=True), own_thread=own_thread)
    ours.subscribe("/tf", TF, on_message)
    hostile = graph.node("hostile").create_publisher(TFMessage, "/tf", 100)
    connected(hostile)
    bad = [whole[:cut] for cut in (5, 9, 40, len(whole) - 1)]
    bad.append(whole[:4] + b"\xff\xff\xff\x7f" + whole[8:])
    for data in bad:
        hostile.publish(data)
    hostile.publish(whole)
    assert stored.wait(20)
    assert len(refused) == len(bad)
    assert store.commit == 1
    assert sorted(store.frames()) == ["base", "frame0", "frame1", "frame2", "frame3"]


@both_ways
def test_a_callback_that_raises_is_logged_and_called_again(
    graph: Graph, own_thread: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    again = threading.Event()
    calls: list[int] = []

    def on_message(data: bytes | memoryview, publisher: str) -> None:
        calls.append(1)
        if len(calls) == 1:
            raise ArithmeticError("the user's mistake")
        again.set()

    ours = graph.ours(graph.node("ours", spin=True), own_thread=own_thread)
    ours.subscribe("/tf", TF, on_message)
    publisher = graph.node("other").create_publisher(TFMessage, "/tf", 10)
    connected(publisher)
    publisher.publish(message(1))
    publisher.publish(message(2))
    assert again.wait(20)
    assert "the user's mistake" in capfd.readouterr().err


def test_unknown_types_and_invalid_names_are_refused(graph: Graph) -> None:
    ours = graph.ours(graph.node("ours"), own_thread=True)
    for kind in ("no_msgs/TFMessage", "tf2_msgs/NoMessage"):
        with pytest.raises(tfdb.InvalidArgument, match=f"the type {kind} is not installed"):
            ours.subscribe("/tf", kind, Heard())
        with pytest.raises(tfdb.InvalidArgument, match=f"the type {kind} is not installed"):
            ours.serve("/frames", kind, lambda _: b"")
    with pytest.raises(InvalidTopicNameException):
        ours.subscribe("/t f", TF, Heard())
    assert not ours.closed


def test_simulated_time(graph: Graph) -> None:
    node = graph.node("ours", spin=True)
    ours = graph.ours(node, own_thread=True)
    times: list[int] = []
    ours.on_clock(times.append)
    assert not ours.simulated
    assert abs(ours.now() - node.get_clock().now().nanoseconds) < 10**10
    node.set_parameters([Parameter("use_sim_time", value=True)])
    assert ours.simulated
    publisher = graph.node("clock").create_publisher(Clock, "/clock", 10)
    # As when a bag is played twice.
    for second in (7, 8, 9, 3, 4):
        stamp = Clock(clock=Time(sec=second, nanosec=5))
        until(
            lambda second=second: ours.now() == second * 10**9 + 5,
            meanwhile=lambda stamp=stamp: publisher.publish(stamp),
        )
    assert [time for time in times if time] == [s * 10**9 + 5 for s in (7, 8, 9, 3, 4)]
    node.set_parameters([Parameter("use_sim_time", value=False)])
    assert not ours.simulated
    before = len(times)
    ours.close()
    assert len(times) == before + 1, "the end is told once"


def test_a_service_in_bytes(graph: Graph) -> None:
    node = graph.node("ours", spin=True)
    ours = graph.ours(node, own_thread=True)
    requests: list[bytes] = []

    def answer(request: bytes) -> bytes:
        requests.append(request)
        if len(requests) == 2:
            raise ArithmeticError("no frames today")
        response: bytes = serialize_message(FrameGraph.Response(frame_yaml="a: 1"))
        return response

    service = ours.serve("~/tf2_frames", "tf2_msgs/FrameGraph", answer)
    client = graph.node("client", spin=True).create_client(FrameGraph, "/ours/tf2_frames")
    assert client.wait_for_service(20)
    assert client.call(FrameGraph.Request()).frame_yaml == "a: 1"
    # An empty request is one byte in CDR, whose value is not defined.
    assert [each[:4] for each in requests] == [b"\x00\x01\x00\x00"]
    assert client.call(FrameGraph.Request()).frame_yaml == ""
    service.close()
    until(lambda: not client.service_is_ready())

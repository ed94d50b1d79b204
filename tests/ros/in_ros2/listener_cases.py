"""Listeners and broadcasters in rclpy, whose parts programs change, end and use directly."""

from __future__ import annotations

import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Any

import pytest
import rclpy.action
import rclpy.time
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy
from rclpy.subscription import Subscription
from tf2_msgs.msg import TFMessage
from tf2_msgs.srv import FrameGraph

from ros.in_ros2.graph import as_bytes, connected, message, until
from tfdb import tf2

if TYPE_CHECKING:
    from ros.in_ros2.graph import Graph

NOW = rclpy.time.Time()
LIMIT = 20.0
both_ways = pytest.mark.parametrize("spin_thread", [True, False], ids=["thread", "executor"])


class Counting(tf2.TransformListener):
    """Counts messages, and renames their frames."""

    def __init__(self, *given: Any, **named: Any) -> None:
        self.heard: list[Any] = []
        super().__init__(*given, **named)

    def callback(self, data: TFMessage) -> None:
        self.heard.append(data)
        data.transforms[0].child_frame_id = "renamed"
        super().callback(data)

    def static_callback(self, data: TFMessage) -> None:
        self.heard.append("static")
        super().static_callback(data)


@both_ways
def test_overridden_callbacks_get_each_message(graph: Graph, spin_thread: bool) -> None:
    buffer = tf2.Buffer()
    node = graph.node("listener", spin=True)
    listener = Counting(buffer, node, spin_thread=spin_thread)
    robot = graph.node("robot")
    publisher = robot.create_publisher(TFMessage, "/tf", 100)
    connected(publisher)
    publisher.publish(as_bytes(7, frames=2)[:-9])
    publisher.publish(message(7, frames=2))
    until(lambda: buffer.can_transform("base", "frame1", NOW))
    assert buffer.can_transform("base", "renamed", NOW)
    assert not buffer.can_transform("base", "frame0", NOW)
    (heard,) = listener.heard
    assert type(heard) is TFMessage
    assert heard.transforms[1] == message(7, frames=2).transforms[1]
    assert sum(listener.corrupt.values()) == 1
    tf2.StaticTransformBroadcaster(robot).sendTransform(message(1, parent="x").transforms)
    until(lambda: buffer.can_transform("x", "frame0", NOW))
    assert listener.heard[1:] == ["static"]
    listener.unregister()


def test_a_listener_that_subscribes_by_itself(graph: Graph) -> None:
    class Own(tf2.TransformListener):
        def __init__(self, buffer: Any, node: Any) -> None:
            self.buffer = buffer
            self.node = node
            self.tf_sub = node.create_subscription(TFMessage, "/tf", self.callback, 10)
            self.tf_static_sub = node.create_subscription(
                TFMessage, "/tf_static", self.static_callback, 10
            )

    buffer = tf2.Buffer()
    node = graph.node("listener", spin=True)
    listener = Own(buffer, node)
    publisher = graph.node("robot").create_publisher(TFMessage, "/tf", 100)
    connected(publisher)
    publisher.publish(message(3))
    until(lambda: buffer.can_transform("base", "frame0", NOW))
    listener.unregister()
    until(lambda: node.count_subscribers("/tf") == node.count_subscribers("/tf_static") == 0)


@both_ways
@pytest.mark.parametrize("executor", ["events", "single"])
def test_subscriptions_are_the_nodes_and_are_destroyed_by_it(
    graph: Graph, spin_thread: bool, executor: str
) -> None:
    node = graph.node("listener", spin=executor == "single")
    if executor == "events":
        from rclpy.experimental import EventsExecutor

        events = EventsExecutor(context=graph.context)
        events.add_node(node)
        graph.at_end.append(events.shutdown)
    buffer = tf2.Buffer()
    listener = tf2.TransformListener(buffer, node, spin_thread=spin_thread)
    assert listener.node is node
    assert type(listener.tf_sub) is Subscription
    assert (listener.tf_sub.topic_name, listener.tf_static_sub.topic_name) == ("/tf", "/tf_static")
    assert listener.tf_static_sub.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert isinstance(listener.group, ReentrantCallbackGroup)
    publisher = graph.node("robot").create_publisher(TFMessage, "/tf", 100)
    connected(publisher)
    spin_once = (lambda: None) if executor == "single" else lambda: events.spin_once(timeout_sec=0)
    until(lambda: listener.tf_sub.get_publisher_count() == 1, meanwhile=spin_once)
    publisher.publish(message(1))
    until(lambda: buffer.can_transform("base", "frame0", NOW), meanwhile=spin_once)
    assert node.destroy_subscription(listener.tf_sub)
    assert not node.destroy_subscription(listener.tf_sub)
    until(lambda: publisher.get_subscription_count() == 0, meanwhile=spin_once)
    assert node.count_subscribers("/tf_static") == 1
    assert node.destroy_subscription(listener.tf_static_sub)
    until(lambda: node.count_subscribers("/tf_static") == 0, meanwhile=spin_once)
    listener.unregister()
    theirs = node.create_subscription(TFMessage, "/tf", print, 10)
    assert node.destroy_subscription(theirs)


def test_spin_thread_spins_the_node_until_its_executor_is_shut_down(graph: Graph) -> None:
    node = graph.node("listener")
    buffer = tf2.Buffer()
    listener = tf2.TransformListener(buffer, node, spin_thread=True)
    assert isinstance(listener.executor, SingleThreadedExecutor)
    called = threading.Event()
    threads: list[Any] = []
    node.create_timer(0.01, lambda: (threads.append(threading.current_thread()), called.set()))
    assert called.wait(LIMIT)
    assert set(threads) == {listener.dedicated_listener_thread}
    publisher = graph.node("robot").create_publisher(TFMessage, "/tf", 100)
    connected(publisher)
    publisher.publish(message(1))
    until(lambda: buffer.can_transform("base", "frame0", NOW))
    assert listener.executor.shutdown()
    listener.dedicated_listener_thread.join(LIMIT)
    assert not listener.dedicated_listener_thread.is_alive()
    # No message arrives any more.
    until(lambda: publisher.get_subscription_count() == 0)
    listener.unregister()
    node.destroy_node()


def test_a_node_that_is_spun_stays_with_its_executor(graph: Graph) -> None:
    node = graph.node("listener", spin=True)
    listener = tf2.TransformListener(tf2.Buffer(), node, spin_thread=True)
    assert node.executor is graph.executor
    listener.unregister()
    listener.dedicated_listener_thread.join(LIMIT)
    assert not listener.dedicated_listener_thread.is_alive()
    assert node.executor is graph.executor


def test_another_executor_takes_the_node_of_spin_thread(graph: Graph) -> None:
    node = graph.node("listener")
    listener = tf2.TransformListener(tf2.Buffer(), node, spin_thread=True)
    other = SingleThreadedExecutor(context=graph.context)
    other.add_node(node)
    assert node.executor is other
    threads: list[Any] = []
    node.create_timer(0.01, lambda: threads.append(threading.current_thread()))
    until(lambda: len(threads) > 3, meanwhile=lambda: other.spin_once(timeout_sec=0.01))
    assert set(threads[1:]) == {threading.current_thread()}
    other.shutdown()
    listener.executor.shutdown()


def test_a_replaced_buffer_gets_later_messages(graph: Graph) -> None:
    first, second = tf2.Buffer(), tf2.Buffer()
    listener = tf2.TransformListener(first, graph.node("listener", spin=True))
    moving = tf2.TransformBroadcaster(graph.node("robot"))
    connected(moving.pub_tf)
    moving.sendTransform(message(1).transforms)
    until(lambda: first.can_transform("base", "frame0", NOW))
    listener.buffer = second
    moving.pub_tf.publish(message(2))
    until(lambda: second.can_transform("base", "frame0", NOW))
    assert first.get_latest_common_time("base", "frame0").nanoseconds == 101 * 10**9
    listener.unregister()


def test_net_message_is_the_latched_message(graph: Graph) -> None:
    static = tf2.StaticTransformBroadcaster(graph.node("robot"))
    assert type(static.net_message) is TFMessage
    static.sendTransform(message(1, frames=2).transforms)
    assert static.net_message == message(1, frames=2)
    static.net_message.transforms.clear()
    static.sendTransform(message(2).transforms)
    assert static.net_message == message(2)
    buffer = tf2.Buffer()
    tf2.TransformListener(buffer, graph.node("late", spin=True))
    until(lambda: buffer.can_transform("base", "frame0", NOW))
    assert not buffer._frameExists("frame1")


def test_clients_and_services_are_rclpys(graph: Graph) -> None:
    node = graph.node("program", spin=True)
    buffer = tf2.Buffer(node=node)
    assert buffer.srv.srv_type is FrameGraph
    assert buffer.srv in list(node.services)
    assert node.destroy_service(buffer.srv)
    client = tf2.BufferClient(node, "nowhere", check_frequency=20.0)
    assert client.node is node
    assert client.check_frequency == 20.0
    assert isinstance(client.action_client, rclpy.action.ActionClient)
    assert not client.action_client.wait_for_server(timeout_sec=0.01)
    assert not hasattr(client, "client")
    client.destroy()


WITHOUT_A_NODE = """
import math, sys
from tfdb import tf2
tf2.install()
import rclpy, tf2_ros
from geometry_msgs.msg import TransformStamped

rclpy.init(args=["--ros-args", "-r", "__node:=given", "-r", "/tf:=/moved"])
buffer = tf2_ros.Buffer()
listener = tf2_ros.TransformListener(buffer)
assert listener.node.get_name().startswith("tfdb_"), listener.node.get_name()
assert listener.tf_sub.topic_name == "/moved"
moving = tf2_ros.TransformBroadcaster()
placed = TransformStamped()
placed.header.frame_id, placed.child_frame_id = "map", "base"
placed.transform.translation.x = 1.5
placed.transform.rotation.z, placed.transform.rotation.w = math.sin(0.2), math.cos(0.2)
for second in range(1, 4000):
    placed.header.stamp.sec = second
    moving.sendTransform(placed)
    wait = rclpy.duration.Duration(seconds=0.01)
    if buffer.can_transform("map", "base", rclpy.time.Time(), wait):
        break
found = buffer.lookup_transform("map", "base", rclpy.time.Time())
assert found.transform == placed.transform
service = tf2_ros.Buffer(node=listener.node)
assert service.srv.srv_name == "tf2_frames"
rclpy.shutdown()
rclpy.init()
again = tf2_ros.TransformListener(tf2_ros.Buffer())
assert again.node is not listener.node
assert again.tf_sub.topic_name == "/tf", again.tf_sub.topic_name
print("done", flush=True)
if sys.argv[1] == "shutdown":
    rclpy.shutdown()
"""


@pytest.mark.parametrize("end", ["shutdown", "leave"])
def test_without_a_node_there_is_one_of_its_own(end: str) -> None:
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_A_NODE, end],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stdout) == (0, "done\n"), done.stderr
    assert "Traceback" not in done.stderr


def test_ctrl_c_ends_a_program_with_a_spin_thread() -> None:
    program = """
import rclpy
from tfdb import tf2
tf2.install()
import tf2_ros
rclpy.init()
node = rclpy.create_node("program")
listener = tf2_ros.TransformListener(tf2_ros.Buffer(), node, spin_thread=True)
# A SIGINT while rclpy makes its executor prints a traceback of rclpy, so it comes later.
spins = node.create_timer(0.01, lambda: (spins.cancel(), print("listening", flush=True)))
try:
    rclpy.spin(node)
except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
    print("interrupted", flush=True)
"""
    with subprocess.Popen(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "listening\n"
        child.send_signal(2)
        out, err = child.communicate(timeout=LIMIT)
    assert (child.returncode, out) == (0, "interrupted\n"), err
    assert "Traceback" not in err

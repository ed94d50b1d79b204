"""tfdb.tf2's listener and broadcasters in nodes of rclpy."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

import pytest
import rclpy.time
from builtin_interfaces.msg import Time
from geometry_msgs.msg import TransformStamped
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock
from tf2_msgs.msg import TFMessage

from ros.in_ros2.graph import Heard, as_bytes, connected, message, until
from tfdb import tf2

if TYPE_CHECKING:
    from ros.in_ros2.graph import Graph

NOW = rclpy.time.Time()
both_ways = pytest.mark.parametrize("spin_thread", [True, False], ids=["thread", "executor"])


def fixed(child: str, x: float) -> TransformStamped:
    """A static transform T[base<-child]."""
    result = TransformStamped()
    result.header.frame_id, result.child_frame_id = "base", child
    result.transform.translation.x = x
    result.transform.rotation.y, result.transform.rotation.w = 0.6, 0.8
    return result


@both_ways
def test_messages_of_rclpy_are_stored(graph: Graph, spin_thread: bool) -> None:
    buffer = tf2.Buffer()
    listener = tf2.TransformListener(
        buffer, graph.node("listener", spin=True), spin_thread=spin_thread
    )
    publisher = graph.node("robot").create_publisher(TFMessage, "/tf", 100)
    connected(publisher)
    publisher.publish(message(1, frames=3))
    assert buffer.can_transform("base", "frame2", NOW, rclpy.time.Duration(seconds=20))
    found = buffer.lookup_transform("base", "frame2", NOW)
    assert isinstance(found, TransformStamped)
    assert found.header.stamp == Time(sec=101, nanosec=2)
    assert found.transform == message(1, frames=3).transforms[2].transform
    listener.unregister()


def test_broadcasters_are_heard_by_rclpy_and_by_late_joiners(graph: Graph) -> None:
    ours = graph.node("ours")
    static = tf2.StaticTransformBroadcaster(ours)
    for number, child in enumerate(["arm", "camera", "arm"]):
        static.sendTransform(fixed(child, float(number)))
    came: list[Any] = []
    late = graph.node("late", spin=True)
    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    late.create_subscription(TFMessage, "/tf_static", came.append, latched)
    until(lambda: bool(came))
    assert came[0].transforms == [fixed("arm", 2.0), fixed("camera", 1.0)]
    buffer = tf2.Buffer()
    tf2.TransformListener(buffer, late, spin_thread=True)
    until(lambda: buffer.can_transform("arm", "camera", NOW))
    moving = tf2.TransformBroadcaster(ours)
    sent = [message(5, frames=2).transforms[1], fixed("tool", 3.0)]
    until(
        lambda: all(buffer.can_transform("arm", each, NOW) for each in ("frame1", "tool")),
        meanwhile=lambda: moving.sendTransform(sent),
    )


@both_ways
def test_a_bag_that_starts_again_clears_the_buffer(graph: Graph, spin_thread: bool) -> None:
    node = graph.node("listener", spin=True)
    node.set_parameters([Parameter("use_sim_time", value=True)])
    buffer = tf2.Buffer(node=node)
    tf2.TransformListener(buffer, node, spin_thread=spin_thread)
    player = graph.node("player")
    clock = player.create_publisher(Clock, "/clock", 10)
    publisher = player.create_publisher(TFMessage, "/tf", 10)
    connected(publisher)
    connected(clock)
    for _ in range(3):
        for second in (2, 3, 4):
            clock.publish(Clock(clock=Time(sec=100 + second)))
            until(
                lambda second=second: node.get_clock().now().nanoseconds == (100 + second) * 10**9
            )
            publisher.publish(message(second))
            stamp = rclpy.time.Time(seconds=100 + second)
            until(lambda stamp=stamp: buffer.can_transform("base", "frame0", stamp))
        # No data of the previous round remains.
        assert not buffer.can_transform("base", "frame0", rclpy.time.Time(seconds=105))
        assert buffer.get_latest_common_time("base", "frame0").nanoseconds == 104 * 10**9


def test_a_timeout_is_wall_time_while_simulated_time_stands_still(graph: Graph) -> None:
    node = graph.node("listener", spin=True)
    node.set_parameters([Parameter("use_sim_time", value=True)])
    buffer = tf2.Buffer(node=node)
    tf2.TransformListener(buffer, node)
    assert node.get_clock().now().nanoseconds == 0
    limit = rclpy.time.Duration(nanoseconds=1_000_000)
    with pytest.raises(tf2.LookupException):
        buffer.lookup_transform("base", "frame0", NOW, limit)
    assert not buffer.can_transform_full("base", NOW, "frame0", NOW, "base", limit)
    client = tf2.BufferClient(node, "no_server", timeout_padding=limit)
    with pytest.raises(tf2.TimeoutException):
        client.lookup_transform("base", "frame0", NOW)
    client.destroy()


@both_ways
def test_damaged_messages_are_counted_and_logged_once(
    graph: Graph, spin_thread: bool, caplog: pytest.LogCaptureFixture
) -> None:
    buffer = tf2.Buffer()
    listener = tf2.TransformListener(
        buffer, graph.node("listener", spin=True), spin_thread=spin_thread
    )
    hostile = graph.node("hostile").create_publisher(TFMessage, "/tf", 100)
    connected(hostile)
    whole = as_bytes(1, frames=2)
    with caplog.at_level(logging.WARNING, logger="tfdb.tf2"):
        for cut in (0, 3, 9, 50):
            hostile.publish(whole[: len(whole) - 1 - cut])
        hostile.publish(whole)
        until(lambda: buffer.can_transform("frame0", "base", NOW))
    assert sum(listener.corrupt.values()) == 4
    names = [record.args[0] for record in caplog.records]
    assert len(names) == len(set(names))


@both_ways
def test_unregister_leaves_the_node(graph: Graph, spin_thread: bool) -> None:
    node = graph.node("listener", spin=True)
    listener = tf2.TransformListener(tf2.Buffer(), node, spin_thread=spin_thread)
    until(lambda: node.count_subscribers("/tf") == node.count_subscribers("/tf_static") == 1)
    listener.unregister()
    until(lambda: node.count_subscribers("/tf") == node.count_subscribers("/tf_static") == 0)
    heard = Heard()
    graph.ours(node, own_thread=True).subscribe("/tf", "tf2_msgs/TFMessage", heard)
    until(lambda: node.count_subscribers("/tf") == 1)


def test_the_order_of_arguments_is_ros_2s(graph: Graph) -> None:
    node = graph.node("ours")
    quality = QoSProfile(depth=7)
    listener = tf2.TransformListener(
        tf2.Buffer(node=node),
        node,
        spin_thread=False,
        qos=quality,
        static_qos=quality,
        tf_topic="/other",
        tf_static_topic="/other_static",
    )
    until(lambda: node.count_subscribers("/other") == node.count_subscribers("/other_static") == 1)
    (info,) = node.get_subscriptions_info_by_topic("/other_static")
    assert info.qos_profile.durability == DurabilityPolicy.VOLATILE
    listener.unregister()

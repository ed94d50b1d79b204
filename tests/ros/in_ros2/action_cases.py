"""BufferServer and BufferClient in nodes of rclpy, each against rclpy's own and each other."""

from __future__ import annotations

import gc
import threading
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import pytest
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import TransformStamped
from rclpy.action import ActionClient, ActionServer, GoalResponse
from rclpy.duration import Duration
from rclpy.time import Time
from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TF2Error

from ros.in_ros2.graph import message, until
from tfdb import tf2
from tfdb.tf2 import buffer_client

if TYPE_CHECKING:
    from collections.abc import Callable

    from ros.in_ros2.graph import Graph

NAME = "tf2_buffer_server"


@pytest.fixture
def buffer() -> tf2.Buffer:
    """T[base<-frame0] from 101 s to 103 s."""
    made = tf2.Buffer()
    for number in (1, 2, 3):
        for each in message(number).transforms:
            made.set_transform(each, "test")
    return made


def ask(graph: Graph, **fields: Any) -> Any:
    """Return the answer of a server to rclpy's own client."""
    client = ActionClient(graph.node("asking", spin=True), LookupTransform, NAME)
    assert client.wait_for_server(20)
    return client.send_goal(LookupTransform.Goal(**fields))


def test_rclpys_client_gets_our_answers(
    graph: Graph, buffer: tf2.Buffer, capfd: pytest.CaptureFixture[str]
) -> None:
    node = graph.node("serving", spin=True)
    with tf2.BufferServer(buffer, NAME, node=node):
        found = ask(graph, target_frame="frame0", source_frame="base")
        assert found.status == GoalStatus.STATUS_SUCCEEDED
        assert found.result.error.error == TF2Error.NO_ERROR
        assert found.result.transform == buffer.lookup_transform("frame0", "base", Time())
        missing = ask(graph, target_frame="nowhere", source_frame="base")
        # Not aborted: tf2's clients interpret that as an empty transform.
        assert missing.status == GoalStatus.STATUS_SUCCEEDED
        assert missing.result.error.error == TF2Error.LOOKUP_ERROR
        with pytest.raises(tf2.LookupException) as caught:
            buffer.lookup_transform("nowhere", "base", Time())
        assert missing.result.error.error_string == str(caught.value)
        late = Duration(nanoseconds=50_000_000).to_msg()
        when = Time(seconds=150).to_msg()
        asked = {"target_frame": "base", "source_frame": "frame0", "source_time": when}
        timed_out = ask(graph, **asked, timeout=late)
        assert timed_out.status == GoalStatus.STATUS_SUCCEEDED
        assert timed_out.result.error.error == TF2Error.EXTRAPOLATION_ERROR
        assert "into the future" in timed_out.result.error.error_string
    gc.collect()  # rclpy reports errors of futures when they are deleted
    assert "never retrieved" not in capfd.readouterr().err
    until(lambda: not [name for name, _ in services_of(node) if NAME in name])


def services_of(node: Any) -> Any:
    """Return the services of a node in the graph."""
    return node.get_service_names_and_types_by_node("serving", "/")


def test_a_goal_waits_for_the_commit_that_answers_it(graph: Graph, buffer: tf2.Buffer) -> None:
    tf2.BufferServer(buffer, NAME, node=graph.node("serving", spin=True))
    client = tf2.BufferClient(graph.node("asking", spin=True), NAME)
    assert client.wait_for_server(Duration(seconds=20))
    with ThreadPoolExecutor(8) as several:
        answers = [
            several.submit(
                client.lookup_transform,
                "base",
                "frame0",
                Time(seconds=100 + number),
                Duration(seconds=20),
            )
            for number in (4, 5, 6, 7)
        ]
        assert not any(each.done() for each in answers)
        for number in (4, 5, 6, 7):
            buffer.set_transform(message(number).transforms[0], "test")
        for number, each in zip((4, 5, 6, 7), answers, strict=True):
            assert each.result(20) == message(number).transforms[0]
    client.destroy()


def test_a_destroyed_client_ends_its_lookups(graph: Graph, buffer: tf2.Buffer) -> None:
    with tf2.BufferServer(buffer, NAME, node=graph.node("serving", spin=True)):
        client = tf2.BufferClient(graph.node("asking", spin=True), NAME)
        assert client.wait_for_server(Duration(seconds=20))
        asked = ("base", "frame0", Time(seconds=150), Duration(seconds=300))
        with ThreadPoolExecutor() as other:
            waiting = other.submit(client.lookup_transform, *asked)
            until(lambda: len(client._transport._sent) > 0)
            client.destroy()
            for ended in (waiting.result, lambda: client.lookup_transform(*asked)):
                with pytest.raises(tf2.TransformException, match="BufferClient is destroyed"):
                    ended()
        assert not client.wait_for_server()


def test_our_client_asks_as_tf2s(graph: Graph, buffer: tf2.Buffer) -> None:
    server = tf2.BufferServer(buffer, NAME, node=graph.node("serving", spin=True))
    client = tf2.BufferClient(graph.node("asking", spin=True), NAME, 20.0, Duration(seconds=10))
    assert client.wait_for_server()
    full = ("base", Time(seconds=103), "base", Time(seconds=101), "frame0")
    assert client.lookup_transform_full(*full) == buffer.lookup_transform_full(*full)
    assert client.can_transform("base", "frame0", Time(seconds=102))
    for asked in (
        ("base", "nowhere", Time()),
        ("base", "frame0", Time(seconds=9)),
        ("", "a", Time()),
    ):
        with pytest.raises(tf2.TransformException) as theirs:
            buffer.lookup_transform(*asked)
        with pytest.raises(tf2.TransformException) as ours:
            client.lookup_transform(*asked)
        assert str(ours.value) == str(theirs.value)
        assert isinstance(theirs.value, type(ours.value))
        assert client.can_transform(*asked, return_debug_tuple=True) == (False, str(theirs.value))
    server.close()
    client.destroy()


def test_a_goal_is_cancelled(graph: Graph, buffer: tf2.Buffer) -> None:
    server = tf2.BufferServer(buffer, NAME, node=graph.node("serving", spin=True))
    client = ActionClient(graph.node("asking", spin=True), LookupTransform, NAME)
    assert client.wait_for_server(20)
    forever = Duration(seconds=1000).to_msg()
    goal = LookupTransform.Goal(target_frame="base", source_frame="never", timeout=forever)
    accepted = threading.Event()
    sent = client.send_goal_async(goal)
    sent.add_done_callback(lambda _: accepted.set())
    assert accepted.wait(20)
    until(lambda: bool(server._waiting))
    assert len(sent.result().cancel_goal().goals_canceling) == 1
    ended = sent.result().get_result()
    assert ended.status == GoalStatus.STATUS_CANCELED
    assert ended.result.error.error == TF2Error.TIMEOUT_ERROR
    assert not server._waiting


def serve(graph: Graph, execute: Callable[[Any], Any], **more: Any) -> None:
    """Start a server of another node."""
    node = graph.node("other_server", spin=True)
    server = ActionServer(node, LookupTransform, NAME, execute, **more)
    graph.at_end.append(server.destroy)


def test_an_aborted_goal_raises(graph: Graph) -> None:
    def execute(goal: Any) -> Any:
        # As tf2's server does after the timeout.
        goal.abort()
        return LookupTransform.Result()

    serve(graph, execute)
    client = tf2.BufferClient(graph.node("asking", spin=True), NAME)
    with pytest.raises(tf2.TimeoutException, match="did not come back with SUCCEEDED status"):
        client.lookup_transform("base", "frame0", Time())
    assert not client.can_transform("base", "frame0", Time())


def test_an_aborted_goal_with_an_error_is_that_error(graph: Graph) -> None:
    def execute(goal: Any) -> Any:
        goal.abort()
        error = TF2Error(error=TF2Error.CONNECTIVITY_ERROR, error_string="two trees")
        return LookupTransform.Result(error=error, transform=TransformStamped())

    serve(graph, execute)
    client = tf2.BufferClient(graph.node("asking", spin=True), NAME)
    with pytest.raises(tf2.ConnectivityException, match=r"^two trees$"):
        client.lookup_transform("base", "frame0", Time())


def test_a_server_that_rejects_and_none_at_all(graph: Graph) -> None:
    asking = graph.node("asking", spin=True)
    client = tf2.BufferClient(asking, "nobody", timeout_padding=Duration(nanoseconds=10**7))
    with pytest.raises(tf2.TimeoutException, match=r"^The BufferServer is not ready\.$"):
        client.lookup_transform("base", "frame0", Time())
    serve(graph, lambda goal: None, goal_callback=lambda _: GoalResponse.REJECT)
    client = tf2.BufferClient(asking, NAME)
    with pytest.raises(tf2.TimeoutException, match="did not come back with accepted status"):
        client.lookup_transform("base", "frame0", Time())


def test_a_silent_server(graph: Graph) -> None:
    go_on = threading.Event()

    def execute(goal: Any) -> Any:
        go_on.wait(20)
        goal.succeed()
        return LookupTransform.Result()

    other = type(graph)(type(graph.context)())
    serve(other, execute)
    asking = graph.node("asking", spin=True)
    client = tf2.BufferClient(asking, NAME, timeout_padding=Duration(nanoseconds=300_000_000))
    assert client.wait_for_server()
    with pytest.raises(tf2.TimeoutException) as caught:
        client.lookup_transform("base", "frame0", Time())
    assert str(caught.value) == buffer_client.LATE
    go_on.set()
    other.end()

"""BufferServer and BufferClient against Debian's, in both directions."""

from __future__ import annotations

import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from ros.messages import clock, transforms
from ros.real_ros1 import SECONDS, RospyChild, environment, until
from ros.test_rospy_node import SCRIPT
from tfdb import tf2
from tfdb.ros.tcpros_node import TcprosNode
from tfdb.tf2 import msgs
from tfdb.tf2.lookup_action import LookupGoal, LookupResult, code_of, exception_of
from tfdb.tf2.ros1_messages import (
    GoalId,
    Status,
    decode_goal,
    decode_goal_id,
    decode_result,
    encode_goal,
    encode_goal_id,
    encode_result,
    encode_status_list,
)

if TYPE_CHECKING:
    from collections.abc import Iterator

S = 1_000_000_000
SERVER = "our_buffer_server"
POSES = transforms(*(("map", "base", second * S, float(second)) for second in range(1, 4)))
ARM = transforms(("base", "arm", 2 * S, 0.5), ("base", "arm", 3 * S + 7, 1.5))


@pytest.fixture
def node(ros1: str) -> Iterator[TcprosNode]:
    with TcprosNode("serving", arguments=[]) as node:
        yield node


@pytest.fixture
def buffer(node: TcprosNode) -> Iterator[tf2.Buffer]:
    with tf2.Buffer(flavor="ros1", debug=False, clock=node) as buffer:
        buffer.buffer.ingest(POSES, encoding="ros1")
        buffer.buffer.ingest(ARM, encoding="ros1")
        yield buffer


def plain(found: Any) -> list[Any]:
    move, turn = found.transform.translation, found.transform.rotation
    pose = [move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w]
    stamp = found.header.stamp
    return [found.header.frame_id, found.child_frame_id, stamp.secs * S + stamp.nsecs, pose]


QUESTIONS: list[tuple[bool, list[Any]]] = [
    (False, ["map", "arm", 2 * S + 500_000_000]),
    (False, ["arm", "map", 0]),
    (False, ["map", "base", 9 * S]),
    (False, ["map", "base", 500_000_000]),
    (False, ["map", "nowhere", 0]),
    (False, ["", "base", 0]),
    (False, ["/map", "base", 0]),
    (True, ["base", 3 * S, "base", S, "map"]),
    (True, ["base", 3 * S, "base", S, "nowhere"]),
]


@pytest.mark.parametrize("in_rospy", [False, True])
def test_debians_client_gets_our_answers(
    node: TcprosNode, buffer: tf2.Buffer, rospy_child: RospyChild, *, in_rospy: bool
) -> None:
    name = f"{SERVER}_{in_rospy}".lower()
    child = None
    if in_rospy:
        child = RospyChild(node._master.uri, "serving_in_rospy", sys.executable, SCRIPT)
        child.call("our_server", name)
        for text in (POSES, ARM):
            child.call("our_transform", name, text.hex())
    else:
        server = tf2.BufferServer(buffer, name, auto_start=False, node=node)
        server.start()
        server.start()
    assert rospy_child.call("client", name, SECONDS)
    for full, question in QUESTIONS:
        find = buffer.lookup_transform_full_core if full else buffer.lookup_transform_core
        try:
            wanted: Any = ["ok", plain(find(*question))]
        except tf2.TransformException as error:
            kind = next(
                each.__name__
                for each in type(error).__mro__
                if each.__name__ in {"LookupException", "ExtrapolationException"}
                or each is tf2.InvalidArgumentException
            )
            wanted = [kind, str(error)]
        assert rospy_child.call("look_up", name, full, question, 0) == wanted, question
    if child is not None:
        child.end()


def test_a_goal_waits_for_its_transform_and_no_longer_than_its_timeout(
    node: TcprosNode, buffer: tf2.Buffer, rospy_child: RospyChild
) -> None:
    with tf2.BufferServer(buffer, SERVER, node=node) as server:
        assert rospy_child.call("client", SERVER, SECONDS)
        for full, question in (
            (False, ["map", "base", 5 * S]),
            (True, ["base", 5 * S + 1, "base", S, "map"]),
        ):
            rospy_child.ask("look_up", SERVER, full, question, SECONDS)
            until(lambda: server._waiting, "a goal that waits")
            buffer.buffer.ingest(
                transforms(("map", "base", question[2 - full] + full, 7.0)), encoding="ros1"
            )
            word, found = rospy_child.answer()
            assert word == "ok"
            assert found[:2] == (question[:3:2] if full else question[:2])
        word, text = rospy_child.call("look_up", SERVER, False, ["map", "base", 99 * S], 0.05)
        assert word == "ExtrapolationException"
        assert "into the future" in text
        assert not server._waiting


def test_actionlib_sees_goals_as_active_and_cancels_them(
    node: TcprosNode, buffer: tf2.Buffer, rospy_child: RospyChild
) -> None:
    with tf2.BufferServer(buffer, SERVER, node=node) as server:
        assert rospy_child.call("client", SERVER, SECONDS)
        rospy_child.call("begin_goal", SERVER, "map", "never", SECONDS)
        assert rospy_child.call("wait_active", SERVER, SECONDS) == 1
        assert rospy_child.call("cancel_goal", SERVER, SECONDS) == 2
        assert not server._waiting
        assert rospy_child.call("look_up", SERVER, False, ["map", "base", S], 0)[0] == "ok"


@pytest.fixture(scope="module")
def debians_server(master_uri: str, rospy_child: RospyChild) -> Iterator[str]:
    """Name of Debian's buffer_server, which has the transforms."""
    command = ["/usr/lib/tf2_ros/buffer_server", "__name:=debians"]
    process = subprocess.Popen(
        command,
        env=environment(master_uri),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        rospy_child.call("advertise", "/tf", "tf2_msgs/TFMessage", False, 10)
        assert rospy_child.call("joined", "/tf", 1, SECONDS)
        rospy_child.call("send", "/tf", [POSES.hex(), ARM.hex()])
        yield "/tf2_buffer_server"
    finally:
        process.terminate()
        process.wait(SECONDS)


def test_our_client_gets_debians_answers(
    node: TcprosNode, rospy_child: RospyChild, debians_server: str
) -> None:
    client = tf2.BufferClient(debians_server, node=node)
    assert client.wait_for_server(msgs.Duration(20))
    assert rospy_child.call("client", debians_server, SECONDS)
    # It has the sent transforms.
    client.lookup_transform("map", "arm", 3 * S, msgs.Duration(20))
    for full, question in QUESTIONS:
        word, wanted = rospy_child.call("look_up", debians_server, full, question, 0)
        find = client.lookup_transform_full if full else client.lookup_transform
        can = client.can_transform_full if full else client.can_transform
        if word == "ok":
            found = plain(find(*question))
            assert found[:3] == wanted[:3]
            assert found[3] == pytest.approx(wanted[3], abs=1e-12)
            assert can(*question, return_debug_tuple=True) == (True, "")
        else:
            with pytest.raises(getattr(tf2, word)) as caught:
                find(*question)
            assert str(caught.value) == wanted
            assert can(*question) is False
            assert can(*question, return_debug_tuple=True) == (False, wanted)
    client.destroy()


def test_a_destroyed_client_ends_its_lookups(node: TcprosNode, buffer: tf2.Buffer) -> None:
    ended: list[str] = []
    with tf2.BufferServer(buffer, SERVER, node=node):
        client = tf2.BufferClient(SERVER, node=node)
        assert client.wait_for_server(msgs.Duration(20))

        def look_up() -> None:
            try:
                client.lookup_transform("map", "arm", 9 * S, msgs.Duration(300))
            except tf2.TransformException as error:
                ended.append(str(error))

        waiting = threading.Thread(target=look_up)
        waiting.start()
        until(lambda: bool(client._transport._waiting), "a lookup that waits")
        client.destroy()
        waiting.join(SECONDS)
        look_up()
        assert ended == 2 * ["The BufferClient is destroyed: make another."]
        assert not client.wait_for_server()


def test_our_client_in_rospy_and_our_server(node: TcprosNode, buffer: tf2.Buffer) -> None:
    child = RospyChild(node._master.uri, "asking", sys.executable, SCRIPT)
    with tf2.BufferServer(buffer, SERVER, node=node):
        found = child.call("our_look_up", SERVER, ["map", "arm", 0], 0)
        assert found == ["ok", plain(buffer.lookup_transform_core("map", "arm", 0))]
        word, text = child.call("our_look_up", SERVER, ["map", "no", 0], 0.01)
        assert word == "LookupException"
        assert "no" in text
    child.end()


def test_our_client_waits_for_the_transform_in_many_threads(
    node: TcprosNode, buffer: tf2.Buffer
) -> None:
    with tf2.BufferServer(buffer, SERVER, node=node) as server:
        client = tf2.BufferClient(node, SERVER)
        found: list[Any] = []

        def ask(number: int) -> None:
            found.append(client.lookup_transform("map", f"late{number}", 5, msgs.Duration(20)))

        threads = [threading.Thread(target=ask, args=(number,)) for number in range(8)]
        for thread in threads:
            thread.start()
        until(lambda: len(server._waiting) == 8, "all goals")
        edges = [("map", f"late{number}", 5, float(number)) for number in range(8)]
        buffer.buffer.ingest(transforms(*edges), encoding="ros1")
        for thread in threads:
            thread.join(SECONDS)
        assert sorted((each.child_frame_id, each.transform.translation.x) for each in found) == [
            (f"late{number}", float(number)) for number in range(8)
        ]


def test_a_server_that_is_missing_silent_or_gone(node: TcprosNode, buffer: tf2.Buffer) -> None:
    brief = msgs.Duration(0, 20_000_000)
    client = tf2.BufferClient("/none", timeout_padding=brief, node=node)
    assert not client.wait_for_server(brief)
    with pytest.raises(tf2.TimeoutException, match="did not come back in the specified time"):
        client.lookup_transform("map", "base", 0)
    assert client.can_transform("map", "base", 0) is False
    # It accepts the goal and does not answer; then the client's node ends.
    with (
        tf2.BufferServer(buffer, SERVER, node=node) as server,
        TcprosNode("asking_node", arguments=[]) as other,
    ):
        silent = tf2.BufferClient(
            SERVER, timeout_padding=msgs.Duration(-19, 980_000_000), node=other
        )
        assert silent.wait_for_server()
        with pytest.raises(tf2.TimeoutException, match="in the specified time"):
            silent.lookup_transform("map", "never", 0, msgs.Duration(19, 40_000_000))
        until(lambda: not server._waiting, "the goal that nobody waits for to be cancelled")
        patient = tf2.BufferClient(SERVER, node=other)
        assert patient.wait_for_server()
        errors: list[BaseException] = []

        def ask() -> None:
            try:
                patient.lookup_transform("map", "never", 0, msgs.Duration(20))
            except tf2.TimeoutException as error:
                errors.append(error)

        thread = threading.Thread(target=ask)
        thread.start()
        until(lambda: server._waiting, "the goal")
        other.close()
        thread.join(SECONDS)
        assert len(errors) == 1


def test_a_cancelled_goal_and_one_from_before_a_cancellation(
    node: TcprosNode, buffer: tf2.Buffer
) -> None:
    results: list[tuple[Status, LookupResult]] = []
    came = threading.Condition()

    def take(data: bytes | memoryview, _: str) -> None:
        with came:
            results.append(decode_result(data))
            came.notify_all()

    def result() -> tuple[Status, LookupResult]:
        with came:
            assert came.wait_for(lambda: results, SECONDS)
            return results.pop()

    never = LookupGoal("map", "never", 0, 20 * S)
    with tf2.BufferServer(buffer, SERVER, node=node) as server:
        node.subscribe(f"{SERVER}/result", "tf2_msgs/LookupTransformActionResult", take)
        goals: Any = node.advertise(f"{SERVER}/goal", "tf2_msgs/LookupTransformActionGoal")
        cancels: Any = node.advertise(f"{SERVER}/cancel", "actionlib_msgs/GoalID")
        until(lambda: goals.subscribers and cancels.subscribers, "connections")
        until(lambda: server._transport._results.subscribers, "a connection back")
        for wish in (GoalId(0, "a"), GoalId(6, ""), GoalId(0, "")):
            goals.publish(encode_goal(1, GoalId(5, "a"), never))
            goals.publish(encode_goal(1, GoalId(5, "a"), never))
            until(lambda: server._waiting, "the goal")
            assert len(server._waiting) == 1, "it came twice"
            cancels.publish(encode_goal_id(wish))
            status, _ = result()
            assert (status.goal_id, status.status) == (GoalId(5, "a"), 2)
            with server._transport._lock:
                server._transport._goals.clear()
                server._transport._last_cancel = 0
        # Before the goal is known, and after it counts as too old.
        cancels.publish(encode_goal_id(GoalId(0, "later")))
        until(lambda: "later" in server._transport._goals, "the wish")
        goals.publish(encode_goal(1, GoalId(8, "later"), never))
        assert result()[0].status == 8
        cancels.publish(encode_goal_id(GoalId(9, "")))
        until(lambda: server._transport._last_cancel == 9, "the wish")
        goals.publish(encode_goal(1, GoalId(9, "older"), never))
        status, _ = result()
        assert status.status == 8
        assert "before the timestamp of the last cancel" in status.text
        # A goal without id gets one.
        goals.publish(encode_goal(1, GoalId(), LookupGoal("map", "base", S, 0)))
        status, found = result()
        assert status.status == 3
        assert status.goal_id.id.startswith("/serving-")
        assert plain(found.transform)[3][0] == 1.0
        # Invalid messages are ignored.
        goals.publish(b"nonsense")
        goals.publish(encode_goal(1, GoalId(0, "last"), LookupGoal("map", "base", S, -1)))
        assert result()[0].goal_id.id == "last"


def test_goals_wait_by_simulated_time(node: TcprosNode, rospy_child: RospyChild) -> None:
    rospy_child.call("advertise", "/clock", "rosgraph_msgs/Clock", True, 1)
    rospy_child.call("send", "/clock", [clock(100 * S).hex()])
    rospy_child.call("set_parameter", "/use_sim_time", True)
    try:
        simulated = TcprosNode("simulated_server", arguments=[])
    finally:
        rospy_child.call("delete_parameter", "/use_sim_time")
    with simulated:
        until(lambda: simulated.now() == 100 * S, "the time")
        buffer = tf2.Buffer(flavor="ros1", debug=False, clock=simulated)
        with tf2.BufferServer(buffer, "simulated_buffer", node=simulated) as server:
            client = tf2.BufferClient("simulated_buffer", node=node)
            errors: list[str] = []

            def ask() -> None:
                try:
                    client.lookup_transform("map", "base", 0, msgs.Duration(15))
                except tf2.LookupException as error:
                    errors.append(str(error))

            thread = threading.Thread(target=ask)
            thread.start()
            until(lambda: server._waiting, "the goal")
            rospy_child.call("send", "/clock", [clock(114 * S).hex()])
            until(lambda: simulated.now() == 114 * S, "the time")
            assert server._waiting
            rospy_child.call("send", "/clock", [clock(115 * S).hex()])
            thread.join(SECONDS)
            assert len(errors) == 1
    rospy_child.call("withdraw", "/clock")


def test_arguments_of_the_client(node: TcprosNode, caplog: pytest.LogCaptureFixture) -> None:
    padding = msgs.Duration(1)
    for client in (
        tf2.BufferClient("x", 10.0, padding, node=node),
        tf2.BufferClient(node, "x", 10.0, padding),
        tf2.BufferClient(node=node, ns="x", check_frequency=1.0, timeout_padding=padding),
    ):
        assert client.timeout_padding is padding
    assert caplog.text.count("check_frequency is deprecated") == 3
    wrong: list[tuple[tuple[object, ...], dict[str, object], str]] = [
        ((), {}, "ns, the name of the server's action, is missing"),
        (("x", 1, 2, 3), {}, "got 4 arguments by position"),
        (("x",), {"other": 1}, "it has no argument 'other'"),
        (("x",), {"ns": "y"}, "ns is given twice"),
    ]
    for given, named, said in wrong:
        with pytest.raises(TypeError, match=f"BufferClient takes .*: {said}"):
            tf2.BufferClient(*given, node=node, **named)
    with pytest.raises(TypeError, match="ns must be a str, got int"):
        tf2.BufferClient(ns=3, node=node)
    with pytest.raises(TypeError, match=r"node must be of tfdb\.ros or rclpy, or None, got int"):
        tf2.BufferClient(3, "x")
    with pytest.raises(TypeError, match="the first argument is ns, a str, or a node, got 3"):
        tf2.BufferClient(3)
    with pytest.raises(TypeError, match=r"buffer must be a tfdb\.tf2\.Buffer, got 3"):
        tf2.BufferServer(3, "x", node=node)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="ns must be a str, got int"):
        tf2.BufferServer(tf2.Buffer(flavor="ros1"), 3, node=node)  # type: ignore[arg-type]
    nameless = "^ns is the name of an action, such as tf2_buffer_server, got ''$"
    with pytest.raises(tf2.InvalidArgumentException, match=nameless):
        tf2.BufferServer(tf2.Buffer(flavor="ros1"), "", node=node)
    with pytest.raises(tf2.InvalidArgumentException, match=nameless):
        tf2.BufferClient(node, "")
    with pytest.raises(TypeError, match=r"must be a tfdb\.tf2\.Buffer, or have set_transform"):
        tf2.TransformListener(3, node)


def test_a_lookup_that_a_message_cannot_hold(node: TcprosNode) -> None:
    client: Any = tf2.BufferClient("/none", node=node)
    said = r"^time .* cannot be sent: a time of ROS1 has 0 to 4294967295 seconds"
    for stamp in (-1, (1 << 32) * S, msgs.Time(-1), msgs.Time((1 << 32) + 2)):
        with pytest.raises(tf2.InvalidArgumentException, match=said) as caught:
            client.lookup_transform("map", "base", stamp)
        assert caught.value.stamp is not None
        for times in ((stamp, 0), (0, stamp)):
            with pytest.raises(tf2.InvalidArgumentException, match=r"_time .* cannot be sent"):
                client.lookup_transform_full("map", times[0], "base", times[1], "map")
    with pytest.raises(TypeError, match="target_frame must be a str, got int"):
        client.lookup_transform(1, "base", 0)
    with pytest.raises(TypeError, match="source_frame must be a str, got NoneType"):
        client.can_transform("map", None, 0)
    with pytest.raises(TypeError, match="fixed_frame must be a str, got int"):
        client.can_transform_full("map", 0, "base", 0, 3)


def test_messages_come_back_as_they_were() -> None:
    goal = LookupGoal("map", "bäse", 5 * S + 7, -S // 2, 9, "fixed", advanced=True)
    goal_id = GoalId(3 * S + 1, "é")
    data = encode_goal(1, goal_id, goal)
    assert decode_goal(data) == (goal_id, goal)
    assert decode_goal_id(encode_goal_id(goal_id)) == goal_id
    status = Status(goal_id, 3, "text")
    message = msgs.TransformStamped(
        msgs.Header(msgs.Time(1, 2), "map"),
        "base",
        msgs.Transform(msgs.Vector3(1, 2, 3), msgs.Quaternion(0.6, 0, 0, 0.8)),
    )
    result = LookupResult(message, 3, "why")
    found_status, found = decode_result(encode_result(1, status, result))
    assert found_status == status
    assert (plain(found.transform), found.error, found.error_string) == (plain(message), 3, "why")
    assert decode_result(encode_result(1, status, LookupResult()))[1].transform is None
    assert encode_status_list(1, [status, status]).count("é".encode()) == 2
    for end in range(len(data)):
        with pytest.raises(tfdb.errors.CorruptMessage, match="ends within a field"):
            decode_goal(data[:end])


def test_every_code_has_its_exception() -> None:
    for name in ("Lookup", "Connectivity", "Extrapolation", "InvalidArgument", "Timeout"):
        kind = getattr(tf2, f"{name}Exception")
        code = code_of(kind("why"))
        assert 1 <= code <= 5
        made = exception_of(LookupResult(None, code, "why"))
        assert type(made) is kind
        assert str(made) == "why"
    assert code_of(tf2.TransformException("why")) == code_of(tfdb.errors.BufferClosed("why")) == 6
    assert code_of(tf2.ForwardExtrapolationException("why")) == 3
    assert type(exception_of(LookupResult(None, 200, "why"))) is tf2.TransformException

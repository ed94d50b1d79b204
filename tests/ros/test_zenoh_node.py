"""The ZenohNode in graphs of rmw_zenoh, over loopback."""

from __future__ import annotations

import importlib.util
import os
import socket
import threading
import time
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from docs.test_howto import ROOT, blocks
from ros.commands import Command, tfdb_json, tfdb_says
from ros.hearing import LIMIT, TF, Heard, S, message, published_until_heard
from ros.routers import free_endpoint, overriding, router_at
from tfdb import tf2
from tfdb.tf2 import msgs

if TYPE_CHECKING:
    from collections.abc import Iterator

HAS_ZENOH = importlib.util.find_spec("zenoh") and importlib.util.find_spec("xxhash")
pytestmark = pytest.mark.skipif(
    not HAS_ZENOH and "CI" not in os.environ, reason="eclipse-zenoh and xxhash are not installed"
)
KEY = "7/tf/tf2_msgs::msg::dds_::TFMessage_/RIHS01_"
HASH = "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087"


@pytest.fixture
def router(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """A session that is the router for the test."""
    endpoint = free_endpoint()
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", overriding(endpoint))
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    monkeypatch.delenv("ZENOH_SESSION_CONFIG_URI", raising=False)
    with router_at(endpoint) as session:
        yield session


def node(name: str, *arguments: str) -> Any:
    from tfdb.ros import ZenohNode

    return ZenohNode(name, arguments=arguments)


def test_messages_arrive_with_the_name_of_the_node(router: Any) -> None:
    heard = Heard()
    with node("first") as first, node("second", "--ros-args", "-r", "__ns:=/robot") as second:
        first.subscribe("/tf", TF, heard)
        publisher = second.advertise("/tf", TF)
        assert published_until_heard(publisher, heard, message(1)) == (message(1), "/robot/second")
        for number in range(50):
            publisher.publish(message(2 + number))
        found = [heard.next()[0] for _ in range(50)]
        while found[-1] != message(51):
            found.append(heard.next()[0])
        assert found[-50:] == [message(2 + number) for number in range(50)]
        assert first.refused == 0


def test_another_node_of_the_same_name_has_its_gid(router: Any) -> None:
    heard = Heard()
    with node("twin") as ours, node("twin") as theirs:
        ours.subscribe("/tf_static", TF, heard, latched=True)
        theirs.advertise("/tf_static", TF, latched=True, depth=1).publish(message(1))
        data, sender = heard.next()
        assert (data, len(bytes.fromhex(sender))) == (message(1), 16)
        ours.advertise("/tf_static", TF, latched=True, depth=1).publish(message(2))
        assert heard.next() == (message(2), "/twin")


def test_late_joiners_get_latched_messages(router: Any) -> None:
    with node("early") as early, node("late") as late:
        early.advertise("/tf_static", TF, latched=True, depth=1).publish(message(3))
        heard = Heard()
        late.subscribe("/tf_static", TF, heard, latched=True)
        assert heard.next() == (message(3), "/early")


def test_a_latched_subscriber_that_was_first_gets_it_too(router: Any) -> None:
    with node("early") as early, node("late") as late:
        heard = Heard()
        early.subscribe("/tf_static", TF, heard, latched=True)
        late.advertise("/tf_static", TF, latched=True, depth=1).publish(message(4))
        assert heard.next() == (message(4), "/late")


def test_the_drop_in_works(router: Any) -> None:
    with node("listens") as listens, node("sends") as sends:
        buffer = tf2.Buffer(node=listens)
        tf2.TransformListener(buffer, listens)
        header = msgs.Header(frame_id="base")
        moved = msgs.Transform(msgs.Vector3(1.25, 0, 0), msgs.Quaternion(0.6, 0, 0, 0.8))
        sent = msgs.TransformStamped(header, "lidar", moved)
        broadcaster = tf2.StaticTransformBroadcaster(sends)
        broadcaster.sendTransform(sent)
        sent.child_frame_id = "camera"
        broadcaster.sendTransform(sent)
        for child in ("lidar", "camera"):
            found = buffer.lookup_transform("base", child, msgs.Time(), timeout=LIMIT)
            assert found.transform.translation.x == 1.25
        assert buffer.buffer.frame_info("camera").authority == "/sends"
        with pytest.raises(tfdb.errors.NotSupported, match="needs a node of rclpy, not ZenohNode"):
            tf2.BufferServer(buffer, "tf2_buffer_server", node=listens)


def attached(size: int = 16, number: int = 1) -> bytes:
    """A sender without a token."""
    return number.to_bytes(8, "little") + (9).to_bytes(8, "little") + bytes([size]) + b"\x0b" * size


def test_foreign_types_and_layouts_are_refused_and_logged_once(
    router: Any, caplog: pytest.LogCaptureFixture
) -> None:
    heard = Heard()
    with node("listens") as listens:
        listens.subscribe("/tf", TF, heard)
        until = time.monotonic() + LIMIT
        while listens.refused < 3:
            router.put(KEY + "0123", message(1), attachment=attached())
            assert time.monotonic() < until
        while "has 60 bytes" not in caplog.text:
            router.put(KEY + HASH, message(1), attachment=b"\0" * 60)
            assert time.monotonic() < until
        while "has 0 bytes" not in caplog.text:
            router.put(KEY + HASH, message(1))
            assert time.monotonic() < until
        router.put(KEY + HASH, message(2), attachment=attached())
        assert heard.next() == (message(2), "0b" * 16)
        router.put(
            "7/tf/tf2_msgs::msg::dds_::TFMessage_/TypeHashNotSupported",
            message(3),
            attachment=attached(),
        )
        assert heard.next() == (message(3), "0b" * 16)
        assert listens.refused >= 5
    lines = [line for line in caplog.messages if "RIHS01_0123" in line and HASH in line]
    assert len(lines) == 1
    assert "must be updated" in caplog.text


def test_a_damaged_message_is_left_out(router: Any, caplog: pytest.LogCaptureFixture) -> None:
    with node("listens") as listens:
        buffer = tf2.Buffer()
        listener = tf2.TransformListener(buffer, listens)
        until = time.monotonic() + LIMIT
        while not listener.corrupt:
            router.put(KEY + HASH, message(1)[:-9], attachment=attached())
            assert time.monotonic() < until
        router.put(KEY + HASH, message(1), attachment=attached())
        assert (
            buffer.buffer.lookup_transform("map", "base", None, timeout=LIMIT).translation[0] == 1
        )
    assert caplog.text.count("damaged message of " + "0b" * 16) == 1


def test_simulated_time(router: Any) -> None:
    import struct

    with node("sim", "--ros-args", "-p", "use_sim_time:=true") as sim, node("clock") as clock:
        told = Heard()
        sim.on_clock(lambda now: told(b"", str(now)))
        assert (sim.simulated, sim.now()) == (True, 0)
        publisher = clock.advertise("/clock", "rosgraph_msgs/Clock", depth=1)
        data = b"\0\1\0\0" + struct.pack("<iI", 12, 5)
        assert published_until_heard(publisher, told, data)[1] == str(12 * S + 5)
        assert sim.now() == 12 * S + 5


def test_names_and_arguments(router: Any) -> None:
    with node("a", "x", "--ros-args", "-r", "tf:=/robot/tf", "-r", "__node:=b", "--", "y") as made:
        assert made.name == "/b"
        assert made._names.resolve("/tf") == "/robot/tf"
        assert made._names.resolve("~/own") == "/b/own"
        for name in ("", "/", "a//b", "1a", "a/", "~a", "ä"):
            with pytest.raises(tfdb.errors.InvalidName):
                made.advertise(name, TF)
        with pytest.raises(tfdb.InvalidArgument, match="known types are"):
            made.advertise("tf", "std_msgs/String")
        with pytest.raises(tfdb.errors.NotSupported, match="needs a node of rclpy"):
            made.serve("x", "tf2_msgs/FrameGraph", bytes)
    with pytest.raises(tfdb.errors.NodeClosed):
        made.advertise("tf", TF)
    made.close()
    for arguments in (["-r", "bad"], ["--params-file", "x"], ["-r"]):
        with pytest.raises(tfdb.InvalidArgument, match="does not start"):
            node("a", "--ros-args", *arguments)
    with pytest.raises(tfdb.errors.InvalidName, match="not a valid node name"):
        node("a b")


def test_without_a_router(monkeypatch: pytest.MonkeyPatch) -> None:
    from tfdb.ros import ZenohNode

    monkeypatch.delenv("ZENOH_CONFIG_OVERRIDE", raising=False)
    monkeypatch.delenv("ZENOH_SESSION_CONFIG_URI", raising=False)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        with pytest.raises(ConnectionError, match=f"no Zenoh router at {endpoint}"):
            ZenohNode("lonely", router=endpoint, arguments=[])
    with pytest.raises(tfdb.InvalidArgument, match="an endpoint such as"):
        ZenohNode("lonely", router="nowhere", arguments=[])
    with pytest.raises(tfdb.InvalidArgument, match="is not a ROS 2 domain"):
        ZenohNode("lonely", domain=233, arguments=[])


def test_commands(router: Any) -> None:
    with node("theirs") as theirs:
        theirs.advertise("/tf_static", TF, latched=True, depth=1).publish(message(7))
        found = tfdb_json("lookup", "ros2+zenoh:", "map", "base", "--for", "20")
        assert found["translation"][0] == 7
        assert tfdb_json("tree", "ros2+zenoh:8", "--for", "0.1")["roots"] == []
        assert "is not a ROS 2 domain" in tfdb_says("tree", "ros2+zenoh:233", code=2)
        heard = Heard()
        theirs.subscribe("/tf_static", TF, heard, latched=True)
        assert heard.next()[1] == "/theirs"
        flags = ("--x", "1", "--frame-id", "map", "--child-frame-id", "arm", "--node-name", "ours")
        with Command("static-publisher", "ros2+zenoh:", *flags) as publisher:
            assert "as /ours" in publisher.line()
            data, name = heard.next()
            assert (name, tfdb.decode_tf_message(data, "cdr")[0].child) == ("/ours", "arm")
            assert publisher.end()[0] == 130


def test_serve_fills_a_store(router: Any, name: str) -> None:
    with node("theirs") as theirs:
        theirs.advertise("/tf_static", TF, latched=True, depth=1).publish(message(7))
        with Command("serve", "ros2", "--rmw", "zenoh", "--into", name) as serving:
            assert f"into shm:{name}" in serving.line()
            shared = tfdb.Buffer.open(name, mode="r")
            found = shared.lookup_transform("map", "base", None, timeout=LIMIT)
            assert found.translation[0] == 7
            assert shared.frame_info("base").authority == "/theirs"
            assert serving.end()[0] == 130


def test_rmw_implementation_chooses(router: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_zenoh_cpp")
    with node("theirs") as theirs:
        theirs.advertise("/tf_static", TF, latched=True, depth=1).publish(message(7))
        assert tfdb_json("lookup", "ros2:", "map", "base", "--for", "20")["translation"][0] == 7
    monkeypatch.delenv("RMW_IMPLEMENTATION")
    assert "ros2+zenoh:" in tfdb_says("tree", "ros2:", code=2)


def test_the_page(router: Any, capsys: pytest.CaptureFixture[str]) -> None:
    program, both_ways = blocks(ROOT / "docs/howto/ros2-without-ros.md")
    with node("robot") as robot:
        robot.advertise("/tf_static", TF, latched=True, depth=1).publish(
            message(1.25, child="base_link")
        )
        exec(compile(program, "ros2-without-ros.md", "exec"), {})
        exec(compile(both_ways, "ros2-without-ros.md", "exec"), {})
    shown = capsys.readouterr().out
    assert "x=1.25" in shown
    assert "received=1" in shown


def test_a_failed_subscription_leaves_no_thread(router: Any) -> None:
    import zenoh

    with node("fails") as fails:
        fails._link._session.close()
        with pytest.raises(zenoh.ZError):
            fails.subscribe("/unheard", TF, Heard())
    assert not [each for each in threading.enumerate() if each.name == "tfdb ROS /unheard"]


def test_a_node_closes_although_zenoh_does_not(router: Any) -> None:
    import zenoh

    class Session:
        """A session that does not reach its router."""

        def close(self) -> None:
            raise zenoh.ZError("timeout")

    closes = node("closes")
    session, closes._link._session = closes._link._session, Session()
    closes.close()
    assert closes.closed
    session.close()


def test_tokens_and_gids() -> None:
    from tfdb.ros.zenoh_graph import gid_of
    from tfdb.ros.zenoh_keys import node_of, quality, token

    made = token(
        7, "aa", 3, "MP", "/robot", "base", "/tf", "T", "RIHS01_0", quality(latched=True, depth=1)
    )
    assert made == "@ros2_lv/7/aa/0/3/MP/%/%robot/base/%tf/T/RIHS01_0/:1:,1:,:,:,,"
    assert node_of(made) == node_of(made + "/backends:cpu,cuda") == "/robot/base"
    assert token(0, "aa", 0, "NN", "/", "x") == "@ros2_lv/0/aa/0/0/NN/%/%/x"
    for bad in (
        "",
        "@ros2_lv/7",
        made + "/a/b",
        made.replace("MP", "MS"),
        made.replace("/base", "/%"),
    ):
        with pytest.raises(ValueError, match="token"):
            node_of(bad)
    # The published digest of no bytes is 99aa06d3014798d86001c324468d497f: low half first here.
    assert gid_of("").hex() == "7f498d4624c30160d8984701d306aa99"

"""DdsNodes in graphs over loopback. `in_ros2/dds_cases.py` tests them with the real rclpy."""

from __future__ import annotations

import importlib.util
import os
import platform
import sys
from dataclasses import replace
from typing import Any

import pytest

import tfdb
from ros import ros2
from ros.commands import Command, tfdb_json, tfdb_says
from ros.hearing import LIMIT, TF, Heard, S, message, published_until_heard

HAS_WHEEL = sys.version_info < (3, 14) and (sys.platform, platform.machine()) == ("linux", "x86_64")
pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("cyclonedds") is None and not ("CI" in os.environ and HAS_WHEEL),
    reason="cyclonedds is not installed",
)


@pytest.fixture(autouse=True)
def domain(monkeypatch: pytest.MonkeyPatch) -> int:
    number = ros2.own_domain()
    monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    return number


def node(name: str, *arguments: str) -> Any:
    from tfdb.ros import DdsNode

    return DdsNode(name, arguments=arguments)


def is_gid(text: str) -> bool:
    return len(bytes.fromhex(text)) == 16


def test_messages_arrive_in_their_order() -> None:
    heard = Heard()
    with node("first") as first, node("second") as second:
        first.subscribe("/tf", TF, heard, depth=200)
        publisher = second.advertise("/tf", TF, depth=200)
        data, sender = published_until_heard(publisher, heard, message(1))
        assert data == message(1)
        assert is_gid(sender)
        for number in range(50):
            publisher.publish(message(2 + number))
        found = [heard.next()]
        while found[-1][0] != message(51):
            found.append(heard.next())
        assert found[-50:] == [(message(2 + number), sender) for number in range(50)]
        assert first.refused == 0


def test_own_messages_have_the_name_of_the_node() -> None:
    heard = Heard()
    with node("alone") as alone:
        alone.subscribe("/tf", TF, heard)
        publisher = alone.advertise("/tf", TF)
        assert published_until_heard(publisher, heard, message(1)) == (message(1), "/alone")


@pytest.mark.parametrize("first", ["publisher", "subscriber"])
def test_latched_messages_arrive_in_either_order(first: str) -> None:
    heard = Heard()
    with node("sends") as sends, node("hears") as hears:

        def publish() -> None:
            publisher = sends.advertise("/tf_static", TF, latched=True, depth=1)
            publisher.publish(message(2))
            publisher.publish(message(3))

        if first == "publisher":
            publish()
        hears.subscribe("/tf_static", TF, heard, latched=True)
        if first == "subscriber":
            publish()
        while heard.next()[0] != message(3):
            pass


def test_short_messages_arrive() -> None:
    with node("sim", "--ros-args", "-p", "use_sim_time:=true") as sim, node("clock") as clock:
        told = Heard()
        sim.on_clock(lambda now: told(b"", str(now)))
        publisher = clock.advertise("/clock", "rosgraph_msgs/Clock", depth=1)
        data = b"\0\1\0\0" + (12).to_bytes(4, "little") + (5).to_bytes(4, "little")
        assert published_until_heard(publisher, told, data)[1] == str(12 * S + 5)


def test_a_message_without_transforms_arrives_as_it_was_sent() -> None:
    heard = Heard()
    empty = tfdb.encode_tf_message([])
    with node("hears") as hears, node("sends") as sends:
        hears.subscribe("/tf", TF, heard)
        publisher = sends.advertise("/tf", TF)
        assert published_until_heard(publisher, heard, empty)[0] == empty
        assert tfdb.decode_tf_message(empty) == []


def test_another_type_hash_is_refused_and_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    from tfdb.ros.ros2_names import kind_of
    from tfdb.ros.wire_node import Topic

    kind, heard = kind_of(TF), Heard()
    foreign = Topic("/tf", replace(kind, hash="RIHS01_0123"), latched=True, depth=2)
    with node("listens") as listens, node("foreign") as other:
        sender = other._link.offer(foreign)
        sender.send(message(1))
        sender.send(message(2))
        listens.subscribe("/tf", TF, heard, latched=True, depth=2)
        publisher = other.advertise("/tf", TF, latched=True)
        publisher.publish(message(3))
        assert heard.next()[0] == message(3)
        sender.send(message(4))
        publisher.publish(message(5))
        assert heard.next()[0] == message(5)
    assert 1 <= listens.refused <= 3
    (line,) = [line for line in caplog.messages if "RIHS01_0123" in line]
    assert kind.hash in line


def test_a_bad_configuration_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CYCLONEDDS_URI", "<CycloneDDS><Nonsense>1</Nonsense></CycloneDDS>")
    with pytest.raises(tfdb.InvalidArgument, match="CYCLONEDDS_URI must be"):
        node("a")


def test_commands(domain: int) -> None:
    with node("theirs") as theirs:
        theirs.advertise("/tf_static", TF, latched=True, depth=1).publish(message(7))
        assert tfdb_json("lookup", "ros2+dds:", "map", "base", "--for", "20")["translation"][0] == 7
        assert "is not a ROS 2 domain" in tfdb_says("tree", "ros2+dds:233", code=2)
        heard = Heard()
        theirs.subscribe("/tf_static", TF, heard, latched=True)
        assert heard.next()[1] == "/theirs"
        flags = ("--x", "1", "--frame-id", "map", "--child-frame-id", "arm", "--node-name", "ours")
        with Command("static-publisher", f"ros2+dds:{domain}", *flags) as publisher:
            assert "as /ours" in publisher.line()
            data, _ = heard.next()
            assert tfdb.decode_tf_message(data, "cdr")[0].child == "arm"
            assert publisher.end()[0] == 130


def test_serve_fills_a_store(name: str) -> None:
    with node("theirs") as theirs:
        theirs.advertise("/tf_static", TF, latched=True, depth=1).publish(message(7))
        with Command("serve", "ros2", "--rmw", "dds", "--into", name) as serving:
            assert f"into shm:{name}" in serving.line()
            shared = tfdb.Buffer.open(name, mode="r")
            found = shared.lookup_transform("map", "base", None, timeout=LIMIT)
            assert found.translation[0] == 7
            assert is_gid(shared.frame_info("base").authority)
            assert serving.end()[0] == 130

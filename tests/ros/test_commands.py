"""Commands on a live ROS 1 graph: a real master, and a publishing rospy program."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import time
import xmlrpc.client
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from websockets.sync.client import connect

import tfdb
from compat.tf2_oracle import unavailable
from ros.commands import Command, tfdb_hears, tfdb_json, tfdb_says
from ros.messages import clock, transforms
from ros.real_ros1 import PYTHON, SECONDS, environment, until

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ros.real_ros1 import RospyChild

S = 1_000_000_000
TF = "tf2_msgs/TFMessage"
STATIC = transforms(("base", "camera", 0, 0.5))


class Robot:
    """Transforms that a rospy program publishes on the graph."""

    def __init__(self, child: RospyChild) -> None:
        self._child = child
        self.joined = 0
        child.call("advertise", "/tf_static", TF, True, 1)
        child.call("advertise", "/tf", TF, False, 100)
        child.call("send", "/tf_static", [STATIC.hex()])

    def moves(self, *stamps: int) -> None:
        """Publish map -> base; `x` is the stamp in seconds."""
        texts = [transforms(("map", "base", stamp, stamp / S)).hex() for stamp in stamps]
        self._child.call("send", "/tf", texts)

    def is_heard(self) -> None:
        """Wait until one more node listens."""
        self.joined += 1
        assert self._child.call("joined", "/tf", self.joined, SECONDS)

    def leave(self) -> None:
        for topic in ("/tf", "/tf_static"):
            self._child.call("withdraw", topic)


@pytest.fixture
def robot(ros1: str, rospy_child: RospyChild) -> Iterator[Robot]:
    made = Robot(rospy_child)
    yield made
    made.leave()


def nodes_of(uri: str) -> set[str]:
    """Return the nodes that the master lists."""
    with xmlrpc.client.ServerProxy(uri) as master:
        _, _, state = master.getSystemState("/test")  # type: ignore[misc]
    return {node for part in state for _, nodes in part for node in nodes}  # type: ignore[union-attr]


def test_commands_that_read_once_listen(ros1: str, robot: Robot) -> None:
    found = tfdb_json("lookup", "ros1:", "base", "/camera", "--for", "20")
    assert found["files"] == ["ros1:"]
    assert found["translation"] == [0.5, 2.0, -3.0]
    (edge,) = tfdb_hears(lambda told: told["edges"], "info", f"ros1:{ros1}")["edges"]
    assert (edge["frame"], edge["static"], edge["authority"]) == ("camera", True, "/theirs")
    assert tfdb_hears(lambda told: told["frames"], "tree", "ros1:")["roots"] == ["base"]
    assert tfdb_hears(lambda told: told["transforms"], "check", "ros1:")["transforms"] == 1
    assert not {node for node in nodes_of(ros1) if "tfdb" in node}


def test_arguments_for_ros(ros1: str, robot: Robot) -> None:
    assert tfdb_json("info", "ros1:", "--for", "0.1", "/tf_static:=/other")["frames"] == 0
    told = tfdb_hears(lambda told: told["roots"], "tree", "/elsewhere:=/tf", "ros1:")
    assert told["roots"] == ["base"]


def test_graphs_that_are_none(ros1: str) -> None:
    assert "no ROS master answers" in tfdb_says("tree", "ros1:http://127.0.0.1:9", code=2)
    assert "is not a ROS URI" in tfdb_says("tree", "ros1:nowhere", code=2)
    assert "is not a valid ROS node name" in tfdb_says(
        "tree", "ros1:", "--node-name", "a/b", code=2
    )
    assert "source the setup.bash" in tfdb_says("tree", "ros2:", code=2)
    assert "cannot be combined with other files" in tfdb_says("tree", "ros1:", "ros2:", code=2)
    assert "--topic is valid for recordings" in tfdb_says(
        "check", "ros1:", "--topic", "/tf", code=2
    )
    assert "reads files only" in tfdb_says("convert", "ros1:", "x.bag", code=2)
    assert "-o OUT.tfdb" in tfdb_says("freeze", "ros1:", code=2)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_serve(ros1: str, robot: Robot, name: str, number: int) -> None:
    with Command("serve", "ros1", "--into", name, "__name:=serving") as serving:
        assert f"ros1: as /serving into shm:{name}" in serving.line()
        robot.is_heard()
        robot.moves(1 * S, 2 * S)
        shared = tfdb.Buffer.open(name, mode="r")
        found = shared.lookup_transform("map", "camera", 2 * S, timeout=SECONDS)
        assert found.report.edges[-1].child == "base"
        assert shared.frame_info("base").authority == "/theirs"
        assert "/serving" in nodes_of(ros1)
        code, said = serving.end(number)
    assert code == 128 + number
    assert "3 commits, 3 frames" in said
    assert "/serving" not in nodes_of(ros1)
    assert tfdb_json("tree", f"shm:{name}")["roots"] == ["map"]


def test_rosnode_kill_ends_serve(ros1: str, robot: Robot, name: str) -> None:
    with Command("serve", "ros1", "--into", name, "--node-name", "serving") as serving:
        serving.line()
        with xmlrpc.client.ServerProxy(ros1) as master:
            _, _, uri = master.lookupNode("/test", "/serving")  # type: ignore[misc]
        with xmlrpc.client.ServerProxy(str(uri)) as node:
            node.shutdown("/test", "because")
        until(lambda: serving.process.poll() is not None, "the end of the command")
        assert serving.process.returncode == 2
        assert serving.process.stderr
        assert "the node /serving was stopped from outside" in serving.process.stderr.read()


def numbers(text: str) -> list[list[float]]:
    """Return the numbers in brackets in each line of echo's output."""
    found = re.findall(r"\[([-\d., ]+)\]", text)
    return [[float(number) for number in each.split(",")] for each in found]


def test_echo_as_debians(ros1: str, robot: Robot) -> None:
    """The order of arguments, the lines and the numbers are the same."""
    arguments = ["camera", "base", "-r", "50", "-p", "6"]
    program = Path("/usr/lib/tf2_tools/echo.py")
    command = [PYTHON, "-u", program, *arguments]
    if not program.exists():
        unavailable(f"no {program}: apt-get install tf2-tools")
    with subprocess.Popen(
        command, env=environment(ros1), stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as theirs:
        ours = tfdb_says("echo", "ros1:", *arguments, "-l", "1")
        told = [theirs.stdout.readline() for _ in range(5)]  # type: ignore[union-attr]
        theirs.kill()
    assert len(numbers(ours)) == 4
    assert np.allclose(np.concatenate(numbers("".join(told))), np.concatenate(numbers(ours)))
    for line, theirs_line in zip(ours.splitlines(), told, strict=False):
        assert re.sub(r"[-\d.]+", "", line) == re.sub(r"[-\d.]+", "", theirs_line.rstrip())
    assert "At time 0.000000000, (current time 1" in ours


def test_monitor_and_echo_of_a_moving_frame(ros1: str, robot: Robot) -> None:
    now = time.time_ns()
    with Command("monitor", "ros1:", "map", "base", "--every", "0.1", "--json") as monitor:
        robot.is_heard()
        with Command("echo", "ros1:", "map", "base", "--each", "--json") as echo:
            robot.is_heard()
            robot.moves(now - 2 * S, now - 1 * S)
            while (echoed := json.loads(echo.line())).get("stamp_ns") != now - 1 * S:
                pass
            assert echoed["age_ns"] > S
            assert echo.end() == (130, "")
        while not (told := json.loads(monitor.line()))["chain"]["frames"]:
            pass
        (base,) = [each for each in told["frames"] if each["frame"] == "base"]
        assert (base["authorities"], base["parent"]) == (["/theirs"], "map")
        assert base["delay_ns"] > S
        assert told["chain"]["delay_ns"] > S
        assert monitor.end(signal.SIGTERM)[0] == 143
    assert not {node for node in nodes_of(ros1) if "tfdb" in node}


def test_ages_by_the_clock_of_the_graph(ros1: str, robot: Robot, rospy_child: RospyChild) -> None:
    rospy_child.call("set_parameter", "/use_sim_time", True)
    rospy_child.call("advertise", "/clock", "rosgraph_msgs/Clock", False, 1)
    try:
        with Command("echo", "ros1:", "map", "base", "-r", "200", "--json") as echo:
            robot.is_heard()
            assert rospy_child.call("joined", "/clock", 1, SECONDS)
            robot.moves(7 * S)
            rospy_child.call("send", "/clock", [clock(10 * S).hex()])
            while json.loads(echo.line()).get("age_ns") != 3 * S:
                pass
            rospy_child.call("send", "/clock", [clock(2 * S).hex()])
            while "error" not in (told := json.loads(echo.line())):
                pass
            assert told["now_ns"] == 2 * S
            echo.process.send_signal(signal.SIGINT)
            assert echo.process.stderr
            assert "jump back in time" in echo.process.stderr.read()
    finally:
        rospy_child.call("withdraw", "/clock")
        rospy_child.call("delete_parameter", "/use_sim_time")


def test_frames_of_a_graph_are_drawn(ros1: str, robot: Robot, tmp_path: Path) -> None:
    path = tmp_path / "frames.dot"
    drawn = ("view-frames", "ros1:", "-o", path, "--overwrite")
    assert tfdb_hears(lambda told: told["frames"], *drawn)["frames"] == 2
    assert '"base" -> "camera" [label="/theirs\\nstatic"' in path.read_text(encoding="utf-8")


def test_a_page_shows_a_graph(ros1: str, robot: Robot) -> None:
    """The page has the frames and their publishers."""
    with Command("view", "ros1:", "--port", "0", "--no-open", "--json") as viewing:
        text = ""
        while not text.endswith("}\n"):
            text += viewing.line()
        address = json.loads(text)["address"].partition("?")[0]
        robot.is_heard()
        robot.moves(2 * S)
        names: set[str] = set()
        facts = ""
        with connect(address.replace("http:", "ws:") + "live", max_size=None) as viewer:
            while names != {"map", "base", "camera"} or "/theirs" not in facts:
                message = viewer.recv(timeout=SECONDS)
                if isinstance(message, str):
                    told = json.loads(message)
                    names = set(told["names"]) if told["type"] == "tree" else names
                    facts = message if told["type"] == "facts" else facts
        assert viewing.end()[0] == 130


def test_static_publisher(ros1: str, rospy_child: RospyChild) -> None:
    """A node that joins later gets the transform."""
    arguments = ("1", "-2", "3", "0.6", "0", "0", "0.8", "map", "base")
    with Command("static-publisher", "ros1:", *arguments, "__name:=ours") as publisher:
        assert "map -> base" in publisher.line()
        rospy_child.call("listen", "/tf_static", TF)
        (heard,), (sender,) = rospy_child.call("heard", "/tf_static", 1, SECONDS)
        (one,) = tfdb.decode_tf_message(bytes.fromhex(heard), "ros1")
        assert (one.parent, one.child, sender) == ("map", "base", "/ours")
        assert tuple(one.translation) == (1, -2, 3)
        assert tuple(one.rotation) == (0.6, 0, 0, 0.8)
        assert one.stamp > S
        assert publisher.end(signal.SIGTERM) == (143, "")
    assert "/ours" not in nodes_of(ros1)


def test_change_notifier(ros1: str, robot: Robot, rospy_child: RospyChild) -> None:
    rospy_child.call("listen", "/tf_changes", TF)
    limits = ("--pair", "map", "camera", "--distance", "1.5", "-r", "1000")
    with Command("change-notifier", "ros1:", *limits, "--json") as notifier:
        robot.is_heard()
        assert rospy_child.call("connected_to", "/tf_changes", SECONDS)
        told = []
        for stamp in (1, 2, 3, 4, 7):
            robot.moves(stamp * S)
            if stamp in {1, 3, 7}:
                told.append(json.loads(notifier.line()))
        assert [each["stamp_ns"] // S for each in told] == [1, 3, 7]
        assert [each["moved_m"] for each in told] == pytest.approx([0, 2, 4])
        heard, senders = rospy_child.call("heard", "/tf_changes", 3, SECONDS)
        notifier.end()
    assert len(heard) == 3
    assert "change_notifier" in senders[0]
    (last,) = tfdb.decode_tf_message(bytes.fromhex(heard[-1]), "ros1")
    assert (last.parent, last.child, last.stamp) == ("map", "camera", 7 * S)
    assert list(last.translation) == told[-1]["translation"]


@pytest.mark.parametrize("shared", [False, True])
def test_buffer_server(
    ros1: str, robot: Robot, rospy_child: RospyChild, name: str, *, shared: bool
) -> None:
    """Debian's BufferClient gets answers from the listener's data, or from a store that others
    fill.
    """
    action = f"server_{shared}".lower()
    options: list[str] = []
    if shared:
        filled = tfdb.Buffer.open(name)
        filled.set_transform("map", "base", 5 * S, (5, 2, -3), (0.6, 0, 0, 0.8))
        options = ["--store", name]
    with Command("buffer-server", "ros1:", "--action", action, *options) as server:
        assert action in server.line()
        assert rospy_child.call("client", action, SECONDS)
        if not shared:
            robot.is_heard()
            robot.moves(5 * S)
        question = ["map", "base", 5 * S]
        kind, found = rospy_child.call("look_up", action, False, question, SECONDS)
        assert kind == "ok", found
        assert found[:3] == ["map", "base", 5 * S]
        assert found[3] == pytest.approx([5, 2, -3, 0.6, 0, 0, 0.8])
        assert server.end()[0] == 130

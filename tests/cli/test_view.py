"""`tfdb view`: the command, not the page that it serves."""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
import subprocess
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any
from urllib.request import urlopen

import pytest
from mcap.writer import Writer as McapWriter
from websockets.sync.client import connect
from websockets.typing import Subprotocol

import tfdb
from tfdb.cli import view

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from conftest import Tool

PATIENCE = 120.0
TURN = (0.0, 0.6, 0.0, 0.8)


@contextmanager
def running(*arguments: object) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run the command; yield the process and the printed address."""
    command = [sys.executable, "-m", "tfdb.cli", "view", *map(str, arguments)]
    with subprocess.Popen(
        [*command, "--port", "0", "--no-open", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        text = ""
        while not text.endswith("}\n"):
            line = process.stdout.readline()
            assert line, process.stderr and process.stderr.read()
            text += line
        try:
            yield process, json.loads(text)["address"]
        finally:
            process.kill()


def messages(address: str, *kinds: str) -> dict[str, Any]:
    """Return the first message of each kind."""
    found: dict[str, Any] = {}
    url = address.partition("?")[0].replace("http:", "ws:") + "live"
    with connect(url, max_size=None, open_timeout=PATIENCE) as viewer:
        while not found.keys() >= set(kinds):
            message = viewer.recv(timeout=PATIENCE)
            if isinstance(message, str):
                body = json.loads(message)
                found.setdefault(body["type"], body)
    return found


def test_a_recording_is_served_until_ctrl_c(bag: Path) -> None:
    with running(bag) as (process, address):
        assert address.startswith("http://127.0.0.1:")
        with urlopen(address, timeout=PATIENCE) as page:
            assert b"app.js" in page.read()
        found = messages(address, "hello", "tree")
        assert found["hello"]["source"] == str(bag)
        assert found["hello"]["opening"] == f"buf = tfdb.load({str(bag)!r})"
        assert len(found["tree"]["names"]) == 85
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 130
        assert process.stderr is not None
        assert "Traceback" not in process.stderr.read()


def test_frozen_stores_and_selections_are_served(tool: Tool, bag: Path, tmp_path: Path) -> None:
    frozen = tmp_path / "drive.tfdb"
    tool("freeze", bag, "-o", frozen)
    with running(frozen) as (_, address):
        found = messages(address, "hello", "tree")
        assert len(found["tree"]["names"]) == 85
        assert found["hello"]["opening"] == f"buf = tfdb.open({str(frozen)!r})"
    with running(bag, "--frame", "base_link") as (_, address):
        found = messages(address, "hello", "tree")
        assert found["hello"]["opening"] == ""
        assert len(found["tree"]["names"]) < 85


def test_a_recording_is_judged_by_expectations(tool: Tool, bag: Path, tmp_path: Path) -> None:
    limits = tmp_path / "expectations.toml"
    limits.write_text('version = 1\n[[edge]]\nparent = "map"\nchild = "odom"\ndeadline = 0.01\n')
    with running(bag, "--expect", limits) as (_, address):
        hello = messages(address, "hello")["hello"]
    kinds = {event["kind"] for event in hello["events"]}
    assert hello["judged"]
    assert kinds == {"deadline"}


def test_a_shared_store_is_followed_until_it_is_removed(name: str) -> None:
    with tfdb.Buffer.open(name) as robot:
        robot.set_transform("map", "base", 1, (1, 0, 0), TURN)
        with running(f"shm:{name}") as (process, address):
            assert messages(address, "tree")["tree"]["names"] == ["map", "base"]
            tfdb.Buffer.unlink(name)
            assert process.wait(PATIENCE) == 2
            assert process.stderr is not None
            error = process.stderr.read()
            assert error.startswith("tfdb: error: ")
            assert name in error


def test_the_shapes_of_a_robot_are_served_and_missing_meshes_are_named(
    bag: Path, tmp_path: Path
) -> None:
    model = tmp_path / "robot.urdf"
    model.write_text(
        '<robot name="r"><link name="base_link">'
        '<visual><geometry><sphere radius="1"/></geometry></visual>'
        '<visual><geometry><mesh filename="package://r/x.stl"/></geometry></visual>'
        "</link></robot>"
    )
    with running(bag, "--urdf", model) as (process, address):
        with urlopen(f"{address}shapes.json", timeout=PATIENCE) as answer:
            (shape,) = json.load(answer)
        assert (shape["frame"], shape["kind"], shape["size"]) == ("base_link", "sphere", [1.0])
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 130
        assert process.stderr is not None
        assert "1 mesh file not shown, no such file" in process.stderr.read()


def test_a_shared_store_is_served_to_foxglove_until_it_is_removed(name: str) -> None:
    pytest.importorskip("foxglove")
    with tfdb.Buffer.open(name) as robot:
        robot.set_transform("map", "base", 1, (1, 0, 0), TURN)
        with running(f"shm:{name}", "--foxglove") as (process, address):
            assert address.startswith("ws://127.0.0.1:")
            with connect(address, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as viewer:
                assert f"shm:{name}" in str(viewer.recv(timeout=PATIENCE))
            tfdb.Buffer.unlink(name)
            assert process.wait(PATIENCE) == 2
            assert process.stderr is not None
            assert name in process.stderr.read()


def test_foxglove_ends_by_ctrl_c(name: str) -> None:
    pytest.importorskip("foxglove")
    with tfdb.Buffer.open(name), running(f"shm:{name}", "--foxglove") as (process, _):
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 130
        assert process.stderr is not None
        assert "Traceback" not in process.stderr.read()


def test_foxglove_at_a_port_in_use_is_named(tool: Tool, name: str) -> None:
    pytest.importorskip("foxglove")
    with tfdb.Buffer.open(name), socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        error = tool("view", f"shm:{name}", "--foxglove", "--port", port, code=2).error
    assert str(port) in error
    assert "in use" in error


def test_foxglove_without_its_package_is_named(tool: Tool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "tfdb.view.foxglove_server", raising=False)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    error = tool("view", "shm:x", "--foxglove", code=2).error
    assert error.startswith("tfdb view --foxglove needs foxglove-sdk: pip install 'tfdb[foxglove]'")


def test_a_robot_is_drawn_by_the_joint_states_of_a_recording(tmp_path: Path) -> None:
    path = tmp_path / "arm.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        kind = writer.register_schema("sensor_msgs/JointState", "ros1msg", b"")
        topic = writer.register_channel("/joint_states", "ros1", kind)
        state = struct.pack("<IIIIII4sIdII", 0, 5, 0, 0, 1, 4, b"lift", 1, 0.5, 0, 0)
        writer.add_message(topic, 5, state, 5)
        writer.finish()
    model = tmp_path / "arm.urdf"
    model.write_text(
        '<robot name="r"><link name="base"/><link name="hand">'
        '<visual><geometry><sphere radius="1"/></geometry></visual></link>'
        '<joint name="lift" type="prismatic"><parent link="base"/><child link="hand"/>'
        '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint></robot>'
    )
    with running(path, "--urdf", model) as (_, address):
        found = messages(address, "hello", "tree")
        assert found["tree"]["names"] == ["base", "hand"]
        assert found["hello"]["shapes"]


def test_a_live_store_and_a_frozen_one_take_a_robot(
    tool: Tool, bag: Path, tmp_path: Path, name: str
) -> None:
    model = tmp_path / "robot.urdf"
    model.write_text('<robot name="r"><link name="base"/></robot>')
    frozen = tmp_path / "drive.tfdb"
    tool("freeze", bag, "-o", frozen)
    with running(frozen, "--urdf", model) as (_, address):
        assert messages(address, "hello")["hello"]["shapes"]
    with tfdb.Buffer.open(name), running(f"shm:{name}", "--urdf", model) as (_, address):
        assert messages(address, "hello")["hello"]["shapes"]


def test_a_port_in_use_is_named(tool: Tool, bag: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        error = tool("view", bag, "--port", port, "--no-open", code=2).error
    assert (
        error == f"port {port} of 127.0.0.1 is in use: give another --port, or 0 for any free one"
    )


def test_a_host_that_is_not_here_is_named(tool: Tool, bag: Path) -> None:
    error = tool("view", bag, "--host", "192.0.2.1", "--port", "0", "--no-open", code=2).error
    assert error.startswith("cannot listen on port 0 of 192.0.2.1: ")


def test_the_browser_is_opened(tool: Tool, bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []

    def open_(address: str) -> None:
        opened.append(address)
        os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(view.webbrowser, "open", open_)
    out = tool("view", bag, "--port", "0", code=130).out
    assert out == f"{opened[0]} shows {bag}; Ctrl-C ends it\n"


def test_a_missing_package_is_named(tool: Tool, bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("tfdb.view.server", "websockets.asyncio.server", "websockets"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    monkeypatch.setitem(sys.modules, "websockets.asyncio.server", None)
    error = tool("view", bag, code=2).error
    assert error.startswith("tfdb view needs websockets: pip install 'tfdb[view]'")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("missing.bag",), "no such file"),
        (("shm:missing-store",), "missing-store"),
        (("shm:x", "--frame", "a"), "live"),
        (("BAG", "--expect", "missing.toml"), "missing.toml"),
        (("BAG", "--urdf", "missing.urdf"), "missing.urdf"),
        (("BAG", "--urdf", "BAG"), "not well-formed XML"),
        (("BAG", "--foxglove"), "OUT.mcap --foxglove"),
        (
            ("shm:x", "--foxglove", "--urdf", "BAG", "--expect", "b"),
            "--urdf, --expect cannot be used with --foxglove",
        ),
        (("shm:x", "--foxglove", "--frame", "a"), "--frame is valid for recordings"),
    ],
)
def test_wrong_input_is_refused(
    tool: Tool, bag: Path, arguments: tuple[str, ...], text: str
) -> None:
    given = [bag if each == "BAG" else each for each in arguments]
    assert text in tool("view", *given, "--no-open", code=2).err

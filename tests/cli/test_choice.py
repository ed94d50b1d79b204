"""All commands that read recordings have the same selection options."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any

import pytest
from mcap.writer import Writer as McapWriter

import tfdb

if TYPE_CHECKING:
    from pathlib import Path

OPTIONS = (
    *("--start", "+2", "--end", "-1.5", "--frame", "map", "--frame", "base_link"),
    *("--exclude", "/tf_stati?", "--rename", "map:=world", "--prefix", "r1/"),
)
NAMES = ["r1/base_footprint", "r1/odom", "r1/world"]


@pytest.fixture
def chosen(bag: Path) -> tfdb.Buffer:
    return tfdb.load(
        bag,
        start="+2",
        end="-1.5",
        frames={"map", "base_footprint"},
        rename={"map": "world"},
        prefix="r1/",
    )


def arguments(bag: Path, *others: object) -> tuple[object, ...]:
    fitting = tuple("base_footprint" if each == "base_link" else each for each in OPTIONS)
    return (bag, *others, *fitting)


def test_info_and_check(tool: Any, bag: Path, chosen: tfdb.Buffer) -> None:
    found = tool("info", *arguments(bag), "--json").json
    assert sorted(edge["frame"] for edge in found["edges"]) == NAMES[:2]
    infos = {info.name: info for info in chosen.tree()}
    for edge in found["edges"]:
        assert edge["samples"] == infos[edge["frame"]].samples
    assert "r1/odom" in tool("tree", *arguments(bag)).out
    assert tool("check", *arguments(bag), "--json").json["findings"] == []


def test_lookup_and_view_frames(tool: Any, bag: Path, chosen: tfdb.Buffer, tmp_path: Path) -> None:
    names = "r1/world", "r1/base_footprint"
    found = tool("lookup", *arguments(bag, *names), "--json").json
    assert found["translation"] == list(chosen.lookup_transform(*names).translation)
    out = tmp_path / "tree.dot"
    tool("view-frames", *arguments(bag), "-o", out)
    assert "r1/world" in out.read_text()


def test_poses_have_a_start_of_their_own(tool: Any, bag: Path, chosen: tfdb.Buffer) -> None:
    options = ("--rename", "map:=world", "--prefix", "r1/")
    times = ("--start", "+2", "--end", "+3", "--rate", "10")
    lines = tool("poses", bag, "r1/world", "r1/odom", *times, *options).out.splitlines()
    assert len(lines) == 11


@pytest.mark.parametrize("suffix", [".mcap", ".bag", ".db3"])
def test_convert(tool: Any, bag: Path, chosen: tfdb.Buffer, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"part{suffix}"
    written = tool("convert", *arguments(bag, out), "--json").json
    made = tfdb.load(out)
    assert made.frames() == chosen.frames() == NAMES
    for frame in NAMES[:2]:
        ours, theirs = made.samples(frame), chosen.samples(frame)
        assert (ours[0] == theirs[0]).all()
        assert abs(ours[1] - theirs[1]).max() < 1e-12
    assert written["transforms"] == sum(len(made.samples(frame)[0]) for frame in NAMES[:2])


def test_freeze_monitor_and_serve(
    tool: Any, bag: Path, chosen: tfdb.Buffer, tmp_path: Path, name: str
) -> None:
    tool("freeze", *arguments(bag), "-o", tmp_path / "part.tfdb")
    assert tfdb.open(tmp_path / "part.tfdb").frames() == chosen.frames()
    shown = tool("monitor", *arguments(bag)).out
    assert "r1/odom" in shown
    assert "base_link" not in shown
    tool("play", *arguments(bag), "--into", name, "--speed", "inf", "--history", 100)
    assert tfdb.Buffer.open(name, mode="r").frames() == chosen.frames()


def test_echo_and_change_notifier(tool: Any, bag: Path) -> None:
    names = ("r1/world", "r1/base_footprint")
    assert "r1/" in tool("echo", *arguments(bag, *names), "--json").out
    tool("change-notifier", *arguments(bag), "--pair", *names)


def test_stores_refuse_options_of_recordings(tool: Any, bag: Path, tmp_path: Path) -> None:
    frozen = tmp_path / "all.tfdb"
    tfdb.load(bag).freeze(frozen)
    words = "is a frozen store, read as a whole: --frame, --prefix are valid for recordings"
    given = ("--prefix", "r/", "--frame", "map")
    assert words in tool("tree", frozen, *given, code=2).error
    assert "is a graph, read as a whole" in tool("tree", "ros1:", "--keep", "3", code=2).error


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("--start", "soon"), "'soon' is not a number of seconds"),
        (("--start", "latest"), "'latest' is valid for lookups only"),
        (("--rename", "map=world"), "'map=world' is not FROM:=TO"),
        (("--keep", "-3"), "negative"),
        (("--keep", "0"), "keep must be a positive number of seconds"),
        (("--frame", "base_lnk"), "did you mean 'base_link'"),
        (("--exclude", "*"), "all 7,180 transforms are left out by exclude="),
    ],
)
def test_bad_options(tool: Any, bag: Path, given: tuple[str, ...], words: str) -> None:
    assert words in tool("tree", bag, *given, code=2).error


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    """A recording of odometry in Foxglove's JSON and ROS 1 joint states, without /tf."""
    path = tmp_path / "arm.mcap"
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        frames = writer.register_schema("foxglove.PoseInFrame", "jsonschema", b"{}")
        joints = writer.register_schema("sensor_msgs/JointState", "ros1msg", b"")
        where = writer.register_channel("/where", "json", frames)
        states = writer.register_channel("/joint_states", "ros1", joints)
        for second in range(1, 6):
            at = second * 10**9
            move, turn = {"x": second, "y": 0, "z": 0}, {"x": 0, "y": 0, "z": 0.6, "w": 0.8}
            pose = {"position": move, "orientation": turn}
            said = {"timestamp": {"sec": second, "nsec": 0}, "frame_id": "map", "pose": pose}
            writer.add_message(where, at, json.dumps(said).encode(), at)
            state = struct.pack(
                "<IIIIII4sIdII", 0, second, 0, 0, 1, 4, b"lift", 1, second / 10, 0, 0
            )
            writer.add_message(states, at, state, at)
        writer.finish()
    (tmp_path / "arm.urdf").write_text(
        """<robot name="arm"><link name="base"/><link name="hand"/><link name="eye"/>
        <joint name="lift" type="prismatic"><parent link="base"/><child link="hand"/>
        <axis xyz="0 0 1"/><limit lower="0" upper="1" velocity="1" effort="1"/></joint>
        <joint name="look" type="fixed"><parent link="hand"/><child link="eye"/>
        <origin xyz="0 0 0.5"/></joint></robot>"""
    )
    return path


def test_poses_and_joint_states(tool: Any, arm: Path, tmp_path: Path, name: str) -> None:
    """Each command computes the eye at T[map<-base] (0, 0, lift + 0.5)."""
    given = ("--pose-topic", "/where=base", "--urdf", arm.with_suffix(".urdf"))
    found = tool("lookup", arm, "map", "eye", "3", *given, "--json").json
    assert found["translation"] == pytest.approx([3, 0, 0.8])
    assert found["rotation_xyzw"] == pytest.approx([0, 0, 0.6, 0.8])
    assert "no topic with transforms; pose_topics='/where'" in tool("tree", arm, code=2).error
    for out in (tmp_path / "out.bag", tmp_path / "both.mcap"):
        if out.suffix == ".bag":
            tool("convert", arm, out, *given)
        else:
            two = ("--prefix", "a/", "--prefix", "b/")
            copy = tmp_path / "copy.mcap"
            copy.write_bytes(arm.read_bytes())
            tool("merge", arm, copy, "-o", out, *two, *given)
        made = tfdb.load(out)
        prefix = "" if out.suffix == ".bag" else "b/"
        pose = made.lookup_transform(f"{prefix}map", f"{prefix}eye", 3 * 10**9)
        assert list(pose.translation) == pytest.approx([3, 0, 0.8])
    assert tool("check", arm, *given, "--json").json["transforms"] == 11
    assert "eye" in tool("monitor", arm, *given).out
    tool("play", arm, "--into", name, "--speed", "inf", *given)
    with tfdb.Buffer.open(name, mode="r") as live:
        assert live.frames() == ["base", "eye", "hand", "map"]
    for wrong, words in (
        (("--pose-topic", "/where"), "--pose-topic /where=base_link"),
        (("--pose-topic", "/where="), "is not TOPIC or TOPIC=CHILD"),
        (("--joint-topic", "/a"), "joint_topic needs urdf"),
        (("--urdf", tmp_path / "none.urdf"), "none.urdf"),
    ):
        assert words in tool("tree", arm, *wrong, code=2).error


def test_only_a_robot_with_joint_states_gets_fixed_joints(
    arm: Path, tool: Any, tmp_path: Path
) -> None:
    other, out, urdf = tmp_path / "b.mcap", tmp_path / "both.mcap", arm.with_suffix(".urdf")
    edge = tfdb.TransformStamped("map", "cart", 2 * 10**9, (1, 2, 3), (0.0, 0.6, 0.0, 0.8))
    tfdb.recordings.write_transforms(other, [edge])
    apart = ("--prefix", "a/", "--prefix", "b/")
    tool("merge", arm, other, "-o", out, "--urdf", urdf, *apart)
    assert tfdb.load(out).frames() == ["a/base", "a/eye", "a/hand", "b/cart", "b/map"]
    tool("merge", arm, other, "-o", out, "--urdf", urdf, "--overwrite")
    assert tfdb.load(out).frames() == tfdb.load([arm, other], urdf=urdf).frames()


def test_serve_follow(tool: Any, mcap: Path, tmp_path: Path, name: str) -> None:
    given = ("--into", name, "--history", "100", "--prefix", "a/")
    made = tool("serve", "follow", mcap, *given, "--json").json
    assert (made["messages"], made["store"]) == (750, name)
    with tfdb.Buffer.open(name, mode="r") as live:
        assert live.frames() == tfdb.load(mcap, prefix="a/").frames()
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(mcap.read_bytes()[:-100])
    error = tool("serve", "follow", cut, *given, "--timeout", "0.01", code=2).error
    assert "has no end: its writer stopped" in error
    assert (
        "keep: not valid while" in tool("serve", "follow", cut, *given, "--keep", 1, code=2).error
    )
    cut.write_bytes(b"")
    error = tool("serve", "follow", cut, *given, "--timeout", "0.01", code=2).error
    assert "has no end: its writer stopped" in error

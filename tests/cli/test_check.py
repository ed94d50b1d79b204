"""`tfdb check` on recordings with planted faults, and its exit codes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import tfdb

if TYPE_CHECKING:
    from conftest import Tool

rosbag1 = pytest.importorskip("rosbags.rosbag1")

S = 1_000_000_000
START = 1_700_000_000 * S
UNIT = (0.0, 0.0, 0.0, 1.0)
CASES = Path(__file__).resolve().parents[1] / "cases"
DEFINITION = "geometry_msgs/TransformStamped[] transforms"
MD5 = "94810edda583a504dfda3829e70d7eec"


class BagMaker:
    """Writes a ROS 1 bag of TFMessages with a third-party library."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.messages: list[tuple[int, str, str, bytes]] = []

    def add(
        self,
        seconds: float,
        transforms: list[tfdb.TransformStamped] | bytes,
        *,
        publisher: str = "/ekf",
        topic: str = "/tf",
    ) -> None:
        """Add one message that arrives at a time in seconds after the start."""
        data = transforms
        if not isinstance(data, bytes):
            data = tfdb.encode_tf_message(data, "ros1")
        self.messages.append((START + round(seconds * S), topic, publisher, data))

    def add_drive(self, seconds: int = 5, publisher: str = "/ekf") -> None:
        """Add an edge at 10 Hz without faults."""
        for i in range(seconds * 10):
            self.add(i / 10, [moved("odom", "base", i / 10, i / 20)], publisher=publisher)

    def write(self) -> Path:
        connections = {}
        with rosbag1.Writer(self.path) as writer:
            for arrival, topic, publisher, data in sorted(self.messages, key=lambda m: m[0]):
                key = (topic, publisher)
                if key not in connections:
                    connections[key] = writer.add_connection(
                        topic,
                        "tf2_msgs/msg/TFMessage",
                        msgdef=DEFINITION,
                        md5sum=MD5,
                        callerid=publisher,
                        latching=0,
                    )
                writer.write(connections[key], arrival, data)
        return self.path


def moved(
    parent: str, child: str, seconds: float, x: float, rotation: tuple[float, ...] = UNIT
) -> tfdb.TransformStamped:
    return tfdb.TransformStamped(parent, child, START + round(seconds * S), (x, 0, 0), rotation)


@pytest.fixture
def maker(tmp_path: Path) -> BagMaker:
    return BagMaker(tmp_path / "made.bag")


def kinds(tool: Tool, path: Path, *options: object, code: int = 1) -> list[str]:
    body = tool("check", path, "--json", *options, code=code).json
    assert body["errors"] + body["warnings"] == len(body["findings"])
    return [finding["kind"] for finding in body["findings"]]


def test_shipped_recording_is_healthy(tool: Tool, bag: Path, mcap: Path) -> None:
    assert "nothing wrong" in tool("check", bag).out
    shown = tool("check", mcap).out
    assert "nothing wrong" in shown
    assert "does not name publishers" in shown


def test_json(tool: Tool, maker: BagMaker) -> None:
    maker.add_drive()
    maker.add(7, [moved("odom", "base", 7, 0)])
    body = tool("check", maker.write(), "--json", code=1).json
    assert set(body) == {
        "tfdb",
        "command",
        "files",
        "messages",
        "transforms",
        "publishers_known",
        "missed_commits",
        "findings",
        "errors",
        "warnings",
    }
    assert body["publishers_known"] is True
    (finding,) = body["findings"]
    assert set(finding) == {
        "kind",
        "severity",
        "frames",
        "message",
        "stamp_ns",
        "count",
        "details",
    }
    assert finding["kind"] == "gap"
    assert finding["severity"] == "warning"
    assert finding["frames"] == ["base"]
    assert finding["stamp_ns"] == START + 49 * S // 10
    assert finding["details"]["longest_ns"] == 21 * S // 10


def test_healthy(tool: Tool, maker: BagMaker) -> None:
    maker.add_drive()
    assert kinds(tool, maker.write(), code=0) == []


def test_two_publishers(tool: Tool, maker: BagMaker) -> None:
    maker.add_drive()
    for i in range(50):
        maker.add(i / 10 + 0.05, [moved("odom", "base", i / 10 + 0.05, i / 20)], publisher="/amcl")
    path = maker.write()
    assert kinds(tool, path) == ["two-publishers"]
    assert "/amcl (50), /ekf (50)" in tool("check", path, code=1).out.replace(
        "/ekf (50), /amcl (50)", "/amcl (50), /ekf (50)"
    )


def test_disconnected_trees(tool: Tool, maker: BagMaker) -> None:
    maker.add_drive()
    maker.add(0, [moved("table", "cup", 0, 1)], topic="/tf_static")
    path = maker.write()
    assert kinds(tool, path) == ["disconnected"]
    assert "odom (2 frames), table (2 frames)" in tool("check", path, code=1).out


def test_refused_messages(tool: Tool, maker: BagMaker) -> None:
    maker.add_drive()
    maker.add(2.01, [moved("odom", "base", 2.01, float("nan"))])
    maker.add(2.02, [moved("odom", "base", 2.02, 1, (0, 0, 0, 0))])
    maker.add(2.03, b"\x05\x00\x00\x00 cut short")
    path = maker.write()
    body = tool("check", path, "--json", code=1).json
    refused = {f["details"]["error"]: f for f in body["findings"] if f["kind"] == "refused"}
    assert refused["InvalidTransform"]["frames"] == ["base"]
    assert set(refused) == {"InvalidTransform", "CorruptMessage"}
    assert refused["InvalidTransform"]["count"] == 2
    assert {finding["kind"] for finding in body["findings"]} == {"refused"}
    for command in ("info", "gaps"):
        assert (
            "2 transforms refused, nothing stored of 3 messages; 'tfdb check' lists the reasons"
            in tool(command, path).out
        )


def test_transforms_that_are_refused_make_no_other_finding(tool: Tool, maker: BagMaker) -> None:
    maker.add_drive()
    edge = moved("base", "camera", 2.01, 1)
    maker.add(2.01, [edge, moved("/map", "/base", 2.01, 900, (0, 0, 0, 0))])
    maker.add(2.02, [edge, moved("camera", "odom", 2.02, 1)], publisher="/other")
    maker.add(2.03, [moved("odom", "base", 2.02, 50, (0, 0, 0, 0))])
    maker.add(2.04, [moved("/base", "/base", 9.0, 50)])
    found = tool("check", maker.write(), "--json", "--ignore", "coverage", code=1).json["findings"]
    assert {finding["kind"] for finding in found} == {"refused", "two-publishers"}
    assert {finding["details"].get("error") for finding in found} == {
        "InvalidTransform",
        "CycleError",
        None,
    }


def test_looped_bag(tool: Tool, maker: BagMaker) -> None:
    for i in range(100):
        maker.add(i / 10, [moved("odom", "base", (i % 50) / 10, i / 20)])
    body = tool("check", maker.write(), "--json", code=1).json
    assert [finding["kind"] for finding in body["findings"]] == ["time-jump"]
    details = body["findings"][0]["details"]
    assert details["from_ns"] - details["to_ns"] == 49 * S // 10


def test_late_and_reparented(tool: Tool, maker: BagMaker) -> None:
    maker.add_drive()
    maker.add(5.0, [moved("map", "base", 5.0, 1)])
    maker.add(5.05, [moved("map", "base", 4.95, 1)])
    found = kinds(tool, maker.write(), "--ignore", "disconnected")
    assert found == ["reparented", "late"]


def test_limits_and_ignore(tool: Tool, maker: BagMaker) -> None:
    maker.add_drive()
    maker.add(7, [moved("odom", "base", 7, 0)])
    path = maker.write()
    assert kinds(tool, path, "--max-gap", "3", code=0) == []
    assert kinds(tool, path, "--ignore", "gap", code=0) == []
    assert kinds(tool, path, "--max-gap", "50000000ns") == ["gap"]


def test_static_twice(tool: Tool, maker: BagMaker) -> None:
    maker.add_drive()
    for i in range(3):
        maker.add(i, [moved("base", "lidar", 0, 0.1 * i)], topic="/tf_static")
    assert kinds(tool, maker.write()) == ["static-revised"]


def test_remapped_topics(tool: Tool, maker: BagMaker) -> None:
    for i in range(20):
        maker.add(i / 10, [moved("odom", "base", i / 10, i)], topic="/robot1/tf")
    maker.add(0, [moved("base", "lidar", 0, 1)], topic="/robot1/fixed")
    path = maker.write()
    options = ("--topic", "/robot1/tf:/tf", "--topic", "/robot1/fixed:/tf_static")
    assert kinds(tool, path, *options, code=0) == []
    body = tool("info", path, *options, "--json").json
    topics = {topic["name"]: topic["static"] for topic in body["topics"]}
    assert topics == {"/robot1/tf": False, "/robot1/fixed": True}
    said = tool("info", path, "--topic", "/robot2/tf", code=2).error
    assert "/robot2/tf" in said
    assert "/robot1/tf" in said


def test_table(tool: Tool, maker: BagMaker) -> None:
    maker.add_drive()
    maker.add(7, [moved("odom", "base", 7, 0)])
    shown = tool("check", maker.write(), code=1).out
    assert "gap" in shown
    assert "base" in shown
    assert "1 gap, the longest 2.1 s where 100 ms is usual" in shown
    assert "0 errors, 1 warning" in shown


def test_exit_code_of_the_installed_program(tool: Tool, maker: BagMaker, bag: Path) -> None:
    maker.add_drive()
    maker.add(7, [moved("odom", "base", 7, 0)])
    done = tool.installed("check", maker.write(), "--json")
    assert done.code == 1
    assert json.loads(done.out)["warnings"] == 1
    assert tool.installed("check", bag).code == 0
    assert tool.installed("check", maker.path.with_name("none.bag")).code == 2


@pytest.mark.parametrize(
    ("recording", "found"),
    [
        ("panda/rosbagFrankaPanda.bag", set()),
        ("panda/ros2", set()),
        ("turtlebot3/rosbag2_turtlebot3_tf", {"disconnected"}),
        ("turtlebot_nav/tf_example.bag", set()),
        ("turtlebot_nav/tf_example", set()),
    ],
)
def test_real_robots(tool: Tool, shared_data: Path, recording: str, found: set[str]) -> None:
    body = tool("check", shared_data / recording, "--json", code=1 if found else 0).json
    assert {finding["kind"] for finding in body["findings"]} == found


@pytest.mark.parametrize("command", ["info", "tree"])
@pytest.mark.parametrize(
    "recording",
    [
        "panda/rosbagFrankaPanda.bag",
        "panda/ros2",
        "panda/ros2/rosbagFrankaPandaRos2.bag.db3",
        "turtlebot3/rosbag2_turtlebot3_tf",
        "turtlebot_nav/tf_example.bag",
        "turtlebot_nav/tf_example/tf_example.db3",
    ],
)
def test_other_commands_on_real_robots(
    tool: Tool, shared_data: Path, recording: str, command: str
) -> None:
    assert tool(command, shared_data / recording).out
    assert tool(command, shared_data / recording, "--json").json["roots"]


def test_leading_slashes(tool: Tool, maker: BagMaker) -> None:
    maker.add_drive()
    for i in range(40):
        maker.add(i / 10 + 0.01, [moved("base", "camera", i / 10, 1)])
    plain = tfdb.encode_tf_message([moved("base", "camera", 4.0, 1)], "ros1")
    base, camera = b"\4\0\0\0base", b"\6\0\0\0camera"
    assert base in plain
    maker.add(4.01, plain.replace(base, b"\5\0\0\0/base").replace(camera, b"\7\0\0\0/camera"))
    found = tool("check", maker.write(), "--json", code=1).json["findings"]
    assert [(f["kind"], f["frames"]) for f in found] == [
        ("leading-slash", ["base"]),
        ("leading-slash", ["camera"]),
    ]
    assert "'base' and as '/base'" in found[0]["message"]


def test_slashes_everywhere_are_fine(tool: Tool, maker: BagMaker) -> None:
    for i in range(40):
        plain = tfdb.encode_tf_message([moved("odom", "base", i / 10, 1)], "ros1")
        named = plain.replace(b"\4\0\0\0odom", b"\5\0\0\0/odom")
        maker.add(i / 10, named.replace(b"\4\0\0\0base", b"\5\0\0\0/base"))
    assert kinds(tool, maker.write(), code=0) == []


def test_salvaged(tool: Tool, maker: BagMaker, tmp_path: Path) -> None:
    maker.add_drive(60)
    path = maker.write()
    whole = tfdb.load(path)
    path.write_bytes(path.read_bytes()[:60_000])
    for command in (("info",), ("tree",), ("check",)):
        assert "--salvage" in tool(*command, path, code=2).error
    done = tool("info", path, "--salvage")
    assert f"tfdb: salvaged {path}: lost at least" in done.err
    body = tool("check", path, "--salvage", "--json", code=1).json
    assert [finding["kind"] for finding in body["findings"]] == ["lost"]
    assert body["findings"][0]["details"]["bytes"] > 0
    out = tmp_path / "saved.bag"
    tool("convert", path, out, "--salvage")
    saved = tfdb.load(out).samples("base")[0]
    assert 100 < len(saved) < 600
    assert saved.tolist() == whole.samples("base")[0][: len(saved)].tolist()


REAL = {
    "panda/rosbagFrankaPanda.bag": [],
    "panda/ros2": [],
    "turtlebot3/rosbag2_turtlebot3_tf": [("disconnected", 2)],
    "turtlebot_nav/tf_example.bag": [],
    "turtlebot_nav/tf_example": [],
    "trajectories/fr2_desk_groundtruth.txt": [("gap", 184)],
    "trajectories/KITTI_00_gt.txt": [],
}


@pytest.mark.parametrize("name", REAL)
def test_real_recordings_have_no_other_findings(shared_data: Path, name: str, tool: Tool) -> None:
    findings = REAL[name]
    found = tool("check", shared_data / name, "--json", code=1 if findings else 0).json["findings"]
    assert [(each["kind"], each["count"]) for each in found] == findings


@pytest.mark.parametrize(
    ("case", "kind", "frame", "words"),
    [
        ("two_auth", "there-and-back", "base_link", "by up to 2.98 m"),
        ("future", "ahead", "odom", "usually by 1 s"),
        ("jump", "pose-jump", "base_link", "999.5 m in 20 ms"),
    ],
)
def test_findings_of_public_recordings(
    case: str, kind: str, frame: str, words: str, tool: Tool
) -> None:
    (found,) = tool("check", CASES / f"{case}.mcap", "--json", code=1).json["findings"]
    assert (found["kind"], found["frames"]) == (kind, [frame])
    assert words in found["message"]
    tool("check", CASES / f"{case}.mcap", "--ignore", kind)


def test_an_edge_that_is_static_and_moves_names_an_option(tool: Tool) -> None:
    path = CASES / "static_and_dyn.mcap"
    findings = tool("check", path, "--json", code=1).json["findings"]
    assert [each["kind"] for each in findings] == ["refused", "static-and-moving"]
    assert "--exclude '/tf_static:base_link'" in findings[0]["message"]
    assert "--exclude '/tf_static:base_link'" in tool("lookup", path, "odom", "base_link").err
    left = tool("check", path, "--exclude", "/tf_static:base_link", "--json").json
    assert (left["findings"], left["transforms"]) == ([], 50)


def test_serving_an_edge_that_is_static_and_moves_names_an_option(tool: Tool) -> None:
    command = ("play", CASES / "static_and_dyn.mcap", "--into", "static-and-moving")
    try:
        shown = tool(*command, "--speed", "inf").out
        assert "--exclude '/tf_static:base_link'" in shown
        assert "change_kind" not in shown
    finally:
        tool("shm", "rm", "static-and-moving")

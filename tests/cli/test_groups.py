"""Commands on recordings with several groups of topics for one edge."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import tfdb

if TYPE_CHECKING:
    from .conftest import Tool

CASES = Path(__file__).resolve().parents[1] / "cases"
ROBOTS = CASES / "two_robots.mcap"
OLD = CASES / "tf_and_tf_old.mcap"
HALF = "1700000000.5"


@pytest.mark.parametrize(
    "command",
    [
        ("lookup", ROBOTS, "odom", "base_link", HALF),
        ("poses", ROBOTS, "odom", "base_link"),
        ("echo", ROBOTS, "odom", "base_link"),
        ("monitor", ROBOTS),
        ("play", ROBOTS, "--into", "robots", "--speed", "inf"),
    ],
    ids=lambda command: command[0],
)
def test_commands_that_answer_refuse_and_name_the_ways_on(
    command: tuple[object, ...], tool: Tool
) -> None:
    error = tool(*command, code=2).error
    assert "/robot1/tf with /robot1/tf_static; /robot2/tf with /robot2/tf_static" in error
    assert "--topic" in error
    assert "--by-namespace" in error
    assert "--mix" in error


def test_the_error_as_json_has_the_groups(tool: Tool) -> None:
    body = tool("lookup", ROBOTS, "odom", "base_link", "--json", code=2).json["error"]
    assert body["type"] == "MixedSources"
    assert body["fields"]["frames"] == ["base_link", "laser"]
    assert body["fields"]["groups"]["/robot2"] == ["/robot2/tf", "/robot2/tf_static"]


def test_nothing_is_served_of_a_recording_that_is_refused(tool: Tool) -> None:
    name = "groups-that-disagree"
    tool("play", ROBOTS, "--into", name, "--speed", "inf", code=2)
    with pytest.raises(tfdb.errors.NoSuchStore):
        tfdb.Buffer.open(name, create=False)


def test_each_group_can_be_served_under_its_prefix(tool: Tool) -> None:
    name = "groups-apart"
    try:
        tool("play", ROBOTS, "--into", name, "--speed", "inf", "--by-namespace")
        with tfdb.Buffer.open(name, create=False) as store:
            found = store.lookup_transform(
                "robot2/odom", "robot2/base_link", 1_700_000_000_500_000_000
            )
            assert found.translation[0] == pytest.approx(50.5)
    finally:
        tool("shm", "rm", name)


def test_each_option_chooses_an_answer(tool: Tool) -> None:
    def x_of(*more: str, frames: tuple[str, str] = ("odom", "base_link")) -> float:
        found = tool("lookup", ROBOTS, *frames, HALF, "--json", *more).json
        return float(found["translation"][0])

    assert x_of("--topic", "/robot1/tf") == pytest.approx(0.5)
    assert x_of("--mix") == pytest.approx(50.5)
    second = ("robot2/odom", "robot2/base_link")
    assert x_of("--by-namespace", frames=second) == pytest.approx(50.5)


@pytest.mark.parametrize(
    ("path", "groups", "frames", "roots"),
    [
        (
            ROBOTS,
            {
                "/robot1": ["/robot1/tf", "/robot1/tf_static"],
                "/robot2": ["/robot2/tf", "/robot2/tf_static"],
            },
            ["base_link", "laser"],
            ["robot1/odom", "robot2/odom"],
        ),
        (
            OLD,
            {"/": ["/tf", "/tf_static"], "/tf_old": ["/tf_old"]},
            ["base_link"],
            ["odom", "tf_old/odom"],
        ),
    ],
    ids=["robots", "old"],
)
def test_info_check_and_tree_show_the_groups_apart(
    path: Path, groups: dict[str, list[str]], frames: list[str], roots: list[str], tool: Tool
) -> None:
    info = tool("info", path, "--json")
    assert info.json["mixed"] == {"groups": groups, "frames": frames}
    assert info.json["roots"] == roots
    assert "Shown here: each group under its own prefix" in info.err
    assert all(edge["rate_hz"] in (None, 50.0) for edge in info.json["edges"])
    (finding,) = tool("check", path, "--json", code=1).json["findings"]
    assert (finding["kind"], finding["severity"]) == ("mixed-sources", "error")
    assert finding["details"] == {"groups": groups, "frames": frames}
    assert finding["frames"] == frames
    text = tool("check", path, code=1).out
    assert all(" with ".join(topics) in text for topics in groups.values())
    assert all(root in tool("tree", path).out for root in roots)
    tool("gaps", path)


def test_check_finds_nothing_where_the_groups_are_apart_or_named(tool: Tool) -> None:
    assert tool("check", ROBOTS, "--by-namespace", "--json").json["findings"] == []
    named = ("--topic", "/robot1/tf", "--topic", "/robot1/tf_static")
    assert tool("check", ROBOTS, *named, "--json").json["findings"] == []
    assert tool("info", ROBOTS, *named, "--json").json["mixed"] is None


def test_check_finds_two_trees_in_one_group(tool: Tool, tmp_path: Path) -> None:
    path = tmp_path / "trees.mcap"
    turned = (0.6, 0.0, 0.0, 0.8)
    edge = tfdb.TransformStamped("a", "b", 5, (1.0, 2.0, 3.0), turned)
    other = tfdb.TransformStamped("c", "d", 5, (1.0, 2.0, 3.0), turned)
    with tfdb.recordings.RecordingWriter(path) as writer:
        data = tfdb.encode_tf_message([edge, other], writer.encoding)
        writer.write(data, 5, topic="/robot/tf", static=False)
    (finding,) = tool("check", path, "--by-namespace", "--json", code=1).json["findings"]
    assert (finding["kind"], finding["frames"]) == ("disconnected", ["robot/a", "robot/c"])


def test_merge_judges_by_the_same_rule(tool: Tool, tmp_path: Path) -> None:
    other, out = tmp_path / "other.mcap", tmp_path / "out.mcap"
    tool("rename", OLD, "-o", other, "--prefix", "other/", "--by-namespace")
    text = tool("merge", ROBOTS, other, "-o", out, code=2).error
    assert "--by-namespace" in text
    assert not out.exists()
    tool("merge", ROBOTS, other, "-o", out, "--prefix", "a/", "--prefix", "b/", code=2)
    tool("merge", ROBOTS, other, "-o", out, "--mix")
    assert tool("info", out, "--json").json["mixed"]["frames"] == ["base_link", "laser"]
    tool("merge", ROBOTS, other, "-o", out, "--by-namespace", "--overwrite")
    assert tool("info", out, "--json").json["mixed"] is None
    assert "robot1/base_link" in tfdb.load(out).frames()


def test_robots_of_two_files_are_merged_by_namespace(tool: Tool, tmp_path: Path) -> None:
    files = []
    for robot in ("robot1", "robot2"):
        files.append(tmp_path / f"{robot}.mcap")
        named = ("--topic", f"/{robot}/tf", "--topic", f"/{robot}/tf_static")
        tool("convert", ROBOTS, files[-1], *named)
    out = tmp_path / "both.mcap"
    assert "--by-namespace" in tool("merge", *files, "-o", out, code=2).error
    tool("merge", *files, "-o", out, "--by-namespace")
    buffer = tfdb.load(out)
    assert {"robot1/base_link", "robot2/base_link"} <= set(buffer.frames())


def test_a_copy_keeps_the_topics_apart(tool: Tool, tmp_path: Path) -> None:
    out = tmp_path / "copy.bag"
    tool("convert", ROBOTS, out)
    assert tool("info", out, "--json").json["mixed"]["frames"] == ["base_link", "laser"]
    apart = tmp_path / "apart.bag"
    tool("convert", ROBOTS, apart, "--by-namespace")
    assert tool("info", apart, "--json").json["roots"] == ["robot1/odom", "robot2/odom"]


def test_a_trajectory_of_a_mixture_is_refused(tool: Tool, tmp_path: Path) -> None:
    out = tmp_path / "path.tum"
    command = ("convert", ROBOTS, out, "--frames", "odom", "base_link")
    assert "--by-namespace" in tool(*command, code=2).error
    assert not out.exists()
    tool(*command, "--topic", "/robot1/tf")
    assert tfdb.load(out).samples("body")[1][:, 0].max() < 1


@pytest.mark.parametrize("option", ["--by-namespace", "--mix"])
def test_a_frozen_store_has_no_groups(option: str, tool: Tool, tmp_path: Path) -> None:
    store = tmp_path / "robots.tfdb"
    tfdb.load(ROBOTS, by_namespace=True).freeze(store)
    assert f"{option} is valid for recordings" in tool("info", store, option, code=2).error


@pytest.mark.parametrize(
    "options", [("--frame", "base_link"), ("--exclude", "laser"), ("--rename", "odom:=map")]
)
def test_options_that_name_frames_need_a_way_on(options: tuple[str, str], tool: Tool) -> None:
    assert "--by-namespace" in tool("info", ROBOTS, *options, code=2).error
    tool("info", ROBOTS, *options, "--mix")


def test_static_transforms_of_a_mixture_need_a_way_on(tool: Tool) -> None:
    name = "groups-static"
    command = ("static-publisher", f"shm:{name}", "--from", ROBOTS)
    try:
        assert "--by-namespace" in tool(*command, code=2).error
        tool(*command, "--by-namespace")
        with tfdb.Buffer.open(name, create=False) as store:
            assert "robot2/laser" in store.frames()
    finally:
        tool("shm", "rm", name)
    given = ("0", "0", "1", "0", "0", "0", "1", "a", "b")
    text = tool("static-publisher", "shm:none", *given, "--mix", code=2).error
    assert "need --from" in text


def test_a_growing_recording_is_followed_by_the_same_rule(tool: Tool) -> None:
    name = "groups-followed"
    command = ("serve", "follow", ROBOTS, "--into", name)
    try:
        assert "--by-namespace" in tool(*command, code=2).error
        assert "no shared store" in tool("shm", "info", name, code=2).error
        tool(*command, "--by-namespace", "--history", "100")
        with tfdb.Buffer.open(name, create=False) as store:
            assert store.frame_info("robot1/base_link").samples == 50
    finally:
        tool("shm", "rm", name)

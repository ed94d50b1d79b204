"""`tfdb merge` and `tfdb rename`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb
from tfdb.recordings import Recording, RecordingWriter

if TYPE_CHECKING:
    from conftest import Tool

S = 1_000_000_000
ROBOTS = Path(__file__).parents[1] / "cases" / "two_robots.mcap"
TURN = (0.0, 0.6, 0.0, 0.8)


def record(
    path: Path,
    moving: dict[tuple[str, str], range],
    static: dict[tuple[str, str], float] | None = None,
    publisher: str = "/who",
) -> Path:
    """Record moving edges (stamps in tenths of a second) and static edges (each with its x)."""
    with RecordingWriter(path) as writer:
        for (parent, child), x in (static or {}).items():
            one = tfdb.TransformStamped(parent, child, 0, (x, 1, 2), TURN)
            data = tfdb.encode_tf_message([one], writer.encoding)
            writer.write(data, S, topic="/tf_static", static=True, authority=publisher)
        rows = sorted((i, *edge) for edge, stamps in moving.items() for i in stamps)
        for i, parent, child in rows:
            one = tfdb.TransformStamped(parent, child, S + i * S // 10, (i, 1, 2), TURN)
            data = tfdb.encode_tf_message([one], writer.encoding)
            writer.write(data, S + i * S // 10, topic="/tf", static=False, authority=publisher)
    return path


@pytest.mark.parametrize("suffix", [".bag", ".mcap"])
def test_a_merged_file_holds_both_in_order_of_time(tool: Tool, tmp_path: Path, suffix: str) -> None:
    one = record(tmp_path / "a.bag", {("map", "a"): range(0, 50, 3)}, {("a", "s"): 4}, "/one")
    other = record(tmp_path / "b.mcap", {("map", "b"): range(10, 60)}, publisher="/two")
    out = tmp_path / f"both{suffix}"
    body = tool("merge", one, other, "-o", out, "--json").json
    assert (body["command"], body["messages"], body["transforms"]) == ("merge", 68, 68)
    assert body["files"] == [str(one), str(other)]
    both = tfdb.Buffer(history=None)
    both.load([one, other])
    found = tfdb.load(out)
    assert sorted(found.frames()) == ["a", "b", "map", "s"]
    for frame in ("a", "b", "s"):
        for mine, theirs in zip(found.samples(frame), both.samples(frame), strict=True):
            assert np.array_equal(mine, theirs)
    with Recording(out) as recording:
        received = [at for _, at, _ in recording.messages()]
        authorities = {source.authority for source in recording.sources}
    assert received == sorted(received)
    assert len(received) == 68
    assert not np.all(np.diff([at for at in received if at % (S // 10) == 0]) == 0)
    if suffix == ".bag":
        assert "/one" in authorities


def test_prefixes_keep_robots_apart(tool: Tool, tmp_path: Path) -> None:
    one = record(tmp_path / "a.bag", {("map", "base"): range(10)}, {("base", "cam"): 1})
    other = record(tmp_path / "b.bag", {("map", "base"): range(5, 20)}, {("base", "cam"): 2})
    out = tmp_path / "both.bag"
    said = tool("merge", one, other, "-o", out, code=2).error
    assert f"2 files state different transforms of cam: {one} (/tf, /tf_static); " in said
    assert "--prefix" in said
    assert not out.exists()
    tool("merge", one, other, "-o", out, "--prefix", "r1/", "--prefix", "r2/")
    found = tfdb.load(out)
    assert sorted(found.frames()) == sorted(
        f"{robot}/{frame}" for robot in ("r1", "r2") for frame in ("map", "base", "cam")
    )
    for robot, file in (("r1", one), ("r2", other)):
        alone = tfdb.load(file)
        for mine, theirs in zip(
            found.samples(f"{robot}/base")[:2], alone.samples("base")[:2], strict=True
        ):
            assert np.array_equal(mine, theirs)
    tool("merge", one, other, "-o", out, "--prefix", "r1/", "--prefix", "", "--overwrite")
    assert {"r1/base", "base"} <= set(tfdb.load(out).frames())


@pytest.mark.parametrize("prefix", ["", "r/", "/r/"])
def test_files_of_one_prefix_are_parts_of_one_recording(
    tool: Tool, tmp_path: Path, prefix: str
) -> None:
    one = record(tmp_path / "a.bag", {("map", "base"): range(10)}, {("base", "cam"): 1})
    other = record(tmp_path / "b.bag", {("map", "base"): range(10)}, {("base", "cam"): 2})
    out = tmp_path / "both.bag"
    prefixes = ("--prefix", prefix, "--prefix", prefix.removeprefix("/"))
    said = tool("merge", one, other, "-o", out, *prefixes, code=2).error
    assert "2 files state different transforms of cam" in said
    assert tool("merge", one, one, "-o", out, *prefixes, code=2).error == f"{one} is given twice"
    assert not out.exists()
    tool("merge", one, other, "-o", out, *prefixes, "--mix")
    assert f"{prefix}base".removeprefix("/") in tfdb.load(out).frames()


@pytest.mark.parametrize("moves", [True, False])
def test_prefixes_that_give_two_frames_one_name_are_refused(
    tool: Tool, tmp_path: Path, moves: bool
) -> None:
    frames = {("map", "base"): range(9)} if moves else {}
    statics = {} if moves else {("map", "base"): 2}
    one = record(tmp_path / "a.bag", {("l/map", "l/base"): range(9)})
    other = record(tmp_path / "b.bag", frames, statics)
    out = tmp_path / "both.bag"
    prefixes = ("--prefix", "", "--prefix", "l/")
    assert tool("merge", one, other, "-o", out, *prefixes, code=2).error == (
        f"the prefixes give frames of {one} and of {other} one name, 'l/base': "
        "give another --prefix, or --mix them"
    )
    made = tool("merge", one, other, "-o", out, *prefixes, "--mix", "--json").json
    assert made["messages"] == (18 if moves else 10)


def test_parts_that_follow_one_another_are_merged(tool: Tool, tmp_path: Path) -> None:
    parts = [
        record(tmp_path / f"{i}.bag", {("map", "base"): range(i, i + 10)}, {("base", "cam"): 1})
        for i in (10, 0)
    ]
    out = tmp_path / "whole.bag"
    tool("merge", *parts, "-o", out)
    assert len(tfdb.load(out).samples("base")[0]) == 20


@pytest.mark.parametrize("suffix", [".bag", ".mcap"])
def test_a_late_sample_in_the_next_part_is_merged(tool: Tool, tmp_path: Path, suffix: str) -> None:
    received = (range(10), [10, 11, 12])
    stamps = (range(10), [10, 8, 12])  # the sample of 0.8 s came 0.3 s late, in the second part
    parts = []
    for n, (times, seen) in enumerate(zip(received, stamps, strict=True)):
        parts.append(tmp_path / f"{n}{suffix}")
        with RecordingWriter(parts[-1]) as writer:
            one = tfdb.TransformStamped("base", "cam", 0, (1, 1, 2), TURN)
            data = tfdb.encode_tf_message([one], writer.encoding)
            writer.write(data, S, topic="/tf_static", static=True)
            for time, stamp in zip(times, seen, strict=True):
                late = stamp + (stamp != time) / 2  # 0.85 s, between two samples of the first part
                at = int(S + late * S / 10)
                one = tfdb.TransformStamped("map", "base", at, (late, 1, 2), TURN)
                data = tfdb.encode_tf_message([one], writer.encoding)
                writer.write(data, S + time * S // 10, topic="/tf")
    out = tmp_path / f"whole{suffix}"
    tool("merge", *parts, "-o", out)
    whole, both = tfdb.load(out), tfdb.Buffer(history=None)
    both.load(parts)
    assert whole.samples("base")[0].tolist() == both.samples("base")[0].tolist()
    assert len(whole.samples("base")[0]) == 13


def test_contradicting_files_are_refused_and_may_be_mixed(tool: Tool, tmp_path: Path) -> None:
    moving = record(tmp_path / "a.bag", {("map", "base"): range(10)}, {("base", "cam"): 1})
    out = tmp_path / "out.bag"
    for other, words in (
        (record(tmp_path / "b.bag", {}, {("base", "cam"): 2}), "different transforms of cam: "),
        (record(tmp_path / "c.bag", {}, {("map", "base"): 2}), "different transforms of base: "),
        (record(tmp_path / "d.bag", {}, {("cam", "map"): 2}), "together make a cycle, "),
    ):
        said = tool("merge", moving, other, "-o", out, code=2).error
        assert words in said
        assert "--mix" in said
        assert not out.exists()
        tool("merge", moving, other, "-o", out, "--mix", "--overwrite")
        with Recording(out) as mixed:
            assert sum(topic.messages for topic in mixed.topics) == 12
        out.unlink()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("a",), "nothing to merge: give two files or more; 'tfdb rename' copies one"),
        (("a", "b", "--prefix", "x/"), "give --prefix once per FILE: got 1 for 2 files"),
        (("a", "none.bag"), "no such file"),
        (("a", "a"), "is given twice"),
        (("a", "b", "--exclude", "*"), "left out"),
    ],
)
def test_misuse_of_merge(
    tool: Tool, tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    files = {n: record(tmp_path / f"{n}.bag", {("map", n): range(10)}) for n in "ab"}
    given = [files.get(argument, argument) for argument in arguments]
    out = tmp_path / "out.bag"
    assert words in tool("merge", *given, "-o", out, code=2).error
    assert not out.exists()
    assert "must end in" in tool("merge", *files.values(), "-o", "x.tum", code=2).error
    assert "also an input" in tool("merge", *files.values(), "-o", files["a"], code=2).error


def test_rename(tool: Tool, tmp_path: Path, bag: Path) -> None:
    out = tmp_path / "world.mcap"
    body = tool(
        *("rename", bag, "-o", out, "--rename", "map:=world", "--prefix", "r1/", "--json")
    ).json
    assert (body["command"], body["transforms"]) == ("rename", 7180)
    before, after = tfdb.load(bag), tfdb.load(out)
    names = {name: "r1/world" if name == "map" else f"r1/{name}" for name in before.frames()}
    assert sorted(after.frames()) == sorted(names.values())
    stamp = before.lookup_transform("map", "base_link").stamp
    expected = before.lookup_transform("map", "l_gripper_tool_frame", stamp).matrix
    found = after.lookup_transform("r1/world", "r1/l_gripper_tool_frame", stamp).matrix
    assert np.array_equal(found, expected)
    assert not np.allclose(found, np.eye(4))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "nothing to rename"),
        (("--exclude", "odom"), "'tfdb convert' writes a part of a recording"),
        (("--rename", "mapp:=world"), "did you mean 'map'?"),
        (("--rename", "map=world"), "FROM:=TO"),
        (("--rename", "map:=odom"), "would both be called 'odom'"),
        (
            ("--rename", "base_link:=b", "--exclude", "base_link"),
            "rename: frame 'base_link' is left out by exclude=['base_link']",
        ),
        (("--rename", "map:=odom", "--prefix", "r/"), "would both be called 'r/odom'"),
    ],
)
def test_misuse_of_rename(
    tool: Tool, tmp_path: Path, bag: Path, arguments: tuple[str, ...], words: str
) -> None:
    out = tmp_path / "out.bag"
    assert words in tool("rename", bag, "-o", out, *arguments, code=2).error
    assert not out.exists()


def test_rename_puts_the_frames_of_each_group_under_its_prefix(tool: Tool, tmp_path: Path) -> None:
    robots, out = ROBOTS, tmp_path / "out.mcap"
    tool("rename", robots, "-o", out, "--by-namespace", "--rename", "robot1/odom:=world")
    found = tfdb.load(out)
    assert found.parent_of("robot1/base_link") == "world"
    assert found.parent_of("robot2/base_link") == "robot2/odom"


def test_check_and_gaps_use_the_selection(tool: Tool, tmp_path: Path) -> None:
    path = record(tmp_path / "a.bag", {("map", "base"): [*range(10), *range(30, 40)]})  # type: ignore[dict-item]
    (gap,) = tool("gaps", path, "--prefix", "r1/", "--json").json["gaps"]
    assert (gap["frame"], gap["parent"]) == ("r1/base", "r1/map")
    (finding,) = tool("check", path, "--prefix", "r1/", "--json", code=1).json["findings"]
    assert finding["frames"] == ["r1/base"]
    assert tool("gaps", path, "--start", "3", "--json").json["gaps"] == []
    assert tool("check", path, "--start", "3", "--json").json["findings"] == []


@pytest.mark.parametrize(
    "options",
    [
        ["--start", "+0.5"],
        ["--end", "-0.5"],
        ["--keep", "0.3"],
        ["--frame", "cup"],
        ["--frame", "base", "--frame", "cup"],
        ["--exclude", "cup"],
        ["--topic", "/robot/tf"],
        ["--rename", "cup:=mug"],
    ],
)
def test_options_see_all_files_as_one_recording(
    tool: Tool, tmp_path: Path, options: list[str]
) -> None:
    one = record(tmp_path / "a.bag", {("map", "base"): range(9)}, {("base", "cam"): 1})
    other = tmp_path / "b.mcap"
    with RecordingWriter(other) as writer:
        for i in range(5, 14):
            stamp = S + i * S // 10
            cup = tfdb.TransformStamped("table", "cup", stamp, (i, 1, 2), TURN)
            data = tfdb.encode_tf_message([cup], writer.encoding)
            writer.write(data, stamp, topic="/robot/tf", static=False)
    merged, converted = tmp_path / "merged.mcap", tmp_path / "converted.mcap"
    tool("merge", one, other, "-o", merged, *options)
    tool("convert", one, other, converted, *options)
    found, expected = tfdb.load(merged), tfdb.load(converted)
    assert found.tree() == expected.tree()
    for frame in expected.frames():
        assert np.array_equal(found.samples(frame)[1], expected.samples(frame)[1])
    if options[0] in ("--start", "--end", "--keep"):
        out = tmp_path / "apart.mcap"
        tool("merge", one, other, "-o", out, "--prefix", "l/", "--prefix", "r/", *options)
        apart = {info.name.partition("/")[2]: info for info in tfdb.load(out).tree()}
        for info in expected.tree():
            assert apart[info.name].oldest == info.oldest
            assert apart[info.name].samples == info.samples


def test_poses_and_joints_may_be_in_one_of_the_files(tool: Tool, tmp_path: Path) -> None:
    moving = record(tmp_path / "a.mcap", {("map", "base"): range(9)})
    track = tmp_path / "track.tum"
    track.write_text("1.05 1 2 3 0 0.6 0 0.8\n1.15 2 2 3 0 0.6 0 0.8\n")
    said = tool("merge", moving, track, "-o", tmp_path / "o.bag", "--frame", "lost", code=2).error
    assert "frame 'lost' does not exist" in said
    said = tool("merge", moving, track, "-o", tmp_path / "o.bag", "--topic", "/no", code=2).error
    assert f"{moving}, {track}: no topic '/no'" in said
    said = tool("merge", moving, track, "-o", tmp_path / "o.bag", "--start", "9", code=2).error
    assert "nothing to merge" in said
    assert not (tmp_path / "o.bag").exists()


def test_a_file_of_which_nothing_is_merged_is_named(tool: Tool, tmp_path: Path) -> None:
    one = record(tmp_path / "a.mcap", {("map", "base"): range(9)})
    other = record(tmp_path / "b.mcap", {("table", "cup"): range(9)})
    ran = tool("merge", one, other, "-o", tmp_path / "both.mcap", "--exclude", "cup")
    assert f"tfdb: warning: {other}: none of its transforms is merged" in ran.err


def test_a_name_of_one_file_is_known_in_the_others(tool: Tool, tmp_path: Path) -> None:
    one = record(tmp_path / "a.mcap", {("map", "base"): range(9), ("base", "arm"): range(9)})
    other = record(tmp_path / "b.mcap", {("table", "cup"): range(9)})
    prefixes = "--prefix", "a/", "--prefix", "b/"
    given = (one, other, "-o", tmp_path / "o.mcap", *prefixes, "--overwrite")
    assert tool("merge", *given, "--exclude", "arm", "--rename", "table:=desk").err == ""
    ran = tool("merge", *given, "--exclude", "am", "--rename", "desk:=table")
    assert ran.err.splitlines() == [
        f"tfdb: warning: exclude: no frame, topic or node of {one}, {other} matches 'am'; "
        "did you mean 'arm'?",
        f"tfdb: warning: rename: no frame of {one}, {other} is called 'desk'",
    ]


def test_a_new_name_joins_the_root_of_one_file_to_another(tool: Tool, tmp_path: Path) -> None:
    one = record(tmp_path / "a.mcap", {("map", "base"): range(9)})
    other = record(tmp_path / "b.mcap", {("world", "body"): range(9)})
    out = tmp_path / "both.mcap"
    tool("merge", one, other, "-o", out, "--rename", "world:=map")
    found, alone = tfdb.load(out), tfdb.load(other)
    assert {info.name: info.parent for info in found.tree()} == {
        "map": None,
        "base": "map",
        "body": "map",
    }
    assert np.array_equal(
        found.lookup_transform("map", "body", 1_450_000_000).matrix,
        alone.lookup_transform("world", "body", 1_450_000_000).matrix,
    )
    bad = tmp_path / "bad.mcap"
    for pair in ("body:=base", "base:=body"):  # both have a parent
        error = tool("merge", one, other, "-o", bad, "--rename", pair, code=2).error
        assert f"'base' and 'body' would both be called {pair.partition(':=')[2]!r}" in error
    same = record(tmp_path / "c.mcap", {("world", "map"): range(9)})
    error = tool("merge", one, same, "-o", bad, "--rename", "world:=map", code=2).error
    assert "'map' and 'world' would both be called 'map'" in error


def test_one_frame_is_not_given_two_names(tool: Tool, tmp_path: Path) -> None:
    one = record(tmp_path / "a.mcap", {("map", "base"): range(9)})
    names = "--rename", "map:=a", "--rename", "map:=b"
    assert (
        "'map' has two new names"
        in tool("rename", one, "-o", tmp_path / "b.mcap", *names, code=2).error
    )
    topics = "--pose-topic", "/odom=a", "--pose-topic", "/odom=b"
    assert "'/odom' has two frames" in tool("info", one, *topics, code=2).error
    with pytest.raises(tfdb.InvalidArgument, match="'map' has two new names"):
        tfdb.load(one, rename={"map": "a", "/map": "b"})

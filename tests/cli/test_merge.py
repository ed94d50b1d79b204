"""`tfdb merge` and `tfdb rename`: recordings in one, and with other names."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb
from tfdb.io import Recording, RecordingWriter

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool

S = 1_000_000_000
TURN = (0.0, 0.6, 0.0, 0.8)


def record(
    path: Path,
    moving: dict[tuple[str, str], range],
    static: dict[tuple[str, str], float] | None = None,
    publisher: str = "/who",
) -> Path:
    """Edges with stamps in tenths of a second, and static edges with their x."""
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
    assert f"{one} and {other} both write T[map<-base] from 1.500000000 to 1.900000000" in said
    assert "and 1 more edges" in said
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


def test_parts_that_follow_one_another_are_merged(tool: Tool, tmp_path: Path) -> None:
    parts = [
        record(tmp_path / f"{i}.bag", {("map", "base"): range(i, i + 10)}, {("base", "cam"): 1})
        for i in (10, 0)
    ]
    out = tmp_path / "whole.bag"
    tool("merge", *parts, "-o", out)
    assert len(tfdb.load(out).samples("base")[0]) == 20


def test_what_contradicts_itself_is_refused(tool: Tool, tmp_path: Path) -> None:
    moving = record(tmp_path / "a.bag", {("map", "base"): range(10)}, {("base", "cam"): 1})
    out = tmp_path / "out.bag"
    for other, words in (
        (record(tmp_path / "b.bag", {}, {("base", "cam"): 2}), "have another static T[base<-cam]"),
        (record(tmp_path / "c.bag", {}, {("map", "base"): 2}), "as static and as moving"),
        (record(tmp_path / "d.bag", {}, {("cam", "map"): 2}), "together make a cycle, "),
    ):
        assert words in tool("merge", moving, other, "-o", out, code=2).error
        assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("a",), "nothing to merge"),
        (("a", "b", "--prefix", "x/"), "2 files, 1 prefixes"),
        (("a", "none.bag"), "no such file"),
        (("a", "a"), "both write T[map<-a]"),
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
    assert "ends in none of" in tool("merge", *files.values(), "-o", "x.tum", code=2).error
    assert "one of the files" in tool("merge", *files.values(), "-o", files["a"], code=2).error


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
        (("--rename", "mapp:=world"), "did you mean 'map'?"),
        (("--rename", "map=world"), "FROM:=TO"),
        (("--rename", "map:=odom"), "would both be called 'odom'"),
    ],
)
def test_misuse_of_rename(
    tool: Tool, tmp_path: Path, bag: Path, arguments: tuple[str, ...], words: str
) -> None:
    out = tmp_path / "out.bag"
    assert words in tool("rename", bag, "-o", out, *arguments, code=2).error
    assert not out.exists()


def test_check_and_gaps_look_at_what_was_chosen(tool: Tool, tmp_path: Path) -> None:
    path = record(tmp_path / "a.bag", {("map", "base"): [*range(10), *range(30, 40)]})  # type: ignore[dict-item]
    (gap,) = tool("gaps", path, "--prefix", "r1/", "--json").json["gaps"]
    assert (gap["frame"], gap["parent"]) == ("r1/base", "r1/map")
    (finding,) = tool("check", path, "--prefix", "r1/", "--json", code=1).json["findings"]
    assert finding["frames"] == ["r1/base"]
    assert tool("gaps", path, "--start", "3", "--json").json["gaps"] == []
    assert tool("check", path, "--start", "3", "--json").json["findings"] == []

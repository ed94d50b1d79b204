"""`tfdb convert`: the same transforms in another file."""

from __future__ import annotations

import shutil
from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb
from tfdb.recordings import Recording, RecordingWriter

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool


def same(one: tfdb.Buffer, other: tfdb.Buffer) -> None:
    assert one.frames() == other.frames()
    for name in one.frames():
        info = one.frame_info(name)
        if info.parent is None:
            continue
        assert info.is_static == other.frame_info(name).is_static
        for mine, theirs in zip(one.samples(name), other.samples(name), strict=True):
            assert np.array_equal(mine, theirs)


def arrivals(path: Path) -> list[tuple[str, int]]:
    with Recording(path) as recording:
        return [(source.topic, received) for source, received, _ in recording.messages()]


@pytest.mark.parametrize("suffix", [".mcap", ".bag", ".db3"])
@pytest.mark.parametrize("name", ["pr2.bag", "pr2.mcap"])
def test_there_and_back(tool: Tool, bag: Path, tmp_path: Path, name: str, suffix: str) -> None:
    source = bag.with_name(name)
    out, back = tmp_path / f"out{suffix}", tmp_path / f"back{source.suffix}"
    body = tool("convert", source, out, "--json").json
    assert set(body) == {
        "tfdb",
        "command",
        "files",
        "output",
        "messages",
        "transforms",
        "refused_transforms",
        "skipped",
    }
    assert (body["messages"], body["transforms"], body["skipped"]) == (750, 7180, 0)
    tool("convert", out, back)
    original = tfdb.load(source)
    same(original, tfdb.load(out))
    same(original, tfdb.load(back))
    assert sorted(arrivals(source)) == sorted(arrivals(out)) == sorted(arrivals(back))


def test_compressed(tool: Tool, bag: Path, tmp_path: Path) -> None:
    small, large = tmp_path / "small.mcap", tmp_path / "large.mcap"
    tool("convert", bag, large)
    tool("convert", bag, small, "--compress")
    assert small.stat().st_size < large.stat().st_size / 2
    same(tfdb.load(small), tfdb.load(large))
    for arguments in (["x.rrd"], ["x.tum", "--frames", "map", "base_link"]):
        said = tool("convert", bag, *arguments, "--compress", code=2).error
        assert "--compress is valid for recordings only" in said


def test_publishers_are_kept_where_the_file_can_hold_them(
    tool: Tool, bag: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.bag"
    tool("convert", bag, out)
    assert tfdb.load(out).frame_info("odom").authority == "/localization"


def test_trajectory(tool: Tool, mcap: Path, tmp_path: Path) -> None:
    out = tmp_path / "base.tum"
    said = tool("convert", mcap, out, "--frames", "map", "base_link").out
    path = tfdb.load(mcap).trajectory("map", "base_link")
    assert f"{len(path.stamps)} poses of base_link in map" in said
    rows = [line for line in out.read_text().splitlines() if not line.startswith("#")]
    assert len(rows) == len(path.stamps)


def test_renamed_topics(tool: Tool, mcap: Path, tmp_path: Path) -> None:
    out = tmp_path / "robot1.mcap"
    options = ("--topic", "/tf:/robot1/tf", "--topic", "/tf_static:/robot1/tf_static")
    tool("convert", mcap, out, *options)
    assert {topic for topic, _ in arrivals(out)} == {"/robot1/tf", "/robot1/tf_static"}
    same(tfdb.load(mcap), tfdb.load(out))


def test_real_robot(tool: Tool, shared_data: Path, tmp_path: Path) -> None:
    bag = shared_data / "panda" / "rosbagFrankaPanda.bag"
    out = tmp_path / "panda.mcap"
    tool("convert", bag, out)
    same(tfdb.load(bag), tfdb.load(out))
    assert out.stat().st_size < bag.stat().st_size


def test_existing_file_stays(tool: Tool, mcap: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.bag"
    out.write_text("precious")
    said = tool("convert", mcap, out, code=2).error
    assert "--overwrite" in said
    assert out.read_text() == "precious"
    tool("convert", mcap, out, "--overwrite")
    assert out.read_bytes().startswith(b"#ROSBAG")


@pytest.mark.parametrize("overwrite", [(), ("--overwrite",)])
def test_an_input_is_never_the_output(
    tool: Tool, bag: Path, tmp_path: Path, overwrite: tuple[str, ...]
) -> None:
    source, hard, soft = (tmp_path / f"{name}.bag" for name in ("source", "hard", "soft"))
    shutil.copy(bag, source)
    hard.hardlink_to(source)
    soft.symlink_to(source.name)
    (tmp_path / "door").symlink_to(tmp_path)
    before = source.read_bytes()
    for out in (source, hard, soft, tmp_path / "door" / "source.bag"):
        said = tool("convert", source, out, *overwrite, code=2).error
        assert said == f"{out} is also an input; choose another name"
        assert source.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 4


def test_a_part_of_the_input_is_never_the_output(
    tool: Tool, shared_data: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "drive"
    shutil.copytree(shared_data / "turtlebot_nav" / "tf_example", folder)
    part = folder / "tf_example.db3"
    before = part.read_bytes()
    assert "also an input" in tool("convert", folder, part, "--overwrite", code=2).err
    assert part.read_bytes() == before


def test_poses_replace_nothing_unasked(tool: Tool, mcap: Path, tmp_path: Path) -> None:
    out = tmp_path / "base.tum"
    arguments = ("poses", mcap, "map", "base_link", "-o", out)
    tool(*arguments)
    before = out.read_text()
    assert "--overwrite replaces it" in tool(*arguments, "--rate", "1", code=2).error
    assert out.read_text() == before
    tool(*arguments, "--rate", "1", "--overwrite")
    assert out.read_text() != before
    said = tool(*arguments, "--at", out, "--overwrite", code=2).error
    assert "also an input" in said


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("out.doc",), "must end in .bag"),
        (
            ("out.kitti", "--frames", "map", "odom"),
            "give --format kitti and a name that ends in .txt, such as ",
        ),
        (("out.tum",), "--frames TARGET SOURCE"),
        (("out.bag", "--frames", "map", "odom"), "--frames TARGET SOURCE"),
        (("out.bag", "--topic", "/none"), "/tf_static"),
        (("out.tum", "--frames", "map", "odm"), "'odom'"),
    ],
)
def test_refused(
    tool: Tool, mcap: Path, tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    out, *options = arguments
    assert words in tool("convert", mcap, tmp_path / out, *options, code=2).error
    assert list(tmp_path.iterdir()) == []


def test_frames_of_a_trajectory(tool: Tool, tmp_path: Path) -> None:
    path, bag = tmp_path / "k00.tum", tmp_path / "few.bag"
    path.write_text("1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n")
    assert "2 poses of body in world" in tool("convert", path, tmp_path / "k00.csv").out
    with RecordingWriter(bag) as writer:
        edges = [tfdb.TransformStamped("map", each, 1, (1, 0, 0)) for each in ("odom", "gps")]
        writer.write(tfdb.encode_tf_message(edges, writer.encoding), 1, topic="/tf")
    said = tool("convert", bag, tmp_path / "few.tum", code=2).error
    assert "name its --frames TARGET SOURCE; the frames are 'gps', 'map', 'odom'" in said
    assert not (tmp_path / "few.tum").exists()

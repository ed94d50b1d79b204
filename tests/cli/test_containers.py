"""Commands on files of other programs: Foxglove's transforms, renamed files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import tfdb

CASES = Path(__file__).parents[1] / "cases"
LAST = 1_700_000_000_980_000_000
NO_TIME = (
    "50 transforms of topic '/transforms' have no timestamp and get the log time of their message"
)


def export(path: Path) -> tfdb.Buffer:
    """Write a moving and a static edge as `to_foxglove` does."""
    pytest.importorskip("foxglove")
    buf = tfdb.Buffer(history=None)
    for at in range(20):
        buf.set_transform("odom", "base", at * 10**8, (0.1 * at, 2, 3), (0.6, 0, 0, 0.8))
    buf.set_static_transform("base", "eye", (0.1, 0.2, 0.3), (0, 0.6, 0, 0.8))
    tfdb.to_foxglove(buf, path, topic="/robot/poses")
    return buf


def same(found: tfdb.Buffer, expected: tfdb.Buffer) -> None:
    assert found.frame_info("eye").is_static
    pose = expected.lookup_transform("odom", "eye", 150_000_000).matrix
    assert abs(found.lookup_transform("odom", "eye", 150_000_000).matrix - pose).max() < 1e-12
    assert len(found.samples("base")[0]) == 20


@pytest.mark.parametrize("name", ["pb_FrameTransform", "json_FrameTransforms", "json_iso"])
def test_every_command_reads_them(tool: Any, tmp_path: Path, name: str) -> None:
    path = CASES / f"{name}.mcap"
    assert tool("info", path, "--json").json["transforms"] == 50
    assert tool("check", path, "--json").json["findings"] == []
    assert "base_link" in tool("tree", path).out
    found = tool("lookup", path, "odom", "base_link", "--json").json
    assert found["translation"] == [0.98, 0, 0]
    assert "base_link" in tool("monitor", path).out
    store = f"foxglove-{tmp_path.name}"
    try:
        tool("play", path, "--into", store, "--speed", "inf", "--history", 100)
        stamps, poses, _ = tfdb.Buffer.open(store, mode="r").samples("base_link")
        assert (len(stamps), int(stamps[-1]), poses[-1, 0]) == (50, LAST, 0.98)
    finally:
        tfdb.Buffer.unlink(store)


@pytest.mark.parametrize("command", ["convert", "merge"])
@pytest.mark.parametrize("end", ["bag", "mcap", "db3"])
def test_they_become_messages_of_tf(tool: Any, tmp_path: Path, command: str, end: str) -> None:
    """The topics are /tf and /tf_static of their old namespace."""
    expected = export(tmp_path / "in.mcap")
    out = tmp_path / f"out.{end}"
    other = [CASES / "json_iso.mcap"] if command == "merge" else []
    tool(command, tmp_path / "in.mcap", *other, *(["-o"] if command == "merge" else []), out)
    same(tfdb.load(out, topics=("/robot/tf", "/robot/tf_static")), expected)
    if other:
        assert tfdb.load(out, topics="/tf").frames() == ["base_link", "odom"]


def test_a_missing_time_is_reported(tool: Any, tmp_path: Path) -> None:
    path = CASES / "pb_notime.mcap"
    for command in (("info", path), ("convert", path, tmp_path / "a.bag")):
        assert NO_TIME in tool(*command).err
    (finding,) = tool("check", path, "--json", code=1).json["findings"]
    assert (finding["kind"], finding["severity"], finding["count"]) == ("no-time", "warning", 50)
    assert "/transforms" in finding["message"]
    assert "no-time" in tool("check", path, code=1).out
    assert len(tfdb.load(tmp_path / "a.bag").samples("base_link")[0]) == 50


def test_a_renamed_part_is_reported(tool: Any, tmp_path: Path) -> None:
    """If the metadata of a folder names other files, each command prints one warning."""
    folder = CASES / "d_renamed"
    words = "names are missing: d_good.db3; other.db3 is read instead"
    for command in (
        ("info", folder),
        ("tree", folder),
        ("monitor", folder),
        ("convert", folder, tmp_path / "a.bag"),
        (
            "merge",
            folder,
            CASES / "json_iso.mcap",
            "--prefix",
            "a/",
            "--prefix",
            "b/",
            "-o",
            tmp_path / "b.bag",
        ),
    ):
        assert tool(*command).err.count(words) == 1, command
    (finding,) = tool("check", folder, "--json", code=1).json["findings"]
    assert (finding["kind"], finding["severity"]) == ("container", "warning")
    assert words in finding["message"]


def test_the_shell_completes_their_frames(tool: Any) -> None:
    from tfdb.cli.common import _example_frames

    assert _example_frames(str(CASES / "json_iso.mcap")) == {"odom", "base_link"}

"""Commands on files, or groups of topics, that disagree on an edge."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

import tfdb

from .test_groups import ROBOTS

if TYPE_CHECKING:
    from pathlib import Path

    from .conftest import Tool

START = 1_700_000_000_000_000_000
TURN = (0.0, 0.6, 0.0, 0.8)


def record(
    path: Path, x: float = 0.0, *, topic: str = "/tf", prefix: str = "", first: int = 0
) -> Path:
    """Record an edge that moves 0.1 m per 20 ms: 50 samples from `first` on."""
    with tfdb.recordings.RecordingWriter(path) as writer:
        write(writer, x, topic=topic, prefix=prefix, first=first)
    return path


def write(
    writer: tfdb.recordings.RecordingWriter,
    x: float,
    *,
    topic: str,
    prefix: str = "",
    first: int = 0,
) -> None:
    for row in range(first, first + 50):
        stamp = START + row * 20_000_000
        pose = (x + 0.1 * row, 2.0, 3.0)
        one = tfdb.TransformStamped(f"{prefix}odom", f"{prefix}base", stamp, pose, TURN)
        data = tfdb.encode_tf_message([one], writer.encoding)
        writer.write(data, stamp, topic=topic, static=False)


@pytest.fixture
def runs(tmp_path: Path) -> tuple[Path, Path]:
    return record(tmp_path / "a.mcap"), record(tmp_path / "b.mcap", 50.0)


@pytest.mark.parametrize(
    ("command", "more"),
    [
        (("lookup", "odom", "base", "+0.5"), "--with"),
        (("poses", "odom", "base"), "--with"),
        (("plot", "trajectory", "odom", "base", "--save", "png"), "--with"),
        (("play", "--into", "mixed-files", "--speed", "inf"), ""),
        (("merge", "-o", "out.mcap"), ""),
    ],
    ids=lambda each: each[0] if isinstance(each, tuple) else "",
)
def test_commands_that_answer_refuse_files_that_contradict(
    command: tuple[str, ...],
    more: str,
    runs: tuple[Path, Path],
    tool: Tool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    one, other = runs
    monkeypatch.chdir(one.parent)
    begin = 2 if command[0] == "serve" else 1
    second = (more, other) if more else (other,)
    files = (one, *second) if more == "" else (one,)
    rest = () if more == "" else second
    error = tool(*command[:begin], *files, *command[begin:], *rest, code=2).error
    assert str(one) in error
    assert str(other) in error
    assert "--prefix" in error
    assert sorted(one.parent.iterdir()) == [one, other]


@pytest.mark.parametrize("out", ["out.mcap", "out.tum", "out.tfdb"])
def test_commands_that_write_refuse_files_that_contradict(
    out: str, runs: tuple[Path, Path], tool: Tool, tmp_path: Path
) -> None:
    path = tmp_path / out
    commands = {
        "out.mcap": ("convert", *runs, path),
        "out.tum": ("convert", *runs, path, "--frames", "odom", "base"),
        "out.tfdb": ("freeze", *runs, "-o", path),
    }
    assert "2 files state different transforms of base" in tool(*commands[out], code=2).error
    assert not path.exists()
    tool(*commands[out], "--mix")
    assert path.exists()


def test_the_error_as_json_has_the_files(runs: tuple[Path, Path], tool: Tool) -> None:
    command = ("lookup", runs[0], "odom", "base", "+0.5", "--with", runs[1], "--json")
    error = tool(*command, code=2).json["error"]
    assert error["type"] == "MixedSources"
    assert error["fields"]["groups"] == {str(path): ["/tf"] for path in runs}
    mixed = tool(*command, "--mix").json
    assert mixed["translation"][0] == pytest.approx(52.5)


def test_files_that_follow_one_another_load(tool: Tool, tmp_path: Path) -> None:
    one, other = record(tmp_path / "a.mcap"), record(tmp_path / "b.mcap", first=40)
    found = tool("lookup", one, "odom", "base", "+1.7", "--with", other, "--json").json
    assert found["translation"][0] == pytest.approx(8.5)
    assert tool("info", one, other, "--json").json["mixed"] is None


LISTINGS = (("info",), ("tree",), ("gaps",), ("view-frames", "-o", "-"))


@pytest.mark.parametrize("command", LISTINGS, ids=lambda each: each[0])
def test_commands_that_list_show_files_that_contradict_with_a_warning(
    command: tuple[str, ...], runs: tuple[Path, Path], tool: Tool
) -> None:
    done = tool(command[0], *runs, *command[1:])
    assert "2 files state different transforms of base" in done.err
    assert "Shown here: all in one tree, as by --mix" in done.err
    assert done.out
    assert tool(command[0], *runs, *command[1:], "--mix").err == ""


@pytest.mark.parametrize("command", LISTINGS, ids=lambda each: each[0])
def test_commands_that_list_show_groups_apart_with_a_warning(
    command: tuple[str, ...], tool: Tool
) -> None:
    done = tool(command[0], ROBOTS, *command[1:])
    assert "2 groups of topics state different transforms" in done.err
    assert "Shown here: each group under its own prefix, as by --by-namespace" in done.err


@pytest.mark.parametrize("kind", ["tree", "timeline"])
def test_pictures_of_all_frames_show_disagreeing_groups_with_a_warning(
    kind: str, runs: tuple[Path, Path], tool: Tool, tmp_path: Path
) -> None:
    out = tmp_path / "out.png"
    done = tool("plot", ROBOTS, kind, "--save", out)
    assert "Shown here: each group under its own prefix" in done.err
    done = tool("plot", runs[0], kind, "--with", runs[1], "--save", out, "--overwrite")
    assert "Shown here: all in one tree" in done.err


@pytest.mark.parametrize("command", [*LISTINGS, ("check",)], ids=lambda each: each[0])
@pytest.mark.parametrize("options", [(), ("--by-namespace",)], ids=["", "by namespace"])
def test_groups_with_colliding_prefixes_are_shown_in_one_tree(
    command: tuple[str, ...], options: tuple[str, ...], tool: Tool, tmp_path: Path
) -> None:
    path = tmp_path / "collision.mcap"
    with tfdb.recordings.RecordingWriter(path) as writer:
        write(writer, 0.0, topic="/tf", prefix="robot1/")
        write(writer, 4.0, topic="/robot1/tf")
        write(writer, 8.0, topic="/tf")
    if command[0] == "check":
        found = tool("check", path, *options, "--json", code=1).json["findings"]
        (mixed,) = (each for each in found if each["kind"] == "mixed-sources")
        assert "examined here all in one tree, as by --mix" in mixed["message"]
        return
    done = tool(command[0], path, *command[1:], *options)
    assert "Shown here: all in one tree, as by --mix" in done.err
    assert done.out


def test_check_finds_files_that_contradict(runs: tuple[Path, Path], tool: Tool) -> None:
    found = tool("check", *runs, "--json", code=1).json["findings"]
    (mixed,) = (each for each in found if each["kind"] == "mixed-sources")
    assert mixed["frames"] == ["base"]
    assert mixed["details"]["groups"] == {str(path): ["/tf"] for path in runs}
    assert mixed["message"] == (
        f"2 files state different transforms: {runs[0]}; {runs[1]}; examined here all in one "
        "tree, as by --mix"
    )

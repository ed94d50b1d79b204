"""Suggestions for mistyped words and words of other programs; names that look like options."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import click
import pytest

import tfdb
from tfdb.cli import checkout_only
from tfdb.cli.app import COMMANDS, cli
from tfdb.cli.groups import OneOf

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from conftest import Tool

SECOND = 10**9


def all_commands(
    group: click.Group, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    context = click.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        assert command is not None
        if isinstance(command, click.Group):
            yield from all_commands(command, (*path, name))
        elif name not in checkout_only.COMMANDS:
            yield (*path, name), command


ALL = list(all_commands(cli))


@pytest.mark.parametrize(("path", "command"), ALL, ids=lambda each: str(each)[:30])
def test_each_option_that_is_mistyped_gets_the_nearest(
    tool: Tool, path: tuple[str, ...], command: click.Command
) -> None:
    for option in command.params:
        for name in option.opts if isinstance(option, click.Option) else ():
            if not name.startswith("--") or len(name) < 6:
                continue
            wrong = name[:-2] + name[-1] + name[-2]  # two letters are swapped
            if wrong == name:
                wrong = name + "x"
            said = tool(*path, wrong, code=2).error
            assert said.startswith(f"No such option '{wrong}'; did you mean "), said
            assert f" {name}" in said, said


@pytest.mark.parametrize(("path", "command"), ALL, ids=lambda each: str(each)[:30])
def test_each_choice_suggests(path: tuple[str, ...], command: click.Command) -> None:
    for param in command.params:
        if isinstance(param.type, click.Choice):
            assert isinstance(param.type, OneOf), (path, param.name)


def test_a_kind_of_plot_that_is_mistyped_gets_the_nearest(tool: Tool, bag: Path) -> None:
    assert "did you mean 'tree'?" in tool("plot", bag, "treee", code=2).error
    assert "did you mean 'timeline'?" in tool("plot", bag, "timline", code=2).error
    said = tool("plot", bag, "trajectory", "map", "base_link", "--axes", "xq", code=2).error
    assert said.startswith("Invalid value for '--axes': 'xq' is not one of ")


def test_help_and_version_are_words(tool: Tool, monkeypatch: pytest.MonkeyPatch) -> None:
    assert tool("help").out == tool("--help").out
    assert tool("help", "lookup").out == tool("lookup", "--help").out
    assert tool("help", "shm", "rm").out == tool("shm", "rm", "--help").out
    assert tool("version").out == tool("--version").out == f"tfdb {tfdb.__version__}\n"
    assert "did you mean 'lookup'?" in tool("help", "lokup", code=2).error
    assert "'version'" in tool("versoin", code=2).error
    assert "'help'" in tool("hlep", code=2).error


def test_a_file_that_is_mistyped_gets_the_nearest(tmp_path: Path, tool: Tool) -> None:
    (tmp_path / "drive.mcap").write_bytes(b"")
    wrong, right = tmp_path / "dirve.mcap", tmp_path / "drive.mcap"
    said = f"{wrong}: no such file; did you mean {right}?"
    assert tool("info", wrong, code=2).error == said
    for read in (
        tfdb.load,
        tfdb.recordings.Recording,
        tfdb.Trajectory.read,
        tfdb.robots.load_urdf,
        lambda path: tfdb.Trajectory.read(path, target="a", source="b"),
        lambda path: tfdb.compare(path, path),
    ):
        with pytest.raises(FileNotFoundError, match="no such file; did you mean") as refused:
            read(wrong)
        assert str(right) in str(refused.value)
        assert refused.value.filename == str(wrong)
    with pytest.raises(FileNotFoundError, match="missing folder"):
        tfdb.load(tmp_path / "runs" / "drive.mcap")


def test_the_name_of_a_shared_store_without_its_prefix(tool: Tool) -> None:
    name = f"test-mistyped-{os.getpid()}"
    with tfdb.Buffer.open(name, create=True):
        said = tool("tree", name, code=2).error
    tfdb.Buffer.unlink(name)
    assert said == f"{name}: no such file; the shared store of this name is shm:{name}"


@pytest.mark.parametrize("command", ["tree", "monitor"])
def test_the_name_of_no_graph(tool: Tool, command: str) -> None:
    said = tool(command, "ros2+cyclone:7", code=2).error
    assert said == "ros2+cyclone:7: no such graph; give ros1:, ros2:, ros2+zenoh: or ros2+dds:"


@pytest.fixture
def odd(tmp_path: Path) -> Path:
    store = tfdb.Buffer()
    for i in range(3):
        store.set_transform("map", "-dash", i * SECOND, (i, 2, 3), (0, 0, 0.6, 0.8))
        store.set_transform("map", "--help-desk", i * SECOND, (0, i, 1), (0, 0, 0, 1))
    file = tmp_path / "odd.tfdb"
    store.freeze(file)
    return file


def test_frames_that_begin_with_a_dash(tool: Tool, odd: Path) -> None:
    expected = tool("lookup", odd, "--json", "--", "map", "-dash").json
    assert expected["translation"] == [2, 2, 3]
    assert tool("lookup", odd, "map", "-dash", "--json").json == expected
    assert tool("lookup", "--json", odd, "map", "-dash").json == expected
    there = tool("lookup", odd, "-dash", "map", "-0.5", "--json").json
    assert (there["target"], there["stamp_ns"]) == ("-dash", 15 * 10**8)
    assert tool("poses", odd, "map", "-dash").out.count("\n") == 3
    assert "Translation: [2.000, 2.000, 3.000]" in tool("echo", odd, "map", "-dash").out
    tool("plot", odd, "trajectory", "map", "-dash", "--save", odd.with_suffix(".png"))
    assert odd.with_suffix(".png").exists()
    assert "frame '-dish' does not exist; did you mean '-dash'?" in tool(
        "lookup", odd, "map", "-dish", code=2
    ).error  # fmt: skip


def test_a_name_that_is_like_an_option_is_one(tool: Tool, odd: Path) -> None:
    said = tool("lookup", odd, "map", "--hlep", code=2).error
    assert "No such option '--hlep'; did you mean --help?" in said
    assert tool("lookup", odd, "--json", "--", "map", "--help-desk").json["translation"] == [
        0,
        2,
        1,
    ]
    said = tool("lookup", odd, "map", "-dash", "-x", code=2).error
    assert "No such option '-x'; a name that begins with a dash must come after --" in said
    assert "No such option '-odd'" in tool("info", "-odd", code=2).error
    assert "after --" not in tool("info", "-odd", code=2).error


def test_a_short_option_with_its_value_may_be_a_frame(tool: Tool, bag: Path) -> None:
    hint = "a name that begins with a dash, such as -odd, must come after --"
    for command in ("poses", "echo"):
        said = tool(command, bag, "map", "-odd", code=2).error
        assert hint in said
        assert said.endswith(f" {command} --help'")
    assert "must come after --" not in tool("poses", bag, "map", code=2).error
    assert (
        "must come after --" not in tool("echo", bag, "map", "base_link", "-o", "dd", code=2).error
    )
    assert "frame '-odd' does not exist" in tool("poses", bag, "--", "map", "-odd", code=2).error


@pytest.mark.parametrize(
    ("arguments", "right"),
    [
        (("lookup", "map", "base_link", "--policy", "exat"), "exact"),
        (("lookup", "map", "base_link", "--policy", "nearst:0.5"), "nearest"),
        (("lookup", "map", "base_link", "latst"), "latest"),
        (("poses", "map", "base_link", "--at", "x", "--policy", "previus"), "previous"),
        (("plot", "tree", "--save", "pgn"), "png"),
        (("plot", "tree", "--save", "sgv"), "svg"),
        (("poses", "map", "base_link", "-o", "x.kiti", "--format", "kiti"), "kitti"),
        (("poses", "map", "base_link", "-o", "x.parqet"), ".parquet"),
        (("convert", "x.mcpa"), ".mcap"),
    ],
)
def test_a_word_that_is_mistyped_gets_the_nearest(
    tool: Tool, bag: Path, arguments: tuple[str, ...], right: str
) -> None:
    said = tool(arguments[0], bag, *arguments[1:], code=2).error
    assert f"did you mean '{right}'?" in said


def test_an_engine_that_is_mistyped_gets_the_nearest(tool: Tool) -> None:
    said = tool("bench", "--engines", "snapshot,silos", code=2).error
    assert "did you mean 'silo'?" in said
    assert "did you mean 'threads'?" in tool("bench", "--sweep", "thread", code=2).error


def test_the_version_as_json(tool: Tool) -> None:
    assert tool("version", "--json").json == {
        "tfdb": 1, "command": "version", "version": tfdb.__version__
    }  # fmt: skip


def test_help_is_text_only(tool: Tool) -> None:
    assert tool("help", "help").out == tool("help").out
    assert "--help ignores --json." in tool("help").out
    assert "help has no --json" in tool("help", "--json", code=2).error
    assert "help has no --json" in tool("help", "lookup", "--json", code=2).error
    assert "'tfdb shm ls --json'" in " ".join(tool("shm", "--help").out.split())


def test_commands_of_a_checkout_are_hidden_in_a_wheel(
    tool: Tool, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "\n  bench " in tool("--help").out
    monkeypatch.setattr(checkout_only, "installed", lambda: False)
    shown = tool("--help").out
    assert not [name for name in checkout_only.COMMANDS if f"\n  {name} " in shown]
    left = [name for name in COMMANDS if name not in checkout_only.COMMANDS]
    assert cli.list_commands(click.Context(cli)) == left


@pytest.mark.parametrize("at", ["stamps", "rate"])
def test_poses_without_a_file_are_in_the_json(tool: Tool, bag: Path, at: str) -> None:
    asked = ("poses", bag, "map", "base_link", *(("--rate", 10) if at == "rate" else ()))
    body = tool(*asked, "--json").json
    lines = [line.split() for line in tool(*asked).out.splitlines()]
    assert body["output"] is None
    assert body["poses"] == len(lines) == len(body["stamps_ns"]) > 2
    assert [f"{ns // SECOND}.{ns % SECOND:09}" for ns in body["stamps_ns"]] == [
        f"{line[0].partition('.')[0]}.{line[0].partition('.')[2]:0<9}" for line in lines
    ]
    assert body["xyz_xyzw"] == [[float(number) for number in line[1:]] for line in lines]


def test_one_is_singular(tool: Tool, tmp_path: Path) -> None:
    store = tfdb.Buffer()
    store.set_transform("map", "base", SECOND, (1, 2, 3), (0, 0, 0.6, 0.8))
    assert "2 frames, 1 edge (0 static)" in repr(store)
    store.remove_frames("base")
    store.set_static_transform("map", "base", (1, 2, 3))
    store.freeze(tmp_path / "one.tfdb")
    assert "2 frames, 0 moving and 1 static edge\n" in tool("info", tmp_path / "one.tfdb").out
    assert "1 frame " not in tool("info", tmp_path / "one.tfdb").out

"""Help texts, and suggestions for mistyped arguments."""

from __future__ import annotations

import dataclasses
import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click
import pytest

from tfdb.cli import checkout_only
from tfdb.cli.app import COMMANDS, cli
from tfdb.cli.selecting import flag_of
from tfdb.recordings import Selection

if TYPE_CHECKING:
    from collections.abc import Iterator

    from conftest import Tool


def every_command() -> Iterator[tuple[str, click.Command]]:
    context = click.Context(cli)
    for name in cli.list_commands(context):
        command = cli.get_command(context, name)
        assert command is not None
        yield name, command
        if isinstance(command, click.Group):
            for part, below in command.commands.items():
                if not below.hidden:
                    yield f"{name} {part}", below


EVERY = dict(every_command())


@pytest.mark.parametrize("name", EVERY)
def test_help_has_a_purpose_and_an_example(tool: Tool, name: str) -> None:
    usage, text = tool(*name.split(), "--help").out.split("\n\n", 1)
    assert usage.startswith("Usage: ")
    line, example, *_ = text.split("\n\n")
    assert line.startswith("  ")
    assert "\n" not in line
    assert len(line) <= 80
    assert line[-1] in ".?"
    assert COMMANDS.get(name, line.strip()) == line.strip()
    match = re.fullmatch(rf"  Example: (tfdb {name}(?: .*)?)", example)
    assert match, example
    # The example is a valid command.
    words = shlex.split(match[1])[1 + len(name.split()) :]
    command = EVERY[name]
    if isinstance(command, click.Group):
        assert words[0] in command.commands
        command, words = command.commands[words[0]], words[1:]
    with command.make_context(name, words) as context:
        assert context.args == []


READS = {
    name for name, command in EVERY.items() if "--topic" in str([p.opts for p in command.params])
}


@pytest.mark.parametrize("name", sorted(READS))
def test_options_that_select_data_have_a_title(tool: Tool, name: str) -> None:
    _, options = tool(*name.split(), "--help").out.split("Options:\n")
    others, selecting = options.split("\nSelect what is read:\n")
    assert "--json" in others
    assert "--topic" not in others
    assert not re.search(r"^  [^ -]", others, re.MULTILINE), "an argument"
    flags = set(re.findall(r"^  (--[a-z-]+)", selecting, re.MULTILINE))
    fields = {flag_of(each.name) for each in dataclasses.fields(Selection)}
    own = {"poses": {"--start", "--end"}, "merge": {"--prefix"}}.get(name, set())
    if name == "static-publisher":
        own = fields - {"--topic", "--by-namespace", "--mix"}
    assert flags == fields - own


def test_commands_that_read_recordings_are_found() -> None:
    assert {"check", "convert", "info", "merge", "monitor", "plot", "rename", "play"} <= READS


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        (("lokup",), "did you mean 'lookup'?"),
        (("frames",), "did you mean 'view-frames'?"),
        (("publisher",), "'static-publisher'"),
        (("Info",), "did you mean 'info'?"),
        (("shm", "list"), "did you mean 'ls'?"),
        (("shm", "inf"), "did you mean 'info'?"),
        (("serve", "ros3"), "'ros2' or 'ros1'?"),
        (("serve", "zzzz"), "the commands are follow, ros1, ros2"),
        (("info", "--topc", "x"), "--topic"),
    ],
)
def test_a_mistyped_command_suggests_the_nearest(
    tool: Tool, given: tuple[str, ...], meant: str
) -> None:
    said = tool(*given, code=2).error
    assert "No such" in said
    assert meant in said


def test_an_unknown_command_lists_the_commands_of_the_help(tool: Tool) -> None:
    said = tool("zzzz", code=2).error
    listed = ", ".join(cli.list_commands(click.Context(cli)))
    assert f"the commands are {listed}; see" in said, said


def test_an_offset_without_its_sign(tool: Tool, bag: Path, tmp_path: Path) -> None:
    said = tool("lookup", bag, "map", "base_link", "2.5", code=2).error
    known = re.fullmatch(
        r"T\[map<-base_link\] has no data at 2\.500000000 s; the path is valid from "
        r"\S+ to \S+ \(.* UTC\); did you mean \+2\.5, from the start\?",
        said,
    )
    assert known, said
    given = ("--start", "2.5", "--rate", "10")
    assert tool("poses", bag, "map", "base_link", *given, code=2).error == said
    # No suggestion for a time near the recording, or an offset longer than it.
    for time in ("1795240000", "12.5", "+12.5"):
        assert "did you mean" not in tool("lookup", bag, "map", "base_link", time, code=2).error
    out = tmp_path / "a.tum"
    for arguments, name in (
        (("poses", bag, "map", "base_link", "-o", out, "--start", "2.5"), "start"),
        (("tree", bag, "--at", "2.5"), "at"),
        (("info", bag, "--start", "2.5"), "start"),
        (("echo", bag, "map", "base_link", "-t", "2.5"), "time"),
    ):
        code = 2 if name == "time" else 0  # the lookup will fail
        warned = tool(*arguments, code=code).err.splitlines()[0]
        assert warned == (
            f"tfdb: warning: --{name} 2.5 is before the first moving transform; "
            "did you mean +2.5, from the start?"
        )


def test_a_time_outside_the_data_keeps_the_edge_in_the_error(tool: Tool, bag: Path) -> None:
    said = tool("lookup", bag, "map", "base_link", "+60", code=2).error
    assert "into the future: edge T[odom<-base_footprint] covers" in said
    assert "; the path is valid from " in said


def test_many_choices_are_listed_in_the_help_alone(tool: Tool) -> None:
    shown = tool("check", "--help").out
    assert "--ignore KIND " in shown
    shown = shown[shown.index("  Errors: ") : shown.index("  --for")]
    listed = set(re.findall(r"[\w-]+", re.sub(r"-\s+", "-", shown)))
    ignored = next(each for each in EVERY["check"].params if each.name == "ignore")
    assert isinstance(ignored.type, click.Choice)
    assert listed - {"Errors", "Warnings", "With", "--expect", "also"} == {*ignored.type.choices}
    said = tool("check", "x.bag", "--ignore", "gp", code=2).error
    assert "'gp' is unknown; did you mean 'gap'?" in said
    assert "'late'" in tool("check", "x.bag", "--ignore", "zzzz", code=2).error


def test_nanoseconds_without_their_unit(tool: Tool, bag: Path) -> None:
    said = tool("lookup", bag, "map", "base_link", "1795240383720679283", code=2).error
    assert "did you mean 1795240383720679283ns?" in said
    assert "write seconds" in tool("lookup", bag, "map", "base_link", "9" * 40, code=2).error


@pytest.mark.parametrize(
    ("option", "given", "near"),
    [
        ("--exclude", "base_lnk", "'base_link'"),
        ("--exclude", "/tff", "'tf'"),
        ("--rename", "base_lnk:=x", "'base_link'"),
    ],
)
def test_a_mistyped_choice_suggests_the_nearest(
    tool: Tool, bag: Path, option: str, given: str, near: str
) -> None:
    assert tool("info", bag, option, given).err.strip().endswith(f"; did you mean {near}?")


def test_a_name_without_near_ones_has_no_suggestion(tool: Tool, bag: Path) -> None:
    for given in (("--exclude", "zzzz"), ("--exclude", "base_lnk*"), ("--rename", "zzzz:=x")):
        said = tool("info", bag, *given).err
        assert "warning" in said
        assert "did you mean" not in said


def test_a_mistyped_topic_suggests_the_nearest(tool: Tool, bag: Path, tmp_path: Path) -> None:
    said = tool("info", bag, "--pose-topic", "/tff=x", code=2).error
    assert "no topic '/tff'; its topics: /tf (" in said
    assert said.endswith("; did you mean '/tf'?")
    assert tool("info", bag, "--topic", "/tff", code=2).error.endswith("; did you mean '/tf'?")
    said = tool("convert", bag, tmp_path / "o.bag", "--topic", "tf_satic", code=2).error
    assert said.endswith("; did you mean '/tf_static'?")


def test_a_mistyped_model_suggests_the_nearest(tool: Tool, bag: Path, tmp_path: Path) -> None:
    (tmp_path / "robot.urdf").write_text("<robot/>")
    given = tmp_path / "robt.urdf"
    for arguments in (("info", bag, "--urdf", given), ("static-publisher", "x", "--from", given)):
        said = tool(*arguments, code=2).error
        assert said == f"{given}: no such file; did you mean {tmp_path / 'robot.urdf'}?"


@pytest.mark.parametrize("name", checkout_only.COMMANDS)
def test_a_command_of_a_checkout_names_the_install(
    tool: Tool, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(checkout_only, "installed", lambda: False)
    shown = tool(name, "--help").out
    assert COMMANDS[name] in shown
    assert "It needs a source checkout" in shown
    assert f"`tfdb {name}` needs a source checkout" in tool(name, "--quick", code=2).error


PAGE = Path(__file__).parents[2] / "docs" / "howto" / "command_line.md"


def test_the_page_lists_the_keys_of_every_command() -> None:
    table = PAGE.read_text("utf-8").split("## JSON", 1)[1]
    rows = re.findall(r"^\| ([^|]+) \|", table, re.MULTILINE)
    listed = {name for row in rows for name in row.split(", ")}
    takes_json = {
        name
        for name, command in EVERY.items()
        if any("--json" in param.opts for param in command.params)
    }
    assert takes_json <= listed


def test_errors_name_the_dates_of_the_valid_range(tool: Tool, bag: Path) -> None:
    said = tool("lookup", bag, "map", "base_link", "+1000", code=2).error
    assert "(2026-11-21 05:53:01.252 to 05:53:09.952 UTC)" in said


def test_a_chain_of_frames_that_are_not_there(tool: Tool, bag: Path) -> None:
    said = tool("monitor", bag, "map", "base_lnk", code=2).error
    assert "did you mean 'base_link'" in said

"""Errors: one line with a remedy, exit code 2, JSON on request."""

from __future__ import annotations

import json
import os
from typing import TYPE_CHECKING

import pytest

import tfdb

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool

READERS = (
    ("info",),
    ("tree",),
    ("check",),
    ("lookup", "map", "base_link"),
    ("poses", "map", "base_link"),
)


@pytest.mark.parametrize("command", READERS, ids=lambda command: command[0])
def test_missing_file(tool: Tool, bag: Path, command: tuple[str, ...]) -> None:
    name, *frames = command
    said = tool(name, bag.with_name("pr3.bag"), *frames, code=2).error
    assert "no such file" in said
    assert "did you mean" in said
    assert "pr2.bag" in said


@pytest.mark.parametrize("command", READERS, ids=lambda command: command[0])
def test_not_a_recording(tool: Tool, tmp_path: Path, command: tuple[str, ...]) -> None:
    name, *frames = command
    file = tmp_path / "notes.bag"
    file.write_text("shopping list")
    assert str(file) in tool(name, file, *frames, code=2).error


def test_truncated_recording(tool: Tool, bag: Path, tmp_path: Path) -> None:
    file = tmp_path / "cut.bag"
    file.write_bytes(bag.read_bytes()[:200_000])
    assert str(file) in tool("info", file, code=2).error


def test_folder_without_a_recording(tool: Tool, tmp_path: Path) -> None:
    assert str(tmp_path) in tool("info", tmp_path, code=2).error


def test_unknown_frame_names_the_nearest(tool: Tool, bag: Path) -> None:
    said = tool("lookup", bag, "map", "base_lnk", code=2).error
    assert "'base_lnk'" in said
    assert "'base_link'" in said
    assert "'odom'" in tool("poses", bag, "odm", "base_link", code=2).error


def test_unknown_frame_without_a_near_name(tool: Tool, bag: Path) -> None:
    assert "tfdb tree FILE" in tool("lookup", bag, "map", "zzzzzz", code=2).error


def test_a_leading_slash_is_dropped_as_loading_does(tool: Tool, bag: Path, tmp_path: Path) -> None:
    plain = tool("lookup", bag, "map", "base_link", "--json").json
    assert tool("lookup", bag, "/map", "/base_link", "--json").json == plain
    poses = tool("poses", bag, "map", "odom", "--rate", "10").out
    assert tool("poses", bag, "/map", "/odom", "--rate", "10").out == poses
    for name, frames in (("a.tum", ("map", "odom")), ("b.tum", ("/map", "/odom"))):
        tool("convert", bag, tmp_path / name, "--frames", *frames)
    assert (tmp_path / "a.tum").read_text() == (tmp_path / "b.tum").read_text()
    said = tool("lookup", bag, "map", "//base_link", code=2).error
    assert "'//base_link'" in said
    assert "'base_link'" in said


@pytest.mark.parametrize(
    "arguments",
    [
        *((name, "", *frames) for name, *frames in READERS),
        ("info", "f", ""),
        ("lookup", "f", "map", "odom", "--with", ""),
        ("poses", "f", "map", "odom", "--at", ""),
        ("poses", "f", "map", "odom", "-o", ""),
        ("convert", "", "out.bag"),
        ("convert", "f", ""),
        ("verify", ""),
    ],
)
def test_an_empty_path_is_refused(tool: Tool, bag: Path, arguments: tuple[str, ...]) -> None:
    given = [bag if argument == "f" else argument for argument in arguments]
    said = tool(*given, code=2).error
    assert "the path is empty" in said or "must end in" in said


@pytest.mark.parametrize("command", [*READERS, ("verify",)], ids=lambda command: command[0])
def test_an_error_of_reading_names_the_file(tool: Tool, command: tuple[str, ...]) -> None:
    name, *frames = command
    assert tool(name, "/proc/self/mem", *frames, code=2).error.startswith("/proc/self/mem: ")


@pytest.mark.parametrize("command", [("info",), ("convert", "out.bag")])
def test_a_topic_is_read_as_moving_or_static(
    tool: Tool, bag: Path, tmp_path: Path, command: tuple[str, ...]
) -> None:
    name, *out = command
    given = [name, bag, *(tmp_path / file for file in out)]
    said = tool(*given, "--topic", "/tf:foo", code=2).error
    assert "topic '/tf' cannot be read as 'foo', only as tf or tf_static" in said


def test_topics_of_convert_are_written_as_those_of_load(
    tool: Tool, bag: Path, tmp_path: Path
) -> None:
    for name, topic in (("a.bag", "/tf"), ("b.bag", "tf"), ("c.bag", "tf:/robot1/tf")):
        tool("convert", bag, tmp_path / name, "--topic", topic)
    found = [tool("info", tmp_path / name, "--json").json["topics"] for name in ("a.bag", "b.bag")]
    assert found[0] == found[1]
    assert tool("info", tmp_path / "c.bag", "--json").json["topics"][0]["name"] == "/robot1/tf"


def test_time_out_of_range_names_the_valid_range(tool: Tool, bag: Path) -> None:
    said = tool("lookup", bag, "map", "base_link", "12.5", code=2).error
    assert "valid from 17" in said
    said = tool("lookup", bag, "map", "base_link", "+1000", code=2).error
    assert "valid from 17" in said


def test_errors_as_json(tool: Tool, bag: Path) -> None:
    done = tool("lookup", bag, "map", "base_lnk", "--json", code=2)
    assert done.error
    body = done.json
    assert body["command"] == "lookup"
    assert body["error"]["type"] == "UnknownFrame"
    assert body["error"]["message"] == done.error
    assert body["error"]["fields"]["frame"] == "base_lnk"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("lookup",), "Missing argument"),
        (("frobnicate",), "No such command"),
        (("info", "--frobnicate", "x"), "No such option"),
        (("lookup", "f", "a", "b", "noon"), "write seconds"),
        (("lookup", "f", "a", "b", "--policy", "magic"), "is not one of 'interpolate'"),
        (("lookup", "f", "a", "b", "--policy", "extrapolate"), "extrapolate:SECONDS"),
        (("lookup", "f", "a", "b", "--policy", "exact:1"), "takes no limit"),
        (("poses", "f", "a", "b", "--rate", "1", "--at", "x"), "exclude each other"),
        (("poses", "f", "a", "b", "--rate", "0"), "range"),
        (("poses", "f", "a", "b", "-o", "x.doc"), "must end in .tum"),
        (("info", "f", "--topic", ":x"), "FROM"),
        (("check", "f", "--max-gap", "long"), "write seconds"),
        (("check", "f", "--max-gap", "-1"), "'-1' is negative"),
        (("info", "f", "--rename", "a:=b", "--rename", "a:=c"), "has two new names"),
        (("info", "f", "--pose-topic", "/a=b", "--pose-topic", "/a=c"), "has two frames"),
        (("poses", "f", "a", "b", "-o", "-", "--format", "tum"), "go to stdout"),
        (("lookup", "f", "a", "b", "++2"), "'++2' is not an offset"),
        (("lookup", "f", "a", "b", "2026-13-01"), "such as 2026"),
        (("tree", "ros1:http://localhost:1", "--rename", "map:=world"), "is valid for recordings"),
        (("rename", "f", "-o"), "see 'tfdb rename --help'"),
        (("completion", "tcsh"), "tcsh"),
    ],
)
def test_misuse(tool: Tool, tmp_path: Path, arguments: tuple[str, ...], words: str) -> None:
    file = tmp_path / "f"
    file.write_text("")
    given = [str(file) if argument == "f" else argument for argument in arguments]
    said = tool(*given, code=2).error
    assert words in said
    assert "--help" in said


def test_stamps_file_is_missing(tool: Tool, bag: Path, tmp_path: Path) -> None:
    said = tool("poses", bag, "map", "odom", "--at", tmp_path / "none.txt", code=2).error
    assert "no such file" in said


def test_output_folder_is_missing(tool: Tool, bag: Path, tmp_path: Path) -> None:
    out = tmp_path / "none" / "a.tum"
    assert str(out.parent) in tool("poses", bag, "map", "odom", "-o", out, code=2).error


def test_a_dangling_link_is_not_suggested(tool: Tool, tmp_path: Path) -> None:
    link = tmp_path / "loop.bag"
    link.symlink_to(link)
    assert "did you mean" not in tool("info", link, code=2).error


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (b"\xff\xd8\xff\xe0", "line 1"),
        (b"+2\n", "'+2' has a sign"),
        (b"-2 0 0 0 0 0 0 1\n", "'-2' is negative"),
    ],
)
def test_files_without_stamps_are_refused(
    tool: Tool, bag: Path, tmp_path: Path, text: bytes, words: str
) -> None:
    file = tmp_path / "stamps.txt"
    file.write_bytes(text)
    assert words in tool("poses", bag, "map", "odom", "--at", file, code=2).error


def test_stamps_after_a_byte_order_mark(tool: Tool, bag: Path, tmp_path: Path) -> None:
    file = tmp_path / "stamps.txt"
    file.write_bytes(b"\xef\xbb\xbf1795240383.5\r\n1795240384\r\n")
    rows = tool("poses", bag, "map", "odom", "--at", file).out.splitlines()
    assert [row.split()[0] for row in rows] == ["1795240383.500000000", "1795240384.000000000"]


def test_offsets_without_their_plus_are_asked_about(tool: Tool, bag: Path) -> None:
    bounds = ("--start", "2", "--end", "5")
    assert "did you mean '+2' and '+5', from the start?" in tool("info", bag, *bounds).err
    said = tool("poses", bag, "map", "odom", *bounds, code=2).error
    assert said.endswith("; did you mean +2 and +5, from the start?")
    assert "valid from 1795240381.252825021" in said
    with pytest.warns(tfdb.TfdbWarning, match=r"did you mean '\+2' and '\+4.5', from"):
        tfdb.load(bag, start="2", end=4_500_000_000)


def test_an_echo_without_any_answer_is_an_error(tool: Tool, bag: Path) -> None:
    asked = ("echo", bag, "map", "base_link", "-t")
    assert tool(*asked, "+3").out
    for time in ("12", "+12"):
        done = tool(*asked, time, code=2)
        assert done.out == ""
        assert "would need extrapolation" in done.error
        (line,) = tool(*asked, time, "--json", code=2).out.splitlines()
        assert json.loads(line)["error"]["type"] == "Extrapolation"


def test_an_echo_that_walks_without_any_answer_is_an_error(tool: Tool, tmp_path: Path) -> None:
    store = tfdb.Buffer(history=None)
    for ms in range(0, 5000, 100):
        store.set_transform("map", "base", ms * 10**6, (1, 0, 0))
        store.set_transform("base", "arm", (ms + 20_000) * 10**6, (1, 0, 0))
    store.freeze(tmp_path / "x.tfdb")
    done = tool("echo", tmp_path / "x.tfdb", "map", "arm", code=2)
    assert (done.out, done.err.count("tfdb: error: ")) == ("", 1)


def test_files_without_a_message_to_salvage_are_refused(
    tool: Tool, bag: Path, tmp_path: Path
) -> None:
    cut = tmp_path / "cut.bag"
    cut.write_bytes(bag.read_bytes()[:6500])
    with tfdb.recordings.Recording(cut, salvage=True) as recording:
        assert [topic.name for topic in recording.topics] == ["/tf_static"]
    done = tool("convert", cut, tmp_path / "o.bag", "--salvage", code=2)
    said = done.err.splitlines()[-1]
    assert said == "tfdb: error: nothing to convert: no message of /tf_static could be read"


def test_names_that_begin_with_a_dash_may_come_after_two(
    tool: Tool, tmp_path: Path, name: str
) -> None:
    store = tfdb.Buffer()
    for i in range(3):
        store.set_transform("map", "-dash", i * 10**9, (i, 0, 0))
    file = tmp_path / "odd.tfdb"
    store.freeze(file)
    expected = tool("lookup", file, "--json", "--", "map", "-dash").json
    assert (expected["source"], expected["stamp_ns"]) == ("-dash", 2 * 10**9)
    found = tool("lookup", file, "map", "--json", "--", "-dash", "-0.5").json
    assert found["stamp_ns"] == 15 * 10**8
    assert "No such option" in tool("lookup", "-zz", file, "--", "map", "map", code=2).error
    for command in ("poses", "echo", "monitor"):
        done = tool(command, file, "map", "--", "-dash", code=2 if command == "monitor" else 0)
        assert "No such option" not in done.err
    tool("static-publisher", f"shm:{name}", 0, 0, -1, 0, 0, 0, 1, "map", "--", "-dash")
    assert "-dash" in tool("tree", f"shm:{name}").out


def test_suggestions_ignore_case(tool: Tool, bag: Path) -> None:
    assert "did you mean 'map'?" in tool("lookup", bag, "MAP", "odom", code=2).error
    assert "did you mean 'map'?" in tool("info", bag, "--frame", "MAP", code=2).error


def test_a_refused_command_makes_no_store(tool: Tool, bag: Path, tmp_path: Path) -> None:
    name = f"test-errors-{os.getpid()}"
    tool("play", bag, "--into", name, "--frame", "nowhere", code=2)
    for options in ((), ("--mix",)):
        said = tool("serve", "follow", bag, "--into", name, *options, code=2).error
        assert said == f"{bag}: not an MCAP file; only .mcap files can be read while they grow"
    tool("serve", "follow", tmp_path, "--into", name, code=2)
    with pytest.raises(tfdb.errors.NoSuchStore):
        tfdb.Buffer.open(name, create=False)

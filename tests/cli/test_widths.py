"""Output at 60, 80 and 200 columns: frame names are never broken or cut."""

from __future__ import annotations

import json
import os
import re
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from rich.cells import cell_len

import tfdb
from tfdb.cli.app import COMMANDS
from tfdb.recordings import RecordingWriter

if TYPE_CHECKING:
    from collections.abc import Iterator

    from conftest import Tool

ROOT = Path(__file__).resolve().parents[2]
S = 1_000_000_000
START = 1_700_000_000 * S
TURN = (0.0, 0.6, 0.0, 0.8)


def long(name: str) -> str:
    """Return a name of 45 characters, as in a fleet of robots."""
    return f"warehouse_7/robot_042/{name}".ljust(44, "_") + "x"


MAP, ODOM, BASE, ARM = (long(name) for name in ("map", "odom", "base_link", "upper_arm"))
SPACED = "a frame whose name has spaces, of 45 letters."
HAND, TABLE = long("hand"), long("table")
ALL = (MAP, ODOM, BASE, ARM, SPACED, HAND)
STORE = f"test-widths-{os.getpid()}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with recordings of a robot with long names: one good, one with all faults."""
    made = tmp_path_factory.mktemp("widths")
    assert {len(name) for name in (*ALL, TABLE)} == {45}
    with RecordingWriter(made / "good.bag") as good, RecordingWriter(made / "bad.bag") as bad:
        statics = [
            tfdb.TransformStamped(ARM, SPACED, 0, (0, 0, 1), TURN),
            tfdb.TransformStamped(SPACED, HAND, 0, (0, 1, 0), TURN),
        ]
        lone = tfdb.TransformStamped(TABLE, TABLE[:-3] + "cup", 0, (0, 1, 0), TURN)
        for writer, first in ((good, statics), (bad, [*statics, lone])):
            data = tfdb.encode_tf_message(first, writer.encoding)
            writer.write(data, START, topic="/tf_static", static=True, authority="/a_publisher")
        for i in range(60):
            stamp = START + i * S // 10
            moving = [
                tfdb.TransformStamped(MAP, ODOM, stamp, (i, 0, 0), TURN),
                tfdb.TransformStamped(ODOM, BASE, stamp, (0, i, 0), TURN),
                tfdb.TransformStamped(BASE, ARM, stamp, (0, 0, i), TURN),
            ]
            data = tfdb.encode_tf_message(moving, good.encoding)
            good.write(data, stamp, topic="/tf", static=False, authority="/a_publisher")
            if 20 <= i < 40:
                del moving[1:]
            if i == 50:
                moving[2] = tfdb.TransformStamped(MAP, ARM, stamp, (0, 0, i), TURN)
            who = "/another_publisher" if i > 45 else "/a_publisher"
            data = tfdb.encode_tf_message(moving, bad.encoding)
            bad.write(data, stamp, topic="/tf", static=False, authority=who)
    return made


@pytest.fixture
def store(folder: Path) -> Iterator[str]:
    name = f"{STORE}-{'with-a-long-name'}"
    with tfdb.Buffer.open(name) as made:
        made.load(folder / "good.bag")
        yield name
    with suppress(tfdb.errors.NoSuchStore):
        tfdb.Buffer.unlink(name)


# command -> (arguments, names that the output must contain unbroken, exit code)
RUNS: dict[str, list[tuple[tuple[str, ...], tuple[str, ...], int]]] = {
    "info": [(("good.bag",), ALL, 0), (("bad.bag",), (*ALL, TABLE), 0), (("shm:STORE",), ALL, 0)],
    "tree": [(("good.bag",), ALL, 0), (("bad.bag", "--at", "+1"), (*ALL, TABLE), 0)],
    "lookup": [(("good.bag", MAP, HAND, "+1.05"), ALL, 0), (("good.bag", ARM, HAND), (), 0)],
    "echo": [(("good.bag", MAP, HAND, "-t", "+1.05"), (ARM,), 0)],
    "monitor": [
        (("bad.bag",), (ODOM, BASE, ARM, SPACED, HAND), 0),
        (("good.bag", MAP, HAND), ALL, 0),
        (("bad.bag", MAP, TABLE), (), 0),
    ],
    "view-frames": [(("good.bag", "-o", "tree.dot", "--overwrite"), (), 0)],
    "plot": [
        (("good.bag", "--save", "t.png", "--overwrite"), (), 0),
        (("good.bag", "trajectory", MAP, HAND, "--save", "p.svg", "--overwrite"), (), 0),
    ],
    "poses": [(("good.bag", MAP, HAND, "-o", "p.tum", "--overwrite"), (MAP, HAND), 0)],
    "check": [(("bad.bag",), (BASE, ARM, ODOM, TABLE), 1), (("good.bag",), (), 0)],
    "expect": [(("good.bag", "-o", "e.toml", "--overwrite"), (), 0)],
    "watch": [(("shm:STORE", "--expect", "watched.toml", "--for", "0.1"), (MAP, ODOM), 1)],
    "record": [(("STORE", "-o", "live.mcap", "--for", "0.01"), (), 0)],
    "gaps": [(("bad.bag",), (BASE, ARM), 0), (("good.bag",), (), 0)],
    "shm": [(("ls",), (), 0), (("info", "STORE"), (), 0)],
    "play": [(("good.bag", "--into", "STORE", "--speed", "inf"), (), 0)],
    "static-publisher": [
        (("shm:STORE", "1", "2", "3", "0", "0", "0", "1", MAP, TABLE), (MAP, TABLE), 0),
        (("shm:STORE", "--from", "good.bag"), (ARM, SPACED, HAND), 0),
    ],
    "change-notifier": [(("good.bag", "--pair", MAP, HAND, "-r", "1"), (MAP, HAND), 0)],
    "freeze": [(("good.bag", "-o", "good.tfdb", "--overwrite"), (), 0)],
    "convert": [
        (("good.bag", "c.bag", "--overwrite"), (), 0),
        (("good.bag", "c.tum", "--frames", MAP, HAND, "--overwrite"), (MAP, HAND), 0),
    ],
    "merge": [
        (
            ("good.bag", "bad.bag", "-o", "m.bag", "--prefix", "", "--prefix", "b/", "--overwrite"),
            (),
            0,
        )
    ],
    "compare": [
        (("good.bag", "bad.bag", "--frames", MAP, BASE, "--align", "none"), (MAP, BASE), 0),
        (("good.bag", "good.bag", "--frames", MAP, ARM, "--align", "origin"), (MAP, ARM), 0),
    ],
    "rename": [(("good.bag", "-o", "r.bag", "--rename", f"{MAP}:=map", "--overwrite"), (), 0)],
    "verify": [(("history.jsonl",), (), 0)],
}
WITHOUT = {
    "bench",
    "bridge",
    "buffer-server",
    "completion",
    "mirror",
    "net",
    "publish",
    "serve",
    "view",
}
"""Not tested: a separate program, commands that need a graph or network, a printed script."""


def test_every_command_is_run_here() -> None:
    assert set(RUNS) | WITHOUT == set(COMMANDS)


@pytest.mark.parametrize("columns", [60, 80, 200])
@pytest.mark.parametrize("command", RUNS)
def test_names_are_whole(
    tool: Tool,
    folder: Path,
    store: str,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    columns: int,
) -> None:
    monkeypatch.chdir(folder)
    (folder / "history.jsonl").write_text(json.dumps({"tfdb_history": 1}) + "\n")
    edge = f'parent = "{MAP}"\nchild = "{ODOM}"\nauthority = "/another_publisher"\n'
    (folder / "watched.toml").write_text(f"version = 1\n[[edge]]\n{edge}")
    (folder / "live.mcap").unlink(missing_ok=True)
    monkeypatch.setenv("COLUMNS", str(columns))
    for arguments, names, code in RUNS[command]:
        given = [argument.replace("STORE", store) for argument in arguments]
        done = tool(command, *given, code=code)
        lines = done.out.splitlines()
        assert lines
        for name in names:
            assert any(name in line for line in lines), (name, done.out)
        for line in lines:
            assert cell_len(line) <= columns, done.out


def test_omitted_columns_are_named_and_wide_shows_them(
    tool: Tool, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = folder / "bad.bag"
    everything = tool("info", file).out
    assert "--wide" not in everything
    monkeypatch.setenv("COLUMNS", "60")
    shown = tool("info", file).out
    assert "--wide shows also: parent, samples, " in shown
    assert "/another_publisher" not in shown
    assert tool("info", file, "--wide").out == everything
    assert "/another_publisher" in everything


def test_rows_are_in_the_order_of_the_tree(
    tool: Tool, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for columns in ("60", "80", "200"):
        monkeypatch.setenv("COLUMNS", columns)
        shown = tool("info", folder / "good.bag").out.split("frame ", 1)[1]
        places = [shown.index(f"{name}  ") for name in ALL]
        assert places == sorted(places)


def test_names_longer_than_the_terminal_stay_whole(
    tool: Tool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    name = "x" * 300
    file = tmp_path / "long.mcap"
    with RecordingWriter(file) as writer:
        moved = [tfdb.TransformStamped("map", name, START + i * S, (i, 0, 0), TURN) for i in (1, 2)]
        data = tfdb.encode_tf_message(moved, writer.encoding)
        writer.write(data, START, topic="/tf", static=False)
    monkeypatch.setenv("COLUMNS", "80")
    for arguments in (("info",), ("tree",), ("monitor",), ("lookup", "map", name)):
        command, *rest = arguments
        assert name in tool(command, file, *rest).out


def test_names_cannot_drive_the_terminal(tool: Tool, tmp_path: Path) -> None:
    name = "red\x9b31m\u202eno\u2028line"
    file = tmp_path / "hostile.mcap"
    with RecordingWriter(file) as writer:
        moved = [tfdb.TransformStamped("map", name, START + i * S, (i, 0, 0), TURN) for i in (1, 2)]
        data = tfdb.encode_tf_message(moved, writer.encoding)
        writer.write(data, START, topic="/tf", static=False)
    for arguments in (("info",), ("tree",), ("monitor",), ("lookup", "map", name)):
        command, *rest = arguments
        shown = tool(command, file, *rest).out
        assert "red\\u009b31m\\u202eno\\u2028line" in shown
        assert not {"\x9b", "\u202e", "\u2028"} & set(shown)


PAGE = ROOT / "docs" / "howto" / "command_line.md"
SHOWN = re.findall(r"```\n\$ tfdb ([^\n]*)\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)


def test_the_page_shows_output() -> None:
    assert len(SHOWN) >= 2


@pytest.mark.parametrize(("command", "shown"), SHOWN)
def test_output_on_the_page_is_the_printed_one(
    tool: Tool, monkeypatch: pytest.MonkeyPatch, command: str, shown: str
) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("COLUMNS", "80")
    printed = tool(*command.split()).out
    assert [line.rstrip() for line in printed.splitlines()] == shown.splitlines()

"""`tfdb freeze`, and commands on its files."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import tfdb

if TYPE_CHECKING:
    from conftest import Tool


@pytest.fixture
def drive(bag: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(bag, tmp_path / "drive.bag"))


@pytest.fixture
def frozen(tool: Tool, drive: Path) -> Path:
    done = tool("freeze", drive)
    path = drive.with_suffix(".tfdb")
    assert done.out.startswith(f"{path}: ")
    assert "samples of 85 frames" in done.out
    return path


def test_it_answers_as_its_recording(tool: Tool, drive: Path, frozen: Path) -> None:
    tool.check_answers(frozen, drive)


def test_json(tool: Tool, drive: Path, tmp_path: Path) -> None:
    out = tmp_path / "x.tfdb"
    body = tool("freeze", drive, "-o", out, "--json").json
    store = tfdb.open(out)
    assert body["output"] == str(out)
    assert body["bytes"] == out.stat().st_size
    assert body["frames"] == len(store.frames())
    assert body["samples"] == sum(info.samples for info in store.tree())
    assert body["start_ns"] < body["end_ns"]


def test_check_compares_all_of_it(tool: Tool, frozen: Path) -> None:
    found = tool("check", frozen, "--json").json
    assert found["transforms"] == sum(info.samples for info in tfdb.open(frozen).tree())
    content = bytearray(frozen.read_bytes())
    content[-1000] ^= 1
    frozen.write_bytes(content)
    assert "is damaged" in tool("check", frozen, code=2).error
    frozen.write_bytes(content[:-8])
    assert "was cut" in tool("info", frozen, code=2).error


def test_freeze_refuses_wrong_arguments(tool: Tool, drive: Path, frozen: Path) -> None:
    assert "--overwrite replaces it" in tool("freeze", drive, code=2).error
    tool("freeze", drive, "--overwrite")
    assert "also an input" in tool("freeze", frozen, "--overwrite", code=2).error
    assert "cannot be combined with other files" in tool("info", frozen, drive, code=2).error
    assert "--topic is valid for recordings" in tool("info", frozen, "--topic", "/tf", code=2).error
    assert "is valid for live stores" in tool("check", frozen, "--for", "1", code=2).error
    assert "has no folder: give -o" in tool("freeze", "shm:none", code=2).error
    said = tool("freeze", drive, "-o", drive.with_suffix(".db3"), code=2).error
    assert ".db3' must end in .tfdb" in said


@pytest.mark.parametrize(
    "arguments",
    [
        ("convert", "FROZEN", "x.bag"),
        ("merge", "FROZEN", "FROZEN", "-o", "x.bag"),
        ("rename", "FROZEN", "-o", "x.bag", "--prefix", "a/"),
        ("play", "FROZEN", "--into", "nothing"),
        ("serve", "follow", "FROZEN", "--into", "nothing"),
        ("monitor", "FROZEN"),
    ],
)
def test_commands_for_recordings_refuse_frozen_stores(
    tool: Tool, frozen: Path, arguments: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(frozen.parent)
    given = [str(frozen) if each == "FROZEN" else each for each in arguments]
    said = tool(*given, code=2).error
    assert said.startswith(f"{frozen} is a frozen store, ")
    assert "; give the recording that it was made from; see '" in said


def test_the_help_lists_commands_without_frozen_stores(tool: Tool) -> None:
    said = " ".join(tool("--help").out.split())
    assert "merge, rename and play read recordings and trajectories only. " in said
    assert "convert also reads .tfdb files, to write a trajectory or a viewer's file. " in said
    assert "monitor reads all but .tfdb files. " in said


def test_of_a_live_store(tool: Tool, tmp_path: Path, name: str) -> None:
    store = tfdb.Buffer.open(name, create=True)
    store.set_transform("map", "base", 10, (1, 2, 3), (0, 0.6, 0, 0.8))
    tool("freeze", f"shm:{name}", "-o", tmp_path / "x.tfdb")
    frozen = tfdb.open(tmp_path / "x.tfdb")
    assert frozen.lookup_transform("map", "base") == store.lookup_transform("map", "base")


def test_a_lookup_as_json_imports_neither_numpy_nor_rich(frozen: Path) -> None:
    """These imports would take longer than the lookup."""
    code = """
import sys
from tfdb.cli.app import cli
try:
    cli.main(sys.argv[1:], "tfdb")
finally:
    print(sorted({"numpy", "rich", "matplotlib"} & set(sys.modules)))
"""
    words = ["lookup", str(frozen), "map", "base_link", "--json"]
    command = [sys.executable, "-c", code, *words]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    *printed, imported = done.stdout.splitlines()
    assert json.loads("\n".join(printed))["target"] == "map"
    assert imported == "[]"

"""Standard streams that are closed, full, or cannot encode names."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import tfdb

if TYPE_CHECKING:
    from conftest import Tool

NAME = "roboter_ä_漢字_🤖"


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tfdb.Buffer()
    made.set_static_transform("map", NAME, (1, 2, 3))
    path = tmp_path_factory.mktemp("streams") / "small.tfdb"
    made.freeze(path)
    return path


def shell(redirected: str, *arguments: object, **environment: str) -> tuple[int, str, str]:
    """Run the command in a shell that redirects its streams."""
    done = subprocess.run(
        ["sh", "-c", f'exec "$@" {redirected}', "sh", sys.executable, "-m", "tfdb.cli"]
        + [str(argument) for argument in arguments],
        capture_output=True,
        encoding=environment.get("PYTHONIOENCODING", "utf-8"),
        env={**os.environ, **environment},
        check=False,
        timeout=120,
    )
    return done.returncode, done.stdout, done.stderr


@pytest.mark.parametrize("redirected", [">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_streams_stop_nothing(store: Path, redirected: str) -> None:
    code, out, err = shell(redirected, "info", store)
    assert (code, err) == (0, "")
    assert bool(out) == (redirected == "2>&-")


def test_no_stamps_come_from_a_closed_stdin(store: Path) -> None:
    code, _, err = shell("<&-", "poses", store, "map", NAME, "--at", "-")
    assert (code, err.count("\n")) == (2, 1)
    assert "no stamp" in err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full here")
def test_a_full_disk_is_named(store: Path) -> None:
    code, _, err = shell(">/dev/full", "info", store)
    assert code == 2
    assert err == "tfdb: error: the output cannot be written: no space is left\n"


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_unencodable_characters_are_escaped(store: Path, encoding: str) -> None:
    for command in ("info", "tree"):
        code, out, err = shell("", command, store, PYTHONIOENCODING=encoding)
        assert (code, err) == (0, "")
        assert ("`-- " in out) == (command == "tree")
        assert "_\\u6f22\\u5b57_\\U0001f916" in out


@pytest.mark.parametrize("encoding", ["ascii", "latin-1"])
def test_unencodable_characters_are_escaped_in_errors_and_results(
    store: Path, tmp_path: Path, encoding: str
) -> None:
    code, _, err = shell("", "lookup", store, "map", NAME[:-2], PYTHONIOENCODING=encoding)
    assert (code, err.count("_\\u6f22\\u5b57")) == (2, 2)
    file = tmp_path / "at.txt"
    file.write_text("1.5")
    where = ("poses", store, "map", NAME, "--at", file, "-o", tmp_path / "o.tum")
    code, out, err = shell("", *where, PYTHONIOENCODING=encoding)
    assert (code, err) == (0, "")
    assert "_\\u6f22\\u5b57_\\U0001f916 in map" in out


def test_graphviz_gets_any_name(store: Path, tmp_path: Path) -> None:
    out = tmp_path / "tree.svg"
    code, _, err = shell(
        "", "view-frames", store, "-o", out,
        LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0",
    )  # fmt: skip
    assert (code, err) == (0, "")
    assert out.stat().st_size


@pytest.mark.parametrize("group", ["shm", "serve"])
def test_a_group_without_a_command_prints_its_help(tool: Tool, group: str) -> None:
    assert tool(group).out == tool(group, "--help").out

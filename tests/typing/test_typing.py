"""Good programs pass strict type checkers, and bad ones do not."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mypy", reason="types are judged by mypy")
pytest.importorskip("basedpyright", reason="types are judged by Pyright, too")

HERE = Path(__file__).resolve().parent
GOOD, BAD = "good_use.py", "bad_use.py"
COMMANDS = {
    "mypy": ["mypy", "--strict", "--config-file=", "--cache-dir", os.devnull, GOOD, BAD],
    "pyright": ["basedpyright", "--pythonpath", sys.executable, "--project", "pyright.json"],
}


@pytest.fixture(scope="module", params=list(COMMANDS))
def found(request: pytest.FixtureRequest) -> dict[str, dict[int, str]]:
    """What a checker complains of: by file, by line."""
    command = [sys.executable, "-m", *COMMANDS[request.param]]
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=HERE)
    assert done.returncode == 1, done.stdout + done.stderr
    lines = re.findall(r"(\w+_use\.py):(\d+):.*?error: (.*)", done.stdout)
    return {file: {int(n): text for name, n, text in lines if name == file} for file in (GOOD, BAD)}


def test_good_use_has_no_type_errors(found: dict[str, dict[int, str]]) -> None:
    assert found[GOOD] == {}


def test_every_line_of_bad_use_is_an_error(found: dict[str, dict[int, str]]) -> None:
    source = (HERE / BAD).read_text(encoding="utf-8").splitlines()
    expected = {i for i, line in enumerate(source, start=1) if line.endswith("# error")}
    assert set(found[BAD]) == expected, found[BAD]

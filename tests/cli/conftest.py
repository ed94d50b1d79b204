"""Fixtures that run the command, in this process and as installed."""

from __future__ import annotations

import inspect
import json
import subprocess
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from tfdb.cli.app import cli

# Click 8.1 separates stdout and stderr on request only, 8.2 always.
_APART = "mix_stderr" in inspect.signature(CliRunner.__init__).parameters
RUNNER = CliRunner(**({"mix_stderr": False} if _APART else {}))
ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Outcome:
    """Output and exit code of a run."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        """The JSON object on stdout."""
        body = json.loads(self.out)
        assert body["tfdb"] == 1
        return dict(body)

    @property
    def error(self) -> str:
        """The single line on stderr."""
        assert self.code == 2, self.out + self.err
        (line,) = self.err.strip().splitlines()
        assert line.startswith("tfdb: error: ")
        return line.removeprefix("tfdb: error: ")


class Tool:
    """Runs `tfdb`."""

    def __call__(self, *arguments: object, stdin: str | None = None, code: int = 0) -> Outcome:
        """Run in this process; `code` is the expected exit code."""
        done = RUNNER.invoke(cli, [str(a) for a in arguments], input=stdin)
        if done.exception is not None and not isinstance(done.exception, SystemExit):
            raise done.exception
        outcome = Outcome(done.exit_code, done.stdout, done.stderr)
        assert outcome.code == code, outcome
        return outcome

    def check_answers(self, store: object, recording: object) -> None:
        """Check that a store and its recording give the same output, except for facts of files."""
        for command in (
            ("info",),
            ("tree",),
            ("tree", "--at", "+3"),
            ("lookup", "map", "base_link"),
            ("lookup", "map", "base_link", "-0.5"),
        ):
            found = self(command[0], store, *command[1:], "--json").json
            expected = self(command[0], recording, *command[1:], "--json").json
            assert found.pop("files") == [str(store)]
            for key in (
                "files",
                "topics",
                "messages",
                "transforms",
                "refused",
                "refused_transforms",
            ):
                expected.pop(key, None)
                found.pop(key, None)
            assert found == expected
            assert "base_link" in self(command[0], store, *command[1:]).out
        arguments = ("map", "base_link", "--rate", "10")
        assert self("poses", store, *arguments).out == self("poses", recording, *arguments).out

    def installed(self, *arguments: object, stdin: str | None = None) -> Outcome:
        """Run the installed program."""
        program = Path(sysconfig.get_path("scripts")) / "tfdb"
        command = [str(program)] if program.exists() else [sys.executable, "-m", "tfdb.cli"]
        done = subprocess.run(
            [*command, *(str(argument) for argument in arguments)],
            input=stdin,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        return Outcome(done.returncode, done.stdout, done.stderr)


@pytest.fixture(autouse=True)
def unlimited(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let commands print all columns, for any terminal of the machine."""
    monkeypatch.delenv("COLUMNS", raising=False)


@pytest.fixture(scope="session")
def tool() -> Tool:
    return Tool()


@pytest.fixture(scope="session")
def bag() -> Path:
    """The shipped ROS 1 bag: a PR2 that drives, 85 frames, four publishers."""
    return ROOT / "examples" / "data" / "pr2.bag"


@pytest.fixture(scope="session")
def mcap() -> Path:
    """The same run as MCAP."""
    return ROOT / "examples" / "data" / "pr2.mcap"

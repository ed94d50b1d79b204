"""Commands of `tfdb` on live graphs, in this process or in a separate one."""

from __future__ import annotations

import inspect
import json
import os
import signal
import subprocess
import sys
from typing import TYPE_CHECKING, Any, Self

from click.testing import CliRunner

from tfdb.cli.app import cli

if TYPE_CHECKING:
    from collections.abc import Callable

# Click 8.1 needs an option to separate the two streams; 8.2 always does.
_APART = "mix_stderr" in inspect.signature(CliRunner.__init__).parameters
RUNNER = CliRunner(**({"mix_stderr": False} if _APART else {}))
SECONDS = 20.0


def tfdb_says(*arguments: object, code: int = 0) -> str:
    """Return the output of a command with that exit code; for an error, its error line."""
    done = RUNNER.invoke(cli, [str(each) for each in arguments])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == code, done.stdout + done.stderr
    return done.stderr if code == 2 else done.stdout


def tfdb_json(*arguments: object, code: int = 0) -> Any:
    """Return the JSON object that a command prints."""
    return json.loads(tfdb_says(*arguments, "--json", code=code))


def tfdb_hears(holds: Callable[[Any], object], *arguments: object) -> Any:
    """Return the JSON object of a listening command that has received the expected data."""
    seconds = 0.3
    while not holds(told := tfdb_json(*arguments, "--for", seconds)):
        seconds *= 2
        assert seconds < SECONDS, told
    return told


class Command:
    """A command that runs until `end` is called."""

    def __init__(self, *arguments: object, environment: dict[str, str] | None = None) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tfdb.cli", *map(str, arguments)],
            env={**os.environ, **(environment or {})},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.communicate()

    def line(self) -> str:
        """Return the next line of its output."""
        assert self.process.stdout
        found = self.process.stdout.readline()
        assert found or self.process.poll() is None, self.process.communicate()[1]
        return found

    def end(self, number: int = signal.SIGINT) -> tuple[int, str]:
        """End the command; return its exit code and the rest of its output."""
        self.process.send_signal(number)
        said, _ = self.process.communicate(timeout=SECONDS)
        return self.process.returncode, said

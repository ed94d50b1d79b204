"""Commands of `tfdb` on live graphs: in this process, or in one of their own."""

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

# Click 8.1 has to be asked to keep the two streams apart, 8.2 does so always.
_APART = "mix_stderr" in inspect.signature(CliRunner.__init__).parameters
RUNNER = CliRunner(**({"mix_stderr": False} if _APART else {}))
SECONDS = 20.0


def tfdb_says(*arguments: object, code: int = 0) -> str:
    """What a command prints that ends with that code; of an error, its line."""
    done = RUNNER.invoke(cli, [str(each) for each in arguments])
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == code, done.stdout + done.stderr
    return done.stderr if code == 2 else done.stdout


def tfdb_json(*arguments: object, code: int = 0) -> Any:
    """The JSON object that it prints."""
    return json.loads(tfdb_says(*arguments, "--json", code=code))


def tfdb_hears(holds: Callable[[Any], object], *arguments: object) -> Any:
    """The JSON object of what listens, for so long that it heard what it should."""
    seconds = 0.3
    while not holds(told := tfdb_json(*arguments, "--for", seconds)):
        seconds *= 2
        assert seconds < SECONDS, told
    return told


class Command:
    """A command that runs until it is told to end."""

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
        """The next line that it prints."""
        assert self.process.stdout
        found = self.process.stdout.readline()
        assert found or self.process.poll() is None, self.process.communicate()[1]
        return found

    def end(self, number: int = signal.SIGINT) -> tuple[int, str]:
        """Its exit code, and what else it prints, once it is told to end."""
        self.process.send_signal(number)
        said, _ = self.process.communicate(timeout=SECONDS)
        return self.process.returncode, said

"""The drivers in C++: where they are, and one run of one of them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from .. import TfdbError, _core
from .points import TF2, Point

ENVIRONMENT = "TFDB_DRIVERS"
"""A folder with the two programs, to be used instead of the installed ones."""

_PROGRAMS = {True: "tfdb_driver_tf2", False: "tfdb_driver"}


class DriverMissing(TfdbError):  # noqa: N818 - the names of tfdb's errors say what happened
    """A program that measures is not installed. Fields: value (its name)."""


class DriverFailed(TfdbError):  # noqa: N818
    """A driver ended with an error. Fields: value (its command line), reason."""


def find(engine: str) -> Path:
    """Return the program that measures an engine. Raises `DriverMissing`."""
    name = _PROGRAMS[engine == TF2]
    folders = [Path(__file__).parents[1] / "bin", Path(_core.__file__).parent / "bin"]
    if os.environ.get(ENVIRONMENT):
        folders = [Path(os.environ[ENVIRONMENT])]
    for folder in folders:
        if os.access(folder / name, os.X_OK):
            return folder / name
    where = " or ".join(str(folder) for folder in dict.fromkeys(folders))
    if engine == TF2:
        message = (
            f"no {name} in {where}: it is built where the real tf2 is installed "
            "(Debian: libtf2-dev; benchmarks/rivals/install does both); or leave out the engine tf2"
        )
    else:
        message = f"no {name} in {where}: install tfdb again, from a wheel or with pip install"
    raise DriverMissing(message, value=name)


def run(point: Point, *, limit: float) -> dict[str, Any]:
    """Measure one point; `limit` is in seconds. Raises `DriverMissing`, `DriverFailed`."""
    command = [str(find(point.engine)), *point.arguments()]
    with (
        tempfile.TemporaryFile("w+") as errors,
        subprocess.Popen(  # noqa: S603, our own program with checked options
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors, text=True
        ) as process,
    ):
        try:
            printed, _ = process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            process.kill()
            raise _failed(command, f"not done within {limit:.0f} s") from None
        except BaseException:
            process.kill()
            raise
        if process.returncode != 0:
            errors.seek(0)
            raise _failed(command, _reason(errors.read(), process.returncode))
    try:
        result: dict[str, Any] = json.loads(printed)
    except json.JSONDecodeError as error:
        raise _failed(command, f"printed no JSON: {error}") from None
    return result


def _reason(text: str, code: int) -> str:
    lines = text.strip().splitlines()
    if lines:
        return lines[-1]
    return f"ended by {signal.Signals(-code).name}" if code < 0 else f"ended with {code}"


def _failed(command: list[str], reason: str) -> DriverFailed:
    shown = " ".join([Path(command[0]).name, *command[1:]])
    return DriverFailed(f"{reason} ({shown})", value=shown, reason=reason)

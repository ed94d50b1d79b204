"""The programs in C++: where they are, and one run of one of them."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import tempfile
from pathlib import Path
from typing import Any

from tfdb import TfdbError, _core

from .points import TF2, Point

ENVIRONMENT = "TFDB_DRIVERS"
"""A folder with the programs, to be used instead of the installed ones."""

HOW_TO_GET = (
    "a checkout of tfdb that is installed as editable has it (make .stamps/install), and so has "
    "what is installed from source with TFDB_MEASURE=1 in the environment"
)
"""Wheels hold no program that measures."""


class DriverMissing(TfdbError):  # noqa: N818 - the names of tfdb's errors say what happened
    """A program that measures is not installed. Fields: value (its name)."""


class DriverFailed(TfdbError):  # noqa: N818
    """A program that measures ended with an error. Fields: value (its command line), reason."""


def find(name: str) -> Path:
    """Return a program of `measure/`. Raises `DriverMissing`, which says how to get it."""
    folders = [
        Path(_core.__file__).parents[1] / "tfdb_measure" / "bin",
        Path(__file__).parent / "bin",
    ]
    if os.environ.get(ENVIRONMENT):
        folders = [Path(os.environ[ENVIRONMENT])]
    for folder in folders:
        if os.access(folder / name, os.X_OK):
            return folder / name
    where = " or ".join(str(folder) for folder in dict.fromkeys(folders))
    message = f"no {name} in {where}: {HOW_TO_GET}"
    if "tf2" in name or name == "tfdb_torn_pair":
        message += (
            ". This one is built where the real tf2 is (Debian: libtf2-dev; "
            "measure/contenders/install does both)"
        )
    raise DriverMissing(message, value=name)


def driver(engine: str) -> Path:
    """Return the program that measures an engine. Raises `DriverMissing`."""
    return find("tfdb_driver_tf2" if engine == TF2 else "tfdb_driver")


def run(point: Point, *, limit: float) -> dict[str, Any]:
    """Measure one point; `limit` is in seconds. Raises `DriverMissing`, `DriverFailed`."""
    (result,) = lines_of([str(driver(point.engine)), *point.arguments()], limit=limit)
    return result


def lines_of(command: list[str], *, limit: float) -> list[dict[str, Any]]:
    """Run a program that prints lines of JSON; `limit` is in seconds. Raises `DriverFailed`."""
    printed = output_of(command, limit=limit)[0]
    try:
        return [json.loads(line) for line in printed.splitlines()]
    except json.JSONDecodeError as error:
        raise _failed(command, f"printed no JSON: {error}") from None


def output_of(command: list[str], *, limit: float) -> tuple[str, str]:
    """Run a program to its end; return what it printed and its errors. Raises `DriverFailed`."""
    with (
        tempfile.TemporaryFile("w+") as errors,
        subprocess.Popen(  # noqa: S603, our own programs with checked options
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
        errors.seek(0)
        said = errors.read()
        if process.returncode != 0:
            raise _failed(command, _reason(said, process.returncode))
    return printed, said


def instructions(operation: str, chain: int) -> float:
    """Instructions per operation: callgrind on two counts of operations, differenced."""
    few, many = 1_000, 4_000
    counts = [_callgrind(operation, chain, count) for count in (few, many)]
    return (counts[1] - counts[0]) / (many - few)


def _callgrind(operation: str, chain: int, count: int) -> int:
    """All instructions of one run of the program."""
    command = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null"]
    command += [str(find("tfdb_against_tf2")), "--count", operation, str(chain), str(count)]
    said = output_of(command, limit=600)[1]
    found = re.search(r"Collected : (\d+)", said)
    if found is None:
        raise _failed(command, "counted nothing")
    return int(found[1])


def _reason(text: str, code: int) -> str:
    lines = text.strip().splitlines()
    if lines:
        return lines[-1]
    return f"ended by {signal.Signals(-code).name}" if code < 0 else f"ended with {code}"


def _failed(command: list[str], reason: str) -> DriverFailed:
    shown = " ".join([Path(command[0]).name, *command[1:]])
    return DriverFailed(f"{reason} ({shown})", value=shown, reason=reason)

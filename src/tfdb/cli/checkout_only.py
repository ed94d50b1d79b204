"""Commands whose programs are part of a checkout and missing in a wheel."""

from __future__ import annotations

import importlib
import importlib.util

import click

import tfdb

COMMANDS = ("bench", "verify")


class MeasureMissing(tfdb.TfdbError):
    """The measuring programs are not installed. Field: value."""


def installed() -> bool:
    """Return whether this installation has the measuring programs."""
    return importlib.util.find_spec("tfdb_measure") is not None


def find(name: str, module: str, text: str) -> click.Command:
    """Import the command. If it is not installed, return one that raises `MeasureMissing`."""
    if not installed():
        return _without(name, text)
    command: click.Command = importlib.import_module(f"tfdb_measure.{module}").command
    return command


def _without(name: str, text: str) -> click.Command:
    @click.command(
        name,
        help=text,
        context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
    )
    def command() -> None:
        message = (
            f"`tfdb {name}` needs a source checkout: run `pip install -e .` there, or build a "
            "wheel with TFDB_MEASURE=1 in the environment"
        )
        raise MeasureMissing(message, value="tfdb_measure")

    return command

"""Commands whose programs are part of a checkout and missing in a wheel."""

from __future__ import annotations

import importlib
import importlib.util

import click

import tfdb

COMMANDS = {
    "bench": ("command", "tfdb bench --quick"),
    "verify": ("verify_command", "tfdb verify history.jsonl --steps 20"),
}
"""The module of each command in `tfdb_measure`, and an example."""


class MeasureMissing(tfdb.TfdbError):
    """The measuring programs are not installed. Field: value."""


def installed() -> bool:
    """Return whether this installation has the measuring programs."""
    return importlib.util.find_spec("tfdb_measure") is not None


def find(name: str, title: str) -> click.Command:
    """Import the command. If it is not installed, return one that raises `MeasureMissing`."""
    module, example = COMMANDS[name]
    if installed():
        found: click.Command = importlib.import_module(f"tfdb_measure.{module}").command
        return found
    needs = "It needs a source checkout that is installed as editable: pip install -e ."

    @click.command(
        name,
        help=f"{title}\n\nExample: {example}\n\n{needs}",
        context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
    )
    def command() -> None:
        message = (
            f"`tfdb {name}` needs a source checkout: run `pip install -e .` there, or build a "
            "wheel with TFDB_MEASURE=1 in the environment"
        )
        raise MeasureMissing(message, value="tfdb_measure")

    return command

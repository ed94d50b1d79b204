"""``tfdb bench``: measured by programs that a checkout has and a wheel has not."""

from __future__ import annotations

import importlib.util

import click

import tfdb


class BenchMissing(tfdb.TfdbError):
    """What measures is not installed. Fields: value."""


@click.command(
    "bench",
    context_settings={"ignore_unknown_options": True, "allow_extra_args": True},
)
def _missing() -> None:
    """The paper's evaluation on this machine: engines and tf2, CSV and a report.

    Example: tfdb bench --quick

    It is run from a checkout that is installed as editable: a wheel has none of its programs.
    """
    message = (
        "a wheel of tfdb measures nothing: install a checkout as editable (make .stamps/install "
        "there, or pip install -e .), or with TFDB_MEASURE=1 in the environment"
    )
    raise BenchMissing(message, value="tfdb_measure")


if importlib.util.find_spec("tfdb_measure") is None:
    command: click.Command = _missing
else:
    import tfdb_measure.command as measuring

    command = measuring.command

__all__ = ["command"]

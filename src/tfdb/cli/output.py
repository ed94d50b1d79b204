"""How commands speak: tables for people, one JSON object for programs, one line for errors.

`rich` is imported where it is used: a shell that completes a name waits for every import.
"""

# ruff: noqa: PLC0415

from __future__ import annotations

import json
import sys
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

SCHEMA = 1
"""The version of the JSON output: keys are added, never renamed or removed, within one version."""

_PIPE_WIDTH = 400


def console() -> Console:
    """Return standard output; wide where no terminal limits it: tables in pipes stay whole."""
    from rich.console import Console

    width = None if sys.stdout.isatty() else _PIPE_WIDTH
    return Console(width=width, highlight=False, emoji=False, markup=False)


def table(*columns: str, right: Sequence[str] = ()) -> Table:
    """Make a table without a frame; the columns named in `right` are flush right."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    made = Table(box=SIMPLE_HEAD, pad_edge=False, header_style="bold", show_edge=False)
    for name in columns:
        made.add_column(
            name, justify="right" if name in right else "left", overflow="fold", no_wrap=False
        )
    return made


def add_rows(made: Table, rows: Iterable[Sequence[str | Text]]) -> Table:
    """Add the rows to the table and return it; their text is taken literally."""
    from rich.text import Text

    for row in rows:
        made.add_row(*(cell if isinstance(cell, Text) else Text(cell) for cell in row))
    return made


def quiet(text: str) -> Text:
    """Give the text less weight."""
    return _styled(text, "dim")


def loud(text: str) -> Text:
    """Make the text ask for attention."""
    return _styled(text, "bold red")


def _styled(text: str, style: str) -> Text:
    from rich.text import Text

    return Text(text, style=style)


def emit_json(command: str | None, body: dict[str, Any]) -> None:
    """Print the command's one JSON object."""
    click.echo(json.dumps({"tfdb": SCHEMA, "command": command, **body}, indent=2))


def emit_json_line(command: str, body: dict[str, Any]) -> None:
    """Print one of the JSON objects of a command that goes on, in a line."""
    click.echo(json.dumps({"tfdb": SCHEMA, "command": command, **body}))


def describe_error(error: Exception) -> str:
    """Return the message of an error in one line; for a misuse, with where to read the usage."""
    if isinstance(error, click.ClickException):
        text = error.format_message()
    elif isinstance(error, OSError) and error.filename is not None:
        text = f"{error.filename}: {error.strerror or error}"
    else:
        text = str(error)
    text = " ".join(text.split())
    if isinstance(error, click.UsageError):
        path = error.ctx.command_path if error.ctx is not None else "tfdb"
        text = f"{text.rstrip('.')}; see '{path} --help'"
    return text


def error_body(error: Exception) -> dict[str, Any]:
    """Return what ``--json`` prints for an error: its class, its message and its fields.

    A misuse of the command line is an `InvalidArgument`.
    """
    name, fields = type(error).__name__, vars(error)
    if isinstance(error, click.ClickException):
        name, fields = "InvalidArgument", {}
    shown = {
        key: value
        for key, value in sorted(fields.items())
        if isinstance(value, str | int | float | list | tuple) and not key.startswith("_")
    }
    return {"error": {"type": name, "message": describe_error(error), "fields": shown}}

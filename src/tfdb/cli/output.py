"""How commands speak to programs: one JSON object; and of errors: one line.

Text for people is laid out by `layout`.
"""

from __future__ import annotations

import errno
import json
import sys
from typing import Any

import click

from .layout import safe

SCHEMA = 1
"""The version of the JSON output: keys are added, never renamed or removed, within one version."""


def say(text: str = "", *, err: bool = False, nl: bool = True) -> None:
    """Print a text, on stderr if asked; what the encoding there lacks is written out.

    Left to itself, `click.echo` takes ASCII for a mistake and writes UTF-8.
    """
    click.echo(text, sys.stderr if err else sys.stdout, nl=nl)


def emit_json(command: str | None, body: dict[str, Any]) -> None:
    """Print the command's one JSON object."""
    say(json.dumps({"tfdb": SCHEMA, "command": command, **body}, indent=2))


def emit_json_line(command: str | None, body: dict[str, Any]) -> None:
    """Print one of the JSON objects of a command that goes on, in a line."""
    say(json.dumps({"tfdb": SCHEMA, "command": command, **body}))


def describe_error(error: Exception, command: str | None = None) -> str:
    """Return the message of an error in one line; for a misuse, with where to read the usage.

    That is of `command` where the error does not say itself.
    """
    if isinstance(error, click.NoSuchOption):
        from .groups import describe_unknown_option  # noqa: PLC0415 - it prints by this module

        text = describe_unknown_option(error)
    elif isinstance(error, click.ClickException):
        text = error.format_message()
    elif isinstance(error, OSError) and error.filename is not None:
        text = f"{error.filename}: {error.strerror or error}"
    elif isinstance(error, OSError) and error.errno == errno.ENOSPC:
        text = "the output cannot be written: no space is left"
    elif isinstance(error, OSError) and error.strerror:
        text = error.strerror
    else:
        text = str(error)
    text = safe(" ".join(text.split()))
    if isinstance(error, click.UsageError):
        path = f"tfdb {command or ''}".rstrip()
        if error.ctx is not None:
            path = error.ctx.command_path
        text = f"{text.rstrip('.')}; see '{path} --help'"
    return text


def error_body(error: Exception, command: str | None = None) -> dict[str, Any]:
    """Return what ``--json`` prints for an error: its class, its message and its fields.

    A misuse of the command line is an `InvalidArgument`.
    """
    name, fields = type(error).__name__, vars(error)
    if isinstance(error, click.ClickException):
        name, fields = "InvalidArgument", {}
    shown = {
        key: value
        for key, value in sorted(fields.items())
        if (isinstance(value, str | int | float | list | tuple) or key == "groups")
        and not key.startswith("_")
    }
    return {"error": {"type": name, "message": describe_error(error, command), "fields": shown}}

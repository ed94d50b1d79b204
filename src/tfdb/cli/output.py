"""Output for programs: one JSON object. Errors: one line.

`layout` lays out text for people.
"""

from __future__ import annotations

import errno
import json
import sys
from typing import Any

import click

from .layout import prose, safe

SCHEMA = 1
"""Version of the JSON output. Within a version keys are added, never renamed or removed."""


def say(text: str = "", *, err: bool = False, nl: bool = True) -> None:
    """Print a text on stdout or stderr; characters that its encoding lacks are escaped.

    `click.echo` would write UTF-8 to an ASCII output.
    """
    click.echo(text, sys.stderr if err else sys.stdout, nl=nl)


def warn(text: str) -> None:
    """Print a warning on stderr."""
    say(f"tfdb: warning: {text}", err=True)


def say_wrapped(text: str, *names: str) -> None:
    """Print prose in lines of the terminal's width; no name of `names` is broken."""
    say(prose(text, *names))


def emit_json(command: str | None, body: dict[str, Any]) -> None:
    """Print the command's one JSON object."""
    say(json.dumps({"tfdb": SCHEMA, "command": command, **body}, indent=2))


def emit_json_line(command: str | None, body: dict[str, Any]) -> None:
    """Print one of several JSON objects of a command, in one line."""
    say(json.dumps({"tfdb": SCHEMA, "command": command, **body}))


def describe_error(error: Exception, command: str | None = None) -> str:
    """Return the message of an error in one line; for a wrong command line, with the help command.

    The help is that of the error's own command, otherwise that of `command`.
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
    """Return an error as JSON: its class, message and fields.

    A wrong command line is an `InvalidArgument`.
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

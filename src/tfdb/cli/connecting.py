"""Common code of `publish` and `mirror`: options of the connection, printed events."""

from __future__ import annotations

import logging
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import click

from . import output

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb.net import Event, Home, Mirror, Session

_OPTIONS = (
    click.option(
        "--connect",
        multiple=True,
        metavar="ENDPOINT",
        help="Connect to this Zenoh router. Repeatable: if one is missing, the next is tried.  "
        "[default: tcp/127.0.0.1:7447]",
    ),
    click.option(
        "--listen",
        multiple=True,
        metavar="ENDPOINT",
        help="Act as a Zenoh router at this address, such as tcp/127.0.0.1:7447; repeatable.",
    ),
    click.option(
        "--config",
        type=click.Path(),
        metavar="FILE",
        help="Read the connection from this Zenoh configuration file.",
    ),
)


def network_options(function: Any) -> Any:
    """Add the options of `connected`."""
    for option in reversed(_OPTIONS):
        function = option(function)
    return function


def connected(
    connect: tuple[str, ...],
    listen: tuple[str, ...],
    config: str | None,
    missing: Callable[[str], None] = output.warn,
    *,
    wait: float | None = None,
) -> Session:
    """Return the connection that the options describe, for a `with` statement.

    It waits for a missing router, and calls `missing` once.
    """
    from tfdb.net import Session  # noqa: PLC0415 - Zenoh is an extra

    return Session(connect=connect, listen=listen, config=config, wait=wait, on_wait=missing)


def follow_events(command: str, what: Home | Mirror, *, as_json: bool) -> None:
    """Print events until Ctrl-C, or until `what` ends. Raises the error that ended it."""
    logging.getLogger("tfdb.net").addHandler(logging.NullHandler())  # else stderr has them as well
    with suppress(KeyboardInterrupt):  # the usual end
        for event in what.events():
            show_event(command, event, as_json=as_json)
    if what.error is not None:
        raise what.error


def show_event(command: str, event: Event, *, as_json: bool) -> None:
    """Print an event at once."""
    if as_json:
        body = {"name": event.name, "event": event.kind, "text": event.text, "time_ns": event.time}
        output.emit_json_line(command, body)
        sys.stdout.flush()
        return
    output.say_wrapped(str(event), event.name)

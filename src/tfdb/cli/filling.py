"""Options of the commands that fill a shared store."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

import tfdb

from .times import NS, seconds_option

if TYPE_CHECKING:
    from collections.abc import Callable

    from click.decorators import FC

    from tfdb import Buffer

into_option: Callable[[FC], FC] = click.option(
    "--into", metavar="NAME", required=True, help="Name of the store; a missing one is created."
)
history_option: Callable[[FC], FC] = seconds_option(
    "--history", default="10", help="Seconds of history that a new store keeps."
)


def open_store(name: str, history: int | None) -> Buffer:
    """Open a shared store; create it if it is missing."""
    return tfdb.Buffer.open(name, history=None if history is None else history / NS)

"""``tfdb publish``: sends the commits of a store to other machines."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import click

import tfdb
from tfdb.data.counting import counted

from . import common, output
from .connecting import connected, follow_events, network_options
from .graph import STORE, is_graph, open_live
from .groups import SuggestingCommand
from .times import NS, seconds_option

if TYPE_CHECKING:
    from tfdb import Buffer
    from tfdb.net import Home


@click.command("publish", cls=SuggestingCommand)
@click.argument("source", metavar="STORE|FILE")
@click.option("--as", "name", required=True, metavar="NAME", help="Namespace to publish under.")
@seconds_option(
    "--max-delay",
    default="0.002",
    help="Longest time that a commit waits, so that it is sent together with later ones.",
)
@click.option(
    "--take-over",
    is_flag=True,
    help="Take over a namespace that has a home; that home then stops.",
)
@click.option(
    "--keep-lost",
    metavar="FILE",
    help="If a later home takes over, write the commits that it lacks to this new file. If some of"
    " them are unknown or no longer kept, write the state.",
)
@network_options
@common.json_lines_option
def command(
    *,
    source: str,
    name: str,
    max_delay: int,
    take_over: bool,
    keep_lost: str | None,
    connect: tuple[str, ...],
    listen: tuple[str, ...],
    config: str | None,
    as_json: bool,
) -> None:
    """Publish a shared store or a file for other machines, until Ctrl-C.

    Example: tfdb publish shm:robot1 --as robot1 --listen tcp/127.0.0.1:7447

    This process becomes the home of the namespace NAME. 'tfdb mirror NAME' on another machine
    copies each commit. A FILE is a recording or a frozen store; its state does not change. The
    command waits for a missing router. With --listen it starts at once, and connects once the
    router answers.

    If a later home takes over, this command ends. The frames of STORE are then read-only, and 'tfdb
    mirror --into STORE' can copy the later home. If this user may only read STORE, it stays
    unchanged.

    Exit code: 0 after Ctrl-C, 1 if a later home took over, 2 on an error, 130 after Ctrl-C during
    the wait for a router.
    """
    from tfdb.net import publish  # noqa: PLC0415 - Zenoh is an extra
    from tfdb.net.link import check_network_name  # noqa: PLC0415 - as above

    check_network_name(name)
    began = time.monotonic()
    store = _open(source)
    with (
        connected(connect, listen, config) as session,
        publish(
            store,
            name,
            session=session,
            max_delay=max_delay / NS,
            take_over=take_over,
            keep_lost=keep_lost,
        ) as home,
    ):
        if not as_json:
            output.say_wrapped(f"{source} as {name}; Ctrl-C ends it", source, name)
        follow_events("publish", home, as_json=as_json)
        state = home.state
    _show_end(home, source, state, began, as_json=as_json)
    if state == "fenced":
        click.get_current_context().exit(1)


def _open(source: str) -> Buffer:
    if source.startswith(STORE):
        try:  # a home that stops makes its store read-only, one that begins makes it writable
            return tfdb.Buffer.open(source.removeprefix(STORE), create=False)
        except tfdb.errors.ReadOnly:  # this user may read it
            return open_live(source)
    if is_graph(source):
        raise click.UsageError(
            f"{source} is a live graph: fill a shared store with 'tfdb serve', and publish that"
        )
    return common.load([source]).store  # type: ignore[return-value]


def _show_end(home: Home, source: str, state: str, began: float, *, as_json: bool) -> None:
    stats = home.stats
    seconds = round(time.monotonic() - began, 3)
    if as_json:
        body = {"source": source, "name": home.name, "state": state, **stats._asdict()}
        output.emit_json_line("publish", {**body, "seconds": seconds})
        return
    text = f"{counted(stats.commits, 'commit')} in {counted(stats.messages, 'message')}"
    text += f", {stats.bytes / 1e6:,.1f} MB, {counted(stats.answers, 'answer')}"
    output.say_wrapped(text)

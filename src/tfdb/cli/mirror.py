"""``tfdb mirror``: copies the commits of a home on another machine into a shared store."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import click

from tfdb.data.counting import counted

from . import common, output
from .connecting import connected, follow_events, network_options, show_event
from .filling import history_option, into_option, open_store
from .graph import STORE
from .groups import SuggestingCommand

if TYPE_CHECKING:
    from tfdb.net import Mirror


@click.command("mirror", cls=SuggestingCommand)
@click.argument("name", metavar="NAME")
@into_option
@click.option(
    "--prefix",
    default="",
    show_default=False,
    metavar="TEXT",
    help="Put TEXT before the name of each frame.",
)
@click.option(
    "--shared",
    multiple=True,
    metavar="FRAME",
    help="Keep the name of this frame without the prefix; repeatable.",
)
@click.option(
    "--max-lag",
    type=click.IntRange(min=1),
    metavar="COMMITS",
    help="If the mirror lacks more commits than this, copy the newest state instead.",
)
@history_option
@network_options
@common.json_lines_option
def command(
    *,
    name: str,
    into: str,
    prefix: str,
    shared: tuple[str, ...],
    max_lag: int | None,
    history: int | None,
    connect: tuple[str, ...],
    listen: tuple[str, ...],
    config: str | None,
    as_json: bool,
) -> None:
    """Follow the store of another machine into a shared store, until Ctrl-C.

    Example: tfdb mirror robot1 --into fleet --prefix robot1/ --shared map

    NAME is the namespace of 'tfdb publish' on the other machine, the home. While the home is gone,
    and after the command ends, the store keeps its last state. A later run continues from there.
    The command waits for a missing router. With --listen it starts at once, and connects once the
    router answers.

    Exit code: 0 after Ctrl-C, 1 if the home was gone at that time, 2 on an error. Ctrl-C during the
    wait for a router gives 130.
    """
    from tfdb.net import Event, mirror  # noqa: PLC0415 - Zenoh is an extra
    from tfdb.net.link import check_network_name  # noqa: PLC0415 - as above

    began = time.monotonic()
    check_network_name(name)
    store = into.removeprefix(STORE)

    def missing(text: str) -> None:
        show_event("mirror", Event(time.time_ns(), name, "absent", text), as_json=as_json)

    with (
        connected(connect, listen, config, missing) as session,
        mirror(
            name,
            into=open_store(store, history),
            prefix=prefix,
            shared=shared,
            max_lag=max_lag,
            session=session,
        ) as following,
    ):
        if not as_json:
            output.say_wrapped(f"{name} into shm:{store}; Ctrl-C ends it", name)
        follow_events("mirror", following, as_json=as_json)
        state = following.state
    _show_end(following, store, state, began, as_json=as_json)
    if state in ("absent", "stale"):
        click.get_current_context().exit(1)


def _show_end(mirror: Mirror, store: str, state: str, began: float, *, as_json: bool) -> None:
    stats = mirror.stats
    position = mirror.position
    commit = 0 if position is None else position.commit
    if as_json:
        body = {"name": mirror.name, "store": store, "state": state, "commit": commit}
        seconds = round(time.monotonic() - began, 3)
        output.emit_json_line("mirror", {**body, **stats._asdict(), "seconds": seconds})
        return
    text = f"commit {commit}: {counted(stats.commits, 'commit')}, {counted(stats.states, 'state')}"
    text += f", {counted(stats.requests, 'request')} to the home, {stats.bytes / 1e6:,.1f} MB"
    output.say_wrapped(text)

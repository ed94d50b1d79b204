"""``tfdb buffer-server``: answers lookups of other nodes."""

from __future__ import annotations

import math
from contextlib import ExitStack

import click

from . import common, output
from .graph import STORE, Live, listening, node_option, open_graph, open_live
from .groups import SuggestingCommand
from .times import seconds_option


@click.command("buffer-server", cls=SuggestingCommand)
@click.argument("where", metavar="GRAPH")
@click.option(
    "--store",
    metavar="NAME",
    help="Answer from this shared store, filled by 'tfdb serve', instead of listening.",
)
@click.option(
    "--action",
    metavar="NAME",
    default="tf2_buffer_server",
    help="Name of the action server of type LookupTransform.",
)
@seconds_option(
    "-c", "--cache-time", default="120", help="Seconds of history to keep of the graph."
)
@node_option
@common.json_option
def command(*, where: str, store: str | None, action: str, cache_time: int, as_json: bool) -> None:
    """Answer the lookups of other nodes, like tf2's buffer_server.

    Example: tfdb buffer-server ros1: --store robot1

    Runs until Ctrl-C. A waiting goal is answered as soon as its transform is committed.
    """
    from tfdb import tf2  # noqa: PLC0415 - it is much

    with ExitStack() as stack:
        if store is None:
            live = stack.enter_context(listening(where, history=cache_time))
        else:
            opened = open_live(store)
            node, ended = stack.enter_context(open_graph(where))
            live = Live(opened, node.now, node, ended=ended)
        buffer = tf2.Buffer(buffer=live.store, node=live.node, clock=live.node)
        stack.enter_context(tf2.BufferServer(buffer, action, node=live.node))
        if as_json:
            body = {"files": [where], "node": live.node_name, "action": action, "store": store}
            output.emit_json("buffer-server", body)
        else:
            origin = "" if store is None else f" from {STORE}{store.removeprefix(STORE)}"
            output.say_wrapped(f"{where} as {live.node_name}, {action}{origin}; Ctrl-C ends it")
        live.sleep(math.inf)

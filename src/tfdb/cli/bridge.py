"""``tfdb bridge``: carries transforms between a shared store and a live graph."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import click

from . import output
from .graph import STORE, listening
from .groups import OneOf, SuggestingCommand, SuggestingGroup
from .serve import describe_graph, domain_option, graph_options, master_option, say_end

if TYPE_CHECKING:
    from collections.abc import Callable


@click.group("bridge", cls=SuggestingGroup)
def command() -> None:
    """Carry transforms between a shared store and a live graph, both ways.

    Example: tfdb bridge ros2 --rmw zenoh robot1
    """


def _origin_option(example: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    return click.option(
        "--origin",
        metavar="NAME",
        help="Name of the graph, without / and spaces; the authorities of its transforms begin "
        f"with it.  [default: such as {example}]",
    )


@command.command("ros1", cls=SuggestingCommand)
@click.argument("store", metavar="STORE")
@master_option
@_origin_option("ros1:http://localhost:11311")
@graph_options
def ros1(
    *, store: str, master: str, origin: str | None, history: int | None, as_json: bool
) -> None:
    """Carry transforms between STORE and a ROS 1 graph, until Ctrl-C.

    Example: tfdb bridge ros1 robot1

    It does for a ROS 1 graph what 'tfdb bridge ros2' does for ROS 2. It needs no ROS package.
    from:=to and __name:=NAME work as in ROS.
    """
    _bridge(f"ros1:{master}", store, origin, history, as_json=as_json)


@command.command("ros2", cls=SuggestingCommand)
@click.argument("store", metavar="STORE")
@domain_option
@click.option(
    "--rmw",
    type=OneOf(["zenoh", "dds"]),
    required=True,
    help="Join a graph of rmw_zenoh, or one over DDS. Neither needs a ROS package.",
)
@_origin_option("ros2+zenoh:7")
@graph_options
def ros2(
    *,
    store: str,
    domain: str,
    rmw: str,
    origin: str | None,
    history: int | None,
    as_json: bool,
) -> None:
    """Carry transforms between STORE and a ROS 2 graph, until Ctrl-C.

    Example: tfdb bridge ros2 --rmw zenoh robot1

    Each message on /tf and /tf_static becomes one commit of the shared store. Each commit of other
    writers becomes one message on /tf. Late joiners get all static transforms in one message on
    /tf_static.

    Transforms from the graph are not sent back to it: their authority begins with the graph's name.
    One store can therefore join two graphs by two bridges. A second bridge to the same graph is
    refused. Do not join two stores to the same two graphs: transforms would circulate.

    A missing store is created. The command waits for a missing graph. --ros-args works as in ROS.
    The store stays when the command ends.
    """
    _bridge(f"ros2+{rmw}:{domain}", store, origin, history, as_json=as_json)


def _bridge(
    graph: str, store: str, origin: str | None, history: int | None, *, as_json: bool
) -> None:
    from tfdb.bridge.bridge import check_origin  # noqa: PLC0415 - --help does not need it

    name = store.removeprefix(STORE)
    if origin is not None:
        check_origin(origin)
    began = time.monotonic()
    with listening(graph, history=history, into=name, both_ways=True, origin=origin) as live:
        bridge: Any = live.bridge
        if not as_json:
            output.say_wrapped(f"{graph} as {live.node_name} and shm:{name}; Ctrl-C ends it")
        try:
            bridge.wait()
        finally:
            bridge.close()
            body, text = describe_graph(live, began)
            stats = bridge.stats
            body |= {"origin": bridge.origin, **stats._asdict()}
            text += f"; {stats.received:,} received, {stats.sent:,} sent"
            text += f", {stats.sent_static:,} on /tf_static"
            if stats.missed or stats.gone:
                text += f"; not sent: {stats.missed:,} commits, {stats.gone:,} samples"
            say_end(graph, name, "bridge", body, text, as_json=as_json)

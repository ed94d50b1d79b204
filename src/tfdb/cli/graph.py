"""Live graphs as FILE arguments: `ros1:`, `ros1:http://host:port`, `ros2:`, `ros2:7`.

`ros2+zenoh:` is a graph of rmw_zenoh, `ros2+dds:` one over DDS; their nodes need no ROS.

A command makes its own node, which fills a store. It follows this store like a shared one.
"""

from __future__ import annotations

import logging
import math
import os
import re
import threading
import time
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NoReturn

import click

import tfdb
from tfdb.data.errors import NotSupported
from tfdb.data.time_text import format_duration
from tfdb.store.given_clock import given_clock
from tfdb.store.shared import path_of

from . import output
from .times import NS, duration_option

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from click.decorators import FC

    from tfdb.bridge import Bridge
    from tfdb.ros import Flavor, Node
    from tfdb.tf2 import TransformListener

_ROS_ARGUMENTS = "tfdb.ros_arguments"
_NODE_NAME = "tfdb.node_name"
_SECONDS = "tfdb.seconds"
LISTENS = 5 * NS
"""Default time of listening to a graph, as in tf2's view_frames."""
_LOOK = 1.0
"""Seconds between two checks for the end of the node or the store."""
_AGAIN = 0.5
"""Seconds between two attempts to join a missing graph."""
_GRAPH = re.compile(r"(ros1|ros2(?:\+(zenoh|dds))?)(?::(.*))?", re.DOTALL)
_REMAPPING = re.compile(r"[~/A-Za-z_][A-Za-z0-9_/]*:=.*", re.ASCII | re.DOTALL)


STORE = "shm:"
"""Prefix of the name of a shared store in a FILE argument."""


def is_graph(name: str) -> bool:
    """Return whether a FILE argument names a live graph."""
    return name.startswith(("ros1:", "ros2:", "ros2+zenoh:", "ros2+dds:"))


def without_ros_arguments(ctx: click.Context, arguments: list[str]) -> list[str]:
    """Remove the arguments for ROS from a command line; `open_graph` passes them on.

    These are `--ros-args ... [--]` of ROS 2 and `from:=to` of ROS 1. Without a graph in the command
    line nothing is removed: a file may have such a name.
    """
    if not any(_GRAPH.fullmatch(argument) for argument in arguments):
        return arguments
    ours: list[str] = []
    theirs, to_ros = [], False
    for argument in arguments:
        if to_ros:
            theirs.append(argument)
            to_ros = argument != "--"
        elif argument == "--ros-args":
            theirs.append(argument)
            to_ros = True
        elif _REMAPPING.fullmatch(argument) and ours[-1:] != ["--rename"]:
            theirs.append(argument)
        else:
            ours.append(argument)
    ctx.meta[_ROS_ARGUMENTS] = theirs
    return ours


def _kept(key: str) -> Callable[[click.Context, click.Parameter, Any], None]:
    def keep(ctx: click.Context, _param: click.Parameter, value: Any) -> None:
        ctx.meta[key] = value

    return keep


node_option: Callable[[FC], FC] = click.option(
    "--node-name",
    metavar="NAME",
    expose_value=False,
    callback=_kept(_NODE_NAME),
    help="Name of this command's node in the graph.  [default: tfdb_COMMAND_PID]",
)


def listen_option(command: Any) -> Any:
    """Add the options for listening to a graph to a command that reads once."""

    def keep(ctx: click.Context, param: click.Parameter, value: str | None) -> None:
        ctx.meta[_SECONDS] = duration_option(ctx, param, value)

    option = click.option(
        "--for",
        metavar="SECONDS",
        expose_value=False,
        callback=keep,
        help="Listen to a live graph (ros1:, ros2:) for this long.  [default: 5]",
    )
    return option(node_option(command))


def listening_time() -> int:
    """Return for how many nanoseconds to listen to a graph."""
    context = click.get_current_context(silent=True)
    given: int | None = None if context is None else context.meta.get(_SECONDS)
    return LISTENS if given is None else given


@dataclass
class Live:
    """A store that other processes or a node fill, with the clock of its stamps."""

    store: tfdb.Buffer
    graph_clock: Callable[[], int] | None = None
    """Returns the time of a graph; None: the clock of the store counts."""
    node: Node | None = None
    listener: TransformListener | None = None
    commit: int = 0
    """The last commit that was seen."""
    ended: threading.Event = field(default_factory=threading.Event)
    """Set when the graph's node is closed from outside."""
    bridge: Bridge | None = None

    def __post_init__(self) -> None:
        other = self.graph_clock or given_clock(self.store)
        self.clock: tfdb.Clock | None = self.store.clock if other is None else None
        self.now: Callable[[], int] = other or self.store.clock.now
        """Return the time in nanoseconds, by the clock of the stamps."""

    @property
    def node_name(self) -> str:
        """Name of the graph's node; empty without one."""
        return "" if self.node is None else self.node.name

    def wait(self, until: float) -> bool:
        """Wait for a new commit until a monotonic time; return whether one came.

        Raises BufferClosed when the graph's node ends, NoSuchStore when the store is removed.
        """
        left = None if math.isinf(until) else max(until - time.monotonic(), 0.0)
        try:
            self.commit = self.store.wait_for_commit(self.commit, left)
        except tfdb.WaitTimeout:
            return False
        return True

    def sleep(self, until: float) -> None:
        """Wait until a monotonic time. Raises as `check`."""
        self.check()
        while (left := until - time.monotonic()) > 0:
            self.ended.wait(min(left, _LOOK))
            self.check()

    def check(self) -> None:
        """Raise NodeClosed if the graph's node has ended, NoSuchStore if the store was removed."""
        if self.node is not None and self.ended.is_set():
            wait_for_end(self.node, self.ended)
        # A reader without write permission cannot wait, and then a removal goes unnoticed.
        with suppress(tfdb.WaitTimeout, NotSupported):
            self.store.wait_for_commit(self.store.commit, 0)


@contextmanager
def open_graph(name: str, *, waits: bool = False) -> Iterator[tuple[Node, threading.Event]]:
    """Make this command's node in the graph `name`; yield it with the event `Live.ended`.

    `waits`: if no master or router answers, warn once and try again.
    """
    from tfdb.ros.open_node import open_node  # noqa: PLC0415 - only for live graphs

    context = click.get_current_context()
    match = _GRAPH.fullmatch(name)
    if match is None:
        raise click.UsageError(
            f"{name!r} is not a graph: give ros1:, ros1:URI, ros2:, ros2:DOMAIN,"
            " ros2+zenoh:DOMAIN or ros2+dds:DOMAIN"
        )
    side: Flavor = "ros1" if match[1] == "ros1" else "ros2"
    plain = re.sub(r"\W", "_", context.command_path.removeprefix("tfdb "))
    own = context.meta.get(_NODE_NAME) or f"tfdb_{plain}_{os.getpid()}"
    arguments: Sequence[str] = context.meta.get(_ROS_ARGUMENTS, ())
    ended, leaves = threading.Event(), threading.Event()
    wire: Any = match[2]
    where = match[3] or ""
    with ExitStack() as stack:

        def join() -> Node:
            return stack.enter_context(
                open_node(side, own, where=where, arguments=arguments, without_ros=wire)
            )

        node = _join_when_up(join) if waits else join()

        def look(_now: int) -> None:
            if node.closed and not leaves.is_set():
                ended.set()

        node.on_clock(look)
        try:
            yield node, ended
        finally:
            leaves.set()


def _join_when_up(join: Callable[[], Node]) -> Node:
    told = False
    while True:
        try:
            return join()
        except ConnectionError as error:
            if not told:
                text = " ".join(str(error).split())
                output.warn(f"{text}; waiting for it")
            told = True
        time.sleep(_AGAIN)


def wait_for_end(node: Node, ended: threading.Event) -> NoReturn:
    """Wait until a signal ends the command. Raises NodeClosed if the node ends before."""
    ended.wait()
    text = f"the node {node.name} was stopped from outside"
    raise tfdb.errors.NodeClosed(text, reason="stopped from outside")


@contextmanager
def listening(
    name: str,
    *,
    history: int | None,
    into: str | None = None,
    both_ways: bool = False,
    origin: str | None = None,
) -> Iterator[Live]:
    """Fill a private store, or the named shared one, from the graph `name`.

    `history`: nanoseconds that a new store keeps; None: everything. `both_ways`: a bridge also
    sends the commits of the shared store; `origin` as in `Bridge`. It waits for a missing graph.

    Raises NodeClosed instead of BufferClosed if the graph's node has ended.
    """
    from tfdb import tf2  # noqa: PLC0415 - only those who listen need it

    _show_log()
    seconds = None if history is None else max(history, 1) / NS
    if into is not None:
        path_of(into)  # refuse an invalid name before the wait
    with ExitStack() as stack:
        node, ended = stack.enter_context(open_graph(name, waits=both_ways))
        if into is None:
            store = tfdb.Buffer(history=seconds)
            # The end of the node ends waits for commits.
            node.on_clock(lambda _: store.close() if ended.is_set() else None)
        else:
            store = tfdb.Buffer.open(into, history=seconds)
        live = Live(store, node.now, node, commit=store.commit, ended=ended)
        if both_ways:
            from tfdb.bridge import Bridge  # noqa: PLC0415 - for one command

            theirs: Any = node  # its messages name their sender
            live.bridge = stack.enter_context(Bridge(store, theirs, origin=origin))
            live.listener = live.bridge.listener
        else:
            served = None if into is None else node
            buffer = tf2.Buffer(buffer=store, node=served, clock=node, flavor=node.flavor)
            live.listener = tf2.TransformListener(buffer, node, spin_thread=True)
        try:
            yield live
        except tfdb.errors.BufferClosed:
            live.check()
            raise


@contextmanager
def live_source(name: str, *, history: int = 10 * NS) -> Iterator[Live]:
    """Open the live source of a command: a graph, or a shared store."""
    if is_graph(name):
        with listening(name, history=history) as live:
            yield live
    else:
        with open_live(name) as store:
            yield Live(store, commit=store.commit)


def open_live(name: str) -> tfdb.Buffer:
    """Open the store `shm:NAME` for reading."""
    return tfdb.Buffer.open(name.removeprefix(STORE), create=False, mode="r")


def listen_once(
    name: str, there: Callable[[tfdb.Buffer], bool] | None = None
) -> tuple[tfdb.Snapshot, int]:
    """Listen for the time of the command line, or until `there` holds for the store.

    Returns a snapshot of the received transforms, and its time by the graph's clock.
    """
    until = time.monotonic() + listening_time() / NS
    with listening(name, history=None) as live:
        while time.monotonic() < until and (there is None or not there(live.store)):
            live.wait(until)
        live.check()
        heard = live.store.snapshot(), live.now()
    if live.commit == 0:
        waited = format_duration(listening_time())
        output.warn(f"no message arrived on /tf and /tf_static of {name} in {waited}")
    return heard


_MOST_TOLD = 1000
"""Largest number of printed refused edges: damaged messages can name any number of frames."""


class _Lines(logging.Handler):
    """Prints log records as warnings of the command; each refused edge once for each error.

    Any thread may log: the handler's lock is held in `emit`.
    """

    def __init__(self) -> None:
        super().__init__()
        self._told: set[tuple[str, str | None, str | None]] = set()

    def emit(self, record: logging.LogRecord) -> None:
        error = getattr(record, "error", None)
        if isinstance(error, tfdb.TfdbError) and error.edge is not None:
            key = type(error).__name__, error.edge, error.authority
            if key in self._told or len(self._told) > _MOST_TOLD:
                return
            self._told.add(key)
        text = " ".join(record.getMessage().split())
        output.say(f"tfdb: {record.levelname.lower()}: {text}", err=True)


def _show_log() -> None:
    """Print the warnings of the listener."""
    logger = logging.getLogger("tfdb")
    if not logger.handlers:
        logger.addHandler(_Lines())

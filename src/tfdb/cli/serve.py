"""``tfdb serve``: fills a shared store."""

from __future__ import annotations

import math
import time
from copy import copy
from typing import TYPE_CHECKING, Any

import click

from tfdb.data.counting import counted
from tfdb.data.time_text import format_duration
from tfdb.recordings.following import Following, refuse_mixture_so_far
from tfdb.store.summary import span

from . import common, output
from .filling import history_option, into_option, open_store
from .graph import STORE, listening, node_option
from .groups import OneOf, SuggestingCommand, SuggestingGroup
from .play import command as play
from .selecting import selected, selection_options
from .times import NS

if TYPE_CHECKING:
    from collections.abc import Callable

    from click.decorators import FC

    from tfdb.recordings.load_report import LoadReport

    from .graph import Live


@click.group("serve", cls=SuggestingGroup)
def command() -> None:
    """Fill a shared store from a live graph, or from a file that grows.

    Example: tfdb serve ros2 --into robot1
    """


_old_name = copy(play)
_old_name.hidden = True
command.add_command(_old_name, "bag")


@command.command("follow", cls=SuggestingCommand)
@common.file_argument
@into_option
@click.option(
    "--timeout",
    type=click.FloatRange(min=0, min_open=True),
    metavar="SECONDS",
    help="Stop with an error if FILE has not grown for this long.  [default: wait]",
)
@history_option
@selection_options
@common.json_option
def follow(
    *,
    file: str,
    into: str,
    timeout: float | None,
    history: int | None,
    as_json: bool,
) -> None:
    """Load an MCAP file into the store NAME while it is written.

    Example: tfdb serve follow running.mcap --into robot1

    Messages arrive chunk by chunk, as the recorder writes them. The command ends when the recorder
    has closed FILE. The store stays when the command ends or is stopped by Ctrl-C.

    --frame, --keep, --urdf and offsets from the first or last stamp are refused, because they need
    a finished file. If topics disagree on an edge, the command stops with an error; the store keeps
    the earlier messages.
    """
    (path,) = common.find_paths([file])
    common.refuse_frozen([path])
    selection = selected()
    name = into.removeprefix(STORE)
    # A file that cannot be followed is refused before the store is made.
    refuse_mixture_so_far(path, selection)
    store = open_store(name, history)
    if not as_json:
        output.say_wrapped(f"{file} into shm:{name}, as it grows; Ctrl-C ends it", file)
    following = Following(store, path, selection, timeout=timeout)
    try:
        following.run()
    except KeyboardInterrupt:
        _show_followed(following.report(1, whole=False), file, name, as_json=as_json)
        raise
    _show_followed(following.report(1), file, name, as_json=as_json)


def _show_followed(report: LoadReport, file: str, name: str, *, as_json: bool) -> None:
    if as_json:
        shown = {"messages": report.messages, "transforms": report.transforms}
        more = {
            "refused": report.refused,
            "refused_transforms": report.refused_transforms,
            "seconds": round(report.seconds, 3),
        }
        output.emit_json("serve follow", {"files": [file], "store": name, **shown, **more})
        return
    passed = format_duration(round(report.seconds * NS))
    output.say_wrapped(f"{report.stored_counts}, loaded in {passed}")


def graph_options(function: Any) -> Any:
    """Add the options that `serve` and `bridge` share."""
    for option in (common.json_option, node_option, history_option):
        function = option(function)
    return function


master_option: Callable[[FC], FC] = click.option(
    "--master",
    metavar="URI",
    default="",
    show_default=False,
    help="URI of the ROS master.  [default: ROS_MASTER_URI]",
)
domain_option: Callable[[FC], FC] = click.option(
    "--domain",
    metavar="ID",
    default="",
    show_default=False,
    help="Number of the ROS domain.  [default: ROS_DOMAIN_ID]",
)


@command.command("ros1", cls=SuggestingCommand)
@master_option
@into_option
@graph_options
def ros1(*, master: str, into: str, history: int | None, as_json: bool) -> None:
    """Fill the store NAME from /tf and /tf_static of a ROS 1 graph, until Ctrl-C.

    Example: tfdb serve ros1 --into robot1

    This process listens; other processes open the store: tfdb.Buffer.open("NAME") or
    tfdb.tf2.Buffer(store="NAME"). It needs no ROS package. from:=to and __name:=NAME work as in
    ROS. The store stays when the command ends.
    """
    _serve_graph(f"ros1:{master}", into, history, as_json=as_json)


@command.command("ros2", cls=SuggestingCommand)
@domain_option
@click.option(
    "--rmw",
    type=OneOf(["zenoh", "dds"]),
    help="Join a graph of rmw_zenoh, or one over DDS, without ROS."
    "  [default: rclpy, where it is installed]",
)
@into_option
@graph_options
def ros2(*, domain: str, rmw: str | None, into: str, history: int | None, as_json: bool) -> None:
    """Fill the store NAME from /tf and /tf_static of a ROS 2 graph, until Ctrl-C.

    Example: tfdb serve ros2 --domain 7 --into robot1

    This process listens; other processes open the store: tfdb.Buffer.open("NAME") or
    tfdb.tf2.Buffer(store="NAME"). It needs rclpy and tf2_msgs: source the setup.bash of ROS 2
    first. --rmw needs neither. --ros-args works as in ROS. The store stays when the command
    ends.
    """
    _serve_graph(f"ros2{f'+{rmw}' if rmw else ''}:{domain}", into, history, as_json=as_json)


def _serve_graph(graph: str, into: str, history: int | None, *, as_json: bool) -> None:
    name = into.removeprefix(STORE)
    began = time.monotonic()
    with listening(graph, history=history, into=name) as live:
        if not as_json:
            output.say_wrapped(f"{graph} as {live.node_name} into shm:{name}; Ctrl-C ends it")
        try:
            live.sleep(math.inf)
        finally:
            body, text = describe_graph(live, began)
            say_end(graph, name, "serve", body, text, as_json=as_json)


def describe_graph(live: Live, began: float) -> tuple[dict[str, Any], str]:
    """Describe the data that a store got from a graph, as JSON and as text."""
    commits, infos = live.store.commit - live.commit, live.store.tree()
    found = span(infos)
    listener = live.listener
    damaged = 0 if listener is None else listener.corrupt.total()
    refused = 0 if listener is None else listener.refused.total()
    seconds = time.monotonic() - began
    body = {
        "commits": commits,
        "damaged": damaged,
        "refused_transforms": refused,
        "frames": len(infos),
        "newest_ns": None if found is None else found[1],
        "seconds": round(seconds, 3),
    }
    text = f"{counted(commits, 'commit')}, {counted(len(infos), 'frame')}"
    text += f", received in {format_duration(round(seconds * NS))}"
    if damaged:
        text += f"; {counted(damaged, 'damaged message')} left out"
    if refused:
        text += f"; {counted(refused, 'transform')} refused"
    return body, text


def say_end(
    graph: str, store: str, command: str, body: dict[str, Any], text: str, *, as_json: bool
) -> None:
    """Print the result of a command on a graph."""
    if as_json:
        name = f"{command} {graph[:4]}"  # ros1 or ros2
        output.emit_json(name, {"files": [graph], "store": store, **body})
    else:
        output.say(text)

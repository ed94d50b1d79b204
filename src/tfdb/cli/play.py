"""``tfdb play``: plays recordings into a shared store, by its clock."""

from __future__ import annotations

import math
import os
import select
import sys
import threading
import time
from contextlib import contextmanager, nullcontext
from typing import TYPE_CHECKING

import click

import tfdb
from tfdb.data.time_text import format_duration
from tfdb.player.controls import CONTROLS, KEYS, obey

from . import common, output
from .filling import history_option, into_option, open_store
from .graph import STORE, open_graph
from .groups import SuggestingCommand
from .selecting import selection_options
from .times import NS

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tfdb.player.player import Player
    from tfdb.recordings.load_report import LoadReport
    from tfdb.recordings.rewriter import Rewriter
    from tfdb.ros.node import Node

_KEYS_HELP = (
    "space: pause, right and left: a commit forth and back, up and down: speed, 1 to 9: that "
    "speed, [ and ]: 5 s back and forth, r: reverse, q: quit"
)
_BETWEEN = 0.2
"""Seconds between two checks for the end while no key is pressed."""


def _speed_option(_context: click.Context, _option: click.Parameter, value: float) -> float:
    """Refuse NaN, which passes click's range check."""
    if math.isnan(value):
        raise click.BadParameter("nan is not a speed")
    return value


@click.command("play", cls=SuggestingCommand)
@common.files_argument
@into_option
@click.option(
    "--speed",
    type=click.FloatRange(min=0, min_open=True),
    default=1.0,
    callback=_speed_option,
    help="Play this many times as fast as recorded. inf plays without waiting, and does not set "
    "the clock.",
)
@click.option("--loop", is_flag=True, help="Start again at the end, until Ctrl-C.")
@click.option(
    "--keep-stamps",
    is_flag=True,
    help="Keep the recorded stamps in each round of --loop. Each round then begins with an empty "
    "history. By default the stamps of each round are later than those of the previous one.",
)
@click.option("--paused", is_flag=True, help="Begin paused.")
@click.option(
    "--control",
    is_flag=True,
    help=f"Read controls from standard input, one per line: {', '.join(CONTROLS)}.",
)
@click.option(
    "--clock",
    "graph",
    metavar="GRAPH",
    help="Publish the store's clock on /clock of a graph: ros1:, ros2:, ros2+zenoh: or ros2+dds:.",
)
@click.option(
    "--clock-rate",
    type=click.FloatRange(min=0, min_open=True, max=1000),
    default=40.0,
    metavar="HZ",
    help="Clock messages per second.",
)
@history_option
@selection_options
@common.json_option
def command(
    *,
    files: tuple[str, ...],
    into: str,
    speed: float,
    loop: bool,
    keep_stamps: bool,
    paused: bool,
    control: bool,
    graph: str | None,
    clock_rate: float,
    history: int | None,
    as_json: bool,
) -> None:
    """Play recordings into a shared store, with pause, step, seek and reverse.

    Example: tfdb play drive.mcap --into robot1

    The store's clock shows the time of the recording: tfdb.Buffer.open("NAME").clock. If a process
    sets the clock, the player follows. After the play, the clock follows the system's again.

    Data of an earlier player are replaced; frames of other writers stay. --history limits a new
    store, which drops older samples.

    Keys in a terminal: space pauses and resumes. Right plays one commit, left takes one back. Up
    and down change the speed, 1 to 9 set it. ] jumps 5 s ahead, [ 5 s back. r reverses, q quits.

    With --clock, ROS nodes with use_sim_time follow the player. --clock ros2: uses the domain of
    ROS_DOMAIN_ID.

    The store stays when the command ends. 'tfdb shm rm NAME' removes it.
    """
    if graph is not None and math.isinf(speed):
        raise click.UsageError("--clock needs a finite --speed: inf sets no clock")
    if paused and math.isinf(speed):
        raise click.UsageError("--paused needs a finite --speed: inf plays without pauses")
    from tfdb.player.player import Player  # noqa: PLC0415 - reads recordings
    from tfdb.player.tape import tape_of  # noqa: PLC0415

    paths = common.find_paths(files)
    name = into.removeprefix(STORE)
    names = [str(path) for path in paths]
    in_graph = nullcontext((None, None)) if graph is None else open_graph(graph)
    with common.open_selected(paths) as recordings, in_graph as (node, _):
        tape, rewriter = tape_of(recordings)
        store = open_store(name, history)  # after what may be refused
        player = Player(store, tape, speed=speed, loop=loop, keep_stamps=keep_stamps, paused=paused)
        for recording in recordings.files:
            player.tally.count(recording, recordings.choice)
        keys = not control and sys.stdin.isatty() and sys.stdout.isatty()
        if not as_json:
            output.say_wrapped(f"{', '.join(names)} into shm:{name}; Ctrl-C ends it", *names)
            if keys:
                output.say_wrapped(_KEYS_HELP)
        began = time.monotonic()
        try:
            with (
                _published(store.clock, node, clock_rate),
                _controlled(player, keys=keys, lines=control),
            ):
                player.run()
            _check_played(player, rewriter, recordings.names)
            rewriter.warn(", ".join(names), 2)
        finally:
            told = player.tally.report(tuple(names), 0, rewriter, empty=True)
            newest = store._span()
            body = _body(player, told, None if newest is None else newest[1], began)
            if as_json:
                output.emit_json("play", {"files": names, "store": name, **body})
            else:
                output.say_wrapped(_describe(player, told, began))


def _check_played(player: Player, rewriter: Rewriter, names: str) -> None:
    """Refuse a selection without transforms."""
    tally = player.tally
    if rewriter.left_out and not (tally.transforms or tally.refused or rewriter.refusals):
        raise tfdb.errors.RecordingError(names, rewriter.reason())


def _body(
    player: Player, told: LoadReport, newest: int | None, began: float
) -> dict[str, int | float | None]:
    return {
        "messages": told.messages,
        "transforms": told.transforms,
        "refused": told.refused,
        "refused_transforms": told.refused_transforms,
        "rounds": player.rounds,
        "shift_ns": player.shift,
        "newest_ns": newest,
        "seconds": round(time.monotonic() - began, 3),
    }


def _describe(player: Player, told: LoadReport, began: float) -> str:
    passed = format_duration(round((time.monotonic() - began) * NS))
    text = f"{told.stored_counts}, played in {passed}"
    if player.shift:
        text += f"; stamps are {format_duration(player.shift)} later than recorded"
    if told.first_refusals:
        error, first = next(iter(told.first_refusals.items()))
        text += f"; {told.refused_counts}, the first: {error}: {first}"
    return text


@contextmanager
def _published(clock: tfdb.Clock, node: Node | None, rate: float) -> Iterator[None]:
    """Publish a clock by a node during the block."""
    if node is None:
        yield
        return
    from tfdb.ros.clock_publishing import ClockPublisher  # noqa: PLC0415 - only for live graphs

    with ClockPublisher(node, clock, rate):
        yield


@contextmanager
def _controlled(player: Player, *, keys: bool, lines: bool) -> Iterator[None]:
    """Let keys or lines of standard input control the player during the block."""
    if not (keys or lines):
        yield
        return
    ended = threading.Event()
    read = _read_keys if keys else _read_lines
    reader = threading.Thread(target=read, args=(player, ended), daemon=True, name="controls")
    with _unbuffered() if keys else nullcontext():
        reader.start()
        try:
            yield
        finally:
            ended.set()
            if keys:
                reader.join()


@contextmanager
def _unbuffered() -> Iterator[None]:
    """Read each key at once, without echo."""
    import termios  # noqa: PLC0415 - of Unix, and of terminals only
    import tty  # noqa: PLC0415

    before = termios.tcgetattr(sys.stdin)
    tty.setcbreak(sys.stdin)
    try:
        yield
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, before)


def _read_keys(player: Player, ended: threading.Event) -> None:
    while not ended.is_set():
        ready, _, _ = select.select([sys.stdin], [], [], _BETWEEN)
        if not ready:
            continue
        typed = os.read(sys.stdin.fileno(), 64).decode(errors="ignore")
        while typed:
            key = typed[:3] if typed[:3] in KEYS else typed[0]
            typed = typed[len(key) :]
            if key in KEYS:
                _obey(player, KEYS[key])


def _read_lines(player: Player, ended: threading.Event) -> None:
    for line in sys.stdin:
        if ended.is_set():
            return
        if line.strip():
            _obey(player, line)


def _obey(player: Player, line: str) -> None:
    try:
        obey(player, line)
    except tfdb.TfdbError as error:
        output.say(f"tfdb: {error}", err=True)

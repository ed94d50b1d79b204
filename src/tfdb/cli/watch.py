"""``tfdb watch``: prints an event when an expectation is broken, or met again."""

from __future__ import annotations

import dataclasses
import math
import sys
import time
from collections import Counter
from typing import TYPE_CHECKING

import click

from tfdb.data.counting import counted
from tfdb.ros.diagnostics import LEVELS, DiagnosticStatus, encode_diagnostics

from . import common, layout, output
from .expect import expect_option_of
from .graph import is_graph, live_source, node_option
from .groups import SuggestingCommand
from .times import NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tfdb.judging.events import Event
    from tfdb.judging.expectations import Expectations
    from tfdb.ros import Node

    from .graph import Live

_STYLES = {"ok": "green", "warning": "yellow", "error": "bold red", "stale": "magenta"}


@click.command("watch", cls=SuggestingCommand)
@common.file_argument
@expect_option_of(required=True)
@common.stop_option
@click.option(
    "--diagnostics",
    is_flag=True,
    help="Publish the state of the expectations on /diagnostics of the graph, once a second.",
)
@node_option
@common.json_lines_option
def command(
    *, file: str, expect: str, length: int | None, diagnostics: bool, as_json: bool
) -> None:
    """Print an event when live data breaks an expectation or meets it again.

    Example: tfdb watch ros2: --expect expectations.toml

    FILE is a live graph (ros1:, ros2:) or a shared store (shm:NAME). The command watches it until
    Ctrl-C, or for the time of --for. 'tfdb check --expect' checks a recording.

    Exit code with --for: 1 after an event of severity error or stale, 0 without one. 130 after
    Ctrl-C, 2 on an error.
    """
    from tfdb.judging.events import BROKEN  # noqa: PLC0415 - with its room
    from tfdb.judging.expectations import Expectations  # noqa: PLC0415

    if not common.is_live(file):
        raise click.UsageError(
            f"{file} is not live: give shm:NAME, ros1: or ros2:; 'tfdb check --expect' checks a "
            "recording"
        )
    if diagnostics and not is_graph(file):
        raise click.UsageError(f"--diagnostics needs ros1: or ros2:, and {file} is a store")
    expected = Expectations.read(expect)
    counts: Counter[str] = Counter()
    with live_source(file) as live:
        publisher = Diagnostics(live.node) if diagnostics and live.node is not None else None
        try:
            for events in watch_events(live, expected, length):
                for event in events:
                    counts[event.severity] += 1
                    _show(event, as_json=as_json)
                if publisher is not None:
                    publisher.take(events)
        finally:
            if not as_json:
                found = [counted(counts[each], each) for each in ("error", "warning")]
                output.say(f"tfdb: {', '.join(found)}, {counts['stale']} stale", err=True)
    if any(counts[severity] for severity in BROKEN):
        click.get_current_context().exit(1)


class Diagnostics:
    """Publishes the state of each edge and authority that has had an event, and a summary."""

    def __init__(self, node: Node) -> None:
        self._node, self._next = node, 0.0
        self._publisher = node.advertise("/diagnostics", "diagnostic_msgs/DiagnosticArray")
        self._subjects: dict[str, dict[str, Event]] = {}

    def take(self, events: Sequence[Event]) -> None:
        """Add events; publish after an event, and once a second."""
        for event in events:
            kinds = self._subjects.setdefault(event.subject, {})
            kinds[event.kind] = event
        if events or time.monotonic() >= self._next:
            self._next = time.monotonic() + 1
            cdr = self._node.encoding != "ros1"
            statuses = self._statuses()
            self._publisher.publish(encode_diagnostics(self._node.now(), statuses, cdr=cdr))

    def _statuses(self) -> list[DiagnosticStatus]:
        made, broken = [], 0
        for subject, kinds in self._subjects.items():
            worst = min(kinds.values(), key=lambda event: event.rank)
            now = [event for event in kinds.values() if event.begins]
            broken += bool(now)
            message = ", ".join(f"{event.kind} {event.measured}".rstrip() for event in now) or "OK"
            values = {kind: str(event.count) for kind, event in kinds.items()}
            made.append(DiagnosticStatus(worst.severity, f"tfdb: {subject}", message, values))
        level = max((LEVELS.index(each.level) for each in made), default=0)
        message = f"{broken} broken" if broken else "OK"
        return [DiagnosticStatus(LEVELS[level], "tfdb: expectations", message), *made]


def watch_events(live: Live, expected: Expectations, length: int | None) -> Iterator[list[Event]]:
    """Follow the commits, and yield the events of each step."""
    from tfdb.judging.judge import Judge  # noqa: PLC0415 - numpy
    from tfdb.judging.live import LOOK, LiveJudge  # noqa: PLC0415

    ends = math.inf if length is None else time.monotonic() + length / NS
    while live.now() <= 0 and time.monotonic() < ends:  # a simulated one
        live.wait(min(time.monotonic() + LOOK, ends))
    judge = LiveJudge(live, Judge(expected, live.now()))
    yield judge.begun
    missed = 0
    while time.monotonic() < ends:
        events = judge.take(judge.read(min(time.monotonic() + LOOK, ends)))
        if judge.missed > missed:
            text = f"{counted(judge.missed - missed, 'commit')} were missed"
            output.warn(f"{text}: they come faster than they are read")
            missed = judge.missed
        yield events
        live.check()


def _show(event: Event, *, as_json: bool) -> None:
    if as_json:
        output.emit_json_line("watch", dataclasses.asdict(event))
        sys.stdout.flush()
        return
    words = layout.words(str(event), event.parent, event.child, event.authority)
    layout.console().print(layout.wrap(words), style=_STYLES[event.severity])

"""``tfdb echo``: one transform, repeatedly."""

from __future__ import annotations

import math
import re
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import click

import tfdb
from tfdb.data.time_text import format_duration, format_ns
from tfdb.judging.events import ANOTHER_CLOCK
from tfdb.store.waiting import NO_ANSWER_YET

from . import common, layout, output
from .angles import pose_body
from .graph import Live, live_source, node_option
from .groups import SuggestingCommand
from .selecting import refuse_selection, selection_options
from .times import LATEST, NS, TimeSpec, offset_option, seconds_option, time_option, warn_of_bounds

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tfdb import Transform
    from tfdb._core import StoreReader


@click.command("echo", cls=SuggestingCommand)
@common.file_argument
@common.target_argument
@common.source_argument
@click.option(
    "-r",
    "--rate",
    type=click.FloatRange(min=0, min_open=True, max=1000),
    default=1.0,
    metavar="HZ",
    help="Transforms per second; from a recording, per recorded second.",
)
@click.option(
    "--each",
    is_flag=True,
    help="Print each time a commit changes the transform, instead of at a rate.",
)
@click.option(
    "-t",
    "--time",
    metavar="TIME",
    callback=time_option,
    help="Look up this time.  [default: the newest]",
)
@click.option(
    "-o",
    "--offset",
    metavar="SECONDS",
    callback=offset_option,
    help="Look up this many seconds after now, by the graph's clock. A negative number is before "
    "now.",
)
@click.option("-l", "--limit", type=click.IntRange(min=1), help="Stop after this many transforms.")
@click.option(
    "-p",
    "--precision",
    type=click.IntRange(min=0, max=17),
    default=3,
    help="Digits after the decimal point.",
)
@seconds_option("-c", "--cache-time", default="10", help="Seconds of history to keep of a graph.")
@common.policy_option
@node_option
@selection_options
@common.json_lines_option
def command(
    *,
    file: str,
    target: str,
    source: str,
    rate: float,
    each: bool,
    time: TimeSpec | None,
    offset: int | None,
    limit: int | None,
    precision: int,
    cache_time: int,
    policy: Any,
    as_json: bool,
) -> None:
    """Print one transform repeatedly, with its age, like tf2_echo.

    Example: tfdb echo ros1: map base_link

    It prints the newest T[TARGET<-SOURCE] at once, then once a second until Ctrl-C. The transform
    maps a point of SOURCE into TARGET. Errors go to stderr. FILE is a live graph (ros1:, ros2:), a
    shared store (shm:NAME) or a recording. From a recording it prints, without waiting, one
    transform per recorded second.

    The arguments have the order of tf2_echo, whose 'source_frame' is TARGET here: 'tf2_echo map
    base' and 'tfdb echo ros1: map base' print the same.
    """
    if time is not None and offset is not None:
        raise click.UsageError("--time and --offset exclude each other")
    question = Question(target, source, time or LATEST, offset, policy)
    printer = Printer(file, precision, as_json=as_json)
    if common.is_live(file):
        if (time or LATEST).since:
            raise click.UsageError(f"{file} is live: give an absolute time, or --offset")
        refuse_selection((file,), "live", "it")
        with live_source(file, history=cache_time) as live:
            echo(live, question.plain(), None if each else 1 / rate, printer, limit)
        return
    if each:
        raise click.UsageError(
            "--each is valid for live stores and graphs only; -r sets the rate for a recording"
        )
    loaded = common.load((file,))
    answered = False
    for now in _steps(loaded, question.found_in(loaded), rate, limit):
        found = question.ask(loaded.store, now)
        answered |= isinstance(found, tfdb.Transform)
        if answered or question.time.ns is None:  # with --time, a failed lookup is the error
            printer.show(found, now)
    if not answered and isinstance(found, tfdb.TfdbError):
        raise found


@dataclass
class Question:
    """The lookup that is repeated."""

    target: str
    source: str
    time: TimeSpec
    offset: int | None
    policy: Any

    def plain(self) -> Question:
        """Drop leading slashes of the frames: stored names have none. Returns itself."""
        self.target, self.source = self.target.removeprefix("/"), self.source.removeprefix("/")
        return self

    def found_in(self, loaded: common.Loaded) -> Question:
        """Resolve frames and time in a recording. Returns itself; raises UnknownFrame."""
        self.target, self.source = common.find_frames(loaded.store, self.target, self.source)
        stamp = self.time.resolve(loaded.span)
        warn_of_bounds(loaded.span, time=self.time)
        if stamp is None and self.offset is None:
            self.offset = 0  # the newest transform at each time
        self.time = TimeSpec(self.time.text, stamp)
        return self

    def ask(self, store: StoreReader, now: int) -> Transform | tfdb.TfdbError:
        """Return the transform, or the error of a lookup that may succeed later."""
        stamp = self.time.ns if self.offset is None else max(now + self.offset, 0)
        try:
            return store.lookup_transform(self.target, self.source, stamp, self.policy)
        except NO_ANSWER_YET as error:
            return error


def echo(
    live: Live, question: Question, period: float | None, printer: Printer, limit: int | None
) -> None:
    """Print at a rate; without a `period`, print each new transform when a commit brings it."""
    left = math.inf if limit is None else limit
    tick = time.monotonic()
    last: tuple[int, bytes] | None = None
    while True:
        live.check()
        found = question.ask(live.store, live.now())
        if isinstance(found, tfdb.Transform):
            new = (found.stamp, found.matrix.tobytes())
            if period is not None or new != last:
                printer.show(found, live.now())
                left -= 1
            last = new
        elif period is None or time.monotonic() >= tick:
            printer.show(found, live.now())
        if left <= 0:
            return
        if period is None:
            live.wait(math.inf)
            continue
        if isinstance(found, tfdb.Transform) or time.monotonic() >= tick:
            tick = max(tick + period, time.monotonic())
        if isinstance(found, tfdb.Transform):
            live.sleep(tick)
        else:
            live.wait(tick)  # a commit may bring the transform earlier


def _steps(
    loaded: common.Loaded, question: Question, rate: float, limit: int | None
) -> Iterator[int]:
    """Yield the times at which to look up a recording; only one if --time is given."""
    span = loaded.span
    count = 0
    if span is None or question.time.ns is not None:
        yield question.time.ns or 0
        return
    common_span = common.common_range(loaded.store, question.target, question.source)
    first, last = common_span or span
    if common_span is not None and question.offset is not None:
        first, last = first - question.offset, last - question.offset
    now = first
    while True:
        yield now
        count += 1
        now = first + round(count * NS / rate)
        if now > last or count == limit:
            return


@dataclass
class Printer:
    """Prints transforms and errors; a repeated error is printed once."""

    file: str
    precision: int
    as_json: bool
    told: str = ""

    def show(self, found: Transform | tfdb.TfdbError, now: int) -> None:
        """Print one."""
        if isinstance(found, tfdb.TfdbError):
            self._complain(found, now)
        elif self.as_json:
            self.told = ""
            output.emit_json_line("echo", self._body(found, now))
        else:
            self.told = ""
            output.say("\n".join(self._lines(found, now)))

    def _complain(self, error: tfdb.TfdbError, now: int) -> None:
        reason = re.sub(r"\d+", "", f"{type(error).__name__}: {error}")  # stamps and commits go on
        if reason == self.told:
            return
        self.told = reason
        if self.as_json:
            body = {"files": [self.file], "now_ns": now, **output.error_body(error)}
            output.emit_json_line("echo", body)
        else:
            output.say(
                f"tfdb: (current time {format_ns(now)}) {output.describe_error(error)}", err=True
            )

    def _body(self, found: Transform, now: int) -> dict[str, Any]:
        limiting = found.report.limiting_edge
        return {
            "files": [self.file],
            "target": found.target,
            "source": found.source,
            "now_ns": now,
            "stamp_ns": found.stamp,
            "age_ns": None if found.report.timeless else now - found.stamp,
            "gap_ns": found.report.max_gap,
            "limiting": None if limiting is None else limiting.child,
            **pose_body(found),
        }

    def _lines(self, found: Transform, now: int) -> Iterator[str]:
        translation, rotation, radians, matrix = found._numbers()
        yield layout.wrap(
            [f"At time {format_ns(found.stamp)},", f" (current time {format_ns(now)})"]
        )
        yield f"- Translation: {self._list(translation)}"
        yield f"- Rotation: in Quaternion {self._list(rotation)}"
        yield f"            in RPY (radian) {self._list(radians)}"
        yield f"            in RPY (degree) {self._list(map(math.degrees, radians))}"
        yield "- Matrix:"
        digits = self.precision
        for row in matrix:
            yield "  " + " ".join(f"{value:{digits + 6}.{digits}f}" for value in row)
        children = [edge.child for edge in found.report.edges]
        yield layout.prose(f"- Age: {self._age(found, now)}", *children)

    def _list(self, values: Any) -> str:
        return f"[{', '.join(f'{value:.{self.precision}f}' for value in values)}]"

    @staticmethod
    def _age(found: Transform, now: int) -> str:
        if found.report.timeless:
            return "none, because no edge of the path moves"
        text = format_duration(now - found.stamp)
        if abs(now - found.stamp) >= ANOTHER_CLOCK:
            where = "behind" if found.stamp < now else "ahead of"
            text = f"none, because the stamp is {text.removeprefix('-')} {where} the clock"
            text += " (replayed, of another clock, or a past time)"
        widest = max(found.report.edges, key=lambda edge: edge.gap)
        if widest.gap == 0:
            return f"{text}, made from samples of that time"
        return f"{text}, interpolated over {format_duration(widest.gap)} in {widest.child}"

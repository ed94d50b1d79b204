"""``tfdb monitor``: shows rates, delays, gaps and publishers of frames."""

from __future__ import annotations

import dataclasses
import time
from typing import TYPE_CHECKING, Any, Self, cast

import click

import tfdb
from tfdb.data.counting import counted
from tfdb.data.time_text import format_duration
from tfdb.judging.arrivals import Arrivals
from tfdb.judging.events import BROKEN, CLOCKS
from tfdb.judging.expectations import Expectations
from tfdb.judging.judge import Judge
from tfdb.judging.live import LiveJudge
from tfdb.judging.proposing import fixed_rows, rows_of, span_of
from tfdb.judging.rates import Delays, Frame, Rates
from tfdb.recordings.arrivals import ArrivalReader
from tfdb.recordings.load_report import Tally
from tfdb.recordings.recording import Run
from tfdb.store.report import frames_passed
from tfdb.store.summary import Forest
from tfdb.store.waiting import NO_ANSWER_YET

from . import common, layout, output
from .expect import expect_option
from .graph import Live, live_source, node_option
from .groups import SuggestingCommand
from .in_place import InPlace
from .selecting import refuse_selection, selection_options
from .times import NS, seconds_option

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    from rich.console import RenderableType
    from rich.text import Text

    from tfdb._core import StoreReader
    from tfdb.judging.events import Event
    from tfdb.judging.judge import Rows
    from tfdb.recordings.arrivals import RecordedArrivals


@click.command("monitor", cls=SuggestingCommand)
@common.file_argument
@click.argument("target", required=False, shell_complete=common.complete_frames)
@click.argument("source", required=False, shell_complete=common.complete_frames)
@seconds_option("--every", default="1", help="Seconds between two reports.")
@seconds_option("--window", default="10", help="Seconds over which rates and delays are computed.")
@common.stop_option
@node_option
@expect_option
@selection_options
@layout.wide_option
@common.json_lines_option
def command(
    *,
    file: str,
    target: str | None,
    source: str | None,
    every: int,
    window: int,
    length: int | None,
    expect: str | None,
    as_json: bool,
) -> None:
    """Show the rate, delay, gaps and publisher of each frame, live or recorded.

    Example: tfdb monitor ros2: map base_link

    A live graph (ros1:, ros2:) or a shared store (shm:NAME) is watched until Ctrl-C. A recording is
    reported once, as a whole. TARGET and SOURCE select the frames between them, and add the net
    delay: the age of the newest T[TARGET<-SOURCE] at each arrival.

    A delay is the time from stamp to arrival, by the clock of the graph, the store or the recorder.
    Replayed stamps have no delay; one line reports their offset. On a terminal the table is updated
    in place, and cut to the height of the terminal. With --expect the worst edges come first, each
    with the expectation that it breaks now.
    """
    if every <= 0:
        raise click.UsageError("--every must be positive")
    if target is not None and source is None:
        raise click.UsageError("give both TARGET and SOURCE, or neither")
    chain = None if target is None or source is None else (target, source)
    expected = None if expect is None else tfdb.Expectations.read(expect)
    screen = Screen(file, chain, as_json=as_json)
    if not common.is_live(file):
        _show_recording(file, chain, expected, screen)
        return
    refuse_selection((file,), "live", "it")
    with live_source(file) as live, screen:
        watch = Watch(
            live.store,
            chain,
            began=time.monotonic_ns(),
            window=max(window // every, 1),
            expected=expected,
            start=live.now(),
        )
        _watch(live, watch, every, length, screen)


class Watch:
    """Counts the samples of a store, checks expectations, and follows the path of two frames."""

    def __init__(
        self,
        store: StoreReader,
        chain: tuple[str, str] | None,
        *,
        began: int,
        window: int = 1,
        expected: Expectations | None = None,
        start: int = 0,
    ) -> None:
        self._store = store
        self._chain = chain and (chain[0].removeprefix("/"), chain[1].removeprefix("/"))
        self.judge: Judge = Judge(expected or Expectations(), start)
        self.judges: bool = expected is not None
        """Whether expectations were given."""
        self.rates: Rates = Rates(self.judge, began, window)
        self.passed: list[str] = []
        """Known frames of the path, from the source to the target."""
        self.broken: str = ""
        """Why the path has no transform now."""
        self._parents: dict[str, str] = {}
        self._depths: dict[str, int] = {}

    def depths(self, parents: dict[str, str]) -> dict[str, int]:
        """Return the depth of each frame, in tree order; `parents`: those of all seen frames."""
        if parents != self._parents:
            rows = Forest(self._store.tree()).rows()
            self._parents, self._depths = parents, {row.info.name: row.depth for row in rows}
        return self._depths

    def take_rows(self, rows: Rows) -> None:
        """Count samples and check their expectations."""
        self.rates.add(rows)
        if self.judges:
            self.judge.feed(rows)

    def look_up_chain(self, store: StoreReader, now: int) -> None:
        """Look up the transform of the path, and count its delay."""
        if self._chain is None:
            return
        try:
            found = store.lookup_transform(*self._chain)
        except NO_ANSWER_YET as error:
            self.broken = str(error)
            return
        self.broken, self.passed = "", frames_passed(found)
        if not found.report.timeless:
            self.rates.add_net(now - found.stamp)

    def shows(self, frame: str) -> bool:
        """Return whether a frame is to be shown."""
        return self._chain is None or frame in self.passed

    def events(self) -> list[Event]:
        """Return the expectations that are broken now, the worst first."""
        return sorted(self.judge.active.values(), key=lambda event: event.rank)


def _watch(live: Live, watch: Watch, every: int, length: int | None, screen: Screen) -> None:
    """Follow the commits, and report once per period."""
    follower = LiveJudge(live, watch.judge, rates=watch.rates, judges=watch.judges)
    began = time.monotonic()
    ends = None if length is None else began + length / NS
    shown = began + every / NS
    while True:
        until = shown if ends is None else min(shown, ends)
        stretches = follower.read(until)
        follower.take(stretches)
        if stretches:
            watch.look_up_chain(live.store, live.now())
        if time.monotonic() >= until:
            live.check()
            now = time.monotonic_ns()
            screen.show(watch, now, follower.missed)
            if ends is not None and until >= ends:
                return
            watch.rates.next_period(now)
            shown = max(shown + every / NS, time.monotonic())


def _show_recording(
    file: str, chain: tuple[str, str] | None, expected: Expectations | None, screen: Screen
) -> None:
    """Play a recording without waiting, and report it as a whole."""
    (path,) = common.find_paths((file,))
    common.refuse_frozen([path], lacks="arrival times")
    reader = ArrivalReader(lambda source: source.authority)
    loaded = common.load([file], arrivals=reader)
    recorded = cast("RecordedArrivals", reader.found)
    arrivals = Arrivals.of(recorded)
    began = min((int(columns[1].min()) for _, columns, _ in recorded.edges), default=0)
    start, end = span_of(arrivals)
    watch = Watch(loaded.store, chain, began=began, expected=expected, start=start)
    joints = [(each.parent, each.child) for each in recorded.rewriter.fixed_joints()]
    watch.take_rows(fixed_rows(watch.judge, joints, recorded.rewriter.model_name, began))
    watch.take_rows(rows_of(arrivals, watch.judge))
    if watch.judges:
        watch.judge.advance(end)
    if chain is not None:
        _play(path, watch, chain)
    screen.show(watch, recorded.end, 0)


def _play(path: Path, watch: Watch, chain: tuple[str, str]) -> None:
    """Store message by message, and look up the path after each."""
    store = tfdb.Buffer(history=None)
    tally = Tally(store)
    with common.open_selected([path]) as recordings:
        rewriter = recordings.rewriter()
        tally.store_model(rewriter)
        for run in recordings.read():
            for index in range(run.first, run.last):
                one = Run(run.messages, index, index + 1, run.sources)
                before = store.commit
                tally.store(one, recordings.choice, rewriter)
                if store.commit != before:
                    watch.look_up_chain(store, one.start)
    common.find_frames(store, *chain)


class Screen:
    """Prints reports: in place on a terminal, below one another in a pipe, or as JSON."""

    def __init__(self, file: str, chain: tuple[str, str] | None, *, as_json: bool) -> None:
        self._file, self._chain, self._as_json = file, chain, as_json
        self._place = InPlace(as_json=as_json)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._place.close()

    def show(self, watch: Watch, now: int, missed: int) -> None:
        """Print a report."""
        if self._as_json:
            output.emit_json_line("monitor", self._body(watch, now, missed))
            return
        from rich.console import Group  # noqa: PLC0415 - see `output`

        self._place.show(Group(*self._parts(watch, now, missed)))

    def _body(self, watch: Watch, now: int, missed: int) -> dict[str, Any]:
        rates = watch.rates
        seconds = rates.seconds(now)
        body: dict[str, Any] = {
            "files": [self._file],
            "seconds": round(seconds, 3),
            "missed_commits": missed,
            "frames": [
                {
                    "frame": name,
                    "parent": frame.parent,
                    "static": frame.static,
                    **_figures(delays, seconds),
                    "longest_gap_ns": delays.gap,
                    "authorities": list(frame.authors),
                }
                for name, frame, delays in rates.of_frames()
                if watch.shows(name)
            ],
            "authorities": [
                {"authority": name, **_figures(delays, seconds)}
                for name, delays in rates.of_authors()
            ],
        }
        if watch.judges:
            body["events"] = [dataclasses.asdict(event) for event in watch.events()]
        if self._chain is not None:
            net = rates.of_chain()
            body["chain"] = {
                "target": self._chain[0],
                "source": self._chain[1],
                "frames": watch.passed[::-1],
                "broken": watch.broken or None,
                "delay_ns": net.mean,
                "longest_delay_ns": net.longest,
                "clock_offset_ns": _clock_offset(net),
            }
        return body

    def _parts(self, watch: Watch, now: int, missed: int) -> Iterator[RenderableType]:
        rates = watch.rates
        seconds = rates.seconds(now)
        over = f" over {format_duration(round(seconds * NS))}"
        yield layout.literal(layout.wrap([f"{layout.safe(self._file)},", over]))
        if self._chain is not None:
            yield layout.literal(self._chain_line(watch))
        frames = {
            name: (frame, delays) for name, frame, delays in rates.of_frames() if watch.shows(name)
        }
        events = watch.events()
        worst = {event.child: event for event in reversed(events) if event.kind not in CLOCKS}
        for event in events:
            if event.child not in frames or event.kind in CLOCKS:
                yield _event_line(event)
        depths = watch.depths({name: frame.parent for name, (frame, _) in frames.items()})
        place = {name: number for number, name in enumerate(depths)}
        names = sorted(frames, key=lambda name: place.get(name, -1))
        names.sort(key=lambda name: worst[name].rank if name in worst else _FINE)
        height = self._place.height
        shown = names if height is None else names[: height // 2]
        states = {name: (_mark(worst.get(name)),) if watch.judges else () for name in shown}
        yield layout.table(
            [_FRAMES[0], *([_STATE] if watch.judges else []), *_FRAMES[1:]],
            [_row(name, *frames[name], seconds, states[name]) for name in shown],
            [depths.get(name, 0) for name in shown],
        )
        if len(shown) < len(names):
            yield layout.quiet(f"{len(names) - len(shown):,} more frames")
        why = _why_no_delay((name, frames[name][1]) for name in names)
        if why:
            yield layout.literal(layout.prose(why, *names))
        yield ""
        yield layout.table(
            _PUBLISHERS,
            [
                (name or "unknown", _rate(delays, seconds), *_delays(delays))
                for name, delays in rates.of_authors()
            ],
        )
        if missed:
            text = f"{counted(missed, 'commit')} were missed: they come faster than they are read"
            yield layout.literal(layout.prose(text))

    def _chain_line(self, watch: Watch) -> str:
        target, source = self._chain or ("", "")
        if watch.broken:
            why = layout.words(f": {watch.broken}", target, source)
            into, of = layout.transform_name(target, source)
            return layout.wrap(["no", f" {into}", of, *why])
        mean, longest = _delays(watch.rates.of_chain())
        first, *way = watch.passed[::-1] or [target]
        chunks = [layout.safe(first), *(f" <- {layout.safe(name)}" for name in way)]
        text = f": net delay {mean or 'none'}, longest {longest or 'none'}"
        return layout.wrap([*chunks, *layout.words(text)])


_FINE = 9, 0, 0
"""The rank of an edge that meets its expectations."""
_STATE = layout.Column("state")
"""With expectations."""
_FRAMES = (
    layout.Column("frame"),
    layout.Column("parent", 6),
    layout.Column("rate", 1, right=True),
    layout.Column("delay", 2, right=True),
    layout.Column("longest", 5, right=True),
    layout.Column("longest gap", 3, right=True),
    layout.Column("publisher", 4),
)
_PUBLISHERS = (
    layout.Column("publisher"),
    layout.Column("rate", 1, right=True),
    layout.Column("delay", 2, right=True),
    layout.Column("longest", 3, right=True),
)


def _figures(delays: Delays, seconds: float) -> dict[str, Any]:
    return {
        "messages": delays.count,
        "rate_hz": delays.count / seconds,
        "delay_ns": delays.mean,
        "longest_delay_ns": delays.longest,
        "clock_offset_ns": _clock_offset(delays),
    }


def _clock_offset(delays: Delays) -> int | None:
    """Return the smallest offset from stamp to arrival of an edge without delays."""
    return delays.nearest if delays.mean is None else None


def _why_no_delay(frames: Iterable[tuple[str, Delays]]) -> str:
    """Explain why frames have no delay: their stamps are of another clock. Empty without any."""
    apart = {name: delays.nearest for name, delays in frames if _clock_offset(delays) is not None}
    if not apart:
        return ""
    away = min((each for each in apart.values() if each is not None), key=abs)
    where = "ahead of" if away < 0 else "behind"
    several = f" and of {counted(len(apart) - 1, 'other frame')}" if len(apart) > 1 else ""
    return (
        f"no delay: the stamps of {next(iter(apart))}{several} are "
        f"{format_duration(abs(away))} {where} their arrival: replayed, or of another clock"
    )


def _event_line(event: Event) -> Text:
    """Describe an event that belongs to none of the shown frames."""
    words = layout.words(f"{event.subject}: {_state(event)}", event.parent, event.child)
    return layout.literal(layout.wrap(words))


def _state(event: Event) -> str:
    return f"{event.severity}: {event.kind} {event.measured}".rstrip()


def _mark(event: Event | None) -> str | Text:
    if event is None:
        return ""
    return layout.loud(_state(event)) if event.severity in BROKEN else _state(event)


def _row(
    name: str, frame: Frame, delays: Delays, seconds: float, state: tuple[str | Text, ...]
) -> tuple[Any, ...]:
    writers: Any = ", ".join(each or "unknown" for each in frame.authors)
    if len(frame.authors) > 1:
        writers = layout.loud(writers)
    if frame.static:
        return (name, *state, frame.parent, layout.quiet("static"), "", "", "", writers)
    gap = format_duration(delays.gap) if delays.gap else ""
    return (name, *state, frame.parent, _rate(delays, seconds), *_delays(delays), gap, writers)


def _rate(delays: Delays, seconds: float) -> str:
    return f"{delays.count / seconds:.4g} Hz"


def _delays(delays: Delays) -> tuple[str, str]:
    if delays.mean is None or delays.longest is None:
        return "", ""
    return format_duration(delays.mean), format_duration(delays.longest)

"""Proposes expectations that a good recording meets; makes its rows for a judge."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from tfdb._core import Buffer
from tfdb.data.decimal_time import NS_PER_SECOND as NS
from tfdb.data.lazy_names import belong_to
from tfdb.data.path_checks import check_path
from tfdb.recordings.arrivals import ArrivalReader
from tfdb.recordings.selection import Selection

from .arrivals import Arrivals
from .doctor import Finding
from .events import EVENT_KINDS, TIMELY
from .expectations import AuthorityExpectation, Expectation, Expectations
from .judge import Judge, Rows
from .motion import angle, length

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    import numpy.typing as npt

    from tfdb.recordings.arrivals import RecordedArrivals

    from .events import Event


_SHARE = 99.9
"""The percentile of the distances between arrivals of which twice is the deadline."""


def recorded_arrivals(paths: Sequence[str | os.PathLike[str]]) -> Arrivals:
    """Read the parts of one recording."""
    from tfdb.recordings.load import load_into  # noqa: PLC0415 - where no command has read it

    reader = ArrivalReader()
    load_into(Buffer(history=None), [check_path(path) for path in paths], Selection(), None, reader)
    return Arrivals.of(cast("RecordedArrivals", reader.found))


def judge_recording(arrivals: Arrivals, expectations: Expectations) -> list[Event]:
    """Evaluate a recording's transforms, from the first arrival to the last or the watch's end.

    If the recording names no publishers, the liveliness of authorities is not judged.
    """
    start, end = span_of(arrivals)
    judge = Judge(expectations, start)
    events = [*judge.feed(rows_of(arrivals, judge)), *judge.advance(end)]
    return [each for each in events if arrivals.publishers_known or each.kind != "liveliness"]


def broken_expectations(events: Sequence[Event]) -> list[Finding]:
    """Return a finding for each edge or authority and kind of event that began."""
    groups: dict[tuple[str, str], list[Event]] = defaultdict(list)
    for event in events:
        groups[event.kind, event.subject].append(event)
    return [_finding(some) for some in groups.values()]


def _finding(events: Sequence[Event]) -> Finding:
    """Return one finding for the events of one kind and subject."""
    begun = [event for event in events if event.begins]
    worst = max(events, key=lambda event: event.value or 0)
    first, last = begun[0], events[-1]
    text = f"{worst.measured or EVENT_KINDS[first.kind][1]} of {first.subject}"
    text += f" by {first.authority}" if first.authority and first.child else ""
    text += ", once" if len(begun) == 1 else f", {len(begun):,} times"
    text += ", until the end" if last.begins else ""
    details = {
        "parent": first.parent,
        "authority": first.authority,
        "value": worst.value,
        "limit": first.limit,
        "times_ns": [[event.since, event.time] for event in events if not event.begins],
    }
    frames = (first.child,) if first.child else ()
    return Finding(first.kind, frames, text, first.time, last.count, details, first.severity)


def rows_of(arrivals: Arrivals, judge: Judge) -> Rows:
    """Return all transforms in the order of arrival; a static one arrives at the start at least."""
    names, edges = arrivals.log.names, list(arrivals.log.edges())
    start, _ = span_of(arrivals)
    numbers, writers = [], []
    for edge in edges:
        parents, inverse = np.unique(edge.parents, return_inverse=True)
        pairs = [names[parent] for parent in parents.tolist()], [edge.name] * len(parents)
        numbers.append(judge.number_edges(*pairs)[inverse])
        publishers, inverse = np.unique(edge.publishers, return_inverse=True)
        known = judge.number_authorities([names[each] for each in publishers.tolist()])
        writers.append(known[inverse])
    empty = np.zeros(0, dtype=np.int64)
    arrived = np.maximum(np.concatenate([empty, *(edge.arrivals for edge in edges)]), start)
    order = np.argsort(arrived, kind="stable")
    return Rows(
        arrived,
        np.concatenate([empty, *numbers]),
        np.concatenate([empty, *writers]),
        np.concatenate([empty, *(edge.stamps for edge in edges)]),
        np.concatenate([np.zeros((0, 7)), *(edge.poses for edge in edges)]),
        np.concatenate([np.zeros(0, dtype=bool), *(edge.static for edge in edges)]),
    ).at(order)


def fixed_rows(
    judge: Judge, pairs: Sequence[tuple[str, str]], authority: str, arrival: int
) -> Rows:
    """Return static samples of edges, by parent and child, that arrive at one time."""
    count = len(pairs)
    return Rows(
        np.full(count, arrival),
        judge.number_edges([parent for parent, _ in pairs], [child for _, child in pairs]),
        judge.number_authorities([authority] * count),
        np.zeros(count, dtype=np.int64),
        np.zeros((count, 7)),
        np.ones(count, dtype=bool),
    )


def propose(*paths: str | os.PathLike[str]) -> Expectations:
    """Propose limits for every edge and authority of a good recording, which meets them itself.

    The deadline is twice the 99.9th percentile of the times between arrivals, or the longest time
    if that is longer; the other limits are twice the largest value. All are rounded up. Several
    paths are parts of one recording.
    """
    return propose_for(recorded_arrivals(paths))


def propose_for(arrivals: Arrivals) -> Expectations:
    """Propose limits for arrivals that were read before."""
    start, end = span_of(arrivals)
    rows = rows_of(arrivals, judge := Judge(Expectations(), start))
    moving = rows.at(~rows.static)
    away = np.abs(moving.arrivals - moving.stamps)
    by_stamps = not len(away) or int(away.min()) < TIMELY
    writers = list(judge.authorities)
    edges = []
    for (parent, child), number in judge.edges.items():
        all_of_edge = rows.at(rows.edges == number)
        used = [writers[each] for each in np.unique(all_of_edge.authorities).tolist()]
        authority = used if len(used) == 1 and used[0] else ()
        limits = _limits(all_of_edge.at(~all_of_edge.static), end, by_stamps=by_stamps)
        edges.append(Expectation(parent, child, authority=tuple(authority), **limits))
    authorities = []
    for name, number in judge.authorities.items():
        mine = rows.at(rows.authorities == number)
        deadline = _deadline(np.append(start, mine.arrivals), end)
        if name and deadline and not mine.static.all():
            authorities.append(AuthorityExpectation(name, deadline))
    return Expectations(edges, authorities, clock="stamps" if by_stamps else "arrival")


def _limits(rows: Rows, end: int, *, by_stamps: bool) -> dict[str, Any]:
    """Propose the limits of one edge by its moving rows."""
    if len(rows) < 2:
        return {}
    newest = np.maximum.accumulate(rows.stamps)
    fresh = np.concatenate([[True], newest[1:] > newest[:-1]])
    base = newest if by_stamps else np.maximum.accumulate(np.where(fresh, rows.arrivals, 0))
    ages = np.append(rows.arrivals[1:], end) - base
    new = rows.at(fresh)
    ways = length(np.diff(new.poses[:, :3], axis=0))
    turn = _twice(angle(new.poses[1:], new.poses[:-1]))
    return {
        "deadline": _deadline(rows.arrivals, end),
        "lifespan": _twice(ages / NS),
        "max_step": _twice(ways),
        "max_speed": _twice(ways / (np.diff(new.stamps) / NS)),
        "max_turn": turn if turn and turn < math.pi else None,
        "max_late": _twice((newest - rows.stamps) / NS),
    }


def _deadline(arrivals: npt.NDArray[np.int64], end: int) -> float | None:
    if len(arrivals) < 2:
        return None
    distances = np.diff(np.append(arrivals, end)) / NS
    usual = 2 * float(np.percentile(distances, _SHARE))
    return _round_up(max(usual, float(distances.max())))


def _twice(values: npt.NDArray[np.float64]) -> float | None:
    return _round_up(2 * float(values.max(initial=0)))


def _round_up(value: float) -> float | None:
    """Round a limit up to two digits; None if it would be 0."""
    if value < 1e-9:
        return None
    power = math.floor(math.log10(value)) - 1
    return float(f"{math.ceil(value / 10.0**power + 1e-9)}e{power}")


def span_of(arrivals: Arrivals) -> tuple[int, int]:
    """Return the first and last arrival of moving transforms; for a live store, its whole watch.

    Without moving transforms: the watch, or the arrivals of a recording's static transforms.
    """
    edges = list(arrivals.log.edges())
    known = [each for edge in edges if len(each := edge.moving.arrivals)]
    if not known and any(arrivals.watched):
        return arrivals.watched
    known = known or [each for edge in edges if len(each := edge.arrivals)]
    if not known:
        return 0, 0
    last = max(int(each.max()) for each in known)
    return min(int(each.min()) for each in known), max(last, arrivals.watched[1])


belong_to("tfdb.judging", globals(), ("propose",))

"""Contents of a live store and its later commits, as input of the doctor."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Protocol

import numpy as np

from tfdb.data import errors
from tfdb.streams.rows import stretches_of_bytes, stretches_of_changes

from .arrivals import Arrivals
from .doctor import Log
from .expectations import Expectations
from .judge import Judge, Rows

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb._core import Buffer, Clock, StoreReader
    from tfdb.streams.rows import Rows as StreamRows
    from tfdb.streams.rows import Stretch

    from .events import Event

_MOST = 1 << 16  # commits that are read at once
_MOST_BYTES = 1 << 24
_BETWEEN = 0.1
"""Seconds between two steps of a progress bar."""
_REST = 8
"""A follower rests so many times as long as the last commits took: then it reads more at once."""
_LONGEST_REST = 0.05
"""Seconds: the feed of a busy store holds more."""


def stored_arrivals(state: StoreReader) -> Arrivals:
    """Treat stored samples as if each arrived at its stamp."""
    log, known = Log(), False
    for info in state.tree():
        if info.parent is None:
            continue
        known = known or bool(info.authority)
        samples = state.samples(info.name)
        log.add_edge(info.name, *samples, publisher=info.authority, static=info.is_static)
    return Arrivals(log, known)


def numbered(judge: Judge, rows: StreamRows, arrival: int) -> Rows:
    """Number the edges and authorities of samples."""
    return Rows(
        np.full(len(rows), arrival),
        judge.number_edges(rows.parents, rows.children),
        judge.number_authorities(rows.authorities),
        rows.stamps,
        rows.poses,
        rows.statics,
        rows.commits,
    )


def held_rows(judge: Judge, state: StoreReader, arrival: int) -> Rows:
    """Return the newest sample of each edge of a state, as if it arrived now."""
    infos = [each for each in state.tree() if each.parent is not None and each.samples]
    count = len(infos)
    return Rows(
        np.full(count, arrival),
        judge.number_edges([each.parent or "" for each in infos], [each.name for each in infos]),
        judge.number_authorities([each.authority for each in infos]),
        np.array([each.newest or 0 for each in infos], dtype=np.int64),
        state.lookup_edges([each.name for each in infos]),
        np.array([each.is_static for each in infos], dtype=bool),
    )


def judge_state(judge: Judge, state: StoreReader, arrival: int) -> list[Event]:
    """Evaluate the newest sample of each edge, after missed commits."""
    judge.forget({child for _, child in judge.edges})
    return judge.feed_held(held_rows(judge, state, arrival))


class Followed(Protocol):
    """A store with other writers, and the clock of its stamps."""

    commit: int

    @property
    def store(self) -> Buffer:
        """The store."""

    @property
    def now(self) -> Callable[[], int]:
        """The clock of the stamps, nanoseconds."""

    @property
    def clock(self) -> Clock | None:
        """The store's clock, if `now` reads it."""

    def wait(self, until: float) -> bool:
        """Wait for a commit after `commit`; False: none came until that monotonic time."""

    def sleep(self, until: float) -> None:
        """Wait until that monotonic time, in seconds, or the end of the source."""


class Follower:
    """Reads the commits of a live store, in order.

    If the feed overruns it, it continues with the newest state, and `missed` counts the commits.
    """

    def __init__(self, live: Followed) -> None:
        self._live = live
        self._told = live.commit
        self._busy_since = math.inf
        self.missed: int = 0
        """How many commits went by unseen."""

    def read(self, until: float, rested: float = math.inf) -> list[Stretch]:
        """Return commits since the last call; wait for one until a monotonic time.

        `rested`: the latest time of the next check for commits, even if it was busy.
        """
        live, now = self._live, time.monotonic()
        rest = min(_REST * (now - self._busy_since), _LONGEST_REST)
        self._busy_since = math.inf
        if rest > 0:
            live.sleep(min(now + rest, until, rested))
        if not live.wait(until):
            return []
        self._busy_since = time.monotonic()
        store = live.store
        try:
            data = store.commits_bytes(self._told, max_commits=_MOST, max_bytes=_MOST_BYTES)
            last, found = stretches_of_bytes(data)
        except errors.FeedLapped:
            newest = store.commit
            self.missed += newest - self._told
            self._told = live.commit = newest
            return []
        except errors.Gone:  # samples that were evicted before they were read are left out
            records = store.changes(self._told)
            last, found = records[-1].commit, stretches_of_changes(records)
        self._told = live.commit = max(live.commit, last)
        return found


def watch_arrivals(
    live: Followed, seconds: float, progress: Callable[[int, int], None] | None
) -> Arrivals:
    """Follow commits for a while, and include existing static edges."""
    judge = Judge(Expectations(), 0)
    with live.store.snapshot() as state:
        live.commit = state.commit
        held = held_rows(judge, state, 0)
        parts = [held.at(held.static)]
    follower, began, start = Follower(live), time.monotonic(), live.now()
    while (passed := time.monotonic() - began) < seconds:
        if progress is not None:
            progress(int(passed * 1000), int(seconds * 1000))
        found = follower.read(began + min(passed + _BETWEEN, seconds))
        parts += [numbered(judge, each.arrived, live.now()) for each in found]
    rows = Rows.joined(parts)
    known = any(judge.authority_names[each] for each in np.unique(rows.authorities).tolist())
    log, watched = Log.of_rows(rows, judge), (start, live.now())
    return Arrivals(log, known, missed=follower.missed, watched=watched)

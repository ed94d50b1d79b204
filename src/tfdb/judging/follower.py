"""Contents of a live store and its later commits, as input of the doctor."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Protocol, cast

import numpy as np

from tfdb.data import errors

from .arrivals import Arrivals
from .doctor import Log
from .judge import Judge, Rows

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import numpy.typing as npt

    from tfdb._core import Buffer, Reads
    from tfdb.data.types import Changes, Columns

    from .events import Event

_BETWEEN = 0.1
"""Seconds between two steps of a progress bar."""
_REST = 8
"""A follower rests so many times as long as the last commits took: then it reads more at once."""
_LONGEST_REST = 0.05
"""Seconds: the feed of a busy store holds more."""


def stored_arrivals(state: Reads) -> Arrivals:
    """Treat stored samples as if each arrived at its stamp."""
    log, known = Log(), False
    for info in state.tree():
        if info.parent is None:
            continue
        known = known or bool(info.authority)
        samples = state.samples(info.name)
        log.add_edge(info.name, *samples, publisher=info.authority, static=info.is_static)
    return Arrivals(log, known)


def judge_changes(judge: Judge, changes: Sequence[Changes], arrival: int) -> list[Event]:
    """Judge commits that were read at one time."""
    events: list[Event] = []
    begun = 0
    for place, change in enumerate(changes):
        if change.cleared or change.removed:  # their stamps may begin anew
            events += judge.feed(rows_of_changes(judge, changes[begun:place], arrival))
            judge.forget({*change.cleared, *change.removed})
            begun = place
    return events + judge.feed(rows_of_changes(judge, changes[begun:], arrival))


def rows_of_changes(judge: Judge, changes: Sequence[Changes], arrival: int) -> Rows:
    """Return the samples of commits."""
    parents: list[str] = []
    children: list[str] = []
    authorities: list[str] = []
    parts, static, commits = [], [], []
    for change in changes:
        authorities += change.authorities
        for columns in (change.stored, change.stored_static):
            if count := len(columns):
                parents += columns.parents
                children += columns.children
                parts.append(columns)
                static.append(columns.stamps is None)
                commits.append((change.commit, count))
    counts = [count for _, count in commits]
    empty = np.zeros(0, dtype=np.int64)
    stamps = [
        np.zeros(len(each), dtype=np.int64) if each.stamps is None else each.stamps
        for each in parts
    ]
    return Rows(
        np.full(len(parents), arrival),
        judge.number_edges(parents, children),
        judge.number_authorities(authorities),
        np.concatenate([empty, *cast("list[npt.NDArray[np.int64]]", stamps)]),
        np.concatenate([np.zeros((0, 7)), *(each.poses for each in parts)]),
        np.repeat(np.array(static, dtype=bool), counts),
        np.repeat(np.array([commit for commit, _ in commits], dtype=np.int64), counts),
    )


def held_rows(judge: Judge, state: Reads, arrival: int) -> Rows:
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


class Followed(Protocol):
    """A store that others write to, and the clock of its stamps."""

    commit: int

    @property
    def store(self) -> Buffer:
        """The store."""

    @property
    def now(self) -> Callable[[], int]:
        """The clock of the stamps, nanoseconds."""

    def wait(self, until: float) -> bool:
        """Wait for a commit beyond `commit`; False: none came until then (monotonic seconds)."""

    def sleep(self, until: float) -> None:
        """Wait until then (monotonic seconds), or for the end of the source."""


class Follower:
    """Tells what is committed to a live store, in its order.

    Who falls behind the feed goes on with the newest state; `missed` says how much went by unseen.
    """

    def __init__(self, live: Followed) -> None:
        self._live = live
        self._told = live.commit
        self._busy_since = math.inf
        self.missed: int = 0
        """How many commits went by unseen."""

    def changes(self, until: float) -> list[Changes]:
        """Commits since the last call; waits for one until a monotonic time."""
        live, now = self._live, time.monotonic()
        rest = min(_REST * (now - self._busy_since), _LONGEST_REST)
        self._busy_since = math.inf
        if rest > 0:
            live.sleep(min(now + rest, until))
        if not live.wait(until):
            return []
        self._busy_since = time.monotonic()
        try:
            found = live.store.changes(self._told)
        except errors.FeedLapped:
            newest = live.store.commit
            self.missed += newest - self._told
            self._told = newest
            return []
        self._told = live.commit = max(live.commit, found[-1].commit)
        return found


def watch_arrivals(
    live: Followed, seconds: float, progress: Callable[[int, int], None] | None
) -> Arrivals:
    """Follow commits for a while, and include existing static edges."""
    log = _Log()
    began = time.monotonic()
    with live.store.snapshot() as state:
        live.commit = state.commit
        for info in state.tree():
            if info.is_static and info.parent is not None:
                _, poses, parents = state.samples(info.name)
                row = (parents[0], info.name, 0, poses[0].tolist())
                log.add(row, 0, info.authority, static=True)
    follower = Follower(live)
    while (passed := time.monotonic() - began) < seconds:
        if progress is not None:
            progress(int(passed * 1000), int(seconds * 1000))
        changes = follower.changes(began + min(passed + _BETWEEN, seconds))
        arrival = live.now()
        for change in changes:
            authors = iter(change.authorities)
            log.add_columns(change.stored, authors, arrival, static=False)
            log.add_columns(change.stored_static, authors, arrival, static=True)
    return log.arrivals(follower.missed)


class _Log:
    """Arrivals and their publishers."""

    def __init__(self) -> None:
        self._log = Log()
        self._known = False

    def add(
        self, row: tuple[str, str, int, list[float]], arrival: int, author: str, *, static: bool
    ) -> None:
        self._known = self._known or bool(author)
        self._log.add([row], arrival=arrival, publisher=author, static=static)

    def add_columns(
        self, columns: Columns, authors: Iterator[str], arrival: int, *, static: bool
    ) -> None:
        given = cast("npt.NDArray[np.int64] | None", columns.stamps)
        stamps = [0] * len(columns) if given is None else given.tolist()
        for parent, child, stamp, pose in zip(
            columns.parents, columns.children, stamps, columns.poses.tolist(), strict=True
        ):
            self.add((parent, child, stamp, pose), arrival, next(authors), static=static)

    def arrivals(self, missed: int = 0) -> Arrivals:
        return Arrivals(self._log, self._known, missed=missed)

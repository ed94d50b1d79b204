"""Contents of a live store and its later commits, as input of the doctor."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Protocol, cast

from tfdb.data import errors

from .arrivals import Arrivals
from .doctor import Log

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    import numpy as np
    import numpy.typing as npt

    from tfdb._core import Buffer, Reads
    from tfdb.data.types import Changes, Columns


_BETWEEN = 0.1
"""Seconds between two steps of a progress bar."""


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


class Follower:
    """Tells what is committed to a live store, in its order.

    Who falls behind the feed goes on with the newest state; `missed` says how much went by unseen.
    """

    def __init__(self, live: Followed) -> None:
        self._live = live
        self._told = live.commit
        self.missed: int = 0
        """How many commits went by unseen."""

    def changes(self, until: float) -> list[Changes]:
        """Commits since the last call; waits for one until a monotonic time."""
        live = self._live
        if not live.wait(until):
            return []
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

"""What a live store holds, and what is committed to it, as the doctor wants it."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, cast

import tfdb

from .arrivals import Arrivals
from .doctor import Log

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    import numpy.typing as npt

    from tfdb import Buffer, Columns, Reads

_BETWEEN = 0.02
"""Seconds between two looks at the feed."""


def stored_arrivals(state: Reads) -> Arrivals:
    """Take what is stored for arrived in the order of the stamps, each when its stamp says."""
    log = _Log()
    for info in state.tree():
        if info.parent is not None:
            stamps, poses, parents = state.samples(info.name)
            rows = list(zip(parents, stamps.tolist(), poses.tolist(), strict=True))
            for parent, stamp, pose in rows:
                row = (parent, info.name, 0 if info.is_static else stamp, pose)
                log.add(row, row[2], info.authority, static=info.is_static)
    return log.arrivals()


def watch_arrivals(
    store: Buffer, seconds: float, progress: Callable[[int, int], None] | None
) -> Arrivals:
    """Follow the store's commits for so long; of static edges also take what was there.

    Who falls behind the feed goes on with the newest state; how much went by unseen is told.
    """
    log = _Log()
    missed = 0
    began = time.monotonic()
    with store.snapshot() as state:
        commit = state.commit
        for info in state.tree():
            if info.is_static and info.parent is not None:
                _, poses, parents = state.samples(info.name)
                row = (parents[0], info.name, 0, poses[0].tolist())
                log.add(row, 0, info.authority, static=True)
    while (passed := time.monotonic() - began) < seconds:
        if progress is not None:
            progress(int(passed * 1000), int(seconds * 1000))
        time.sleep(min(_BETWEEN, seconds - passed))
        arrival = time.time_ns()
        try:
            changes = store.changes(commit)
        except tfdb.FeedLapped:
            newest = store.commit
            missed += newest - commit
            commit = newest
            continue
        for change in changes:
            commit = change.commit
            log.add_columns(store, change.stored, arrival, static=False)
            log.add_columns(store, change.stored_static, arrival, static=True)
    return log.arrivals(missed)


class _Log:
    """What arrived, and who wrote it: a store knows of each frame who was the last."""

    def __init__(self) -> None:
        self._log = Log()
        self._known = False

    def add(
        self, row: tuple[str, str, int, list[float]], arrival: int, author: str, *, static: bool
    ) -> None:
        self._known = self._known or bool(author)
        self._log.add([row], arrival=arrival, publisher=author, static=static)

    def add_columns(self, store: Buffer, columns: Columns, arrival: int, *, static: bool) -> None:
        authors: dict[str, str] = {}
        given = cast("npt.NDArray[np.int64] | None", columns.stamps)
        stamps = [0] * len(columns) if given is None else given.tolist()
        for parent, child, stamp, pose in zip(
            columns.parents, columns.children, stamps, columns.poses.tolist(), strict=True
        ):
            if child not in authors:
                authors[child] = _author(store, child)
            self.add((parent, child, stamp, pose), arrival, authors[child], static=static)

    def arrivals(self, missed: int = 0) -> Arrivals:
        return Arrivals(self._log, self._known, missed=missed)


def _author(store: Buffer, frame: str) -> str:
    try:
        return store.frame_info(frame).authority
    except tfdb.UnknownFrame:
        return ""  # it was removed since

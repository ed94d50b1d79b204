"""Why tf2 has no answer: its walk, for the words only. Lookups that have an answer never come here.

tf2 walks from the source to its root, then from the target to where the first walk ended, and names
the edge that the second walk stopped at, else that of the first. Hence the edge may lie above the
meeting point of the two, and two trees may be told as an extrapolation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tfdb.errors import Disconnected

if TYPE_CHECKING:
    from collections.abc import Container

    from tfdb import Snapshot


@dataclass(frozen=True, slots=True)
class Gap:
    """An edge without data at a stamp."""

    edge: str
    """Its child."""
    stamp: int
    """The stamp that was asked for."""
    oldest: int | None
    """Its first stamp; None: it has been emptied."""
    newest: int | None
    """Its last stamp; None: it has been emptied."""


class TwoTrees:
    """No path joins the frames, as far as tf2 looks."""


class Walker:
    """Walks one snapshot at one stamp, as tf2 does."""

    def __init__(self, snapshot: Snapshot, emptied: Container[str]) -> None:
        self._snapshot = snapshot
        self._emptied = emptied

    def refusal(self, target: str, source: str, stamp: int) -> Gap | TwoTrees | None:
        """Why T[target<-source] at a stamp has no answer; None: tf2 would have one.

        Both frames exist. Stamp 0 is the latest common time.
        """
        if target == source:
            return None
        if stamp == 0:
            try:
                stamp = self._snapshot.latest_common_time(target, source)
            except Disconnected:
                return TwoTrees()
        top, first = self._climb(source, target, stamp)
        if top == target:
            return None
        reached, second = self._climb(target, top, stamp)
        if reached in {top, source}:
            return None
        return second or first or TwoTrees()

    def _climb(self, frame: str, goal: str, stamp: int) -> tuple[str, Gap | None]:
        """Walk up to `goal`, or to a root, or to a gap: where it ended, and the gap."""
        while frame != goal:
            above = self._parent(frame, stamp)
            if above is None or isinstance(above, Gap):
                return frame, above
            frame = above
        return frame, None

    def _parent(self, frame: str, stamp: int) -> str | Gap | None:
        """Its parent at the stamp; None for a root."""
        info = self._snapshot.frame_info(frame)
        if info.is_static:
            return info.parent
        if info.oldest is None or info.newest is None:
            return Gap(frame, stamp, None, None) if frame in self._emptied else None
        # An all-static path is walked at stamp 0, where tf2 takes what is newest.
        if stamp == 0 < info.oldest:
            return info.parent
        if not info.oldest <= stamp <= info.newest:
            return Gap(frame, stamp, info.oldest, info.newest)
        return self._snapshot.parent_of(frame, stamp)

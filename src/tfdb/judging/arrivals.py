"""Transforms of a recording in the order of arrival, for the doctor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

from .doctor import Log

if TYPE_CHECKING:
    from tfdb.recordings.arrivals import RecordedArrivals


@dataclass(frozen=True)
class Arrivals:
    """The transforms, and whether the containers name their publishers (ROS 1 bags do).

    `mixed` are the frames that some messages write with a leading slash and others without.
    `missed` is how many commits of a live store went by unseen. `watched` is when its watch began
    and ended.
    """

    log: Log
    publishers_known: bool
    mixed: tuple[str, ...] = ()
    missed: int = 0
    watched: tuple[int, int] = 0, 0

    @classmethod
    def of(cls, recorded: RecordedArrivals) -> Self:
        """Return those of recordings. What a store refuses is left out."""
        return cls(Log.of(recorded), recorded.publishers_known, recorded.mixed)

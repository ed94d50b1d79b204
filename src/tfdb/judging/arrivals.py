"""Transforms of a recording in the order of arrival, as input of `doctor`."""

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
    `missed` is the number of commits of a live store that were not read. `watched` has the begin
    and the end of its watch.
    """

    log: Log
    publishers_known: bool
    mixed: tuple[str, ...] = ()
    missed: int = 0
    watched: tuple[int, int] = 0, 0

    @classmethod
    def of(cls, recorded: RecordedArrivals) -> Self:
        """Return the arrivals of recordings, without the transforms that a store refuses."""
        return cls(Log.of(recorded), recorded.publishers_known, recorded.mixed)

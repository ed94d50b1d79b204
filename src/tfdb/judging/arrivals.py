"""A recording's transforms in the order of their arrival, for the doctor."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tfdb.recordings.arrivals import recorded_arrivals
from tfdb.recordings.choice import Choice
from tfdb.recordings.recording import Recording

from .doctor import Log

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from tfdb.recordings.choice import LoadOptions


@dataclass(frozen=True)
class Arrivals:
    """The transforms, and whether the containers name their publishers (ROS 1 bags do).

    `mixed` are the frames that some messages write with a leading slash and others without.
    `missed` is how many commits of a live store went by unseen.
    """

    log: Log
    publishers_known: bool
    mixed: tuple[str, ...] = ()
    missed: int = 0


def read_arrivals(
    paths: Sequence[str],
    static: Mapping[str, bool],
    progress: Callable[[int, int], None] | None = None,
    *,
    salvage: bool = False,
    options: LoadOptions | None = None,
) -> Arrivals:
    """Read the topics in `static`, which says of each whether its transforms are static.

    `options` are those with which they were loaded.
    What a store refuses is left out: loading counts it as refused.
    """
    with ExitStack() as stack:
        unit = (options or {}).get("stamp_unit")
        recordings = [
            stack.enter_context(Recording(path, salvage=salvage, stamp_unit=unit)) for path in paths
        ]
        recorded = recorded_arrivals(recordings, static, Choice(**options or {}), progress)
    return Arrivals(Log.of(recorded), recorded.publishers_known, recorded.mixed)

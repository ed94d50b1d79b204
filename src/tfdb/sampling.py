"""Trajectories out of a store."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .errors import InvalidArgument
from .explain import held
from .types import Trajectory

if TYPE_CHECKING:
    from ._core import Policy, Reads, Snapshot
    from .stamps import StampLike

__all__ = ["trajectory"]

_MOST_POSES = 2**31


def trajectory(
    self: Reads,
    target: str,
    source: str,
    rate: float | None = None,
    start: StampLike | None = None,
    end: StampLike | None = None,
    policy: Policy | None = None,
) -> Trajectory:
    """Sample T[target<-source] over time, all from one snapshot.

    Parameters
    ----------
    target, source
        Frame names.
    rate
        Poses per second from `start` on. None: at the stored stamps of the path.
    start, end
        First and last stamp, nanoseconds. None: where every moving edge has data.
    policy
        How stamps between samples are answered. None: Interpolate().

    Returns
    -------
    Trajectory
        With stamps (N,) and poses (N, 7).

    Raises
    ------
    InvalidArgument
        A rate that is not positive, `end` before `start`, or nothing moves and no time is given.
    Extrapolation, and what else `lookup_transforms` raises
        With `index`, the position of the stamp.
    """
    with held(self) as snapshot:
        if rate is None:
            stamps = _stored_stamps(snapshot, target, source, start, end)
        else:
            stamps = _even_stamps(snapshot, target, source, rate, start, end)
        poses = snapshot.lookup_transforms(target, source, stamps, policy)
    return Trajectory(target, source, stamps, poses)


def _nanoseconds(time: StampLike) -> int:
    """Convert one stamp as the store would."""
    from ._core import to_nanoseconds  # noqa: PLC0415 - the extension imports this module

    return to_nanoseconds(time)


def _stored_stamps(
    snapshot: Snapshot, target: str, source: str, start: StampLike | None, end: StampLike | None
) -> npt.NDArray[np.int64]:
    stamps = snapshot._path_stamps(target, source, start, end)
    if len(stamps) == 0:
        raise InvalidArgument(
            f"there is no stored stamp on the path T[{target}<-{source}] in that time: give a "
            "rate, start and end, or ask explain()",
            target=target,
            source=source,
        )
    return stamps


def _even_stamps(
    snapshot: Snapshot,
    target: str,
    source: str,
    rate: float,
    start: StampLike | None,
    end: StampLike | None,
) -> npt.NDArray[np.int64]:
    if isinstance(rate, bool) or not (math.isfinite(rate) and rate > 0):
        raise InvalidArgument(f"rate must be a positive number of Hz, got {rate!r}", value=rate)
    if start is None or end is None:
        stored = _stored_stamps(snapshot, target, source, start, end)
    first = int(stored[0]) if start is None else _nanoseconds(start)
    last = int(stored[-1]) if end is None else _nanoseconds(end)
    if last < first:
        raise InvalidArgument(f"end {last} lies before start {first}", value=last)
    period = 1e9 / rate
    # The last stamp may miss `end` by the rounding of the period.
    count = math.floor((last - first) / period * (1.0 + 1e-15)) + 1
    if period < 1.0 or count > _MOST_POSES:
        raise InvalidArgument(
            f"a rate of {rate!r} Hz over {(last - first) / 1e9} s is too much", value=rate
        )
    offsets = np.rint(np.arange(count, dtype=np.float64) * period).astype(np.int64)
    stamps: npt.NDArray[np.int64] = first + offsets[offsets <= last - first]
    return stamps

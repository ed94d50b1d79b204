"""Trajectories from a store."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Literal

from tfdb.data.argument_checks import check_name, check_word
from tfdb.data.errors import InvalidArgument
from tfdb.data.poses import found
from tfdb.data.stamps import MAX_STAMP, shown
from tfdb.data.time_arguments import check_order, stamp_of

from .explain import from_one_state
from .summary import span

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from tfdb._core import Policy, Snapshot, StoreReader
    from tfdb.data.stamps import StampLike

    Samples = tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]

__all__: list[str] = []

_MOST_POSES = 10**8
"""Largest number of poses: more mean a wrong rate or time, and would exceed the memory."""
_MISSING: tuple[Any, ...] = ("raise", "nan", "skip")


def sample(
    self: StoreReader,
    target: str,
    source: str,
    rate: float | None,
    start: StampLike | str | None,
    end: StampLike | str | None,
    policy: Policy | None,
    missing: Literal["raise", "nan", "skip"],
) -> Samples:
    """Implements `Buffer.trajectory`: stamps (N,) and poses (N, 7)."""
    _check(missing)
    for name, frame in (("target", target), ("source", source)):
        check_name(name, frame)

    def read(snapshot: Snapshot) -> Samples:
        given = [
            stamp_of(name, time, lambda: span(snapshot.tree()))
            for name, time in (("start", start), ("end", end))
        ]
        if rate is None:
            stamps = _stored_stamps(snapshot, target, source, *given)
        else:
            _period(rate)
            first, last = _range(snapshot, target, source, *given)
            if missing == "raise":  # fail before a wrong time makes many stamps
                snapshot.lookup_transforms(target, source, [first], policy)
            stamps = _even_stamps(first, last, rate)
        return _sample_at(snapshot, target, source, stamps, policy, missing)

    return from_one_state(self, read)


def sample_at(
    self: StoreReader,
    target: str,
    source: str,
    stamps: npt.NDArray[np.int64],
    policy: Policy | None,
    missing: Literal["raise", "nan", "skip"],
) -> Samples:
    """Sample at given increasing stamps."""
    _check(missing)
    return from_one_state(
        self, lambda snapshot: _sample_at(snapshot, target, source, stamps, policy, missing)
    )


def _check(missing: object) -> None:
    check_word("missing", missing, _MISSING)


def _sample_at(
    snapshot: Snapshot,
    target: str,
    source: str,
    stamps: npt.NDArray[np.int64],
    policy: Policy | None,
    missing: Literal["raise", "nan", "skip"],
) -> Samples:
    absent: Literal["raise", "nan"] = "raise" if missing == "raise" else "nan"
    poses = snapshot.lookup_transforms(target, source, stamps, policy, missing=absent)
    if missing == "skip":
        here = found(poses)
        if len(here) and not here.any():
            snapshot.lookup_transforms(target, source, stamps, policy)  # raises
        stamps, poses = stamps[here], poses[here]
    return stamps, poses


def _stored_stamps(
    snapshot: Snapshot, target: str, source: str, start: int | None, end: int | None
) -> npt.NDArray[np.int64]:
    stamps = snapshot._path_stamps(target, source, start, end)
    if len(stamps) == 0:
        if start is not None and end is not None:
            check_order(start, end)
        what = f"T[{target}<-{source}] has no stored stamp from start to end"
        remedy = "give rate (--rate) for poses at other stamps"
        if not len(snapshot._path_stamps(target, source, None, None)):
            what = f"no edge of the path T[{target}<-{source}] moves"
            remedy = "give rate, start and end (--rate, --start, --end)"
        raise InvalidArgument(f"{what}: {remedy}", target=target, source=source)
    return stamps


def _range(
    snapshot: Snapshot, target: str, source: str, start: int | None, end: int | None
) -> tuple[int, int]:
    """Return the first and last stamp: as given, otherwise those of the path."""
    if start is None or end is None:
        stored = _stored_stamps(snapshot, target, source, start, end)
    first = int(stored[0]) if start is None else start
    last = int(stored[-1]) if end is None else end
    check_order(first, last)
    return first, last


def _even_stamps(first: int, last: int, rate: float) -> npt.NDArray[np.int64]:
    period = _period(rate)
    # The last stamp may miss the end by the rounding of the period.
    periods = (last - first) / period * (1.0 + 1e-15)
    if period < 1.0 or periods >= _MOST_POSES:
        raise InvalidArgument(
            f"a rate of {rate!r} Hz over {(last - first) / 1e9} s gives more than {_MOST_POSES:,} "
            "poses: lower the rate, or shorten the time",
            value=rate,
            limit=_MOST_POSES,
        )
    import numpy as np

    count = math.floor(periods) + 1
    offsets = np.rint(np.arange(count, dtype=np.float64) * period).astype(np.int64)
    stamps: npt.NDArray[np.int64] = first + offsets[offsets <= last - first]
    return stamps


def _period(rate: float) -> float:
    """Return the nanoseconds between two poses, at most the range of stamps."""
    try:
        if not isinstance(rate, bool) and math.isfinite(rate) and rate > 0:
            return min(1e9 / rate, MAX_STAMP + 1.0)
    except (TypeError, ValueError, ArithmeticError):
        pass
    raise InvalidArgument(f"rate must be a positive number of Hz, got {shown(rate)}", value=rate)

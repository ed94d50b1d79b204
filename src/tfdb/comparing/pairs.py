"""Pairs of poses for the relative error, chosen as in evo."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from tfdb.data.errors import InvalidArgument, NotComparable

from .poses import angles, distances, relative

if TYPE_CHECKING:
    from .poses import Array, Rows, Stamps

DeltaUnit: TypeAlias = Literal["frames", "m", "s", "deg", "rad"]
UNITS: tuple[DeltaUnit, ...] = ("frames", "m", "s", "deg", "rad")

_LONGEST = 4e9
"""Seconds: longer than the range of stamps."""
_IN_UNITS = {"s": 1e-9, "deg": np.rad2deg(1.0)}


def find_pairs(
    stamps: Stamps,
    poses: Array,
    delta: float,
    unit: DeltaUnit,
    *,
    all_pairs: bool,
    tolerance: float,
) -> Rows:
    """Return the rows (M, 2) of the poses that are `delta` apart.

    Consecutive pairs: each pair ends at the first pose whose path length from the pair's first pose
    reaches `delta`; the next pair begins there. All pairs: each pose is paired with the pose whose
    path length is nearest to `delta`, within the relative `tolerance`. For angles, each pose is
    paired with all poses that are rotated by `delta`.
    Raises NotComparable if no pair is found.
    """
    count = len(poses)
    if unit == "frames":
        starts = np.arange(0, count - int(delta), 1 if all_pairs else int(delta))
        pairs = np.stack((starts, starts + int(delta)), axis=1)
        if len(pairs) == 0:
            raise _too_short(delta, unit, f"only {count} poses are matched")
        return pairs
    turns = unit in ("deg", "rad")
    wanted = float(np.deg2rad(delta)) if unit == "deg" else delta
    steps: Array | Stamps
    if unit == "s":  # in nanoseconds: as floats, ten tenths sum to less than one
        wanted = max(round(min(delta, _LONGEST) * 1e9), 1)
        steps = np.diff(stamps)
    else:
        steps = (angles if turns else distances)(relative(poses[:-1], poses[1:]))
    if not all_pairs:
        pairs = _consecutive(steps, wanted)
    elif turns:
        pairs = _by_angle(poses, wanted, wanted * tolerance)
    else:
        pairs = _nearest(steps, wanted, wanted * tolerance)
    if len(pairs) == 0:
        whole = steps.sum() * _IN_UNITS.get(unit, 1.0)
        raise _too_short(delta, unit, f"the whole path of the matched poses is {whole:.6g} {unit}")
    return pairs


def _too_short(delta: float, unit: DeltaUnit, found: str) -> NotComparable:
    return NotComparable(
        f"no two poses lie {delta:g} {unit} apart, so the relative error is undefined: {found}; "
        "give a smaller delta (--delta), or with all_pairs (--all-pairs) a larger delta_tolerance "
        "(--delta-tolerance)",
        reason="no pairs",
    )


def _consecutive(steps: Array | Stamps, wanted: float) -> Rows:
    ends, way = [0], 0
    for row, step in enumerate(steps.tolist(), start=1):
        way += step
        if way >= wanted:
            ends.append(row)
            way = 0
    return np.stack((ends[:-1], ends[1:]), axis=1).astype(np.intp)


def _nearest(steps: Array | Stamps, wanted: float, tolerance: float) -> Rows:
    way = np.insert(np.cumsum(steps), 0, 0)
    first = np.arange(len(way) - 1)
    reached = np.searchsorted(way, way[:-1] + wanted)
    # During a standstill several poses are equally near: the first one counts.
    short = np.searchsorted(way, way[reached - 1])
    ends = np.stack((short, np.minimum(reached, len(way) - 1)), axis=1)
    ends = np.maximum(ends, first[:, np.newaxis] + 1)
    off = np.abs(way[ends] - way[:-1, np.newaxis] - wanted)
    best = np.argmin(off, axis=1)
    near = off[first, best] <= tolerance
    pairs: Rows = np.stack((first, ends[first, best]), axis=1)[near]
    return pairs


def _by_angle(poses: Array, wanted: float, tolerance: float) -> Rows:
    found = []
    for first in range(len(poses) - 1):
        rest = poses[first + 1 :]
        turned = angles(relative(np.broadcast_to(poses[first], rest.shape), rest))
        ends = np.flatnonzero(np.abs(turned - wanted) <= tolerance) + first + 1
        found.append(np.stack((np.full_like(ends, first), ends), axis=1))
    return np.concatenate(found) if found else np.empty((0, 2), np.intp)


def check_delta(delta: float, unit: DeltaUnit) -> None:
    """Raise InvalidArgument unless `delta` is valid in its unit."""
    if unit == "frames" and delta != int(delta):
        message = f"delta must be a whole number of frames, got {delta!r}"
        raise InvalidArgument(message, value=delta)

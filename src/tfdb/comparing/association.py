"""Matches the poses of two trajectories, by their stamps or row by row."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from tfdb.data.errors import NotComparable
from tfdb.data.stamps import format_seconds
from tfdb.store.summary import GAP_FACTOR, find_gaps
from tfdb.trajectories.trajectory import Trajectory

from .poses import poses_at, there

if TYPE_CHECKING:
    import numpy.typing as npt

    from .poses import Array, Rows, Stamps

NEAREST_MAX_DIFF = 10_000_000
"""Nanoseconds: the limit of evo and of the TUM RGB-D benchmark's tools."""


@dataclass(frozen=True)
class MatchedPoses:
    """Matched poses, row by row, at `stamps` of the reference's clock."""

    stamps: Stamps
    reference: Array
    estimate: Array
    max_diff: int
    """Longest allowed time to the nearest pose, in nanoseconds."""


def associate(
    reference: Trajectory,
    estimate: Trajectory,
    *,
    how: Literal["interpolate", "nearest", "rows"],
    max_diff: int | None,
    offset: int,
) -> MatchedPoses:
    """Match poses; `offset` is added to the stamps of the estimate, both in nanoseconds.

    Raises NotComparable if no two poses match.
    """
    if how == "rows":
        return _by_row(reference, estimate)
    interpolated = how == "interpolate"
    stamps = estimate.stamps + offset
    moved = Trajectory._made(estimate.target, estimate.source, stamps, estimate.poses)
    by_estimate = _decides(reference, moved, common=interpolated)
    few, many = (moved, reference) if by_estimate else (reference, moved)
    limit = _default(many, interpolated=interpolated) if max_diff is None else max_diff
    nearest, away = _nearest(few.stamps, many.stamps[there(many)])
    rows = np.flatnonzero(there(few) & (interpolated | (away <= limit)))
    # An offset may lead to negative stamps, which are invalid: look up each by its own clock.
    own = many is moved
    searched = estimate if own else reference
    if interpolated:
        found = poses_at(searched, few.stamps[rows] - (offset if own else 0), 2 * limit)
        rows, found = _known(rows, found)
    else:
        found = searched.poses[there(searched)][nearest[rows]]
    if len(rows) == 0:
        raise _nothing_matches(reference, moved, int(away[there(few)].min()), limit, interpolated)
    first = few.poses[rows]
    sides = (found, first) if by_estimate else (first, found)
    return MatchedPoses(few.stamps[rows], *sides, limit)


def _by_row(reference: Trajectory, estimate: Trajectory) -> MatchedPoses:
    """Match poses row by row, at the stamps of the reference.

    Raises NotComparable if the numbers of rows differ, or no row has both poses.
    """
    if len(reference) != len(estimate):
        raise NotComparable(
            f"the reference has {len(reference)} poses and the estimate {len(estimate)}: "
            "association='rows' needs equal numbers",
            reason="other numbers of poses",
        )
    rows = np.flatnonzero(there(reference) & there(estimate))
    return MatchedPoses(reference.stamps[rows], reference.poses[rows], estimate.poses[rows], 0)


def _known(rows: Rows, found: Array) -> tuple[Rows, Array]:
    known = np.isfinite(found).all(axis=1)
    return rows[known], found[known]


def _decides(reference: Trajectory, estimate: Trajectory, *, common: bool) -> bool:
    """Return whether to match at the estimate's stamps: the reference has at least as many poses.

    With `common`, only poses of the common time count.
    """
    ours, theirs = reference.stamps[there(reference)], estimate.stamps[there(estimate)]
    if common:
        start, end = max(ours[0], theirs[0]), min(ours[-1], theirs[-1])
        ours = ours[(ours >= start) & (ours <= end)]
        theirs = theirs[(theirs >= start) & (theirs <= end)]
    return len(theirs) <= len(ours)


def _default(searched: Trajectory, *, interpolated: bool) -> int:
    """Return the default limit: half of the interval that counts as a gap."""
    period = find_gaps(searched.stamps[there(searched)])[0]
    if not interpolated or period is None:
        return NEAREST_MAX_DIFF
    return GAP_FACTOR * period // 2


def _nearest(stamps: Stamps, others: Stamps) -> tuple[Rows, npt.NDArray[np.int64]]:
    """Return for each stamp the row of the nearest other (of two, the first) and its distance."""
    after = np.clip(np.searchsorted(others, stamps), 1, max(len(others) - 1, 1))
    after = np.minimum(after, len(others) - 1)
    before = np.maximum(after - 1, 0)
    nearer = np.abs(stamps - others[before]) <= np.abs(others[after] - stamps)
    nearest = np.where(nearer, before, after)
    return nearest, np.abs(others[nearest] - stamps)


def _nothing_matches(
    reference: Trajectory, estimate: Trajectory, nearest: int, limit: int, interpolated: bool
) -> NotComparable:
    def span(trajectory: Trajectory) -> str:
        first, last = int(trajectory.stamps[0]), int(trajectory.stamps[-1])
        return f"from {format_seconds(first)} to {format_seconds(last)}"

    spans = f"the reference reaches {span(reference)}, the estimate {span(estimate)}"
    apart = reference.stamps[-1] < estimate.stamps[0] or estimate.stamps[-1] < reference.stamps[0]
    if apart:
        what = f"the trajectories have no time in common: {spans}"
        reason = "no time in common"
        remedy = "give offset (--offset SECONDS), or offset='estimate' (--offset estimate)"
    else:
        what = f"no two poses lie within max_diff, {format_seconds(limit)}"
        if interpolated:
            what = (
                "no pose of one trajectory lies between poses of the other that are at most "
                f"{format_seconds(2 * limit)} apart (twice max_diff)"
            )
        what += f": the nearest two are {format_seconds(nearest)} apart; {spans}"
        reason = "no match"
        remedy = "give a larger max_diff (--max-diff), or offset='estimate' (--offset estimate)"
    return NotComparable(f"{what}; {remedy}", reason=reason, limit=limit)

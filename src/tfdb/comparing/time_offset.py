"""Estimates the clock offset of two trajectories.

Linear and angular speeds do not depend on the frame, so the offset with the best correlation of
both speeds comes first; the fit of the aligned positions then refines it. Correlation of partly
missing data: D. Padfield, "Masked object registration in the Fourier domain", IEEE Transactions on
Image Processing 21(5), 2012.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tfdb.data.errors import NotComparable
from tfdb.data.stamps import format_seconds
from tfdb.store.summary import GAP_FACTOR, find_gaps

from .poses import angles, distances, poses_at, relative, there

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb.trajectories.trajectory import Trajectory

    from .poses import Array

NEEDED = 8
"""Poses of each trajectory."""
_LEAST_OVERLAP = 0.5
_LEAST_CORRELATION = 0.5
_MOST_STEPS = 2**17
_MOST_POSES = 1_000
_CANDIDATES = 6
_WINDOW = 100_000_000
_ROUNDING = 1e-15
"""Largest ratio of misfits at which an offset is accepted."""


def estimate_offset(reference: Trajectory, estimate: Trajectory, *, scaled: bool) -> int:
    """Estimate the nanoseconds to add to the estimate's stamps.

    Half of the shorter trajectory must overlap the longer one. Raises NotComparable if the motion
    does not determine the offset: too few poses, standstill, constant speeds, no agreement.
    """
    for name, one in (("reference", reference), ("estimate", estimate)):
        if int(there(one).sum()) < NEEDED:
            raise NotComparable(
                f"the {name} has {int(there(one).sum())} poses, {NEEDED} are needed to estimate "
                "the offset; give it in seconds",
                reason="too few poses",
            )
    step, window = _steps(reference, estimate)
    courses = [_course(each, step, window) for each in (reference, estimate)]
    start = int(reference.stamps[0] - estimate.stamps[0])
    candidates = _correlate(courses[0], courses[1], step)
    offsets = [start + lag for lag in candidates]
    fit = _Fit(reference, estimate, scaled=scaled)
    if not fit.moves:
        return offsets[0]
    refined = [fit.refine(each, window) for each in offsets]
    found, left = min(refined, key=lambda each: each[1])
    return 0 if fit.misfit(0) <= left + _ROUNDING else found


def _steps(reference: Trajectory, estimate: Trajectory) -> tuple[int, int]:
    """Return the step of the grid, and the interval for speeds, both in nanoseconds."""
    lengths = [int(each.stamps[-1] - each.stamps[0]) for each in (reference, estimate)]
    periods = [find_gaps(each.stamps)[0] or 1 for each in (reference, estimate)]
    step = max(*periods, max(lengths) // _MOST_STEPS, 1)
    window = max(2, min(_WINDOW, min(lengths) // 50) // step) * step
    return step, window


def _course(trajectory: Trajectory, step: int, window: int) -> Array:
    """Return linear and angular speed (2, N) at even stamps; NaN where unknown."""
    stamps = np.arange(int(trajectory.stamps[0]), int(trajectory.stamps[-1]) + 1, step)
    poses = poses_at(
        trajectory, stamps, GAP_FACTOR * max(step, find_gaps(trajectory.stamps)[0] or 0)
    )
    many = window // step
    moved = relative(poses[:-many], poses[many:])
    return np.stack((distances(moved), angles(moved))) / (window / 1e9)


def _correlate(ours: Array, theirs: Array, step: int) -> list[int]:
    """Return the lags (ns) with the best correlation of one of the two speeds, best first."""
    best: tuple[float, list[int]] | None = None
    for a, b in zip(ours, theirs, strict=True):
        found = _peaks(a, b, step)
        if found is not None and (best is None or found[0] > best[0]):
            best = found
    if best is None:
        raise NotComparable(
            "the offset cannot be estimated: a trajectory stands still or has constant speeds; "
            "give the offset in seconds",
            reason="even motion",
        )
    if best[0] < _LEAST_CORRELATION:
        raise NotComparable(
            f"the offset cannot be estimated: the speeds correlate by at most {best[0]:.2f} (at "
            f"{format_seconds(best[1][0])} from aligned starts), {_LEAST_CORRELATION} is needed; "
            "give the offset in seconds",
            reason="no agreement",
        )
    return best[1]


def _peaks(a: Array, b: Array, step: int) -> tuple[float, list[int]] | None:
    """Return the best correlation, and the lags of the highest peaks; None if one is constant."""
    known = [np.isfinite(each) for each in (a, b)]
    sides = []
    for values, mask in zip((a, b), known, strict=True):
        if not mask.any():
            return None
        centred = np.where(mask, values - values[mask].mean(), 0.0)
        if centred.std() <= 1e-6 * np.abs(values[mask]).max():
            return None
        sides.append(centred / centred.std())
    size = 1 << (len(a) + len(b)).bit_length()

    def lay(one: Array, other: Array) -> Array:
        """Return sums of products at each lag; negative lags are indexed from the end."""
        product = np.fft.rfft(one, size) * np.conj(np.fft.rfft(other, size))
        return np.asarray(np.fft.irfft(product, size))

    (x, y), (mx, my) = sides, [mask.astype(np.float64) for mask in known]
    count = np.rint(lay(mx, my))
    enough = count >= max(_LEAST_OVERLAP * min(mx.sum(), my.sum()), NEEDED / 2)
    count = np.maximum(count, 1.0)
    sx, sy = lay(x, my), lay(mx, y)
    vx, vy = lay(x * x, my) - sx * sx / count, lay(mx, y * y) - sy * sy / count
    spread = np.sqrt(np.maximum(vx, 0) * np.maximum(vy, 0))
    good = enough & (spread > 1e-9 * count)
    ncc = np.where(good, (lay(x, y) - sx * sy / count) / np.where(good, spread, 1.0), -1.0)
    ncc = np.clip(np.roll(ncc, len(b)), -1.0, 1.0)
    peaks = np.flatnonzero(
        (ncc >= np.roll(ncc, 1)) & (ncc >= np.roll(ncc, -1)) & (ncc >= 0.9 * ncc.max())
    )
    peaks = peaks[np.argsort(-ncc[peaks], kind="stable")][:_CANDIDATES]
    lags = [int(np.rint((peak - len(b) + _vertex(ncc, int(peak))) * step)) for peak in peaks]
    return float(ncc.max()), lags


def _vertex(values: Array, peak: int) -> float:
    """Return the vertex of the parabola through a peak and its neighbours: -0.5 to 0.5."""
    if not 0 < peak < len(values) - 1:
        return 0.0
    left, middle, right = values[peak - 1 : peak + 2]
    bend = left - 2 * middle + right
    return 0.0 if bend == 0 else float(np.clip((left - right) / (2 * bend), -0.5, 0.5))


class _Fit:
    """Measures how well the positions fit at an offset, after alignment."""

    def __init__(self, reference: Trajectory, estimate: Trajectory, *, scaled: bool) -> None:
        few, many = (estimate, reference), (reference, estimate)
        self._sign = 1
        if len(reference) < len(estimate):
            few, many, self._sign = many, few, -1
        self._few, self._many = few[0], many[0]
        rows = np.flatnonzero(there(self._few))
        self._rows = rows[:: -(-len(rows) // _MOST_POSES)]
        self._points = self._few.poses[self._rows, :3]
        self._scaled = scaled
        good = there(self._many)
        self._start = int(self._many.stamps[0])
        self._times = (self._many.stamps[good] - self._start) / 1e9
        self._course = self._many.poses[good, :3]
        # The motion in a gap was not measured.
        holes = find_gaps(self._many.stamps[good])[2]
        self._holes = [
            ((h.before - self._start) / 1e9, (h.after - self._start) / 1e9) for h in holes
        ]
        self.moves = all(
            np.ptp(p, axis=0).max() > 1e-9 * (1 + np.abs(p).max())
            for p in (self._points, self._course)
        )

    def misfit(self, offset: int) -> float:
        """Return the share of the motion that remains as error; infinite without enough overlap."""
        stamps = self._few.stamps[self._rows] + self._sign * offset
        times = (stamps - self._start) / 1e9
        inside = (times >= 0.0) & (times <= self._times[-1])
        for before, after in self._holes:
            inside &= (times <= before) | (times >= after)
        if inside.sum() < max(_LEAST_OVERLAP / 2 * len(times), 4):
            return np.inf
        found = np.stack([np.interp(times[inside], self._times, c) for c in self._course.T], axis=1)
        return _misfit(found, self._points[inside], scaled=self._scaled)

    def refine(self, offset: int, window: int) -> tuple[int, float]:
        """Return the offset near this one with the least misfit, and the misfit."""
        many = np.linspace(-window, window, 41).astype(np.int64) + offset
        costs = [self.misfit(int(each)) for each in many]
        best = int(np.argmin(costs))
        low, high = int(many[max(best - 1, 0)]), int(many[min(best + 1, 40)])
        found = _lowest(self.misfit, low, high - low)
        return found, self.misfit(found)


def _misfit(a: Array, b: Array, *, scaled: bool) -> float:
    """Return the sum of squares after Umeyama's alignment, computed from the covariances."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    u, d, vt = np.linalg.svd(a.T @ b)
    if np.linalg.det(u) * np.linalg.det(vt) < 0:
        d[2] = -d[2]
    ours, theirs, both = np.sum(a * a), np.sum(b * b), d.sum()
    left = ours - both * both / theirs if scaled else ours + theirs - 2.0 * both
    return float(max(left, 0.0) / max(ours, 1e-300))


def _lowest(cost: Callable[[int], float], start: int, length: int) -> int:
    """Find a minimum by golden section search among the integers from `start` on."""
    ratio = (5**0.5 - 1) / 2
    low, high = 0.0, float(length)
    a, b = high - ratio * (high - low), low + ratio * (high - low)
    at_a, at_b = cost(start + round(a)), cost(start + round(b))
    while high - low > 50.0:
        if at_a <= at_b:
            high, b, at_b = b, a, at_a
            a = high - ratio * (high - low)
            at_a = cost(start + round(a))
        else:
            low, a, at_a = a, b, at_b
            b = low + ratio * (high - low)
            at_b = cost(start + round(b))
    return start + round((low + high) / 2)

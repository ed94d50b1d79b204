"""Which poses of a trajectory are enough to interpolate the rest."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Rows = npt.NDArray[np.int64]
    Array = npt.NDArray[np.float64]

__all__: list[str] = []

_LANE = 4096
"""Poses that are gone through one after the other; so many lanes go side by side."""
_TRIES = 3
"""Ends that are tried at once from each start."""
_ROWS = 1 << 19
"""Rows that are looked at together, or memory would run short."""


def enough_rows(stamps: Rows, poses: Array, metres: float, radians: float) -> Rows:
    """Rows, the first and last among them, that keep the interpolated path within tolerances.

    From each row on to the farthest that can be reached by one interpolation. `poses` are finite.
    """
    import numpy as np

    last = len(stamps) - 1
    if last < 2:
        return np.arange(last + 1)
    path = _Path(stamps, poses, metres, radians)
    starts = np.arange(0, last, _LANE)
    kept = np.zeros(last + 1, bool)
    kept[[0, last]] = True
    kept[starts] = True
    _walk(path, starts, np.append(starts[1:], last), kept)
    _join(path, starts[1:], kept)
    return np.flatnonzero(kept)


def _walk(path: _Path, at: Rows, stop: Rows, kept: npt.NDArray[np.bool_]) -> None:
    """Go from each of `at` to its `stop` in as long steps as can be found; note where they end."""
    import numpy as np

    at = at.copy()
    good = at + 1  # can be reached
    bad = stop + 1  # cannot, if it is not behind the stop
    span = np.ones_like(at)  # how far to look for one that cannot
    while len(at):
        done = (good == stop) | (bad - good == 1)
        kept[good[done]] = True
        span[done] = np.maximum((good - at)[done] // 4, 1)
        at[done] = good[done]
        good[done] = at[done] + 1
        bad[done] = stop[done] + 1
        going = at < stop
        at, good, bad, stop, span = (x[going] for x in (at, good, bad, stop, span))
        ends = _ends_to_try(at, good, bad, stop, span)
        fine = path.reaches(np.repeat(at, _TRIES), ends.ravel()).reshape(ends.shape)
        fine &= ends < bad[:, np.newaxis]
        reached = np.logical_and.accumulate(fine, axis=1)
        count = reached.sum(axis=1)
        lanes = np.arange(len(at))
        good = np.where(count > 0, np.maximum(good, ends[lanes, count - 1]), good)
        bad = np.where(count < _TRIES, ends[lanes, np.minimum(count, _TRIES - 1)], bad)
        bad = np.maximum(bad, good + 1)
        span = np.maximum(span, good - at)


def _ends_to_try(at: Rows, good: Rows, bad: Rows, stop: Rows, span: Rows) -> Rows:
    """Rising rows behind `good`: farther and farther, then between what is good and what is bad."""
    import numpy as np

    steps = np.arange(1, _TRIES + 1)
    farther = at[:, np.newaxis] + span[:, np.newaxis] * 2**steps
    farther = np.minimum(np.maximum(farther, good[:, np.newaxis]), stop[:, np.newaxis])
    width = (bad - good)[:, np.newaxis]
    parts = width * steps // (_TRIES + 1)
    between = good[:, np.newaxis] + np.clip(parts, 1, np.maximum(width - 1, 1))
    return np.where((bad > stop)[:, np.newaxis], farther, between)


def _join(path: _Path, seams: Rows, kept: npt.NDArray[np.bool_]) -> None:
    """Drop the ends of lanes that are not needed."""
    import numpy as np

    while len(seams):
        dropped = np.zeros(len(seams), bool)
        for turn in (0, 1):  # no two neighbours at once
            some = seams[turn::2]
            rows = np.flatnonzero(kept)
            place = np.searchsorted(rows, some)
            free = path.reaches(rows[place - 1], rows[place + 1])
            kept[some[free]] = False
            dropped[turn::2] = free
        if not dropped.any():
            return
        seams = seams[~dropped]


class _Path:
    """A path that is linear in the translation and slerp in the rotation between its rows.

    Of two such paths, one of which has some of the rows of the other, the translations differ most
    at a row. The quaternions a and b of two slerps, whose angles over a piece are A and B (half of
    the rotations' angles), differ by g = a - b, and g'' = -A^2 g + (B^2 - A^2) b. What is twice
    differentiable leaves the chord between its ends by at most max|g''| / 8, so that anywhere in
    the piece |g| <= (m + |B^2 - A^2| / 8) / (1 - min(A, B)^2 / 8), m the greater |g| at its ends.
    A rotation by an angle is two quaternions 2 sin(angle / 4) apart.
    """

    def __init__(self, stamps: Rows, poses: Array, metres: float, radians: float) -> None:
        import numpy as np

        self._stamps = stamps
        self._places = poses[:, :3]
        self._metres = metres
        # No two rotations are farther apart than pi.
        self._apart = math.inf if radians >= math.pi else 2.0 * math.sin(radians / 4.0)
        turned = poses[:, 3:]
        flips = np.where((turned[1:] * turned[:-1]).sum(axis=1) < 0.0, -1.0, 1.0)
        self._turns = turned * np.cumprod(np.append(1.0, flips))[:, np.newaxis]
        self._angles = _angles(self._turns[:-1], self._turns[1:])

    def reaches(self, starts: Rows, ends: Rows) -> npt.NDArray[np.bool_]:
        """Whether one interpolation from each start to its end, a row behind it, is near enough."""
        import numpy as np

        half = len(starts) // 2
        if half and (ends - starts).sum() > _ROWS:
            parts = (slice(half), slice(half, None))
            return np.concatenate([self.reaches(starts[part], ends[part]) for part in parts])
        answer = ends - starts <= 1
        test = np.flatnonzero(~answer)
        if len(test) == 0:
            return answer
        starts, ends = starts[test], ends[test]
        counts = ends - starts - 1
        offsets = np.cumsum(counts) - counts
        owner = np.repeat(np.arange(len(test)), counts)
        rows = np.arange(len(owner)) - np.repeat(offsets - starts - 1, counts)
        length = (self._stamps[ends] - self._stamps[starts]).astype(np.float64)
        u = (self._stamps[rows] - self._stamps[starts][owner]) / length[owner]
        with np.errstate(over="ignore", invalid="ignore"):
            near = self._places_near(starts[owner], ends[owner], rows, u)
            if self._apart < math.inf:
                near &= self._turns_near(starts, ends, rows, u, owner, offsets, length)
        answer[test] = np.logical_and.reduceat(near, offsets)
        return answer

    def _places_near(self, start: Rows, end: Rows, rows: Rows, u: Array) -> npt.NDArray[np.bool_]:
        p, q = self._places[start], self._places[end]
        off = p + u[:, None] * (q - p) - self._places[rows]
        near: npt.NDArray[np.bool_] = (off**2).sum(axis=1) <= self._metres**2
        return near

    def _turns_near(
        self,
        starts: Rows,
        ends: Rows,
        rows: Rows,
        u: Array,
        owner: Rows,
        offsets: Rows,
        length: Array,
    ) -> npt.NDArray[np.bool_]:
        """Of each row: whether the piece that ends there is near, of the last also the one after.

        A start and an end with opposite signs are joined by a turn the other way round, which
        somewhere is pi off.
        """
        import numpy as np

        a, b = self._turns[starts], self._turns[ends]
        same_way = (a * b).sum(axis=1) >= 0.0
        angle = _angles(a, b)
        made = _slerp(a[owner], b[owner], angle[owner], u)
        apart = np.sqrt(((made - self._turns[rows]) ** 2).sum(axis=1))
        before = np.append(0.0, apart[:-1])
        before[offsets] = 0.0
        speed = angle / length
        lasts = np.append(offsets[1:], len(rows)) - 1

        def farthest(m: Array, piece: Rows, over: Array) -> Array:
            exact = self._angles[piece]
            given = over * (self._stamps[piece + 1] - self._stamps[piece])
            bend = np.minimum(exact, given) ** 2 / 8.0
            bound: Array = (m + np.abs(given**2 - exact**2) / 8.0) / (1.0 - bend)
            return bound

        near = farthest(np.maximum(before, apart), rows - 1, speed[owner]) <= self._apart
        near[lasts] &= same_way & (farthest(apart[lasts], rows[lasts], speed) <= self._apart)
        return near


def _angles(a: Array, b: Array) -> Array:
    """Angles between unit vectors of four numbers."""
    import numpy as np

    apart = np.sqrt(((a - b) ** 2).sum(axis=-1))
    along = np.sqrt(((a + b) ** 2).sum(axis=-1))
    angles: Array = 2.0 * np.arctan2(apart, along)
    return angles


def _slerp(a: Array, b: Array, angle: Array, u: Array) -> Array:
    """From a (u = 0) to b (u = 1), `angle` apart."""
    import numpy as np

    # sin(u angle) / sin(angle), also where the angle is zero.
    whole = np.sinc(angle / np.pi)
    of_a = (1.0 - u) * np.sinc((1.0 - u) * angle / np.pi) / whole
    of_b = u * np.sinc(u * angle / np.pi) / whole
    made: Array = of_a[:, None] * a + of_b[:, None] * b
    return made

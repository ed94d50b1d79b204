"""Rates, delays and publishers of frames, for `tfdb monitor`."""

from __future__ import annotations

from collections import defaultdict, deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from tfdb.data.decimal_time import NS_PER_SECOND as NS

from .events import ANOTHER_CLOCK, TIMELY
from .judge import NEVER, Groups

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    from .judge import Floats, Integers, Judge, Rows


@dataclass(frozen=True)
class Delays:
    """Times from a stamp to its arrival, in nanoseconds, over a period.

    Stamps of a clock other than that of the arrivals have no delay.
    """

    count: int
    mean: int | None
    """None without any."""
    longest: int | None
    gap: int
    """The longest time between two stamps."""
    nearest: int | None
    """Delay of a stamp of any clock: the one nearest to 0."""


@dataclass(frozen=True)
class Frame:
    """One frame: its parent and its publishers."""

    parent: str
    static: bool
    authors: tuple[str, ...]


_COUNT, _TIMED, _LONGEST, _GAP, _BEHIND, _AHEAD = range(6)
_NOTHING = np.array([0, 0, -NEVER, 0, NEVER, -NEVER])
"""What a period has of each subject: two counts, the greatest, but of `_BEHIND` the least."""


class _Sums:
    """Delays of numbered subjects over the last periods: two arrays for each period.

    One holds integers, the other the sum of the delays, which integers of 64 bits cannot.
    """

    def __init__(self, window: int) -> None:
        self._periods = deque([(_columns(0), np.zeros(0))], maxlen=window)

    def next_period(self) -> None:
        """Begin another period."""
        self._periods.append((_columns(0), np.zeros(0)))

    def grow(self, count: int) -> tuple[Integers, Floats]:
        """Return the newest period, with a column for so many subjects."""
        now, totals = self._periods[-1]
        if (added := count - len(totals)) > 0:
            now = np.hstack([now, _columns(added)])
            self._periods[-1] = now, np.append(totals, np.zeros(added))
        return self._periods[-1]

    def count(self, subjects: Integers) -> None:
        """Count arrivals without a delay."""
        now, _ = self.grow(int(subjects.max(initial=-1)) + 1)
        now[_COUNT] += np.bincount(subjects, minlength=now.shape[1])

    def add(self, subjects: Integers, delays: Integers) -> None:
        """Count arrivals with their delays."""
        self.count(subjects)
        now, totals = self._periods[-1]
        behind = delays >= 0
        np.minimum.at(now[_BEHIND], subjects[behind], delays[behind])
        np.maximum.at(now[_AHEAD], subjects[~behind], delays[~behind])
        timed = np.abs(delays) < ANOTHER_CLOCK
        subjects, delays = subjects[timed], delays[timed]
        now[_TIMED] += np.bincount(subjects, minlength=now.shape[1])
        totals += np.bincount(subjects, delays, minlength=len(totals))
        np.maximum.at(now[_LONGEST], subjects, delays)

    def all(self, *, apart: bool = False) -> list[Delays]:
        """Return the delays of each subject over the periods; `apart`: without the delays."""
        whole, totals = self._joined()
        columns = zip(whole.T.tolist(), totals.tolist(), strict=True)
        return [_delays(column, total, apart=apart) for column, total in columns]

    def nearest(self) -> int:
        """Return the least distance of a stamp to its arrival; NEVER without stamps."""
        whole, _ = self._joined()
        return int(np.minimum(whole[_BEHIND], -whole[_AHEAD]).min(initial=NEVER))

    def _joined(self) -> tuple[Integers, Floats]:
        whole = _columns(max(len(totals) for _, totals in self._periods))
        sums = np.zeros(whole.shape[1])
        for period, totals in self._periods:
            part = whole[:, : len(totals)]
            sums[: len(totals)] += totals
            part[: _TIMED + 1] += period[: _TIMED + 1]
            for row, join in _JOINS:
                join(part[row], period[row], out=part[row])
        return whole, sums


_JOINS = (
    (_LONGEST, np.maximum),
    (_GAP, np.maximum),
    (_BEHIND, np.minimum),
    (_AHEAD, np.maximum),
)


def _columns(count: int) -> Integers:
    return np.repeat(_NOTHING[:, None], count, axis=1)


def _delays(column: list[int], total: float, *, apart: bool) -> Delays:
    count, timed, longest, gap, behind, ahead = column
    nearest = behind if behind <= -ahead else ahead
    known = None if nearest == NEVER else nearest
    if apart or not timed:
        return Delays(count, None, None, gap, known)
    return Delays(count, int(total // timed), longest, gap, known)


class Rates:
    """Counts arrivals over the last periods.

    Parameters
    ----------
    judge
        Numbers the edges and authorities.
    began
        Start of the first period, in nanoseconds of a clock that does not jump.
    window
        Number of periods that count.
    """

    def __init__(self, judge: Judge, began: int, window: int) -> None:
        self._judge = judge
        self._began: deque[int] = deque([began], maxlen=window)
        self._numbers: dict[str, int] = {}
        self._frame_of = np.zeros(0, dtype=np.int64)
        """By edge: the number of its child."""
        self._edges = np.zeros(0, dtype=np.int64)
        """By frame: its newest edge."""
        self._static = np.zeros(0, dtype=bool)
        self._newest = np.zeros(0, dtype=np.int64)
        self._author = np.zeros(0, dtype=np.int64)
        self._authors: dict[int, set[int]] = defaultdict(set)
        self._of_frames, self._of_authors = _Sums(window), _Sums(window)
        self._net = _Sums(window)

    def add(self, rows: Rows) -> None:
        """Count samples."""
        if not len(rows):
            return
        self._number_frames()
        frames = self._frame_of[rows.edges]
        self._edges[frames], self._static[frames] = rows.edges, rows.static
        other = self._author[frames] != rows.authorities
        self._author[frames] = rows.authorities
        pairs = np.stack([frames[other], rows.authorities[other]])
        for frame, author in np.unique(pairs, axis=1).T.tolist():
            self._authors[frame].add(author)
        if rows.static.any():
            self._of_frames.count(frames[rows.static])
            self._of_authors.count(rows.authorities[rows.static])
            rows = rows.at(~rows.static)
            frames = self._frame_of[rows.edges]
        delays = rows.arrivals - rows.stamps
        self._of_frames.add(frames, delays)
        self._of_authors.add(rows.authorities, delays)
        groups = Groups.of(frames)
        newest = groups.greatest(rows.stamps[groups.rows], self._newest)
        before = groups.before(newest, self._newest)
        gaps = np.where(before < 0, 0, rows.stamps[groups.rows] - before)
        np.maximum.at(self._of_frames.grow(0)[0][_GAP], groups.subjects, gaps)
        self._newest[groups.subjects[groups.lasts]] = newest[groups.lasts]

    def forget(self, frames: Collection[str]) -> None:
        """Restart frames whose samples were dropped, as when time jumps back."""
        self._newest[[self._numbers[name] for name in frames if name in self._numbers]] = -1

    def add_net(self, delay: int) -> None:
        """Count the delay of the monitored chain."""
        self._net.add(np.zeros(1, dtype=np.int64), np.array([delay]))

    def next_period(self, now: int) -> None:
        """Begin another period, and drop periods that are too old."""
        self._began.append(now)
        for each in (self._of_frames, self._of_authors, self._net):
            each.next_period()

    def seconds(self, now: int) -> float:
        """Total length of the periods that count."""
        return max(now - self._began[0], 1) / NS

    def of_frames(self) -> Iterator[tuple[str, Frame, Delays]]:
        """Return each frame with its delays, by name."""
        self._of_frames.grow(len(self._numbers))
        found = self._of_frames.all(apart=self._are_apart())
        names, pairs = self._judge.authority_names, self._judge.edge_names
        for name, number in sorted(self._numbers.items()):
            if self._edges[number] < 0:  # expected, and has not arrived
                continue
            authors = tuple(sorted(names[author] for author in self._authors[number]))
            edge = pairs[self._edges[number]]
            yield name, Frame(edge[0], bool(self._static[number]), authors), found[number]

    def of_authors(self) -> list[tuple[str, Delays]]:
        """Return each publisher with its delays, by name."""
        self._of_authors.grow(len(self._judge.authority_names))
        found = self._of_authors.all(apart=self._are_apart())
        seen = set[int]().union(*self._authors.values())
        named = zip(self._judge.authority_names, found, strict=True)
        return sorted(each for number, each in enumerate(named) if number in seen)

    def of_chain(self) -> Delays:
        """The delays of the monitored chain."""
        self._net.grow(1)
        return self._net.all(apart=self._are_apart())[0]

    def _are_apart(self) -> bool:
        """Whether no stamp is near its arrival, so that all come from another clock."""
        return TIMELY < self._of_frames.nearest() < NEVER

    def _number_frames(self) -> None:
        """Number the children of new edges."""
        known = len(self._frame_of)
        new = [child for _, child in self._judge.edge_names[known:]]
        if not new:
            return
        numbers = [self._numbers.setdefault(child, len(self._numbers)) for child in new]
        self._frame_of = np.append(self._frame_of, numbers)
        added = len(self._numbers) - len(self._edges)
        self._edges = np.append(self._edges, np.full(added, -1))
        self._static = np.append(self._static, np.zeros(added, dtype=bool))
        self._newest = np.append(self._newest, np.full(added, -1))
        self._author = np.append(self._author, np.full(added, -1))

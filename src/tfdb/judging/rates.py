"""Rates, delays and publishers of frames, for `tfdb monitor`."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tfdb.data.decimal_time import NS_PER_SECOND as NS

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    import numpy as np
    import numpy.typing as npt

    from tfdb.recordings.arrivals import Columns


ANOTHER_CLOCK = 3600 * NS
"""No stamp that is so far from its arrival is of the arrival's clock."""
TIMELY = 10 * NS
"""Where no stamp is so near to its arrival, all are of another clock."""


@dataclass
class Delays:
    """Times from a stamp to its arrival, in nanoseconds, over some period.

    Stamps of another clock than that of the arrivals have none.
    """

    count: int = 0
    timed: int = 0
    total: int = 0
    longest: int | None = None
    gap: int = 0
    nearest: int | None = None
    """From a stamp of any clock to its arrival: the one that is nearest to 0."""

    def add(self, delay: int, gap: int = 0) -> None:
        """Count one arrival, so long after its stamp, which is so far from the one before."""
        self.count += 1
        self.gap = max(self.gap, gap)
        self._take_nearest(delay)
        if abs(delay) < ANOTHER_CLOCK:
            self.timed += 1
            self.total += delay
            self.longest = delay if self.longest is None else max(self.longest, delay)

    def add_many(self, delays: npt.NDArray[np.int64]) -> None:
        """Count arrivals, so long after their stamps."""
        self.count += len(delays)
        if len(delays):
            self._take_nearest(int(delays[abs(delays).argmin()]))
        timed = delays[abs(delays) < ANOTHER_CLOCK]
        if len(timed):
            self.timed += len(timed)
            # In halves, of which no sum overflows.
            self.total += (int((timed >> 32).sum()) << 32) + int((timed & 0xFFFFFFFF).sum())
            longest = int(timed.max())
            self.longest = longest if self.longest is None else max(self.longest, longest)

    def join(self, other: Delays) -> None:
        """Take those of another period, too."""
        self.count += other.count
        self.timed += other.timed
        self.total += other.total
        self.gap = max(self.gap, other.gap)
        if other.nearest is not None:
            self._take_nearest(other.nearest)
        if other.longest is not None:
            self.longest = (
                other.longest if self.longest is None else max(self.longest, other.longest)
            )

    def _take_nearest(self, delay: int) -> None:
        self.nearest = delay if self.nearest is None else min(self.nearest, delay, key=abs)

    def without(self) -> Delays:
        """The same counts without any delay."""
        return Delays(self.count, gap=self.gap, nearest=self.nearest)

    @property
    def mean(self) -> int | None:
        """Nanoseconds; None without any."""
        return self.total // self.timed if self.timed else None


@dataclass
class Frame:
    """One frame: publishers, parent, and delays per period."""

    parent: str
    static: bool
    authors: Counter[str] = field(default_factory=Counter)
    newest: int | None = None
    periods: deque[Delays] = field(default_factory=lambda: deque([Delays()]))


class Rates:
    """Counts arrivals, over the last periods alone.

    Parameters
    ----------
    began
        When it began to look, in nanoseconds of any clock that does not jump.
    window
        How many periods count.
    """

    def __init__(self, began: int, window: int) -> None:
        self._window = window
        self._began: deque[int] = deque([began])
        self.frames: dict[str, Frame] = {}
        """By name."""
        self._authors: dict[str, deque[Delays]] = {}
        self.net: deque[Delays] = deque([Delays()])

    def add(
        self, edge: tuple[str, str], stamp: int, arrival: int, author: str, *, static: bool
    ) -> None:
        """Count the arrival of (parent, child)."""
        parent, child = edge
        frame = self.frames.get(child)
        if frame is None:
            frame = self.frames[child] = Frame(parent, static)
        frame.parent, frame.static = parent, static
        frame.authors[author] += 1
        sent = self._authors.setdefault(author, deque([Delays()]))
        if static:
            frame.periods[-1].count += 1
            sent[-1].count += 1
            return
        gap = 0 if frame.newest is None else stamp - frame.newest
        frame.newest = stamp if frame.newest is None else max(stamp, frame.newest)
        frame.periods[-1].add(arrival - stamp, gap)
        sent[-1].add(arrival - stamp)

    def add_columns(
        self,
        child: str,
        columns: Columns,
        static: npt.NDArray[np.bool_],
        names: Sequence[str],
    ) -> None:
        """Count a recorded edge's arrivals.

        `names` are those of the parents and publishers.
        """
        import numpy as np

        stamps, arrivals, _, parents, publishers = columns
        newest = np.maximum.accumulate(stamps)
        moving = ~static
        frame = Frame(names[parents[-1]], bool(static[-1]))
        self.frames[child] = frame
        if not frame.static:
            frame.newest = int(newest[-1])
        period = frame.periods[-1]
        period.add_many((arrivals - stamps)[moving])
        period.count += int(static.sum())
        period.gap = int((stamps[1:] - newest[:-1])[moving[1:]].max(initial=0))
        for number in np.unique(publishers).tolist():
            theirs = publishers == number
            frame.authors[names[number]] = int(theirs.sum())
            sent = self._authors.setdefault(names[number], deque([Delays()]))[-1]
            sent.add_many((arrivals - stamps)[theirs & moving])
            sent.count += int((theirs & static).sum())

    def forget_stamps(self, name: str) -> None:
        """Restart a frame whose samples were dropped, as when time jumps back."""
        frame = self.frames.get(name)
        if frame is not None:
            frame.newest = None

    def add_net(self, delay: int) -> None:
        """Count the delay of the chain that is watched."""
        self.net[-1].add(delay)

    def next_period(self, now: int) -> None:
        """Begin another period, and forget those that are too long ago."""
        self._began.append(now)
        while len(self._began) > self._window:
            self._began.popleft()
        of_frames = (frame.periods for frame in self.frames.values())
        for each in (self.net, *of_frames, *self._authors.values()):
            each.append(Delays())
            while len(each) > len(self._began):
                each.popleft()

    def seconds(self, now: int) -> float:
        """How long the periods are that count."""
        return max(now - self._began[0], 1) / NS

    def of_frames(self) -> Iterator[tuple[str, Frame, Delays]]:
        """Each frame with the delays that count, by name."""
        apart = self._are_apart()
        for name, frame in sorted(self.frames.items()):
            delays = joined(frame.periods)
            yield name, frame, delays.without() if apart else delays

    def of_authors(self) -> list[tuple[str, Delays]]:
        """Each publisher with the delays of all that it sent, by name."""
        apart = self._are_apart()
        found = ((name, joined(periods)) for name, periods in sorted(self._authors.items()))
        return [(name, delays.without() if apart else delays) for name, delays in found]

    def of_chain(self) -> Delays:
        """The delays of the chain that is watched."""
        net = joined(self.net)
        return net.without() if self._are_apart() else net

    def _are_apart(self) -> bool:
        """Whether no stamp of any frame is near to its arrival: all are of another clock."""
        nearest = (joined(frame.periods).nearest for frame in self.frames.values())
        known = [abs(each) for each in nearest if each is not None]
        return bool(known) and min(known) > TIMELY


def joined(periods: deque[Delays]) -> Delays:
    """All periods as one."""
    whole = Delays()
    for period in periods:
        whole.join(period)
    return whole

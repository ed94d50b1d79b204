"""The versions of one edge in their order, and between which of them a read must have happened."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from typing import TYPE_CHECKING, NamedTuple

from .history import UNSEEN, Read, Transaction, Unseen, Value, Write

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

STATIC = -1
"""The stamp that stands for a static edge's one value."""


class Version(NamedTuple):
    """One value of an edge: the number of its writer in the history, and the write."""

    writer: int
    write: Write


class Span(NamedTuple):
    """A read fits after version `after` (-1: from the beginning on) and before version `before`.

    `before` None: to the end. `broken`: a version before `after` that rules the read out.
    """

    after: int
    before: int | None
    broken: int | None = None


def stamp_of(write: Write) -> int:
    """The stamp that places the write among the samples of its edge."""
    return STATIC if write.stamp is None else write.stamp


def final_writes(transaction: Transaction) -> list[Write]:
    """What the transaction leaves behind: of several writes to one place the last."""
    if len(transaction.writes) == 1:
        return list(transaction.writes)
    kept: dict[tuple[str, int | None], Write] = {}
    for write in transaction.writes:
        if write.remove:
            for place in [p for p in kept if p[0] == write.edge]:
                del kept[place]
            kept[write.edge, None] = write
        else:
            place = (write.edge, stamp_of(write))
            kept.pop(place, None)
            kept[place] = write
    return list(kept.values())


class EdgeVersions:
    """All versions of one edge, in their order."""

    def __init__(self, versions: Sequence[Version]) -> None:
        self.versions = versions
        self.index: dict[Value, int] = {v.write.value: i for i, v in enumerate(versions)}
        count = len(versions)
        self._stamps = [stamp_of(v.write) for v in versions]
        self._born = [0] * count  # first version of the frame's life
        self._gone: list[int | None] = [None] * count  # the removal that ends it
        self._replaced: list[int | None] = [None] * count  # by what is as new or newer
        self._shadowed = [False] * count  # something newer was there before
        self._by_stamp: list[tuple[int, int]] = []
        self._find_lives()

    def _find_lives(self) -> None:
        born = 0
        newest: int | None = None
        waiting: list[int] = []  # not yet replaced, stamps falling
        for i, version in enumerate(self.versions):
            if version.write.remove:
                for j in range(born, i):
                    self._gone[j] = i
                for j in waiting:
                    self._replaced[j] = i
                waiting.clear()
                born, newest = i + 1, None
                self._born[i] = i
                continue
            stamp = self._stamps[i]
            self._born[i] = born
            self._by_stamp.append((stamp, i))
            self._shadowed[i] = newest is not None and stamp < newest
            newest = stamp if newest is None else max(newest, stamp)
            while waiting and self._stamps[waiting[-1]] <= stamp:
                self._replaced[waiting.pop()] = i
            waiting.append(i)
        self._by_stamp.sort()

    def is_value(self, index: int) -> bool:
        """Tell whether this version is a value: neither the beginning nor a removal."""
        return index >= 0 and not self.versions[index].write.remove

    def spans(self, read: Read) -> Iterator[list[Span]]:
        """For each side of the read the spans that it fits, one of which must hold.

        A value that is no version of this edge has no spans: it is judged elsewhere.
        """
        if read.stamp is None:
            yield self._newest(read.before)
            return
        if read.before is not UNSEEN:
            yield self._side(read.before, None, read.stamp)
        if read.after is not UNSEEN:
            yield self._side(read.after, read.stamp, None)

    def _newest(self, value: Value | Unseen | None) -> list[Span]:
        if value is None:
            return self._absent(None, None)
        i = self.index.get(value)  # type: ignore[arg-type]
        if i is None or self.versions[i].write.remove:
            return []
        broken = None
        if self._shadowed[i]:
            stamp = self._stamps[i]
            broken = next(j for j in range(self._born[i], i) if self._stamps[j] > stamp)
        return [Span(i, self._replaced[i], broken)]

    def _side(self, value: Value | Unseen | None, start: int | None, end: int | None) -> list[Span]:
        """The nearest sample at or before `end`, or at or after `start`."""
        if value is None:
            return self._absent(start, end)
        i = self.index.get(value)  # type: ignore[arg-type]
        if i is None or self.versions[i].write.remove:
            return []
        stamp = self._stamps[i]
        first, last = (stamp, end) if start is None else (start, stamp)
        before, broken = self._gone[i], None
        for other, j in self._between(first, last):
            if j > i and (before is None or j < before):
                before = j
            elif self._born[i] <= j < i and other != stamp and (broken is None or j < broken):
                broken = j
        return [Span(i, before, broken)]

    def _absent(self, start: int | None, end: int | None) -> list[Span]:
        """Where no sample lay between the stamps: at the start of each life of the frame."""
        inside = sorted(j for _, j in self._between(start, end))
        lives = [0, *(i + 1 for i, v in enumerate(self.versions) if v.write.remove)]
        found: list[Span] = []
        for life in lives:
            at = bisect_left(inside, life)
            first = inside[at] if at < len(inside) else None
            found.append(Span(life - 1, first))
        # A life without such a sample goes on into the next one.
        merged: list[Span] = []
        for span in found:
            if merged and merged[-1].before == span.before:
                continue
            merged.append(span)
        return merged

    def _between(self, start: int | None, end: int | None) -> list[tuple[int, int]]:
        lo = 0 if start is None else bisect_left(self._by_stamp, (start, -1))
        hi = (
            len(self._by_stamp)
            if end is None
            else bisect_right(self._by_stamp, (end, len(self.versions)))
        )
        return self._by_stamp[lo:hi]

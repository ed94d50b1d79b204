"""An order of the transactions that explains what they read, found by trying.

For histories that do not say in which order an edge was written. What is next is one of those that
nobody still waiting precedes in real time, so that few have to be tried at each step.
"""

from __future__ import annotations

import random
from bisect import bisect_left, bisect_right, insort
from collections import defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from .graph import thread_order
from .history import UNSEEN, Read, Transaction, Unseen, Value, Write
from .versions import stamp_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence


@dataclass
class _Edge:
    """The samples of one frame."""

    stamps: list[int] = field(default_factory=list)
    values: dict[int, Value] = field(default_factory=dict)

    def newest(self) -> Value | None:
        return self.values[self.stamps[-1]] if self.stamps else None

    def before(self, stamp: int) -> Value | None:
        at = bisect_right(self.stamps, stamp)
        return self.values[self.stamps[at - 1]] if at else None

    def after(self, stamp: int) -> Value | None:
        at = bisect_left(self.stamps, stamp)
        return self.values[self.stamps[at]] if at < len(self.stamps) else None


_Undo = list[tuple[str, int, Value | None, "_Edge | None"]]


class _Store:
    """All edges, with writes that can be taken back, and a number that tells states apart."""

    def __init__(self) -> None:
        self._edges: dict[str, _Edge] = defaultdict(_Edge)
        self.mark = 0

    def apply(self, writes: Iterable[Write]) -> _Undo:
        undo: _Undo = []
        for write in writes:
            edge = self._edges[write.edge]
            if write.remove:
                undo.append((write.edge, 0, None, edge))
                self._edges[write.edge] = _Edge()
                self._toggle(write.edge, edge)
                continue
            stamp = stamp_of(write)
            old = edge.values.get(stamp)
            undo.append((write.edge, stamp, old, None))
            if old is None:
                insort(edge.stamps, stamp)
            else:
                self.mark ^= hash((write.edge, stamp, old))
            edge.values[stamp] = write.value
            self.mark ^= hash((write.edge, stamp, write.value))
        return undo

    def undo(self, undo: _Undo) -> None:
        for name, stamp, old, whole in reversed(undo):
            if whole is not None:
                self._edges[name] = whole
                self._toggle(name, whole)
                continue
            edge = self._edges[name]
            self.mark ^= hash((name, stamp, edge.values[stamp]))
            if old is None:
                del edge.values[stamp]
                del edge.stamps[bisect_left(edge.stamps, stamp)]
            else:
                edge.values[stamp] = old
                self.mark ^= hash((name, stamp, old))

    def _toggle(self, name: str, edge: _Edge) -> None:
        for stamp, value in edge.values.items():
            self.mark ^= hash((name, stamp, value))

    def fits(self, one: Transaction) -> bool:
        """Tell whether the transaction, run now and alone, reads what it has read."""
        for read in one.reads:
            if read.own:
                undo = self.apply(one.writes[: read.own])
                same = self._same(read)
                self.undo(undo)
            else:
                same = self._same(read)
            if not same:
                return False
        return True

    def _same(self, read: Read) -> bool:
        edge = self._edges[read.edge]
        if read.stamp is None:
            return edge.newest() == read.before
        return _equal(read.before, edge.before(read.stamp)) and _equal(
            read.after, edge.after(read.stamp)
        )


def _equal(seen: Value | Unseen | None, found: Value | None) -> bool:
    return seen is UNSEEN or seen == found


class Search:
    """A search with a bound on the transactions that it tries.

    After `run`: `order` is an order that explains the history, or None; `exhausted` says that there
    is none. `deepest` is the longest order that explains a part, and `stuck` what would be next.
    The last `optional` transactions may be left out.
    """

    def __init__(self, transactions: Sequence[Transaction], steps: int, optional: int = 0) -> None:
        self.order: list[int] | None = None
        self.exhausted: bool = False
        self.deepest: list[int] = []
        self.stuck: list[int] = []
        self._needed = len(transactions) - optional
        self._missing = self._needed
        self._transactions = transactions
        self._left = steps
        self._store = _Store()
        count = len(transactions)
        self._sorted = sorted(range(count), key=lambda t: (transactions[t].begin, t))
        self._next = [0] * (count + 1)  # `count` is both ends of the ring
        self._before = [0] * (count + 1)
        ring = [count, *self._sorted]
        for node, other in zip(ring, [*ring[1:], count], strict=True):
            self._next[node], self._before[other] = other, node
        self._done = [False] * count
        self._needs = _needs(transactions, self._sorted, self._needed)
        marks = random.Random(1)  # noqa: S311
        self._marks = [marks.getrandbits(64) for _ in range(count)]
        self._mark = 0
        self._begun = min((t.begin for t in transactions), default=0)  # latest of those placed
        self._placed: list[tuple[int, _Undo]] = []
        self._begins: list[int] = []

    def run(self) -> Search:
        """Try until an order is found, none is left, or the steps are used up."""
        seen: set[tuple[int, int]] = set()
        self._place_readers()
        stack: list[tuple[list[int], int]] = [(self._candidates(), len(self._placed))]
        while self._missing:
            if not stack:
                self.exhausted = True
                return self
            candidates, depth = stack[-1]
            self._take_back(depth)
            if not candidates:
                self._note()
                stack.pop()
                continue
            node = candidates.pop()
            if self._left <= 0:
                return self
            if not self._fits(node):
                continue
            self._place(node)
            self._place_readers()
            key = (self._mark, self._store.mark)
            if key in seen:
                continue
            seen.add(key)
            stack.append((self._candidates(), len(self._placed)))
        self.order = [node for node, _ in self._placed]
        return self

    def _note(self) -> None:
        """Remember how far it went, before anything is taken back."""
        if len(self._placed) > len(self.deepest) or not self.stuck:
            self.deepest = [node for node, _ in self._placed]
            self.stuck = self._open()

    def _candidates(self) -> list[int]:
        """Who may be next, the likeliest last."""
        found = self._open()
        found.sort(key=lambda node: -self._transactions[node].end)
        return found

    def _open(self) -> list[int]:
        found: list[int] = []
        count = len(self._transactions)
        node = self._next[count]
        first_end: int | None = None
        while node != count:
            one = self._transactions[node]
            if first_end is not None and one.begin > first_end:
                break
            needed = node < self._needed
            if needed and (first_end is None or one.end < first_end):
                first_end = one.end
            ready = all(self._done[other] for other in self._needs[node])
            if ready and (needed or one.end >= self._begun):
                found.append(node)
            node = self._next[node]
        return found

    def _place_readers(self) -> None:
        """Whoever only reads and fits now may go now: it changes nothing for the others."""
        placed = True
        while placed and self._left > 0:
            placed = False
            for node in self._open():
                if not self._transactions[node].writes and self._fits(node):
                    self._place(node)
                    placed = True

    def _fits(self, node: int) -> bool:
        self._left -= 1
        return self._store.fits(self._transactions[node])

    def _place(self, node: int) -> None:
        one = self._transactions[node]
        self._placed.append((node, self._store.apply(one.writes)))
        self._begins.append(self._begun)
        self._begun = max(self._begun, one.begin)
        self._missing -= node < self._needed
        before, after = self._before[node], self._next[node]
        self._next[before], self._before[after] = after, before
        self._done[node] = True
        self._mark ^= self._marks[node]

    def _take_back(self, depth: int) -> None:
        while len(self._placed) > depth:
            node, undo = self._placed.pop()
            self._begun = self._begins.pop()
            self._missing += node < self._needed
            self._store.undo(undo)
            self._next[self._before[node]] = self._before[self._next[node]] = node
            self._done[node] = False
            self._mark ^= self._marks[node]


def _needs(
    transactions: Sequence[Transaction], by_begin: list[int], needed: int
) -> list[list[int]]:
    """Who must be done before each: by the order of its thread, and by commit numbers."""
    by_begin = [node for node in by_begin if node < needed]
    needs: list[list[int]] = [[] for _ in transactions]
    for before, node in thread_order(transactions, by_begin):
        needs[node].append(before)
    writers: dict[str, list[int]] = defaultdict(list)
    numbered = [t for t in by_begin if transactions[t].commit is not None]
    numbered.sort(key=lambda t: transactions[t].commit or 0)
    for node in numbered:
        for edge in {write.edge for write in transactions[node].writes}:
            if writers[edge]:
                needs[node].append(writers[edge][-1])
            writers[edge].append(node)
    return needs

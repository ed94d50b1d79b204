"""Incremental evaluation of expectations: batches of samples, and times, give events.

Samples are columns. It has no clock. Events do not depend on the division into batches. The state
of each kind of event is a few arrays, by number of the edge or authority. A batch costs a constant
number of numpy calls, and one more round of them for each jump of an edge's stamps within it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np
import numpy.typing as npt

from tfdb.data.decimal_time import NS_PER_SECOND as NS
from tfdb.data.errors import InvalidArray

from .events import ANOTHER_CLOCK, CLOCKS, EVENT_KINDS, Event
from .expectations import (
    edge_limits,
    expected_authorities,
    limits_of_authority,
    matches,
)
from .motion import angle, length

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

    from .events import Severity
    from .expectations import Expectation, Expectations

Integers: TypeAlias = npt.NDArray[np.int64]
Floats: TypeAlias = npt.NDArray[np.float64]
Flags: TypeAlias = npt.NDArray[np.bool_]

_Key = TypeVar("_Key")

NEVER = 2**62
"""Later than all times; two of it do not overflow."""
SETTLE = NS
"""Samples that break a limit are one event until there was none for so long."""
JUMP = NS
"""Stamps that move by more than this against the arrivals jump."""
PATIENCE = NS
"""How long an expected edge may be missing at first, or its deadline if that is longer."""
_KINDS = list(EVENT_KINDS)
_SILENCES = ("missing", "deadline", "lifespan", "liveliness")


@dataclass(frozen=True)
class Rows:
    """Samples in order of arrival, as columns; a judge numbers edges and authorities."""

    arrivals: Integers
    """Nanoseconds, not decreasing."""
    edges: Integers
    """From `Judge.number_edges`."""
    authorities: Integers
    """From `Judge.number_authorities`."""
    stamps: Integers
    """Nanoseconds; unused for static samples."""
    poses: Floats
    """(N, 7)."""
    static: Flags
    commits: Integers | None = None
    """The commit of each sample; None: from a recording."""

    def __len__(self) -> int:
        return len(self.arrivals)

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
        """Return the rows of several batches, without commits."""
        names = ("arrivals", "edges", "authorities", "stamps", "poses", "static")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def at(self, rows: Integers | Flags | slice) -> Rows:
        """Only some rows."""
        return Rows(
            self.arrivals[rows],
            self.edges[rows],
            self.authorities[rows],
            self.stamps[rows],
            self.poses[rows],
            self.static[rows],
            None if self.commits is None else self.commits[rows],
        )


class Groups:
    """Rows sorted by subject; the order within a subject stays."""

    def __init__(self, subjects: Integers, rows: Integers) -> None:
        self.subjects = subjects
        self.rows = rows
        """Numbers of the rows in the batch."""
        self.starts: Flags = np.ones(len(rows), dtype=bool)
        self.starts[1:] = subjects[1:] != subjects[:-1]
        self.lasts: Flags = np.ones(len(rows), dtype=bool)
        self.lasts[:-1] = self.starts[1:]

    @classmethod
    def of(cls, subjects: Integers) -> Groups:
        """Sort all rows of a batch."""
        if (subjects[1:] >= subjects[:-1]).all():
            return cls(subjects, np.arange(len(subjects)))
        order = np.argsort(subjects, kind="stable")
        return cls(subjects[order], order)

    def only(self, chosen: Flags) -> Groups:
        """Only some rows."""
        return Groups(self.subjects[chosen], self.rows[chosen])

    def before(self, values: npt.NDArray[Any], state: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return for each row the value of its subject's previous row, or of the state."""
        found = np.empty_like(values)
        found[1:] = values[:-1]
        found[self.starts] = state[self.subjects[self.starts]]
        return found

    def greatest(self, values: Integers, state: Integers) -> Integers:
        """Return for each row the greatest value of its subject so far."""
        values = values.copy()
        values[self.starts] = np.maximum(values[self.starts], state[self.subjects[self.starts]])
        falls = values[1:] < values[:-1]
        falls &= ~self.starts[1:]
        if not falls.any():
            return values
        # A running maximum of ranks, which start higher in each group.
        order = np.argsort(values, kind="stable")
        ranks = np.empty_like(order)
        ranks[order] = np.arange(len(order))
        base = (np.cumsum(self.starts) - 1) * len(order)
        found: Integers = values[order][np.maximum.accumulate(ranks + base) - base]
        return found


class _Kind:
    """One kind of event, of all its subjects: edges, authorities or the clock.

    A silence breaks the expectation at its due time. A sample breaks it at once, and it is met
    again at the due time.
    """

    def __init__(self, name: str) -> None:
        self.name, self.place = name, _KINDS.index(name)
        self.silence = name in _SILENCES
        self.judged = False
        """Whether any subject has a limit."""
        self.limits = np.zeros(0)
        """As events have them; NaN: not judged."""
        self.lengths = np.zeros(0, dtype=np.int64)
        """Those of silences in nanoseconds; NEVER: not judged."""
        self.due = np.zeros(0, dtype=np.int64)
        self.broken = np.zeros(0, dtype=bool)
        self.counts = np.zeros(0, dtype=np.int64)
        self.worst = np.zeros(0)

    def add(self, limits: Sequence[float | None], begun: Sequence[bool], start: int) -> None:
        """Add subjects; active ones are due from the start."""
        new = np.array([np.nan if limit is None else limit for limit in limits], dtype=np.float64)
        free = np.isnan(new)
        lengths = np.where(free, NEVER, np.rint(np.where(free, 0, new) * NS)).astype(np.int64)
        due = np.where(np.array(begun, dtype=bool) & ~free, lengths + start, NEVER)
        self.limits = np.concatenate([self.limits, new])
        self.lengths = np.concatenate([self.lengths, lengths])
        self.due = np.concatenate([self.due, due])
        self.broken = np.concatenate([self.broken, np.zeros(len(new), dtype=bool)])
        self.counts = np.concatenate([self.counts, np.zeros(len(new), dtype=np.int64)])
        self.worst = np.concatenate([self.worst, np.zeros(len(new))])
        self.judged = self.judged or not free.all()

    def change(self, limits: Sequence[float | None], since: Integers, now: int) -> list[int]:
        """Set the subjects' limits; return the subjects whose limit changed.

        Their silences count from `since`; NEVER: not yet.
        """
        new = _Kind(self.name)
        new.add(limits, [False] * len(limits), now)
        changed = new.limits != self.limits
        changed &= ~(np.isnan(new.limits) & np.isnan(self.limits))
        self.due[changed] = NEVER
        self.broken[changed] = False
        waits = changed & (since < NEVER) & (new.lengths < NEVER) & self.silence
        self.due[waits] = np.maximum(new.lengths[waits] + since[waits], now)
        self.limits, self.lengths, self.judged = new.limits, new.lengths, new.judged
        return np.flatnonzero(changed).tolist()


@dataclass(frozen=True, slots=True)
class _Draft:
    """An event before it is counted."""

    kind: _Kind
    subject: int
    time: int
    value: float
    row: int | None = None
    """The row that began or ended it; None: the time did."""
    count: int | None = None
    """Number of samples that broke the limit so far."""
    begins: bool = field(kw_only=True)

    @property
    def key(self) -> tuple[int, bool, int, int, int]:
        """The order of events: those of a time come after those of its rows."""
        row = -1 if self.row is None else self.row
        return self.time, self.row is None, row, self.kind.place, self.subject


class Judge:
    """Evaluates expectations of edges and authorities incrementally. Threads: one.

    Parameters
    ----------
    expectations
        What is expected.
    start
        When it begins to wait for edges and authorities, nanoseconds of the clock of arrivals.
    """

    def __init__(self, expectations: Expectations, start: int) -> None:
        self._expectations, self._limits = expectations, edge_limits(expectations)
        self._by_stamps = expectations.clock == "stamps"
        self._now = start
        self.active: dict[tuple[str, int], Event] = {}
        """The events that have begun and not ended, by kind and number of the subject."""
        self.edges: dict[tuple[str, str], int] = {}
        """Numbers of edges, by parent and child."""
        self.authorities: dict[str, int] = {}
        """Numbers of authorities, by name."""
        self.edge_names: list[tuple[str, str]] = []
        self.authority_names: list[str] = []
        self._severities: dict[str, list[Mapping[str, Severity]]] = {
            "edge": [],
            "authority": [],
            "clock": [expectations.default.severity],
        }
        self._kinds = {name: _Kind(name) for name in _KINDS}
        for name, limit in (("two-clocks", ANOTHER_CLOCK), ("time-jump", JUMP)):
            self._kinds[name].add([limit / NS], [False], start)
        self._lists: dict[tuple[str, ...], int] = {(): 0}
        self._list_of = np.zeros(0, dtype=np.int64)
        """By edge: the number of the list of its authorities."""
        self._ranks = np.zeros((1, 0), dtype=np.int64)
        """By list and authority: 0 for the strongest or an unknown one, -1 for a foreign one."""
        self._seen = np.zeros(0, dtype=bool)
        """By edge: whether it has had a sample."""
        self._newest = np.zeros(0, dtype=np.int64)
        """By edge: the newest stamp; -1: none."""
        self._ahead = np.zeros(0, dtype=np.int64)
        """By edge: how far stamps came to lie ahead of their arrival."""
        self._skew = np.zeros(0, dtype=np.int64)
        """By edge: how far the stamps have jumped in all."""
        self._fresh = np.zeros(0, dtype=np.int64)
        """By edge: the arrival of the newest stamp."""
        self._far = np.zeros((2, 0), dtype=np.int64)
        """By edge: how far behind the last sample and the one before are, where that is far."""
        self._poses = np.zeros((0, 7))
        """By edge: the pose of the newest stamp."""
        self._wait_for_expected(start)

    def number_edges(self, parents: Sequence[str], children: Sequence[str]) -> Integers:
        """Return the numbers of edges; new ones are evaluated from now on."""
        return _numbers(self.edges, lambda: zip(parents, children, strict=True), self._add_edges)

    def number_authorities(self, names: Sequence[str]) -> Integers:
        """Return the numbers of authorities; an empty name is an unknown one."""
        return _numbers(self.authorities, lambda: names, self._add_authorities)

    def feed(self, rows: Rows, doubt: int = 0) -> list[Event]:
        """Evaluate samples, and the time until the last of them.

        They may have arrived that many nanoseconds later than the rows state, so the next ones
        are due later.
        """
        if not len(rows):
            return []
        if (np.diff(rows.arrivals) < 0).any():
            raise InvalidArray("arrivals decrease within a batch; sort the rows by arrival")
        still = rows.static
        if np.isin(rows.edges[still], rows.edges[~still]).any():  # an edge changes its kind
            cuts = [0, *(np.flatnonzero(still[1:] != still[:-1]) + 1), len(rows)]
            parts = [rows.at(slice(*cut)) for cut in pairwise(cuts)]
            return [event for part in parts for event in self.feed(part, doubt)]
        drafts = self._go_back(int(rows.arrivals[0]))
        self._seen[rows.edges] = True
        groups = Groups.of(rows.edges)
        kinds = self._kinds
        if (kinds["missing"].due < NEVER).any():
            due = np.full(len(rows), NEVER)
            drafts += _silences(kinds["missing"], groups, rows.arrivals, due)
        if len(self._lists) > 1:
            ranks = self._ranks[self._list_of[groups.subjects], rows.authorities[groups.rows]]
            for name, bad in (("foreign-authority", ranks < 0), ("failover", ranks > 0)):
                values = np.full(int(bad.sum()), np.nan)
                drafts += _samples(kinds[name], groups.only(bad), rows.arrivals, values)
        if kinds["liveliness"].judged:
            writers = Groups.of(rows.authorities)
            drafts += _repeating(kinds["liveliness"], writers, rows.arrivals, doubt)
        if still.any():
            drafts += self._judge_static(rows, groups.only(still[groups.rows]))
            groups = groups.only(~still[groups.rows])
        if kinds["deadline"].judged:
            drafts += _repeating(kinds["deadline"], groups, rows.arrivals, doubt)
        drafts += self._judge_motion(rows, groups)
        return self._finish(drafts, int(rows.arrivals[-1]), rows)

    def feed_held(self, rows: Rows, doubt: int = 0) -> list[Event]:
        """Evaluate existing samples of a store, as if they arrived now.

        They do not count as late: their stamps may have been on time when they arrived.
        """
        events = self.feed(rows, doubt)
        self._ahead[rows.edges] = np.maximum(self._ahead[rows.edges], 0)
        return events

    def advance(self, now: int) -> list[Event]:
        """Evaluate the time until now, nanoseconds: report missing samples."""
        return self._finish(self._go_back(now), now, None)

    def set_ahead(self, now: int, by: int) -> list[Event]:
        """Evaluate the time until the clock was set ahead by that many nanoseconds, to `now`.

        That time did not pass, so all due times move by as much.
        """
        events = self.advance(now - by)
        return events + self._finish(self._set_clock(now), now, None)

    def earliest_arrivals(self, rows: Rows, first: int, last: int) -> Integers:
        """Return the earliest arrivals of samples, between `first` and `last`.

        No sample arrived sooner after its stamp than earlier ones.
        """
        ahead = self._ahead[rows.edges]
        times = rows.stamps - np.where(ahead == -NEVER, 0, ahead)
        found: Integers = np.maximum.accumulate(np.where(rows.static, 0, times))
        return found.clip(first, last)

    def forget(self, frames: Collection[str]) -> None:
        """Forget the samples of frames whose edges were cleared: their stamps may restart."""
        if not frames:
            return
        chosen = [number for (_, child), number in self.edges.items() if child in frames]
        self._begin_anew(np.array(chosen, dtype=np.int64))

    def _begin_anew(self, chosen: Integers) -> None:
        self._newest[chosen] = -1
        self._ahead[chosen] = -NEVER
        self._skew[chosen] = 0
        self._far[:, chosen] = 0

    def change(self, expectations: Expectations, start: int) -> None:
        """Replace the expectations, of the same clock; new ones count from `start`.

        Unchanged expectations keep their state. If a limit changes or is removed, its active
        event is dropped.
        """
        self._expectations, self._limits = expectations, edge_limits(expectations)
        self._severities = {"edge": [], "authority": [], "clock": [expectations.default.severity]}
        exact = {(each.parent, each.child) for each in expectations.edges if each.is_exact}
        found = [self._limits(*pair) for pair in self.edge_names]
        begun = [pair in exact for pair in self.edge_names]
        self._lists = {(): 0}
        self._list_of = self._number_lists(found)
        now, moves = np.full(len(found), start), self._newest >= 0
        born = self._newest - self._skew if self._by_stamps else now
        known = moves & (np.abs(born - start) <= ANOTHER_CLOCK)
        since = {
            "missing": np.where(self._seen, NEVER, now),
            "deadline": np.where(moves, now, NEVER),
            "lifespan": np.where(known, born, NEVER),
        }
        for name, limits in _limits_of_edges(found, begun).items():
            self._change(name, limits, since.get(name, now), start)
        alive = self._limits_of_authorities(self.authority_names)
        self._change("liveliness", alive, np.full(len(alive), start), start)
        self._wait_for_expected(start)

    def next_due(self) -> int | None:
        """Return the last time before the next event if no sample arrives.

        None: nothing is due.
        """
        judged = (kind for kind in self._kinds.values() if len(kind.due))
        due = min(int(k.due[k.broken != k.silence].min(initial=NEVER)) for k in judged)
        return None if due == NEVER else due

    def _change(
        self, name: str, limits: Sequence[float | None], since: Integers, start: int
    ) -> None:
        for subject in self._kinds[name].change(limits, since, start):
            self.active.pop((name, subject), None)

    def _wait_for_expected(self, start: int) -> None:
        """Expect the named edges and authorities that have not appeared yet."""
        edges = [(each.parent, each.child) for each in self._expectations.edges if each.is_exact]
        self._add_edges([each for each in edges if each not in self.edges], start)
        names = expected_authorities(self._expectations)
        self._add_authorities([each for each in names if each not in self.authorities], start)

    def _add_edges(self, pairs: Sequence[tuple[str, str]], start: int | None = None) -> None:
        found = [self._limits(*pair) for pair in pairs]
        for pair in pairs:
            self.edges[pair] = len(self.edge_names)
            self.edge_names.append(pair)
        self._list_of = np.concatenate([self._list_of, self._number_lists(found)])
        for name, limits in _limits_of_edges(found, [start is not None] * len(found)).items():
            self._kinds[name].add(limits, [name == "missing"] * len(found), start or 0)
        added = len(found)
        self._seen = np.concatenate([self._seen, np.zeros(added, dtype=bool)])
        self._newest = np.concatenate([self._newest, np.full(added, -1)])
        self._ahead = np.concatenate([self._ahead, np.full(added, -NEVER)])
        self._skew = np.concatenate([self._skew, np.zeros(added, dtype=np.int64)])
        self._fresh = np.concatenate([self._fresh, np.zeros(added, dtype=np.int64)])
        self._far = np.concatenate([self._far, np.zeros((2, added), dtype=np.int64)], axis=1)
        self._poses = np.concatenate([self._poses, np.zeros((added, 7))])

    def _add_authorities(self, names: Sequence[str], start: int | None = None) -> None:
        limits = self._limits_of_authorities(names)
        for name in names:
            self.authorities[name] = len(self.authority_names)
            self.authority_names.append(name)
        self._rank()
        begun = [start is not None] * len(names)
        self._kinds["liveliness"].add(limits, begun, start or 0)

    def _limits_of_authorities(self, names: Sequence[str]) -> list[float | None]:
        """Return their liveliness, and note their severities."""
        found = [limits_of_authority(self._expectations, name) if name else None for name in names]
        self._severities["authority"] += [each.severity if each else {} for each in found]
        return [each.liveliness if each else None for each in found]

    def _number_lists(self, found: Sequence[Expectation]) -> Integers:
        """Number the lists of authorities of edges, and note their severities."""
        for each in found:
            self._lists.setdefault(tuple(each.authority), len(self._lists))
        self._rank()
        self._severities["edge"] += [each.severity for each in found]
        return np.array([self._lists[tuple(each.authority)] for each in found], dtype=np.int64)

    def _rank(self) -> None:
        """Number the authorities of each list by strength."""
        lists = (list_ for list_, _ in sorted(self._lists.items(), key=lambda each: each[1]))
        self._ranks = np.array(
            [[_rank_in(list_, name) for name in self.authority_names] for list_ in lists],
            dtype=np.int64,
        ).reshape(len(self._lists), len(self.authority_names))

    def _go_back(self, now: int) -> list[_Draft]:
        return self._set_clock(now) if now < self._now else []

    def _set_clock(self, now: int) -> list[_Draft]:
        """Move all due times when the clock is set: a time jump."""
        moved = now - self._now
        for kind in self._kinds.values():
            kind.due = np.where(kind.due < NEVER, kind.due + moved, NEVER)
        self._fresh += moved
        self._now = now
        if abs(moved) <= JUMP:
            return []
        clock = Groups(np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64))
        kind, times = self._kinds["time-jump"], np.array([now])
        drafts = _samples(kind, clock, times, np.array([abs(moved) / NS]))
        return [replace(draft, row=None) for draft in drafts]

    def _judge_static(self, rows: Rows, groups: Groups) -> list[_Draft]:
        """End events of moving edges that became static: no sample is due."""
        drafts: list[_Draft] = []
        for kind in (self._kinds["deadline"], self._kinds["lifespan"]):
            if kind.judged:
                due = np.full(len(groups.rows), NEVER)
                drafts += _silences(kind, groups, rows.arrivals, due)
        self._begin_anew(groups.subjects)
        return drafts

    def _judge_motion(self, rows: Rows, groups: Groups) -> list[_Draft]:
        """Evaluate stamps and poses of moving samples."""
        drafts: list[_Draft] = []
        if self._by_stamps:
            order = np.sort(groups.rows)
            away = np.abs(rows.stamps[order] - rows.arrivals[order])
            off = away > ANOTHER_CLOCK
            clock = Groups(np.zeros(int(off.sum()), dtype=np.int64), order[off])
            drafts += _samples(self._kinds["two-clocks"], clock, rows.arrivals, away[off] / NS)
        jumps = np.zeros(len(rows))
        while len(groups.rows):
            groups = self._judge_stretch(rows, groups, jumps, drafts)
        at = np.flatnonzero(jumps)
        clock = Groups(np.zeros(len(at), dtype=np.int64), at)
        drafts += _samples(self._kinds["time-jump"], clock, rows.arrivals, jumps[at])
        return drafts

    def _judge_stretch(
        self, rows: Rows, groups: Groups, jumps: Floats, drafts: list[_Draft]
    ) -> Groups:
        """Evaluate each edge up to its first jump of stamps; return the rows after the jumps."""
        stamps, arrivals = rows.stamps[groups.rows], rows.arrivals[groups.rows]
        newest = groups.greatest(stamps, self._newest)
        before = groups.before(newest, self._newest)
        lead = stamps - arrivals
        ahead = groups.greatest(lead, self._ahead)
        known = before >= 0
        behind = np.where(known, before - stamps, 0)
        far = np.where(behind > JUMP, behind, 0)
        far_before = groups.before(far, self._far[0])
        far_second = groups.before(far_before, self._far[1])
        jump = (far > 0) & (far_before > 0) & (far_second > 0)
        if self._by_stamps:
            jump |= known & (lead - JUMP > groups.before(ahead, self._ahead))
        earlier: Integers = np.cumsum(jump) - jump
        index = np.cumsum(groups.starts) - 1
        after: Flags = earlier > earlier[groups.starts][index]
        if after.any():
            self._judge_stretch(rows, groups.only(~after), jumps, drafts)
            return groups.only(after)

        skew = np.where(jump, lead - groups.before(ahead, self._ahead), 0)
        jumps[groups.rows[jump]] = np.maximum(np.abs(skew), behind)[jump] / NS
        fresh = (stamps > before) & ~jump
        pending = np.where(far_before > 0, np.maximum(far_before, far_second), 0)
        late = np.where((far > 0) | jump, 0, np.maximum(behind, pending)) / NS
        self._limit("late", rows, groups, late, drafts)
        self._judge_poses(rows, groups.only(fresh), before[fresh], drafts)
        kind = self._kinds["lifespan"]
        if kind.judged:
            # A jump of the stamps does not change ages, so it is one event only.
            jumping = jump | (far > 0)
            arrived = groups.greatest(np.where(fresh | jump, arrivals, 0), self._fresh)
            base = np.where(jumping, arrivals, arrived)
            if self._by_stamps:
                usual = arrivals + groups.before(ahead, self._ahead)
                base = np.where(jumping, usual, newest) - self._skew[groups.subjects]
            due = np.minimum(base, NEVER - 1) + kind.lengths[groups.subjects]
            due[np.abs(base - arrivals) > ANOTHER_CLOCK] = NEVER
            for _ in range(2):  # samples far in the past, which end no event; the third is a jump
                due_before = groups.before(due, kind.due)
                due = np.where((far > 0) & ~jump & (arrivals > due_before), due_before, due)
            drafts += _silences(kind, groups, rows.arrivals, due)
            self._fresh[groups.subjects[groups.lasts]] = arrived[groups.lasts]
        subjects = groups.subjects[groups.lasts]
        newest, ahead = np.where(jump, stamps, newest), np.where(jump, lead, ahead)
        self._skew[subjects] += skew[groups.lasts]
        self._newest[subjects] = newest[groups.lasts]
        self._ahead[subjects] = ahead[groups.lasts]
        self._far[0, subjects] = np.where(jump, 0, far)[groups.lasts]
        self._far[1, subjects] = far_before[groups.lasts]
        kept = groups.only(fresh | jump)
        self._poses[kept.subjects[kept.lasts]] = rows.poses[kept.rows[kept.lasts]]
        return groups.only(after)

    def _judge_poses(
        self, rows: Rows, groups: Groups, before: Integers, drafts: list[_Draft]
    ) -> None:
        """Compare each new pose with that of the newest stamp before it."""
        kinds = self._kinds
        if not (kinds["step"].judged or kinds["speed"].judged or kinds["turn"].judged):
            return
        poses = rows.poses[groups.rows]
        others = groups.before(poses, self._poses)
        known = before >= 0
        way = np.where(known, length(poses[:, :3] - others[:, :3]), 0)
        seconds = (rows.stamps[groups.rows] - before) / NS
        turn = np.where(known, angle(poses, others), 0)
        self._limit("step", rows, groups, way, drafts)
        self._limit("speed", rows, groups, way / seconds, drafts)
        self._limit("turn", rows, groups, turn, drafts)

    def _limit(
        self, name: str, rows: Rows, groups: Groups, values: Floats, drafts: list[_Draft]
    ) -> None:
        """Report the rows with values over the limits of their edges."""
        kind = self._kinds[name]
        if kind.judged:
            bad = values > kind.limits[groups.subjects]
            drafts += _samples(kind, groups.only(bad), rows.arrivals, values[bad])

    def _finish(self, drafts: list[_Draft], now: int, rows: Rows | None) -> list[Event]:
        """Report due silences, and return the events in order."""
        self._now = max(self._now, now)
        for kind in self._kinds.values():
            passed = kind.due < self._now
            passed &= kind.broken != kind.silence
            for subject in np.flatnonzero(passed).tolist():
                kind.broken[subject] = kind.silence
                value = kind.limits[subject] if kind.silence else kind.worst[subject]
                kind.worst[subject] = value
                count = None if kind.silence else int(kind.counts[subject])
                due = int(kind.due[subject])
                drafts.append(_Draft(kind, subject, due, value, None, count, begins=kind.silence))
        drafts.sort(key=lambda draft: draft.key)
        return [self._event(draft, rows) for draft in drafts]

    def _event(self, draft: _Draft, rows: Rows | None) -> Event:
        kind, subject = draft.kind, draft.subject
        key, row = (kind.name, subject), draft.row
        of = "clock" if kind.name in CLOCKS else "edge"
        of = "authority" if kind.name == "liveliness" else of
        began = self.active.pop(key, None)
        parent, child, authority = "", "", ""
        if of == "edge":
            parent, child = self.edge_names[subject]
        elif of == "authority":
            authority = self.authority_names[subject]
        if began is not None:
            parent, child, authority = began.parent, began.child, began.authority
        elif row is not None and rows is not None and not kind.silence:
            parent, child = self.edge_names[int(rows.edges[row])]
            authority = self.authority_names[int(rows.authorities[row])]
        commits = None if rows is None or row is None else rows.commits
        if draft.begins and kind.silence:
            kind.counts[subject] += 1
        usual = EVENT_KINDS[kind.name][0]
        given = self._severities[of][subject].get(kind.name, usual)
        limit, value = float(kind.limits[subject]), float(draft.value)
        event = Event(
            kind.name,
            given if draft.begins else "ok",
            draft.begins,
            draft.time,
            draft.time if began is None else began.since,
            parent,
            child,
            authority,
            None if np.isnan(value) else value,
            None if np.isnan(limit) else limit,
            int(kind.counts[subject]) if draft.count is None else draft.count,
            None if commits is None else int(commits[row]),
        )
        if draft.begins:
            self.active[key] = event
        return event


def _limits_of_edges(
    found: Sequence[Expectation], begun: Sequence[bool]
) -> dict[str, list[float | None]]:
    """Return the limits of edges by kind; an inactive edge cannot be missing."""
    least = PATIENCE / NS
    return {
        "missing": [
            max(each.deadline or 0, least) if waits else None
            for each, waits in zip(found, begun, strict=True)
        ],
        "deadline": [each.deadline for each in found],
        "lifespan": [each.lifespan for each in found],
        "step": [each.max_step for each in found],
        "speed": [each.max_speed for each in found],
        "turn": [each.max_turn for each in found],
        "late": [each.max_late for each in found],
        "foreign-authority": [None] * len(found),
        "failover": [None] * len(found),
    }


def _numbers(
    known: Mapping[_Key, int], keys: Callable[[], Iterable[_Key]], add: Callable[[list[_Key]], None]
) -> Integers:
    """Return the numbers of keys; add those that are new."""
    try:
        return np.fromiter(map(known.__getitem__, keys()), np.int64)
    except KeyError:
        add([key for key in dict.fromkeys(keys()) if key not in known])
    return np.fromiter(map(known.__getitem__, keys()), np.int64)


def _rank_in(names: tuple[str, ...], name: str) -> int:
    """Return the place of an authority in a list; 0 for an unknown one, -1 for a foreign one."""
    if not names or not name:
        return 0
    return next((place for place, each in enumerate(names) if matches(each, name)), -1)


def _repeating(kind: _Kind, groups: Groups, arrivals: Integers, doubt: int) -> list[_Draft]:
    """Report silences between rows."""
    due = arrivals[groups.rows] + doubt + kind.lengths[groups.subjects]
    return _silences(kind, groups, arrivals, due)


def _silences(kind: _Kind, groups: Groups, arrivals: Integers, due: Integers) -> list[_Draft]:
    """Report rows after their due time, and rows whose next one is already due."""
    times, subjects = arrivals[groups.rows], groups.subjects
    due_before = groups.before(due, kind.due)
    passed, broken = times > due_before, times > due
    reported = groups.before(broken, kind.broken)
    drafts: list[_Draft] = []
    kind.due[subjects[groups.lasts]] = due[groups.lasts]
    kind.broken[subjects[groups.lasts]] = broken[groups.lasts]
    if not (passed.any() or broken.any()):
        return drafts
    over = np.maximum(np.where(passed, times - due_before, 0), np.where(broken, times - due, 0))
    values = np.where(over > 0, kind.limits[subjects] + over / NS, 0)
    heads = np.flatnonzero(groups.starts | ~reported)
    worst = np.maximum.reduceat(values, heads)
    known = np.where(reported[heads], kind.worst[subjects[heads]], 0)
    worst = np.maximum(worst, known)[np.cumsum(groups.starts | ~reported) - 1]
    kind.worst[subjects[groups.lasts]] = worst[groups.lasts]
    for i in np.flatnonzero(passed & ~reported).tolist():
        subject = int(subjects[i])
        began = int(due_before[i])
        drafts.append(_Draft(kind, subject, began, kind.limits[subject], begins=True))
    for i in np.flatnonzero(passed != broken).tolist():
        subject, time, row = int(subjects[i]), int(times[i]), int(groups.rows[i])
        value = float(values[i] if broken[i] else worst[i])
        drafts.append(_Draft(kind, subject, time, value, row, begins=bool(broken[i])))
    return drafts


def _samples(kind: _Kind, groups: Groups, arrivals: Integers, values: Floats) -> list[_Draft]:
    """Report rows that break a limit, those with less than SETTLE between them as one event."""
    if not len(values):
        return []
    times, subjects = arrivals[groups.rows], groups.subjects
    due_before = groups.before(times + SETTLE, kind.due)
    open_before = groups.before(np.ones(len(times), dtype=bool), kind.broken)
    over = times > due_before
    begins = over | ~open_before
    places = np.arange(len(times))
    in_group = places - places[groups.starts][np.cumsum(groups.starts) - 1]
    counts = kind.counts[subjects] + in_group + 1
    heads = np.flatnonzero(begins | groups.starts)
    worst = np.maximum.reduceat(values, heads)
    goes_on = ~begins[heads]
    worst[goes_on] = np.fmax(worst[goes_on], kind.worst[subjects[heads[goes_on]]])
    worst = worst[np.searchsorted(heads, places, side="right") - 1]
    worst_before = groups.before(worst, kind.worst)
    counts_before = groups.before(counts, kind.counts)
    drafts = []
    for i in np.flatnonzero(over & open_before).tolist():
        known = int(due_before[i]), worst_before[i], None, int(counts_before[i])
        drafts.append(_Draft(kind, int(subjects[i]), *known, begins=False))
    for i in np.flatnonzero(begins).tolist():
        began = int(times[i]), values[i], int(groups.rows[i]), int(counts[i])
        drafts.append(_Draft(kind, int(subjects[i]), *began, begins=True))
    chosen = subjects[groups.lasts]
    kind.due[chosen] = times[groups.lasts] + SETTLE
    kind.broken[chosen] = True
    kind.counts[chosen] = counts[groups.lasts]
    kind.worst[chosen] = worst[groups.lasts]
    return drafts

"""A judge that loops over rows in plain Python, written from docs/howto/expectations.md."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from tfdb.judging.events import EVENT_KINDS
from tfdb.judging.expectations import edge_limits, expected_authorities, limits_of_authority

if TYPE_CHECKING:
    from tfdb.judging.expectations import Expectations

S = 10**9
KINDS = list(EVENT_KINDS)
SILENCES = ("missing", "deadline", "lifespan", "liveliness")


@dataclass
class Row:
    """One sample."""

    arrival: int
    edge: tuple[str, str]
    authority: str
    stamp: int
    pose: tuple[float, ...]
    static: bool = False


@dataclass
class Edge:
    """What is remembered of an edge."""

    newest: Row | None = None
    ahead: int = 0
    far: list[int] = field(default_factory=list)
    skew: int = 0
    arrived: int = 0


class NaiveJudge:
    """Gives events as tuples (time, kind, begins, subject, value, count)."""

    def __init__(self, expectations: Expectations, start: int) -> None:
        self.expectations, self.now = expectations, start
        self.subjects: list[Any] = []
        self.edges: dict[tuple[str, str], Edge] = {}
        self.due: dict[tuple[str, Any], tuple[int, float]] = {}
        self.samples: dict[tuple[str, Any], list[float]] = {}
        self.broken: set[tuple[str, Any]] = set()
        self.counts: dict[tuple[str, Any], int] = {}
        self.worst: dict[tuple[str, Any], float] = {}
        self.events: list[tuple[Any, ...]] = []
        for each in expectations.edges:
            if each.is_exact:
                edge = each.parent, each.child
                self.subjects.append(edge)
                limit = edge_limits(expectations)(*edge).deadline or 0
                limit = max(limit, 1.0)
                self.due["missing", edge] = start + round(limit * S), limit
        for name in expected_authorities(expectations):
            self.subjects.append(name)
            alive = limits_of_authority(expectations, name)
            assert alive is not None
            due = start + round(alive.liveliness * S)
            self.due["liveliness", name] = due, alive.liveliness

    def advance(self, now: int) -> None:
        """Let time pass."""
        back = self.now - now
        if back > 0:
            self.due = {key: (due - back, limit) for key, (due, limit) in self.due.items()}
            for edge in self.edges.values():
                edge.arrived -= back
            self.now = now
            if back > S:
                self.bad("time-jump", "clock", now, back / S)
        passed = [
            (due, KINDS.index(kind), self.place(subject), kind, subject)
            for (kind, subject), (due, _) in self.due.items()
            if due < now
        ]
        for due, _, _, kind, subject in sorted(passed):
            key = kind, subject
            if kind in SILENCES:
                if key not in self.broken:
                    self.begin(key, due, self.due[key][1])
            else:
                del self.due[key]
                self.end(key, due, max(self.samples.pop(key)))
        self.now = now

    def place(self, subject: Any) -> int:
        """The order of subjects of one kind: as they came."""
        if subject == "clock":
            return 0
        return [each for each in self.subjects if type(each) is type(subject)].index(subject)

    def begin(self, key: tuple[str, Any], time: int, value: float) -> None:
        self.broken.add(key)
        if key[0] in SILENCES:
            self.counts[key] = self.counts.get(key, 0) + 1
            self.worst[key] = value
        self.events.append((time, key[0], True, key[1], value, self.counts[key]))

    def end(self, key: tuple[str, Any], time: int, value: float) -> None:
        self.broken.remove(key)
        value = max(value, self.worst.pop(key, value))
        self.events.append((time, key[0], False, key[1], value, self.counts[key]))

    def bad(self, kind: str, subject: Any, time: int, value: float) -> None:
        """A sample breaks a limit, for one second at least."""
        key = kind, subject
        self.counts[key] = self.counts.get(key, 0) + 1
        self.samples.setdefault(key, []).append(value)
        self.due[key] = time + S, 0.0
        if key not in self.broken:
            self.begin(key, time, value)

    def again(self, kind: str, subject: Any, time: int, since: int, limit: float) -> None:
        """A row came: the silence counts anew since then."""
        key = kind, subject
        due, broken = since + round(limit * S), key in self.broken
        if broken:
            over = time - min(self.due[key][0], due)
            self.worst[key] = max(self.worst[key], limit + over / S)
        if broken and time <= due:
            self.end(key, time, limit + (time - self.due[key][0]) / S)
        elif not broken and time > due:
            self.begin(key, time, limit + (time - due) / S)
        self.due[key] = due, limit

    def feed(self, row: Row) -> None:
        """Judge one sample."""
        self.advance(row.arrival)
        for subject in (row.edge, row.authority):
            if subject not in self.subjects:
                self.subjects.append(subject)
        checks = sorted(self.check(row), key=lambda each: KINDS.index(each[0]))
        for kind, judge, *arguments in checks:
            judge(kind, *arguments)

    def check(self, row: Row) -> list[tuple[Any, ...]]:
        """All that a row bears on: kind, method and its arguments."""
        limits, t, found = edge_limits(self.expectations)(*row.edge), row.arrival, []
        if ("missing", row.edge) in self.broken:
            due, limit = self.due["missing", row.edge]
            found.append(("missing", self.met, row.edge, t, limit + (t - due) / S))
        self.due.pop(("missing", row.edge), None)
        if limits.authority and row.authority:
            if row.authority not in limits.authority:
                found.append(("foreign-authority", self.bad, row.edge, t, 0.0))
            elif row.authority != limits.authority[0]:
                found.append(("failover", self.bad, row.edge, t, 0.0))
        alive = limits_of_authority(self.expectations, row.authority) if row.authority else None
        if alive is not None:
            found.append(("liveliness", self.again, row.authority, t, t, alive.liveliness))
        if row.static:
            self.edges.pop(row.edge, None)
            for kind in ("deadline", "lifespan"):
                due, limit = self.due.pop((kind, row.edge), (0, 0.0))
                if (kind, row.edge) in self.broken:
                    found.append((kind, self.met, row.edge, t, limit + (t - due) / S))
            return found
        if limits.deadline:
            found.append(("deadline", self.again, row.edge, t, t, limits.deadline))
        if self.expectations.clock == "stamps" and abs(row.stamp - t) > 3600 * S:
            found.append(("two-clocks", self.bad, "clock", t, abs(row.stamp - t) / S))
        return found + self.check_motion(row, limits)

    def met(self, kind: str, subject: Any, time: int, value: float) -> None:
        self.end((kind, subject), time, value)

    def check_motion(self, row: Row, limits: Any) -> list[tuple[Any, ...]]:
        edge = self.edges.setdefault(row.edge, Edge())
        found: list[tuple[Any, ...]] = []
        before, t = edge.newest, row.arrival
        lead = row.stamp - t
        behind = 0 if before is None else before.stamp - row.stamp
        jumps = self.expectations.clock == "stamps" and before is not None
        jumps = jumps and lead > edge.ahead + S
        edge.far.append(behind if behind > S else 0)
        if all(edge.far[-3:]) and len(edge.far) >= 3:
            jumps = True
        jumping, usual, skew = jumps or behind > S, t + edge.ahead, edge.skew
        if jumps:
            edge.skew += lead - edge.ahead
            found.append(
                ("time-jump", self.bad, "clock", t, max(abs(lead - edge.ahead), behind) / S)
            )
            edge.far = []
        elif behind <= S:
            late = max(behind, *edge.far, 0)
            edge.far = []
            if limits.max_late and late / S > limits.max_late:
                found.append(("late", self.bad, row.edge, t, late / S))
        fresh = before is None or row.stamp > before.stamp
        if before is not None and fresh and not jumps:
            found += self.check_pose(row, before, limits)
        if fresh or jumps:
            edge.newest = Row(**vars(row))
        edge.ahead = lead if before is None or jumps else max(edge.ahead, lead)
        if limits.lifespan:
            edge.arrived = t if fresh or jumps else edge.arrived
            assert edge.newest is not None
            since = (usual if jumping else edge.newest.stamp) - skew
            if self.expectations.clock == "arrival":
                since = t if jumping else edge.arrived
            if behind > S and not jumps and ("lifespan", row.edge) in self.broken:
                return found
            if abs(since - t) <= 3600 * S:
                found.append(("lifespan", self.again, row.edge, t, since, limits.lifespan))
            else:
                key = "lifespan", row.edge
                if key in self.broken:
                    value = limits.lifespan + (t - self.due[key][0]) / S
                    found.append(("lifespan", self.met, row.edge, t, value))
                self.due.pop(key, None)
        return found

    def check_pose(self, row: Row, before: Row, limits: Any) -> list[tuple[Any, ...]]:
        way = math.dist(row.pose[:3], before.pose[:3])
        seconds = (row.stamp - before.stamp) / S
        same = abs(sum(a * b for a, b in zip(row.pose[3:], before.pose[3:], strict=True)))
        values = {"step": way, "speed": way / seconds, "turn": 2 * math.acos(min(same, 1.0))}
        return [
            (kind, self.bad, row.edge, row.arrival, value)
            for kind, value in values.items()
            if (limit := getattr(limits, f"max_{kind}")) and value > limit
        ]

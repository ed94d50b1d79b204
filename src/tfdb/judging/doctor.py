"""Finds faults of a recording from its transforms in order of arrival.

Pure functions over columns: `tfdb check` reads the file, this module finds the faults.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from tfdb.data.counting import counted
from tfdb.data.decimal_time import NS_PER_SECOND as NS
from tfdb.data.time_text import format_duration, format_ns, format_offset
from tfdb.store.summary import GAP_FACTOR, YEAR_NS, Clock, Gap, describe_clocks, find_gaps

from . import motion
from .events import EVENT_KINDS

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from tfdb.recordings.arrivals import RecordedArrivals

    from .judge import Judge, Rows

# kind -> (severity, what it means); the documentation lists the same.
KINDS = {
    "refused": ("error", "transforms or messages that the store refuses"),
    "two-clocks": ("error", "stamps of two clocks, such as a simulated and a real one"),
    "time-jump": ("error", "stamps that jump relative to the time of arrival"),
    "mixed-sources": (
        "error",
        "different transforms of one edge in several groups of topics or files",
    ),
    "two-publishers": ("error", "one edge written by several publishers"),
    "there-and-back": ("error", "poses that alternate between two places, as of two publishers"),
    "pose-jump": ("error", "poses that jump further than anything moves"),
    "static-and-moving": ("error", "one edge written as static and as moving"),
    "disconnected": ("error", "more than one tree"),
    "lost": ("error", "data of a damaged file that --salvage could not read"),
    "container": ("warning", "files that a recorder did not finish, or that were renamed"),
    "no-time": ("warning", "transforms without a timestamp"),
    "leading-slash": ("warning", "a frame that is written with and without a leading slash"),
    "ahead": ("warning", "stamps later than the time of arrival"),
    "quaternion": ("warning", "quaternions without unit length"),
    "reparented": ("warning", "a frame whose parent changes"),
    "repeated": ("warning", "several poses of one edge at one stamp"),
    "late": ("warning", "samples older than the newest one of their edge"),
    "gap": ("warning", "gaps in the samples of an edge"),
    "coverage": ("warning", "an edge that starts late or stops early"),
    "static-revised": ("warning", "a static edge whose pose changes"),
}
QUATERNION_TOLERANCE = 1e-4
"""Largest unreported difference of a quaternion's squared length from 1."""
AHEAD = NS // 10
"""Largest allowed lead of stamps over their arrival: clocks of two machines differ by less."""


@dataclass(frozen=True)
class Finding:
    """One fault: its frames, its first time (arrival or stamp), and its count."""

    kind: str
    frames: tuple[str, ...]
    message: str
    stamp: int | None = None
    count: int = 1
    details: dict[str, Any] = field(default_factory=dict)
    given: str | None = None
    """The severity, if it is not that of the kind."""

    @property
    def severity(self) -> str:
        """``error`` or ``warning``; for an expectation, its severity."""
        return self.given or KINDS[self.kind][0]


@dataclass(frozen=True)
class Hole:
    """One gap of an edge, the edge's usual period, and the publishers before and after the gap.

    Times are nanoseconds; the names are empty if the container does not name publishers.
    """

    frame: str
    parent: str
    gap: Gap
    period: int
    publisher_before: str
    publisher_after: str


@dataclass(frozen=True)
class Limits:
    """Limits in nanoseconds. `gap` None: five median periods of the edge."""

    gap: int | None = None
    jump: int = NS
    coverage: int = NS


@dataclass(frozen=True)
class Edge:
    """One child frame's transforms in the order of arrival, as columns."""

    name: str
    stamps: npt.NDArray[np.int64]
    arrivals: npt.NDArray[np.int64]
    poses: npt.NDArray[np.float64]
    parents: npt.NDArray[np.int64]
    publishers: npt.NDArray[np.int64]
    static: npt.NDArray[np.bool_]

    @property
    def moving(self) -> Edge:
        """Only the moving transforms."""
        return self._rows(~self.static)

    @property
    def fixed(self) -> Edge:
        """Only the static transforms."""
        return self._rows(self.static)

    def between(self, first: int, beyond: int) -> Edge:
        """Only the transforms with stamps from `first` on and before `beyond`."""
        return self._rows((self.stamps >= first) & (self.stamps < beyond))

    def _rows(self, kept: npt.NDArray[np.bool_] | npt.NDArray[np.int64]) -> Edge:
        if kept.dtype == bool and kept.all():
            return self
        return Edge(
            self.name,
            self.stamps[kept],
            self.arrivals[kept],
            self.poses[kept],
            self.parents[kept],
            self.publishers[kept],
            self.static[kept],
        )


class Log:
    """All transforms of a recording or of a store, edge by edge."""

    def __init__(self) -> None:
        self._ids: dict[str, int] = {}
        self.names: list[str] = []
        self.conflicts: Counter[tuple[str, bool]] = Counter()
        """Refused transforms of edges that are of the other kind, by child and whether static."""
        self._edges: list[Edge] = []

    @classmethod
    def of(cls, recorded: RecordedArrivals) -> Log:
        """Return the log of recorded arrivals."""
        log = cls()
        log.names = recorded.names
        log._ids = {name: number for number, name in enumerate(log.names)}
        log.conflicts.update(recorded.conflicts)
        for name, columns, static in recorded.edges:
            log._edges.append(Edge(name, *columns, np.frombuffer(static, dtype=bool)))
        return log

    @classmethod
    def of_rows(cls, rows: Rows, judge: Judge) -> Log:
        """Return the log of rows with the numbers of a judge."""
        log = cls()
        of_authorities = np.array([log._id(each) for each in judge.authority_names], dtype=np.int64)
        of_edges = np.array([log._id(parent) for parent, _ in judge.edge_names], dtype=np.int64)
        numbers: dict[str, int] = {}
        children = [numbers.setdefault(child, len(numbers)) for _, child in judge.edge_names]
        child_of = np.array(children, dtype=np.int64)[rows.edges]
        order = np.argsort(child_of, kind="stable")
        bounds = np.searchsorted(child_of[order], np.arange(len(numbers) + 1))
        for name, number in numbers.items():
            mine = rows.at(order[bounds[number] : bounds[number + 1]])
            if not len(mine):
                continue
            parents, publishers = of_edges[mine.edges], of_authorities[mine.authorities]
            columns = mine.stamps, mine.arrivals, mine.poses, parents, publishers, mine.static
            log._edges.append(Edge(name, *columns))
        return log

    def add_edge(
        self,
        name: str,
        stamps: npt.NDArray[np.int64],
        poses: npt.NDArray[np.float64],
        parents: Sequence[str],
        *,
        publisher: str,
        static: bool,
    ) -> None:
        """Add an edge whose transforms arrived at their stamps, a static one at 0."""
        rows = len(stamps)
        if static:
            stamps = np.zeros_like(stamps)
        ups = np.fromiter(map(self._id, parents), np.int64, rows)
        who = np.full(rows, self._id(publisher))
        self._edges.append(Edge(name, stamps, stamps, poses, ups, who, np.full(rows, static)))

    @property
    def count(self) -> int:
        """Number of transforms."""
        return sum(len(edge.stamps) for edge in self._edges)

    def _id(self, name: str) -> int:
        if name not in self._ids:
            self._ids[name] = len(self.names)
            self.names.append(name)
        return self._ids[name]

    def edges(self) -> Iterator[Edge]:
        """Return the edges by name."""
        yield from sorted(self._edges, key=lambda edge: edge.name)


def examine(log: Log, limits: Limits = Limits()) -> list[Finding]:
    """Find all faults of single edges."""
    edges = list(log.edges())
    moving = [edge.moving for edge in edges]
    parts = _by_clock([edge for edge in moving if len(edge.stamps)])
    found: list[Finding] = list(_two_clocks(parts))
    for edge in edges:
        found += _publishers(edge, log.names)
        found += _static_and_moving(edge, log.conflicts)
        found += _quaternions(edge)
        found += _revised(edge.fixed)
    for part in parts:
        found += _examine_clock(part, log.names, limits)
    return found


def _examine_clock(whole: Sequence[Edge], names: Sequence[str], limits: Limits) -> list[Finding]:
    """Find faults of moving edges with stamps of one clock."""
    start = min(int(edge.stamps.min()) for edge in whole)
    end = max(int(edge.stamps.max()) for edge in whole)
    jumps = {edge.name: jump_rows(edge, limits.jump) for edge in whole}
    found: list[Finding] = [*_jumps(whole, jumps), *_ahead(whole)]
    for edge in whole:
        # Each piece between two jumps is examined alone, because stamps may repeat after a jump.
        pieces = np.zeros(len(edge.stamps), dtype=np.int64)
        pieces[jumps[edge.name] + 1] = 1
        pieces = np.cumsum(pieces)
        found += _reparented(edge, names)
        found += _repeated(edge, pieces)
        found += _pose_jumps(edge, pieces)
        found += _turns(edge, pieces)
        found += _late(edge, pieces)
        found += _gaps(edge, pieces, limits.gap)
        found += _coverage(edge, start, end, limits)
    return found


def leading_slashes(frames: Sequence[str]) -> list[Finding]:
    """Report frames that messages name both `map` and `/map`."""
    return [
        Finding(
            "leading-slash",
            (name,),
            f"written as {name!r} and as {'/' + name!r}: one frame in tfdb; tf2 refuses the slash",
        )
        for name in sorted(frames)
    ]


def disconnected(roots: Sequence[tuple[str, int]]) -> list[Finding]:
    """Report the roots if there are several, each with the number of frames of its tree."""
    if len(roots) < 2:
        return []
    listed = ", ".join(f"{name} ({count} frame{'s'[: count != 1]})" for name, count in roots)
    message = f"{len(roots)} trees without a connection, with the roots {listed}"
    return [Finding("disconnected", tuple(name for name, _ in roots), message, count=len(roots))]


def sort_key(finding: Finding) -> tuple[int, tuple[str, ...], int]:
    """Sort by kind as listed in KINDS, then expectations; by frame and by time."""
    kinds = [*KINDS, *EVENT_KINDS]
    return kinds.index(finding.kind), finding.frames, finding.stamp or 0


def _by_clock(edges: Sequence[Edge]) -> list[list[Edge]]:
    """Group the moving edges by clock, the earliest first; each group is examined separately."""
    if not edges:
        return []
    stamps = np.sort(np.concatenate([edge.stamps for edge in edges]))
    firsts = [int(stamps[0]), *stamps[1:][np.diff(stamps) > YEAR_NS].tolist()]
    parts = []
    for first, beyond in zip(firsts, [*firsts[1:], int(stamps[-1]) + 1], strict=True):
        rows = [edge.between(first, beyond) for edge in edges]
        parts.append([edge for edge in rows if len(edge.stamps)])
    return parts


def _two_clocks(parts: Sequence[Sequence[Edge]]) -> Iterator[Finding]:
    found = [
        Clock(
            min(int(edge.stamps.min()) for edge in part),
            max(int(edge.stamps.max()) for edge in part),
            tuple(edge.name for edge in part),
        )
        for part in parts
    ]
    message = describe_clocks(found)
    if message:
        fewest = min(found, key=lambda clock: len(clock.frames))
        yield Finding("two-clocks", fewest.frames, message, fewest.start, len(found))


def jump_rows(edge: Edge, limit: int) -> npt.NDArray[np.int64]:
    """Find the rows after which the stamps jump and the arrival times do not.

    A step back is a jump unless the stamps return at once, as after a late sample. A step forward
    is a jump if the stamps are further ahead of arrival than ever since the last jump. A stalled
    delivery is not a jump: the stamps fall behind and catch up.
    """
    steps = np.diff(edge.stamps)
    moved = steps - np.rint(np.diff(edge.arrivals) * _pace(edge)).astype(np.int64)
    ahead = np.concatenate([[0], np.cumsum(moved)])
    rows: list[int] = []
    most, seen = 0, 0
    for row in np.flatnonzero(np.abs(moved) > limit).tolist():
        most = max(most, int(ahead[seen : row + 1].max()))
        seen = row + 1
        back = steps[row] < 0 and ahead[row + 1 : row + 4].max() < ahead[row] - limit
        if back or ahead[row + 1] > most + limit:
            rows.append(row)
            most = int(ahead[row + 1])
    return np.array(rows, dtype=np.int64)


def _pace(edge: Edge) -> float:
    """Return the rate of the stamps relative to arrival: 1, or the speed of a simulation.

    It is measured over a tenth of the whole time, because samples may arrive in bursts or
    alternate between two publishers.
    """
    stamps, arrivals = edge.stamps, edge.arrivals
    later = np.searchsorted(arrivals, arrivals + max(1, (arrivals[-1] - arrivals[0]) // 10))
    first = np.flatnonzero(later < len(arrivals))
    if len(first) < 10:
        return 1.0
    last = later[first]
    pace = float(np.median((stamps[last] - stamps[first]) / (arrivals[last] - arrivals[first])))
    return 1.0 if 0.9 < pace < 1.1 or pace <= 0 else pace


def _jumps(edges: Sequence[Edge], rows: Mapping[str, npt.NDArray[np.int64]]) -> Iterator[Finding]:
    """Report the jumps; edges that jump at the same times share a finding."""
    groups: dict[tuple[tuple[int, bool], ...], list[Edge]] = defaultdict(list)
    for edge in edges:
        at = rows[edge.name]
        forth = edge.stamps[at + 1] > edge.stamps[at]
        key = tuple(zip(edge.arrivals[at + 1].tolist(), forth.tolist(), strict=True))
        if key:
            groups[key].append(edge)
    for members in groups.values():
        edge = members[0]
        at = rows[edge.name]
        steps = edge.stamps[at + 1] - edge.stamps[at]
        before, step = int(edge.stamps[at[0]]), int(steps[0])
        arrival = int(edge.arrivals[at[0] + 1])
        times = "" if len(at) == 1 else f" {_times(len(at))}, first"
        message = (
            f"the stamps of {counted(len(members), 'edge')} jump{times} from {format_ns(before)} "
            f"to {format_ns(before + step)} ({format_offset(step)}) while "
            f"{format_duration(arrival - int(edge.arrivals[at[0]]))} passed"
        )
        details = {
            "from_ns": before,
            "to_ns": before + step,
            "arrival_ns": arrival,
            "jumps": len(at),
        }
        names = tuple(sorted(member.name for member in members))
        yield Finding("time-jump", names, message, before, len(names) * len(at), details)


def _publishers(edge: Edge, names: Sequence[str]) -> Iterator[Finding]:
    who = [names[i] for i in np.unique(edge.publishers) if names[i]]
    if len(who) < 2:
        return
    shares = [int(np.sum(edge.publishers == names.index(name))) for name in who]
    listed = ", ".join(f"{name} ({share:,})" for name, share in zip(who, shares, strict=True))
    message = f"{len(who)} publishers: {listed}"
    yield Finding("two-publishers", (edge.name,), message, None, len(who), {"publishers": who})


def _static_and_moving(edge: Edge, conflicts: Mapping[tuple[str, bool], int]) -> Iterator[Finding]:
    static = int(edge.static.sum())
    moving = len(edge.static) - static + conflicts.get((edge.name, False), 0)
    static += conflicts.get((edge.name, True), 0)
    if static and moving:
        message = f"{counted(static, 'static transform')}, {counted(moving, 'moving transform')}"
        yield Finding("static-and-moving", (edge.name,), message, None, min(static, moving))


def _quaternions(edge: Edge) -> Iterator[Finding]:
    off = np.abs(np.sum(edge.poses[:, 3:] ** 2, axis=1) - 1)
    bad = ~(off <= QUATERNION_TOLERANCE)
    if bad.any():
        row = int(np.flatnonzero(bad)[0])
        worst = float(np.max(np.where(np.isfinite(off), off, np.inf)[bad]))
        message = (
            f"{counted(int(bad.sum()), 'quaternion')} not of unit length, "
            f"squared length off by up to {worst:.3g}"
        )
        stamp = int(edge.stamps[row])
        yield Finding("quaternion", (edge.name,), message, stamp, int(bad.sum()))


def _revised(edge: Edge) -> Iterator[Finding]:
    if len(edge.poses) < 2:
        return
    changed = np.any(edge.poses[1:] != edge.poses[:-1], axis=1)
    changed |= edge.parents[1:] != edge.parents[:-1]
    if changed.any():
        count = int(changed.sum())
        message = f"the static transform changes {_times(count)}; the last one counts"
        arrival = int(edge.arrivals[int(np.flatnonzero(changed)[0]) + 1])
        yield Finding("static-revised", (edge.name,), message, None, count, {"arrival_ns": arrival})


def _reparented(edge: Edge, names: Sequence[str]) -> Iterator[Finding]:
    changes = np.flatnonzero(edge.parents[1:] != edge.parents[:-1])
    if len(changes):
        parents = [names[i] for i in dict.fromkeys(edge.parents.tolist())]
        stamp = int(edge.stamps[int(changes[0]) + 1])
        message = f"the parent changes {_times(len(changes))}, between {', '.join(parents)}"
        yield Finding(
            "reparented", (edge.name,), message, stamp, len(changes), {"parents": parents}
        )


def _repeated(edge: Edge, pieces: npt.NDArray[np.int64]) -> Iterator[Finding]:
    order = np.lexsort((edge.stamps, pieces))
    same = (np.diff(edge.stamps[order]) == 0) & (np.diff(pieces[order]) == 0)
    poses = edge.poses[order]
    other = same & np.any(poses[1:] != poses[:-1], axis=1)
    if other.any():
        count = int(other.sum())
        stamp = int(edge.stamps[order[int(np.flatnonzero(other)[0])]])
        message = (
            f"{counted(count, 'sample')} with the stamp of an earlier sample, but another pose"
        )
        yield Finding("repeated", (edge.name,), message, stamp, count)


def _ordered(edge: Edge, pieces: npt.NDArray[np.int64]) -> Iterator[Edge]:
    """Yield each piece sorted by stamp, without repeated and broken samples."""
    order = np.lexsort((edge.stamps, pieces))
    for rows in np.split(order, np.flatnonzero(np.diff(pieces[order])) + 1):
        part = edge._rows(rows)
        same = np.zeros(len(rows), dtype=bool)
        same[1:] = (np.diff(part.stamps) == 0) & (part.poses[1:] == part.poses[:-1]).all(axis=1)
        whole = np.isfinite(part.poses).all(axis=1)
        yield part._rows(whole & ~same)


def _pose_jumps(edge: Edge, pieces: npt.NDArray[np.int64]) -> Iterator[Finding]:
    found = []
    for part in _ordered(edge, pieces):
        for row in motion.jump_rows(part.stamps, part.poses[:, :3]).tolist():
            if part.parents[row] == part.parents[row + 1]:
                way = float(np.linalg.norm(part.poses[row + 1, :3] - part.poses[row, :3]))
                found.append((way, int(part.stamps[row]), int(part.stamps[row + 1])))
    if not found:
        return
    way, before, after = max(found)
    message = f"{counted(len(found), 'jump')}, the furthest {way:,.4g} m "
    message += f"in {format_duration(after - before)}"
    details = {"furthest_m": way, "from_ns": before, "to_ns": after}
    yield Finding("pose-jump", (edge.name,), message, before, len(found), details)


def _turns(edge: Edge, pieces: npt.NDArray[np.int64]) -> Iterator[Finding]:
    parts = [(part, motion.turns(part.poses)) for part in _ordered(edge, pieces)]
    found = [(part, turns) for part, turns in parts if turns is not None]
    if not found:
        return
    part, turns = max(found, key=lambda each: len(each[1].rows))
    count = sum(len(each.rows) for _, each in found)
    far = f"{np.degrees(turns.furthest):.3g} deg" if turns.is_angle else f"{turns.furthest:,.4g} m"
    message = (
        f"{counted(count, 'pose')} out of {len(edge.stamps):,} jump there and back, "
        f"by up to {far}: perhaps two publishers alternate"
    )
    stamp = int(part.stamps[turns.rows[0]])
    yield Finding("there-and-back", (edge.name,), message, stamp, count)


def _ahead(edges: Sequence[Edge]) -> Iterator[Finding]:
    """Report edges whose stamps are mostly ahead of arrival, in one finding."""
    found = []
    for edge in edges:
        ahead = edge.stamps - edge.arrivals
        usual = int(np.median(ahead))
        samples = int((ahead > AHEAD).sum())
        if 2 * samples > len(ahead) and usual < YEAR_NS:
            found.append((usual, samples, edge))
    if not found:
        return
    most = max(usual for usual, _, _ in found)
    count = sum(samples for _, samples, _ in found)
    message = (
        f"{counted(count, 'sample')} of {counted(len(found), 'edge')} with stamps later than their "
        f"arrival, usually by {format_duration(most)}"
    )
    names = tuple(sorted(edge.name for _, _, edge in found))
    first = min(int(edge.stamps[0]) for _, _, edge in found)
    yield Finding("ahead", names, message, first, count, {"usual_ns": most})


def _late(edge: Edge, pieces: npt.NDArray[np.int64]) -> Iterator[Finding]:
    parts = np.split(edge.stamps, np.flatnonzero(np.diff(pieces)) + 1)
    behind = np.concatenate([np.maximum.accumulate(part) - part for part in parts])
    late = behind > 0
    if late.any():
        count = int(late.sum())
        stamp = int(edge.stamps[int(np.flatnonzero(late)[0])])
        message = (
            f"{counted(count, 'sample')} out of {len(late):,} out of order, "
            f"up to {format_duration(int(behind.max()))} behind the newest"
        )
        details = {"worst_ns": int(behind.max())}
        yield Finding("late", (edge.name,), message, stamp, count, details)


def holes(log: Log, limit: int | None = None) -> list[Hole]:
    """Find every gap of every edge, by frame and time, as `examine` counts them."""
    found: list[Hole] = []
    for part in _by_clock([moving for edge in log.edges() if len((moving := edge.moving).stamps)]):
        for edge in part:
            jumps = jump_rows(edge, NS)
            for rows in np.split(np.arange(len(edge.stamps)), jumps + 1):
                found += _holes_of(edge, rows, limit, log.names)
    return sorted(found, key=lambda hole: (hole.frame, hole.gap.before))


def _holes_of(
    edge: Edge, rows: npt.NDArray[np.int64], limit: int | None, names: Sequence[str]
) -> Iterator[Hole]:
    """Find the gaps among some rows of an edge."""
    stamps, first = np.unique(edge.stamps[rows], return_index=True)
    period, _, gaps = find_gaps(stamps, limit)
    for gap in gaps:
        before, after = rows[first[np.searchsorted(stamps, [gap.before, gap.after])]]
        yield Hole(
            edge.name,
            names[edge.parents[before]],
            gap,
            period or 0,
            names[edge.publishers[before]],
            names[edge.publishers[after]],
        )


def _gaps(edge: Edge, pieces: npt.NDArray[np.int64], limit: int | None) -> Iterator[Finding]:
    parts = np.split(edge.stamps, np.flatnonzero(np.diff(pieces)) + 1)
    found = [find_gaps(np.unique(part), limit) for part in parts]
    gaps = [gap for _, _, some in found for gap in some]
    periods = [period for period, _, some in found if some and period is not None]
    if not gaps or not periods:
        return
    longest = max(gaps, key=lambda gap: gap.length)
    message = (
        f"{counted(len(gaps), 'gap')}, the longest {format_duration(longest.length)} "
        f"where {format_duration(periods[0])} is usual"
    )
    details = {
        "longest_ns": longest.length,
        "period_ns": periods[0],
        "gaps": [[gap.before, gap.after] for gap in gaps],
    }
    yield Finding("gap", (edge.name,), message, longest.before, len(gaps), details)


def _coverage(edge: Edge, start: int, end: int, limits: Limits) -> Iterator[Finding]:
    stamps = np.unique(edge.stamps)
    period = find_gaps(stamps)[0] or 0
    limit = max(limits.coverage, GAP_FACTOR * period)
    first, last = int(stamps[0]), int(stamps[-1])
    parts = []
    if first - start > limit:
        parts.append(f"starts {format_duration(first - start)} after the first sample of all edges")
    if end - last > limit:
        parts.append(f"stops {format_duration(end - last)} before the last sample of all edges")
    if parts:
        yield Finding("coverage", (edge.name,), " and ".join(parts), first, len(parts))


def _times(number: int) -> str:
    return "once" if number == 1 else f"{number:,} times"

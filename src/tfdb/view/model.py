"""The model of the page: tree, poses per tick, facts, events and lookups of a store."""

from __future__ import annotations

import time
from collections import Counter, OrderedDict, deque
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from tfdb.data.counting import counted
from tfdb.data.decimal_time import NS_PER_SECOND as NS
from tfdb.data.errors import TfdbError, UnknownFrame
from tfdb.data.suggestions import first_few
from tfdb.data.time_text import format_duration
from tfdb.judging.events import ANOTHER_CLOCK
from tfdb.judging.judge import Judge
from tfdb.judging.live import LiveJudge
from tfdb.store.explain import from_one_state
from tfdb.store.summary import Forest, edge_summaries, find_gaps

from .messages import CHANGED, EVENTS, PAST, WHOLE, Lookup, as_numbers, write_poses, write_text
from .metrics import age_metric, expectation_metrics

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Sequence

    from tfdb._core import Buffer, Clock, Snapshot
    from tfdb.data.types import TreeColumns
    from tfdb.judging.events import Event
    from tfdb.judging.expectations import Expectations
    from tfdb.judging.follower import Followed

    from .metrics import Metric

T = TypeVar("T")
Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_CHECKED = 64
"""Largest number of parents that a tick compares; in larger trees they take turns."""
_FAR = 1024.0
"""Metres: beyond this float32 rounds by more than 0.1 mm; poses are sent relative to an origin."""
_REST = 0.5
_LONGEST_REST = 5.0
_SHARE = 200
"""Pause between facts, as a multiple of their duration; at most 5 s. They use 0.5 % of a core."""
_ROW = np.dtype("V28")
"""Bytes of a pose: seven float32 numbers."""
_GAPS = 200
_TRAIL = 240
_TOPOLOGIES = 16
_GAPS_AGE = 2.0
"""Seconds for which the gaps of a growing edge are cached."""


@dataclass(frozen=True, eq=False)
class Topology:
    """Frames in tree order, with their parents; a row is the number of a frame."""

    number: int
    names: tuple[str, ...]
    columns: Integers
    """Positions of the frames in `TreeColumns`."""
    moving: Integers
    """Rows of the moving edges."""
    moving_names: list[str]
    moving_parents: list[str | None]
    origins: Floats
    """(M, 3): the poses of the moving edges are sent relative to these."""
    text: str
    """The message for viewers."""


class Model:
    """The content of the page for one store. Threads: one.

    Parameters
    ----------
    store
        The store. A changing store also needs `live`.
    source
        The name of the store for users.
    live
        Its commits and the clock of its stamps. None: the store does not change.
    opening
        Python code that opens it as `buf`; empty: unknown.
    expected
        The expectations of its edges.
    events
        Events of a recording.
    """

    def __init__(
        self,
        store: Buffer,
        source: str,
        *,
        live: Followed | None = None,
        opening: str = "",
        expected: Expectations | None = None,
        events: Iterable[Event] = (),
    ) -> None:
        self.store: Buffer = store
        self.source: str = source
        self.live: Followed | None = live
        self.events: deque[dict[str, Any]] = deque(maxlen=EVENTS)
        self.judges: bool = expected is not None
        self.commit: int = -1
        """The last shown commit."""
        self.facts: str = ""
        """The newest facts, as a message."""
        self.rest: float = _REST
        """Seconds until facts are sent again after commits."""
        self._opening = opening
        self._topologies: OrderedDict[Any, Topology] = OrderedDict()
        self._numbers = 0
        self.topology: Topology
        self._poses: npt.NDArray[np.float32]
        self._shown: tuple[Any, ...] = ()
        """Names, parents, kinds and static poses of the topology."""
        self._writers: tuple[Topology | None, tuple[str, ...], list[str], list[int]]
        self._writers = None, (), [], []
        """The authorities of a topology's edges: their names, and the index of each row's."""
        self._turn = 0
        self._stamp = 0
        self._since = time.monotonic_ns()
        self._clock: Clock = store.clock
        self._goes_otherwise = live is not None and live.clock is None
        self._time: Callable[[], int] = self._clock.now if live is None else live.now
        self._gaps: OrderedDict[str, tuple[float, int, dict[str, Any]]] = OrderedDict()
        self._news: list[dict[str, Any]] = []
        self._judge: LiveJudge | None = None
        self._begun: Counter[str] = Counter()
        """Number of broken expectations, by kind."""
        if live is not None and expected is not None:
            self._judge = LiveJudge(live, Judge(expected, live.now()))
            self._take(self._judge.begun)
        elif live is None:
            self._take(events)
            self.events.extend(_gap_events(store, EVENTS - len(self.events)))
        self.look()

    # The newest state.

    def look(self) -> None:
        """Read the newest state: the tree, the facts and all poses."""
        began = time.monotonic()
        self._read(self._look)
        took = time.monotonic() - began
        self.rest = min(max(_SHARE * took, _REST), _LONGEST_REST)

    def tick(self) -> bytes:
        """Read the newest poses, and return the changed ones; empty without a change."""
        return self._read(self._tick)

    def whole(self) -> bytes:
        """Return all poses of the last tick."""
        moving = self.topology.moving
        return write_poses(WHOLE, self.topology.number, self._stamp, moving, self._poses)

    def judge(self) -> list[dict[str, Any]]:
        """Check the expectations on the commits since the last call; return new events."""
        judge = self._judge
        if judge is None:
            return []
        return self._take(judge.take(judge.read(0)))

    def _take(self, events: Iterable[Event]) -> list[dict[str, Any]]:
        """Count and keep events; return them as messages."""
        known = list(events)
        self._begun.update(event.kind for event in known if event.begins)
        made = [_event(event) for event in known]
        self.events.extend(made)
        return made

    def take_tree_events(self) -> list[dict[str, Any]]:
        """Return the events of the tree since the last call."""
        made, self._news = self._news, []
        return made

    @property
    def settings(self) -> int:
        """Number of times that the store's clock was set: ages change with it."""
        return self._clock._settings

    def hello(self, shapes: str = "") -> str:
        """Return the first message to a viewer; `shapes` identifies the shapes."""
        return write_text(
            "hello",
            source=self.source,
            live=self.live is not None,
            judged=self.judges,
            opening=self._opening,
            shapes=shapes,
            events=list(self.events),
        )

    def _read(self, read: Callable[[Snapshot], T]) -> T:
        return from_one_state(self.store, read)

    def _look(self, state: Snapshot) -> None:
        self.commit = state.commit
        columns = state.tree_columns()
        fixed = np.flatnonzero(columns.is_static)
        poses = state.lookup_edges([columns.names[each] for each in fixed])
        made_of = (columns.names, columns.parents, columns.is_static.tobytes(), poses.tobytes())
        if made_of != self._shown:
            before = dict(zip(*self._shown[:2], strict=True)) if self._shown else None
            self._shown = made_of
            self.topology = self._topology(state, None, columns)
            if before is not None:
                self._news = [*self._news, *self._changes(before, columns)]
            self._poses = self._poses_at(state, self.topology, None)
        self._facts_message(state, columns)

    def _tick(self, state: Snapshot) -> bytes:
        topology = self.topology
        first = self._turn if self._turn < len(topology.moving) else 0
        turn = slice(first, first + _CHECKED)
        self._turn = first + _CHECKED
        try:
            parents = list(map(state.parent_of, topology.moving_names[turn]))
        except UnknownFrame:
            parents = []
        if parents != topology.moving_parents[turn]:
            self._look(state)
            return b""
        self.commit = state.commit
        poses = self._poses_at(state, topology, None)
        # Compare bytes, because NaN differs from itself.
        changed = poses.view(_ROW)[:, 0] != self._poses.view(_ROW)[:, 0]
        self._poses = poses
        rows = np.flatnonzero(changed)
        if not len(rows):
            return b""
        if len(rows) < len(poses):
            poses = poses[rows]
        moved = topology.moving[rows]
        return write_poses(CHANGED, topology.number, self._stamp, moved, poses)

    def _poses_at(
        self, state: Snapshot, topology: Topology, stamp: int | None
    ) -> npt.NDArray[np.float32]:
        if not topology.origins.any():
            return state.lookup_edges(topology.moving_names, stamp, dtype=np.float32)
        poses = state.lookup_edges(topology.moving_names, stamp)
        poses[:, :3] -= topology.origins
        return poses.astype(np.float32)

    # Topologies.

    def _topology(self, state: Snapshot, stamp: int | None, columns: TreeColumns) -> Topology:
        """Return the topology of a state at a stamp: a known one, or a new one."""
        fixed = np.flatnonzero(columns.is_static)
        still = state.lookup_edges([columns.names[each] for each in fixed])
        key = columns.names, columns.parents, columns.is_static.tobytes(), still.tobytes()
        known = self._topologies.get(key)
        if known is not None:
            self._topologies.move_to_end(key)
            return known
        place = {name: column for column, name in enumerate(columns.names)}
        names = tuple(row.info.name for row in Forest(state.tree(stamp)).rows())
        row_of = {name: row for row, name in enumerate(names)}
        order = np.array([place[name] for name in names], dtype=np.int64)
        parents = [columns.parents[each] for each in order]
        static = columns.is_static[order] if len(order) else np.zeros(0, dtype=bool)
        has_parent = np.array([each is not None for each in parents], dtype=bool)
        moving = np.flatnonzero(has_parent & ~static)
        moving_names = [names[row] for row in moving]
        first = state.lookup_edges(moving_names)[:, :3]
        far = np.isfinite(first).all(axis=1) & (np.abs(first).max(axis=1, initial=0) > _FAR)
        origins = np.where(far[:, None], np.round(first), 0.0)
        poses = dict(zip(fixed.tolist(), as_numbers(still), strict=True))
        self._numbers += 1
        text = write_text(
            "tree",
            topology=self._numbers,
            names=names,
            parents=[-1 if each is None else row_of[each] for each in parents],
            static={row: poses[order[row]] for row in np.flatnonzero(static).tolist()},
            origins={
                int(row): origin
                for row, origin in zip(moving[far], origins[far].tolist(), strict=True)
            },
        )
        moving_parents = [parents[row] for row in moving]
        made = Topology(
            self._numbers, names, order, moving, moving_names, moving_parents, origins, text
        )
        self._topologies[key] = made
        while len(self._topologies) > _TOPOLOGIES:
            self._topologies.popitem(last=False)
        return made

    def _changes(self, before: dict[str, str | None], columns: TreeColumns) -> list[dict[str, Any]]:
        """Describe how the tree changed."""
        now = dict(zip(columns.names, columns.parents, strict=True))
        stamp = int(columns.newest.max(initial=0))
        made = [name for name in now if name not in before]
        removed = [name for name in before if name not in now]
        moved = [name for name in now if name in before and now[name] != before[name]]
        found = []
        for kind, names in (("new", made), ("removed", removed)):
            if names:
                text = f"{counted(len(names), 'frame')}: {first_few(names)}"
                found.append(_tree_event(kind, names[0], text, stamp))
        for name in moved[:EVENTS]:
            text = f"{name}: parent {before[name] or 'none'} -> {now[name] or 'none'}"
            found.append(_tree_event("re-parented", name, text, stamp))
        self.events.extend(found)
        return found

    # Facts.

    def _facts_message(self, state: Snapshot, columns: TreeColumns) -> None:
        """Write the facts of all edges as one message."""
        topology = self.topology
        moving = topology.columns[topology.moving]
        newest, oldest = columns.newest[moving], columns.oldest[moving]
        known = newest >= 0
        self._stamp_of(int(newest.max(initial=0)))
        if self._writers[:2] != (topology, columns.authorities):
            numbers = {name: number for number, name in enumerate(set(columns.authorities))}
            rows = [numbers[columns.authorities[each]] for each in topology.columns]
            self._writers = topology, columns.authorities, list(numbers), rows
        _, _, authorities, authority = self._writers
        now, own = self._now()
        self.facts = write_text(
            "facts",
            topology=topology.number,
            commit=state.commit,
            start=str(int(oldest[known].min())) if known.any() else None,
            end=str(int(newest[known].max())) if known.any() else None,
            now=str(now),
            clock=own,
            speed=self._speed() if own else 1.0,
            rest=self.rest,
            rows=topology.moving.tolist(),
            # Integers are written three times as fast; a rate of 0 means unknown.
            rate=np.nan_to_num(100 * columns.rate[moving], posinf=0).round().astype(int).tolist(),
            newest=[str(each) if each >= 0 else None for each in newest.tolist()],
            late=columns.late[moving].tolist(),
            gap=(columns.longest_gap[moving] // 100_000).tolist(),
            authorities=authorities,
            authority=authority,
            broken=self._broken(),
        )

    def _broken(self) -> list[list[str]]:
        """List the broken expectations: the frame (may be empty), the severity, and the text."""
        if self._judge is None:
            return []
        active = sorted(self._judge.judge.active.values(), key=lambda event: event.rank)
        return [[each.child, each.severity, _text_of(each)] for each in active]

    def _stamp_of(self, newest: int) -> None:
        if newest != self._stamp:
            self._stamp, self._since = newest, time.monotonic_ns()

    def _now(self) -> tuple[int, bool]:
        """Return the current time for ages, and whether it is that of the store's clock.

        Stamps of another clock age from the newest one on.
        """
        if self.live is None:
            return self._stamp, False
        now = self._time()
        if abs(now - self._stamp) < ANOTHER_CLOCK:
            return now, True
        return self._stamp + time.monotonic_ns() - self._since, False

    def _speed(self) -> float:
        """Return the speed of that time; 0 while it is paused."""
        if self._goes_otherwise:
            return 1.0
        return 0.0 if self._clock.paused else self._clock.speed

    def metrics(self) -> list[Metric]:
        """Return the ages of the edges of a live store, and counts of broken expectations."""
        found = []
        if self.judges:
            active = () if self._judge is None else self._judge.judge.active.values()
            found += expectation_metrics(active, self._begun)
        if self.live is not None:
            found.append(age_metric(self._read(self._ages)))
        return found

    def _ages(self, state: Snapshot) -> list[tuple[str, str, float]]:
        columns = state.tree_columns()
        self._stamp_of(int(columns.newest.max(initial=0)))
        now, _ = self._now()
        ages = (now - columns.newest) / NS
        rows = np.flatnonzero(columns.newest >= 0).tolist()
        return [(columns.parents[row] or "", columns.names[row], ages[row]) for row in rows]

    # Questions.

    def at(self, stamp: int) -> tuple[Topology, bytes]:
        """Return the tree and all poses at a stamp. Raises InvalidStamp."""

        def read(state: Snapshot) -> tuple[Topology, bytes]:
            topology = self._topology(state, stamp, state.tree_columns(stamp))
            poses = self._poses_at(state, topology, stamp)
            message = write_poses(PAST, topology.number, stamp, topology.moving, poses)
            return topology, message

        return self._read(read)

    def answer(self, asked: Lookup) -> str:
        """Answer a lookup: the transform, the use of each edge, gaps, trail, and Python code."""
        try:
            body = self._read(lambda state: self._answer(state, asked))
        except TfdbError as error:
            body = {"ok": False, "text": str(error)}
        return write_text(
            "answer",
            id=asked.number,
            target=asked.target,
            source=asked.source,
            at=None if asked.stamp is None else str(asked.stamp),
            python=self._python(asked),
            **body,
        )

    def _answer(self, state: Snapshot, asked: Lookup) -> dict[str, Any]:
        gaps = self._gaps_of(state, asked.source)
        is_live = asked.stamp is None and self.live is not None
        try:
            if is_live:
                found = state.lookup_latest_transform(asked.target, asked.source)
            else:
                found = state.lookup_transform(asked.target, asked.source, asked.stamp)
        except TfdbError:
            told = state.explain(asked.target, asked.source, asked.stamp)
            if told.ok:  # a latest lookup differs if an edge was cleared
                raise
            return {"ok": False, "text": str(told), "gaps": gaps}
        report = found.report
        now, _ = self._now()
        edges = [
            {
                "parent": edge.parent,
                "child": edge.child,
                "used": edge.used,
                "before": None if edge.before is None else str(edge.before),
                "after": None if edge.after is None else str(edge.after),
                "gap": edge.gap / NS,
                "age": (now - edge.before if is_live and edge.before is not None else edge.age)
                / NS,
                "inverted": edge.inverted,
            }
            for edge in report.edges
        ]
        return {
            "ok": True,
            "stamp": None if report.timeless else str(found.stamp),
            "pose": found.pose.tolist(),
            "rpy": found.rpy.tolist(),
            "edges": edges,
            "gaps": gaps,
            "trail": self._trail(state, asked),
        }

    def _trail(self, state: Snapshot, asked: Lookup) -> list[list[float]]:
        """Return the positions of the source in the target before the stamp."""
        if not asked.trail or asked.source == asked.target:
            return []
        first, last = state.common_times(asked.target, asked.source)
        last = last if asked.stamp is None else min(last, asked.stamp)
        first = max(first, last - round(asked.trail * NS))
        if first >= last:
            return []
        stamps = np.linspace(0, last - first, _TRAIL).astype(np.int64) + first
        poses = state.lookup_transforms(asked.target, asked.source, stamps, missing="nan")
        places = poses[np.isfinite(poses).all(axis=1), :3]
        return np.round(places, 5).tolist()  # type: ignore[no-any-return]

    def _gaps_of(self, state: Snapshot, name: str) -> dict[str, Any]:
        """Return the period, span and gaps of an edge's samples, longest gaps first."""
        then, commit, known = self._gaps.get(name, (-_GAPS_AGE, -1, {}))
        if commit == state.commit or time.monotonic() - then < _GAPS_AGE:
            return known
        info = state.frame_info(name)
        found: dict[str, Any] = {}
        if info.oldest is not None and info.newest is not None:
            period, _, gaps = find_gaps(state.samples(name)[0])
            longest = sorted(gaps, key=lambda gap: -gap.length)[:_GAPS]
            found = {
                "start": str(info.oldest),
                "end": str(info.newest),
                "period": None if period is None else period / NS,
                "gaps": [[str(gap.before), str(gap.after)] for gap in longest],
                "count": len(gaps),
            }
        self._gaps[name] = time.monotonic(), state.commit, found
        self._gaps.move_to_end(name)
        while len(self._gaps) > 4 * _TOPOLOGIES:
            self._gaps.popitem(last=False)
        return found

    def _python(self, asked: Lookup) -> str:
        """Write the lookup as Python code."""
        names = f"{asked.target!r}, {asked.source!r}"
        if asked.stamp is not None:
            call = f"buf.lookup_transform({names}, {asked.stamp})"
        elif self.live is not None:
            call = f"buf.lookup_latest_transform({names})"
        else:
            call = f"buf.lookup_transform({names})"
        lines = ["import tfdb", "", self._opening] if self._opening else []
        return "\n".join([*lines, f"T = {call}"])


def _event(event: Event) -> dict[str, Any]:
    return {
        "time": str(event.time),
        "kind": event.kind,
        "severity": event.severity,
        "begins": event.begins,
        "frame": event.child,
        "text": _text_of(event),
    }


def _text_of(event: Event) -> str:
    return f"{event.subject}: {event.kind} {event.measured}".rstrip()


def _tree_event(kind: str, frame: str, text: str, stamp: int) -> dict[str, Any]:
    return {
        "time": str(stamp),
        "kind": kind,
        "severity": "info",
        "begins": True,
        "frame": frame,
        "text": text,
    }


def _gap_events(store: Buffer, most: int) -> Sequence[dict[str, Any]]:
    """Return the longest gaps of an unchanging store, as events."""
    found = [(gap, edge) for edge in edge_summaries(store) for gap in edge.gaps]
    found.sort(key=lambda each: -each[0].length)
    return [
        {
            "time": str(gap.before),
            "kind": "gap",
            "severity": "warning",
            "begins": True,
            "frame": edge.info.name,
            "text": f"{edge.info.name}: no sample for {format_duration(gap.length)}",
        }
        for gap, edge in found[: max(most, 0)]
    ]

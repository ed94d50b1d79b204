"""The whole store as one would write it on a napkin: lists, and full scans for every question.

It keeps every commit, so any earlier state can still be asked. Frames are numbers in here: a name
that was removed and comes back is another frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import takewhile
from typing import TYPE_CHECKING, Any, TypeAlias

import tfdb

from .poses import IDENTITY, Pose, compose, interpolate, inverse

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

ErrorClass: TypeAlias = type[tfdb.TfdbError]
_BEFORE_ALL = -1


@dataclass(frozen=True)
class Newest:
    """Each edge's own newest sample, whatever the stamp: what no caller can pass as a policy."""

    kind: str = "latest"
    limit_ns: int | None = None


Policy: TypeAlias = tfdb.Policy | Newest
NEWEST = Newest()


class Refused(Exception):  # noqa: N818 - it is an answer, too
    """The model refuses: with which class of error, and what its fields say."""

    def __init__(self, kind: ErrorClass, **fields: Any) -> None:
        super().__init__(kind.__name__, fields)
        self.kind = kind
        self.fields = fields


@dataclass(frozen=True)
class Member:
    """One transform T[parent<-child] of a batch."""

    parent: str
    child: str
    stamp: int
    pose: Pose


@dataclass(frozen=True)
class Use:
    """How one edge of a path was used; stamps are None for a static edge."""

    child: str
    parent: str
    used: str
    before: int | None
    after: int | None
    inverted: bool


@dataclass(frozen=True)
class Answer:
    """T[target<-source], its stamp, and the edges of the path."""

    pose: Pose
    stamp: int
    edges: tuple[Use, ...]


@dataclass(frozen=True)
class Sample:
    """What one member of a commit left behind."""

    child: int
    parent: int
    stamp: int
    pose: Pose
    commit: int
    static: bool


@dataclass
class _Frame:
    name: str
    born: int
    died: int | None = None


@dataclass(frozen=True)
class _Choice:
    """Which samples answer for an edge at a stamp; `anchor` names the parent."""

    anchor: Sample
    second: Sample | None = None
    used: str = "static"
    bracket: tuple[int, int] | None = None
    refusal: tuple[ErrorClass, dict[str, Any]] | None = None


@dataclass
class Model:
    """All commits of a store, and the answers of any of its states."""

    history: int | None
    commit: int = 0
    frames: list[_Frame] = field(default_factory=list)
    samples: list[Sample] = field(default_factory=list)
    clears: list[int] = field(default_factory=list)

    # -- frames and samples ------------------------------------------------------------------------

    def alive(self, frame: int, state: int) -> bool:
        """Whether the frame exists in that state."""
        it = self.frames[frame]
        return it.born <= state and (it.died is None or state < it.died)

    def find(self, name: str, state: int) -> int | None:
        """The frame of that name."""
        found = (f for f in range(len(self.frames)) if self.frames[f].name == name)
        return next((f for f in found if self.alive(f, state)), None)

    def frame_names(self, state: int) -> list[str]:
        """Names of all frames, sorted."""
        alive = (f for f in range(len(self.frames)) if self.alive(f, state))
        return sorted(self.frames[f].name for f in alive)

    def visible(self, frame: int, state: int) -> list[Sample]:
        """In the order of stamps, one for each; a static edge has just its newest pose."""
        cleared = max((c for c in self.clears if c <= state), default=0)
        by_stamp: dict[int, Sample] = {}
        for s in self.samples:
            if s.child == frame and s.commit <= state and (s.static or s.commit > cleared):
                by_stamp[0 if s.static else s.stamp] = s
        found = [by_stamp[stamp] for stamp in sorted(by_stamp)]
        if not found or found[-1].static or self.history is None:
            return found
        return [s for s in found if s.stamp >= found[-1].stamp - self.history]

    def parent_name(self, sample: Sample, state: int) -> str | None:
        """Name of the sample's parent; None if that was removed."""
        alive = self.alive(sample.parent, state)
        return self.frames[sample.parent].name if alive else None

    # -- which samples answer ----------------------------------------------------------------------

    def choose(self, frame: int, time: int, policy: Policy, state: int) -> _Choice | None:
        """The samples that a policy picks for an edge; None for a root."""
        samples = self.visible(frame, state)
        if not samples:
            return None
        if samples[-1].static:
            return _Choice(samples[-1])
        if policy.kind == "latest":
            return _Choice(samples[-1], used="latest")
        if policy.kind == "nearest":
            return _choose_nearest(samples, time, policy)
        before = [s for s in samples if s.stamp <= time]
        after = [s for s in samples if s.stamp > time]
        if before and before[-1].stamp == time:
            return _Choice(before[-1], used="exact")
        if policy.kind == "exact":
            return _Choice(
                before[-1] if before else after[0],
                refusal=_refusal(tfdb.NoSampleNear, samples, time, 0),
            )
        if policy.kind == "previous" and before:
            late = policy.limit_ns is not None and time - before[-1].stamp > policy.limit_ns
            refusal = _refusal(tfdb.Stale, samples, time, policy.limit_ns) if late else None
            return _Choice(before[-1], used="held", refusal=refusal)
        if before and after:
            return _choose_between(samples, before[-1], after[0], time, policy)
        return _choose_outside(samples, time, policy)

    def parent_at(
        self, frame: int, time: int, policy: Policy, state: int, *, answering: bool = False
    ) -> int | None:
        """The parent that the picked sample names; None for a root."""
        choice = self.choose(frame, time, policy, state)
        if choice is None or (answering and choice.refusal):
            return None
        return choice.anchor.parent if self.alive(choice.anchor.parent, state) else None

    # -- lookups -----------------------------------------------------------------------------------

    def require(self, *names: str, state: int) -> list[int]:
        """The frames of these names; refuses the first that does not exist."""
        found = []
        for name in names:
            frame = self.find(name, state)
            if frame is None:
                raise Refused(tfdb.UnknownFrame, frame=name)
            found.append(frame)
        return found

    def _chain(
        self, frame: int, time: int, policy: Policy, state: int, *, answering: bool
    ) -> list[int]:
        chain: list[int] = []
        at: int | None = frame
        while at is not None and at not in chain:
            chain.append(at)
            at = self.parent_at(at, time, policy, state, answering=answering)
        return chain

    def path(
        self, target: int, source: int, time: int, policy: Policy, state: int
    ) -> tuple[list[int], list[int]]:
        """Frames from the source, and from the target, up to below their meeting point.

        One of edges that all answer at that time is preferred. If there is none, an edge that does
        not answer has the parent of its nearest sample: the lookup can then say which one fails.
        """
        for answering in (True, False):
            up = self._chain(source, time, policy, state, answering=answering)
            down = self._chain(target, time, policy, state, answering=answering)
            top = next((f for f in up if f in down), None)
            if top is not None:
                return up[: up.index(top)], down[: down.index(top)]
        roots = (self.frames[down[-1]].name, self.frames[up[-1]].name)
        raise Refused(tfdb.Disconnected, frames=roots)

    def common_time(self, target: str, source: str, state: int) -> int:
        """The newest stamp at which every moving edge of the newest path has data."""
        to, start = self.require(target, source, state=state)
        up, down = ([start], []) if to == start else self.path(to, start, 0, NEWEST, state)
        newest = [samples[-1] for f in up + down if (samples := self.visible(f, state))]
        return min((s.stamp for s in newest if not s.static), default=0)

    def common_times(self, target: str, source: str, state: int) -> tuple[int, int]:
        """The oldest and the newest stamp that the newest path covers."""
        to, start = self.require(target, source, state=state)
        up, down = ([start], []) if to == start else self.path(to, start, 0, NEWEST, state)
        oldest = 0
        for samples in (self.visible(f, state) for f in up + down):
            moving = [s for s in samples if not s.static]
            last = takewhile(lambda s: s.parent == moving[-1].parent, reversed(moving))  # noqa: B023
            oldest = max([oldest, *(s.stamp for s in list(last)[-1:])])
        return oldest, self.common_time(target, source, state)

    def parent_of(self, name: str, time: int | None, state: int) -> str | None:
        """The parent at a stamp; None: of the newest sample."""
        (frame,) = self.require(name, state=state)
        policy = NEWEST if time is None else tfdb.Interpolate()
        parent = self.parent_at(frame, time or 0, policy, state)
        return None if parent is None else self.frames[parent].name

    def lookup(
        self, target: str, source: str, time: int | None, policy: Policy, state: int
    ) -> Answer:
        """T[target<-source] at a time; None: the latest common time."""
        to, start = self.require(target, source, state=state)
        at = self.common_time(target, source, state) if time is None else time
        up, down = self.path(to, start, at, policy, state)
        edges: list[Use] = []
        from_source = self._climb(up, at, policy, state, edges, inverted=False)
        from_target = self._climb(down, at, policy, state, edges, inverted=True)
        return Answer(compose(inverse(from_target), from_source), at, tuple(edges))

    def _climb(
        self,
        chain: list[int],
        time: int,
        policy: Policy,
        state: int,
        edges: list[Use],
        *,
        inverted: bool,
    ) -> Pose:
        pose = IDENTITY
        for frame in chain:
            choice = self.choose(frame, time, policy, state)
            assert choice is not None, "the path ends at roots"
            child = self.frames[frame].name
            parent = self.frames[choice.anchor.parent].name
            if choice.refusal:
                kind, fields = choice.refusal
                raise Refused(kind, edge=child, parent=parent, **fields)
            before, after = choice.bracket or (choice.anchor.stamp, choice.anchor.stamp)
            static = choice.anchor.static
            edges.append(
                Use(
                    child,
                    parent,
                    choice.used,
                    None if static else before,
                    None if static else after,
                    inverted,
                )
            )
            pose = compose(_pose_of(choice, time), pose)
        return pose

    def lookup_latest(
        self, target: str, source: str, state: int, max_age: int | None, now: int
    ) -> Answer:
        """Each edge's own newest sample."""
        found = self.lookup(target, source, 0, NEWEST, state)
        for use in found.edges:
            if use.before is not None and max_age is not None and use.before < now - max_age:
                raise Refused(
                    tfdb.Stale,
                    edge=use.child,
                    parent=use.parent,
                    stamp=now,
                    newest=use.before,
                    limit=max_age,
                )
        oldest = min((use.before for use in found.edges if use.before is not None), default=0)
        return Answer(found.pose, oldest, found.edges)

    def lookup_full(
        self,
        target: tuple[str, int | None],
        source: tuple[str, int | None],
        fixed: str,
        policy: Policy,
        state: int,
    ) -> Answer:
        """T[target at its time <- source at its time] by way of a frame that stays put."""
        self.require(target[0], source[0], fixed, state=state)
        first = self.lookup(fixed, source[0], source[1], policy, state)
        second = self.lookup(target[0], fixed, target[1], policy, state)
        pose = compose(second.pose, first.pose)
        return Answer(pose, second.stamp, first.edges + second.edges)

    # -- writes ------------------------------------------------------------------------------------

    def faults(self, batch: Sequence[Member], *, static: bool) -> dict[int, ErrorClass]:
        """What is wrong with single members of a batch, by index: judged by what is committed."""
        found: dict[int, ErrorClass] = {}
        for index, m in enumerate(batch):
            child = self.find(m.child, self.commit)
            stored = [] if child is None else self.visible(child, self.commit)
            oldest = stored[-1].stamp - self.history if stored and self.history is not None else 0
            if m.parent == m.child:
                found[index] = tfdb.InvalidTransform
            elif stored and stored[-1].static != static:
                found[index] = tfdb.StaticConflict
            elif stored and not static and m.stamp < oldest:
                found[index] = tfdb.TooOld
        return found

    def closes_cycle(self, batch: Sequence[Member], *, static: bool) -> bool:
        """Whether these members, none of them at fault, would together close a cycle."""
        frames, samples = len(self.frames), len(self.samples)
        self.set(batch, static=static)
        closed = self._has_cycle()
        del self.frames[frames:], self.samples[samples:]
        self.commit -= 1
        return closed

    def set(self, batch: Iterable[Member], *, static: bool) -> None:
        """Commit a batch of which no member has to be refused."""
        self.commit += 1
        for m in batch:
            parent, child = (self._find_or_make(name) for name in (m.parent, m.child))
            self.samples.append(Sample(child, parent, m.stamp, m.pose, self.commit, static))

    def _find_or_make(self, name: str) -> int:
        found = self.find(name, self.commit)
        if found is None:
            self.frames.append(_Frame(name, self.commit))
            found = len(self.frames) - 1
        return found

    def _held_parents(self, frame: int) -> list[tuple[int, int | None]]:
        """From when on which parent is held; a static edge's is held for all time."""
        held: list[tuple[int, int | None]] = [(_BEFORE_ALL, None)]
        for s in self.visible(frame, self.commit):
            parent = s.parent if self.alive(s.parent, self.commit) else None
            if parent != held[-1][1]:
                held.append((_BEFORE_ALL if s.static else s.stamp, parent))
        return held

    def _has_cycle(self) -> bool:
        """Whether a frame is its own ancestor at any time."""
        frames = [f for f in range(len(self.frames)) if self.alive(f, self.commit)]
        held = {f: self._held_parents(f) for f in frames}
        for time in {since for steps in held.values() for since, _ in steps}:
            parents = {f: [p for since, p in held[f] if since <= time][-1] for f in frames}
            for frame in frames:
                at = parents[frame]
                for _ in frames:
                    at = None if at is None else parents[at]
                if at is not None:
                    return True
        return False

    def remove(self, name: str, *, recursive: bool) -> None:
        """Remove a frame; `recursive`: with all below it."""
        (root,) = self.require(name, state=self.commit)
        gone = [root]
        for frame in gone:
            children = [f for f in range(len(self.frames)) if self._newest_parent(f) == frame]
            if children and not recursive:
                names = {self.frames[f].name for f in children}
                raise Refused(tfdb.FrameInUse, frame=name, children=names)
            gone += children
        self.commit += 1
        for frame in gone:
            self.frames[frame].died = self.commit

    def _newest_parent(self, frame: int) -> int | None:
        alive = self.alive(frame, self.commit)
        return self.parent_at(frame, 0, NEWEST, self.commit) if alive else None

    def clear(self) -> None:
        """Drop all moving samples."""
        self.commit += 1
        self.clears.append(self.commit)


def _refusal(
    kind: ErrorClass, samples: list[Sample], time: int, limit: int | None
) -> tuple[ErrorClass, dict[str, Any]]:
    before = [s.stamp for s in samples if s.stamp <= time]
    after = [s.stamp for s in samples if s.stamp > time]
    fields: dict[str, Any] = {
        "stamp": time,
        "oldest": samples[0].stamp,
        "newest": samples[-1].stamp,
        "before": before[-1] if before else None,
        "after": after[0] if after else None,
        "limit": limit,
    }
    if kind is tfdb.Extrapolation:
        fields["reason"] = "past" if time < samples[0].stamp else "future"
    return kind, fields


def _choose_nearest(samples: list[Sample], time: int, policy: Policy) -> _Choice:
    anchor = min(samples, key=lambda s: (abs(s.stamp - time), s.stamp))
    distance = abs(anchor.stamp - time)
    too_far = policy.limit_ns is not None and distance > policy.limit_ns
    return _Choice(
        anchor,
        used="nearest" if distance else "exact",
        refusal=_refusal(tfdb.NoSampleNear, samples, time, policy.limit_ns) if too_far else None,
    )


def _choose_between(
    samples: list[Sample], before: Sample, after: Sample, time: int, policy: Policy
) -> _Choice:
    limit = policy.limit_ns if policy.kind == "interpolate" else None
    too_wide = limit is not None and after.stamp - before.stamp > limit
    same = before.parent == after.parent
    return _Choice(
        before,
        after if same else None,
        "interpolated" if same else "held",
        (before.stamp, after.stamp),
        _refusal(tfdb.GapTooLarge, samples, time, limit) if too_wide else None,
    )


def _choose_outside(samples: list[Sample], time: int, policy: Policy) -> _Choice:
    """Only Extrapolate goes on, on the line through the two outermost samples."""
    future = time > samples[-1].stamp
    anchor, *others = reversed(samples) if future else samples
    limit = policy.limit_ns
    beyond = abs(time - anchor.stamp)
    if policy.kind != "extrapolate" or (limit is not None and beyond > limit):
        return _Choice(anchor, refusal=_refusal(tfdb.Extrapolation, samples, time, limit))
    if not others:
        return _Choice(anchor, used="extrapolated")
    low, high = sorted((anchor.stamp, others[0].stamp))
    second = others[0] if others[0].parent == anchor.parent else None
    return _Choice(anchor, second, "extrapolated", (low, high))


def _pose_of(choice: _Choice, time: int) -> Pose:
    first, second = choice.anchor, choice.second
    if second is None:
        return first.pose
    share = (time - first.stamp) / (second.stamp - first.stamp)
    return interpolate(first.pose, second.pose, share)

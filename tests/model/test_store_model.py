"""Random operations on a store, judged by the naive model, with snapshots held across them.

`TFDB_HYPOTHESIS=long python -m pytest tests/model` searches for long, with the seed `TFDB_SEED`.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from hypothesis import HealthCheck, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

import tfdb

from .agreement import close, outcome, refuses, same_frames, same_report
from .naive import Answer, Member, Model, Refused
from .operations import NAMES, TREE, UNKNOWN, Rule, edges, limits, names, rules, ticks
from .poses import random_pose

LONG = os.environ.get("TFDB_HYPOTHESIS") == "long"
SEED = int(os.environ.get("TFDB_SEED", "1"))
SETTINGS = settings(
    max_examples=20_000 if LONG else 150,
    stateful_step_count=60 if LONG else 40,
    derandomize=True,
    deadline=None,
    print_blob=True,
    suppress_health_check=list(HealthCheck),
)
MOST_HELD = 3

SURE = 0  # one in four: what ends everything else should be seldom

readers = st.integers(0, MOST_HELD)
frame_numbers = st.integers(0, 23)
pairs_asked = st.tuples(frame_numbers, frame_numbers)
times = st.one_of(ticks, ticks, ticks, st.none())


@dataclass
class Held:
    """A snapshot, and what it said when it was taken."""

    snapshot: tfdb.Snapshot
    commit: int
    said: list[Any]


class Store(RuleBasedStateMachine):
    """Does the same to a store and to the model, and asks both the same."""

    buffer: tfdb.Buffer
    model: Model

    @initialize(
        history=st.sampled_from((None, 12, 40)),
        start=st.sampled_from((0, 1_700_000_000_000_000_000)),
        tick=st.sampled_from((1, 10_000_000)),
        static=st.frozensets(st.sampled_from(TREE), max_size=3),
    )
    def begin(
        self, history: int | None, start: int, tick: int, static: frozenset[tuple[str, str]]
    ) -> None:
        kept = None if history is None else history * tick
        self.buffer = tfdb.Buffer(
            None if kept is None else kept / 1e9,
            clock=lambda: self.at(self.horizon),
        )
        self.model = Model(kept)
        self.start, self.tick, self.horizon = start, tick, 0
        self.held: list[Held] = []
        self.poses = 0
        self.static = static
        self.announce()
        self.publish(count=4, step=2, left_out=None)

    def at(self, tick: int) -> int:
        """The stamp of a tick; a negative one counts back from the newest."""
        count = max(0, self.horizon + 1 + tick) if tick < 0 else tick
        return self.start + count * self.tick

    def maybe_at(self, tick: int | None) -> int | None:
        return None if tick is None else self.at(tick)

    def reader(self, number: int) -> tuple[tfdb.Reads, int]:
        """The buffer or a held snapshot, and the state that it shows."""
        if number < len(self.held):
            return self.held[number].snapshot, self.held[number].commit
        return self.buffer, self.model.commit

    def frame(self, number: int, state: int) -> str:
        """One of the frames of a state; the last number is one that no state has."""
        known = self.model.frame_names(state)
        return UNKNOWN if number == 23 or not known else known[number % len(known)]

    # -- writes ------------------------------------------------------------------------------------

    def commit(
        self, batch: list[tuple[str, str, int]], *, static: bool, partial: bool = False
    ) -> None:
        """Write a batch of (parent, child, stamp) to both, each member with a pose of its own."""
        members = []
        for parent, child, stamp in batch:
            self.poses += 1
            members.append(Member(parent, child, stamp, random_pose(self.poses)))
        transforms = [
            tfdb.TransformStamped(m.parent, m.child, m.stamp, m.pose[:3], m.pose[3:])
            for m in members
        ]
        if partial:
            refused = self.buffer.set_transforms(
                transforms, static=static, authority="driver", partial=True
            )
        else:
            refused = self.refusals(members, transforms, static=static)
        stored = self.judge(members, refused, static=static)
        if (refused and not partial) or not stored:
            same_frames(self.buffer, self.model, self.model.commit)
            return
        self.model.set(stored, static=static)
        if not static:
            newest = max(m.stamp for m in stored)
            self.horizon = max(self.horizon, (newest - self.start) // self.tick)

    def refusals(
        self, members: list[Member], transforms: list[tfdb.TransformStamped], *, static: bool
    ) -> list[tfdb.types.Refused]:
        """Write all or nothing; if nothing, whom the error names."""
        try:
            commit = self.buffer.set_transforms(transforms, static=static, authority="driver")
        except tfdb.TfdbError as error:
            assert error.refused
            first = error.refused[0]
            assert (type(error).__name__, error.index) == (first.error, first.index)
            member = members[first.index]
            assert (error.edge, error.parent) == (member.child, member.parent)
            if isinstance(error, tfdb.TooOld):
                assert error.stamp == member.stamp
                assert error.oldest is not None
                assert error.newest is not None
                assert member.stamp < error.oldest == error.newest - (self.model.history or 0)
            return list(error.refused)
        assert commit == self.model.commit + 1
        return []

    def judge(
        self, members: list[Member], refused: list[tfdb.types.Refused], *, static: bool
    ) -> list[Member]:
        """Whether just the right members are refused, each for the right reason; the others."""
        told = {record.index: record.error for record in refused}
        assert list(told) == sorted(told)
        assert len(told) == len(refused)
        faults = self.model.faults(members, static=static)
        sound = [m for i, m in enumerate(members) if i not in faults]
        rest = [m for i, m in enumerate(members) if i not in told]
        alone = {i: error for i, error in told.items() if i in faults or error != "CycleError"}
        assert alone == {i: kind.__name__ for i, kind in faults.items()}
        # Members are left out for a cycle only if there is one, and until there is none.
        closes = bool(sound) and self.model.closes_cycle(sound, static=static)
        assert closes == (len(rest) < len(sound)), (members, refused)
        assert not rest or not self.model.closes_cycle(rest, static=static)
        return rest

    @rule(
        batch=st.lists(st.tuples(edges, ticks), min_size=1, max_size=4),
        partial=st.booleans(),
    )
    def move(self, batch: list[tuple[tuple[str, str], int]], partial: bool) -> None:
        members = [(parent, child, self.at(t)) for (child, parent), t in batch]
        self.commit(members, static=False, partial=partial)

    @rule(
        count=st.integers(1, 12),
        step=st.integers(1, 3),
        left_out=st.one_of(st.none(), st.sampled_from(TREE)),
    )
    def publish(self, count: int, step: int, left_out: tuple[str, str] | None) -> None:
        """The moving edges of the tree in one commit, again and again: what robots do."""
        moving = [edge for edge in TREE if edge not in self.static and edge != left_out]
        for _ in range(count):
            now = self.at(self.horizon + step)
            self.commit([(parent, child, now) for child, parent in moving], static=False)

    @rule()
    def announce(self) -> None:
        """The static edges of the tree in one commit."""
        if self.static:
            fixed = [(parent, child, 0) for child, parent in sorted(self.static)]
            self.commit(fixed, static=True)

    @rule(
        edge=st.sampled_from(TREE),
        count=st.integers(2, 25),
        first=st.integers(-40, -1),
        backwards=st.booleans(),
    )
    def flood(self, edge: tuple[str, str], count: int, first: int, backwards: bool) -> None:
        """Many samples of one edge in one commit, also late ones."""
        child, parent = edge
        begin = max(0, self.horizon + 1 + first)
        batch = [(parent, child, self.at(begin + i)) for i in range(count)]
        self.commit(batch[::-1] if backwards else batch, static=False)

    @rule(batch=st.lists(edges, min_size=1, max_size=3), sure=st.integers(0, 3))
    def fix(self, batch: list[tuple[str, str]], sure: int) -> None:
        """Other static edges, mostly such that do not conflict with moving ones."""
        still = [(p, c, 0) for c, p in batch if sure == SURE or not self.moves(c)]
        if still:
            self.commit(still, static=True)

    def moves(self, name: str) -> bool:
        frame = self.model.find(name, self.model.commit)
        samples = [] if frame is None else self.model.visible(frame, self.model.commit)
        return bool(samples) and not samples[-1].static

    @rule(number=frame_numbers, recursive=st.booleans(), sure=st.integers(0, 3))
    def remove(self, number: int, recursive: bool, sure: int) -> None:
        name = self.frame(number, self.model.commit)
        if recursive and sure != SURE:
            return
        refused = outcome(lambda: self.model.remove(name, recursive=recursive))
        if isinstance(refused, Refused):
            children = refused.fields.pop("children", None)
            error = refuses(refused, lambda: self.buffer.remove_frame(name, recursive=recursive))
            assert children is None or set(error.frames or ()) == children
        else:
            assert self.buffer.remove_frame(name, recursive=recursive) == self.model.commit

    @rule(edge=edges, then=names, late=names, back=st.integers(-30, -2))
    def supersede(self, edge: tuple[str, str], then: str, late: str, back: int) -> None:
        """A frame gets another parent, loses the former, and is told late of a third."""
        child, former = edge
        self.commit([(then, child, self.at(self.horizon + 1))], static=False)
        if outcome(lambda: self.model.remove(former, recursive=False)) is None:
            self.buffer.remove_frame(former)
        self.commit([(late, child, self.at(back))], static=False)

    @rule(sure=st.integers(0, 3))
    def clear(self, sure: int) -> None:
        if sure == SURE:
            self.model.clear()
            assert self.buffer.clear() == self.model.commit

    # -- snapshots ---------------------------------------------------------------------------------

    def say(self, reads: tfdb.Reads) -> list[Any]:
        """Everything about a state, to be compared bit for bit."""
        said: list[Any] = []
        for name in reads.frames():
            stamps, poses, parents = reads.samples(name)
            said.append((name, stamps.tolist(), poses.tobytes(), parents))
            for other in NAMES[:3]:
                explained = reads.explain(other, name)
                said.append((explained.ok, type(explained.error)))
                if explained.ok:
                    said.append(reads.lookup_transform(other, name).pose.tobytes())
        return said

    @precondition(lambda self: len(self.held) < MOST_HELD)
    @rule()
    def hold(self) -> None:
        snapshot = self.buffer.snapshot()
        assert snapshot.commit == self.model.commit
        self.held.append(Held(snapshot, self.model.commit, self.say(snapshot)))

    @precondition(lambda self: self.held)
    @rule(number=readers)
    def release(self, number: int) -> None:
        held = self.held.pop(number % len(self.held))
        assert self.say(held.snapshot) == held.said
        held.snapshot.close()

    # -- questions ---------------------------------------------------------------------------------

    @rule(number=readers, asked=frame_numbers, time=times, how=rules, age=limits)
    def ask(self, number: int, asked: int, time: int | None, how: Rule, age: int | None) -> None:
        """One frame from all others, in every single way."""
        reads, state = self.reader(number)
        at, policy = self.maybe_at(time), how.policy(self.tick)
        source = self.frame(asked, state)
        for target in (*self.model.frame_names(state), UNKNOWN):
            expected = outcome(partial(self.model.lookup, target, source, at, policy, state))
            self.check_scalar(reads, (target, source, at, policy), expected)
            self.check_latest(reads, state, target, source, age)
            common = outcome(partial(self.model.common_time, target, source, state))
            if isinstance(common, Refused):
                refuses(common, partial(reads.latest_common_time, target, source))
            else:
                assert reads.latest_common_time(target, source) == common
                covered = self.model.common_times(target, source, state)
                assert reads.common_times(target, source) == covered
        if source != UNKNOWN:
            assert reads.parent_of(source, at) == self.model.parent_of(source, at, state)

    def check_scalar(
        self,
        reads: tfdb.Reads,
        question: tuple[str, str, int | None, tfdb.Policy],
        expected: Answer | Refused,
    ) -> None:
        explained = reads.explain(*question)
        assert explained.ok == reads.can_transform(*question) == isinstance(expected, Answer)
        if isinstance(expected, Refused):
            expected.fields.setdefault("target", question[0])
            expected.fields.setdefault("source", question[1])
            error = refuses(expected, lambda: reads.lookup_transform(*question))
            assert explained.error is not None
            assert type(explained.error) is type(error)
            assert str(explained.error) == str(error)
        else:
            found = reads.lookup_transform(*question)
            same_report(found, expected)
            assert (found.target, found.source, found.commit) == (*question[:2], reads.commit)
            assert explained.error is None
            assert all(edge.ok for edge in explained.edges)
            assert len(explained.edges) == len(expected.edges)

    def check_latest(
        self, reads: tfdb.Reads, state: int, target: str, source: str, age: int | None
    ) -> None:
        now = self.at(self.horizon)
        most = None if age is None else age * self.tick
        seconds = None if most is None else most / 1e9
        expected = outcome(lambda: self.model.lookup_latest(target, source, state, most, now))
        if isinstance(expected, Refused):
            refuses(expected, lambda: reads.lookup_latest_transform(target, source, seconds, now))
        else:
            same_report(reads.lookup_latest_transform(target, source, seconds, now), expected)

    @rule(
        number=readers,
        pair=pairs_asked,
        through=frame_numbers,
        stamps=st.tuples(times, times),
        how=rules,
    )
    def ask_full(
        self,
        number: int,
        pair: tuple[int, int],
        through: int,
        stamps: tuple[int | None, int | None],
        how: Rule,
    ) -> None:
        reads, state = self.reader(number)
        target, source, fixed = (self.frame(i, state) for i in (*pair, through))
        first, second = self.maybe_at(stamps[0]), self.maybe_at(stamps[1])
        policy = how.policy(self.tick)
        question = (target, first, source, second, fixed, policy)
        expected = outcome(
            lambda: self.model.lookup_full((target, first), (source, second), fixed, policy, state)
        )
        assert reads.can_transform_full(*question) == isinstance(expected, Answer)
        if isinstance(expected, Refused):
            refuses(expected, lambda: reads.lookup_transform_full(*question))
        else:
            same_report(reads.lookup_transform_full(*question), expected)

    @rule(
        number=readers,
        pair=pairs_asked,
        stamps=st.lists(ticks, min_size=1, max_size=40),
        how=rules,
        is_sorted=st.booleans(),
    )
    def ask_many(
        self,
        number: int,
        pair: tuple[int, int],
        stamps: list[int],
        how: Rule,
        is_sorted: bool,
    ) -> None:
        """Batches are equal to single lookups, and refuse as the first of them that does."""
        reads, state = self.reader(number)
        target, source = (self.frame(i, state) for i in pair)
        policy = how.policy(self.tick)
        at = [self.at(t) for t in stamps]
        if is_sorted:
            at.sort()
        singles = [
            outcome(partial(self.model.lookup, target, source, t, policy, state)) for t in at
        ]
        points = np.array([random_pose(i)[:3] for i in range(len(at))])
        refusals = [(i, single) for i, single in enumerate(singles) if isinstance(single, Refused)]
        nan = partial(reads.lookup_transforms, target, source, at, policy, missing="nan")
        if refusals:
            index, refused = refusals[0]
            if refused.kind is not tfdb.UnknownFrame:
                refused.fields["index"] = index
            refuses(refused, partial(reads.lookup_transforms, target, source, at, policy))
            refuses(refused, partial(reads.transform_points, target, source, points, at, policy))
            if refused.kind is tfdb.UnknownFrame:
                refuses(refused, nan)
                return
        found = nan()
        self.check_rows(reads, (target, source, policy), at, singles, found)
        if not refusals:
            same = reads.lookup_transforms(target, source, at, policy)
            np.testing.assert_array_equal(same, found)
            moved = reads.transform_points(target, source, points, at, policy)
            for point, row, stamp in zip(points, moved, at, strict=True):
                single = reads.lookup_transform(target, source, stamp, policy)
                scale = max(1.0, np.abs(row).max())
                np.testing.assert_allclose(row / scale, single.apply(point) / scale, atol=1e-12)

    def check_rows(
        self,
        reads: tfdb.Reads,
        question: tuple[str, str, tfdb.Policy],
        at: list[int],
        singles: list[Answer | Refused],
        found: np.ndarray[Any, np.dtype[np.float64]],
    ) -> None:
        target, source, policy = question
        for row, stamp, single in zip(found, at, singles, strict=True):
            if isinstance(single, Refused):
                assert np.isnan(row).all()
            else:
                close(row, single.pose, 1e-9)
                close(row, reads.lookup_transform(target, source, stamp, policy).pose, 1e-12)
        matrices = reads.lookup_transforms(
            target, source, at, policy, layout="matrix", missing="nan"
        )
        for matrix, stamp, single in zip(matrices, at, singles, strict=True):
            if isinstance(single, Refused):
                assert np.isnan(matrix).all()
            else:
                expected = reads.lookup_transform(target, source, stamp, policy).matrix
                scale = max(1.0, np.abs(expected).max())
                np.testing.assert_allclose(matrix / scale, expected / scale, rtol=0, atol=1e-12)

    @rule(number=readers, time=ticks)
    def look_around(self, number: int, time: int) -> None:
        """Frames, samples and the tree at a stamp."""
        reads, state = self.reader(number)
        same_frames(reads, self.model, state)
        at = self.at(time)
        for info in reads.tree(at):
            frame = self.model.find(info.name, state)
            assert frame is not None
            parent = self.model.parent_at(frame, at, tfdb.Interpolate(), state)
            assert info.parent == (None if parent is None else self.model.frames[parent].name)
        for name in (*NAMES, UNKNOWN):
            assert reads.frame_exists(name) == (self.model.find(name, state) is not None)

    @invariant()
    def commits_are_counted(self) -> None:
        if hasattr(self, "model"):
            assert self.buffer.commit == self.model.commit

    def teardown(self) -> None:
        for held in getattr(self, "held", []):
            assert self.say(held.snapshot) == held.said
            held.snapshot.close()
        if hasattr(self, "model"):
            same_frames(self.buffer, self.model, self.model.commit)


def test_the_store_does_what_the_model_does() -> None:
    print(f"seed {SEED}")
    run_state_machine_as_test(seed(SEED)(Store), settings=SETTINGS)

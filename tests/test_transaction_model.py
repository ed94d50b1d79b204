"""A transaction sees and leaves what the same calls, made one by one, would show and leave."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

import tfdb
from oracle import quaternion

FRAMES = ("a", "b", "c", "d", "e")
STAMPS = range(0, 90, 10)
TURNS = [quaternion((1, -2, 0.5), 0.9), quaternion((0, 1, 3), -1.4), quaternion((2, 1, 0), 2.5)]

frames = st.sampled_from(FRAMES)
stamps = st.sampled_from(STAMPS)
poses = st.tuples(st.integers(-3, 3), st.sampled_from(TURNS))
members = st.tuples(frames, frames, stamps, poses)


def stamped(member: Any) -> tfdb.TransformStamped:
    parent, child, stamp, (x, turn) = member
    return tfdb.TransformStamped(parent, child, stamp, (x, 1, 2), turn)


calls = st.one_of(
    st.tuples(st.just("set"), members),
    st.tuples(st.just("set"), members),
    st.tuples(st.just("batch"), st.lists(members, min_size=1, max_size=4)),
    st.tuples(st.just("static"), st.tuples(frames, frames, poses)),
    st.tuples(st.just("remove"), st.tuples(frames, st.booleans())),
    st.tuples(st.just("reparent"), st.tuples(frames, frames, st.none() | stamps)),
)


def apply(writes: Any, call: Any) -> None:
    """Make one call on a store or in a transaction."""
    kind, given_ = call
    if kind == "set":
        one = stamped(given_)
        writes.set_transform(one.parent, one.child, one.stamp, one.translation, one.rotation)
    elif kind == "batch":
        writes.set_transforms([stamped(member) for member in given_])
    elif kind == "static":
        parent, child, (x, turn) = given_
        writes.set_static_transform(parent, child, (x, 1, 2), turn)
    elif kind == "remove":
        writes.remove_frame(given_[0], recursive=given_[1])
    elif isinstance(writes, tfdb.Transaction):
        writes.reparent(*given_)
    else:
        child, parent, stamp = given_
        pose = writes.lookup_transform(parent, child, stamp)
        if stamp is None:
            writes.set_static_transform(parent, child, pose.translation, pose.rotation)
        else:
            writes.set_transform(parent, child, stamp, pose.translation, pose.rotation)


def outcome(call: Any) -> Any:
    """What a lookup gives: the pose and the samples used, or the error.

    Where several edges have no answer, any of them may be named.
    """
    try:
        found = call()
    except tfdb.TfdbError as error:
        return type(error), error.frame  # of an UnknownFrame
    edges = [(e.child, e.parent, e.used, e.before, e.after) for e in found.report.edges]
    return edges, found.stamp, found.pose.round(9).tolist()


def answers(reads: Any) -> dict[Any, Any]:
    """Every lookup there is among few frames and stamps."""
    result: dict[Any, Any] = {}
    for target in FRAMES:
        for source in FRAMES:
            result[target, source, "latest"] = outcome(
                lambda t=target, s=source: reads.lookup_latest_transform(t, s)
            )
            for stamp in (None, *STAMPS, 25):
                result[target, source, stamp] = outcome(
                    lambda t=target, s=source, when=stamp: reads.lookup_transform(t, s, when)
                )
    return result


def contents(buffer: tfdb.Buffer) -> Any:
    names = buffer.frames()
    stored = [(s.tolist(), p.round(9).tolist(), n) for s, p, n in map(buffer.samples, names)]
    return names, stored, [(i.parent, i.is_static) for i in buffer.tree()]


def refused(writes: Any, call: Any) -> type[tfdb.TfdbError] | None:
    try:
        apply(writes, call)
    except tfdb.TfdbError as error:
        return type(error)
    return None


@pytest.mark.parametrize("engine", ["snapshot", "2pl-wait-die"])
@pytest.mark.parametrize("history", [None, 45e-9])
@given(before=st.lists(calls, max_size=5), within=st.lists(calls, min_size=1, max_size=6))
def test_a_transaction_is_its_calls_one_by_one(
    engine: Any, history: float | None, before: list[Any], within: list[Any]
) -> None:
    plain = tfdb.Buffer(history, concurrency=engine)
    store = tfdb.Buffer(history, concurrency=engine)
    for call in before:
        assert refused(plain, call) == refused(store, call)
    untouched = contents(store)
    cycle = False

    def work() -> None:
        nonlocal cycle
        with store.transaction() as tx:
            for call in within:
                error = refused(plain, call)
                also = refused(tx, call)
                if error is tfdb.CycleError and also is None:
                    cycle = True  # it is found at the end
                    return
                # Of a batch with a cycle in it, others may be refused at once.
                assert also == error or (also is not None and error is tfdb.CycleError), call
                assert answers(tx) == answers(plain)

    if not within_closes_a_cycle(work):
        assert not cycle
        assert contents(store) == contents(plain)
        assert answers(store) == answers(plain)
    else:
        assert cycle
        assert contents(store) == untouched


def within_closes_a_cycle(work: Any) -> bool:
    try:
        work()
    except tfdb.CycleError:
        return True
    return False

"""`explain` takes time in proportion to the path: each edge is examined once."""

from __future__ import annotations

import random
from dataclasses import replace
from typing import Any

import pytest

import tfdb
from oracle import quaternion
from tfdb.store.explain import _Case
from tfdb.store.summary import clocks

TURN = quaternion((1, -2, 0.5), 0.9)
POLICIES = (
    None,
    tfdb.Interpolate(max_gap=3e-9),
    tfdb.Exact(),
    tfdb.Previous(max_age=2e-9),
    tfdb.Nearest(tolerance=2e-9),
    tfdb.Extrapolate(max=3e-9),
)
FAILS = (
    tfdb.UnknownFrame,
    tfdb.Disconnected,
    tfdb.Extrapolation,
    tfdb.errors.GapTooLarge,
    tfdb.errors.Stale,
    tfdb.errors.NoSampleNear,
)


def said(lookup: Any, *question: Any) -> tuple[Any, ...]:
    """The result of a lookup, or its complete error."""
    try:
        found = lookup(*question)
    except FAILS as error:
        return type(error), str(error), error.edge, error.stamp, error.oldest, error.newest
    return found.pose.tolist(), found.stamp, found.report.edges


@pytest.mark.parametrize("seed", range(30))
def test_an_edge_alone_answers_as_the_lookup_over_it(seed: int) -> None:
    rng = random.Random(seed)
    buffer = tfdb.Buffer(history=None)
    for n in range(60):
        child = rng.randrange(1, 8)
        parent = rng.randrange(0, child)  # no cycles
        pose = ((n, 1, 2), TURN)
        buffer.set_transform(f"f{parent}", f"f{child}", rng.randrange(5, 40), *pose)
    buffer.set_static_transform("f3", "camera", (1, 2, 3), TURN)
    judged = failed = 0
    with buffer.snapshot() as snapshot:
        for stamp in range(0, 45, 3):
            for info in snapshot.tree(stamp):
                if info.parent is None:
                    continue
                for policy in POLICIES:
                    question = (info.parent, info.name, stamp, policy)
                    alone = said(snapshot._lookup_edge, *question)
                    if alone[0] is tfdb.Disconnected:
                        continue
                    assert alone == said(snapshot.lookup_transform, *question)
                    judged += 1
                    failed += isinstance(alone[0], type)
    assert judged > 300
    assert failed > 50


class Counting:
    """A snapshot whose lookups are counted."""

    def __init__(self, snapshot: tfdb.Snapshot) -> None:
        self.snapshot = snapshot
        self.walks = 0

    def lookup_transform(self, *question: Any) -> tfdb.Transform:
        self.walks += 1
        return self.snapshot.lookup_transform(*question)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.snapshot, name)


@pytest.mark.parametrize("stamp", [50, 150, 300])
def test_a_failing_chain_is_walked_once(stamp: int) -> None:
    buffer = tfdb.Buffer(history=None)
    for at in (100, 200):
        buffer.set_transforms(
            [
                tfdb.TransformStamped(
                    f"f{i}", f"f{i + 1}", at + 1000 * (i == 2000), (1, 2, 3), TURN
                )
                for i in range(8000)
            ]
        )
    with buffer.snapshot() as snapshot:
        counting: Any = Counting(snapshot)
        found = _Case(counting, "f0", "f8000", stamp, None).explain()
    assert counting.walks == 1
    assert len(found.edges) == 8000
    wrong = [edge for edge in found.edges if not edge.ok]
    assert len(wrong) == (1 if stamp == 150 else 8000)
    assert any(
        "T[f2000<-f2001]" in edge.text and "is before its first sample" in edge.text
        for edge in wrong
    )


class Name(str):
    """A name that counts how often it is hashed."""

    __slots__ = ()
    hashed = 0

    def __hash__(self) -> int:
        Name.hashed += 1
        return super().__hash__()

    __eq__ = str.__eq__


def test_the_clocks_of_many_edges_look_at_each_name_once() -> None:
    buffer = tfdb.Buffer(history=None)
    for n in range(500):
        buffer.set_transform("map", f"f{n:03}", 10 + n, (n, 1, 2), TURN)
    infos = [replace(info, name=Name(info.name)) for info in buffer.tree() if info.parent]
    Name.hashed = 0
    (clock,) = clocks(infos, buffer)
    assert Name.hashed < 5 * len(infos)
    assert (clock.start, clock.end) == (10, 509)
    assert clock.frames == tuple(f"f{n:03}" for n in range(500))

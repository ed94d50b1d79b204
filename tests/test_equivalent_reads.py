"""All reads of one transform agree, on random stores."""

from __future__ import annotations

import random
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from oracle import quaternion

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb import Buffer, Snapshot, Transaction

SEEDS = range(12)
NAMES = ["map", "odom", "base", "arm", "hand", "eye"]
LATEST = 60
POLICIES = [
    None,
    tfdb.Interpolate(2e-9),
    tfdb.Exact(),
    tfdb.Previous(),
    tfdb.Previous(3e-9),
    tfdb.Nearest(),
    tfdb.Nearest(2e-9),
    tfdb.Extrapolate(5e-9),
]


def random_store(rng: random.Random) -> Buffer:
    """Re-parenting, role swaps, late data, static edges, removals, clears, limited history."""
    buffer = tfdb.Buffer(history=rng.choice([None, 25e-9]))
    for commit in range(70):
        clock = LATEST * commit // 70
        parent, child = rng.sample(NAMES, 2)
        pose = [rng.uniform(-9, 9) for _ in range(3)]
        turn = quaternion((rng.uniform(0.1, 1), rng.uniform(-1, 1), 0.5), rng.uniform(-3.1, 3.1))
        with suppress(tfdb.TfdbError):
            if rng.random() < 0.05:
                buffer.set_static_transform(parent, child, pose, turn)
            elif rng.random() < 0.04:
                buffer.remove_frames(child, recursive=rng.random() < 0.5)
            elif rng.random() < 0.01:
                buffer.clear()
                buffer.compact()
            else:
                stamp = max(0, clock + rng.choice([0, 0, 1, 2, -1, -9, -20]))
                buffer.set_transform(parent, child, stamp, pose, turn)
    return buffer


Told = tuple[str, Any, Any]


def story(ask: Callable[[], Any]) -> Told:
    """The result bit for bit, or the error with all fields."""
    try:
        found = ask()
    except tfdb.TfdbError as error:
        return type(error).__name__, str(error), vars(error)
    if not isinstance(found, tfdb.Transform):
        return "value", found, None
    report = [(e.child, e.parent, e.used, e.before, e.after) for e in found.report.edges]
    return "answer", (found.pose.tobytes(), found.stamp, found.commit), report


def same_verdict(one: Told, other: Told) -> bool:
    """Like `==`, for results by another path: errors name other frames or halves."""
    return one == other if one[0] == "answer" else one[0] == other[0]


def check_explained(reads: Buffer | Snapshot, question: tuple[Any, ...], told: Told) -> None:
    explained = reads.explain(*question)
    assert explained.ok == (told[0] == "answer")
    if told[0] == "answer":
        edges = [(edge.child, edge.parent) for edge in explained.edges]
        assert edges == [(child, parent) for child, parent, *_ in told[2]]
    else:
        assert type(explained.error).__name__ == told[0]
        assert explained.text.startswith(told[1])


def check_question(
    ways: list[Buffer | Snapshot | Transaction],
    target: str,
    source: str,
    time: int | None,
    policy: tfdb.types.Policy | None,
) -> Told:
    """Call all kinds of reads; return their common result."""
    question = (target, source, time, policy)
    told = story(lambda: ways[0].lookup_transform(*question))
    for reads in ways:
        assert story(lambda reads=reads: reads.lookup_transform(*question)) == told
        assert reads.can_transform(*question) == (told[0] == "answer")
        common = story(lambda reads=reads: reads.latest_common_time(target, source))
        if time is None and common[0] == "value":
            newest = (target, source, common[1], policy)
            assert story(lambda reads=reads, q=newest: reads.lookup_transform(*q)) == told
            assert reads.common_times(target, source)[1] == common[1]
        elif time is None:
            assert common == told
        # Through one of the two frames, at equal times: one half is then the identity.
        for fixed in (target, source):
            full = (target, time, source, time, fixed, policy)
            through = story(lambda reads=reads, q=full: reads.lookup_transform_full(*q))
            if time is None:
                assert through[0] == told[0]
                continue
            assert same_verdict(through, told), (through, told)
            assert reads.can_transform_full(*full) == (told[0] == "answer")
        check_explained(reads, question, told)
        if time is not None and told[0] == "answer":
            rows = reads.lookup_transforms(target, source, [time], policy)
            single = np.frombuffer(told[1][0])
            sign = np.sign(rows[0, 3:] @ single[3:])
            rows[0, 3:] *= sign
            np.testing.assert_allclose(rows[0], single, rtol=0, atol=1e-9)
    return told


def check_cover(reads: Buffer, target: str, source: str) -> None:
    """Every stamp of the common times has a result, on the newest tree's path."""
    try:
        oldest, newest = reads.common_times(target, source)
    except (tfdb.Disconnected, tfdb.UnknownFrame):
        return
    frames = {
        (edge.child, edge.parent)
        for edge in reads.lookup_latest_transform(target, source).report.edges
    }
    for stamp in range(oldest, newest + 1):
        found = reads.lookup_transform(target, source, stamp)
        assert {(edge.child, edge.parent) for edge in found.report.edges} == frames
        for edge in found.report.edges:
            assert reads.parent_of(edge.child, stamp) == edge.parent


@pytest.mark.parametrize("seed", SEEDS)
def test_all_reads_agree(seed: int) -> None:
    print(f"seed {seed}")
    rng = random.Random(seed)
    buffer = random_store(rng)
    questions = [
        (
            rng.choice(NAMES),
            rng.choice(NAMES),
            rng.choice([None, *(rng.randrange(LATEST + 9) for _ in range(4))]),
            rng.choice(POLICIES),
        )
        for _ in range(250)
    ]
    with buffer.snapshot() as snapshot:
        told = [check_question([buffer, snapshot], *question) for question in questions]
    for target in NAMES:
        for source in NAMES:
            check_cover(buffer, target, source)
    with buffer.transaction() as tx:
        for question, before in zip(questions, told, strict=True):
            assert check_question([tx], *question) == before
    endings = [ending for ending, *_ in told]
    assert endings.count("answer") > 20
    assert len(set(endings)) > 2


def test_the_common_times_of_a_frame_and_itself_are_its_own() -> None:
    buffer = tfdb.Buffer(history=None)
    for stamp, parent in enumerate("aabb", 10):
        buffer.set_transform(parent, "x", stamp, (stamp, 1, 2), (0, 0.6, 0, 0.8))
    buffer.set_static_transform("x", "camera", (1, 2, 3))
    assert buffer.common_times("b", "x") == (12, 13)
    assert buffer.common_times("x", "x") == (10, 13)
    with buffer.snapshot() as snapshot:
        buffer.set_transform("a", "x", 7, (1, 1, 2), (0, 0.6, 0, 0.8))
        assert snapshot.common_times("x", "x") == (10, 13)
    assert buffer.common_times("x", "x") == (7, 13)
    assert buffer.common_times("camera", "camera") == (0, 0)
    assert buffer.common_times("a", "a") == (0, 0)
    buffer.clear()
    assert buffer.common_times("x", "x") == (0, 0)

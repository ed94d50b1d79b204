"""The checker against an oracle that tries every order, on small random histories."""

from __future__ import annotations

import random
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tfdb_measure.verify import History, check
from verify.serial import Shape, any_order, corrupt, random_history

SHAPES = {
    "static": Shape(6),
    "read-modify-write": Shape(6, edges=1, reads=2, writes=1),
    "no commit numbers": Shape(6, commits=False),
    "one edge, no numbers": Shape(6, edges=1, writes=1, commits=False),
    "stamps": Shape(6, stamps=4, edges=2, at=0.6),
    "stamps, no numbers": Shape(6, stamps=4, edges=2, at=0.6, commits=False),
    "removals": Shape(6, edges=2, removals=0.3),
    "removals, stamps": Shape(6, stamps=4, edges=2, at=0.5, removals=0.3),
    "removals, no numbers": Shape(6, stamps=3, edges=2, at=0.5, removals=0.3, commits=False),
    "own writes": Shape(6, stamps=3, edges=2, at=0.4, own=0.5, removals=0.1),
    "one thread": Shape(6, threads=1),
    "all at once": Shape(6, threads=6),
}
shapes = pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES.keys())


@shapes
@given(seed=st.integers(0, 2**32))
@settings(max_examples=40)
def test_serial_histories_pass(shape: Shape, seed: int) -> None:
    transactions = random_history(random.Random(seed), shape)
    verdict = check(History(transactions))
    assert verdict.serializable is True, verdict
    assert verdict.anomalies == []


@shapes
@given(seed=st.integers(0, 2**32), flaws=st.integers(1, 3))
@settings(max_examples=80)
def test_corrupted_histories_get_the_oracles_verdict(shape: Shape, seed: int, flaws: int) -> None:
    rng = random.Random(seed)
    transactions = random_history(rng, shape)
    for _ in range(flaws):
        transactions = corrupt(rng, transactions) or transactions
    verdict = check(History(transactions))
    assert verdict.serializable is any_order(transactions), verdict
    assert bool(verdict.anomalies) is not verdict.serializable


@shapes
@given(seed=st.integers(0, 2**32))
@settings(max_examples=40)
def test_unknown_ends_are_judged_as_by_trying_every_order(shape: Shape, seed: int) -> None:
    rng = random.Random(seed)
    transactions = corrupt(rng, random_history(rng, shape)) or []
    transactions = [
        replace(t, status="unknown", commit=None) if rng.random() < 0.3 else t for t in transactions
    ]
    assert check(History(transactions)).serializable is any_order(transactions)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("commits", [True, False])
def test_long_histories_pass(seed: int, commits: bool) -> None:
    shape = Shape(1000, threads=6, edges=5, stamps=2000, at=0.4, removals=0.02, commits=commits)
    transactions = random_history(random.Random(seed), shape)
    assert check(History(transactions)).serializable is True


@pytest.mark.parametrize("seed", range(12))
def test_one_flaw_in_a_long_history_is_found(seed: int) -> None:
    """A read that saw a value of long ago, or one of the far future."""
    rng = random.Random(seed)
    shape = Shape(600, threads=4, edges=3, commits=seed % 2 == 0)
    transactions = random_history(rng, shape)
    spot = rng.randrange(300, 600)
    while not transactions[spot].reads:
        spot -= 1
    one = transactions[spot]
    edge = one.reads[0].edge
    old = next(w.value for t in transactions[:100] for w in t.writes if w.edge == edge)
    spoiled = (one.reads[0]._replace(before=old), *one.reads[1:])
    transactions[spot] = replace(one, reads=spoiled)
    verdict = check(History(transactions))
    assert verdict.serializable is False
    assert any(one.id in anomaly.transactions for anomaly in verdict.anomalies)

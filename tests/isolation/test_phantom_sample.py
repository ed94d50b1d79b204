"""phantom_sample: a sample that would have changed an answer, had it been there."""

from __future__ import annotations

from typing import Any

import pytest

from isolation.actors import Actor, actors, directions, number, store, write
from isolation.engines import atomic_engines
from isolation.phantoms import cross, in_some_order


def inserted(engine: str, down: bool, stamp: int | None) -> tuple[int | None, int | None]:
    """Between two samples (x is 15 at 30), or as newest (x is 20 at 40)."""
    buffer = store(engine, x=10, mark=70)
    write(buffer, "x", 40, 20)
    return cross(
        buffer,
        down,
        lambda tx: number(tx, "x", down, stamp),
        lambda tx, seen: write(tx, "x", stamp or 60, seen),
    )


@directions
@atomic_engines
@pytest.mark.parametrize(("stamp", "before"), [(30, 15), (None, 20)], ids=["between", "newest"])
def test_the_answer_and_the_sample_have_an_order(
    engine: str, down: bool, stamp: int | None, before: int
) -> None:
    assert in_some_order(inserted(engine, down, stamp), before, 70)


@directions
def test_fine_shows_it(down: bool) -> None:
    assert inserted("fine", down, 30) == (15, 70)


@directions
@atomic_engines
@pytest.mark.parametrize("stamp", [30, 35, 25])
def test_the_same_question_has_one_answer(engine: str, down: bool, stamp: int) -> None:
    """A late sample between two reads of one transaction."""
    buffer = store(engine, x=10)
    write(buffer, "x", 40, 20)

    def read(tx: Any) -> int:
        return number(tx, "x", down, 30)

    with actors(buffer, 2) as (reader, writer):
        one: Actor = reader
        before = one.begins(read).result()
        change = writer.rebuilds(write, buffer, "x", stamp, 99)
        after = one.does(read).result()
        committed = one.ends().result()
        change.result()
    assert before == 15
    assert after == 15 or not committed
    assert number(buffer, "x", down, stamp) == 99

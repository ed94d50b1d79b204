"""lost_update: two transactions read a number and write one more; both must count."""

from __future__ import annotations

from typing import Any

from isolation.actors import actors, directions, interleaved, number, store, write
from isolation.engines import atomic_engines


def both_add_one(engine: str, down: bool) -> tuple[int, int]:
    """How many of the two committed, and the number then."""
    buffer = store(engine, x=5, y=0)

    def read(tx: Any) -> int:
        return number(tx, "x", down)

    def change(tx: Any, seen: int) -> None:
        write(tx, "x", 30, 77)
        write(tx, "x", 30, seen + 1)

    outcomes = interleaved(buffer, (read, change), (read, change))
    return sum(one.committed for one in outcomes), number(buffer, "x", down)


@directions
@atomic_engines
def test_no_increment_is_lost(engine: str, down: bool) -> None:
    committed, after = both_add_one(engine, down)
    assert committed >= 1
    assert after == 5 + committed


@directions
def test_fine_loses_one(down: bool) -> None:
    assert both_add_one("fine", down) == (2, 6)


@directions
@atomic_engines
def test_run_tries_again_until_all_count(engine: str, down: bool) -> None:
    buffer = store(engine, x=0)

    def increment(tx: Any) -> None:
        seen = number(tx, "x", down)
        write(tx, "x", 100 + seen, seen + 1)

    def work() -> None:
        for _ in range(25):
            buffer.run(increment, retries=1000)

    with actors(buffer, 3) as several:
        for future in [actor.start(work) for actor in several]:
            future.result()
    assert number(buffer, "x", down) == 75

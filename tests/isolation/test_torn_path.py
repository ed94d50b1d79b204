"""torn_path: of two commits one after the other, nobody sees the later one without the earlier."""

from __future__ import annotations

from typing import Any

from isolation.actors import actors, directions, number, store, write
from isolation.engines import atomic_engines


def seen_around_two_commits(engine: str, down: bool) -> tuple[int, int] | None:
    """One transaction reads x, others commit x and then y, it reads y."""
    buffer = store(engine, x=1, y=1)
    with actors(buffer, 2) as (reader, writer):
        x = reader.begins(lambda tx: number(tx, "x", down)).result()

        def both() -> None:
            write(buffer, "x", 30, 2)
            write(buffer, "y", 30, 2)

        commits = writer.commits(both)
        y = reader.does(lambda tx: number(tx, "y", down)).result()
        committed = reader.ends().result()
        commits.result()
    return (x, y) if committed else None


@directions
@atomic_engines
def test_no_effect_without_what_came_before(engine: str, down: bool) -> None:
    assert seen_around_two_commits(engine, down) in {(1, 1), None}


@directions
def test_fine_shows_it(down: bool) -> None:
    assert seen_around_two_commits("fine", down) == (1, 2)


@directions
@atomic_engines
def test_single_lookups_beside_two_writes(engine: str, down: bool) -> None:
    """x is always written before y: y is never ahead of x, and at most one behind."""
    buffer = store(engine, x=0, y=0)
    rounds = 1500
    with actors(buffer, 2) as (writer, reader):

        def writes() -> None:
            for i in range(1, rounds):
                write(buffer, "x", 20 + i, i)
                write(buffer, "y", 20 + i, i)

        def reads() -> list[int]:
            return [ahead(buffer, down) for _ in range(rounds)]

        work = writer.start(writes)
        assert set(reader.start(reads).result()) <= {0, 1}
        work.result()


def ahead(place: Any, down: bool) -> int:
    """How far x is ahead of y, by one lookup between them."""
    found = place.lookup_latest_transform("y", "x") if down else None
    if found is None:
        found = place.lookup_latest_transform("x", "y").inverse()
    # T[y<-x] turns the way along the map's x axis into that of y.
    return round(abs(found.translation).max())

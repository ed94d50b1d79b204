"""torn_batch: one commit writes two frames; nobody sees one of them new and the other old."""

from __future__ import annotations

from isolation.actors import actors, directions, number, store, write_all
from isolation.engines import atomic_engines


def seen_around_a_batch(engine: str, down: bool) -> tuple[int, int] | None:
    """What one transaction sees of x before and of y after a commit of both; None: it has lost."""
    buffer = store(engine, x=1, y=1)
    with actors(buffer, 2) as (reader, writer):
        x = reader.begins(lambda tx: number(tx, "x", down)).result()
        batch = writer.commits(lambda: write_all(buffer, 30, x=2, y=2))
        y = reader.does(lambda tx: number(tx, "y", down)).result()
        committed = reader.ends().result()
        batch.result()
    assert (number(buffer, "x", down), number(buffer, "y", down)) == (2, 2)
    return (x, y) if committed else None


@directions
@atomic_engines
def test_all_or_nothing_of_a_batch(engine: str, down: bool) -> None:
    assert seen_around_a_batch(engine, down) in {(1, 1), None}


@directions
def test_fine_shows_half(down: bool) -> None:
    assert seen_around_a_batch("fine", down) == (1, 2)


@directions
@atomic_engines
def test_one_lookup_along_both_frames(engine: str, down: bool) -> None:
    """T[x<-y] stays the same in every commit, whatever x and y are."""
    buffer = store(engine, x=0, y=0)
    rounds = 1500
    with actors(buffer, 3) as (writer, *readers):

        def writes() -> None:
            for i in range(1, rounds):
                write_all(buffer, 20 + i, x=i, y=i)

        def reads() -> int:
            names = ("x", "y") if down else ("y", "x")
            torn = 0
            for _ in range(rounds):
                torn += abs(buffer.lookup_latest_transform(*names).translation).max() > 1e-9
                torn += abs(buffer.lookup_transform(*names).translation).max() > 1e-9
            return torn

        work = writer.start(writes)
        assert [future.result() for future in [r.start(reads) for r in readers]] == [0, 0]
        work.result()

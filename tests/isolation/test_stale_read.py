"""stale_read: what was committed before a read began is seen by it, however it reads."""

from __future__ import annotations

from typing import Any

from isolation.actors import actors, directions, number, store, write, write_all
from isolation.engines import every_engine


@directions
@every_engine
def test_a_commit_is_seen_by_every_later_read(engine: str, down: bool) -> None:
    buffer = store(engine, x=0, y=0)

    def in_transaction() -> tuple[int, int]:
        with buffer.transaction() as tx:
            return number(tx, "x", down), number(tx, "y", down)

    def in_snapshot() -> tuple[int, int]:
        with buffer.snapshot() as held:
            return number(held, "x", down), number(held, "y", down)

    def alone() -> tuple[int, int]:
        return number(buffer, "x", down), number(buffer, "y", down)

    with actors(buffer, 2) as (writer, reader):
        for i in range(1, 60):
            writer.start(lambda i=i: write_all(buffer, 20 + i, x=i, y=-i)).result()
            for read in (in_transaction, in_snapshot, alone):
                assert reader.start(read).result() == (i, -i)
                assert writer.start(read).result() == (i, -i)


@directions
@every_engine
def test_a_transaction_is_seen_by_every_later_read(engine: str, down: bool) -> None:
    buffer = store(engine, x=0)

    def change(i: int) -> int:
        with buffer.transaction() as tx:
            write(tx, "x", 20 + i, i)
            return number(tx, "x", down)

    def read() -> int:
        return number(buffer, "x", down)

    def read_again(tx: Any) -> int:
        return number(tx, "x", down)

    with actors(buffer, 2) as (writer, reader):
        for i in range(1, 60):
            assert writer.start(change, i).result() == i
            assert reader.start(read).result() == i
            assert reader.start(buffer.run, read_again).result() == i

"""write_skew: each goes off duty if it has seen both on duty; one of them has to stay."""

from __future__ import annotations

from typing import Any

from isolation.actors import directions, interleaved, number, store, write
from isolation.engines import atomic_engines


def both_leave(engine: str, down: bool) -> int:
    """How many are on duty in the end."""
    buffer = store(engine, x=1, y=1)

    def read(tx: Any) -> int:
        return number(tx, "x", down) + number(tx, "y", down)

    def leave(frame: str) -> Any:
        def change(tx: Any, seen: int) -> None:
            if seen == 2:
                write(tx, frame, 30, 0)

        return change

    interleaved(buffer, (read, leave("x")), (read, leave("y")))
    return number(buffer, "x", down) + number(buffer, "y", down)


@directions
@atomic_engines
def test_one_stays(engine: str, down: bool) -> None:
    assert both_leave(engine, down) == 1


@directions
def test_in_fine_both_leave(down: bool) -> None:
    assert both_leave("fine", down) == 0

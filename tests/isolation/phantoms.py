"""One transaction writes down what it sees; another changes that, by what was written down."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from isolation.actors import interleaved, number, write

if TYPE_CHECKING:
    from collections.abc import Callable

    import tfdb


def cross(
    buffer: tfdb.Buffer,
    down: bool,
    answer: Callable[[Any], int],
    change: Callable[[Any, int], None],
) -> tuple[int | None, int | None]:
    """Return what is written down, and what the answer was changed to; None for who has lost."""
    first, second = interleaved(
        buffer,
        (answer, lambda tx, seen: write(tx, "mark", 50, seen)),
        (lambda tx: number(tx, "mark", down), change),
    )
    return (
        first.seen if first.committed else None,
        second.seen if second.committed else None,
    )


def in_some_order(outcome: tuple[int | None, int | None], before: int, mark: int) -> bool:
    """Is this one after the other? `before`: the answer at first; `mark`: the mark at first."""
    return outcome in {(before, before), (mark, mark), (before, None), (None, mark)}

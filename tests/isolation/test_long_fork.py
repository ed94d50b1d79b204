"""long_fork: two commits that do not know each other are seen in one order by everybody."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from isolation.actors import WAITING, Actor, actors, directions, number, store, write
from isolation.engines import atomic_engines

if TYPE_CHECKING:
    from concurrent.futures import Future


def forks(engine: str, down: bool) -> list[tuple[int, int] | None]:
    """What two readers see of x and y, read in opposite orders, with a commit before each read."""
    buffer = store(engine, x=1, y=1)
    with actors(buffer, 4) as (one, two, of_x, of_y):

        def reads(actor: Actor, first: bool, frame: str) -> Future[Any]:
            def step(tx: Any) -> int:
                return number(tx, frame, down)

            future = actor.begins(step) if first else actor.does(step)
            # Who reads behind a waiting writer may have to wait, too.
            if engine not in WAITING or (first and engine != "giant"):
                future.result()
            return future

        x_of_one = reads(one, True, "x")
        x_written = of_x.commits(write, buffer, "x", 30, 2)
        y_of_two = reads(two, True, "y")
        y_written = of_y.commits(write, buffer, "y", 30, 2)
        y_of_one = reads(one, False, "y")
        one_ended = one.ends()
        x_of_two = reads(two, False, "x")
        two_ended = two.ends()
        seen = [
            (x.result(), y.result()) if end.result() else None
            for x, y, end in ((x_of_one, y_of_one, one_ended), (x_of_two, y_of_two, two_ended))
        ]
        x_written.result()
        y_written.result()
    return seen


@directions
@atomic_engines
def test_no_two_readers_disagree(engine: str, down: bool) -> None:
    seen = forks(engine, down)
    assert seen != [(1, 2), (2, 1)]


@directions
def test_fine_shows_it(down: bool) -> None:
    assert forks("fine", down) == [(1, 2), (2, 1)]

"""phantom_reparent: a new parent, or a frame that comes or goes, would have changed an answer."""

from __future__ import annotations

from typing import Any

from isolation.actors import TURN, actors, directions, number, store, write
from isolation.engines import atomic_engines
from isolation.phantoms import cross, in_some_order

# y lies 100 along x from the map and is turned: what stands still in the map moves below y.
BASES = {"x": 15, "y": 100, "mark": 70}


def moved(engine: str, down: bool) -> tuple[int | None, int | None]:
    """The second transaction hangs x below y, so that T[map<-x] is at what it has seen."""
    buffer = store(engine, **BASES)

    def change(tx: Any, seen: int) -> None:
        write(tx, "x", 30, seen)
        place = tx.lookup_latest_transform("map", "x")
        tx.reparent("x", "y", 30, *relative(tx, place))

    return cross(buffer, down, lambda tx: number(tx, "x", down), change)


def relative(tx: Any, place: Any) -> tuple[Any, Any]:
    """T[y<-x] from T[map<-x], as both are newest."""
    pose = tx.lookup_latest_transform("y", "map") @ place
    return pose.translation, pose.rotation


@directions
@atomic_engines
def test_the_answer_and_the_parent_have_an_order(engine: str, down: bool) -> None:
    assert in_some_order(moved(engine, down), 15, 70)


@directions
def test_fine_shows_it(down: bool) -> None:
    assert moved("fine", down) == (15, 70)


@directions
@atomic_engines
def test_the_same_path_has_one_answer(engine: str, down: bool) -> None:
    """A new parent, under other rotation, between two reads of one transaction."""
    buffer = store(engine, **BASES)
    with actors(buffer, 2) as (reader, writer):
        before = reader.begins(lambda tx: number(tx, "x", down)).result()
        change = writer.rebuilds(write, buffer, "x", 30, 99, "y")
        after = reader.does(lambda tx: number(tx, "x", down)).result()
        committed = reader.ends().result()
        change.result()
    assert before == 15
    assert after == 15 or not committed
    assert buffer.frame_info("x").parent == "y"


@directions
@atomic_engines
def test_a_frame_comes_or_was_there(engine: str, down: bool) -> None:
    outcome = cross(
        store(engine, x=15, mark=70),
        down,
        lambda tx: number(tx, "new", down) if tx.frame_exists("new") else 15,
        lambda tx, seen: tx.set_transform("map", "new", 30, (seen, 2, 3), TURN),
    )
    assert in_some_order(outcome, 15, 70)


@directions
@atomic_engines
def test_a_frame_goes_or_is_still_there(engine: str, down: bool) -> None:
    """The second transaction removes x and leaves a note of what it knew."""
    buffer = store(engine, x=15, mark=70, note=0)

    def change(tx: Any, seen: int) -> None:
        tx.remove_frame("x")
        write(tx, "note", 30, seen)

    seen, known = cross(
        buffer, down, lambda tx: number(tx, "x", down) if tx.frame_exists("x") else 70, change
    )
    assert in_some_order((seen, known), 15, 70)
    assert buffer.frame_exists("x") is (known is None)

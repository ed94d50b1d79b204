"""Threads that do one step after another, in the order that a test decides."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, NamedTuple

import pytest

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

# T[b<-a] is never the identity, nor is any rotation.
TURN = (0.5, -0.5, 0.5, 0.5)

# Where a writer waits for open transactions that have read what it writes.
WAITING = {"giant", "2pl-no-wait", "2pl-wait-die", "2pl-wound-wait"}
# Where a late sample or a new parent waits for all open transactions.
WAITING_FOR_ALL = {*WAITING, "silo", "fine"}

directions = pytest.mark.parametrize("down", [True, False], ids=["down", "up"])


class Actor:
    """A thread of its own, and perhaps a transaction in it."""

    def __init__(self, buffer: tfdb.Buffer) -> None:
        self.buffer = buffer
        self._thread = ThreadPoolExecutor(max_workers=1)
        self._tx: Any = None

    def start(self, step: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Begin a step; it may have to wait for somebody."""
        return self._thread.submit(step, *arguments)

    def commits(self, step: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """Write newer samples; waited for unless the engine makes it wait for a transaction."""
        future = self.start(step, *arguments)
        if self.buffer.concurrency not in WAITING:
            future.result()
        return future

    def rebuilds(self, step: Callable[..., Any], *arguments: Any) -> Future[Any]:
        """The same for any other commit."""
        future = self.start(step, *arguments)
        if self.buffer.concurrency not in WAITING_FOR_ALL:
            future.result()
        return future

    def begins(self, read: Callable[[Any], Any] = lambda tx: None) -> Future[Any]:
        """Begin a transaction with a read."""

        def work() -> Any:
            self._tx = self.buffer.transaction().__enter__()
            return self._step(read)

        return self.start(work)

    def does(self, step: Callable[[Any], Any]) -> Future[Any]:
        """A step in the transaction; None once it has lost."""
        return self.start(lambda: self._step(step))

    def ends(self) -> Future[bool]:
        """Commit; False if the transaction has lost."""

        def work() -> bool:
            if not self._tx.is_open:
                return False
            try:
                self._tx.__exit__(None, None, None)
            except tfdb.Conflict:
                return False
            return True

        return self.start(work)

    def _step(self, step: Callable[[Any], Any]) -> Any:
        try:
            return step(self._tx) if self._tx.is_open else None
        except tfdb.Conflict:
            return None

    def close(self) -> None:
        self._thread.shutdown()


@contextmanager
def actors(buffer: tfdb.Buffer, count: int) -> Iterator[list[Actor]]:
    """So many threads, whose steps are all over at the end."""
    made = [Actor(buffer) for _ in range(count)]
    try:
        yield made
    finally:
        for actor in made:
            actor.close()


class Outcome(NamedTuple):
    """What a transaction had read, and whether it committed."""

    committed: bool
    seen: Any


Script = tuple["Callable[[Any], Any]", "Callable[[Any, Any], None]"]


def interleaved(buffer: tfdb.Buffer, *scripts: Script) -> list[Outcome]:
    """Transactions that have all read before any of them writes what it makes of that.

    In `giant` one after the other: there a transaction keeps everybody else out.
    """
    with actors(buffer, len(scripts)) as several:
        seen = []
        for actor, (read, _) in zip(several, scripts, strict=True):
            seen.append(actor.begins(read))
            if buffer.concurrency != "giant":
                seen[-1].result()
        ended = []
        for actor, (_, change), future in zip(several, scripts, seen, strict=True):
            actor.does(lambda tx, c=change, f=future: c(tx, f.result()))
            ended.append(actor.ends())
        return [Outcome(end.result(), read.result()) for end, read in zip(ended, seen, strict=True)]


def store(engine: str, **edges: float) -> tfdb.Buffer:
    """Frames below `map`, each with one number at stamp 20."""
    buffer = tfdb.Buffer(history=None, concurrency=engine)
    wrong = [tfdb.TransformStamped("map", name, 20, (-1, 2, 3), TURN) for name in edges]
    right = [tfdb.TransformStamped("map", n, 20, (x, 2, 3), TURN) for n, x in edges.items()]
    buffer.set_transforms([*reversed(wrong), *right])
    return buffer


def write(place: Any, frame: str, stamp: int, number: float, parent: str = "map") -> None:
    place.set_transform(parent, frame, stamp, (number, 2, 3), TURN)


def write_all(buffer: tfdb.Buffer, stamp: int, **edges: float) -> None:
    """One batch, unsorted, each frame twice: the later member counts."""
    batch = [tfdb.TransformStamped("map", name, stamp, (-1, 2, 3), TURN) for name in edges]
    right = [tfdb.TransformStamped("map", n, stamp, (x, 2, 3), TURN) for n, x in edges.items()]
    buffer.set_transforms([*batch, *reversed(right)])


def number(place: Any, frame: str, down: bool, stamp: int | None = None) -> int:
    """The number of T[map<-frame], asked for in either direction; without a stamp the latest."""
    names = ("map", frame) if down else (frame, "map")
    found = (
        place.lookup_latest_transform(*names)
        if stamp is None
        else place.lookup_transform(*names, stamp)
    )
    return round((found if down else found.inverse()).translation[0])

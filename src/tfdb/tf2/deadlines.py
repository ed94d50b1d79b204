"""Deadlines of waits: by the system's clock, a node's simulated clock, and the node's end."""

from __future__ import annotations

import threading
import time
import weakref
from typing import TYPE_CHECKING, Protocol

from tfdb.ros.times import SECOND

from .timers import call_at

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb.ros import Node, Subscription

    from .buffer import Buffer

__all__ = ["Deadline", "deadline_in", "stop_with", "wait_until"]

JUMP = 3 * SECOND
"""As in tf2, a wait ends if simulated time jumps back by more than this, as when a bag restarts."""


class Timer(Protocol):
    """A pending call of a deadline."""

    def cancel(self) -> None:
        """Cancel the call."""


class Deadline(Protocol):
    """A time by some clock. Any thread may call it."""

    def left(self) -> int | None:
        """Nanoseconds left, 0 if it has passed; None: only the clock decides."""

    def call(self, called: Callable[[], None]) -> Timer:
        """Call a function once, in another thread, at the deadline."""


class _ClockTimer:
    """A timer by a node's clock."""

    def __init__(self, watch: Subscription) -> None:
        self._watch = watch

    def cancel(self) -> None:
        """Cancel the call."""
        self._watch.close()


class _WallDeadline:
    """A deadline by the system's steady clock."""

    def __init__(self, limit: int) -> None:
        self._until = time.monotonic_ns() + limit

    def left(self) -> int | None:
        return max(self._until - time.monotonic_ns(), 0)

    def call(self, called: Callable[[], None]) -> Timer:
        return call_at(self._until, called)


class _SimulatedDeadline:
    """A deadline by a node's simulated clock, which may pause, jump, and end with the node."""

    def __init__(self, node: Node, limit: int) -> None:
        self._node = node
        self._begin = node.now()
        self._until = self._begin + limit

    def _passed(self, now: int) -> bool:
        return not self._begin - JUMP <= now < self._until or self._node.closed

    def left(self) -> int | None:
        return 0 if self._passed(self._node.now()) else None

    def call(self, called: Callable[[], None]) -> Timer:
        once = threading.Lock()

        def look(now: int) -> None:
            if self._passed(now) and once.acquire(blocking=False):
                called()

        watch = self._node.on_clock(look)
        look(self._node.now())
        return _ClockTimer(watch)


def stop_with(node: Node, buffer: Buffer) -> None:
    """End all waits on a buffer, and later ones, once its node ends, even by a signal.

    They end as after a timeout.
    """
    with _stopping:
        is_first = node not in _buffers
        buffers = _buffers.setdefault(node, weakref.WeakSet())
        buffers.add(buffer)

    def stop(_: int) -> None:
        if node.closed:
            for each in list(buffers):
                if each.clock == node:
                    each.buffer._stop_waits(stop=True)

    buffer.buffer._stop_waits(stop=False)
    if is_first:
        node.on_clock(stop)
    else:
        stop(0)  # the node may have ended


# A signal handler may call this during another call.
_stopping = threading.RLock()
_buffers: weakref.WeakKeyDictionary[Node, weakref.WeakSet[Buffer]] = weakref.WeakKeyDictionary()


def deadline_in(limit: int, clock: Node | None) -> Deadline:
    """Return the deadline after some nanoseconds, by a node's clock or the system's."""
    if clock is not None and clock.simulated:
        return _SimulatedDeadline(clock, limit)
    return _WallDeadline(limit)


def wait_until(over: threading.Event, deadline: Deadline | None) -> None:
    """Wait for an event, at most until a deadline."""
    left = None if deadline is None else deadline.left()
    if deadline is None or left is not None:
        over.wait(None if left is None else left / SECOND)
        return
    timer = deadline.call(over.set)
    try:
        over.wait()
    finally:
        timer.cancel()

"""Timers of the steady clock: functions that one thread calls at a given time."""

from __future__ import annotations

import heapq
import logging
import os
import threading
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Timer", "call_at"]

LOGGER = logging.getLogger("tfdb.tf2")
LINGERS = 1.0  # seconds that the idle thread waits for a new timer
MANY = 1_000  # a longer heap is swept of cancelled timers


@dataclass(order=True, slots=True)
class Timer:
    """A pending call. Any thread may cancel it."""

    due: int
    """Nanoseconds of `time.monotonic_ns`."""
    called: Callable[[], None] | None = field(compare=False)
    """The function; None: cancelled."""

    def cancel(self) -> None:
        """Drop the call."""
        self.called = None


class _Clock:
    """The timers of the process and the thread that runs them. Thread-safe."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._timers: list[Timer] = []
        self._runs = False

    def set(self, timer: Timer) -> None:
        with self._changed:
            if len(self._timers) >= MANY:
                self._timers = [each for each in self._timers if each.called is not None]
                heapq.heapify(self._timers)
            heapq.heappush(self._timers, timer)
            if not self._runs:
                self._runs = True
                threading.Thread(target=self._run, name="tfdb timers", daemon=True).start()
            elif self._timers[0] is timer:
                self._changed.notify()

    def _next(self) -> Timer | None:
        """Wait for the next due timer; None: no timer was added for some time."""
        with self._changed:
            while True:
                while self._timers and self._timers[0].called is None:
                    heapq.heappop(self._timers)
                if not self._timers:
                    if self._changed.wait(LINGERS) or self._timers:
                        continue
                    self._runs = False
                    return None
                left = self._timers[0].due - time.monotonic_ns()
                if left <= 0:
                    return heapq.heappop(self._timers)
                self._changed.wait(left / 1e9)

    def _run(self) -> None:
        while (timer := self._next()) is not None:
            called = timer.called
            try:
                if called is not None:
                    called()
            except Exception:  # later timers still run
                LOGGER.exception("a timer's function raised")


_clock = _Clock()


def _forget_parent() -> None:
    global _clock  # noqa: PLW0603 - its thread is not in this process
    _clock = _Clock()


os.register_at_fork(after_in_child=_forget_parent)


def call_at(due: int, called: Callable[[], None]) -> Timer:
    """Call a function at a time of `time.monotonic_ns`. It must not block."""
    timer = Timer(due, called)
    _clock.set(timer)
    return timer

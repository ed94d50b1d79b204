"""Functions that are called at a time of the system's steady clock, all by one thread."""

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

__all__ = ["Alarm", "alarm_at"]

LOGGER = logging.getLogger("tfdb.tf2")
LINGERS = 1.0  # seconds that the thread stays for the next alarm
MANY = 1_000  # alarms of which most were cancelled are swept


@dataclass(order=True, slots=True)
class Alarm:
    """A call to come. Any thread may cancel it."""

    due: int
    """Nanoseconds of `time.monotonic_ns`."""
    called: Callable[[], None] | None = field(compare=False)
    """What is called; None: nothing any more."""

    def cancel(self) -> None:
        """Call no more."""
        self.called = None


class _Clock:
    """The alarms of the process, and the thread that calls. Any thread may set one."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._alarms: list[Alarm] = []
        self._runs = False

    def set(self, alarm: Alarm) -> None:
        with self._changed:
            if len(self._alarms) >= MANY:
                self._alarms = [each for each in self._alarms if each.called is not None]
                heapq.heapify(self._alarms)
            heapq.heappush(self._alarms, alarm)
            if not self._runs:
                self._runs = True
                threading.Thread(target=self._run, name="tfdb alarms", daemon=True).start()
            elif self._alarms[0] is alarm:
                self._changed.notify()

    def _next(self) -> Alarm | None:
        """Wait for the next that is due; None: for a while there was none."""
        with self._changed:
            while True:
                while self._alarms and self._alarms[0].called is None:
                    heapq.heappop(self._alarms)
                if not self._alarms:
                    if self._changed.wait(LINGERS) or self._alarms:
                        continue
                    self._runs = False
                    return None
                left = self._alarms[0].due - time.monotonic_ns()
                if left <= 0:
                    return heapq.heappop(self._alarms)
                self._changed.wait(left / 1e9)

    def _run(self) -> None:
        while (alarm := self._next()) is not None:
            called = alarm.called
            try:
                if called is not None:
                    called()
            except Exception:  # the next one is called all the same
                LOGGER.exception("what waited for a deadline raised")


_clock = _Clock()


def _forget_parent() -> None:
    global _clock  # noqa: PLW0603 - its thread is not in this process
    _clock = _Clock()


os.register_at_fork(after_in_child=_forget_parent)


def alarm_at(due: int, called: Callable[[], None]) -> Alarm:
    """Have a function called at a time of `time.monotonic_ns`. It must not block."""
    alarm = Alarm(due, called)
    _clock.set(alarm)
    return alarm

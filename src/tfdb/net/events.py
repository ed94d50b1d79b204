"""Events of homes and mirrors."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING, Literal, NamedTuple

from tfdb.data.errors import StreamClosed
from tfdb.streams.reader import Reader, deadline

if TYPE_CHECKING:
    from collections.abc import Callable

    import tfdb.data.types
    from tfdb.data.types import Epoch

LOGGER = logging.getLogger("tfdb.net")
_KEPT = 1000
_LOUD = ("rewound", "refused", "fenced", "unseen", "lapped", "ended")

Kind = Literal[
    "absent",
    "catching up",
    "live",
    "stale",
    "rewound",
    "refused",
    "fenced",
    "unseen",
    "lapped",
    "ended",
]


class Event(NamedTuple):
    """An event of a home or a mirror.

    `kind` is a new state of a mirror (`absent`, `catching up`, `live`, `stale`), or one of:
    `rewound` (a mirror went back from `before` to `after`), `refused` (a received message cannot be
    stored), `fenced` (the home stopped because of a later one), `unseen` (access control hides the
    home), `lapped` (commits came faster than the home could send them, so it sends a state),
    `ended` (by an error).
    """

    time: int
    """Time of the event, nanoseconds since 1970."""
    name: str
    """The namespace."""
    kind: str
    """The kind of event."""
    text: str
    """A description in one sentence."""
    before: tuple[tfdb.data.types.Epoch, int] | None = None
    """Of `rewound`: the mirror's old position. Of `fenced`: the last common commit of both homes,
    if known.
    """
    after: tuple[tfdb.data.types.Epoch, int] | None = None
    """Of `rewound`: the mirror's new position. Of `fenced`: the last commit of the stopped home."""

    def __str__(self) -> str:
        return f"{self.name}: {self.kind}: {self.text}"


class EventLog:
    """The last events of one home or mirror, for its streams. Threads: any."""

    def __init__(self, name: str) -> None:
        self.name: str = name
        self.changed: threading.Condition = threading.Condition()
        self.wakes: set[Callable[[], None]] = set()
        """Functions that wake coroutines. `changed` guards them."""
        self.closed: bool = False
        self._events: deque[Event] = deque(maxlen=_KEPT)
        self._count = 0

    def add(
        self,
        kind: Kind,
        text: str,
        before: tuple[Epoch, int] | None = None,
        after: tuple[Epoch, int] | None = None,
    ) -> None:
        """Store an event, and log it."""
        event = Event(time.time_ns(), self.name, kind, text, before, after)
        LOGGER.log(logging.WARNING if kind in _LOUD else logging.INFO, "%s", event)
        with self.changed:
            self._events.append(event)
            self._count += 1
            self.wake()

    def close(self) -> None:
        """End the reads after all events were read."""
        with self.changed:
            self.closed = True
            self.wake()

    def wake(self) -> None:
        """Wake all waiting reads, under `changed`."""
        self.changed.notify_all()
        for wake in tuple(self.wakes):
            wake()

    def after(self, number: int) -> tuple[int, Event | None]:
        """Return the next stored event after the first `number` events, and its own number."""
        begin = max(number, self._count - len(self._events))
        if begin == self._count:
            return begin, None
        return begin + 1, self._events[begin - self._count]


class NetEvents(Reader[Event]):
    """The events of a home or a mirror, each once, from the oldest of the last 1,000.

    `home.events()` and `mirror.events()` create it. Iterate over it by `for` or `async for`, or
    call `read_next`. It ends when it is closed, or when its home or mirror is closed.
    """

    def __init__(self, log: EventLog) -> None:
        self._log, self._read, self._closed = log, 0, False

    def read_next(self, timeout: float | None = 0) -> Event | None:
        """Read the next event.

        Parameters
        ----------
        timeout
            Seconds to wait for it; 0: do not wait; None: for ever.

        Returns
        -------
        Event or None
            None: it does not exist yet.

        Raises
        ------
        StreamClosed
            The stream is closed; or its home or mirror is closed, and all events were read.
        """
        until = deadline(timeout)
        with self._log.changed:
            while True:
                if self._closed:
                    raise StreamClosed("the stream of events is closed: call events() again")
                self._read, event = self._log.after(self._read)
                if event is not None:
                    return event
                if self._log.closed:
                    raise StreamClosed(f"{self._log.name} is closed: it has no more events")
                left = None if until is None else until - time.monotonic()
                if left is not None and left <= 0:
                    return None
                self._log.changed.wait(left)

    def close(self) -> None:
        """End the reads in all threads. A second call does nothing."""
        with self._log.changed:
            self._closed = True
            self._log.wake()

    async def __anext__(self) -> Event:
        loop, changed = asyncio.get_running_loop(), asyncio.Event()

        def wake() -> None:
            with suppress(RuntimeError):  # a closed loop has no waiting coroutine
                loop.call_soon_threadsafe(changed.set)

        with self._log.changed:
            self._log.wakes.add(wake)
        try:
            while (event := self.read_next()) is None:
                await changed.wait()
                changed.clear()
        except StreamClosed:
            raise StopAsyncIteration from None
        finally:
            with self._log.changed:
                self._log.wakes.discard(wake)
        return event

"""The class EventStream: the events of a buffer's expectations, each once."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING

from tfdb.data.argument_checks import check_count
from tfdb.data.errors import BufferClosed, StreamClosed
from tfdb.data.lazy_names import belong_to
from tfdb.streams.reader import Reader, deadline

if TYPE_CHECKING:
    from asyncio import AbstractEventLoop, Future

    from tfdb._core import Buffer

    from .events import Event

__all__ = ["EventStream"]

LOGGER = logging.getLogger("tfdb.expectations")
_LOOK = 1.0  # seconds between two checks whether the buffer was closed


class EventStream(Reader["Event"]):
    """The events of a buffer's expectations, in their order, each once.

    `Buffer.events()` creates it. Iterate over it by `for` or `async for`, or call `read_next`. It
    is a context manager; any thread may call `close()`, which ends all reads.
    """

    def __init__(self, buffer: Buffer, max_pending: int) -> None:
        self._buffer = buffer
        self._events: deque[Event] = deque()
        self._most = check_count("max_pending", max_pending)
        self._missed = 0
        self._closed = False
        self._error: BaseException | None = None
        self._lock = threading.Condition()
        self._waits: set[tuple[AbstractEventLoop, Future[None]]] = set()

    @property
    def missed(self) -> int:
        """Number of events that were dropped, because more than `max_pending` were unread."""
        return self._missed

    @property
    def closed(self) -> bool:
        """Whether `close` was called. A child of `fork` finds its streams closed."""
        return self._closed

    def close(self) -> None:
        """End the reads in all threads, and drop the unread events. A second call does nothing."""
        with self._lock:
            self._closed = True
            self._events.clear()
            self._wake()

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
        BufferClosed
            The buffer was closed, or its shared store removed, and all events were read.
        StreamClosed, InvalidArgument
        """
        until = deadline(timeout)
        with self._lock:
            while (event := self._next()) is None:
                left = None if until is None else until - time.monotonic()
                if left is not None and left <= 0:
                    return None
                self._lock.wait(_LOOK if left is None else min(left, _LOOK))
            return event

    async def __anext__(self) -> Event:
        import asyncio  # noqa: PLC0415 - it takes as long as all of tfdb

        loop = asyncio.get_running_loop()
        while True:
            wait = loop, loop.create_future()
            with self._lock:
                try:
                    event = self._next()
                except StreamClosed:
                    raise StopAsyncIteration from None
                if event is not None:
                    return event
                self._waits.add(wait)
            try:
                await asyncio.wait([wait[1]], timeout=_LOOK)
            finally:
                with self._lock:
                    self._waits.discard(wait)

    def _next(self) -> Event | None:
        if self._closed:
            raise StreamClosed("the stream is closed: make another by Buffer.events()")
        if self._events:
            return self._events.popleft()
        if self._error is not None:
            raise self._error.with_traceback(None)
        if self._buffer.closed:
            raise BufferClosed("the buffer was closed: it has no more events")
        return None

    def _end(self, error: BaseException) -> None:
        """Raise an error to readers, once all events were read."""
        with self._lock:
            self._error = error
            self._wake()

    def _put(self, event: Event) -> None:
        with self._lock:
            if self._closed:
                return
            if len(self._events) == self._most:
                self._events.popleft()
                self._missed += 1
                if self._missed == 1:
                    LOGGER.warning(
                        "a stream of events is not read: beyond %d, the oldest are dropped",
                        self._most,
                    )
            self._events.append(event)
            self._wake()

    def _wake(self) -> None:
        self._lock.notify_all()
        for loop, future in self._waits:
            with suppress(RuntimeError):  # a closed loop has no waiting coroutine
                loop.call_soon_threadsafe(_wake, future)
        self._waits.clear()

    def _abandon(self) -> None:
        """Close it in a child of fork, whose other threads are gone."""
        self._lock = threading.Condition()
        self._closed = True


def _wake(future: Future[None]) -> None:
    if not future.done():
        future.set_result(None)


belong_to("tfdb.judging", globals(), __all__)

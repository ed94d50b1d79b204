"""One thread for many connections."""

from __future__ import annotations

import heapq
import logging
import selectors
import socket
import threading
import time
from collections import deque
from typing import TYPE_CHECKING, TypeAlias

from tfdb.data.errors import CorruptMessage

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["LOG", "Loop", "warn_of_message"]

LOG = logging.getLogger("tfdb.ros")
Ready: TypeAlias = "Callable[[int], None]"  # called with selectors.EVENT_READ and EVENT_WRITE


def warn_of_message(topic: str, publisher: str, error: Exception) -> None:
    """Log a failed callback; callers call this once for each publisher."""
    LOG.warning(
        "a message of %s on %s: %s; logged once for each publisher",
        publisher,
        topic,
        error,
        exc_info=not isinstance(error, CorruptMessage),
    )


class Loop:
    """Calls functions for ready sockets, for requests of other threads, and for due times.

    Threads: any may call `soon` and `close`. Only the loop's thread may call the others; before
    `start`, the creating thread may.
    """

    def __init__(self, name: str) -> None:
        self._selector = selectors.DefaultSelector()
        self._asked: deque[Callable[[], None]] = deque()
        self._due: list[tuple[float, int, Callable[[], None]]] = []
        self._count = 0  # counts all calls: calls for the same time stay in order
        self._wake, woken = socket.socketpair()
        for end in (self._wake, woken):
            end.setblocking(False)  # noqa: FBT003
        self._woken = woken
        self.watch(woken, selectors.EVENT_READ, self._answer)
        self._closed = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def soon(self, action: Callable[[], None]) -> None:
        """Call a function in the loop's thread."""
        self._asked.append(action)
        try:
            self._wake.send(b"\0")
        except OSError:
            # The loop is already being woken, or has ended.
            return

    def later(self, seconds: float, action: Callable[[], None]) -> None:
        """Call a function after a delay."""
        self._count += 1
        heapq.heappush(self._due, (time.monotonic() + seconds, self._count, action))

    def watch(self, connection: socket.socket, events: int, ready: Ready) -> None:
        """Call `ready(events)` at one of `events`; a second call changes the events."""
        if connection.fileno() in self._selector.get_map():
            self._selector.modify(connection, events, ready)
        else:
            self._selector.register(connection, events, ready)

    def leave(self, connection: socket.socket) -> None:
        """Stop watching a socket."""
        self._selector.unregister(connection)

    def forget(self, connection: socket.socket) -> None:
        """Stop watching a socket, and close it."""
        if connection.fileno() >= 0:
            if connection.fileno() in self._selector.get_map():
                self._selector.unregister(connection)
            connection.close()

    def close(self) -> None:
        """End the loop, and close all watched sockets."""
        self.soon(self._end)
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join()

    def _end(self) -> None:
        self._closed = True

    def _answer(self, _: int) -> None:
        self._woken.recv(4096)
        for _ in range(len(self._asked)):
            _guarded(self._asked.popleft())

    def _run(self) -> None:
        while not self._closed:
            now = time.monotonic()
            while self._due and self._due[0][0] <= now:
                _guarded(heapq.heappop(self._due)[2])
            wait = max(0.0, self._due[0][0] - time.monotonic()) if self._due else None
            for key, events in self._selector.select(wait):
                # An earlier callback of this round may have closed it.
                if self._selector.get_map().get(key.fd) is key:
                    _guarded(key.data, events)
        for key in list(self._selector.get_map().values()):
            self._selector.unregister(key.fileobj)
            key.fileobj.close()  # type: ignore[union-attr]
        self._selector.close()
        self._wake.close()


def _guarded(action: Callable[..., None], *arguments: int) -> None:
    """Call it; an exception is logged, and the loop continues."""
    try:
        action(*arguments)
    except Exception:
        LOG.exception("an internal error of tfdb.ros")

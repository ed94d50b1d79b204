"""Functions that are called once a transform is available, or cannot become available any more."""

from __future__ import annotations

import enum
import logging
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import count
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb.store import waiting

    from .buffer import Buffer

__all__ = ["NEVER", "TransformableRequests", "TransformableResult"]

LOGGER = logging.getLogger("tfdb.tf2")
NEVER = 2**64 - 1
"""Handle of a request with a time out of the cache."""


class TransformableResult(enum.Enum):
    """The result of a request."""

    TransformAvailable = 0
    """The transform was available when the call was scheduled."""
    TransformFailure = 1
    """The transform cannot become available: its time is out of the cache, or the buffer was
    closed.
    """


@dataclass
class _Request:
    """One waiting request."""

    callback: Callable[[int, str, str, Any, TransformableResult], object]
    frames: tuple[str, str]
    time: Any
    waits: list[waiting.Wait] = field(default_factory=list)


class TransformableRequests:
    """Requests of a buffer, and the thread that calls their functions. Any thread may use it."""

    def __init__(self, buffer: Buffer) -> None:
        self._buffer = buffer
        self._lock = threading.Lock()
        self._requests: dict[int, _Request] = {}
        self._handles = count(1)
        self._caller: ThreadPoolExecutor | None = None

    def add(
        self,
        callback: Callable[[int, str, str, Any, TransformableResult], object],
        frames: tuple[str, str],
        time: Any,
    ) -> int:
        """Implements `Buffer.add_transformable_request`."""
        stamp = self._buffer._nanoseconds(time)
        handle = next(self._handles)
        request = _Request(callback, frames, time)
        with self._lock:
            self._requests[handle] = request
        failure = TransformableResult.TransformFailure
        begun = self._buffer._begin_request(
            frames,
            stamp,
            lambda result: self._end(handle, result or failure),
            lambda wait: self._hold(handle, wait),
        )
        if begun is None or self._taken(handle) is None:
            return handle
        return NEVER if begun is failure else 0

    def _hold(self, handle: int, wait: waiting.Wait) -> None:
        """Store a wait with its request, unless the request has ended."""
        with self._lock:
            request = self._requests.get(handle)
            if request is not None:
                request.waits.append(wait)
                return
        wait.cancel()

    def _end(self, handle: int, result: TransformableResult) -> None:
        """Call a request's function in the thread for it, unless it has ended already."""
        request = self._taken(handle)
        if request is not None:
            self.call(request.callback, handle, *request.frames, request.time, result)

    def _taken(self, handle: int) -> _Request | None:
        with self._lock:
            request = self._requests.pop(handle, None)
            waits = [] if request is None else [*request.waits]
        for wait in waits:
            wait.cancel()
        return request

    def call(self, function: Callable[..., object], *arguments: Any) -> None:
        """Call a function in its thread; exceptions are logged."""
        with self._lock:
            if self._caller is None:
                self._caller = ThreadPoolExecutor(1, thread_name_prefix="tfdb callbacks")
            self._caller.submit(_logged, function, *arguments)

    def cancel(self, handle: int) -> None:
        """Remove a request without calling its function."""
        self._taken(handle)


def _logged(function: Callable[..., object], *arguments: Any) -> None:
    try:
        function(*arguments)
    except Exception:  # the next function is called nevertheless
        LOGGER.exception("a callback of a transformable request raised")

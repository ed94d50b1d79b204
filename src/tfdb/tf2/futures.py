"""Futures: rclpy's if the program uses rclpy, otherwise those of asyncio or threads."""

# ruff: noqa: PLC0415  (rclpy is loaded by programs that use it)

from __future__ import annotations

import asyncio
import concurrent.futures
import sys
import threading
from contextlib import suppress
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

    from tfdb.ros import Node

__all__ = ["complete", "future_of_caller"]


_cancelling = threading.RLock()
NOT_DONE = (
    "the transform is not available yet: wait for it with result(timeout=seconds), with await, "
    "or with add_done_callback"
)


class _Awaited:
    """Can be awaited in an asyncio loop, in an rclpy executor, or in neither."""

    def __await__(self: Any) -> Generator[Any, None, Any]:
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            # As in rclpy's future: its executor resumes the coroutine until the future has ended.
            while not self.done() and not self.cancelled():
                yield
        else:
            yield from _end_in(loop, self)
        return self.result()


def _end_in(loop: asyncio.AbstractEventLoop, future: Any) -> Generator[Any, None, None]:
    """Wait in an asyncio loop for a future that any thread may complete."""
    ended = loop.create_future()

    def tell(_: Any) -> None:
        with suppress(RuntimeError):  # a closed loop has no waiting coroutine
            loop.call_soon_threadsafe(complete, ended, None)

    future.add_done_callback(tell)
    try:
        yield from ended
    except asyncio.CancelledError:
        future.cancel()
        raise
    if future.cancelled():
        raise asyncio.CancelledError


class _ThreadsFuture(_Awaited, concurrent.futures.Future[Any]):
    """A future for threads. Any thread may complete or cancel it.

    Without a timeout `result` and `exception` never wait: before it is done they raise
    InvalidStateError, as asyncio's futures do. With one they wait, and raise TimeoutError.
    """

    def __init__(self, cancelled: Callable[[], None]) -> None:
        super().__init__()
        self._tell_cancelled = cancelled

    def _check_may_wait(self, timeout: float | None) -> None:
        if timeout is None and not self.done():
            raise concurrent.futures.InvalidStateError(NOT_DONE)

    def result(self, timeout: float | None = None) -> Any:
        """Return the transform, or raise the error of the wait; `timeout` is in seconds."""
        self._check_may_wait(timeout)
        return super().result(timeout)

    def exception(self, timeout: float | None = None) -> BaseException | None:
        """Return the error of the wait, or None; `timeout` is in seconds."""
        self._check_may_wait(timeout)
        return super().exception(timeout)

    def cancel(self) -> bool:
        """End the future and its wait."""
        with _cancelling:
            before = self.cancelled()
            cancelled = super().cancel()
            if cancelled and not before:
                self.set_running_or_notify_cancel()  # so that concurrent.futures.wait sees it
                self._tell_cancelled()
        return cancelled


class _LoopFuture(asyncio.Future[Any]):
    """A future of a running asyncio loop; only that loop may complete or cancel it."""

    def __init__(self, cancelled: Callable[[], None]) -> None:
        super().__init__()
        self._tell_cancelled = cancelled

    def cancel(self, msg: Any = None) -> bool:
        """End the future and its wait."""
        cancelled = super().cancel(msg)
        if cancelled:
            self._tell_cancelled()
        return cancelled


@cache
def _rclpys_future(base: Any) -> Any:
    """Make the subclass of `rclpy.task.Future` that ends its wait."""

    class RclpyFuture(_Awaited, base):  # type: ignore[misc]
        """A future of rclpy. Any thread may complete or cancel it; the first call counts."""

        def __init__(self, cancelled: Callable[[], None]) -> None:
            super().__init__()
            self._tell_cancelled = cancelled
            self._end = threading.Lock()

        def _is_first(self) -> bool:
            """Whether the caller is the first one to end the future."""
            return not self.done() and self._end.acquire(blocking=False)

        def complete(self, result: Any) -> None:
            """Set its result or exception unless it has ended."""
            if self._is_first():
                give = self.set_exception if isinstance(result, Exception) else self.set_result
                give(result)

        def cancel(self) -> None:
            """End the future and its wait."""
            if self._is_first():
                super().cancel()
                self._tell_cancelled()

    return RclpyFuture


def _rclpys() -> Any:
    """The future class of the rclpy that the program uses; None: it does not use rclpy."""
    if "rclpy" not in sys.modules:
        return None
    try:
        from rclpy.task import Future
    except ImportError:  # the module of `tfdb.tf2.install` without ROS
        return None
    return _rclpys_future(Future)


def future_of_caller(
    node: Node | None, cancelled: Callable[[], None], *, ros2: bool
) -> tuple[Any, asyncio.AbstractEventLoop | None]:
    """Return a future, and the loop that must complete it; None: any thread may.

    `cancelled` is called when it is cancelled. `ros2`: use rclpy's future.
    """
    kind = _rclpys() if ros2 else None
    if kind is None:
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:
            return _ThreadsFuture(cancelled), None
        return _LoopFuture(cancelled), loop
    future = kind(cancelled)
    wake = getattr(node, "wake", None)
    if wake is not None:
        future.add_done_callback(lambda _: wake())
    return future, None


def complete(future: Any, result: Any) -> None:
    """Set the result or exception of a future unless it has ended."""
    if hasattr(future, "complete"):
        future.complete(result)
        return
    try:
        if isinstance(result, BaseException):
            future.set_exception(result)
        else:
            future.set_result(result)
    except (concurrent.futures.InvalidStateError, asyncio.InvalidStateError):
        if not future.done():
            raise

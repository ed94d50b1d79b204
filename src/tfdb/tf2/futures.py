"""Futures of whatever runs here: asyncio, rclpy, or threads alone."""

from __future__ import annotations

import asyncio
import concurrent.futures
import threading
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

    from tfdb.ros import Node

__all__ = ["future_here", "settle"]


_cancelling = threading.RLock()


class _ThreadsFuture(concurrent.futures.Future[Any]):
    """A future for threads, and for coroutines of rclpy. Any thread may settle or cancel it."""

    def __init__(self, cancelled: Callable[[], None]) -> None:
        super().__init__()
        self._tell_cancelled = cancelled

    def __await__(self) -> Generator[None, None, Any]:
        # As rclpy's own: a coroutine in its executor is resumed until this is done.
        while not self.done():
            yield
        return self.result()

    def cancel(self) -> bool:
        """End it, and what it waits for."""
        with _cancelling:
            before = self.cancelled()
            cancelled = super().cancel()
            if cancelled and not before:
                self.set_running_or_notify_cancel()  # so that concurrent.futures.wait sees it
                self._tell_cancelled()
        return cancelled


class _LoopFuture(asyncio.Future[Any]):
    """A future of a running loop of asyncio, which alone may settle or cancel it."""

    def __init__(self, cancelled: Callable[[], None]) -> None:
        super().__init__()
        self._tell_cancelled = cancelled

    def cancel(self, msg: Any = None) -> bool:
        """End it, and what it waits for."""
        cancelled = super().cancel(msg)
        if cancelled:
            self._tell_cancelled()
        return cancelled


def future_here(
    node: Node | None, cancelled: Callable[[], None]
) -> tuple[Any, asyncio.AbstractEventLoop | None]:
    """Return a future, and the loop that it is to be settled in; None: any thread may.

    `cancelled` is called when somebody cancels it.
    """
    try:
        loop = asyncio.get_running_loop()
    except RuntimeError:
        future = _ThreadsFuture(cancelled)
        wake = getattr(node, "wake", None)
        if wake is not None:
            future.add_done_callback(lambda _: wake())
        return future, None
    return _LoopFuture(cancelled), loop


def settle(future: Any, result: Any) -> None:
    """Give a future its result, or its exception, unless it has ended."""
    try:
        if isinstance(result, BaseException):
            future.set_exception(result)
        else:
            future.set_result(result)
    except (concurrent.futures.InvalidStateError, asyncio.InvalidStateError):
        if not future.done():
            raise

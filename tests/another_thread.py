"""Calls in another thread, in steps that the test controls."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any, Generic, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable

Result = TypeVar("Result")


class Call(Generic[Result]):
    """`function()` in a thread of its own; `result()` waits for it."""

    def __init__(self, function: Callable[[], Result]) -> None:
        self._function = function
        self._outcome: Any = None
        self._error: BaseException | None = None
        self._begun = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        self._begun.wait()

    def _run(self) -> None:
        self._begun.set()
        try:
            self._outcome = self._function()
        except BaseException as error:
            self._error = error

    def result(self) -> Result:
        self._thread.join()
        if self._error is not None:
            raise self._error
        return self._outcome


def in_another_thread(function: Callable[[], Result]) -> Result:
    """What `function()` returns or raises in another thread, which has then ended."""
    return Call(function).result()

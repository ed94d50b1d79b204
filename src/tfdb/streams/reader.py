"""The common part of all streams: iteration over `read_next`, and their end."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Generic, TypeVar

from tfdb._core import duration_to_nanoseconds
from tfdb.data.closable import Closable
from tfdb.data.errors import StreamClosed

if TYPE_CHECKING:
    from typing import Self

__all__: list[str] = []

Item = TypeVar("Item")


class Reader(Closable, ABC, Generic[Item]):
    """Iterates over items, by `for` and `async for`; a context manager."""

    @abstractmethod
    def read_next(self, *, timeout: float | None = 0) -> Item | None:
        """Read the next item. None: it does not exist yet."""

    @abstractmethod
    def close(self) -> None:
        """End the reads in all threads."""

    @abstractmethod
    async def __anext__(self) -> Item:
        """Wait for the next item."""

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> Item:
        try:
            item = self.read_next(timeout=None)
        except StreamClosed:
            item = None
        if item is None:
            raise StopIteration
        return item

    def __aiter__(self) -> Self:
        return self


def deadline(timeout: float | None) -> float | None:
    """Return the end of a wait as a time of `time.monotonic`; None: the wait has no end."""
    if timeout is None:
        return None
    return time.monotonic() + duration_to_nanoseconds(timeout, "timeout") / 1e9

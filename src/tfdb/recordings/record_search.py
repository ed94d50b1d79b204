"""Searches damaged bytes for the next position at which a record begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    import re
    from collections.abc import Callable

    from .raw_file import Packed

_PIECE = 2**20
REACH = 256
"""Number of bytes from the start of a record on that a pattern may compare."""


class Bytes(Protocol):
    """Bytes that are read by position: a file or a chunk."""

    @property
    def size(self) -> int:
        """Number of bytes."""

    def read(self, at: int, count: int) -> Packed:
        """Return bytes from a position on."""

    def data_from(self, at: int) -> int:
        """Return the first position from `at` on that is not in a hole of a sparse file."""


@dataclass(frozen=True)
class Chunk:
    """The decompressed bytes of a chunk."""

    raw: Packed

    @property
    def size(self) -> int:
        """Number of bytes."""
        return len(self.raw)

    def read(self, at: int, count: int) -> Packed:
        """Return bytes from a position on."""
        return self.raw[at : at + count]

    def data_from(self, at: int) -> int:
        """Return the position: a chunk has no holes."""
        return at


def find_record(
    data: Bytes,
    pattern: re.Pattern[bytes],
    at: int,
    end: int,
    start_of: Callable[[int], int | None],
) -> int:
    """Return the first position in a range at which a record begins, or the end of the range.

    Parameters
    ----------
    data
        The bytes to search.
    pattern
        Matches within the first `REACH` bytes of each record.
    at, end
        The range.
    start_of
        Returns the start of the record that has a match at a position; None if there is none.
    """
    first = at
    while (at := data.data_from(at)) < end:
        count = min(_PIECE, end - at)
        piece = data.read(at, min(count + REACH, data.size - at))
        match = pattern.search(piece)
        while match is not None:
            start = start_of(at + match.start())
            if start is not None and first <= start < end:
                return start
            match = pattern.search(piece, match.start() + 1)
        at += count
    return end

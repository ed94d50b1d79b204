"""The head of encoded commits and states: docs/wire.md."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator


def numbers_of(sample: bytes) -> tuple[int, int]:
    """Return the commit before encoded commits, and their last commit.

    For a state both are its commit. Raises ValueError or IndexError for invalid bytes.
    """
    varints = _varints(sample, 36)
    since = next(varints)
    return since, since + (next(varints) if sample[5] == 1 else 0)


def epoch_of(sample: bytes) -> bytes:
    """Return the encoded epoch in the bytes of commits or a state."""
    return sample[8:32]


def _varints(data: bytes, at: int) -> Iterator[int]:
    while True:
        number = shift = 0
        while data[at] >= 0x80:
            number |= (data[at] & 0x7F) << shift
            shift += 7
            at += 1
            if shift > 63:
                raise ValueError("a number has more than ten bytes")
        yield number | data[at] << shift
        at += 1

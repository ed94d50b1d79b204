"""Writes commits, and ends the threads of rules after each test."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from tfdb.rules import rules

if TYPE_CHECKING:
    from collections.abc import Iterator

    import tfdb


@pytest.fixture(autouse=True)
def _close_buffers() -> Iterator[None]:
    """Close buffers with rules: their threads would live as long as the process."""
    yield
    for each in list(rules._all):
        if each._dispatcher.rules:  # another test's buffer without rules may be unusable
            each._buffer.close()


def put(buf: tfdb.Buffer, x: float, stamp: int | None = None, child: str = "base") -> int:
    """Move a frame. Return the number of the commit."""
    stamp = buf.commit + 1 if stamp is None else stamp
    buf.set_transform("map", child, stamp, (x, 2.0, 3.0), (0.5, 0.5, 0.5, 0.5))
    return buf.commit

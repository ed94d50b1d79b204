"""The clock that a buffer was given instead of its store's."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb._core import to_nanoseconds

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb._core import Buffer


def given_clock(buffer: Buffer) -> Callable[[], int] | None:
    """Return what was given as `clock=`, in nanoseconds; None: the store's clock counts."""
    given = buffer._clock
    return None if given is None else lambda: to_nanoseconds(given())

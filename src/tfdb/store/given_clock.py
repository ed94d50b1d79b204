"""The clock function of a buffer, which replaces that of its store."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb._core import to_nanoseconds

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb._core import Buffer


def given_clock(buffer: Buffer) -> Callable[[], int] | None:
    """Return the function given as `clock=`; None if the store's clock counts."""
    given = buffer._clock
    return None if given is None else lambda: to_nanoseconds(given())

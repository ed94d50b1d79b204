"""Stamps: integer nanoseconds, and what else is taken for one."""

from __future__ import annotations

from collections.abc import Iterable
from decimal import ROUND_HALF_EVEN, Context, Decimal, InvalidOperation
from typing import Any, Protocol, SupportsIndex, TypeAlias

import numpy as np
import numpy.typing as npt

from .errors import InvalidStamp

__all__ = ["StampLike", "StampsLike", "format_seconds", "stamp"]

MAX_STAMP = 2**63 - 1


class SecNanosec(Protocol):
    """A ROS 2 time message."""

    @property
    def sec(self) -> int:
        """Whole seconds."""

    @property
    def nanosec(self) -> int:
        """Nanoseconds below one second."""


class SecsNsecs(Protocol):
    """A ROS 1 time."""

    @property
    def secs(self) -> int:
        """Whole seconds."""

    @property
    def nsecs(self) -> int:
        """Nanoseconds below one second."""


class ToNsec(Protocol):
    """Anything with `to_nsec()`."""

    def to_nsec(self) -> int:
        """Nanoseconds."""


class Nanoseconds(Protocol):
    """An `rclpy.time.Time`."""

    @property
    def nanoseconds(self) -> int:
        """Nanoseconds."""


StampLike: TypeAlias = SupportsIndex | np.datetime64 | SecNanosec | SecsNsecs | ToNsec | Nanoseconds
"""What every parameter that is a stamp takes; integers are nanoseconds."""

StampsLike: TypeAlias = npt.NDArray[np.integer[Any] | np.datetime64] | Iterable[StampLike]
"""What every parameter that is an array of stamps takes."""

# 19 digits hold every stamp; the rest is for digits behind the nanosecond, which are rounded off.
_CONTEXT = Context(prec=60, rounding=ROUND_HALF_EVEN)


def stamp(seconds: float | str | Decimal) -> int:
    """Nanoseconds of a time in seconds: the only way from a float to a stamp.

    Parameters
    ----------
    seconds
        A number of seconds >= 0. A str (`"12.5"`) or a Decimal is exact to the nanosecond. A float
        is taken as the decimal number it prints as, so `stamp(0.1)` is 100_000_000; at today's
        epoch a float itself is only good to some 100 ns.

    Returns
    -------
    int
        Nanoseconds, rounded to the nearest.

    Raises
    ------
    InvalidStamp
        Negative, not a number, infinite, or beyond 2**63 - 1 ns.
    """
    if isinstance(seconds, bool | np.bool_):
        raise InvalidStamp(f"seconds must be a number, got {seconds!r}", value=seconds)
    try:
        value = Decimal(str(seconds).strip())
    except InvalidOperation:
        raise InvalidStamp(f"{seconds!r} is not a number of seconds", value=seconds) from None
    if not value.is_finite() or value < 0 or value.adjusted() > 10:
        raise InvalidStamp(
            f"{seconds!r} s is no stamp: valid are 0 to {format_seconds(MAX_STAMP)}", value=seconds
        )
    nanoseconds = int(value.scaleb(9, _CONTEXT).to_integral_value(ROUND_HALF_EVEN))
    if nanoseconds > MAX_STAMP:
        raise InvalidStamp(
            f"{seconds!r} s is no stamp: valid are 0 to {format_seconds(MAX_STAMP)}", value=seconds
        )
    return nanoseconds


def format_seconds(nanoseconds: int) -> str:
    """Write nanoseconds as seconds, exactly: `12.5 s`."""
    sign = "-" if nanoseconds < 0 else ""
    whole, fraction = divmod(abs(nanoseconds), 1_000_000_000)
    digits = f"{fraction:09d}".rstrip("0")
    return f"{sign}{whole}{'.' if digits else ''}{digits} s"

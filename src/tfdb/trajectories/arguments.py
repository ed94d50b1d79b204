"""Checks of the arguments of a trajectory's methods."""

from __future__ import annotations

import math
from typing import Any

from tfdb._core import Transform
from tfdb.data.errors import InvalidArgument
from tfdb.data.stamps import MAX_STAMP, format_seconds, shown

__all__: list[str] = []


def _number(value: float) -> float:
    """Return a number as a float, and NaN for other types."""
    if isinstance(value, bool | str | bytes | bytearray):
        return math.nan
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        return math.nan


def tolerance(value: float, name: str) -> float:
    """Return a tolerance as a float; raises InvalidArgument if it is invalid."""
    number = _number(value)
    if not number >= 0.0:
        message = f"{name} must be a number >= 0, got {shown(value)}"
        raise InvalidArgument(message, value=value)
    return number


def nanoseconds_of(interval: float) -> int:
    """Convert an interval in seconds to nanoseconds."""
    number = _number(interval) * 1e9
    if not 1.0 <= number <= MAX_STAMP:
        most = format_seconds(MAX_STAMP)
        message = f"interval must be a number of seconds, from {format_seconds(1)} to {most}, got "
        raise InvalidArgument(message + shown(interval), value=interval)
    return round(number)


def chains(other: object, written: str, instead: str) -> bool:
    """Return whether `other` is a Transform. False: Python tries the operator of `other`."""
    if isinstance(other, Transform):
        return True
    if isinstance(other, list | tuple) or hasattr(other, "__array__"):
        name = type(other).__name__
        raise TypeError(f"{written} chains with a Transform, got a {name}: {instead}")
    return False


def check_chain(target: str, source: str, second_target: str, second_source: str) -> None:
    """Raise InvalidArgument if T[target<-source] @ T[second_target<-...] do not chain."""
    if source != second_target:
        raise InvalidArgument(
            f"T[{target}<-{source}] @ T[{second_target}<-{second_source}] do not chain: the first "
            f"maps from '{source}', the second into '{second_target}'",
            source=source,
            target=second_target,
        )


def are_many(stamps: Any) -> bool:
    """Return whether the argument is a collection of stamps."""
    if getattr(stamps, "shape", None) == ():
        return False
    return hasattr(stamps, "__len__") or hasattr(stamps, "__iter__")


def are_none(stamps: Any) -> bool:
    """Return whether the argument is an empty collection."""
    return hasattr(stamps, "__len__") and len(stamps) == 0

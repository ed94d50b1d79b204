"""Policies: how lookups use samples for stamps between or beyond them.

Limits are seconds, or exact nanoseconds with the keyword that ends in `_ns`. They are stored in
nanoseconds.
"""

from __future__ import annotations

from operator import index
from typing import Any, overload

from tfdb._core import Policy, duration_to_nanoseconds

from .errors import InvalidArgument
from .stamps import shown

__all__ = ["Exact", "Extrapolate", "Interpolate", "Nearest", "Policy", "Previous"]


_MOST_NANOSECONDS = 2**63 - 1


def _nanoseconds(name: str, seconds: float | None, nanoseconds: int | None) -> int | None:
    """Return a limit in nanoseconds; raise InvalidArgument if it is not a duration in its range."""
    if seconds is not None and nanoseconds is not None:
        raise InvalidArgument(f"give {name} or {name}_ns, not both")
    if seconds is None and nanoseconds is None:
        return None
    if seconds is not None:
        return duration_to_nanoseconds(seconds, name)
    limit = -1
    try:
        if nanoseconds is not None and not isinstance(nanoseconds, bool):
            limit = index(nanoseconds)
    except TypeError:
        pass  # refused below
    if 0 <= limit <= _MOST_NANOSECONDS:
        return limit
    valid = f"{name}_ns must be an integer from 0 to 2**63 - 1"
    raise InvalidArgument(f"{valid}, got {shown(nanoseconds)}", value=nanoseconds)


class _Limited(Policy):
    """A policy that prints, compares and pickles by its limit."""

    __slots__ = ()
    _limit_name = ""

    def __repr__(self) -> str:
        limit = "" if self.limit_ns is None else f"{self._limit_name}={self.limit_ns / 1e9}"
        return f"{type(self).__name__}({limit})"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Policy):
            return NotImplemented
        return self.kind == other.kind and self.limit_ns == other.limit_ns

    def __hash__(self) -> int:
        return hash((self.kind, self.limit_ns))

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore, (type(self), self.kind, self.limit_ns)

    def _seconds(self) -> float | None:
        return None if self.limit_ns is None else self.limit_ns / 1e9


def _restore(cls: type[_Limited], kind: str, limit_ns: int | None) -> _Limited:
    """Unpickle a policy of any class, although their constructors differ."""
    policy = cls.__new__(cls)
    Policy.__init__(policy, kind, limit_ns)
    return policy


class Interpolate(_Limited):
    """Linear translation and slerp rotation between the samples around the stamp, as in tf2.

    Raises GapTooLarge if the samples are more than `max_gap` apart, and Extrapolation outside the
    data.
    """

    __slots__ = ()
    _limit_name = "max_gap"

    def __init__(self, max_gap: float | None = None, *, max_gap_ns: int | None = None) -> None:
        super().__init__("interpolate", _nanoseconds("max_gap", max_gap, max_gap_ns))

    @property
    def max_gap(self) -> float | None:
        """Seconds; None: any gap."""
        return self._seconds()


class Exact(_Limited):
    """Only stored stamps; raises NoSampleNear for others."""

    __slots__ = ()

    def __init__(self) -> None:
        super().__init__("exact")


class Previous(_Limited):
    """The newest sample at or before the stamp (zero-order hold).

    Raises Stale if it is older than `max_age`.
    """

    __slots__ = ()
    _limit_name = "max_age"

    def __init__(self, max_age: float | None = None, *, max_age_ns: int | None = None) -> None:
        super().__init__("previous", _nanoseconds("max_age", max_age, max_age_ns))

    @property
    def max_age(self) -> float | None:
        """Seconds; None: any age."""
        return self._seconds()


class Nearest(_Limited):
    """The closest sample; the earlier one of two at the same distance.

    Raises NoSampleNear if it is further away than `tolerance`.
    """

    __slots__ = ()
    _limit_name = "tolerance"

    def __init__(self, tolerance: float | None = None, *, tolerance_ns: int | None = None) -> None:
        super().__init__("nearest", _nanoseconds("tolerance", tolerance, tolerance_ns))

    @property
    def tolerance(self) -> float | None:
        """Seconds; None: any distance."""
        return self._seconds()


class Extrapolate(_Limited):
    """Interpolate, and extrapolate at constant velocity for at most `max`."""

    __slots__ = ()
    _limit_name = "max"

    @overload
    def __init__(self, max: float) -> None: ...
    @overload
    def __init__(self, *, max_ns: int) -> None: ...
    def __init__(self, max: float | None = None, *, max_ns: int | None = None) -> None:  # noqa: A002
        limit = _nanoseconds("max", max, max_ns)
        if limit is None:
            raise InvalidArgument("Extrapolate needs a limit: Extrapolate(max=0.1)")
        super().__init__("extrapolate", limit)

    @property
    def max(self) -> float:
        """Seconds."""
        return float(self._seconds() or 0.0)

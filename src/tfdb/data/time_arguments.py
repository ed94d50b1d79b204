"""Times as arguments: stamps, or text, which may be an offset in a range of stamps.

`load`, `trajectory`, `crop` and the command line use it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tfdb._core import to_nanoseconds

from .decimal_time import parse_stamp
from .errors import InvalidArgument, InvalidStamp
from .stamps import DATE, format_seconds, shown, stamp

if TYPE_CHECKING:
    from collections.abc import Callable

    from .stamps import StampLike

__all__: list[str] = []

TIMES = (
    "write seconds ('12.5'), nanoseconds ('12500000000ns'), a date ('2026-05-17T12:00:00.25Z'), or "
    "an offset from the first ('+1.5') or to the last moving stamp ('-0.5')"
)
_UNIT = re.compile(r"(?<=[0-9.])s$")
_ZONE = re.compile(r"([Zz]|[+-]\d\d(:?\d\d)?)", re.ASCII)


@dataclass(frozen=True)
class Time:
    """A stamp, or an offset from the first moving stamp (`since` 1) or back from the last (-1)."""

    text: str
    ns: int
    since: int = 0

    def __repr__(self) -> str:
        return self.text if self.since else f"{self.ns}ns"

    def resolve(self, found: tuple[int, int] | None) -> int:
        """Return the stamp; `found` has the first and last moving stamp."""
        if not self.since:
            return self.ns
        if found is None:
            raise InvalidArgument(
                f"{self.text!r} counts from the first or to the last moving stamp, but "
                "the selection has no moving transform; give an absolute time",
                value=self.text,
            )
        return found[0] + self.ns if self.since > 0 else found[1] - self.ns

    def stamp(self, found: tuple[int, int] | None) -> int:
        """Return the stamp; raises InvalidStamp if an offset leads before time 0."""
        stamp = self.resolve(found)
        if stamp < 0 and found is not None:
            raise InvalidStamp(
                f"{self.text!r} lies before time 0: the last moving stamp is at "
                f"{format_seconds(found[1])}",
                value=self.text,
            )
        return stamp

    def may_be_offset(self, found: tuple[int, int] | None) -> bool:
        """Return whether a time is far before `found`, and not greater than its length."""
        if self.since or found is None:
            return False
        length = found[1] - found[0]
        return self.ns <= length < found[0] - self.ns


def read_time(text: str) -> Time:
    """Read seconds, nanoseconds, a date or an offset. Raises ValueError with a reason."""
    text = text.strip()
    if text.startswith(("+", "-")):
        return Time(text, abs(read_offset(text)), -1 if text[0] == "-" else 1)
    if DATE.match(text):
        ns = _date_ns(text)
        return Time(f"{ns}ns", ns)
    return Time(text, parse_stamp(text))


def read_offset(text: str) -> int:
    """Convert a signed duration to nanoseconds. Raises ValueError with a reason."""
    try:
        size = read_length(text[1:] if text.startswith(("+", "-")) else text)
    except ValueError as error:
        raise ValueError(f"{text[:40]!r} is not an offset: {error}") from None
    return -size if text.startswith("-") else size


def read_length(text: str) -> int:
    """Convert `10`, `10s` or `500ns` to nanoseconds. Raises ValueError with a reason."""
    return read_unsigned(_UNIT.sub("", text))


def read_unsigned(text: str) -> int:
    """Convert `10` (seconds) or `500ns` to nanoseconds. Raises ValueError with a reason."""
    if text.startswith(("+", "-")):
        why = "is negative" if text.startswith("-") else "has a sign too many"
        raise ValueError(f"{text[:40]!r} {why}")
    return parse_stamp(text)


def _date_ns(text: str) -> int:
    """Convert a date to nanoseconds; without a time zone it is in UTC."""
    date = text.removesuffix("UTC").rstrip()
    day, time = date[:10], date[11:]
    zone = "" if _ZONE.search(time) else "Z"
    return stamp(f"{day}T{time or '00:00:00'}{zone}")


def time_of(name: str, given: StampLike | str | None) -> Time | None:
    """Read the time given as the argument `name`. Raises InvalidArgument, InvalidStamp."""
    if given is None:
        return None
    if not isinstance(given, str):
        return Time(shown(given), to_nanoseconds(given))
    try:
        return read_time(given)
    except ValueError as error:
        raise InvalidArgument(f"{name}: {error}: {TIMES}", value=given) from None


def stamp_of(
    name: str, given: StampLike | str | None, span: Callable[[], tuple[int, int] | None]
) -> int | None:
    """Return the stamp of the argument `name`; `span()` returns the range for offsets."""
    time = time_of(name, given)
    return None if time is None else time.stamp(span() if time.since else None)


def check_order(first: int, last: int) -> None:
    """Raise InvalidArgument if the stamp `end` is before the stamp `start`."""
    if last < first:
        ends = f"end ({format_seconds(last)}) is before start ({format_seconds(first)})"
        raise InvalidArgument(ends, value=last)

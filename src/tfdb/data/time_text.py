"""Times as text for people: seconds, dates and durations."""

from __future__ import annotations

from datetime import UTC, datetime
from decimal import Decimal

from .decimal_time import NS_PER_SECOND as NS
from .decimal_time import ns_to_seconds

_EPOCH_NS = 946_684_800 * NS
"""The year 2000: earlier stamps are not dates."""


def format_ns(ns: int) -> str:
    """Write nanoseconds as seconds with nine decimals, exactly; they may be negative."""
    return f"-{ns_to_seconds(-ns)}" if ns < 0 else ns_to_seconds(ns)


def format_date(ns: int, *, day: bool = True) -> str:
    """Write a stamp as a date in UTC, to a millisecond; empty if it is not a date.

    Without `day`, only the time of day.
    """
    if ns < _EPOCH_NS:
        return ""
    when = datetime.fromtimestamp(ns // NS, UTC)
    form = "%Y-%m-%d %H:%M:%S" if day else "%H:%M:%S"
    return f"{when:{form}}.{ns % NS // 1_000_000:03}"


def format_when(ns: int) -> str:
    """Write a stamp in seconds, with its date in UTC if it is one."""
    date = format_date(ns)
    return f"{format_ns(ns)} ({date} UTC)" if date else format_ns(ns)


def format_dates(first: int, last: int) -> str:
    """Write a span as dates; empty if an end is not a date."""
    start, end = format_date(first), format_date(last)
    if not start or not end:
        return ""
    same = start[:10] == end[:10]
    return f"{start} to {format_date(last, day=not same)} UTC"


def format_duration(ns: int) -> str:
    """Write a duration: ``33.4 ms``, ``1.25 s``, ``2 min 3 s``, ``20 min``."""
    size = abs(ns)
    sign = "-" if ns < 0 else ""
    for limit, unit, scale in ((1_000, "ns", 1), (1_000_000, "us", 1_000), (NS, "ms", 1_000_000)):
        if size < limit:
            return f"{sign}{_three_digits(Decimal(size) / scale)} {unit}"
    if size < 120 * NS:
        return f"{sign}{_three_digits(Decimal(size) / NS)} s"
    minutes, rest = divmod(size // NS, 60)
    if minutes < 120:
        return f"{sign}{minutes} min" + (f" {rest} s" if rest else "")
    hours, rest = divmod(minutes, 60)
    return f"{sign}{hours} h" + (f" {rest} min" if rest else "")


def format_offset(ns: int) -> str:
    """Write a duration with its sign: ``+33.4 ms``."""
    return ("+" if ns >= 0 else "") + format_duration(ns)


def _three_digits(value: Decimal) -> str:
    digits = 0 if value >= 100 else 1 if value >= 10 else 2
    text = f"{value:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text

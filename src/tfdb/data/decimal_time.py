"""Conversion of stamps between decimal text and integer nanoseconds, without floats."""

from __future__ import annotations

import re
from datetime import date, time
from decimal import ROUND_HALF_EVEN, Context
from typing import Literal, TypeAlias

from .stamps import MAX_STAMP, NUMBER

Unit: TypeAlias = Literal["s", "ms", "us", "ns"]
NS_PER_SECOND = 1_000_000_000
UNITS: dict[Unit, tuple[int, str]] = {
    "s": (9, "seconds"),
    "ms": (6, "milliseconds"),
    "us": (3, "microseconds"),
    "ns": (0, "nanoseconds"),
}
"""Per unit: the power of ten that converts it to nanoseconds, and its name."""

_RFC3339 = re.compile(
    r"(\d{4})-(\d\d)-(\d\d)[Tt ](\d\d):(\d\d):(\d\d)(\.\d+)?(?:[Zz]|([+-])(\d\d):(\d\d))?",
    re.ASCII,
)
_EPOCH = date(1970, 1, 1).toordinal()
# A stamp has at most 19 digits of nanoseconds; 60 leave room for digits below a nanosecond.
_CONTEXT = Context(prec=60, rounding=ROUND_HALF_EVEN, Emin=-999_999, Emax=999_999, traps=[])


def seconds_to_ns(text: str) -> int:
    """Convert a decimal number of seconds, such as ``12.5`` or ``1.25e1``, to nanoseconds.

    Digits below a nanosecond are rounded: programs that print floats write them. Raises
    ``ValueError`` with a reason if the text is not a number, negative or beyond the greatest stamp.
    """
    whole, _, fraction = text.partition(".")
    digits = whole + fraction
    if 0 < len(whole) <= 10 and 0 < len(fraction) <= 9 and digits.isascii() and digits.isdecimal():
        return _checked(int(whole) * NS_PER_SECOND + int(fraction.ljust(9, "0")), text)
    return _decimal_ns(text, "s")


def units_to_ns(text: str, unit: Unit) -> int:
    """Convert a decimal number of another unit to nanoseconds; raises as `seconds_to_ns`."""
    if unit == "s":
        return seconds_to_ns(text)
    if text.isascii() and text.isdecimal() and len(text) <= 20:
        return _checked(int(text) * 10 ** UNITS[unit][0], text)
    return _decimal_ns(text, unit)


def _decimal_ns(text: str, unit: Unit) -> int:
    power, name = UNITS[unit]
    if not NUMBER.fullmatch(text):
        raise ValueError(f"{text[:40]!r} is not a number of {name}")
    value = _CONTEXT.create_decimal(text)
    if value.is_infinite() or (value and value.adjusted() + power > 19):
        raise ValueError(f"{text[:40]!r} is beyond the greatest stamp")
    return _checked(int(_CONTEXT.to_integral_value(_CONTEXT.scaleb(value, power))), text)


def is_whole(text: str) -> bool:
    """Return whether a text is a number without decimals."""
    return text.isascii() and text.isdecimal()


def whole_part(text: str) -> int | None:
    """Return the number without its decimals; None if it is not a number, or has 40 digits."""
    whole = text.partition(".")[0]
    if is_whole(whole) and len(whole) < 40 and "e" not in text and "E" not in text:
        return int(whole)
    if not NUMBER.fullmatch(text):
        return None
    value = _CONTEXT.create_decimal(text)
    return int(value) if value.is_finite() and value.adjusted() < 40 else None


def integer_ns(text: str) -> int:
    """Convert digits to nanoseconds; raises ``ValueError`` with a reason for other text."""
    if not (text.isascii() and text.isdecimal()) or len(text) > 40:
        raise ValueError(f"{text[:40]!r} is not an integer number of nanoseconds")
    return _checked(int(text), text)


def parse_stamp(text: str) -> int:
    """Convert ``12.5`` (seconds) or ``12500000000ns`` to nanoseconds. Raises ``ValueError``."""
    return integer_ns(text[:-2]) if text.endswith("ns") else seconds_to_ns(text)


def rfc3339_ns(text: str) -> int:
    """Convert a time of RFC 3339, such as ``2023-11-14T22:13:20.020Z``, to nanoseconds since 1970.

    Digits below a nanosecond are rounded. The result is negative before 1970. Raises
    ``ValueError`` with a reason for other text.
    """
    found = _RFC3339.fullmatch(text)
    if found is None:
        raise ValueError(f"{text[:40]!r} is not a time such as '2023-11-14T22:13:20.020Z'")
    year, month, day, hour, minute, second = map(int, found.group(1, 2, 3, 4, 5, 6))
    fraction, sign, hours, minutes = found.group(7, 8, 9, 10)
    if sign is None and text[-1] not in "Zz":
        raise ValueError(f"{text[:40]!r} has no time zone: it ends in 'Z' or such as '+02:00'")
    try:
        days = date(year, month, day).toordinal() - _EPOCH
        clock, ahead = time(hour, minute, second), time(int(hours or 0), int(minutes or 0))
    except ValueError as error:
        raise ValueError(f"{text[:40]!r} is not a time: {error}") from None
    offset = _seconds_of(ahead) * (-1 if sign == "-" else 1)
    seconds = days * 86_400 + _seconds_of(clock) - offset
    return seconds * NS_PER_SECOND + (seconds_to_ns(f"0{fraction}") if fraction else 0)


def _seconds_of(clock: time) -> int:
    return (clock.hour * 60 + clock.minute) * 60 + clock.second


def ns_to_seconds(stamp: int) -> str:
    """Write nanoseconds as seconds with nine decimals, exactly: ``12.500000000``."""
    whole, rest = divmod(stamp, NS_PER_SECOND)
    return f"{whole}.{rest:09d}"


def _checked(stamp: int, text: str) -> int:
    if stamp < 0:
        raise ValueError(f"{text[:40]!r} is negative; stamps count from 0")
    if stamp > MAX_STAMP:
        raise ValueError(f"{text[:40]!r} is beyond the greatest stamp")
    return stamp

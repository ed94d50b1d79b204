"""Stamps between decimal text and integer nanoseconds, without a float on the way."""

from __future__ import annotations

import re
from decimal import ROUND_HALF_EVEN, Context

from tfdb.stamps import MAX_STAMP

NS_PER_SECOND = 1_000_000_000

_NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
# Every stamp has at most 19 digits of nanoseconds; 60 leave room for any digits behind them.
_CONTEXT = Context(prec=60, rounding=ROUND_HALF_EVEN, Emin=-999_999, Emax=999_999, traps=[])


def seconds_to_ns(text: str) -> int:
    """Nanoseconds of a decimal number of seconds, such as ``12.5`` or ``1.25e1``.

    Digits beyond the nanosecond, as programs that print floats leave them, are rounded to the
    nearest one. Raises ``ValueError`` with a reason when the text is no number, negative or beyond
    the greatest stamp.
    """
    whole, _, fraction = text.partition(".")
    digits = whole + fraction
    if 0 < len(whole) <= 10 and 0 < len(fraction) <= 9 and digits.isascii() and digits.isdecimal():
        return _checked(int(whole) * NS_PER_SECOND + int(fraction.ljust(9, "0")), text)
    if not _NUMBER.fullmatch(text):
        raise ValueError(f"{text[:40]!r} is not a number of seconds")
    value = _CONTEXT.create_decimal(text)
    if value.is_infinite() or (value and value.adjusted() > 10):
        raise ValueError(f"{text[:40]!r} is beyond the greatest stamp")
    return _checked(int(_CONTEXT.to_integral_value(_CONTEXT.scaleb(value, 9))), text)


def integer_ns(text: str) -> int:
    """Nanoseconds of a text of digits; ``ValueError`` with a reason for anything else."""
    if not (text.isascii() and text.isdecimal()) or len(text) > 40:
        raise ValueError(f"{text[:40]!r} is not an integer number of nanoseconds")
    return _checked(int(text), text)


def parse_stamp(text: str) -> int:
    """Nanoseconds of ``12.5`` (seconds) or ``12500000000ns``; ``ValueError`` for anything else."""
    return integer_ns(text[:-2]) if text.endswith("ns") else seconds_to_ns(text)


def ns_to_seconds(stamp: int) -> str:
    """Seconds with nine decimals, exact: ``12500000000`` gives ``12.500000000``."""
    whole, rest = divmod(stamp, NS_PER_SECOND)
    return f"{whole}.{rest:09d}"


def _checked(stamp: int, text: str) -> int:
    if stamp < 0:
        raise ValueError(f"{text[:40]!r} is negative; stamps count from 0")
    if stamp > MAX_STAMP:
        raise ValueError(f"{text[:40]!r} is beyond the greatest stamp")
    return stamp

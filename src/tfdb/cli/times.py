"""Times as people type them, turned into integer nanoseconds without passing through a float."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal

import click

from tfdb.io.decimal_time import NS_PER_SECOND, integer_ns, ns_to_seconds, seconds_to_ns

NS = NS_PER_SECOND

HINT = (
    "write seconds (12.5), nanoseconds (12500000000ns), an offset from the start (+1.5) or 'latest'"
)


def parse_stamp(text: str) -> int:
    """Nanoseconds of ``12.5`` (seconds) or ``12500000000ns``; ``ValueError`` for anything else."""
    return integer_ns(text[:-2]) if text.endswith("ns") else seconds_to_ns(text)


@dataclass(frozen=True)
class TimeSpec:
    """A time that may need the recording to be known: absolute, from the start, or the latest."""

    text: str
    ns: int | None
    relative: bool = False

    def resolve(self, start: int | None) -> int | None:
        """Return the stamp in nanoseconds, or None for the latest common time.

        `start` is the recording's first moving stamp, None when it has none.
        """
        if self.ns is None or not self.relative:
            return self.ns
        if start is None:
            raise click.ClickException(
                f"{self.text!r} counts from the first moving sample and there is none; "
                "give an absolute time or 'latest'"
            )
        return start + self.ns


LATEST = TimeSpec("latest", None)


def time_option(ctx: click.Context, param: click.Parameter, value: str | None) -> TimeSpec | None:
    """Click's callback for a time."""
    text = (value or "").strip()
    if value is None or ctx.resilient_parsing:
        return None
    if text == "latest":
        return LATEST
    try:
        if text.startswith("+"):
            return TimeSpec(text, parse_stamp(text[1:]), relative=True)
        return TimeSpec(text, parse_stamp(text))
    except ValueError as error:
        raise click.BadParameter(f"{error}: {HINT}", ctx, param) from None


def duration_option(ctx: click.Context, param: click.Parameter, value: str | None) -> int | None:
    """Click's callback for a length of time: seconds with decimals, or nanoseconds with ``ns``."""
    if value is None or ctx.resilient_parsing:
        return None
    try:
        return parse_stamp(value.strip())
    except ValueError as error:
        hint = "write seconds (0.5) or nanoseconds (500000000ns)"
        raise click.BadParameter(f"{error}: {hint}", ctx, param) from None


def format_ns(ns: int) -> str:
    """Seconds with nine decimals, exact: ``12.500000000``; a sign where negative."""
    return f"-{ns_to_seconds(-ns)}" if ns < 0 else ns_to_seconds(ns)


def format_duration(ns: int) -> str:
    """Write a length of time for people: ``33.4 ms``, ``1.25 s``, ``2 min 3 s``."""
    size = abs(ns)
    sign = "-" if ns < 0 else ""
    for limit, unit, scale in ((1_000, "ns", 1), (1_000_000, "us", 1_000), (NS, "ms", 1_000_000)):
        if size < limit:
            return f"{sign}{_three_digits(Decimal(size) / scale)} {unit}"
    if size < 120 * NS:
        return f"{sign}{_three_digits(Decimal(size) / NS)} s"
    minutes, rest = divmod(size // NS, 60)
    if minutes < 120:
        return f"{sign}{minutes} min {rest} s"
    return f"{sign}{minutes // 60} h {minutes % 60} min"


def _three_digits(value: Decimal) -> str:
    digits = 0 if value >= 100 else 1 if value >= 10 else 2
    text = f"{value:.{digits}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def read_stamps(text: str, name: str) -> list[int]:
    """Stamps of a text with one per line, in seconds or with ``ns``.

    The first column counts, so a TUM or CSV trajectory works too; empty lines, ``#`` comments and
    a CSV heading are passed over. A first column of integers above 10^14 is taken for nanoseconds
    (as EuRoC writes them).
    """
    stamps: list[int] = []
    for number, line in enumerate(text.splitlines(), start=1):
        fields = line.replace(",", " ").split()
        if not fields or fields[0].startswith("#"):
            continue
        first = fields[0]
        try:
            bare_ns = first.isdigit() and len(first) > 14
            stamps.append(parse_stamp(first + "ns" if bare_ns else first))
        except ValueError as error:
            if not stamps and not first[0].isdigit() and len(fields) > 1:
                continue
            raise click.ClickException(
                f"{name}, line {number}: {error}; write one stamp per line in seconds, "
                "or in nanoseconds with 'ns'"
            ) from None
    if not stamps:
        raise click.ClickException(f"{name} holds no stamp; write one per line")
    return stamps

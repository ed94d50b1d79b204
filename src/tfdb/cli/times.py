"""Typed times, converted to integer nanoseconds without floats."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

import tfdb
from tfdb.data.decimal_time import NS_PER_SECOND
from tfdb.data.stamps import MAX_STAMP
from tfdb.data.suggestions import near_names
from tfdb.data.time_arguments import Time, read_length, read_offset, read_time, read_unsigned
from tfdb.data.time_text import _EPOCH_NS

from . import output

if TYPE_CHECKING:
    from collections.abc import Callable

NS = NS_PER_SECOND

HINT = (
    "write seconds (12.5), nanoseconds (12500000000ns), a date (2026-05-17T12:00:00.25), an offset "
    "from the start (+1.5) or from the end (-0.5), or 'latest'"
)


@dataclass(frozen=True)
class TimeSpec:
    """A time that may need the recording to be known.

    `ns` is absolute, or counts from the start (`since` 1) or to the end (-1); None: the latest.
    """

    text: str
    ns: int | None
    since: int = 0

    def resolve(self, span: tuple[int, int] | None) -> int | None:
        """Return the stamp in nanoseconds, or None for the latest common time.

        `span` holds the recording's first and last moving stamp, None when it has none.
        """
        return None if self.ns is None else Time(self.text, self.ns, self.since).stamp(span)

    def may_be_offset(self, span: tuple[int, int] | None) -> bool:
        """Whether it lies far before the recording, and is no longer."""
        return self.ns is not None and Time(self.text, self.ns, self.since).may_be_offset(span)


LATEST = TimeSpec("latest", None)


def ask_of_offsets(span: tuple[int, int] | None, *times: TimeSpec | None) -> str:
    """Ask whether offsets were meant by times; empty where they were not."""
    given = [f"+{time.text}" for time in times if time is not None and time.may_be_offset(span)]
    return f"did you mean {' and '.join(given)}, from the start?" if given else ""


def warn_of_bounds(span: tuple[int, int] | None, **bounds: TimeSpec | None) -> None:
    """Warn of times, by the names of their options, by which an offset was meant."""
    for name, time in bounds.items():
        if time is not None and (question := ask_of_offsets(span, time)):
            text = f"--{name} {time.text} lies before all that moves; {question}"
            output.say(f"tfdb: warning: {text}", err=True)


def time_option(ctx: click.Context, param: click.Parameter, value: str | None) -> TimeSpec | None:
    """Click's callback for a time."""
    text = (value or "").strip()
    if value is None or ctx.resilient_parsing:
        return None
    if text == "latest":
        return LATEST
    try:
        time = read_time(text)
        return TimeSpec(time.text, time.ns, time.since)
    except ValueError as error:
        hint = f"did you mean {text}ns?" if _looks_like_ns(text) else HINT
        if near_names(text, ("latest",), cutoff=0.6):
            hint = f"did you mean 'latest'? Else {HINT}"
        raise click.BadParameter(f"{error}: {hint}", ctx, param) from None


def _looks_like_ns(text: str) -> bool:
    """Whether a time is written as nanoseconds since 1970 are, without their unit."""
    return text.isascii() and text.isdigit() and _EPOCH_NS <= int(text) <= MAX_STAMP


def duration_option(ctx: click.Context, param: click.Parameter, value: str | None) -> int | None:
    """Click's callback for a length of time: `10`, `10s`, `0.5`, or nanoseconds with `ns`."""
    return _length_option(ctx, param, value, read_length)


def offset_option(ctx: click.Context, param: click.Parameter, value: str | None) -> int | None:
    """Click's callback for a length of time with a sign."""
    return _length_option(ctx, param, value, read_offset)


def _length_option(
    ctx: click.Context, param: click.Parameter, value: str | None, read: Callable[[str], int]
) -> int | None:
    if value is None or ctx.resilient_parsing:
        return None
    try:
        return read(value.strip())
    except ValueError as error:
        hint = "write seconds (0.5) or nanoseconds (500000000ns)"
        raise click.BadParameter(f"{error}: {hint}", ctx, param) from None


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
            stamps.append(read_unsigned(first + "ns" if bare_ns else first))
        except ValueError as error:
            if not stamps and not first[0].isdigit() and first[0] not in "+-" and len(fields) > 1:
                continue
            raise tfdb.InvalidStamp(
                f"{name}, line {number}: {error}; write one stamp per line in seconds, "
                "or in nanoseconds with 'ns'",
                path=name,
                line=number,
            ) from None
    if not stamps:
        raise tfdb.InvalidStamp(f"{name} holds no stamp; write one per line", path=name)
    return stamps

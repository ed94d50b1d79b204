"""Times on the command line, converted to integer nanoseconds without floats."""

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

    from click.decorators import FC

NS = NS_PER_SECOND

HINT = (
    "write seconds (12.5), nanoseconds (12500000000ns), a date (2026-05-17T12:00:00.25), an offset "
    "from the start (+1.5) or from the end (-0.5), or 'latest'"
)


@dataclass(frozen=True)
class TimeSpec:
    """A time, or an offset in a recording.

    `ns` is absolute, counts from the start (`since` 1), or back from the end (-1). None: the
    latest.
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
        """Whether the time is far before the recording, and not longer than the recording."""
        return self.ns is not None and Time(self.text, self.ns, self.since).may_be_offset(span)


LATEST = TimeSpec("latest", None)


def ask_of_offsets(span: tuple[int, int] | None, *times: TimeSpec | None) -> str:
    """Suggest offsets for absolute times; empty if they are not likely to be offsets."""
    given = [f"+{time.text}" for time in times if time is not None and time.may_be_offset(span)]
    return f"did you mean {' and '.join(given)}, from the start?" if given else ""


def warn_of_bounds(span: tuple[int, int] | None, **bounds: TimeSpec | None) -> None:
    """Warn of absolute times that are likely to be offsets; the keywords are option names."""
    for name, time in bounds.items():
        if time is not None and (question := ask_of_offsets(span, time)):
            text = f"--{name} {time.text} is before the first moving transform; {question}"
            output.warn(text)


def time_option(ctx: click.Context, param: click.Parameter, value: str | None) -> TimeSpec | None:
    """Convert an option's text to a time."""
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
            hint = f"did you mean 'latest'? Otherwise {HINT}"
        raise click.BadParameter(f"{error}; {hint}", ctx, param) from None


def _looks_like_ns(text: str) -> bool:
    """Return whether a number looks like nanoseconds since 1970 without their unit."""
    return text.isascii() and text.isdigit() and _EPOCH_NS <= int(text) <= MAX_STAMP


def duration_option(ctx: click.Context, param: click.Parameter, value: str | None) -> int | None:
    """Convert an option's text to a duration: `10`, `10s`, `0.5`, or nanoseconds with `ns`."""
    return _length_option(ctx, param, value, read_length)


def seconds_option(
    *names: str,
    help: str,  # noqa: A002 - as click calls it
    default: str | None = None,
) -> Callable[[FC], FC]:
    """Make an option for a duration; the command gets nanoseconds, or None without one."""
    return click.option(
        *names, metavar="SECONDS", default=default, callback=duration_option, help=help
    )


def offset_option(ctx: click.Context, param: click.Parameter, value: str | None) -> int | None:
    """Convert an option's text to a signed duration."""
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
        raise click.BadParameter(f"{error}; {hint}", ctx, param) from None


def read_stamps(text: str, name: str) -> list[int]:
    """Read stamps from a text, one per line: seconds, or nanoseconds with `ns`.

    The stamp is the first column, so TUM and CSV trajectories are valid. Empty lines, `#` comments
    and a CSV header are skipped. Integers above 10^14 are nanoseconds, as in EuRoC files.
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
            is_text = first.isprintable() and "\ufffd" not in first
            reason = error if is_text else "this is not UTF-8 text"
            raise tfdb.InvalidStamp(
                f"{name}, line {number}: {reason}; write one stamp per line in seconds, "
                "or in nanoseconds with 'ns'",
                path=name,
                line=number,
            ) from None
    if not stamps:
        raise tfdb.InvalidStamp(f"{name} holds no stamp; write one per line", path=name)
    return stamps

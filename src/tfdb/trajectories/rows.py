"""Converts rows of a trajectory file to stamps and poses; counts repeated and skipped rows."""

from __future__ import annotations

import math
from contextlib import suppress
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
import numpy.typing as npt

from tfdb.data.decimal_time import NS_PER_SECOND, UNITS, Unit, integer_ns, units_to_ns, whole_part
from tfdb.data.errors import TrajectoryError
from tfdb.data.poses import MAX_NORM_ERROR, found, missing
from tfdb.data.stamps import MAX_STAMP, format_seconds

from .lines import SALVAGE, zeros
from .reading_report import TrajectoryRows

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from .columns import Layout
    from .lines import Lines

Stamps: TypeAlias = npt.NDArray[np.int64]
Poses: TypeAlias = npt.NDArray[np.float64]

MAX_MENDED = 0.1
"""Error of a quaternion's squared length that counts as rounding by few digits."""
_NOTHING = ("", "nan")
"""Text for the numbers of a missing pose in a CSV file."""
_YEARS = 630_000_000, 4_200_000_000
"""Seconds of 1989 and 2103: a stamp in another unit is recognised between these years."""
_NEAR = 0.01, math.radians(1.0)
"""Metres and radians: poses of one stamp that differ by less count as equal."""
_LONG_STEP = 100 * NS_PER_SECOND


def rows_of_text(
    lines: Lines, layout: Layout, unit: Unit | None, *, salvage: bool
) -> tuple[Stamps, Poses, TrajectoryRows]:
    """Read the rows of a text file. Raises TrajectoryError for an invalid row."""
    report = TrajectoryRows(str(lines.path), rows=len(lines.rows))
    if layout.note:
        report.notes.append(layout.note)
    numbers: list[int] = []
    texts: list[tuple[str, str]] = []
    poses: list[list[float]] = []
    sizes: list[int] = []
    cut = lines.cut()
    for number, line in lines.rows:
        try:
            stamp, pose = _fields(layout, line, cut if number == lines.rows[-1][0] else None)
            _check_norm(pose, MAX_MENDED if salvage else MAX_NORM_ERROR)
        except ValueError as error:
            if not salvage:
                raise lines.skippable(number, str(error)) from None
            report.skip(number, len(line) + 1, str(error))
            continue
        numbers.append(number)
        texts.append(stamp)
        poses.append(pose)
        sizes.append(len(line) + 1)
    given, odd = _unit(lines, layout, unit, numbers, texts, report)
    stamps: list[int] = []
    kept: list[int] = []
    for at, text in enumerate(texts):
        reason = odd.get(numbers[at])
        if reason is None:
            try:
                stamps.append(_stamp(text, given, whole=layout.whole and unit is None))
            except ValueError as error:
                reason = f"{error}{_of_unit(given, unit, layout)}"
        if reason is None:
            kept.append(at)
        elif salvage:
            report.skip(numbers[at], sizes[at], reason)
        else:
            raise lines.skippable(numbers[at], reason)
    array = np.array(poses, dtype=np.float64).reshape(-1, 7)[kept]
    made = finish_rows(
        np.array(stamps, dtype=np.int64),
        array,
        report,
        [numbers[at] for at in kept],
        salvage=salvage,
    )
    if unit is None and layout.unit is None and given == "s":
        _doubt_seconds(made[0], texts, report)
    return (*made, report)


def finish_rows(
    stamps: Stamps,
    poses: Poses,
    report: TrajectoryRows,
    numbers: Sequence[int] | None,
    *,
    salvage: bool,
) -> tuple[Stamps, Poses]:
    """Keep the last row of each stamp; with `salvage`, sort the rows. Stamps then increase.

    `numbers` are the lines of the rows. Raises TrajectoryError if stamps decrease.
    """
    steps = np.diff(stamps)
    back = np.flatnonzero(steps < 0)
    if len(back) and not salvage:
        row = int(back[0])
        reason = (
            f"stamp {format_seconds(int(stamps[row + 1]))} follows "
            f"{format_seconds(int(stamps[row]))}: sort the rows by their stamps, or let {SALVAGE} "
            "sort them"
        )
        raise TrajectoryError(report.path, None if numbers is None else numbers[row + 1], reason)
    if len(back):
        report.moved = int(np.count_nonzero(stamps < np.maximum.accumulate(stamps)))
        order = np.argsort(stamps, kind="stable")
        stamps, poses = stamps[order], poses[order]
        steps = np.diff(stamps)
    again = np.flatnonzero(steps == 0)
    if len(again):
        report.repeated = len(again)
        report.differing = _differing(poses[again], poses[again + 1])
        last = np.append(steps != 0, True)
        stamps, poses = stamps[last], poses[last]
    if salvage and len(poses):
        poses = poses.copy()
        norms = np.linalg.norm(poses[:, 3:], axis=1)
        with np.errstate(invalid="ignore"):
            off = np.abs(norms**2 - 1.0) > MAX_NORM_ERROR
        poses[off, 3:] /= norms[off, np.newaxis]
        report.normalised = int(np.count_nonzero(off))
    report.poses = len(stamps)
    if not len(stamps):
        reason = "no pose in it"
        if report.skipped:
            reason += (
                f": all {report.rows:,} rows were skipped, the first at {report.first_skipped}"
            )
        raise TrajectoryError(report.path, None, reason)
    return stamps, poses


def _differing(poses: Poses, others: Poses) -> int:
    """Count the poses that differ; a missing pose differs from every other."""
    moved = np.linalg.norm(poses[:, :3] - others[:, :3], axis=1)
    norms = np.linalg.norm(poses[:, 3:], axis=1) * np.linalg.norm(others[:, 3:], axis=1)
    cosine = np.abs(np.sum(poses[:, 3:] * others[:, 3:], axis=1)) / norms
    near = (moved <= _NEAR[0]) & (cosine >= math.cos(_NEAR[1] / 2))
    return int(np.count_nonzero(~near & ~(missing(poses) & missing(others))))


def repair_rows(stamps: Stamps, poses: Poses, path: Path) -> tuple[Stamps, Poses, TrajectoryRows]:
    """Keep rows with a valid stamp and pose (or a missing pose), sorted by stamp."""
    report = TrajectoryRows(str(path), rows=len(stamps))
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs((poses[:, 3:] ** 2).sum(axis=1) - 1.0)
    fine = (found(poses) & (off <= MAX_MENDED)) | missing(poses)
    valid = (stamps >= 0) & (stamps <= MAX_STAMP)
    for row in np.flatnonzero(~(fine & valid)).tolist():
        what = "no rigid transform" if valid[row] else f"{stamps[row]} is not a stamp"
        report.skip(None, poses.itemsize * 8, f"row {row}: {what}")
    kept = fine & valid
    return (*finish_rows(stamps[kept], poses[kept], report, None, salvage=True), report)


def _fields(layout: Layout, line: str, cut: str | None) -> tuple[tuple[str, str], list[float]]:
    """Return the stamp's text, from one or two columns, and the pose; raises ``ValueError``."""
    broken = zeros(line)
    if broken is not None:
        raise ValueError(broken)
    fields = layout.fields(line)
    if len(fields) not in layout.counts:
        raise ValueError(f"{len(fields)} columns instead of `{layout.text}`")
    if cut is not None:
        raise ValueError(cut)
    stamp, *pose = [fields[place] for place in layout.order]
    rest = "" if layout.nanoseconds is None else fields[layout.nanoseconds]
    if layout.holes and all(each.lower() in _NOTHING for each in pose):
        return (stamp, rest), [math.nan] * 7
    return (stamp, rest), floats(pose)


def floats(fields: Sequence[str]) -> list[float]:
    """Convert texts to finite numbers; raises ``ValueError`` with a reason."""
    with suppress(ValueError):
        quick = list(map(float, fields))
        joined = "".join(fields)
        if math.isfinite(sum(quick)) and "_" not in joined and joined.isascii():
            return quick
    values = []
    for each in fields:
        try:
            value = float(each)
        except ValueError:
            raise ValueError(f"{each.strip()[:40]!r} is not a number") from None
        if not math.isfinite(value) or "_" in each or not each.isascii():
            raise ValueError(f"{each.strip()[:40]!r} is not a finite number")
        values.append(value)
    return values


def _check_norm(pose: Sequence[float], most: float) -> None:
    x, y, z, w = pose[3:]
    squared = x * x + y * y + z * z + w * w
    if abs(squared - 1.0) > most:
        raise ValueError(f"the quaternion has length {math.sqrt(squared):.6g}, not 1")


def _stamp(text: tuple[str, str], unit: Unit, *, whole: bool) -> int:
    first, rest = text
    if rest:
        seconds, nanoseconds = integer_ns(first), integer_ns(rest)
        if nanoseconds >= NS_PER_SECOND:
            raise ValueError(f"{rest!r} nanoseconds are more than a second")
        return units_to_ns(f"{seconds}.{nanoseconds:09d}", "s")
    decimals = first.partition(".")[2].strip("0")
    if unit == "ns" and not whole and decimals.isdecimal():
        raise ValueError(f"{first[:40]!r} is not a whole number of nanoseconds")
    return integer_ns(first) if whole and unit == "ns" else units_to_ns(first, unit)


def _unit(
    lines: Lines,
    layout: Layout,
    given: Unit | None,
    numbers: Sequence[int],
    texts: Sequence[tuple[str, str]],
    report: TrajectoryRows,
) -> tuple[Unit, dict[int, str]]:
    """Return the unit of the stamps: the given one, that of the format, or one by their size.

    In the last case also return, by line, why the size of a stamp fits another unit.
    """
    if given is not None or layout.unit is not None:
        return given or layout.unit or "s", {}
    sizes = {
        number: size
        for number, (text, _) in zip(numbers, texts, strict=True)
        if (size := whole_part(text)) is not None
    }
    usual = sorted(sizes.values())[len(sizes) // 2] if sizes else 0
    unit = _unit_by_size(usual)
    if unit is not None:
        if unit != "s":
            asked = f"stamp_unit={unit!r} (--stamp-unit {unit})"
            name = UNITS[unit][1]
            report.notes.append(f"stamps taken as {name}, by their size; {asked} confirms it")
        shown = {number: text for number, (text, _) in zip(numbers, texts, strict=True)}
        return unit, _odd_units(unit, sizes, shown)
    line = next(number for number, size in sizes.items() if size >= usual)
    raise lines.error(
        line,
        f"stamp {sizes[line]} is too large for seconds, and not a date in another unit; set "
        f"stamp_unit= (--stamp-unit) to one of {', '.join(UNITS)}",
    )


def _unit_by_size(size: int) -> Unit | None:
    """Return the unit of a stamp by its size; None if it is too large and no date in any unit."""
    if size <= MAX_STAMP // NS_PER_SECOND:
        return "s"
    for unit, (power, _) in UNITS.items():
        scale = 10 ** (9 - power)
        if _YEARS[0] * scale <= size < _YEARS[1] * scale:
            return unit
    return None


def _odd_units(usual: Unit, sizes: Mapping[int, int], shown: Mapping[int, str]) -> dict[int, str]:
    """Return, by line, why the size of a stamp does not fit the unit of most stamps."""
    if not sizes or _unit_by_size(min(sizes.values())) == _unit_by_size(max(sizes.values())):
        return {}
    units = {line: _unit_by_size(size) for line, size in sizes.items() if size >= 0}
    near = next(line for line, unit in units.items() if unit == usual)
    odd: dict[int, str] = {}
    for line, unit in units.items():
        if unit == usual:
            near = line
        elif unit is not None or usual != "s":
            what = "is not a date in any unit" if unit is None else f"looks like {UNITS[unit][1]}"
            odd[line] = (
                f"stamp {shown[line][:40]} {what}, {shown[near][:40]} in line {near} like "
                f"{UNITS[usual][1]}"
            )
    return odd


def _of_unit(unit: Unit, given: Unit | None, layout: Layout) -> str:
    """Return an addition to the error about a stamp whose unit was guessed."""
    if given is not None or layout.unit is not None or unit != "s":
        return ""
    return "; stamps are read as seconds, stamp_unit= (--stamp-unit) sets another unit"


def _doubt_seconds(
    stamps: Stamps, texts: Sequence[tuple[str, str]], report: TrajectoryRows
) -> None:
    """Note integer stamps that are too far apart for seconds."""
    if len(stamps) < 3 or not all(first.isdecimal() and not rest for first, rest in texts):
        return
    step = int(np.median(np.diff(stamps)))
    if step > _LONG_STEP:
        report.notes.append(
            f"stamps taken as seconds are {step // NS_PER_SECOND:,} s apart; stamp_unit='ns' "
            "(--stamp-unit ns) reads nanoseconds, 'us' microseconds"
        )

"""Finds the columns of stamp and pose in a table by their names.

It knows the names in TUM and EuRoC files, and those of `rostopic echo -p`, bagpy, PlotJuggler and
evo. Similar names are valid: a word for time, and `x`, `y`, `z`, `w` after a word for positions or
rotations.
"""

from __future__ import annotations

import re
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from tfdb.data.decimal_time import Unit

    Words = tuple[str, ...]
    Parts = Mapping[Words, Mapping[str, int]]

_POSITION = frozenset(("position", "pos", "p", "t", "translation", "trans", "location"))
_ROTATION = frozenset(
    ("orientation", "orient", "ori", "rotation", "rot", "quaternion", "quat", "q", "attitude")
)
_FUSED_POSITION = re.compile(r"(t|p|pos|position|trans|translation)([xyz])")
_FUSED_ROTATION = re.compile(r"(q|quat|quaternion|ori|orientation|rot|rotation)([xyzw])")
_TIMES = frozenset(("time", "timestamp", "stamp"))
_UNITS: dict[str, Unit] = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
    **dict.fromkeys(("ms", "msec", "msecs", "millisec", "milliseconds"), "ms"),
    **dict.fromkeys(("us", "usec", "usecs", "microsec", "microseconds", "µs", "μs"), "us"),
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanosec", "nanosecs", "nanoseconds"), "ns"),
}
_SECONDS = frozenset(("sec", "secs", "seconds"))
_NANOSECONDS = frozenset(("nsec", "nsecs", "nanosec", "nanosecs", "nanoseconds"))
_IN_BRACKETS = re.compile(r"[\[(]\s*([^\])\d]*?|1)\s*[\])]\s*$")
_METRES = frozenset(("", "m", "meter", "meters", "metre", "metres", "-", "1"))


class NamesError(ValueError):
    """Names that do not identify stamp and pose; the text is the reason."""


@dataclass(frozen=True)
class PoseColumns:
    """The columns of stamp and pose.

    `pose` has the positions of x, y, z, qx, qy, qz, qw. If `stamp` holds whole seconds,
    `nanoseconds` is the column with the rest. `unit` is the unit that the name of the stamp states.
    """

    stamp: int
    pose: tuple[int, ...]
    nanoseconds: int | None = None
    unit: Unit | None = None
    note: str = ""


@dataclass(frozen=True)
class _Name:
    """The words of a column name, and its unit in brackets."""

    raw: str
    words: Words
    unit: str


@dataclass(frozen=True)
class _Time:
    """One or two columns that may hold the stamps; the lowest rank is preferred."""

    rank: int
    words: Words
    stamp: int
    unit: Unit | None
    nanoseconds: int | None = None


def named_columns(names: Sequence[str]) -> PoseColumns:
    """Find stamp and pose among the names of columns; raises NamesError if they are ambiguous."""
    read = [_read(name) for name in names]
    positions = _complete_parts("xyz", _parts(read, _POSITION, _FUSED_POSITION))
    rotations = _complete_parts("xyzw", _parts(read, _ROTATION, _FUSED_ROTATION))
    listed = ", ".join(names)
    for found, what in ((positions, "position (x, y, z)"), (rotations, "quaternion (qx ... qw)")):
        if not found:
            raise NamesError(f"its header names no {what}: {listed[:200]}")
    position, rotation = _one_pose(names, positions, rotations)
    for place in positions[position].values():
        if read[place].unit not in _METRES:
            unit = read[place].unit
            raise NamesError(f"positions are metres, but {names[place]!r} is in {unit!r}")
    times = _times(read)
    if not times:
        raise NamesError(f"its header names no time (timestamp, time, stamp): {listed[:200]}")
    best = _best(names, times, position)
    places = (*positions[position].values(), *rotations[rotation].values())
    note = ""
    if len(positions) > 1 or len(rotations) > 1 or len(times) > 1:
        stamps = [best.stamp] + ([] if best.nanoseconds is None else [best.nanoseconds])
        note = "columns taken: " + ", ".join(names[place] for place in (*stamps, *places))
    return PoseColumns(best.stamp, places, best.nanoseconds, best.unit, note)


def _read(name: str) -> _Name:
    lowered = name.strip().lower()
    found = _IN_BRACKETS.search(lowered)
    rest = lowered[: found.start()] if found else lowered
    return _Name(name, tuple(re.findall(r"[a-z0-9µμ]+", rest)), found.group(1) if found else "")


def _parts(
    names: Sequence[_Name], kinds: frozenset[str], fused: re.Pattern[str]
) -> dict[Words, dict[str, int]]:
    """Return the columns of x, y, z (and w) by their prefix, such as `pose`, `position`."""
    found: dict[Words, dict[str, int]] = defaultdict(dict)
    for place, name in enumerate(names):
        if not name.words:
            continue
        *before, last = name.words
        together = fused.fullmatch(last)
        if together:
            key, axis = (*before, together.group(1)), together.group(2)
        elif last in ("x", "y", "z", "w") and _is_of(before, kinds):
            key, axis = tuple(before), last
        else:
            continue
        if axis in found[key]:
            raise NamesError(f"its header must name each axis once, but repeats {name.raw!r}")
        found[key][axis] = place
    return found


def _is_of(before: Sequence[str], kinds: frozenset[str]) -> bool:
    """Return whether an axis belongs to `kinds`. `x` alone, or of a pose, is a position."""
    rotates = bool(_ROTATION.intersection(before))
    if kinds is _ROTATION:
        return rotates
    return not rotates and (not before or before[-1] == "pose" or bool(kinds.intersection(before)))


def _complete_parts(axes: str, parts: Parts) -> dict[Words, dict[str, int]]:
    """Keep the parts that have all axes."""
    return {
        key: {axis: found[axis] for axis in axes}
        for key, found in parts.items()
        if all(axis in found for axis in axes)
    }


def _one_pose(names: Sequence[str], positions: Parts, rotations: Parts) -> tuple[Words, Words]:
    """Return the position and the rotation of the same pose."""
    if len(positions) == len(rotations) == 1:
        return next(iter(positions)), next(iter(rotations))
    pairs = [
        (position, rotation)
        for position in positions
        for rotation in rotations
        if _stem(position, _POSITION) == _stem(rotation, _ROTATION)
    ]
    if len(pairs) != 1:
        firsts = ", ".join(repr(names[found["x"]]) for found in positions.values())
        raise NamesError(f"its header names several poses; keep the columns of one of {firsts}")
    return pairs[0]


def _stem(words: Words, kinds: frozenset[str]) -> Words:
    return tuple(word for word in words if word not in kinds)


def _times(names: Sequence[_Name]) -> list[_Time]:
    """Return the columns that may hold the stamps."""
    halves: dict[Words, dict[str, int]] = defaultdict(dict)
    for place, name in enumerate(names):
        *before, last = name.words or ("",)
        if last in _SECONDS | _NANOSECONDS and (not before or before[-1] in _TIMES):
            halves[tuple(before)]["s" if last in _SECONDS else "ns"] = place
    pairs = {key: found for key, found in halves.items() if len(found) == 2}
    times = [_Time(_rank(key), key, found["s"], "s", found["ns"]) for key, found in pairs.items()]
    taken = {place for found in pairs.values() for place in found.values()}
    for place, name in enumerate(names):
        single = None if place in taken else _single(place, name)
        if single is not None:
            times.append(single)
    return times


def _single(place: int, name: _Name) -> _Time | None:
    words, unit = name.words, _UNITS.get(name.unit)
    if words == ("t",):
        return _Time(1, words, place, unit)
    if words == ("utime",):
        return _Time(1, words, place, "us")
    if words and words[-1] in _UNITS and (len(words) > 1 or words[0] in _SECONDS | _NANOSECONDS):
        unit, words = _UNITS[words[-1]], words[:-1]
        if words in ((), ("t",)):
            return _Time(1, words, place, unit)
    if not words or words[-1] not in _TIMES:
        return None
    if name.raw.startswith(("%", "field.")):
        unit = "ns"  # rostopic echo -p
    elif name.raw == "__time":
        unit = "s"  # PlotJuggler
    return _Time(_rank(words), words, place, unit)


def _rank(words: Words) -> int:
    """Return the rank of a time: header stamps come first, then plain times, then others."""
    return 0 if "header" in words else 1 if len(words) <= 1 else 2


def _best(names: Sequence[str], times: Sequence[_Time], position: Words) -> _Time:
    least = min(time.rank for time in times)
    best = [time for time in times if time.rank == least]
    most = max(_common(time.words, position) for time in best)
    best = [time for time in best if _common(time.words, position) == most]
    if len(best) > 1:
        listed = ", ".join(repr(names[time.stamp]) for time in best)
        raise NamesError(f"its header names several times; keep one of {listed}")
    return best[0]


def _common(words: Words, others: Words) -> int:
    """Count the leading words that both have in common."""
    count = 0
    for ours, theirs in zip(words, others, strict=False):
        if ours != theirs:
            break
        count += 1
    return count

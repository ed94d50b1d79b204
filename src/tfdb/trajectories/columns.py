"""Finds the columns of stamp and pose in a text file.

The names in a header decide. Without a header the number of columns decides, if only one program
writes this number. Guesses are noted for the user; ambiguous files are refused.
"""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

from tfdb.data.counting import counted
from tfdb.data.decimal_time import Unit, is_whole

from .column_names import NamesError, named_columns
from .lines import has_decimal_commas, separator_of, split
from .tables import COLUMNS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from .lines import Lines

Row: TypeAlias = "tuple[int, str]"

NAME_THEM = (
    "name the columns in the first line, such as `timestamp x y z qx qy qz qw`, or give format="
)


@dataclass(frozen=True)
class Layout:
    """The columns of a file.

    Parameters
    ----------
    text
        The columns as text, for errors.
    separator
        None: blanks.
    counts
        Valid numbers of columns.
    order
        The position of each of `COLUMNS`.
    nanoseconds
        The column with the nanoseconds of the stamp, if its seconds have a separate column.
    unit
        Unit of the stamps; None: found by their size.
    whole
        Stamps with decimals are errors.
    holes
        A pose may be missing: empty, or NaN as a whole.
    note
        A guess about the columns that the user must know; empty without a guess.
    """

    text: str
    separator: str | None
    counts: tuple[int, ...]
    order: tuple[int, ...] = tuple(range(8))
    nanoseconds: int | None = None
    unit: Unit | None = None
    whole: bool = False
    holes: bool = False
    note: str = ""

    def fields(self, line: str) -> list[str]:
        """Split a line into fields; a separator at its end adds no field."""
        fields = split(line, self.separator)
        if self.separator and not fields[-1] and len(fields) - 1 in self.counts:
            fields.pop()
        return fields


_W_FIRST = (0, 1, 2, 3, 5, 6, 7, 4)
_TUM = Layout("seconds x y z qx qy qz qw", None, (8,))
_EUROC = Layout("nanoseconds,x,y,z,qw,qx,qy,qz", ",", (8, 11, 17), _W_FIRST, unit="ns", whole=True)
"""8 columns with poses alone, 11 with velocity (VINS), 17 with velocity and biases (EuRoC)."""
_CSV = Layout(",".join(COLUMNS), ",", (8,), unit="ns", whole=True, holes=True)
_LAYOUTS = {"tum": _TUM, "euroc": _EUROC, "csv": _CSV}
_COVARIANCES = 20
_QUATERNION = re.compile(r"\bq(?:\w*_)?([wxyz])\b", re.IGNORECASE)
"""Matches header names of the parts of a quaternion: `qx`, `q_x`, `q_RS_x []`."""


def layout_of(lines: Lines, kind: str | None) -> Layout | None:
    """Return the columns of a file; None for KITTI poses.

    `kind` is `tum`, `euroc`, `csv` or None. Raises TrajectoryError if the header contradicts it, or
    the columns are ambiguous.
    """
    sample = _sample(lines)
    if sample is None:
        raise lines.error(None, "no pose in it")
    number, first = sample
    if has_decimal_commas(first):
        reason = "decimal commas: write the numbers with points, such as 0.5"
        raise lines.error(number, reason)
    separator = separator_of(first)
    if kind is not None:
        layout = _LAYOUTS[kind]
        named = _named(lines, sample, separator, fallback=True) if kind == "csv" else None
        if named is not None:
            return named
        _refuse_other_order(lines, kind, layout)
        return replace(layout, separator=separator if kind == "tum" else layout.separator)
    fields = split(first, separator)
    as_euroc = separator == "," and len(fields) in _EUROC.counts and is_whole(fields[0])
    named = _named(lines, sample, separator, fallback=as_euroc)
    return named if named is not None else _guessed(lines, sample, separator)


def _sample(lines: Lines) -> Row | None:
    """Return the first line with the most frequent number of columns."""
    rows = lines.rows
    if not rows:
        return None
    counts = [len(split(line, separator_of(line))) for _, line in rows[:200]]
    usual = Counter(counts).most_common(1)[0][0]
    return rows[counts.index(usual)]


def _named(lines: Lines, sample: Row, separator: str | None, *, fallback: bool) -> Layout | None:
    """Return the columns that a header names; None without a header.

    A comment is a header only if it names all needed columns. A header that is not a comment must
    name them, except with a `fallback`.
    """
    fields = split(sample[1], separator)
    for number, heading in reversed(list(lines.headings())):
        failures: list[NamesError] = []
        for names in _names_of(heading, separator):
            # An index column may have no name.
            if len(names) == len(fields) - 1 and _first_counts(lines, separator):
                names.insert(0, "")
            try:
                return _layout_named(sample, names, _counts(names, fields), separator)
            except NamesError as error:
                failures.append(error)
        if lines.heading is not None and number == lines.heading[0] and not fallback:
            raise lines.error(number, str(failures[0]))
    return None


def _names_of(heading: str, separator: str | None) -> list[list[str]]:
    """Yield the names in a header, split by the separator of the data, then by others."""
    glued = re.sub(r"\s*([\[(])\s*([^\])\d]*?)\s*([\])])", r"\1\2\3", heading)
    separators = dict.fromkeys((separator, separator_of(heading), None))
    return [split(glued if each is None else heading, each) for each in separators]


def _counts(names: Sequence[str], fields: Sequence[str]) -> tuple[int, ...]:
    count = len(names)
    if count > 1 and not names[-1]:
        return (count, count - 1)
    if count == len(fields) or (count == len(fields) - 1 and not fields[-1]):
        return (count,)
    raise NamesError(f"its header names {count} columns, but its rows have {len(fields)}")


def _layout_named(
    sample: Row, names: Sequence[str], counts: tuple[int, ...], separator: str | None
) -> Layout:
    named = named_columns(names)
    order = (named.stamp, *named.pose)
    text = (separator or " ").join(names)
    layout = Layout(text, separator, counts, order, named.nanoseconds, named.unit, note=named.note)
    if names[named.stamp] == COLUMNS[0]:
        return replace(layout, unit="ns", whole=True, holes=True)
    as_euroc = separator == "," and order == _W_FIRST and counts[0] in _EUROC.counts
    if as_euroc and named.unit is None and is_whole(layout.fields(sample[1])[0]):
        return replace(layout, unit="ns", whole=True)
    return layout


def _refuse_other_order(lines: Lines, kind: str, layout: Layout) -> bool:
    """Refuse a header with another quaternion order; return whether a header has this order."""
    confirmed = False
    found = sorted((place, part) for part, place in zip("xyzw", layout.order[4:], strict=True))
    expected = "".join(part for _, part in found)
    for number, heading in lines.headings():
        said = "".join(_QUATERNION.findall(heading)).lower()
        if sorted(said) == sorted(expected) and said != expected:
            raise lines.error(
                number,
                f"the header has the quaternion order {' '.join(said)}, but format {kind!r} has "
                f"{' '.join(expected)}; without format= a header that names all columns decides",
            )
        confirmed = confirmed or said == expected
    return confirmed


def _guessed(lines: Lines, sample: Row, separator: str | None) -> Layout | None:
    """Guess the columns by their number, if only one program writes this number."""
    number, first = sample
    fields = split(first, separator)
    if separator and not fields[-1]:
        fields.pop()
    count = len(fields)
    if separator is None or separator == "\t":
        if count == 12:
            return None
        if count == 8:
            return _checked(lines, "tum", _TUM)
        if count == _COVARIANCES:
            note = "20 columns: taken as `seconds x y z qx qy qz qw` and 12 of a covariance"
            return _checked(lines, "tum", replace(_TUM, counts=(count,), note=note))
        if count == 9 and _first_counts(lines, separator):
            note = "9 columns, the first of which counts the rows: taken as `index seconds x y z qx"
            order = tuple(range(1, 9))
            layout = replace(_TUM, counts=(count,), order=order, note=f"{note} qy qz qw`")
            return _checked(lines, "tum", layout)
    elif separator == "," and count in _EUROC.counts and is_whole(fields[0]):
        more = {8: "", 11: ",vx,vy,vz"}.get(count, ",...")
        note = f"{count} columns without known names: taken as `{_EUROC.text}{more}`"
        note = "" if count == 17 else note  # only EuRoC has this number
        return _checked(lines, "euroc", replace(_EUROC, counts=(count,), note=note))
    what = {None: "blanks", "\t": "tabs", ",": "commas", ";": "semicolons"}[separator]
    if count in (8, 9, 11, 17, _COVARIANCES):
        reason = f"{count} columns by {what} without a header match several formats: {NAME_THEM}"
        raise lines.error(number, reason + ("'tum'" if count == 8 else "..."))
    raise lines.error(
        number,
        f"no known format has {counted(count, 'column')}: TUM has 8 and KITTI 12, by blanks; EuRoC "
        f"has 8, 11 or 17, by commas; {NAME_THEM}...",
    )


def _checked(lines: Lines, kind: str, layout: Layout) -> Layout:
    """Return the columns; without a note if a header has their quaternion order."""
    if _refuse_other_order(lines, kind, layout) and kind == "euroc":
        return replace(layout, note="")
    return layout


def _first_counts(lines: Lines, separator: str | None) -> bool:
    """Return whether the first column counts the rows from 0 or 1."""
    firsts = [split(line, separator)[0] for _, line in lines.rows]
    start = firsts[0]
    return start in ("0", "1") and all(
        field == str(number) for number, field in enumerate(firsts, int(start))
    )

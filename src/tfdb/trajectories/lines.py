"""The lines of a trajectory in a text file: data, comments, headers, separators."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from tfdb.data.errors import TrajectoryError
from tfdb.data.path_checks import shell_word

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

SALVAGE = "salvage=True (--salvage)"
_NUMBER_FIRST = re.compile(r"[\s,;\"']*[-+.]?\d")
_LAST_DECIMALS = re.compile(r"(?:^|[\s,;\"'])[-+]?\d+(?:\.(\d*))?[\"'\s,;]*$")
_DECIMAL_COMMA = re.compile(r"[-+]?\d+,\d+([eE][-+]?\d+)?")
_COMMENT = re.compile(r"(?:#|//|%(?=\s|$))+\s*")
"""Begin a comment; `%time` is a column name of `rostopic echo -p`."""
_MANY_ROWS, _MANY_DECIMALS = 10, 4
_UTF16 = (b"\xff\xfe", b"\xfe\xff")
_ZEROS = re.compile(rb"\0{16,}")
"""A block of zero bytes: after a power cut it stands for text that was not written."""
_BINARY = re.compile(rb"[\0-\x08\x0e-\x1f\x7f]")


class Lines:
    """The data lines of a text file, with their numbers.

    Raises TrajectoryError for binary files and text that is not UTF-8. With `salvage`, only lines
    with invalid characters are skipped.
    """

    def __init__(self, path: Path, raw: bytes, *, salvage: bool = False) -> None:
        self.path = path
        self._ends = raw.endswith((b"\n", b"\r"))
        if raw.startswith(_UTF16):
            raise TrajectoryError(path, None, "UTF-16 text: save it as UTF-8")
        _check_text(path, raw)
        try:
            text = raw.decode("utf-8-sig", errors="replace" if salvage else "strict")
        except UnicodeDecodeError as error:
            line = raw.count(b"\n", 0, error.start) + 1
            raise self.skippable(line, "not UTF-8 text") from None
        self._all = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
        self.rows: list[tuple[int, str]] = [
            (number, stripped)
            for number, line in enumerate(self._all, start=1)
            if (stripped := line.strip())
            and not (stripped[0] in "#/%" and _COMMENT.match(stripped))
        ]
        """The lines with data: all except comments and a header."""
        self.heading: tuple[int, str] | None = None
        """The first line, if it is neither a comment nor data."""
        if self.rows and is_heading(self.rows[0][1]):
            self.heading = self.rows.pop(0)

    def headings(self) -> Iterator[tuple[int, str]]:
        """The lines before the first data: comments and column names."""
        for number, line in enumerate(self._all, start=1):
            if _NUMBER_FIRST.match(line):
                return
            if line.strip():
                yield number, _COMMENT.sub("", line.strip(), count=1)

    def cut(self) -> str | None:
        """Return why the last row seems cut: no end of line, and fewer decimals than other rows.

        Empty unless the other rows are many and have equally many decimals.
        """
        if self._ends or len(self.rows) < _MANY_ROWS:
            return None
        ends = [_LAST_DECIMALS.search(line) for _, line in self.rows]
        if None in ends:
            return None
        *others, last = (len(end.group(1) or "") for end in ends if end)
        if len(set(others)) != 1 or others[0] < _MANY_DECIMALS or last >= others[0]:
            return None
        return f"the file ends within a number, with {last} decimals instead of {others[0]}"

    def error(self, line: int | None, reason: str) -> TrajectoryError:
        """Make an error about a line, or about the file."""
        return TrajectoryError(self.path, line, reason)

    def skippable(self, line: int | None, reason: str) -> TrajectoryError:
        """Make an error about a line that `salvage` skips."""
        return self.error(line, f"{reason}; {SALVAGE} skips such rows")


def _check_text(path: Path, raw: bytes) -> None:
    """Raise TrajectoryError for binary files; text may hold blocks of zero bytes."""
    if raw.startswith(b"\x1f\x8b"):
        word = shell_word(path.name)
        what = f"compressed with gzip: run `gzip -dc {word} > FILE` first, and give FILE"
        raise TrajectoryError(path, None, what)
    if b"\0" not in raw:
        return
    text = _ZEROS.sub(b"", raw.rstrip(b"\0"))
    if not text:
        raise TrajectoryError(path, None, f"all its {len(raw):,} bytes are zero")
    first = text[:4096].partition(b"\n")[0].decode(errors="replace")
    if b"\0" in raw[:4096] and ("\ufffd" in first or _BINARY.search(text[:4096])):
        what = "a binary file, but neither NPZ nor Parquet"
        raise TrajectoryError(path, None, what)


def zeros(line: str) -> str | None:
    """Return why a line with zero bytes is not a row; None without zero bytes."""
    count = line.count("\0")
    if not count:
        return None
    if count == 1:
        return "1 zero byte, as a power cut leaves it"
    return f"{count:,} zero bytes, as a power cut leaves them"


def is_heading(line: str) -> bool:
    """Return whether a line names columns: none of its fields is a number."""
    if _NUMBER_FIRST.match(line):
        return False
    return not any(_is_number(field) for field in split(line, separator_of(line)))


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return True


def separator_of(line: str) -> str | None:
    """Return the separator of the columns; None for blanks."""
    for separator in (";", ","):
        if separator in line:
            return separator
    # Tabs separate empty fields too, unless blanks stand between them.
    return "\t" if line.count("\t") >= 7 and " " not in line else None


def split(line: str, separator: str | None) -> list[str]:
    """Split a line into fields, without surrounding blanks and quotes."""
    fields = line.split(separator)
    if separator is not None or '"' in line or "'" in line:
        return [field.strip().strip("\"'") for field in fields]
    return fields


def has_decimal_commas(line: str) -> bool:
    """Return whether the numbers of a line have decimal commas, as in `0,5`."""
    for separator in (";", None):
        fields = split(line, separator)
        if sum(_DECIMAL_COMMA.fullmatch(field) is not None for field in fields) >= 7:
            return True
    return False

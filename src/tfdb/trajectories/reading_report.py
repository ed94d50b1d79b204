"""Counts of the rows of a trajectory file."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tfdb.data.errors import TfdbWarning
from tfdb.data.loss import Loss

if TYPE_CHECKING:
    from collections.abc import Iterator


@dataclass
class TrajectoryRows:
    """Counts of the rows of a trajectory file.

    Parameters
    ----------
    path
        The file.
    rows
        Rows with data.
    poses
        Poses read, including missing ones (rows of NaN in CSV, NPZ and Parquet).
    repeated
        Rows that a later row with the same stamp replaced.
    differing
        Repeated rows that differ from the later row by more than 1 cm or 1 degree.
    moved
        Rows that followed a later stamp, and were sorted (`salvage`).
    normalised
        Quaternions between 0.5 % and 5 % off unit length that were normalised (`salvage`).
    skipped, bytes_skipped, first_skipped
        Rows without a valid stamp or pose (`salvage`), their size, and why the first was skipped.
    notes
        Guesses about the format: the unit of the stamps, the columns.
    """

    path: str
    rows: int = 0
    poses: int = 0
    repeated: int = 0
    differing: int = 0
    moved: int = 0
    normalised: int = 0
    skipped: int = 0
    bytes_skipped: int = 0
    first_skipped: str = ""
    notes: list[str] = field(default_factory=list)

    def skip(self, line: int | None, size: int, reason: str) -> None:
        """Count a skipped row."""
        self.skipped += 1
        self.bytes_skipped += size
        if not self.first_skipped:
            self.first_skipped = reason if line is None else f"line {line}: {reason}"

    @property
    def losses(self) -> tuple[Loss, ...]:
        """Return the skipped rows as losses of a salvaged recording."""
        if not self.skipped:
            return ()
        more = f", and {self.skipped - 1:,} more rows" if self.skipped > 1 else ""
        reason = f"{self.first_skipped}{more}"
        return (Loss(self.path, reason, self.skipped, self.bytes_skipped),)

    @property
    def summary(self) -> str:
        """Number of rows, and counts of those without a pose of their own."""
        parts = [f"{self.rows:,} row{'' if self.rows == 1 else 's'}"]
        if self.repeated:
            other = f", {self.differing:,} with another pose" if self.differing else ""
            parts.append(f"{self.repeated:,} with a repeated stamp{other} (the last row counts)")
        if self.moved:
            parts.append(f"{self.moved:,} out of order, sorted")
        if self.normalised:
            parts.append(f"{self.normalised:,} with the quaternion normalised")
        if self.skipped:
            parts.append(f"{self.skipped:,} skipped ({self.first_skipped})")
        return ", ".join(parts)

    def __str__(self) -> str:
        """Write the path and the counts in one line."""
        return f"{self.path}: {self.summary}"

    def complaints(self) -> Iterator[str]:
        """Texts of warnings, each with the path of the file."""
        if self.repeated or self.moved or self.normalised or self.skipped:
            yield f"{self.path}: {self.summary}"
        for note in self.notes:
            yield f"{self.path}: {note}"


def warn_of_rows(rows: TrajectoryRows, depth: int) -> None:
    """Warn with the texts of `complaints`; the caller is `depth` frames up."""
    for text in rows.complaints():
        warnings.warn(text, TfdbWarning, stacklevel=depth + 1)

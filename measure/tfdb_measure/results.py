"""What was measured: one row per run, written as it comes, and medians of the rounds."""

from __future__ import annotations

import csv
import statistics
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping
    from pathlib import Path

OWN_COLUMNS = ("sweep", "label", "round", "engine")


def number(value: float) -> str:
    """Three digits that matter."""
    if value == 0:
        return "0"
    if abs(value) >= 1e6:
        return f"{value / 1e6:.3g} M"
    if abs(value) >= 100:
        return f"{value:,.0f}"
    return f"{value:.3g}" if abs(value) >= 1e-3 else f"{value:.1e}"


@dataclass(frozen=True)
class Spread:
    """Median, smallest and largest of the rounds."""

    median: float
    low: float
    high: float


@dataclass(frozen=True)
class Cell:
    """What one contender of one row, or one engine at one point, was measured for."""

    sweep: str
    label: str
    engine: str
    column: str = "value"

    def holds(self, row: Mapping[str, Any]) -> bool:
        """Say whether a row is a round of it."""
        return (row["sweep"], row["label"], row["engine"]) == (self.sweep, self.label, self.engine)


@dataclass
class Results:
    """All rows; with a path, each is also appended to a CSV file before `add` returns."""

    path: Path | None = None
    rows: list[dict[str, Any]] = field(default_factory=list)

    def add(self, sweep: str, label: str, turn: int, engine: str, found: dict[str, Any]) -> None:
        """Add one run's result."""
        row = {"sweep": sweep, "label": label, "round": turn, "engine": engine}
        row |= {key: value for key, value in found.items() if key not in row}
        if self.path is not None:
            with self.path.open("a" if self.rows else "w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, fieldnames=list(row), extrasaction="ignore")
                if not self.rows:
                    writer.writeheader()
                writer.writerow(row)
        self.rows.append(row)

    def add_rounds(
        self, sweep: str, label: str, unit: str, rounds: Mapping[str, list[float]]
    ) -> None:
        """Add one row of several contenders: the values of their rounds."""
        for engine, values in rounds.items():
            for turn, value in enumerate(values, start=1):
                self.add(sweep, label, turn, engine, {"value": value, "unit": unit})

    @classmethod
    def read(cls, path: Path, *, without: Collection[str] = ()) -> Results:
        """Return what an earlier run has written, but for the sweeps that are measured again."""
        results = cls(path)
        if path.exists():
            with path.open(newline="", encoding="utf-8") as file:
                rows = [
                    {key: _value(text) for key, text in row.items()} for row in csv.DictReader(file)
                ]
            path.unlink()
            for row in rows:
                if row["sweep"] not in without:
                    own = [row.pop(name) for name in OWN_COLUMNS]
                    results.add(str(own[0]), str(own[1]), own[2], str(own[3]), row)
        return results

    def engines(self, sweep: str) -> list[str]:
        """Engines with a result, in the order of their first one."""
        return list(dict.fromkeys(row["engine"] for row in self.rows if row["sweep"] == sweep))

    def labels(self, sweep: str) -> list[str]:
        """Labels with a result, in the order of their first one."""
        return list(dict.fromkeys(row["label"] for row in self.rows if row["sweep"] == sweep))

    def sweeps(self) -> list[str]:
        """Sweeps with a result."""
        return list(dict.fromkeys(row["sweep"] for row in self.rows))

    def get(self, sweep: str, label: str, engine: str, column: str) -> Spread | None:
        """Return a column over the rounds of one point; None where nothing was measured."""
        values = list(self.rounds(Cell(sweep, label, engine, column)).values())
        if not values:
            return None
        return Spread(statistics.median(values), min(values), max(values))

    def rounds(self, cell: Cell) -> dict[int, float]:
        """Return the value of each round in which the cell was measured."""
        found = {row["round"]: _column(row, cell.column) for row in self.rows if cell.holds(row)}
        return {turn: float(value) for turn, value in found.items() if value is not None}

    def unit(self, sweep: str, label: str) -> str:
        """Return the unit of a row of contenders."""
        own = (row for row in self.rows if (row["sweep"], row["label"]) == (sweep, label))
        return str(next(own, {}).get("unit", ""))

    def shown(self, sweep: str, label: str) -> str:
        """Write the medians of a row of contenders."""
        cells = [Cell(sweep, label, engine) for engine in self.engines(sweep)]
        known = [(cell.engine, self.rounds(cell)) for cell in cells]
        medians = [
            f"{engine} {number(statistics.median(found.values()))}"
            for engine, found in known
            if found
        ]
        return f"{', '.join(medians)} {self.unit(sweep, label)}"

    def single_rounds(self) -> int:
        """Count the points that were measured only once: their spread is unknown."""
        rounds = Counter((row["sweep"], row["label"], row["engine"]) for row in self.rows)
        return sum(1 for count in rounds.values() if count == 1)

    def median(self, sweep: str, label: str, engine: str, column: str) -> float | None:
        """Return the median alone."""
        spread = self.get(sweep, label, engine, column)
        return None if spread is None else spread.median


def _value(text: str) -> Any:
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text or None


def _column(row: dict[str, Any], column: str) -> float | None:
    """Return a column of the driver's, or one that is made of several."""
    if column in row:
        value: float | None = row[column]
        return value
    return DERIVED[column](row) if column in DERIVED else None


def _per_operation(row: dict[str, Any]) -> float | None:
    done = row["reads_done"] + row["writes_done"]
    return aborted(row) / done if done else None


def aborted(row: dict[str, Any]) -> float:
    """Attempts that came to nothing: the engine's retries, lapped lookups, lost transactions."""
    lost: float = row["retries"] + row["lapped_reads"] + row["reads_lost"] + row["writes_lost"]
    return lost


def _total(row: dict[str, Any]) -> float:
    total: float = row["reads_per_s"] + row["writes_per_s"]
    return total


def _per_write(row: dict[str, Any]) -> float | None:
    return aborted(row) / row["writes_done"] if row["writes_done"] else None


def _per_read(row: dict[str, Any]) -> float | None:
    return aborted(row) / row["reads_done"] if row["reads_done"] else None


def _retries_per_write(row: dict[str, Any]) -> float | None:
    return row["retries"] / row["writes_done"] if row["writes_done"] else None


DERIVED: dict[str, Callable[[dict[str, Any]], float | None]] = {
    "aborts_per_operation": _per_operation,
    "aborts_per_read": _per_read,
    "aborts_per_write": _per_write,
    "operations_per_s": _total,
    "retries_per_write": _retries_per_write,
}
"""Columns that are made of the driver's."""

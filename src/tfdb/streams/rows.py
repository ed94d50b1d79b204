"""Samples of commits as the rows of one table."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain, compress
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from tfdb._core import rows_of_commits
from tfdb.data.types import Batch, Columns

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import numpy.typing as npt

    from tfdb.data.types import Changes

__all__: list[str] = []


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """N samples T[parent<-child], in the order of commits."""

    parents: list[str]
    children: list[str]
    stamps: npt.NDArray[np.int64]
    """Nanoseconds; 0 of a static transform."""
    poses: npt.NDArray[np.float64]
    statics: npt.NDArray[np.bool_]
    commits: npt.NDArray[np.int64]
    authorities: list[str]

    def __len__(self) -> int:
        return len(self.parents)

    def part(self, first: int, last: int) -> Rows:
        """Return the rows from `first` to `last`, excluding `last`."""
        return Rows(*(column[first:last] for column in self.columns()))

    def chosen(self, mask: npt.NDArray[np.bool_]) -> Rows:
        """Return the rows for which the mask is true."""
        columns: list[Any] = [
            column[mask] if isinstance(column, np.ndarray) else list(compress(column, mask))
            for column in self.columns()
        ]
        return Rows(*columns)

    def columns(self) -> tuple[Any, Any, Any, Any, Any, Any, Any]:
        """Return all columns, in the order of the fields."""
        return (
            self.parents, self.children, self.stamps, self.poses, self.statics, self.commits,
            self.authorities,
        )  # fmt: skip

    def batch(self) -> Batch:
        """Return the moving and the static rows as columns."""
        parts = (self, NONE)
        if self.statics.any():
            parts = (self.chosen(~self.statics), self.chosen(self.statics))
        moving, static = parts
        return Batch(
            Columns(moving.parents, moving.children, moving.stamps, moving.poses),
            Columns(static.parents, static.children, None, static.poses),
            np.concatenate([moving.commits, static.commits]),
            (*moving.authorities, *static.authorities),
        )


def joined(parts: Sequence[Rows]) -> Rows:
    """Return the rows of one table after those of the other."""
    parts = [part for part in parts if len(part)]
    if len(parts) < 2:
        return parts[0] if parts else NONE
    columns: list[Any] = [
        np.concatenate(same) if isinstance(same[0], np.ndarray) else [*chain(*same)]
        for same in zip(*(part.columns() for part in parts), strict=True)
    ]
    return Rows(*columns)


def of_bytes(data: bytes) -> tuple[int, Rows]:
    """Read bytes of `commits_bytes` or `state_bytes`: their last commit, and the rows."""
    last, columns, _ = rows_of_commits(data)
    return last, Rows(*columns)


class Stretch(NamedTuple):
    """Samples of commits, and the frames that were cleared or removed before these samples."""

    cleared: frozenset[str]
    rows: Rows
    commit: int
    """The commit that cleared them; 0: none."""

    @property
    def arrived(self) -> Rows:
        """The samples that arrived. If the commit replaced a history, only the newest of each edge.

        So the old samples that a player's jump or a restarted copy stores do not count as arrivals.
        """
        if not self.cleared:
            return self.rows
        count = int(np.searchsorted(self.rows.commits, self.commit, side="right"))
        children = self.rows.children[:count]  # the rows of an edge are sorted by stamp
        newest = {child: row for row, child in enumerate(children)}
        gone = [
            child in self.cleared and newest[child] != row for row, child in enumerate(children)
        ]
        kept = np.ones(len(self.rows), dtype=bool)
        kept[:count] = ~np.array(gone, dtype=bool)
        return self.rows.chosen(kept)


def stretches_of_bytes(data: bytes) -> tuple[int, list[Stretch]]:
    """Read bytes of `commits_bytes`: their last commit, and the samples, divided at each clear."""
    last, columns, resets = rows_of_commits(data)
    rows = Rows(*columns)
    found = []
    begun, by, cleared = 0, 0, frozenset[str]()
    for row, commit, frames in resets:
        found.append(Stretch(cleared, rows.part(begun, row), by))
        begun, by, cleared = row, commit, frozenset(frames)
    found.append(Stretch(cleared, rows.part(begun, len(rows)), by))
    return last, found


def stretches_of_changes(records: Iterable[Changes]) -> list[Stretch]:
    """Return the readable samples of these commits, with the frames that each commit cleared."""
    return [
        Stretch(frozenset({*record.cleared, *record.removed}), of_changes([record]), record.commit)
        for record in records
    ]


def of_changes(records: Iterable[Changes]) -> Rows:
    """Return the readable samples of these commits."""
    parts = []
    for record in records:
        moving, static = record.stored, record.stored_static
        stamps = np.asarray(moving.stamps, np.int64)
        count = len(moving) + len(static)
        parts.append(
            Rows(
                [*moving.parents, *static.parents],
                [*moving.children, *static.children],
                np.concatenate([stamps, np.zeros(len(static), np.int64)]),
                np.concatenate([moving.poses, static.poses]),
                np.arange(count) >= len(moving),
                np.full(count, record.commit, np.int64),
                list(record.authorities),
            )
        )
    return joined(parts)


NONE = Rows(
    [], [], np.zeros(0, np.int64), np.zeros((0, 7)), np.zeros(0, bool), np.zeros(0, np.int64), []
)

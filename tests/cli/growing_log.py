"""A log of transforms that grows message by message."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

import numpy as np

from tfdb.judging.doctor import Edge, Log

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence


class GrowingLog(Log):
    """A log of single transforms."""

    def __init__(self) -> None:
        super().__init__()
        self._rows: dict[str, list[tuple[int, int, Sequence[float], int, int, bool]]]
        self._rows = defaultdict(list)

    def add(
        self,
        rows: Iterable[tuple[str, str, int, Sequence[float]]],
        *,
        arrival: int,
        publisher: str,
        static: bool,
    ) -> None:
        """Add one message's transforms: (parent, child, stamp, pose of 7) each."""
        for parent, child, stamp, pose in rows:
            ids = self._id(parent), self._id(publisher)
            self._rows[child].append((stamp, arrival, pose, *ids, static))

    def edges(self) -> Iterator[Edge]:
        """Return the edges by name."""
        for name, rows in sorted(self._rows.items()):
            yield Edge(name, *map(np.array, zip(*rows, strict=True)))

"""Folds subtrees, so that a picture has a limited number of rows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tfdb.data.errors import InvalidArgument

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from tfdb.data.types import FrameInfo
    from tfdb.store.summary import Forest


@dataclass(frozen=True)
class FoldedRow:
    """A frame, or (without `info`) the folded frames below `parent`."""

    parent: str | None
    depth: int
    info: FrameInfo | None
    hidden: tuple[FrameInfo, ...] = ()


def check_rows(rows: object) -> None:
    """Refuse values that are not a number of rows."""
    if rows is not None and (type(rows) is not int or rows < 1):
        raise InvalidArgument(
            f"rows must be an integer of at least 1, or None, got {rows!r}", value=rows
        )


class Folds:
    """The folded children of each frame.

    `heights` is the number of rows of each frame; None: one each.
    """

    def __init__(self, forest: Forest, heights: Mapping[str, int] | None = None) -> None:
        self.forest = forest
        self.away: dict[str, list[str]] = {}
        """By parent, the children in its folded row."""
        self.sizes: dict[str, int] = {}
        """Number of frames of each subtree, with its root."""
        self._hidden: set[str] = set()
        self._still: dict[str, bool] = {}
        self._depths: dict[str, int] = {}
        self._heights: dict[str, int] = {}
        self._shown: dict[str, int] = {}
        rows = forest.rows()
        for row in rows:
            self._depths[row.info.name] = row.depth
        for row in reversed(rows):
            name = row.info.name
            below = forest.children[name]
            self.sizes[name] = 1 + sum(self.sizes[child] for child in below)
            self._still[name] = row.info.is_static and all(self._still[child] for child in below)
            self._heights[name] = 1 if heights is None else heights[name]
            self._shown[name] = self._heights[name] + self._rows(below)

    @property
    def frames(self) -> int:
        """Number of folded frames."""
        return sum(self.sizes[child] for below in self.away.values() for child in below)

    def fold(self, rows: int) -> None:
        """Fold until at most `rows` rows are left, if possible."""
        shown = sum(self._shown[root] for root in self.forest.roots)
        names = sorted(self.forest.by_name)
        still = {
            name: [child for child in self.forest.children[name] if self._still[child]]
            for name in names
        }
        # What hangs in a subtree of static edges goes with it.
        tops = [name for name in names if not self._still[name] and still[name]]
        for name in sorted(tops, key=lambda top: -self._rows(still[top])):
            if shown <= rows:
                return
            shown -= self._hide(name, still[name])
        inner = [name for name in names if self.forest.children[name]]
        for name in sorted(inner, key=lambda top: (-self._depths[top], -self.sizes[top], top)):
            if shown <= rows:
                return
            shown -= self._hide(name, self.forest.children[name])

    def rows(self) -> Iterator[FoldedRow]:
        """Return the remaining rows, from top to bottom."""
        frames = self.forest.by_name
        stack = [FoldedRow(frames[root].parent, 0, frames[root]) for root in self.forest.roots]
        stack.reverse()
        while stack:
            row = stack.pop()
            yield row
            if row.info is None:
                continue
            name, depth = row.info.name, row.depth + 1
            hidden = self.away.get(name, [])
            below = [
                FoldedRow(name, depth, frames[child])
                for child in self.forest.children[name]
                if child not in set(hidden)
            ]
            if hidden:
                infos = [each.info for child in hidden for each in self.forest.walk(child)]
                below.append(FoldedRow(name, depth, None, tuple(infos)))
            stack.extend(reversed(below))

    def _rows(self, children: Sequence[str]) -> int:
        return sum(self._shown[child] for child in children)

    def _hide(self, parent: str, children: list[str]) -> int:
        """Fold children; return the number of saved rows."""
        if parent in self._hidden:
            return 0
        before = self._shown[parent]
        others = [child for child in self.forest.children[parent] if child not in set(children)]
        after = self._heights[parent] + 1 + self._rows(others)
        if before - after < 1:
            return 0
        self.away[parent] = children
        name: str | None = parent
        while name in self._shown:
            self._shown[name] -= before - after
            name = self.forest.by_name[name].parent
        stack = list(children)
        while stack:
            name = stack.pop()
            if name not in self._hidden:
                self._hidden.add(name)
                self.away.pop(name, None)  # of nested folds only the outermost counts
                stack.extend(self.forest.children[name])
        return before - after

"""The edges of recordings, to resolve offsets, frame sets and new names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from tfdb.store.summary import span

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from typing import Self

    from tfdb._core import Buffer

    Surveyed = Mapping[str, tuple[str, tuple[int, int] | None]]


@dataclass(frozen=True)
class RecordedEdges:
    """The frames of recordings, under their names there.

    Parameters
    ----------
    frames
        The frames, sorted.
    parents
        All parents that each child frame had.
    span
        First and last stamp of the moving edges, nanoseconds; None without moving edges.
    """

    frames: list[str]
    parents: Mapping[str, set[str]]
    span: tuple[int, int] | None

    @classmethod
    def of_survey(cls, edges: Surveyed) -> Self:
        """Return the edges that a `_core.EdgeSurvey` found."""
        frames = sorted({*edges, *(parent for parent, _ in edges.values())})
        moving = [stamps for _, stamps in edges.values() if stamps is not None]
        ends = (min(a for a, _ in moving), max(b for _, b in moving)) if moving else None
        return cls(frames, {child: {parent} for child, (parent, _) in edges.items()}, ends)

    @classmethod
    def of_store(cls, store: Buffer) -> Self:
        """Return the edges of a store that keeps everything."""
        infos = store.tree()
        parents: dict[str, set[str]] = {}
        for info in infos:
            if info.is_static and info.parent is not None:
                parents[info.name] = {info.parent}
            elif info.oldest is not None:
                parents[info.name] = set(store.samples(info.name)[2])
        return cls(sorted(store.frames()), parents, span(infos))

    def between(self, frames: Iterable[str]) -> frozenset[str]:
        """Return the children of the edges on the paths between frames, at any time.

        In a tree with only one of the frames: the edges on its path to the root.
        """
        above = {frame: self._up(frame) for frame in frames if frame in self.frames}
        kept: set[str] = set()
        for ours in above.values():
            together = [up for up in above.values() if not up.isdisjoint(ours)]
            for child in ours & self.parents.keys():
                joint = all(child in up for up in together)
                if len(together) == 1 or not joint or self._is_unsure(child, ours):
                    kept.add(child)
        return frozenset(kept)

    def _is_unsure(self, child: str, ours: set[str]) -> bool:
        """Return whether a descendant had several parents, so that paths may include this edge."""
        below = (each for each in ours if len(self.parents.get(each, ())) > 1)
        return any(child in self._up(each) for each in below)

    def _up(self, frame: str) -> set[str]:
        """Return a frame and all its ancestors at any time."""
        found, waiting = {frame}, [frame]
        while waiting:
            fresh = self.parents.get(waiting.pop(), set()) - found
            found |= fresh
            waiting += fresh
        return found

"""Statistics of a store, edge by edge: periods, gaps, trees, the time span.

The command line, the pictures and the demo use them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

from tfdb.data.stamps import format_seconds

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    import numpy as np
    import numpy.typing as npt

    from tfdb._core import Buffer, Snapshot, StoreReader
    from tfdb.data.types import FrameInfo

YEAR_NS = 365 * 86_400 * 1_000_000_000
"""Stamps further apart than this belong to different clocks."""

GAP_FACTOR = 5
"""An interval is a gap if it is longer than this many median periods of its edge."""


@dataclass(frozen=True)
class Gap:
    """An interval of an edge without samples: from `before` to `after`, in nanoseconds."""

    before: int
    after: int

    @property
    def length(self) -> int:
        """Length of the interval in nanoseconds."""
        return self.after - self.before


@dataclass(frozen=True)
class EdgeSummary:
    """One edge: its FrameInfo, period and gaps.

    `period` is the median interval between samples in nanoseconds (None with fewer than two
    samples), `longest` the longest interval, `gaps` the intervals longer than the limit.
    """

    info: FrameInfo
    period: int | None
    longest: Gap | None
    gaps: tuple[Gap, ...]


def static_edges(store: StoreReader) -> Iterator[tuple[FrameInfo, str, list[float]]]:
    """Yield each static edge with its parent and its pose: x y z, then the quaternion x y z w."""
    for info in store.tree():
        if info.is_static and info.parent is not None:
            yield info, info.parent, store.samples(info.name)[1][0].tolist()


def find_gaps(
    stamps: npt.NDArray[np.int64], max_gap: int | None = None
) -> tuple[int | None, Gap | None, tuple[Gap, ...]]:
    """Return median period, longest interval and gaps of sorted stamps, in nanoseconds.

    `max_gap` is the longest interval that is not a gap; None: GAP_FACTOR median periods.
    """
    if len(stamps) < 2:
        return None, None, ()
    import numpy as np

    steps = np.diff(stamps)
    period = int(np.partition(steps, len(steps) // 2)[len(steps) // 2])
    limit = GAP_FACTOR * period if max_gap is None else max_gap
    widest = int(np.argmax(steps))
    longest = Gap(int(stamps[widest]), int(stamps[widest + 1]))
    wide = np.flatnonzero(steps > limit)
    return period, longest, tuple(Gap(int(stamps[i]), int(stamps[i + 1])) for i in wide)


def edge_summaries(store: Buffer | Snapshot, max_gap: int | None = None) -> list[EdgeSummary]:
    """Return all edges of a store (frames with a parent), sorted by name.

    `max_gap` in nanoseconds as in :func:`find_gaps`.
    """
    found = []
    for info in store.tree():
        if info.parent is None:
            continue
        if info.is_static:
            found.append(EdgeSummary(info, None, None, ()))
        else:
            found.append(EdgeSummary(info, *find_gaps(store.samples(info.name)[0], max_gap)))
    return sorted(found, key=lambda edge: edge.info.name)


@dataclass(frozen=True)
class Clock:
    """A clock of stamps: its first and last stamp, and the moving edges with such stamps."""

    start: int
    end: int
    frames: tuple[str, ...]

    def __str__(self) -> str:
        listed = ", ".join(self.frames[:3])
        more = f" and {len(self.frames) - 3} more" if len(self.frames) > 3 else ""
        return f"{listed}{more} from {format_seconds(self.start)} to {format_seconds(self.end)}"


def clocks(infos: Iterable[FrameInfo], store: Buffer | Snapshot) -> list[Clock]:
    """Group the moving edges of a store by the clocks of their stamps, the earliest clock first.

    Stamps of two clocks, such as a simulated and a real one, are more than a year apart. An edge
    with stamps of both is listed with both.
    """
    spans = [(*ends, info.name) for info in infos for ends in _spans(info, store)]
    found: list[tuple[int, int, dict[str, None]]] = []
    for start, end, name in sorted(spans):
        if found and start - found[-1][1] <= YEAR_NS:
            first, last, frames = found[-1]
            frames[name] = None
            found[-1] = first, max(last, end), frames
        else:
            found.append((start, end, {name: None}))
    return [Clock(start, end, tuple(frames)) for start, end, frames in found]


def _spans(info: FrameInfo, store: Buffer | Snapshot) -> Iterator[tuple[int, int]]:
    """Return the first and last stamp of an edge on each of its clocks."""
    if info.oldest is None or info.newest is None:
        return
    if info.longest_gap <= YEAR_NS:
        yield info.oldest, info.newest
        return
    import numpy as np

    stamps = store.samples(info.name)[0]
    for part in np.split(stamps, np.flatnonzero(np.diff(stamps) > YEAR_NS) + 1):
        if len(part):
            yield int(part[0]), int(part[-1])


def describe_clocks(found: Sequence[Clock]) -> str:
    """Return the warning for several clocks in one store; empty for one clock."""
    if len(found) < 2:
        return ""
    text = f"stamps of {len(found)} clocks, more than a year apart: " + "; ".join(map(str, found))
    for one, other in pairwise(found):
        both = sorted(set(one.frames) & set(other.frames))
        if both:
            text += f"; {', '.join(both[:3])} has stamps of both"
            text += "; lookups between them interpolate over the time in between"
        if other.start - YEAR_NS <= one.end * 1_000_000_000 <= other.end + YEAR_NS:
            return f"{text}; the small ones look like seconds: tfdb.stamp() converts them"
    return f"{text}; paths over edges of both have no answer"


def span(infos: Iterable[FrameInfo]) -> tuple[int, int] | None:
    """Return the first and last moving stamp in nanoseconds; None if no edge moves."""
    moving = [(i.oldest, i.newest) for i in infos if i.oldest is not None and i.newest is not None]
    if not moving:
        return None
    return min(first for first, _ in moving), max(last for _, last in moving)


@dataclass(frozen=True)
class TreeRow:
    """A frame of a printed tree: `depth` edges below its root; `last`: no sibling follows."""

    info: FrameInfo
    depth: int
    last: bool


class Forest:
    """Frames sorted into trees: roots with the most frames first, children by name."""

    def __init__(self, infos: Iterable[FrameInfo]) -> None:
        self.by_name: dict[str, FrameInfo] = {info.name: info for info in infos}
        self.children: dict[str, list[str]] = {name: [] for name in self.by_name}
        roots: list[str] = []
        for info in self.by_name.values():
            if info.parent in self.children:
                self.children[info.parent].append(info.name)
            else:
                roots.append(info.name)
        for names in self.children.values():
            names.sort()
        sizes = {root: sum(1 for _ in self.walk(root)) for root in roots}
        self.roots: list[str] = sorted(roots, key=lambda root: (-sizes[root], root))

    def walk(self, root: str) -> Iterator[TreeRow]:
        """Yield the frames of one tree, each before its children."""
        stack = [(root, 0, True)]
        while stack:
            name, depth, last = stack.pop()
            yield TreeRow(self.by_name[name], depth, last)
            names = self.children[name]
            stack.extend((child, depth + 1, child == names[-1]) for child in reversed(names))

    def rows(self) -> list[TreeRow]:
        """List all trees one after the other."""
        return [row for root in self.roots for row in self.walk(root)]

    def chain(self, name: str) -> list[FrameInfo]:
        """List the edges from a frame up to its root, the frame's own first."""
        edges = []
        info = self.by_name[name]
        while info.parent in self.by_name:
            edges.append(info)
            info = self.by_name[info.parent]
        return edges


def longest_moving_chain(infos: Iterable[FrameInfo]) -> tuple[str, str] | None:
    """Return a root and the descendant with the most moving edges between them.

    The edges must have a time span in common. Among equals the longer span counts, then the longer
    path, then the name. None if no edge moves.
    """
    forest = Forest(infos)
    best: tuple[tuple[int, int, int], str, str] | None = None
    for name in sorted(forest.by_name):
        chain = forest.chain(name)
        moving = [
            (i.oldest, i.newest) for i in chain if i.oldest is not None and i.newest is not None
        ]
        if not moving:
            continue
        common = min(last for _, last in moving) - max(first for first, _ in moving)
        if common <= 0:
            continue
        key = (len(moving), common, len(chain))
        root = chain[-1].parent
        if root is not None and (best is None or key > best[0]):
            best = (key, root, name)
    return None if best is None else best[1:]

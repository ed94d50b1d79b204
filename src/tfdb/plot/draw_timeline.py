"""Draws when each edge has samples: one row per moving edge, with gaps, late data, publishers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from tfdb.data.errors import InvalidArgument
from tfdb.data.policies import Interpolate
from tfdb.store.summary import (
    GAP_FACTOR,
    EdgeSummary,
    Forest,
    clocks,
    edge_summaries,
    find_gaps,
    span,
)

from . import label_fitting, style
from .axis_ticks import number
from .folding import Folds, check_rows

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tfdb._core import Buffer, Snapshot
    from tfdb.data.types import FrameInfo

    Stamps = npt.NDArray[np.int64]

# In points.
_ROW = 12.0
_HEAD = 50.0
_FOOT = 40.0
_INDENT = 8.0  # where there is room
_BETWEEN = 8.0
_TICKS_AT_MOST = 250


@dataclass(frozen=True)
class Arrivals:
    """The samples of one edge in the order of arrival, and the publisher of each."""

    stamps: Sequence[int] | Stamps
    """Nanoseconds."""
    publishers: Sequence[str]
    """A publisher for each sample; empty where unknown."""


@dataclass(frozen=True)
class _Row:
    """A row: moving edges, the samples of one publisher, or (without stamps) static edges."""

    text: str
    depth: int
    note: str
    color: str
    loud: bool = False
    stamps: Stamps | None = None
    late: Stamps | None = None
    max_gap: int | None = None


def timeline(
    store: Buffer | Snapshot,
    *,
    title: str | None = None,
    max_gap: float | None = None,
    arrivals: Mapping[str, Arrivals] | None = None,
    width: float = 10.0,
    rows: int | None = 100,
) -> Figure:
    """Draw one row per moving edge over time, in tree order; all static edges share one row.

    Gaps longer than the limit are red. Rows with many samples are drawn as bars between gaps, rows
    with few samples as single strokes. The number of late samples stands to the right of the row.
    Times are in seconds from the first sample.

    Parameters
    ----------
    store
        A store or a snapshot.
    title
        Title of the picture. None: "Samples of each edge".
    max_gap
        Longest accepted gap in seconds. None: five median periods of each edge.
    arrivals
        The arrivals of each child frame, which a store does not keep; `tfdb plot` reads them from
        the recording. Late samples are marked, and each publisher of an edge has its own row.
    width
        Width of the picture in inches, from 5 to 100. The number of rows sets its height.
    rows
        Largest number of rows. Beyond it subtrees are folded, the deepest first. A folded row has
        the samples of all its edges. None: no limit.

    Raises
    ------
    InvalidArgument
        `max_gap`, `width` or `rows` is outside its range, `arrivals` is not a mapping to
        `Arrivals`, or the numbers of publishers and stamps differ.
    """
    if not hasattr(store, "samples"):
        got = type(store).__name__
        raise InvalidArgument(f"store must be a Buffer or a Snapshot, got {got}", value=store)
    limit = None if max_gap is None else Interpolate(max_gap).limit_ns
    if not _is_width(width):
        raise InvalidArgument(f"width must be 5 to 100 inches, got {width!r}", value=width)
    check_rows(rows)
    edges = edge_summaries(store, limit)
    whole = span(edge.info for edge in edges) or (0, 0)
    made = _Rows(store, edges, _checked(arrivals), limit)
    drawn = made.listed(rows)
    deepest = max((row.depth for row in drawn), default=0)
    step = min(_INDENT, 0.15 * width * 72 / max(deepest, 1))
    names, notes, left, right = _columns(drawn, width * 72, step)
    marks = _handles(drawn, edges)
    room = width * 72 - 2 * style.MARGIN
    lines = -(-len(marks) // style.legend_columns([str(m.get_label()) for m in marks], room))
    head = _HEAD + lines * style.LEGEND_ROW + 8
    height = head + _FOOT + max(len(drawn), 1) * _ROW
    figure = style.new_figure(width, height / 72)
    style.title(
        figure,
        title if title is not None else "Samples of each edge",
        _under(edges, whole, made.folded, len(clocks((edge.info for edge in edges), store))),
        x=style.MARGIN / 72 / width,
    )
    style.legend(figure, marks, (style.MARGIN, head - lines * style.LEGEND_ROW - 8), room)
    axes = figure.add_axes(
        (
            left / 72 / width,
            _FOOT / height,
            (width * 72 - left - right) / 72 / width,
            1 - (head + _FOOT) / height,
        )
    )
    _style_axes(axes, len(drawn), whole, (width * 72 - left - right))
    for at, row in enumerate(drawn):
        _draw(axes, at, row, whole)
    _names(figure, drawn, names, notes, (head, width * 72 - right), step)
    return figure


def _is_width(value: object) -> bool:
    real = isinstance(value, int | float) and not isinstance(value, bool)
    return real and 5 <= value <= 100  # type: ignore[operator]


def _checked(arrivals: Any) -> dict[str, tuple[Stamps, list[str]]]:
    """Return the arrivals as columns; raise InvalidArgument for other types."""
    try:
        given = dict(arrivals or {})
        found = {
            name: (np.asarray(each.stamps, dtype=np.int64), list(each.publishers))
            for name, each in given.items()
        }
    except (TypeError, ValueError, AttributeError, OverflowError) as error:
        raise InvalidArgument(
            f"arrivals must map child frames to tfdb.plot.Arrivals: {error}", value=arrivals
        ) from None
    for name, (stamps, publishers) in found.items():
        if stamps.shape != (len(publishers),):
            raise InvalidArgument(
                f"arrivals of {name!r}: {len(publishers)} publishers for {stamps.size} stamps",
                value=arrivals,
            )
    return found


class _Rows:
    """Makes the rows."""

    def __init__(
        self,
        store: Buffer | Snapshot,
        edges: Sequence[EdgeSummary],
        arrivals: Mapping[str, tuple[Stamps, list[str]]],
        max_gap: int | None,
    ) -> None:
        self.store = store
        self.edges = {edge.info.name: edge for edge in edges}
        self.arrivals = arrivals
        self.max_gap = max_gap
        self.folded = 0
        """Number of moving edges in folded rows."""
        self.publishers = {
            name: sorted(set(filter(None, by))) for name, (_, by) in arrivals.items()
        }

    def listed(self, rows: int | None) -> list[_Row]:
        """Return at most `rows` rows if possible: moving edges in tree order, then static ones."""
        infos = self.store.tree()
        folds = Folds(Forest(infos), {info.name: self._height(info) for info in infos})
        still = {info.name for info in infos if info.is_static}
        if rows is not None:
            folds.fold(max(rows - bool(still), 1))
        found: list[_Row] = []
        depths: dict[str | None, int] = {}
        for row in folds.rows():
            above = depths.get(row.parent, 0)
            if row.info is None:
                found += self._folded(row.hidden, above)
                continue
            moving = row.info.name in self.edges and not row.info.is_static
            depths[row.info.name] = above + moving
            if self._height(row.info):
                found += self._edge(row.info, above)
                still.discard(row.info.name)
        if still:
            text = f"{len(still)} static edge{'s' if len(still) != 1 else ''}"
            found.append(_Row(text, 0, "static", style.STATIC))
        return found

    def _several(self, name: str) -> int:
        """Return the number of publishers of an edge; 0 for a single one."""
        count = len(self.publishers.get(name, ()))
        return count if count > 1 else 0

    def _height(self, info: FrameInfo) -> int:
        """Return how many rows an edge takes."""
        several = self._several(info.name)
        if info.is_static:
            return int(several > 0)
        return 1 + several if info.name in self.edges else 0

    def _edge(self, info: FrameInfo, depth: int) -> Iterator[_Row]:
        """Return the row of an edge, followed by one row for each of several publishers."""
        several = self._several(info.name)
        said = f"{several} publishers" if several else ""
        if info.is_static:
            yield _Row(info.name, depth + 1, said, style.STATIC, loud=True)
            return
        late = self._late(info)
        count = info.late if late is None else len(late)
        rate = "" if info.rate is None else f"{info.rate:.3g} Hz"
        note = ", ".join(filter(None, (rate, f"{count:,} late" if count else "", said)))
        color = style.STATIC if several else style.MOVING
        loud = several > 0 or count > 0
        yield _Row(info.name, depth, note, color, loud, self._stamps(info), late, self.max_gap)
        if not several:
            return
        sent, by = self.arrivals[info.name]
        for i, publisher in enumerate(self.publishers[info.name]):
            own = np.unique(sent[np.array([name == publisher for name in by])])
            color = style.SERIES[i % len(style.SERIES)]
            yield _Row(f"by {publisher}", depth + 2, _rate(own), color, stamps=own)

    def _folded(self, infos: Sequence[FrameInfo], depth: int) -> Iterator[_Row]:
        """Return one row for many edges: all their samples, and the gaps common to all."""
        moving = [info for info in infos if info.name in self.edges and not info.is_static]
        if not moving:
            return
        stamps = np.unique(np.concatenate([self._stamps(info) for info in moving]))
        marks = [self._late(info) for info in moving]
        known = [late for late in marks if late is not None]
        count = sum(
            info.late if late is None else len(late)
            for info, late in zip(moving, marks, strict=True)
        )
        gaps = sum(len(self.edges[info.name].gaps) for info in moving)
        several = sum(self._several(info.name) > 0 for info in moving)
        said = (
            f"{gaps:,} gap{'s' if gaps != 1 else ''}" if gaps else "",
            f"{count:,} late" if count else "",
            f"{several} with several publishers" if several else "",
        )
        periods = [self.edges[info.name].period or 0 for info in moving]
        self.folded += len(moving)
        yield _Row(
            f"+ {len(moving)} moving edge{'s' if len(moving) != 1 else ''}",
            depth,
            ", ".join(filter(None, said)),
            style.MOVING,
            count > 0 or several > 0,
            stamps,
            np.unique(np.concatenate(known)) if known else None,
            GAP_FACTOR * max(periods) if self.max_gap is None else self.max_gap,
        )

    def _stamps(self, info: FrameInfo) -> Stamps:
        return np.asarray(self.store.samples(info.name)[0])

    def _late(self, info: FrameInfo) -> Stamps | None:
        """Return the late samples, if arrivals are known."""
        sent = self.arrivals.get(info.name, (np.empty(0, np.int64),))[0]
        return _late(sent) if len(sent) else None


def _late(sent: Stamps) -> Stamps:
    """Return the stamps that arrived after a newer one."""
    return np.unique(sent[1:][sent[1:] < np.maximum.accumulate(sent)[:-1]])


def _rate(stamps: Stamps) -> str:
    if len(stamps) < 2:
        return f"{len(stamps)} sample{'s' if len(stamps) != 1 else ''}"
    return f"{(len(stamps) - 1) / ((stamps[-1] - stamps[0]) / 1e9):.3g} Hz"


def _columns(
    rows: Sequence[_Row], width: float, step: float
) -> tuple[list[str], list[str], float, float]:
    """Return the names and notes, shortened to fit, and their widths with margins."""
    notes = [label_fitting.fitted(row.note, style.SMALL_SIZE, 0.3 * width) for row in rows]
    room = 0.42 * width
    names = [
        label_fitting.fitted(row.text, style.SMALL_SIZE, max(room - row.depth * step, 60))
        for row in rows
    ]
    left = max(
        (
            row.depth * step + label_fitting.width(name, style.SMALL_SIZE)
            for row, name in zip(rows, names, strict=True)
        ),
        default=20.0,
    )
    right = max((label_fitting.width(note, style.SMALL_SIZE) for note in notes), default=0.0)
    return names, notes, style.MARGIN + left + _BETWEEN, right + _BETWEEN + style.MARGIN


def _under(edges: Sequence[EdgeSummary], whole: tuple[int, int], folded: int, several: int) -> str:
    moving = [edge for edge in edges if not edge.info.is_static]
    gaps = sum(len(edge.gaps) for edge in moving)
    text = (
        f"{len(moving)} moving and {len(edges) - len(moving)} static edges over "
        f"{number((whole[1] - whole[0]) / 1e9, 1)} s, {gaps or 'no'} gap{'' if gaps == 1 else 's'}"
    )
    text += f"; {folded} are folded" if folded else ""
    return text + (f"; stamps of {several} clocks" if several > 1 else "")


def _style_axes(axes: Axes, rows: int, whole: tuple[int, int], room: float) -> None:
    style.tidy(axes)
    length = _length(whole)
    axes.set_xlim(-0.01 * length, 1.01 * length)
    axes.set_ylim(max(rows, 1) - 0.4, -0.6)
    axes.set_yticks([])
    axes.grid(visible=False, axis="y")
    style.label(axes, label_fitting.fitted(style.since(whole[0]), style.TEXT_SIZE, room), "")


def _length(whole: tuple[int, int]) -> float:
    """Return the seconds that the picture covers; more than 0 even for one sample."""
    return (whole[1] - whole[0]) / 1e9 or 1e-3


def _draw(axes: Axes, at: int, row: _Row, whole: tuple[int, int]) -> None:
    start = whole[0]
    if row.stamps is None:
        ends = [0, _length(whole)]
        axes.plot(ends, [at, at], color=row.color, linewidth=0.8, dashes=(4, 3))
        return
    seconds = (row.stamps - start) / 1e9
    gaps = find_gaps(row.stamps, row.max_gap)[2]
    if len(seconds) <= _TICKS_AT_MOST:
        strokes = [[(x, at - 0.32), (x, at + 0.32)] for x in seconds]
        axes.add_collection(LineCollection(strokes, colors=row.color, linewidths=0.7))
    else:
        cuts = np.flatnonzero(np.isin(row.stamps, [gap.after for gap in gaps]))
        bars = [[(part[0], at), (part[-1], at)] for part in np.split(seconds, cuts) if len(part)]
        axes.add_collection(
            LineCollection(bars, colors=row.color, linewidths=5.0, alpha=0.8, capstyle="butt")
        )
    holes = [[((gap.before - start) / 1e9, at), ((gap.after - start) / 1e9, at)] for gap in gaps]
    axes.add_collection(LineCollection(holes, colors=style.WARNING, linewidths=1.6))
    if row.late is not None and len(row.late):
        x = (row.late - start) / 1e9
        axes.plot(
            x,
            np.full(len(x), at - 0.1),
            linestyle="",
            marker="v",
            markersize=4.5,
            color=style.LATE,
            markeredgecolor=style.PAPER,
            markeredgewidth=0.5,
            zorder=4,
            clip_on=False,
        )


def _names(
    figure: Figure,
    rows: Sequence[_Row],
    names: Sequence[str],
    notes: Sequence[str],
    at: tuple[float, float],
    step: float,
) -> None:
    """Write each row's name at its left and its note at its right."""
    head, right = at
    width, height = figure.get_size_inches() * 72
    look: dict[str, Any] = {
        "fontsize": style.SMALL_SIZE,
        "va": "center_baseline",
        "parse_math": False,
        **style.font(),
    }
    for i, (row, name, note) in enumerate(zip(rows, names, notes, strict=True)):
        # The limits of the axes: -0.6 to rows - 0.4.
        y = 1 - (head + (i + 0.6) * _ROW * len(rows) / (len(rows) + 0.2)) / height
        quiet = row.stamps is None
        color = style.MUTED if quiet else style.INK
        figure.text((style.MARGIN + row.depth * step) / width, y, name, color=color, **look)
        loud = style.WARNING if row.loud else style.MUTED
        figure.text((right + _BETWEEN) / width, y, note, color=loud, **look)


def _handles(rows: Sequence[_Row], edges: Sequence[EdgeSummary]) -> list[Line2D]:
    """Return legend entries for the marks in the picture."""
    found = [Line2D([], [], color=style.MOVING, linewidth=4, label="samples")]
    if any(edge.gaps for edge in edges):
        found.append(Line2D([], [], color=style.WARNING, linewidth=1.6, label="gap"))
    if any(row.late is not None and len(row.late) for row in rows):
        found.append(Line2D([], [], color=style.LATE, marker="v", linestyle="", label="came late"))
    if any(row.stamps is None for row in rows):
        found.append(
            Line2D([], [], color=style.STATIC, linewidth=0.8, dashes=(4, 3), label="static")
        )
    if any("publishers" in row.note for row in rows):
        found.append(
            Line2D([], [], color=style.STATIC, linewidth=4, label="samples of several publishers")
        )
    return found

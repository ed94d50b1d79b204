"""When each edge has samples: one row per moving edge, with its gaps, late data and publishers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from ..errors import InvalidArgument
from ..policies import Interpolate
from ..summary import EdgeSummary, Forest, clocks, edge_summaries, find_gaps, span
from . import lettering, style

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .. import Buffer, Snapshot

    Stamps = npt.NDArray[np.int64]

# In points.
_ROW = 12.0
_HEAD = 50.0
_FOOT = 40.0
_INDENT = 8.0
_BETWEEN = 8.0
_TICKS_AT_MOST = 250


@dataclass(frozen=True)
class Arrivals:
    """The samples of one edge in the order in which they arrived, and who sent each."""

    stamps: Sequence[int] | Stamps
    """Nanoseconds."""
    publishers: Sequence[str]
    """A name for each sample; empty where nobody said."""


@dataclass(frozen=True)
class _Row:
    """A moving edge, what one of its publishers sent, or (without stamps) static edges."""

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
) -> Figure:
    """Draw one row per moving edge over time, sorted as the tree; all static edges are one row.

    Holes longer than the limit are red. Rows with many samples are drawn as bars from one gap to
    the next, rows with few as single strokes. How many samples of an edge came late is said at its
    right. Times are in seconds from the first sample.

    Parameters
    ----------
    store
        A store or a snapshot.
    title
        Instead of "Samples of each edge".
    max_gap
        The longest hole that is fine, in seconds. None: five median periods of each edge.
    arrivals
        By child frame, its samples as they came, which a store does not keep: late ones (older than
        one that came before) are marked where they lie, and an edge that several publishers write
        has a row for each of them. `tfdb plot` has them from the recording.
    width
        Of the picture, in inches, from 5 to 100. Its height comes from the number of edges.

    Raises
    ------
    InvalidArgument
        `max_gap` or `width` is outside its range, `arrivals` is no mapping to `Arrivals`, or one of
        them has not as many publishers as stamps.
    """
    if not hasattr(store, "samples"):
        got = type(store).__name__
        raise InvalidArgument(f"draw a store or a snapshot of one; got {got}", value=store)
    limit = None if max_gap is None else Interpolate(max_gap).limit_ns
    if not _is_width(width):
        raise InvalidArgument(f"width must be 5 to 100 inches, got {width!r}", value=width)
    edges = edge_summaries(store, limit)
    whole = span(edge.info for edge in edges) or (0, 0)
    rows = list(_rows(store, edges, _checked(arrivals), limit))
    names, notes, left, right = _columns(rows, width * 72)
    marks = _handles(rows, edges)
    room = width * 72 - 2 * style.MARGIN
    lines = -(-len(marks) // style.legend_columns([str(m.get_label()) for m in marks], room))
    head = _HEAD + lines * style.LEGEND_ROW + 8
    height = head + _FOOT + max(len(rows), 1) * _ROW
    figure = style.new_figure(width, height / 72)
    style.title(
        figure,
        title if title is not None else "Samples of each edge",
        _under(edges, whole),
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
    _axes_look(axes, len(rows), whole, (width * 72 - left - right))
    for at, row in enumerate(rows):
        _draw(axes, at, row, whole)
    _names(figure, rows, names, notes, (head, width * 72 - right))
    return figure


def _is_width(value: object) -> bool:
    real = isinstance(value, int | float) and not isinstance(value, bool)
    return real and 5 <= value <= 100  # type: ignore[operator]


def _checked(arrivals: Any) -> dict[str, tuple[Stamps, list[str]]]:
    """Return the arrivals as columns; raise InvalidArgument for what is none."""
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


def _rows(
    store: Buffer | Snapshot,
    edges: Sequence[EdgeSummary],
    arrivals: Mapping[str, tuple[Stamps, list[str]]],
    max_gap: int | None,
) -> list[_Row]:
    found: list[_Row] = []
    by_name = {edge.info.name: edge for edge in edges}
    still: list[str] = []
    depths: dict[str | None, int] = {}
    for row in Forest(edge.info for edge in edges).rows():
        info = row.info
        sent, by = arrivals.get(info.name, (np.empty(0, np.int64), []))
        publishers = sorted(set(filter(None, by)))
        depth = depths[info.name] = depths.get(info.parent, 0) + (not info.is_static)
        several = len(publishers) > 1
        said = f"{len(publishers)} publishers" if several else ""
        if info.is_static:
            if several:
                found.append(_Row(info.name, depth, said, style.STATIC, loud=True))
            else:
                still.append(info.name)
            continue
        stamps = np.asarray(store.samples(info.name)[0])
        late = _late(sent) if len(sent) else None
        count = len(late) if late is not None else by_name[info.name].info.late
        rate = "" if info.rate is None else f"{info.rate:.3g} Hz"
        note = ", ".join(filter(None, (rate, f"{count:,} late" if count else "", said)))
        color = style.STATIC if several else style.MOVING
        loud = several or count > 0
        found.append(_Row(info.name, depth - 1, note, color, loud, stamps, late, max_gap))
        for i, publisher in enumerate(publishers if several else ()):
            own = np.unique(sent[np.array([name == publisher for name in by])])
            color = style.SERIES[i % len(style.SERIES)]
            found.append(_Row(f"by {publisher}", depth + 1, _rate(own), color, stamps=own))
    if still:
        text = f"{len(still)} static edge{'s' if len(still) != 1 else ''}"
        found.append(_Row(text, 0, "static", style.STATIC))
    return found


def _late(sent: Stamps) -> Stamps:
    """Return the stamps that came after a newer one."""
    return np.unique(sent[1:][sent[1:] < np.maximum.accumulate(sent)[:-1]])


def _rate(stamps: Stamps) -> str:
    if len(stamps) < 2:
        return f"{len(stamps)} sample{'s' if len(stamps) != 1 else ''}"
    return f"{(len(stamps) - 1) / ((stamps[-1] - stamps[0]) / 1e9):.3g} Hz"


def _columns(rows: Sequence[_Row], width: float) -> tuple[list[str], list[str], float, float]:
    """Return the names and the notes as they fit, and how wide they are, margins included."""
    notes = [lettering.fitted(row.note, style.SMALL_SIZE, 0.3 * width) for row in rows]
    room = 0.42 * width
    names = [
        lettering.fitted(row.text, style.SMALL_SIZE, max(room - _indent(row), 60)) for row in rows
    ]
    left = max(
        (
            _indent(row) + lettering.width(name, style.SMALL_SIZE)
            for row, name in zip(rows, names, strict=True)
        ),
        default=20.0,
    )
    right = max((lettering.width(note, style.SMALL_SIZE) for note in notes), default=0.0)
    return names, notes, style.MARGIN + left + _BETWEEN, right + _BETWEEN + style.MARGIN


def _indent(row: _Row) -> float:
    return min(row.depth, 8) * _INDENT


def _under(edges: Sequence[EdgeSummary], whole: tuple[int, int]) -> str:
    moving = [edge for edge in edges if not edge.info.is_static]
    gaps = sum(len(edge.gaps) for edge in moving)
    text = (
        f"{len(moving)} moving and {len(edges) - len(moving)} static edges over "
        f"{(whole[1] - whole[0]) / 1e9:.1f} s, {gaps or 'no'} gap{'' if gaps == 1 else 's'}"
    )
    several = len(clocks(edge.info for edge in edges))
    return text + (f"; stamps of {several} clocks" if several > 1 else "")


def _axes_look(axes: Axes, rows: int, whole: tuple[int, int], room: float) -> None:
    style.tidy(axes)
    length = max((whole[1] - whole[0]) / 1e9, 1e-3)
    axes.set_xlim(-0.01 * length, 1.01 * length)
    axes.set_ylim(max(rows, 1) - 0.4, -0.6)
    axes.set_yticks([])
    axes.grid(visible=False, axis="y")
    axes.ticklabel_format(axis="x", useOffset=False, style="plain")
    style.label(axes, lettering.fitted(style.since(whole[0]), style.TEXT_SIZE, room), "")


def _draw(axes: Axes, at: int, row: _Row, whole: tuple[int, int]) -> None:
    start = whole[0]
    if row.stamps is None:
        ends = [0, max((whole[1] - start) / 1e9, 1e-3)]
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
        # As the axes lie: from -0.6 to rows - 0.4.
        y = 1 - (head + (i + 0.6) * _ROW * len(rows) / (len(rows) + 0.2)) / height
        quiet = row.stamps is None
        color = style.MUTED if quiet else style.INK
        figure.text((style.MARGIN + _indent(row)) / width, y, name, color=color, **look)
        loud = style.WARNING if row.loud else style.MUTED
        figure.text((right + _BETWEEN) / width, y, note, color=loud, **look)


def _handles(rows: Sequence[_Row], edges: Sequence[EdgeSummary]) -> list[Line2D]:
    """Explain the marks that are there."""
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

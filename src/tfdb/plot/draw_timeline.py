"""When each edge has samples: one row per edge, with its gaps."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from ..policies import Interpolate
from ..summary import EdgeSummary, edge_summaries, span
from . import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .. import Buffer, Snapshot

_ROW_INCHES = 0.155
_HEAD_INCHES = 0.85
_FOOT_INCHES = 0.55
_WIDTH_INCHES = 10.0
_LETTER_INCHES = 0.063
_TICKS_AT_MOST = 400


def timeline(
    store: Buffer | Snapshot, *, title: str | None = None, max_gap: float | None = None
) -> Figure:
    """Draw one row per edge over time: samples, holes longer than the limit in red, statics grey.

    `max_gap` is the longest hole in seconds that is fine; None takes five median periods of
    each edge. Moving edges come first, by name, then the static ones. Rows with many samples are
    drawn as bars from one gap to the next, rows with few as single strokes. Times in seconds from
    the first sample.
    """
    limit = None if max_gap is None else Interpolate(max_gap).limit_ns
    edges = edge_summaries(store, limit)
    moving = [edge for edge in edges if not edge.info.is_static]
    static = [edge for edge in edges if edge.info.is_static]
    whole = span(edge.info for edge in edges) or (0, 0)
    gaps = sum(len(edge.gaps) for edge in moving)
    height = _HEAD_INCHES + _FOOT_INCHES + max(len(edges), 1) * _ROW_INCHES
    figure = style.new_figure(_WIDTH_INCHES, height)
    length = (whole[1] - whole[0]) / 1e9
    style.title(
        figure,
        title or "Samples of each edge",
        f"{len(moving)} moving and {len(static)} static edges over {length:.1f} s, "
        f"{gaps or 'no'} gap{'' if gaps == 1 else 's'}",
    )
    names = [f"{edge.info.name}" for edge in (*moving, *static)]
    left = (max((len(name) for name in names), default=4) * _LETTER_INCHES + 0.25) / _WIDTH_INCHES
    left = min(left, 0.45)
    axes = figure.add_axes(
        (
            left,
            _FOOT_INCHES / height,
            0.93 - left,
            1 - (_HEAD_INCHES + _FOOT_INCHES) / height,
        )
    )
    _axes_look(axes, names, whole)
    for row, edge in enumerate(moving):
        _draw_moving(axes, row, edge, np.asarray(store.samples(edge.info.name)[0]), whole[0])
    for row, _ in enumerate(static, start=len(moving)):
        ends = [0, max(length, 1e-3)]
        axes.plot(ends, [row, row], color=style.STATIC, linewidth=0.8, dashes=(4, 3))
    _notes(axes, [*moving, *static], max(length, 1e-3))
    _legend(figure)
    return figure


def _axes_look(axes: Axes, names: list[str], whole: tuple[int, int]) -> None:
    style.tidy(axes)
    length = max((whole[1] - whole[0]) / 1e9, 1e-3)
    axes.set_xlim(-0.01 * length, 1.01 * length)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_yticks(range(len(names)), names)
    for text in axes.get_yticklabels():
        text.set_parse_math(False)
    axes.tick_params(axis="y", labelcolor=style.INK, length=0)
    axes.grid(visible=False, axis="y")
    style.label(axes, f"time since {whole[0] // 10**9}.{whole[0] % 10**9 // 10**6:03d} [s]", "")


def _draw_moving(
    axes: Axes, row: int, edge: EdgeSummary, stamps: npt.NDArray[np.int64], start: int
) -> None:
    seconds = (stamps - start) / 1e9
    if len(seconds) <= _TICKS_AT_MOST:
        strokes = [[(x, row - 0.32), (x, row + 0.32)] for x in seconds]
        axes.add_collection(LineCollection(strokes, colors=style.MOVING, linewidths=0.7))
    else:
        cuts = np.flatnonzero(np.isin(stamps, [gap.after for gap in edge.gaps]))
        bars = [[(part[0], row), (part[-1], row)] for part in np.split(seconds, cuts) if len(part)]
        axes.add_collection(LineCollection(bars, colors=style.MOVING, linewidths=5.0, alpha=0.8))
    holes = [
        [((gap.before - start) / 1e9, row), ((gap.after - start) / 1e9, row)] for gap in edge.gaps
    ]
    axes.add_collection(LineCollection(holes, colors=style.WARNING, linewidths=1.6))


def _notes(axes: Axes, edges: list[EdgeSummary], length: float) -> None:
    """Write the rate at the right end of each row."""
    for row, edge in enumerate(edges):
        info = edge.info
        note = "static" if info.is_static else "" if info.rate is None else f"{info.rate:.3g} Hz"
        axes.text(
            1.015 * length,
            row,
            note,
            fontsize=style.SMALL_SIZE - 1,
            color=style.MUTED,
            va="center",
            clip_on=False,
        )


def _legend(figure: Figure) -> None:
    figure.legend(
        handles=[
            Line2D([], [], color=style.MOVING, linewidth=4, label="samples"),
            Line2D([], [], color=style.WARNING, linewidth=1.6, label="gap"),
            Line2D([], [], color=style.STATIC, linewidth=0.8, dashes=(4, 3), label="static"),
        ],
        loc="upper right",
        bbox_to_anchor=(0.985, 1 - 0.12 / figure.get_figheight()),
        ncols=3,
        borderaxespad=0,
        fontsize=style.SMALL_SIZE,
        frameon=False,
        labelcolor=style.INK,
    )

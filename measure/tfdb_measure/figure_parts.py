"""What the pictures of a report are made of: panels, lines in an engine's look, their names."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from matplotlib.lines import Line2D
from matplotlib.ticker import (
    FixedLocator,
    FuncFormatter,
    LogLocator,
    NullFormatter,
    NullLocator,
)

from tfdb.plot import style

from .points import ENGINES, TF2

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .results import Spread

COLOURS = dict(
    zip(
        ENGINES,
        (
            "#1f6fb2",  # snapshot
            "#6b7780",  # giant
            "#c79a1b",  # fine
            "#2c8c4b",  # 2pl-no-wait
            "#8b5fbf",  # 2pl-wait-die
            "#cf3d2e",  # 2pl-wound-wait
            "#e0812f",  # silo
            "#111111",  # tf2
        ),
        strict=True,
    )
)
MARKERS = dict(zip(ENGINES, "osD^v<>X", strict=True))

# As wide as a page shows pictures: what is wider would be shrunk, its letters with it.
TEXT_SIZE = 9.0
_PANEL_INCHES = 3.3
_NARROW_INCHES = 2.4
_LABEL_INCHES = 1.4
_NARROW_LABEL_INCHES = 0.5
_HEAD_INCHES = 0.86
_PLOT_INCHES = 3.0
_FOOT_INCHES = 0.62
_LEFT_INCHES = 0.72
_LEGEND_INCHES = 0.25
_VALUE_POINTS = 17.0  # between two names on an axis
_LABEL_GAP = 0.062  # of the axes' height


@dataclass(frozen=True)
class Panel:
    """One pair of axes: which column, in which unit."""

    column: str
    label: str
    scale: float = 1.0  # what the column is multiplied with
    log: bool = True


def frame(
    panels: int, title: str, under: str, *, narrow: bool = False, legend: bool = False
) -> tuple[Figure, list[Axes]]:
    """Make a figure with a title and so many panels, room for names at the right of each.

    With `legend` there is room for one above them.
    """
    panel_inches = _NARROW_INCHES if narrow else _PANEL_INCHES
    label_inches = _NARROW_LABEL_INCHES if narrow else _LABEL_INCHES
    width = _LEFT_INCHES + panels * (panel_inches + label_inches)
    height = _HEAD_INCHES + legend * _LEGEND_INCHES + _PLOT_INCHES + _FOOT_INCHES
    figure = style.new_figure(width, height)
    style.title(figure, title, under, x=0.15 / width)
    axes = []
    for i in range(panels):
        left = _LEFT_INCHES + i * (panel_inches + label_inches)
        box = (
            left / width,
            _FOOT_INCHES / height,
            (panel_inches - 0.35) / width,
            _PLOT_INCHES / height,
        )
        made = figure.add_axes(box)
        style.tidy(made)
        made.tick_params(labelsize=TEXT_SIZE)
        axes.append(made)
    return figure, axes


def line(axes: Axes, engine: str, known: list[tuple[float, Spread]], panel: Panel) -> None:
    """Draw one engine over (x, spread): its median, and all rounds as a band."""
    x = [at for at, _ in known]
    scale = panel.scale
    floor = 0.1 if panel.log else 0.0  # a round in which nothing was done has no place on it
    axes.fill_between(
        x,
        [max(spread.low, floor * spread.median) * scale for _, spread in known],
        [spread.high * scale for _, spread in known],
        color=COLOURS[engine],
        alpha=0.10,
        linewidth=0,
    )
    axes.plot(
        x,
        [spread.median * scale for _, spread in known],
        color=COLOURS[engine],
        marker=MARKERS[engine],
        markersize=4.5 if engine in ("snapshot", TF2) else 3.5,
        linewidth=2.2 if engine in ("snapshot", TF2) else 1.2,
        linestyle="--" if engine == TF2 else "-",
        zorder=4 if engine == "snapshot" else 3,
    )


def name_values(axes: Axes, values: Sequence[float]) -> None:
    """Mark each value on the x axis, and name those that are not too close to another."""
    axes.xaxis.set_major_locator(FixedLocator(list(values)))
    axes.xaxis.set_minor_locator(NullLocator())
    room = _VALUE_POINTS / (axes.bbox.width / axes.figure.dpi * 72)
    to_axes = axes.transData + axes.transAxes.inverted()
    low = axes.get_ylim()[0]
    named: list[float] = []
    last = -math.inf
    for value in values:
        place = float(to_axes.transform((value, low))[0])
        if place - last >= room:
            named.append(value)
            last = place
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: short(x) if x in named else ""))


def scale(axes: Axes, *, log: bool) -> None:
    """Set the scale of the y axis, with at least one labelled tick per decade."""
    if log:
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        if high / low < 20:  # a decade at the least, so that a tick is labelled
            middle = math.sqrt(low * high)
            axes.set_ylim(min(low, middle / 4), max(high, middle * 4))
        few = high / low < 300
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
        axes.yaxis.set_minor_formatter(NullFormatter())
    else:
        axes.set_ylim(bottom=0)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: short(y)))


def short(value: float) -> str:
    """Write a number for an axis: 1.5k, 2M, 0.1."""
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= size * 0.9999:
            return f"{value / size:.3g}{letter}"
    return f"{value:.3g}"


def direct_labels(axes: Axes, ends: list[tuple[str, float, float]]) -> None:
    """Name each line where it ends; names that would meet are pushed apart."""
    to_axes = axes.transData + axes.transAxes.inverted()
    placed = sorted(
        (float(to_axes.transform((x, y))[1]), float(to_axes.transform((x, y))[0]), engine)
        for engine, x, y in ends
    )
    heights = spread_out([height for height, _, _ in placed], _LABEL_GAP)
    for (height, x, engine), label in zip(placed, heights, strict=True):
        axes.plot(
            [x, 1.035],
            [height, label],
            transform=axes.transAxes,
            color=COLOURS[engine],
            linewidth=0.6,
            alpha=0.7,
            clip_on=False,
        )
        axes.text(
            1.045,
            label,
            engine,
            transform=axes.transAxes,
            color=COLOURS[engine],
            fontsize=TEXT_SIZE,
            fontweight="bold" if engine in ("snapshot", TF2) else "normal",
            va="center",
        )


def spread_out(heights: Sequence[float], gap: float) -> list[float]:
    """Move sorted heights as little as keeps them `gap` apart, within 0 and 1 where they fit."""
    count = len(heights)
    placed = list(heights)
    for i in range(1, count):
        placed[i] = max(placed[i], placed[i - 1] + gap)
    over = max(0.0, placed[-1] - 1.0) if placed else 0.0
    for i in reversed(range(count)):
        ceiling = 1.0 if i == count - 1 else placed[i + 1] - gap
        placed[i] = min(placed[i], ceiling) if over else placed[i]
    return placed


def legend(figure: Figure, engines: Sequence[str]) -> None:
    """Explain the engines' marks below the title, where `frame` made room."""
    figure.legend(
        handles=[
            Line2D(
                [],
                [],
                color=COLOURS[engine],
                marker=MARKERS[engine],
                linewidth=0,
                markersize=5,
                label=engine,
            )
            for engine in engines
        ],
        loc="upper left",
        bbox_to_anchor=(0.15 / figure.get_figwidth(), 1 - 0.72 / figure.get_figheight()),
        borderpad=0,
        borderaxespad=0,
        ncols=len(engines),
        fontsize=TEXT_SIZE,
        frameon=False,
        labelcolor=style.INK,
        columnspacing=1.0,
        handletextpad=0.2,
    )


def nothing(axes: Axes) -> None:
    """Say that there is nothing to show."""
    axes.text(0.5, 0.5, "nothing to show", transform=axes.transAxes, color=style.MUTED, ha="center")

"""The style of all pictures: colours, sizes, and figures without a screen."""

from __future__ import annotations

from datetime import UTC, datetime
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.figure import Figure

from tfdb.data.argument_checks import refuse_without
from tfdb.data.stamps import format_seconds

from . import label_fitting
from .axis_ticks import SparseLocator, TickFormatter

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

INK = "#22303c"
MUTED = "#5f6c78"
FAINT = "#d9dfe4"
PAPER = "#ffffff"
MOVING = "#1f6fb2"
STATIC = "#9aa5ae"
WARNING = "#cf3d2e"
LATE = "#d9730d"
START = "#2c8c4b"
END = "#cf3d2e"
SERIES = (
    MOVING,
    "#d9730d",
    "#2c8c4b",
    "#8b5fbf",
    "#cf3d2e",
    "#8a5a3b",
    "#d4589b",
    "#5f6c78",
    "#a68a00",
    "#1597a5",
)
"""Colours to distinguish several paths or publishers."""

TITLE_SIZE = 12.0
TEXT_SIZE = 9.0
SMALL_SIZE = 8.0
DPI = 120
MARGIN = 14.0
"""Margin at each side, in points."""


class Picture(Figure):
    """A figure that a notebook shows as the last line of a cell.

    With `%matplotlib inline` a notebook shows any Figure. Without it, it calls `_repr_png_`.
    """

    def _repr_png_(self) -> bytes:
        """Draw the picture as a PNG."""
        drawn = BytesIO()
        self.savefig(drawn, format="png")
        return drawn.getvalue()


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure of `width` x `height` inches without a window."""
    figure = Picture(figsize=(width, height), dpi=DPI, facecolor=PAPER)
    figure.set_layout_engine("none")
    return figure


def lay_out(figure: Figure, top: float, between: float = 0.02) -> None:
    """Lay out later additions automatically, below `top` points."""
    width, height = figure.get_size_inches() * 72
    figure.set_layout_engine(
        "constrained",
        rect=(0.5 * MARGIN / width, 0.01, 1 - MARGIN / width, 1 - top / height - 0.01),
        w_pad=0.08,
        h_pad=0.04,
        wspace=between,
    )


def freeze_layout(figure: Figure) -> None:
    """Lay out the additions since `lay_out`, and keep the layout for every file format."""
    figure.draw_without_rendering()
    figure.set_layout_engine("none")


def frame_all(axes: Axes, low: npt.NDArray[np.float64], high: npt.NDArray[np.float64]) -> None:
    """Set the limits to a rectangle with a margin, both axes in one scale."""
    half = np.maximum((high - low) * 0.57, 0.05 * max(float((high - low).max()), 1e-2))
    middle = (low + high) / 2
    axes.update_datalim([middle - half, middle + half])
    axes.margins(0)
    axes.autoscale_view()
    axes.set_aspect("equal", adjustable="datalim")


def tidy(axes: Axes) -> None:
    """Give axes a thin grey frame, a faint grid and small labels."""
    axes.set_facecolor(PAPER)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(FAINT)
    axes.tick_params(colors=MUTED, labelsize=SMALL_SIZE, length=3)
    axes.xaxis.set_major_locator(SparseLocator())
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(TickFormatter())
    axes.grid(visible=True, color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)


def label(axes: Axes, x: str, y: str) -> None:
    """Name both axes; the names are not read as formulas."""
    axes.set_xlabel(x, color=INK, fontsize=TEXT_SIZE, parse_math=False, **font())
    axes.set_ylabel(y, color=INK, fontsize=TEXT_SIZE, parse_math=False, **font())


def font() -> dict[str, Any]:
    """Return the font options of a text."""
    return {"fontfamily": label_fitting.families()}


def title(figure: Figure, text: str, under: str = "", **where: Any) -> None:
    """Write a left-aligned title with a quieter line under it; `where` places the first line.

    Text wider than the figure is shortened in the middle.
    """
    refuse_without(text, "title", "a str", "isascii", "isprintable")
    width, height = figure.get_size_inches()
    x = float(where.get("x", 0.02))
    room = (1 - x) * width * 72 - MARGIN
    lines: tuple[tuple[float, str, dict[str, Any]], ...] = (
        (0.30, text, {"color": INK, "fontsize": TITLE_SIZE, "fontweight": "bold"}),
        (0.53, under, {"color": MUTED, "fontsize": TEXT_SIZE, "fontweight": "normal"}),
    )
    for down, line, look in lines:
        if not line:
            continue
        shown = label_fitting.fitted(line, look["fontsize"], room, look["fontweight"])
        y = 1.0 - down / height
        figure.text(x, y, shown, va="center", parse_math=False, **look, **font())


def since(stamp: int) -> str:
    """Return the name of a time axis that begins at a stamp: its date, otherwise its seconds."""
    if stamp < _YEAR_2000:
        return f"time since {format_seconds(stamp)} [s]"
    date = datetime.fromtimestamp(stamp // 10**9, UTC).strftime("%Y-%m-%d %H:%M:%S")
    return f"time since {date}.{stamp % 10**9 // 10**6:03d} UTC [s]"


_YEAR_2000 = 946_684_800 * 10**9

LEGEND_ROW = 13.0
_HANDLE = 30.0
_GAP = 16.0


def legend_columns(labels: Sequence[str], room: float) -> int:
    """Return how many columns of a legend fit into `width` points."""
    widest = max((label_fitting.width(text, SMALL_SIZE) for text in labels), default=0.0)
    columns = int((room + _GAP) // (widest + _HANDLE + _GAP))
    return max(1, min(columns, len(labels)))


def legend_labels(names: Sequence[str], room: float) -> list[str]:
    """Return names, shortened to fit into a legend of `width` points."""
    return [label_fitting.fitted(name, SMALL_SIZE, room - _HANDLE) for name in names]


def legend(figure: Figure, handles: Sequence[Artist], at: tuple[float, float], room: float) -> None:
    """Put a legend with its upper left corner `at` (points from the figure's upper left)."""
    width, height = figure.get_size_inches() * 72
    columns = legend_columns([str(handle.get_label()) for handle in handles], room)
    made = figure.legend(
        handles=list(handles),
        loc="upper left",
        bbox_to_anchor=(at[0] / width, 1 - at[1] / height),
        ncols=columns,
        borderaxespad=0,
        borderpad=0,
        labelspacing=0.35,
        columnspacing=_GAP / SMALL_SIZE,
        handlelength=2.2,
        handletextpad=0.6,
        fontsize=SMALL_SIZE,
        frameon=False,
        labelcolor=INK,
    )
    for text in made.get_texts():
        text.set_parse_math(False)
        text.set_fontfamily(label_fitting.families())

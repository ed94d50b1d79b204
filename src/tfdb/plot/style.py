"""The one look of all pictures: colours, sizes, and figures that need no screen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

INK = "#22303c"
MUTED = "#74818d"
FAINT = "#d9dfe4"
PAPER = "#ffffff"
MOVING = "#1f6fb2"
STATIC = "#9aa5ae"
WARNING = "#cf3d2e"
START = "#2c8c4b"
END = "#cf3d2e"

TITLE_SIZE = 12.0
TEXT_SIZE = 9.0
SMALL_SIZE = 7.5
DPI = 120


def new_figure(width: float, height: float) -> Figure:
    """Make an empty figure of `width` x `height` inches that belongs to no window."""
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor=PAPER)
    figure.set_layout_engine("none")
    return figure


def tidy(axes: Axes) -> None:
    """Thin grey frame, faint grid, small labels."""
    axes.set_facecolor(PAPER)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(FAINT)
    axes.tick_params(colors=MUTED, labelsize=SMALL_SIZE, length=3)
    axes.grid(visible=True, color=FAINT, linewidth=0.6)
    axes.set_axisbelow(True)


def label(axes: Axes, x: str, y: str) -> None:
    """Name both axes."""
    axes.set_xlabel(x, color=INK, fontsize=TEXT_SIZE)
    axes.set_ylabel(y, color=INK, fontsize=TEXT_SIZE)


def title(figure: Figure, text: str, under: str = "", **where: Any) -> None:
    """Write a left-aligned title with a quieter line under it; `where` places the first line."""
    x = float(where.get("x", 0.02))
    height = figure.get_figheight()
    y = 1.0 - 0.30 / height
    figure.text(x, y, text, color=INK, fontsize=TITLE_SIZE, fontweight="bold", va="center")
    if under:
        y = 1.0 - 0.53 / height
        figure.text(x, y, under, color=MUTED, fontsize=TEXT_SIZE, va="center")

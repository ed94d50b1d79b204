"""Two trajectories over each other, coloured by the error, and the errors over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from tfdb.data.argument_checks import refuse_without
from tfdb.data.counting import counted
from tfdb.store.summary import find_gaps

from . import label_fitting, style
from .axis_ticks import TickFormatter

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .drawable import Compared, Errors


_SIZE = (10.0, 5.2)
_TOP = 66.0
_COLOURS = "viridis"
_LEGEND: dict[str, Any] = {
    "fontsize": style.SMALL_SIZE,
    "framealpha": 0.85,
    "edgecolor": style.FAINT,
    "labelcolor": style.INK,
}


def comparison(result: Compared, *, title: str | None = None) -> Figure:
    """Draw the result of `tfdb.compare`.

    The left part shows the two axes of the reference's largest extent in one scale: the reference
    in grey, the aligned estimate coloured by its APE in metres. The right part shows the errors
    over time, translations in metres above rotations in degrees: the APE with its rmse (dashed),
    and the RPE as a thinner line. Gaps stay empty. Seconds count from the first matched pose.
    """
    refuse_without(
        result, "result", "what tfdb.compare found", "ape_translation", "rpe_translation"
    )
    figure = style.new_figure(*_SIZE)
    absolute, relative = result.ape_translation, result.rpe_translation
    style.title(
        figure,
        title
        if title is not None
        else f"{result.estimate.source} in {result.alignment.source} against "
        f"{result.reference.source} in {result.reference.target}",
        f"{counted(len(result), 'pose')}; "
        f"APE {absolute.rmse:.4g} m rmse, {absolute.max:.4g} m at most; "
        f"RPE {relative.rmse:.4g} m rmse",
        x=style.MARGIN / 72 / _SIZE[0],
    )
    style.lay_out(figure, _TOP)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1))
    _draw_paths(figure, figure.add_subplot(grid[:, 0]), result)
    start = int(result.reference.stamps[0])
    above = figure.add_subplot(grid[0, 1])
    below = figure.add_subplot(grid[1, 1], sharex=above)
    _draw_errors(above, result.ape_translation, result.rpe_translation, start, 1.0)
    _draw_errors(below, result.ape_rotation, result.rpe_rotation, start, 180.0 / np.pi)
    style.label(above, "", "translation [m]")
    style.label(below, style.since(start) if result.has_stamps else "row", "rotation [deg]")
    above.tick_params(labelbottom=False)
    figure.align_ylabels([above, below])
    style.freeze_layout(figure)
    return figure


def _joined(stamps: npt.NDArray[np.int64]) -> npt.NDArray[np.bool_]:
    """Return the pairs of neighbours without a gap between them."""
    holes = [gap.before for gap in find_gaps(stamps)[2]]
    return np.isin(stamps[:-1], holes, invert=True)


def _draw_paths(figure: Figure, axes: Axes, result: Compared) -> None:
    style.tidy(axes)
    ours, theirs = result.reference.poses[:, :3], result.estimate.poses[:, :3]
    wide = np.sort(np.argsort(-np.ptp(ours, axis=0), kind="stable")[:2])
    joined = _joined(result.reference.stamps)
    a, b = ours[:, wide], theirs[:, wide]
    axes.add_collection(LineCollection(_strokes(a, joined), colors=style.MUTED, linewidths=1.3))
    values = result.ape_translation.values
    coloured = LineCollection(_strokes(b, joined), cmap=_COLOURS, linewidths=1.9)
    coloured.set_array((values[:-1] + values[1:])[joined] / 2)
    low, high = float(values.min()), float(values.max())
    # Equal errors differ by rounding; colours must not show that.
    same = high - low <= 1e-9 * high
    coloured.set_clim(0.0 if same else low, max(high, 1e-12))
    axes.add_collection(coloured)
    low = np.minimum(a.min(axis=0), b.min(axis=0))
    high = np.maximum(a.max(axis=0), b.max(axis=0))
    style.frame_all(axes, low, high)
    room = _SIZE[1] * 72 - 190.0
    target = label_fitting.fitted(result.reference.target, style.TEXT_SIZE, room)
    names = [f"{'xyz'[axis]} in {target} [m]" for axis in wide]
    style.label(axes, names[0], names[1])
    name = "estimate" if result.align == "none" else "estimate, aligned"
    marks = [
        Line2D([], [], color=style.MUTED, linewidth=1.3, label="reference"),
        Line2D([], [], color=coloured.get_cmap()(0.5), linewidth=1.9, label=name),
    ]
    style.legend(figure, marks, (style.MARGIN, 48.0), _SIZE[0] * 72)
    bar = figure.colorbar(coloured, ax=axes, aspect=50, pad=0.02, format=TickFormatter())
    bar.outline.set_edgecolor(style.FAINT)
    bar.ax.tick_params(colors=style.MUTED, labelsize=style.SMALL_SIZE, length=3)
    bar.set_label("APE [m]", color=style.INK, fontsize=style.TEXT_SIZE)


def _strokes(
    points: npt.NDArray[np.float64], joined: npt.NDArray[np.bool_]
) -> list[npt.NDArray[np.float64]]:
    return list(np.stack((points[:-1], points[1:]), axis=1)[joined])


def _draw_errors(axes: Axes, absolute: Errors, relative: Errors, start: int, factor: float) -> None:
    style.tidy(axes)
    # The RPE of many poses is a broad band: draw the APE above it.
    looks = ((absolute, "APE", style.MOVING, 1.3, 3.0), (relative, "RPE", style.END, 0.7, 2.0))
    for errors, name, colour, width, order in looks:
        seconds = (errors.stamps - start) / 1e9
        values = errors.values * factor
        cuts = np.flatnonzero(~_joined(errors.stamps)) + 1
        axes.plot(
            np.insert(seconds, cuts, np.nan),
            np.insert(values, cuts, np.nan),
            color=colour,
            linewidth=width,
            label=name,
            zorder=order,
        )
    rmse = absolute.rmse * factor
    axes.axhline(
        rmse, color=style.MOVING, linewidth=0.9, dashes=(4, 3), label=f"rmse {rmse:.4g}", zorder=4
    )
    top = max(float(absolute.max), float(relative.max)) * factor
    axes.set_ylim(0, max(top * 1.3, 1e-12))
    axes.legend(ncols=3, loc="upper right", **_LEGEND)

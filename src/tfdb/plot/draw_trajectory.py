"""Draws trajectories: their path in a plane or in space, and each coordinate over time."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import ceil
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from tfdb.data.argument_checks import check_word
from tfdb.data.errors import InvalidArgument
from tfdb.data.poses import TOO_FAR

from . import label_fitting, style
from .axis_ticks import TickFormatter, number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .drawable import Drawable

    Floats = npt.NDArray[np.float64]

PLANES = ("xy", "xz", "yz", "xyz")
COLORS = ("time", "speed")

_HEADINGS = 14
_SIZE = (9.6, 5.4)
_SMALLEST = (5.0, 4.0)
_PARTS = 1500
"""Largest number of pieces of a coloured path."""
_MOST_TICKS = 8
_OWN_PAD = 21.0
"""Padding that matplotlib adds to a 3-D axis."""
_LINES: tuple[Literal["-", "--", "-.", ":"], ...] = ("-", "--", "-.", ":")


@dataclass(frozen=True)
class _Path:
    """A trajectory to draw; NaN for missing poses."""

    label: str
    source: str
    color: str
    line: Literal["-", "--", "-.", ":"]
    stamps: npt.NDArray[np.int64]
    seconds: Floats
    points: Floats
    rotations: Floats
    good: npt.NDArray[np.intp]

    @property
    def length(self) -> float:
        """Length in metres."""
        return float(np.linalg.norm(np.diff(self.points[self.good], axis=0), axis=1).sum())


def trajectory(
    *paths: Drawable,
    axes: Literal["xy", "xz", "yz", "xyz"] | None = None,
    color: Literal["time", "speed"] | None = None,
    labels: Sequence[str] | None = None,
    title: str | None = None,
    size: tuple[float, float] = _SIZE,
) -> Figure:
    """Draw the translations of one or several ``T[target<-source]``.

    The path is at the left, with both axes in one scale; x, y and z over time are at the right. A
    disc marks the start, a square the end. Arrows on a single path show the heading, the source's
    x axis. Rows with NaN leave a gap. Lengths are in metres, times in seconds from the first stamp.

    Parameters
    ----------
    *paths
        What `Buffer.trajectory` and `Trajectory.read` return.
    axes
        The plane to draw, or `"xyz"` for three dimensions. None: the two axes of largest extent.
    color
        `"time"` or `"speed"` (m/s) colours the paths by one scale. None: one colour for each path.
    labels
        A name for each path. None: its frames.
    title
        Title of the picture. None: the frames.
    size
        Width and height in inches, at least 5 and 4. A long legend adds to the height.

    Raises
    ------
    InvalidArgument
        No path; a path without a pose, or with a coordinate beyond 1e100 m; a wrong number of
        labels; an invalid value of an option.
    """
    _check(paths, axes, color, labels, size)
    drawn = _prepare(paths, labels)
    plane = _widest(drawn) if axes is None else axes
    room = size[0] * 72 - 2 * style.MARGIN
    marks = _legend_handles(drawn, room, several=len(drawn) > 1, plane=plane)
    names = [str(handle.get_label()) for handle in marks]
    rows = ceil(len(marks) / style.legend_columns(names, room))
    head = 50.0
    foot = head + rows * style.LEGEND_ROW + 8
    figure = style.new_figure(size[0], size[1] + max(0, rows - 1) * style.LEGEND_ROW / 72)
    style.title(
        figure,
        title if title is not None else _title(drawn, paths),
        _under(drawn),
        x=style.MARGIN / 72 / size[0],
    )
    style.legend(figure, marks, (style.MARGIN, head), room)
    _draw(figure, drawn, paths[0].target, plane, color, foot)
    return figure


def _check(paths: Sequence[Any], axes: object, color: object, labels: Any, size: Any) -> None:
    if not paths:
        raise InvalidArgument("at least one trajectory is required")
    for path in paths:
        if not all(hasattr(path, name) for name in ("target", "source", "stamps", "poses")):
            got = type(path).__name__
            raise InvalidArgument(
                f"each path must be a tfdb.Trajectory, as Buffer.trajectory returns, got {got}",
                value=path,
            )
    if axes is not None:
        check_word("axes", axes, PLANES)
    if color is not None:
        check_word("color", color, COLORS)
    if labels is not None:
        count = len(labels) if isinstance(labels, list | tuple) else -1
        if count != len(paths) or not all(isinstance(label, str) for label in labels):
            raise InvalidArgument(
                f"labels must be {len(paths)} names, one for each trajectory", value=labels
            )
    right = isinstance(size, list | tuple) and len(size) == 2
    for side, least in zip(size, _SMALLEST, strict=True) if right else ():
        right &= isinstance(side, int | float) and least <= side <= 100
    if not right:
        raise InvalidArgument(
            f"size must be a width from 5 and a height from 4 to 100 inches, got {size!r}",
            value=size,
        )


def _prepare(paths: Sequence[Drawable], labels: Sequence[str] | None) -> list[_Path]:
    one_target = len({path.target for path in paths}) == 1
    origin = min((int(path.stamps[0]) for path in paths if len(path.stamps)), default=0)
    found = []
    for i, path in enumerate(paths):
        poses = np.asarray(path.poses, dtype=np.float64).reshape(-1, 7)
        stamps = np.asarray(path.stamps, dtype=np.int64)
        good = np.flatnonzero(np.isfinite(poses).all(axis=1))
        named = f"{path.source} in {path.target}"
        if not len(good):
            raise InvalidArgument(f"the trajectory of {named} has no valid pose", value=path)
        if np.abs(poses[good, :3]).max() >= TOO_FAR:
            raise InvalidArgument(
                f"the trajectory of {named} reaches {np.abs(poses[good, :3]).max():.3g} m from the "
                f"origin: at most {TOO_FAR:g} m can be drawn",
                value=path,
            )
        points = np.full((len(poses), 3), np.nan)
        points[good] = poses[good, :3]
        found.append(
            _Path(
                labels[i] if labels is not None else path.source if one_target else named,
                path.source,
                style.SERIES[i % len(style.SERIES)],
                _LINES[i // len(style.SERIES) % len(_LINES)],
                stamps,
                (stamps - origin) / 1e9,
                points,
                poses[:, 3:],
                good,
            )
        )
    return found


def _widest(drawn: Sequence[_Path]) -> str:
    """Name the two axes of largest extent, in the order of the alphabet."""
    points = np.concatenate([path.points[path.good] for path in drawn])
    reach = points.max(axis=0) - points.min(axis=0)
    widest = sorted(np.argsort(-reach, kind="stable")[:2].tolist())
    return "".join("xyz"[axis] for axis in widest)


def _title(drawn: Sequence[_Path], paths: Sequence[Drawable]) -> str:
    if len(drawn) == 1:
        return f"{paths[0].source} in {paths[0].target}"
    targets = {path.target for path in paths}
    names = {path.source for path in paths}
    what = next(iter(names)) if len(names) == 1 else f"{len(names)} frames"
    return f"{what} in {next(iter(targets)) if len(targets) == 1 else f'{len(targets)} frames'}"


def _under(drawn: Sequence[_Path]) -> str:
    poses = sum(len(path.good) for path in drawn)
    seconds = max(float(path.seconds[-1]) for path in drawn)
    text = f"{poses:,} pose{'s' if poses != 1 else ''} over {number(seconds, 1)} s"
    if len(drawn) == 1:
        return f"{text}, {number(drawn[0].length)} m travelled"
    return text


def _legend_handles(
    drawn: Sequence[_Path], room: float, *, several: bool, plane: str
) -> list[Line2D]:
    marks = []
    if several:
        labels = [f"{path.label}  {number(path.length)} m" for path in drawn]
        marks = [
            Line2D([], [], color=path.color, linestyle=path.line, linewidth=1.8, label=label)
            for path, label in zip(drawn, style.legend_labels(labels, room), strict=True)
        ]
    start, end = ((style.MUTED,) * 2) if several else (style.START, style.END)
    for name, marker, colour in (("start", "o", start), ("end", "s", end)):
        marks.append(
            Line2D([], [], color=colour, linestyle="", marker=marker, markersize=6, label=name)
        )
    if not several and plane != "xyz":
        look: dict[str, Any] = {"color": style.MUTED, "linestyle": "", "markersize": 8}
        marks.append(Line2D([], [], marker=r"$\rightarrow$", label="heading (x axis)", **look))
    return marks


def _draw(
    figure: Figure,
    drawn: Sequence[_Path],
    target: str,
    plane: str,
    color: Literal["time", "speed"] | None,
    top: float,
) -> None:
    """Draw the path at the left, and x, y and z over time at the right, below `top` points."""
    # The name of a third axis extends beyond the axes.
    style.lay_out(figure, top, 0.1 if plane == "xyz" else 0.02)
    grid = figure.add_gridspec(3, 2, width_ratios=(1.25, 1))
    main = figure.add_subplot(grid[:, 0], projection="3d" if plane == "xyz" else None)
    scale = None if color is None else _scale(drawn, color)
    if plane == "xyz":
        _draw_space(main, drawn, scale, color)
    else:
        _draw_plane(main, drawn, plane, scale, color)
    _name_axes(figure, main, plane, target)
    over_time: list[Axes] = []
    for axis in range(3):
        made = figure.add_subplot(grid[axis, 1], sharex=over_time[0] if over_time else None)
        _draw_over_time(made, drawn, axis)
        over_time.append(made)
        style.label(made, "", f"{'xyz'[axis]} [m]")
    for upper in over_time[:2]:
        upper.tick_params(axis="x", labelbottom=False)
    first = min(int(path.stamps[0]) for path in drawn)
    style.label(over_time[2], style.since(first), "z [m]")
    if scale is not None and color is not None:
        _draw_scale(figure, main, scale, color)
    figure.align_ylabels(over_time)
    style.freeze_layout(figure)
    if plane == "xyz":
        _bring_name_near(main)
        _move_name_away(main)


def _move_name_away(space: Any) -> None:
    """Move the name of the second axis away from its numbers, which may be wide."""
    axis, apart = space.yaxis, 4 * space.figure.dpi / 72
    for _ in range(10):
        boxes = [tick.label1.get_window_extent() for tick in axis.get_major_ticks()]
        if not axis.label.get_window_extent().padded(apart).count_overlaps(boxes):
            return
        axis.labelpad += 4
        space.figure.draw_without_rendering()


def _bring_name_near(space: Any) -> None:
    """Put the name of the third axis beside its numbers, after the layout."""
    axis = space.zaxis
    line, name = axis.line.get_window_extent(), axis.label.get_window_extent()
    low, high = space.get_zlim()
    ticks = zip(axis.get_major_ticks(), axis.get_majorticklocs(), strict=True)
    numbers = [tick.label1.get_window_extent().x1 for tick, at in ticks if low <= at <= high]
    wanted = max([line.x1, *numbers]) + 0.5 * name.width + 6 * space.figure.dpi / 72 - line.x1
    # The distance per point of padding depends on the box.
    led = 0.5 * (name.x0 + name.x1) - line.x1
    axis.labelpad = (axis.labelpad + _OWN_PAD) * wanted / led - _OWN_PAD


def _name_axes(figure: Figure, main: Axes, plane: str, target: str) -> None:
    if plane == "xyz":
        # Slanted axes have no room for the name of a frame.
        space: Any = main
        for axis in (space.xaxis, space.yaxis, space.zaxis):
            axis.set_rotate_label(False)
            text = f"{axis.axis_name} [m]"
            axis.set_label_text(text, color=style.INK, fontsize=style.TEXT_SIZE)
            axis.labelpad = 11
        return
    width, height = figure.get_size_inches() * 72
    room = min(0.55 * width - 130, 0.8 * (height - 150))
    frame = label_fitting.fitted(target, style.TEXT_SIZE, room)
    style.label(main, f"{plane[0]} in {frame} [m]", f"{plane[1]} in {frame} [m]")


def _values(path: _Path, color: str) -> Floats:
    """Return the value that sets the colour of each piece between two poses."""
    good = path.good
    if color == "time":
        return (path.seconds[good][1:] + path.seconds[good][:-1]) / 2
    way = np.linalg.norm(np.diff(path.points[good], axis=0), axis=1)
    return np.asarray(way / np.diff(path.seconds[good]), dtype=np.float64)


def _scale(drawn: Sequence[_Path], color: str) -> ScalarMappable:
    values = np.concatenate([_values(path, color) for path in drawn])
    low = high = 0.0
    if len(values):
        low = 0.0 if color == "speed" else float(values.min())
        # The speed of a jump must not stretch the scale of all other speeds.
        high = float(np.quantile(values, 0.99)) if color == "speed" else float(values.max())
    norm = Normalize(low, high if high > low else low + 1e-3)
    return ScalarMappable(norm, colormaps["viridis"])


def _draw_scale(figure: Figure, main: Axes, scale: ScalarMappable, color: str) -> None:
    bar = figure.colorbar(
        scale,
        ax=main,
        location="bottom",
        aspect=40,
        pad=0.03,
        extend="max" if color == "speed" else "neither",
        format=TickFormatter(),
    )
    outline: Any = bar.outline
    outline.set_visible(False)
    bar.ax.tick_params(colors=style.MUTED, labelsize=style.SMALL_SIZE, length=3)
    name = "speed [m/s]" if color == "speed" else "time [s]"
    bar.set_label(name, color=style.INK, fontsize=style.TEXT_SIZE)


def _pieces(path: _Path, columns: list[int], color: str) -> tuple[list[Floats], Floats]:
    """Cut a path into adjacent pieces of one colour each; no piece bridges a gap."""
    good, points = path.good, path.points[:, columns]
    cuts = np.unique(np.linspace(0, len(good) - 1, _PARTS + 1).astype(int))
    values = _values(path, color)
    pieces, tells = [], []
    for first, last in pairwise(cuts.tolist()):
        pieces.append(points[good[first] : good[last] + 1])
        tells.append(float(values[first:last].mean()))
    return pieces, np.array(tells)


def _draw_plane(
    axes: Axes, drawn: Sequence[_Path], plane: str, scale: ScalarMappable | None, color: str | None
) -> None:
    style.tidy(axes)
    columns = ["xyz".index(name) for name in plane]
    for path in drawn:
        if scale is None or color is None:
            axes.plot(
                path.points[:, columns[0]],
                path.points[:, columns[1]],
                color=path.color,
                linestyle=path.line,
                linewidth=1.5,
            )
        else:
            pieces, tells = _pieces(path, columns, color)
            lines = LineCollection(pieces, cmap=scale.get_cmap(), norm=scale.norm, linewidths=2.0)
            lines.set_array(tells)
            axes.add_collection(lines)
    if len(drawn) == 1:
        _arrows(axes, drawn[0], columns)
    for path in drawn:
        _ends(axes, path, path.points[path.good][:, columns], several=len(drawn) > 1)
    points = np.concatenate([path.points[path.good][:, columns] for path in drawn])
    style.frame_all(axes, points.min(axis=0), points.max(axis=0))


def _draw_space(
    axes: Any, drawn: Sequence[_Path], scale: ScalarMappable | None, color: str | None
) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection  # noqa: PLC0415 - slow to import

    for path in drawn:
        if scale is None or color is None:
            axes.plot(*path.points.T, color=path.color, linestyle=path.line, linewidth=1.4)
        elif len(path.good) > 1:
            pieces, tells = _pieces(path, [0, 1, 2], color)
            lines = Line3DCollection(pieces, cmap=scale.get_cmap(), norm=scale.norm, linewidths=1.8)
            lines.set_array(tells)
            axes.add_collection3d(lines)
        _ends(axes, path, path.points[path.good], several=len(drawn) > 1)
    points = np.concatenate([path.points[path.good] for path in drawn])
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    half = np.maximum((points.max(axis=0) - points.min(axis=0)) * 0.55, 1e-3)
    half = np.maximum(half, half.max() * 0.3)
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] - half[1], middle[1] + half[1])
    axes.set_zlim(middle[2] - half[2], middle[2] + half[2])
    # One scale, and smaller than the room, because the axis names extend beyond the axes.
    axes.set_box_aspect(half, zoom=0.85)
    axes.tick_params(colors=style.MUTED, labelsize=style.SMALL_SIZE - 1, pad=0)
    for each, part in zip((axes.xaxis, axes.yaxis, axes.zaxis), half / half.max(), strict=True):
        each.set_pane_color((1, 1, 1, 0))
        each.line.set_color(style.FAINT)
        each.set_major_locator(MaxNLocator(ceil(4 * part), min_n_ticks=1))
        each.set_major_formatter(TickFormatter())
    for each in (axes.yaxis, axes.zaxis):
        # Beside the axis for any width of the numbers; centred they would cross it.
        for tick in each.get_major_ticks(_MOST_TICKS):
            tick.label1.set_horizontalalignment("left")


def _arrows(axes: Axes, path: _Path, columns: list[int]) -> None:
    """Draw headings at even distances along the path; none if the source hardly moves."""
    points = path.points[path.good][:, columns]
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    if way[-1] < 1e-6:
        return
    rows = np.unique(np.searchsorted(way, np.linspace(0, way[-1], _HEADINGS)[1:-1]))
    rows = rows[rows < len(points)]
    x, y, z, w = path.rotations[path.good[rows]].T
    forward = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)], axis=1)
    forward = forward[:, columns]
    size = np.linalg.norm(forward, axis=1, keepdims=True)
    seen = size[:, 0] > 0.2  # towards the eye it has no heading
    forward = forward[seen] / size[seen]
    axes.quiver(
        points[rows[seen], 0],
        points[rows[seen], 1],
        forward[:, 0],
        forward[:, 1],
        color=style.MUTED,
        angles="xy",
        scale=26,
        width=0.004,
        headwidth=4,
        zorder=3,
    )


def _ends(axes: Any, path: _Path, points: Floats, *, several: bool) -> None:
    look: dict[str, Any] = {"zorder": 4, "edgecolors": style.PAPER, "linewidths": 0.8}
    start, end = (path.color, path.color) if several else (style.START, style.END)
    axes.scatter(*points[0], marker="o", s=48, color=start, **look)
    axes.scatter(*points[-1], marker="s", s=40, color=end, **look)


def _draw_over_time(axes: Axes, drawn: Sequence[_Path], axis: int) -> None:
    style.tidy(axes)
    for path in drawn:
        axes.plot(
            path.seconds,
            path.points[:, axis],
            color=path.color,
            linestyle=path.line,
            linewidth=1.2,
        )
    if all(len(path.good) == 1 for path in drawn):
        for path in drawn:
            axes.plot(path.seconds, path.points[:, axis], color=path.color, marker="o")
    heights = np.concatenate([path.points[path.good, axis] for path in drawn])
    low, high = float(heights.min()), float(heights.max())
    # A flat path stays flat: millimetres of noise must not fill the height.
    half = max((high - low) * 0.58, 0.05)
    axes.set_ylim((low + high) / 2 - half, (low + high) / 2 + half)

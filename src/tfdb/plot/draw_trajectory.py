"""A trajectory from above, and its height over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .. import Trajectory

_HEADINGS = 14
_SIZE = (9.6, 5.0)
_TOP = (0.075, 0.115, 0.45, 0.715)
_SIDE = (0.605, 0.115, 0.37, 0.715)


def trajectory(path: Trajectory, *, title: str | None = None) -> Figure:
    """Draw the translations of ``T[target<-source]``: top view (x, y) and height (z) over time.

    Both axes of the top view have one scale. Start and end are marked, small arrows show the
    heading (the source's x axis); rows with NaN leave a hole in the line. Lengths in metres,
    times in seconds from the first stamp. Raises ``ValueError`` for a trajectory without poses.
    """
    poses = np.asarray(path.poses, dtype=np.float64)
    stamps = np.asarray(path.stamps, dtype=np.int64)
    good: npt.NDArray[np.bool_] = np.asarray(np.isfinite(poses.reshape(-1, 7)).all(axis=1))
    if not good.any():
        raise ValueError("the trajectory holds no pose to draw")
    seconds = (stamps - stamps[0]) / 1e9
    figure = style.new_figure(*_SIZE)
    style.title(
        figure,
        title or f"{path.source} in {path.target}",
        f"{int(good.sum()):,} poses over {seconds[-1]:.1f} s, "
        f"{_length(poses[good, :3]):.2f} m travelled",
    )
    top = figure.add_axes(_TOP)
    side = figure.add_axes(_SIDE)
    _draw_top(top, poses, good)
    _draw_height(side, seconds, poses[:, 2], good)
    style.label(top, f"x in {path.target} [m]", f"y in {path.target} [m]")
    style.label(side, f"time since {_seconds(int(stamps[0]))} [s]", "z [m]")
    return figure


def _length(points: npt.NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def _seconds(ns: int) -> str:
    return f"{ns // 10**9}.{ns % 10**9 // 10**6:03d}"


def _draw_top(axes: Axes, poses: npt.NDArray[np.float64], good: npt.NDArray[np.bool_]) -> None:
    style.tidy(axes)
    axes.plot(poses[:, 0], poses[:, 1], color=style.MOVING, linewidth=1.5, solid_capstyle="round")
    rows = np.flatnonzero(good)
    _arrows(axes, poses[rows])
    _ends(axes, poses[rows, 0], poses[rows, 1])
    low = poses[rows, :2].min(axis=0)
    high = poses[rows, :2].max(axis=0)
    # One metre is as long in x as in y: limits in the shape of the axes' box.
    shape = np.array([_TOP[2] * _SIZE[0], _TOP[3] * _SIZE[1]])
    scale = max(float(((high - low) / shape).max()) * 1.14, 1e-3)
    near, far = (low + high - scale * shape) / 2, (low + high + scale * shape) / 2
    axes.set_xlim(near[0], far[0])
    axes.set_ylim(near[1], far[1])
    axes.set_aspect("equal", adjustable="box")
    axes.legend(
        loc="best",
        fontsize=style.SMALL_SIZE,
        frameon=True,
        framealpha=0.85,
        edgecolor=style.FAINT,
        labelcolor=style.INK,
    )


def _arrows(axes: Axes, poses: npt.NDArray[np.float64]) -> None:
    """Headings at even distances along the way; none where the source hardly moves."""
    steps = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    if way[-1] < 1e-6:
        return
    rows = np.unique(np.searchsorted(way, np.linspace(0, way[-1], _HEADINGS)[1:-1]))
    rows = rows[rows < len(poses)]
    x, y, z, w = (poses[rows, i] for i in range(3, 7))
    forward = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + z * w)], axis=1)
    size = np.linalg.norm(forward, axis=1, keepdims=True)
    seen = size[:, 0] > 0.2  # pointing up or down, it has no heading in a top view
    forward = forward[seen] / size[seen]
    axes.quiver(
        poses[rows[seen], 0],
        poses[rows[seen], 1],
        forward[:, 0],
        forward[:, 1],
        color=style.MUTED,
        angles="xy",
        scale=26,
        width=0.004,
        headwidth=4,
        zorder=3,
    )
    axes.scatter([], [], marker=r"$\rightarrow$", color=style.MUTED, s=60, label="heading (x axis)")


def _ends(axes: Axes, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]) -> None:
    marks: list[tuple[int, str, dict[str, Any]]] = [
        (0, "start", {"marker": "o", "color": style.START, "s": 48}),
        (-1, "end", {"marker": "s", "color": style.END, "s": 40}),
    ]
    for row, name, look in marks:
        axes.scatter(x[row], y[row], label=name, zorder=4, edgecolors=style.PAPER, **look)


def _draw_height(
    axes: Axes,
    seconds: npt.NDArray[np.float64],
    height: npt.NDArray[np.float64],
    good: npt.NDArray[np.bool_],
) -> None:
    style.tidy(axes)
    axes.plot(seconds, height, color=style.MOVING, linewidth=1.2)
    rows = np.flatnonzero(good)
    _ends(axes, seconds[rows], height[rows])
    low, high = float(height[rows].min()), float(height[rows].max())
    # A flat drive stays flat: noise of millimetres is not blown up to the picture's height.
    half = max((high - low) * 0.58, 0.05)
    axes.set_ylim((low + high) / 2 - half, (low + high) / 2 + half)
    axes.ticklabel_format(useOffset=False)

"""The frame tree, root at the left, one row for each leaf so that no label meets another."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from matplotlib.font_manager import FontProperties
from matplotlib.lines import Line2D
from matplotlib.patches import FancyBboxPatch
from matplotlib.textpath import text_to_path

from ..summary import Forest
from . import style

if TYPE_CHECKING:
    from collections.abc import Iterable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .. import Buffer, FrameInfo, Snapshot

# All in points (1/72 inch): the axes cover the figure and count in points, so text fits by measure.
_ROW = 15.0
_BOX = 11.5
_PAD = 4.0
_STEP = 22.0
_MARGIN = 16.0
_HEAD = 62.0
_TREE_GAP = 1.0
_MIN_WIDTH = 430.0


@dataclass
class _Node:
    info: FrameInfo
    note: str
    width: float
    x: float = 0.0
    row: float = 0.0


def frame_tree(
    frames: Buffer | Snapshot | Iterable[FrameInfo], *, title: str | None = None
) -> Figure:
    """Draw all frames from left (roots) to right, moving edges in colour with their rate in Hz.

    Takes a store or what its ``tree()`` returned. The picture grows with the number of frames, so
    that labels stay readable and apart.
    """
    # Only the store has a tree(); an iterable of FrameInfo is taken as it is.
    infos = list(frames.tree()) if hasattr(frames, "tree") else list(frames)
    forest = Forest(infos)
    nodes = _place(forest)
    rows = max((node.row for node in nodes.values()), default=0.0) + 1
    right = max((node.x + node.width for node in nodes.values()), default=0.0)
    width = max(_MIN_WIDTH, _MARGIN * 2 + right)
    height = _HEAD + rows * _ROW + _MARGIN
    figure = style.new_figure(width / 72, height / 72)
    moving = sum(1 for i in infos if i.parent is not None and not i.is_static)
    static = sum(1 for i in infos if i.is_static)
    style.title(
        figure,
        title or "Frame tree",
        f"{len(infos)} frames, {moving} moving edges, {static} static, "
        f"{len(forest.roots)} {'tree' if len(forest.roots) == 1 else 'trees'}",
        x=_MARGIN / width,
    )
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(0, width)
    axes.set_ylim(0, height)
    axes.axis("off")
    _draw(axes, nodes, height)
    _legend(axes, width, height)
    return figure


def _text_width(text: str, size: float) -> float:
    """Points, with a little to spare: on the screen's grid letters come out wider."""
    width, _, _ = text_to_path.get_text_width_height_descent(
        text, FontProperties(size=size), ismath=False
    )
    return float(width) * 1.06


def _note(info: FrameInfo) -> str:
    if info.parent is None or info.is_static:
        return ""
    if info.rate is None:
        return f"{info.samples} sample{'s' if info.samples != 1 else ''}"
    return f"{info.rate:.3g} Hz"


def _place(forest: Forest) -> dict[str, _Node]:
    """Leaves get the rows in reading order, a parent the middle of its children.

    No two subtrees share a row, so each frame may stand right behind its own parent.
    """
    nodes: dict[str, _Node] = {}
    next_row = 0.0
    for root in forest.roots:
        order = [row.info for row in forest.walk(root)]
        for info in order:
            node = nodes[info.name] = _Node(info, _note(info), 2 * _PAD)
            node.width += _text_width(info.name, style.SMALL_SIZE)
            if node.note:
                node.width += _text_width(node.note, style.SMALL_SIZE - 1) + _PAD
            parent = nodes.get(info.parent) if info.parent is not None else None
            if parent is not None:
                node.x = parent.x + parent.width + _STEP
            if not forest.children[info.name]:
                node.row = next_row
                next_row += 1
        for info in reversed(order):
            below = forest.children[info.name]
            if below:
                nodes[info.name].row = (nodes[below[0]].row + nodes[below[-1]].row) / 2
        next_row += _TREE_GAP
    return nodes


def _draw(axes: Axes, nodes: dict[str, _Node], height: float) -> None:
    def place(node: _Node) -> tuple[float, float]:
        return _MARGIN + node.x, height - _HEAD - (node.row + 0.5) * _ROW

    for node in nodes.values():
        x, y = place(node)
        parent = nodes.get(node.info.parent) if node.info.parent is not None else None
        if parent is not None:
            from_x, from_y = place(parent)
            bend = x - _STEP * 0.5
            axes.plot(
                [from_x + parent.width, bend, bend, x],
                [from_y, from_y, y, y],
                zorder=1.5 if not node.info.is_static else 1,
                solid_joinstyle="round",
                **_line(node.info),
            )
        _draw_box(axes, node, x, y)


def _line(info: FrameInfo) -> dict[str, Any]:
    if info.is_static:
        return {"color": style.STATIC, "linewidth": 0.8}
    return {"color": style.MOVING, "linewidth": 1.4}


def _draw_box(axes: Axes, node: _Node, x: float, y: float) -> None:
    root = node.info.parent is None
    colour = style.INK if root else _line(node.info)["color"]
    axes.add_patch(
        FancyBboxPatch(
            (x, y - _BOX / 2),
            node.width,
            _BOX,
            boxstyle="round,pad=0,rounding_size=3",
            facecolor=style.INK if root else style.PAPER,
            edgecolor=colour,
            linewidth=0.9,
            zorder=2,
        )
    )
    axes.text(
        x + _PAD,
        y,
        node.info.name,
        fontsize=style.SMALL_SIZE,
        va="center_baseline",
        zorder=3,
        color=style.PAPER if root else style.INK,
        parse_math=False,
    )
    if node.note:
        axes.text(
            x + node.width - _PAD,
            y,
            node.note,
            fontsize=style.SMALL_SIZE - 1,
            ha="right",
            va="center_baseline",
            color=style.MOVING,
            zorder=3,
            parse_math=False,
        )


def _legend(axes: Axes, width: float, height: float) -> None:
    axes.legend(
        handles=[
            Line2D([], [], color=style.MOVING, linewidth=1.4, label="moving, with its mean rate"),
            Line2D([], [], color=style.STATIC, linewidth=0.8, label="static"),
        ],
        loc="upper right",
        bbox_to_anchor=(1 - _MARGIN / width, 1 - 8 / height),
        borderaxespad=0,
        fontsize=style.SMALL_SIZE,
        frameon=False,
        labelcolor=style.INK,
    )

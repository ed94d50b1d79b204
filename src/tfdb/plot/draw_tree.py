"""Draws the frame tree, one row for each frame below its parent; large subtrees are folded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from matplotlib.lines import Line2D
from matplotlib.patches import FancyBboxPatch

from tfdb.data.counting import counted
from tfdb.data.errors import InvalidArgument
from tfdb.store.summary import Forest

from . import label_fitting, style
from .folding import FoldedRow, Folds, check_rows

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from tfdb._core import StoreReader
    from tfdb.data.types import FrameInfo

# All lengths are points (1/72 inch): the axes cover the figure in points, so text can be measured.
_ROW = 15.0
_BOX = 11.5
_PAD = 4.0
_RISE = 0.8  # text stands a little above the middle, because of descenders
_STEP = 18.0
_DEEPEST = 400.0
_HEAD = 50.0
_TREE_GAP = 0.6
_MIN_WIDTH = 430.0
_WIDEST_NAME = 420.0


@dataclass
class _Node:
    """A frame, or (without `info`) the folded frames below `parent`."""

    text: str
    parent: str | None
    depth: int
    info: FrameInfo | None = None
    note: str = ""
    static: bool = True
    row: float = 0.0


def frame_tree(
    frames: StoreReader | Iterable[FrameInfo], *, title: str | None = None, rows: int | None = 100
) -> Figure:
    """Draw all frames, each in a row under its parent, moving edges in colour with their rate.

    Parameters
    ----------
    frames
        A store or a snapshot, or the result of its `tree()`.
    title
        Title of the picture. None: "Frame tree".
    rows
        Largest number of drawn frames. Beyond it each subtree is folded into one row with the
        number of its frames: first subtrees with static edges only, the largest first, then the
        deepest. Roots are always drawn. None: no limit.

    Raises
    ------
    InvalidArgument
        `rows` is not a positive number, or `frames` is neither a store nor frames.
    """
    check_rows(rows)
    infos = _infos(frames)
    forest = Forest(infos)
    folded = Folds(forest)
    if rows is not None:
        folded.fold(rows)
    nodes = list(_nodes(folded))
    deepest = max((node.depth for node in nodes), default=0)
    step = min(_STEP, _DEEPEST / max(deepest, 1))
    right = max((node.depth * step + _width(node) for node in nodes), default=0.0)
    width = max(_MIN_WIDTH, style.MARGIN * 2 + right)
    legend = _handles()
    names = [str(handle.get_label()) for handle in legend]
    room = width - 2 * style.MARGIN
    head = _HEAD + -(-len(names) // style.legend_columns(names, room)) * style.LEGEND_ROW + 8
    height = head + (nodes[-1].row + 1 if nodes else 1) * _ROW + style.MARGIN
    figure = style.new_figure(width / 72, height / 72)
    style.title(
        figure,
        title if title is not None else "Frame tree",
        _under(infos, forest, folded),
        x=style.MARGIN / width,
    )
    style.legend(figure, legend, (style.MARGIN, _HEAD), room)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(0, width)
    axes.set_ylim(height, 0)
    axes.axis("off")
    _draw(axes, nodes, step, head)
    return figure


def _infos(frames: Any) -> list[FrameInfo]:
    # Only a store has tree(); a list of frames is used as it is.
    try:
        infos = list(frames.tree() if hasattr(frames, "tree") else frames)
    except TypeError:
        infos = [None]
    if not all(hasattr(info, "is_static") and hasattr(info, "parent") for info in infos):
        raise InvalidArgument(
            f"frames must be a store, a snapshot or the result of tree(), got "
            f"{type(frames).__name__}",
            value=frames,
        )
    return infos


def _nodes(folded: Folds) -> Iterator[_Node]:
    """Return the drawn nodes, from top to bottom."""
    down = 0.0
    for at, row in enumerate(folded.rows()):
        if at and row.depth == 0:
            down += _TREE_GAP
        node = _fold(row) if row.info is None else _frame(row.info, row.depth)
        node.row = at + down
        yield node


def _frame(info: FrameInfo, depth: int) -> _Node:
    text = label_fitting.fitted(info.name, style.SMALL_SIZE, _WIDEST_NAME)
    return _Node(text, info.parent, depth, info, _note(info), info.is_static)


def _fold(row: FoldedRow) -> _Node:
    frames = len(row.hidden)
    moving = sum(not info.is_static for info in row.hidden)
    plural = "s" if frames != 1 else ""
    text = f"+ {frames} static frame{plural}"
    if moving:
        text = f"+ {frames} frame{plural}, {moving} of them moving"
    return _Node(text, row.parent, row.depth, static=not moving)


def _note(info: FrameInfo) -> str:
    if info.parent is None or info.is_static:
        return ""
    if info.rate is None:
        return f"{info.samples} sample{'s' if info.samples != 1 else ''}"
    return f"{info.rate:.3g} Hz"


def _width(node: _Node) -> float:
    wide = 2 * _PAD + label_fitting.width(node.text, style.SMALL_SIZE)
    return wide + (label_fitting.width(node.note, style.SMALL_SIZE) + 2 * _PAD if node.note else 0)


def _under(infos: Sequence[FrameInfo], forest: Forest, folded: Folds) -> str:
    moving = sum(1 for i in infos if i.parent is not None and not i.is_static)
    static = sum(1 for i in infos if i.is_static)
    trees = len(forest.roots)
    text = (
        f"{counted(len(infos), 'frame')}, {counted(moving, 'moving edge')}, {static} static, "
        f"{counted(trees, 'tree')}"
    )
    folds = f"{counted(folded.frames, 'frame')} {'is' if folded.frames == 1 else 'are'} folded"
    return f"{text}; {folds}" if folded.away else text


def _handles() -> list[Line2D]:
    return [
        Line2D([], [], color=style.MOVING, linewidth=1.4, label="moving, with its mean rate"),
        Line2D([], [], color=style.STATIC, linewidth=0.8, label="static"),
    ]


def _draw(axes: Axes, nodes: Sequence[_Node], step: float, head: float) -> None:
    places = {
        node.info.name: (style.MARGIN + node.depth * step, head + (node.row + 0.5) * _ROW)
        for node in nodes
        if node.info is not None
    }
    for node in nodes:
        x = style.MARGIN + node.depth * step
        y = head + (node.row + 0.5) * _ROW
        parent = places.get(node.parent) if node.parent is not None else None
        if parent is not None:
            down = parent[0] + min(7.0, step * 0.4)
            axes.plot(
                [down, down, x],
                [parent[1] + _BOX / 2, y, y],
                zorder=1 if node.static else 1.5,
                solid_joinstyle="round",
                **_line(node),
            )
        _draw_box(axes, node, x, y)


def _line(node: _Node) -> dict[str, Any]:
    if node.static:
        return {"color": style.STATIC, "linewidth": 0.8}
    return {"color": style.MOVING, "linewidth": 1.4}


def _draw_box(axes: Axes, node: _Node, x: float, y: float) -> None:
    root = node.depth == 0
    name = label_fitting.width(node.text, style.SMALL_SIZE)
    axes.add_patch(
        FancyBboxPatch(
            (x, y - _BOX / 2),
            name + 2 * _PAD,
            _BOX,
            boxstyle="round,pad=0,rounding_size=3",
            facecolor=style.INK if root else style.PAPER,
            edgecolor=style.INK if root else _line(node)["color"],
            linestyle="-" if node.info is not None else (0, (3, 2)),
            linewidth=0.9,
            zorder=2,
        )
    )
    look: dict[str, Any] = {"fontsize": style.SMALL_SIZE, "va": "center_baseline", "zorder": 3}
    y -= _RISE
    colour = style.PAPER if root else style.INK if node.info is not None else style.MUTED
    axes.text(x + _PAD, y, node.text, color=colour, parse_math=False, **look, **style.font())
    if node.note:
        x += name + 4 * _PAD
        axes.text(x, y, node.note, color=style.MOVING, parse_math=False, **look, **style.font())

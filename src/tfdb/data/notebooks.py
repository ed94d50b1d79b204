"""How objects show themselves in notebooks: small tables of HTML."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING

from .errors import TfdbError
from .stamps import format_seconds

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import numpy as np
    import numpy.typing as npt

    from tfdb._core import Reads, Transform

__all__: list[str] = []


def table(caption: str, head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Write a table; every text is escaped."""
    lines = [f"<table><caption>{escape(caption)}</caption>"]
    if head:
        lines.append("<thead><tr>" + _cells("th", head) + "</tr></thead>")
    lines += [
        "<tbody>",
        *("<tr>" + _cells("td", row) + "</tr>" for row in rows),
        "</tbody></table>",
    ]
    return "\n".join(lines)


def _cells(tag: str, texts: Iterable[object]) -> str:
    return "".join(f"<{tag}>{escape(str(text))}</{tag}>" for text in texts)


MOST_ROWS = 60
"""A table of more frames is cut."""


def of_store(reads: Reads) -> str:
    """Show the frames of a store, as they are in its newest tree."""
    caption = repr(reads)
    try:
        infos = reads.tree()
    except TfdbError:  # closed, say
        return table(caption, (), ())
    rows: list[tuple[object, ...]] = [
        (
            info.name,
            info.parent or "",
            "root" if info.parent is None else "static" if info.is_static else "moving",
            info.samples,
            "" if info.rate is None else f"{info.rate:.6g}",
            "" if info.oldest is None else format_seconds(info.oldest),
            "" if info.newest is None else format_seconds(info.newest),
        )
        for info in infos[:MOST_ROWS]
    ]
    if len(infos) > MOST_ROWS:
        rows.append((f"and {len(infos) - MOST_ROWS} more", *[""] * 6))
    return table(caption, ("frame", "parent", "kind", "samples", "Hz", "from", "to"), rows)


def of_transform(transform: Transform) -> str:
    """Show the pose of a transform, and what it was made from."""
    timeless = transform.stamp == 0 and transform.report.timeless
    when = "all times" if timeless else format_seconds(transform.stamp)
    rows = [
        ("translation [m]", *(f"{value:.6g}" for value in transform.translation), ""),
        ("rotation", *(f"{value:.6g}" for value in transform.rotation)),
        ("rpy [rad]", *(f"{value:.6g}" for value in transform.rpy), ""),
    ]
    name = f"T[{transform.target}<-{transform.source}] at {when}"
    shown = table(name, ("", "x", "y", "z", "w"), rows)
    return shown + transform.report._repr_html_() if transform.report.edges else shown


def of_poses(caption: str, stamps: npt.NDArray[np.int64], poses: npt.NDArray[np.float64]) -> str:
    """Show the first and the last poses of many."""
    rows = list(range(len(stamps)))
    if len(rows) > 10:
        rows = [*rows[:5], -1, *rows[-5:]]
    lines: list[Sequence[object]] = []
    for row in rows:
        cells = ["\u22ee"] * 8
        if row >= 0:
            stamp = format_seconds(int(stamps[row])).removesuffix(" s")
            cells = [stamp, *(f"{number:.6g}" for number in poses[row])]
        lines.append(cells)
    heads = ("stamp [s]", "x [m]", "y [m]", "z [m]", "qx", "qy", "qz", "qw")
    return table(caption, heads, lines)

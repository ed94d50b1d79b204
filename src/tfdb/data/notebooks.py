"""HTML tables of tfdb's objects for notebooks.

The records of `types` have the type `Any` here, because that module imports this one.
"""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

from tfdb._core import to_nanoseconds

from .errors import TfdbError
from .stamps import format_seconds

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    import numpy as np
    import numpy.typing as npt

    from tfdb._core import StoreReader, Transform

__all__: list[str] = []


def table(caption: str, head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table; every text is escaped."""
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
"""Largest number of frames in a table."""


def of_store(reads: StoreReader) -> str:
    """Show the frames of a store in its newest tree."""
    caption = repr(reads)
    try:
        infos = reads.tree()
    except TfdbError:  # the store may be closed
        return table(caption, (), ())
    rows: list[tuple[object, ...]] = [_frame_row(info) for info in infos[:MOST_ROWS]]
    if len(infos) > MOST_ROWS:
        rows.append((f"and {len(infos) - MOST_ROWS} more", *[""] * 6))
    return table(caption, _FRAME_HEAD, rows)


_FRAME_HEAD = ("frame", "parent", "kind", "samples", "Hz", "from", "to")


def _frame_row(info: Any) -> tuple[object, ...]:
    return (
        info.name,
        info.parent or "",
        "root" if info.parent is None else "static" if info.is_static else "moving",
        info.samples,
        "" if info.rate is None else f"{info.rate:.6g}",
        "" if info.oldest is None else format_seconds(info.oldest),
        "" if info.newest is None else format_seconds(info.newest),
    )


def of_frame(info: Any) -> str:
    """Show the properties of a frame."""
    gap = format_seconds(info.longest_gap) if info.longest_gap else ""
    head = (*_FRAME_HEAD, "longest gap", "late", "authority")
    return table(f"frame {info.name}", head, [(*_frame_row(info), gap, info.late, info.authority)])


def of_transform(transform: Transform) -> str:
    """Show the pose of a transform, and the samples that it was made from."""
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


_DOTS = "\N{VERTICAL ELLIPSIS}"


def _ends(rows: int) -> list[int | None]:
    """Return the first and the last rows; of many, None stands for those between."""
    return list(range(rows)) if rows <= 10 else [*range(5), None, *range(rows - 5, rows)]


def _numbers(values: Iterable[float]) -> list[str]:
    return [f"{value:.6g}" for value in values]


_POSE_HEAD = ("x [m]", "y [m]", "z [m]", "qx", "qy", "qz", "qw")


def of_poses(caption: str, stamps: npt.NDArray[np.int64], poses: npt.NDArray[np.float64]) -> str:
    """Show the first and the last poses of many."""
    lines = [
        [_DOTS] * 8 if row is None else [_stamp_text(int(stamps[row])), *_numbers(poses[row])]
        for row in _ends(len(stamps))
    ]
    return table(caption, ("stamp [s]", *_POSE_HEAD), lines)


def of_columns(columns: Any) -> str:
    """Show the first and the last transforms of a batch."""
    stamps: Any = columns.stamps
    names = (columns.parents, columns.children)
    lines: list[list[str]] = []
    for row in _ends(len(columns)):
        if row is None:
            lines.append([_DOTS] * 10)
            continue
        stamp = "all times" if stamps is None else _stamp_text(stamps[row])
        frames = [each if isinstance(each, str) else each[row] for each in names]
        lines.append([*frames, stamp, *_numbers(columns.poses[row])])
    return table(repr(columns).strip("<>"), ("parent", "child", "stamp [s]", *_POSE_HEAD), lines)


def _stamp_text(stamp: Any) -> str:
    try:
        return format_seconds(to_nanoseconds(stamp)).removesuffix(" s")
    except (TypeError, TfdbError):  # the store checks the column later
        return str(stamp)


def of_twist(twist: Any) -> str:
    """Show a velocity, or the first and the last of many."""
    if twist.linear.ndim == 1:
        parts = (("linear [m/s]", twist.linear), ("angular [rad/s]", twist.angular))
        rows = [(name, *_numbers(values)) for name, values in parts]
        return table("velocity", ("", "x", "y", "z"), rows)
    head = ("", "vx [m/s]", "vy [m/s]", "vz [m/s]", "wx [rad/s]", "wy [rad/s]", "wz [rad/s]")
    lines = [
        [_DOTS] * 7
        if row is None
        else [str(row), *_numbers(twist.linear[row]), *_numbers(twist.angular[row])]
        for row in _ends(len(twist.linear))
    ]
    return table(f"{len(twist.linear)} velocities", head, lines)


def of_changes(changes: Any) -> str:
    """Show the effects of a commit on frames."""
    frames: dict[str, Sequence[str]] = {
        "stored": _children(changes.stored),
        "stored static": _children(changes.stored_static),
        "made": changes.made,
        "moved": changes.moved,
        "cleared": changes.cleared,
        "removed": changes.removed,
        "passing": changes.passing,
        "gone": list(changes.gone),
    }
    counts = {
        "stored": len(changes.stored),
        "stored static": len(changes.stored_static),
        "gone": sum(changes.gone.values()),
    }
    rows = [
        (what, counts.get(what, len(names)), _few(names)) for what, names in frames.items() if names
    ]
    return table(f"changes of commit {changes.commit}", ("", "count", "frames"), rows)


def _children(columns: Any) -> Sequence[str]:
    children = columns.children
    if not isinstance(children, str):
        return list(dict.fromkeys(children))
    return [children] if len(columns) else []


def _few(names: Sequence[str]) -> str:
    more = f" and {len(names) - 10} more" if len(names) > 10 else ""
    return ", ".join(names[:10]) + more

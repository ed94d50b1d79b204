"""``tfdb lookup``: looks up one transform and prints its report."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import click

import tfdb
from tfdb.data.time_text import format_date, format_duration, format_ns, format_offset
from tfdb.store.report import frames_passed

from . import common, layout, output
from .angles import pose_body
from .graph import listen_option
from .groups import SuggestingCommand
from .selecting import selection_options
from .times import TimeSpec, ask_of_offsets, time_option

if TYPE_CHECKING:
    from tfdb import Buffer, Transform


@click.command("lookup", cls=SuggestingCommand)
@common.file_argument
@common.target_argument
@common.source_argument
@click.argument("time", default="latest", callback=time_option)
@common.policy_option
@common.more_option
@listen_option
@selection_options
@layout.wide_option
@common.json_option
def command(
    *,
    file: str,
    target: str,
    source: str,
    time: TimeSpec,
    policy: Any,
    more: tuple[str, ...],
    as_json: bool,
) -> None:
    """Look up one transform T[TARGET<-SOURCE], and show how it was computed.

    Example: tfdb lookup drive.mcap map camera +12.5

    The transform maps a point of SOURCE into TARGET.

    TIME is in seconds (12.5), in nanoseconds (12500000000ns), a date (2026-05-17T12:00:00.25), or
    an offset from the start (+1.5) or the end (-0.5). The default, 'latest', is the newest stamp at
    which every edge of the path has data. With a live graph (ros1:, ros2:) the command waits for
    the transform.

    The line 'limited by' names the moving edge with the largest of all gaps and ages.
    """
    loaded = common.load((file, *more), there=lambda s: _is_answered(s, target, source, time))
    store = loaded.store
    target, source = common.find_frames(store, target, source)
    stamp = time.resolve(loaded.span)
    try:
        found = store.lookup_transform(target, source, stamp, policy)
    except (tfdb.Extrapolation, tfdb.errors.NoSampleNear) as error:
        common.add_range(error, store, target, source, "", ask_of_offsets(loaded.span, time))
        raise
    if as_json:
        output.emit_json("lookup", _body(loaded, found, time.text))
    else:
        _show(found, loaded.span)


def _is_answered(store: Buffer, target: str, source: str, time: TimeSpec) -> bool:
    """Return whether the received transforms suffice; never for a time that is an offset."""
    names = target.removeprefix("/"), source.removeprefix("/")
    return not time.since and store.can_transform(*names, time.ns)


def _body(loaded: common.Loaded, found: Transform, asked: str) -> dict[str, Any]:
    limiting = found.report.limiting_edge
    return {
        "files": list(loaded.names),
        "target": found.target,
        "source": found.source,
        "asked": asked,
        "stamp_ns": found.stamp,
        **pose_body(found),
        "edges": [
            {
                "child": edge.child,
                "parent": edge.parent,
                "used": edge.used,
                "inverted": edge.inverted,
                "before_ns": edge.before,
                "after_ns": edge.after,
                "gap_ns": edge.gap,
                "age_ns": edge.age,
            }
            for edge in found.report.edges
        ],
        "limiting": None if limiting is None else limiting.child,
    }


_COLUMNS = (
    layout.Column("frame"),
    layout.Column("parent", 5),
    layout.Column("method", 1),
    layout.Column("before", 4, right=True),
    layout.Column("after", 4, right=True),
    layout.Column("gap", 2, right=True),
    layout.Column("age", 3, right=True),
)


def _show(found: Transform, span: tuple[int, int] | None) -> None:
    out = layout.console()
    out.print(layout.wrap(layout.transform_name(found.target, found.source)), style="bold")
    if found.report.timeless:
        text = "none: no edge of the path moves, so the transform holds at all times"
        out.print(layout.wrap(["stamp           ", *layout.words(text)], " " * 16))
    else:
        since = "" if span is None else f"  ({format_ns(found.stamp - span[0])} from the start)"
        out.print(layout.wrap(["stamp           " + format_ns(found.stamp), since], " " * 16))
        if date := format_date(found.stamp):
            out.print(f"date            {date} UTC")
    translation, rotation, rpy, matrix = found._numbers()
    out.print("translation     " + _numbers(translation) + "  m")
    out.print(layout.wrap(["quaternion      " + _numbers(rotation), "  x y z w"], " " * 16))
    out.print("roll pitch yaw  " + _numbers(map(math.degrees, rpy), 4) + "  deg")
    out.print("matrix")
    for row in matrix:
        out.print("  " + _numbers(row))
    edges = {edge.child: edge for edge in found.report.edges}
    if edges:
        names = reversed(frames_passed(found))
        out.print()
        out.print(layout.table(_COLUMNS, [_row(n, edges.get(n), found.stamp) for n in names]))
    limiting = found.report.limiting_edge
    if limiting is not None:
        out.print(layout.prose(f"limited by {limiting.child}"), style="dim")


def _row(name: str, edge: Any, stamp: int) -> tuple[Any, ...]:
    """Return the row of a frame on the path: how the edge to its parent was used.

    The topmost frame of the path has no such edge.
    """
    if edge is None:
        return (name, "", "", "", "", "", "")
    if edge.used == "static":
        return (name, edge.parent, layout.quiet("static"), "", "", "", "")
    before = "" if edge.before is None else format_offset(edge.before - stamp)
    after = "" if edge.after is None else format_offset(edge.after - stamp)
    gap = format_duration(edge.gap) if edge.gap else ""
    return (name, edge.parent, edge.used, before, after, gap, format_duration(edge.age))


def _numbers(values: Any, digits: int = 6) -> str:
    size = digits + (6 if layout.width() >= 70 else 4)
    return " ".join(f"{float(value):>{size}.{digits}f}" for value in values)

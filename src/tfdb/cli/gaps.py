"""``tfdb gaps``: lists the gaps of each edge."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from tfdb.data.counting import counted
from tfdb.data.time_text import format_date, format_duration, format_ns
from tfdb.judging.doctor import holes
from tfdb.store.summary import Forest

from . import common, layout, output
from .check import examined
from .graph import node_option
from .groups import SuggestingCommand
from .selecting import selection_options

if TYPE_CHECKING:
    from tfdb.judging.doctor import Hole


@click.command("gaps", cls=SuggestingCommand)
@common.files_argument
@common.max_gap_option
@common.watch_option
@node_option
@selection_options
@layout.wide_option
@common.json_option
def command(
    *,
    files: tuple[str, ...],
    max_gap: int | None,
    length: int | None,
    as_json: bool,
) -> None:
    """List the gaps of each edge: start, length, publishers before and after.

    Example: tfdb gaps drive.bag --max-gap 0.5

    The gaps of each frame are sorted by time; frames are in the order of the tree. A gap is longer
    than --max-gap, or than five median periods of its edge. Only ROS 1 bags and live graphs name
    publishers.
    """
    loaded, arrivals = examined(files, length)
    loaded.warn_of_mixture()
    order = {row.info.name: i for i, row in enumerate(Forest(loaded.store.tree()).rows())}
    found = holes(arrivals.log, max_gap)
    found.sort(key=lambda hole: (order.get(hole.frame, len(order)), hole.gap.before))
    if as_json:
        output.emit_json("gaps", {"files": list(loaded.names), "gaps": [_body(h) for h in found]})
        return
    out = layout.console()
    if found:
        out.print(layout.table(_COLUMNS, [_row(hole, max_gap) for hole in found]))
    else:
        frames = counted(len(loaded.store.frames()), "frame")
        text = f"no gaps in {counted(arrivals.log.count, 'transform')} of {frames}"
        out.print(layout.prose(text))
    layout.say_refused(out, loaded.report)


def _body(hole: Hole) -> dict[str, Any]:
    return {
        "frame": hole.frame,
        "parent": hole.parent,
        "before_ns": hole.gap.before,
        "after_ns": hole.gap.after,
        "length_ns": hole.gap.length,
        "period_ns": hole.period,
        "publisher_before": hole.publisher_before,
        "publisher_after": hole.publisher_after,
    }


_COLUMNS = (
    layout.Column("frame"),
    layout.Column("parent", 7),
    layout.Column("since", 2, right=True),
    layout.Column("date (UTC)", 4),
    layout.Column("length", 1, right=True),
    layout.Column("usual", 5, right=True),
    layout.Column("publisher before", 3),
    layout.Column("publisher after", 6),
)


def _row(hole: Hole, limit: int | None) -> tuple[Any, ...]:
    before, after = hole.publisher_before, hole.publisher_after
    return (
        hole.frame,
        hole.parent,
        format_ns(hole.gap.before),
        format_date(hole.gap.before),
        layout.loud(_length(hole.gap.length, limit)),
        format_duration(hole.period),
        before,
        layout.loud(after) if after != before else after,
    )


def _length(length: int, limit: int | None) -> str:
    """Describe a length; with all digits if it would otherwise look equal to the limit."""
    text = format_duration(length)
    rounded = limit is not None and text == format_duration(limit)
    return f"{format_ns(length)} s" if rounded else text

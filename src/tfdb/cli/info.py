"""``tfdb info``: shows the contents of a recording."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from tfdb.data.counting import counted
from tfdb.data.path_checks import check_path
from tfdb.data.time_text import format_dates, format_duration, format_ns
from tfdb.store.summary import EdgeSummary, Forest, edge_summaries

from . import common, layout, output
from .graph import listen_option
from .groups import SuggestingCommand
from .selecting import selection_options

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.console import Console

    import tfdb
    from tfdb.recordings.load_report import LoadReport
    from tfdb.trajectories.reading_report import TrajectoryRows


@click.command("info", cls=SuggestingCommand)
@common.files_argument
@listen_option
@selection_options
@layout.wide_option
@common.json_option
def command(*, files: tuple[str, ...], as_json: bool) -> None:
    """Show what a recording holds: topics, frames, edges with rates, gaps, duration.

    Example: tfdb info drive.mcap

    Several FILEs are parts of one recording. A shared store (shm:NAME), a live graph (ros1:,
    ros2:), a frozen store (FILE.tfdb) and a trajectory are shown without topics.
    """
    loaded = common.load(files, apart=True)
    edges = edge_summaries(loaded.store)
    if as_json:
        output.emit_json("info", _body(loaded, edges))
    else:
        _show(loaded, edges)


def _body(loaded: common.Loaded, edges: list[EdgeSummary]) -> dict[str, Any]:
    start, end = loaded.span or (None, None)
    report = loaded.report
    return {
        "files": list(loaded.names),
        "topics": [
            {"name": topic.name, "messages": topic.messages, "static": topic.static}
            for topic in (() if report is None else report.topics)
        ],
        "messages": report and report.messages,
        "transforms": report and report.transforms,
        "refused": report and report.refused,
        **rows_body(report),
        "refused_transforms": report and report.refused_transforms,
        **(
            {"lost": [vars(loss) for loss in report.lost]}
            if report and loaded.selection.salvage
            else {}
        ),
        "mixed": None if loaded.mixed is None else mixed_body(loaded.mixed),
        "frames": len(loaded.store.frames()),
        "roots": [info.name for info in loaded.store.tree() if info.parent is None],
        "start_ns": start,
        "end_ns": end,
        "edges": [edge_body(edge) for edge in edges],
    }


def mixed_body(error: tfdb.errors.MixedSources) -> dict[str, Any]:
    """Return groups of topics that disagree as JSON; `info` and `check` use the same keys."""
    groups = {name: list(topics) for name, topics in (error.groups or {}).items()}
    return {"groups": groups, "frames": list(error.frames or ())}


def rows_body(report: LoadReport | None) -> dict[str, Any]:
    """Return how many rows of each trajectory file were read, repeated or skipped, as JSON."""
    found = report.trajectories if report else ()
    return {"trajectories": [vars(rows) for rows in found]} if found else {}


def say_rows(out: Console, trajectories: Sequence[TrajectoryRows]) -> None:
    """Print how many rows of each trajectory file were read, repeated or skipped."""
    for rows in trajectories:
        name = f"{check_path(rows.path).name}: " if len(trajectories) > 1 else ""
        out.print(layout.prose(f"{name}{rows.summary}"))


def edge_body(edge: EdgeSummary) -> dict[str, Any]:
    """Return one edge as JSON; `info` and `tree` use the same keys."""
    info = edge.info
    return {
        "frame": info.name,
        "parent": info.parent,
        "static": info.is_static,
        "samples": info.samples,
        "rate_hz": info.rate,
        "oldest_ns": info.oldest,
        "newest_ns": info.newest,
        "longest_gap_ns": None if edge.longest is None else edge.longest.length,
        "gaps": len(edge.gaps),
        "late": info.late,
        "authority": info.authority,
    }


def _show(loaded: common.Loaded, edges: list[EdgeSummary]) -> None:
    out = layout.console()
    report = loaded.report
    infos = loaded.store.tree()
    whole = loaded.span
    out.print(layout.prose(", ".join(loaded.names), *loaded.names), style="bold")
    if whole is not None:
        text = f"{format_ns(whole[0])} to {format_ns(whole[1])}"
        out.print(layout.wrap([text, f" ({format_duration(whole[1] - whole[0])})"]))
        dates = format_dates(*whole)
        if dates:
            out.print(dates)
    moving = sum(1 for edge in edges if not edge.info.is_static)
    given = ""
    if report:
        messages = sum(topic.messages for topic in report.topics)
        given = f"{counted(messages, 'message')}, " if messages or not report.trajectories else ""
        given += f"{counted(report.transforms, 'transform')}, "
    static = counted(len(edges) - moving, "static edge")
    counts = f"{given}{counted(len(infos), 'frame')}, {moving} moving and {static}"
    out.print(layout.prose(counts))
    if report:
        layout.say_refused(out, report)
        say_rows(out, report.trajectories)
        kinds = ("moving", "static")
        rows = [(t.name, f"{t.messages:,}", kinds[t.static]) for t in report.topics]
        if rows:
            out.print(layout.table(_TOPIC_COLUMNS, rows))
    by_name = {edge.info.name: edge for edge in edges}
    tree = Forest(infos).rows()
    lines = [_edge_row(row.info.name, by_name.get(row.info.name)) for row in tree]
    if lines:
        out.print(layout.table(_EDGE_COLUMNS, lines, [row.depth for row in tree]))


_TOPIC_COLUMNS = (
    layout.Column("topic"),
    layout.Column("messages", 1, right=True),
    layout.Column("kind", 2),
)
_EDGE_COLUMNS = (
    layout.Column("frame"),
    layout.Column("parent", 6),
    layout.Column("rate", 1, right=True),
    layout.Column("samples", 4, right=True),
    layout.Column("longest gap", 2, right=True),
    layout.Column("late", 3, right=True),
    layout.Column("publisher", 5),
)


def _edge_row(name: str, edge: EdgeSummary | None) -> tuple[Any, ...]:
    if edge is None:
        return (name, "", layout.quiet("root"), "", "", "", "")
    info = edge.info
    names = (name, info.parent or "")
    if info.is_static:
        return (*names, layout.quiet("static"), "", "", "", info.authority)
    gap: Any = "" if edge.longest is None else format_duration(edge.longest.length)
    if edge.gaps:
        gap = layout.loud(gap)
    rate = "" if info.rate is None else f"{info.rate:.4g} Hz"
    return (*names, rate, f"{info.samples:,}", gap, str(info.late or ""), info.authority)

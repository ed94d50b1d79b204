"""``tfdb tree``: shows the frame tree."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click
from rich.text import Text

from tfdb.data.counting import counted
from tfdb.data.time_text import format_duration, format_when
from tfdb.store.summary import EdgeSummary, Forest, TreeRow, edge_summaries

from . import common, layout, output
from .graph import listen_option
from .groups import SuggestingCommand
from .info import edge_body
from .selecting import selection_options
from .times import TimeSpec, time_option, warn_of_bounds

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tfdb import Buffer, Snapshot


@click.command("tree", cls=SuggestingCommand)
@common.files_argument
@click.option(
    "--at",
    metavar="TIME",
    callback=time_option,
    help="Show the tree as it was at this time.  [default: the newest]",
)
@listen_option
@selection_options
@layout.wide_option
@common.json_option
def command(*, files: tuple[str, ...], at: TimeSpec | None, as_json: bool) -> None:
    """Show the frame tree with rates, gaps and publishers, now or at a given time.

    Example: tfdb tree drive.mcap --at +12.5

    TIME is in seconds (12.5), in nanoseconds (12500000000ns), a date (2026-05-17T12:00:00.25), or
    an offset from the start (+1.5) or the end (-0.5).
    """
    loaded = common.load(files, apart=True)
    time = None if at is None else at.resolve(loaded.span)
    warn_of_bounds(loaded.span, at=at)
    infos = loaded.store.tree(time)
    forest = Forest(infos)
    edges = {edge.info.name: edge for edge in edge_summaries(loaded.store)}
    if as_json:
        output.emit_json("tree", _body(loaded, forest, edges, time))
        return
    if time is not None:
        layout.console().print(f"at {format_when(time)}", style="dim")
    _print(forest, edges)


def print_tree(store: Buffer | Snapshot) -> None:
    """Print the newest frame tree of a store in the width of the terminal."""
    _print(Forest(store.tree()), {edge.info.name: edge for edge in edge_summaries(store)})


def _print(forest: Forest, edges: dict[str, EdgeSummary]) -> None:
    out = layout.console()
    for root in forest.roots:
        for line in _draw(forest, edges, root):
            out.print(line)


def _body(
    loaded: common.Loaded, forest: Forest, edges: dict[str, EdgeSummary], time: int | None
) -> dict[str, Any]:
    frames = []
    for row in forest.rows():
        name = row.info.name
        body = edge_body(edges[name]) if name in edges else {"frame": name}
        frames.append({**body, "parent": row.info.parent, "depth": row.depth})
    return {
        "files": list(loaded.names),
        "time_ns": time,
        "roots": forest.roots,
        "frames": frames,
    }


def _draw(forest: Forest, edges: dict[str, EdgeSummary], root: str) -> Iterator[Text]:
    """Return the lines of one tree. Its guides are narrow enough for every name to fit."""
    rows = list(forest.walk(root))
    width = layout.width()
    step = next((s for s in (4, 2) if all(_fits(r, s, width) for r in rows)), 1)
    last: list[bool] = []
    for row in rows:
        name = layout.safe(row.info.name)
        if row.depth == 0:
            yield Text(name, style="bold")
            continue
        last[row.depth - 1 :] = [row.last]
        ends = [
            *("    " if ended else "│   " for ended in last[:-1]),
            "└── " if row.last else "├── ",
        ]
        guides = layout.drawing("".join(end[: step - 1] + " " for end in ends))
        if step == 1:  # blanks, fewer where the name would not fit
            guides = guides[: max(width - layout.cells(name), 0)]
        line = Text(guides, style="dim")
        line.append(name, style="not dim")
        room = width - line.cell_len
        for note in _notes(edges[row.info.name]):
            room -= 2 + note.cell_len
            if room < 0:
                break  # the rest is less important
            line.append("  ").append_text(note)
        yield line


def _fits(row: TreeRow, step: int, width: int) -> bool:
    return step * row.depth + layout.cells(layout.safe(row.info.name)) <= width


def _notes(edge: EdgeSummary) -> Iterator[Text]:
    """Return the facts of an edge, the most important first."""
    info = edge.info
    notes = ["static"] if info.is_static else []
    if not info.is_static:
        notes.append(
            counted(info.samples, "sample") if info.rate is None else f"{info.rate:.4g} Hz"
        )
    if info.late:
        notes.append(f"{info.late} late")
    yield Text(", ".join(notes), style="dim" if info.is_static else "cyan")
    if edge.gaps and edge.longest is not None:
        count = counted(len(edge.gaps), "gap")
        yield layout.loud(f"{count}, longest {format_duration(edge.longest.length)}")
    if info.authority:
        yield layout.quiet(info.authority)

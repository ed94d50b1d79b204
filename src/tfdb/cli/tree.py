"""``tfdb tree``: the frames, each under its parent."""

from __future__ import annotations

from typing import Any

import click
from rich.text import Text
from rich.tree import Tree

from tfdb.summary import EdgeSummary, Forest, edge_summaries

from . import common, output
from .graph import listen_option
from .info import edge_body
from .times import TimeSpec, format_duration, format_ns, time_option


@click.command("tree")
@common.files_argument
@click.option(
    "--at", metavar="TIME", callback=time_option, help="The parents at this time, not the newest."
)
@listen_option
@common.topic_option
@common.json_option
def command(
    *, files: tuple[str, ...], at: TimeSpec | None, topics: tuple[str, ...], as_json: bool
) -> None:
    """Draw the frame tree with rates, gaps and who published.

    TIME: seconds (12.5), nanoseconds (12500000000ns), or an offset from the start (+1.5) or from
    the end (-0.5).
    """
    loaded = common.load(files, topics)
    time = None if at is None else at.resolve(loaded.span)
    infos = loaded.store.tree(time)
    forest = Forest(infos)
    edges = {edge.info.name: edge for edge in edge_summaries(loaded.store)}
    if as_json:
        output.emit_json("tree", _body(loaded, forest, edges, time))
        return
    out = output.console()
    if time is not None:
        out.print(f"at {format_ns(time)}", style="dim")
    for root in forest.roots:
        out.print(_draw(forest, edges, root))


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


def _draw(forest: Forest, edges: dict[str, EdgeSummary], root: str) -> Tree:
    top = Tree(Text(root, style="bold"), guide_style="dim")
    branches = {root: top}
    for row in forest.walk(root):
        name, parent = row.info.name, row.info.parent
        if row.depth and parent is not None:
            branches[name] = branches[parent].add(describe(edges[name]))
    return top


def describe(edge: EdgeSummary) -> Text:
    """Write a frame's line in the tree: name, rate, longest gap, late samples, authority."""
    info = edge.info
    text = Text(info.name)
    notes = ["static"] if info.is_static else []
    if not info.is_static:
        notes.append(f"{info.samples:,} samples" if info.rate is None else f"{info.rate:.4g} Hz")
    if info.late:
        notes.append(f"{info.late} late")
    text.append("  " + ", ".join(notes), style="dim" if info.is_static else "cyan")
    if edge.gaps and edge.longest is not None:
        count = f"{len(edge.gaps)} gap{'s' if len(edge.gaps) > 1 else ''}"
        text.append(f"  {count}, longest {format_duration(edge.longest.length)}", style="bold red")
    if info.authority:
        text.append(f"  {info.authority}", style="dim")
    return text

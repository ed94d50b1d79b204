"""The tree as text, in tf2's forms."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from .phrases import seconds

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tfdb import Transform
    from tfdb.types import FrameInfo

    from .times import Flavor

# What YAML takes as a key as it stands, and does not take for a number or a word of its own.
PLAIN = re.compile(r"(?!(?:true|false|null|yes|no|on|off|y|n)$)[A-Za-z_][\w./-]*", re.I)
SHORTEST = 0.0001  # s; so that one sample has a rate, too


def quoted(name: str) -> str:
    """Write a name as a string of YAML."""
    return "'" + name.replace("'", "''") + "'"


def in_dot(name: str) -> str:
    """Write a name as a string of DOT."""
    return '"' + name.replace("\\", "\\\\").replace('"', '\\"') + '"'


def length_and_rate(info: FrameInfo) -> tuple[float, float]:
    """Seconds that an edge's samples span, and how many there are in one."""
    length = ((info.newest or 0) - (info.oldest or 0)) / 1e9
    return length, info.samples / max(length, SHORTEST)


def as_yaml(tree: Iterable[FrameInfo], flavor: Flavor) -> str:
    """All edges as YAML."""
    digits = 3 if flavor == "ros1" else 6
    lines = []
    for info in tree:
        if info.parent is None:
            continue
        length, rate = length_and_rate(info)
        key = info.name if PLAIN.fullmatch(info.name) else quoted(info.name)
        lines += [
            f"{key}: ",
            f"  parent: {quoted(info.parent)}",
            f"  broadcaster: {quoted(info.authority)}",
            f"  rate: {rate:.3f}",
            f"  most_recent_transform: {seconds(info.newest or 0, digits)}",
            f"  oldest_transform: {seconds(info.oldest or 0, digits)}",
            f"  buffer_length: {length:.3f}",
        ]
    if not lines:
        return "{}" if flavor == "ros1" else "[]"
    return "\n".join(lines) + "\n"


def as_string(tree: Iterable[FrameInfo]) -> str:
    """All edges, one line each."""
    return "".join(
        f"Frame {info.name} exists with parent {info.parent or 'NO_PARENT'}.\n"
        for info in tree
        if info.parent is not None or info.cleared
    )


def as_dot(tree: Sequence[FrameInfo], now: int | None) -> str:
    """All edges as a graph; with `now`, how old each is, and a legend."""
    if not any(info.parent is not None for info in tree):
        return 'digraph G {\n"no tf data recieved"}'
    parts = ["digraph G {\n"]
    for info in tree:
        if info.parent is None:
            continue
        length, rate = length_and_rate(info)
        newest = info.newest or 0
        age = "" if now is None else f"( {seconds(now - newest, 3)} sec old)"
        broadcaster = in_dot(info.authority)[1:-1]
        parts.append(
            f"{in_dot(info.parent)} -> {in_dot(info.name)}["
            f'label="Broadcaster: {broadcaster}\\nAverage rate: {rate:.3f} Hz\\n'
            f"Most recent transform: {seconds(newest, 3)} {age}\\n"
            f'Buffer length: {length:.3f} sec\\n"];\n'
        )
    if now is not None:
        parts.append(
            "edge [style=invis];\n subgraph cluster_legend { style=bold; color=black; "
            f'label ="view_frames Result";\n"Recorded at time: {seconds(now, 3)}"'
            "[ shape=plaintext ] ;\n }"
        )
        parents = {info.parent for info in tree}
        roots = [info.name for info in tree if info.parent is None and info.name in parents]
        parts += [f'"Recorded at time: {seconds(now, 3)}"->{in_dot(root)};\n' for root in roots]
    return "".join(parts) + "}"


def frames_passed(found: Transform) -> list[str]:
    """Frames on the way from source to target, both included."""
    up, down = [found.source], []
    for edge in found.report.edges:
        if edge.inverted:
            down.append(edge.child)
        else:
            up.append(edge.parent)
    return up + down[::-1]

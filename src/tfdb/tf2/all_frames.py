"""The tree as text, in tf2's forms."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from tfdb.ros.times import SECOND

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tfdb.data.types import FrameInfo
    from tfdb.ros.times import Flavor

# What YAML takes as a key as it stands, and does not take for a number or a word of its own.
PLAIN = re.compile(r"(?!(?:true|false|null|yes|no|on|off|y|n)$)[A-Za-z_][\w./-]*", re.I)
# What YAML takes for a line's end, or not at all; DOT ends at the first of them.
ESCAPED = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\ufeff\ufffe\uffff]")
LONGEST_KEY = 1000  # characters; YAML allows a little more before the colon of a line
SHORTEST = 0.0001  # s; so that one sample has a rate, too


def _escape(found: re.Match[str]) -> str:
    """Write one character as YAML does between double quotes."""
    code = ord(found[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"


def quoted(name: str) -> str:
    """Write a name as a string of YAML."""
    if ESCAPED.search(name) is None:
        return "'" + name.replace("'", "''") + "'"
    return '"' + ESCAPED.sub(_escape, name.replace("\\", "\\\\").replace('"', '\\"')) + '"'


def in_dot(*lines: str) -> str:
    """Write a name, or lines, as a DOT string, with the escapes of YAML."""
    shown = (ESCAPED.sub(_escape, line) for line in lines)
    return '"' + "\\n".join(x.replace("\\", "\\\\").replace('"', '\\"') for x in shown) + '"'


def in_seconds(stamp: int, digits: int) -> str:
    """Write a stamp as tf2's listings do: from a float, which decides how a half is rounded."""
    whole, rest = divmod(stamp, SECOND)
    return f"{whole + 1e-9 * rest:.{digits}f}"


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
            f"{key}: " if len(key) <= LONGEST_KEY else f"? {key}\n:",
            f"  parent: {quoted(info.parent)}",
            f"  broadcaster: {quoted(info.authority)}",
            f"  rate: {rate:.3f}",
            f"  most_recent_transform: {in_seconds(info.newest or 0, digits)}",
            f"  oldest_transform: {in_seconds(info.oldest or 0, digits)}",
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
        age = "" if now is None else f"( {in_seconds(now - newest, 3)} sec old)"
        broadcaster = in_dot(info.authority)[1:-1]
        parts.append(
            f"{in_dot(info.parent)} -> {in_dot(info.name)}["
            f'label="Broadcaster: {broadcaster}\\nAverage rate: {rate:.3f} Hz\\n'
            f"Most recent transform: {in_seconds(newest, 3)} {age}\\n"
            f'Buffer length: {length:.3f} sec\\n"];\n'
        )
    if now is not None:
        parts.append(
            "edge [style=invis];\n subgraph cluster_legend { style=bold; color=black; "
            f'label ="view_frames Result";\n"Recorded at time: {in_seconds(now, 3)}"'
            "[ shape=plaintext ] ;\n }"
        )
        parents = {info.parent for info in tree}
        roots = [info.name for info in tree if info.parent is None and info.name in parents]
        parts += [f'"Recorded at time: {in_seconds(now, 3)}"->{in_dot(root)};\n' for root in roots]
    return "".join(parts) + "}"

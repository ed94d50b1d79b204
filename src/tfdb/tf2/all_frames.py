"""The tree as text, in tf2's formats."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

from tfdb.ros.times import SECOND

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tfdb.data.types import FrameInfo
    from tfdb.ros.times import Flavor

# Valid YAML keys without quotes, which YAML does not read as a number or a keyword.
PLAIN = re.compile(r"(?!(?:true|false|null|yes|no|on|off|y|n)$)[A-Za-z_][\w./-]*", re.I)
# Line ends and invalid characters in YAML; a DOT file ends at the first of these.
ESCAPED = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\ufeff\ufffe\uffff]")
LONGEST_KEY = 1000  # characters; YAML allows a little more before the colon of a line
SHORTEST = 0.0001  # seconds, so that a single sample also has a rate


def _escape(found: re.Match[str]) -> str:
    """Escape one character for a double-quoted YAML string."""
    code = ord(found[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"


def quoted(name: str) -> str:
    """Write a name as a YAML string."""
    if ESCAPED.search(name) is None:
        return "'" + name.replace("'", "''") + "'"
    return '"' + ESCAPED.sub(_escape, name.replace("\\", "\\\\").replace('"', '\\"')) + '"'


def in_dot(*lines: str) -> str:
    """Write a name, or lines, as a DOT string, with the escapes of YAML."""
    shown = (ESCAPED.sub(_escape, line) for line in lines)
    return '"' + "\\n".join(x.replace("\\", "\\\\").replace('"', '\\"') for x in shown) + '"'


def in_seconds(stamp: int, digits: int) -> str:
    """Write a stamp as in tf2's listings: from a float, so that it is rounded as in tf2."""
    whole, rest = divmod(stamp, SECOND)
    return f"{whole + 1e-9 * rest:.{digits}f}"


def length_and_rate(info: FrameInfo) -> tuple[float, float]:
    """Return the span of an edge's samples in seconds, and their rate."""
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
    """All edges as a DOT graph; with `now`, also the age of each edge and a legend."""
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

"""Remedies for an edge that a recording has as both static and moving."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Mapping


def way_on(error: str, frame: str, topics: Mapping[str, bool]) -> str:
    """Return the message of a StaticConflict with the options of loading instead of its advice.

    The store's advice is for a program that writes. `frame` is the child's name in the recording.
    `topics` maps each topic that was read to whether it is static.
    """
    what = error.rpartition(": remove frame ")[0] or error
    static = [name for name, is_static in topics.items() if is_static]
    moving = [name for name, is_static in topics.items() if not is_static]
    ways = []
    if static:
        entry = f"{static[0] if len(static) == 1 else '*_static'}:{frame}"
        ways.append(f"exclude={entry!r} (--exclude {entry!r}) loads what is moving")
    if len(moving) == 1:
        entry = f"{moving[0]}:{frame}"
        ways.append(f"exclude={entry!r} (--exclude {entry!r}) loads what is static")
    return f"{what}; {', '.join(ways)}" if ways else error

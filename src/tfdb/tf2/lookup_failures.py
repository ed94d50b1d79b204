"""Finds tf2's reason for a failed lookup, by tf2's walk. Used for error texts only.

tf2 walks from the source to its root, then from the target to the end of the first walk. It names
the edge at which the second walk stopped, otherwise that of the first walk. So this edge may be
above the common ancestor, and two trees may be reported as an extrapolation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from tfdb._core import StoreReader


class Gap(NamedTuple):
    """An edge without data at a stamp."""

    edge: str
    """The child of the edge."""
    stamp: int
    """The requested stamp."""
    oldest: int | None
    """The first stamp of the edge; None: it has been cleared."""
    newest: int | None
    """The last stamp of the edge; None: it has been cleared."""


class TwoTrees:
    """tf2's walk finds no path between the frames."""


def lookup_failure(
    reads: StoreReader, target: str, source: str, stamp: int
) -> Gap | TwoTrees | None:
    """Return why a lookup at a stamp fails, if both frames exist; None: it succeeds in tf2.

    Stamp 0 is the latest common time.
    """
    found = reads._reach(target, source, stamp or None)
    if found is None:
        return None
    edge, common_time, oldest, newest = found
    return TwoTrees() if edge is None else Gap(edge, stamp or common_time, oldest, newest)

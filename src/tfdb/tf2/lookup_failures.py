"""Why tf2 has no answer: its walk, for the words only. Lookups that have an answer never come here.

tf2 walks from the source to its root, then from the target to where the first walk ended, and names
the edge that the second walk stopped at, else that of the first. Hence the edge may lie above the
meeting point of the two, and two trees may be told as an extrapolation.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from tfdb._core import StoreReader


class Gap(NamedTuple):
    """An edge without data at a stamp."""

    edge: str
    """Its child."""
    stamp: int
    """The requested stamp."""
    oldest: int | None
    """Its first stamp; None: it has been cleared."""
    newest: int | None
    """Its last stamp; None: it has been cleared."""


class TwoTrees:
    """No path joins the frames, as far as tf2 looks."""


def lookup_failure(
    reads: StoreReader, target: str, source: str, stamp: int
) -> Gap | TwoTrees | None:
    """Why T[target<-source] at a stamp has no answer, where both frames exist; None: tf2 has one.

    Stamp 0 is the latest common time.
    """
    found = reads._reach(target, source, stamp or None)
    if found is None:
        return None
    edge, common_time, oldest, newest = found
    return TwoTrees() if edge is None else Gap(edge, stamp or common_time, oldest, newest)

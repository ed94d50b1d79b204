"""Children, descendants and paths between frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb._core import to_nanoseconds
from tfdb.data.argument_checks import check_name
from tfdb.data.errors import Disconnected
from tfdb.data.stamps import format_seconds

from .explain import from_one_state

if TYPE_CHECKING:
    from tfdb._core import Snapshot, StoreReader
    from tfdb.data.stamps import StampLike

__all__: list[str] = []

Parents = dict[str, str | None]


def children(reads: StoreReader, name: str, stamp: StampLike | None) -> list[str]:
    """Implements `Buffer.children`."""

    def read(snapshot: Snapshot) -> list[str]:
        parents = _parents(snapshot, stamp, name)
        return [child for child, parent in parents.items() if parent == name]

    return from_one_state(reads, read)


def descendants(reads: StoreReader, name: str, stamp: StampLike | None) -> list[str]:
    """Implements `Buffer.descendants`."""

    def read(snapshot: Snapshot) -> list[str]:
        below: dict[str, list[str]] = {}
        for child, parent in _parents(snapshot, stamp, name).items():
            if parent is not None:
                below.setdefault(parent, []).append(child)
        found: dict[str, None] = {}  # ordered; in a damaged store the parents may form a cycle
        open_ = below.get(name, [])[::-1]
        while open_:
            frame = open_.pop()
            if frame not in found:
                found[frame] = None
                open_ += below.get(frame, [])[::-1]
        return list(found)

    return from_one_state(reads, read)


def path(reads: StoreReader, target: str, source: str, stamp: StampLike | None) -> list[str]:
    """Implements `Buffer.path`."""

    def read(snapshot: Snapshot) -> list[str]:
        parents = _parents(snapshot, stamp, target, source)
        up, down = _chain(parents, target), _chain(parents, source)
        if up[-1] != down[-1]:
            when = "" if stamp is None else f" at {format_seconds(to_nanoseconds(stamp))}"
            raise Disconnected(
                f"no path joins {target!r} and {source!r}{when}: the frames are in two trees, "
                f"{target!r} under root {up[-1]!r} and {source!r} under root {down[-1]!r}",
                target=target,
                source=source,
                frames=(up[-1], down[-1]),
                commit=snapshot.commit,
            )
        meeting = next(frame for frame in up if frame in set(down))
        return up[: up.index(meeting) + 1] + down[: down.index(meeting)][::-1]

    return from_one_state(reads, read)


def _parents(snapshot: Snapshot, stamp: StampLike | None, *names: str) -> Parents:
    """Return the parents of all frames at a stamp; raise UnknownFrame for unknown names."""
    for name in names:
        snapshot.parent_of(check_name("a frame's name", name))
    return {info.name: info.parent for info in snapshot.tree(stamp)}


def _chain(parents: Parents, name: str) -> list[str]:
    """Return a frame and its ancestors, up to the root."""
    chain: dict[str, None] = {}  # ordered; in a damaged store the parents may form a cycle
    at: str | None = name
    while at is not None and at not in chain:
        chain[at] = None
        at = parents[at]
    return list(chain)

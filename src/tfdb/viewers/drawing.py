"""Content of `to_rerun` and `to_foxglove`: edges of stores, poses of trajectories."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from tfdb.data.errors import InvalidArgument

if TYPE_CHECKING:
    import numpy.typing as npt

    from tfdb.trajectories.trajectory import Trajectory


@dataclass(frozen=True)
class Edge:
    """The samples T[parent<-child] of one edge."""

    child: str
    stamps: npt.NDArray[np.int64] | None
    """Nanoseconds, increasing; None for a static edge."""
    poses: npt.NDArray[np.float64]
    parents: list[str]


@dataclass(frozen=True)
class Scene:
    """All edges, and the trajectories, which are also drawn as paths."""

    edges: list[Edge]
    paths: list[Trajectory]

    @property
    def first(self) -> int:
        """The first stamp; 0 without moving edges."""
        return min((int(e.stamps[0]) for e in self.edges if e.stamps is not None), default=0)

    @property
    def transforms(self) -> int:
        """Number of samples."""
        return sum(len(edge.poses) for edge in self.edges)


def collect(what: Any) -> Scene:
    """Collect the edges of a store, snapshot or trajectories; others raise InvalidArgument."""
    if hasattr(what, "tree") and hasattr(what, "samples"):
        return Scene(_edges_of(what), [])
    paths = list(what) if isinstance(what, list | tuple) else [what]
    for path in paths:
        if not all(hasattr(path, name) for name in ("target", "source", "stamps", "poses")):
            raise InvalidArgument(
                "export() takes a Buffer, a Snapshot, a Trajectory or a list of trajectories, got "
                f"{type(path).__name__}",
                value=path,
            )
    if not paths:
        raise InvalidArgument(
            "export() needs at least one trajectory: the list is empty", value=what
        )
    sources = [path.source for path in paths]
    twice = next((name for name in sources if sources.count(name) > 1), None)
    if twice is not None:
        raise InvalidArgument(f"two trajectories have the source frame {twice!r}", value=what)
    return Scene([_edge_of(path) for path in paths], paths)


def _edges_of(store: Any) -> list[Edge]:
    found = []
    for info in store.tree():
        stamps, poses, parents = store.samples(info.name)
        if len(poses):
            found.append(Edge(info.name, None if info.is_static else stamps, poses, parents))
    return found


def _edge_of(path: Trajectory) -> Edge:
    good = np.flatnonzero(np.isfinite(path.poses).all(axis=1))
    if not len(good):
        raise InvalidArgument(
            f"the trajectory of {path.source} in {path.target} has no valid pose", value=path
        )
    return Edge(path.source, path.stamps[good], path.poses[good], [path.target] * len(good))

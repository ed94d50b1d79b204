"""Explanations of lookups as text."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, TypeVar, cast

from tfdb._core import Buffer
from tfdb.data.counting import counted
from tfdb.data.errors import (
    Disconnected,
    Extrapolation,
    GapTooLarge,
    NoSampleNear,
    SnapshotTooOld,
    Stale,
    TfdbError,
    UnknownFrame,
)
from tfdb.data.lazy_names import belong_to
from tfdb.data.stamps import format_seconds

from .summary import clocks, describe_clocks

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb._core import Policy, Snapshot, StoreReader, Transform
    from tfdb.data.stamps import StampLike
    from tfdb.data.types import FrameInfo

__all__ = ["EdgeExplanation", "Explanation"]

T = TypeVar("T")

_EXPLAINED = (UnknownFrame, Disconnected, Extrapolation, GapTooLarge, Stale, NoSampleNear)


@dataclass(frozen=True, slots=True)
class EdgeExplanation:
    """One edge of an explained path: the samples that it uses, or why it has none."""

    child: str
    """Child frame of the edge."""
    parent: str
    """Parent frame of the edge."""
    ok: bool
    """Whether the edge has an answer."""
    text: str
    """The explanation as text."""


@dataclass(frozen=True, slots=True)
class Explanation:
    """Why a lookup of T[target<-source] has an answer, or fails."""

    target: str
    """Target of the lookup."""
    source: str
    """Source of the lookup."""
    ok: bool
    """Whether there is an answer."""
    text: str
    """The explanation as text, also returned by str()."""
    edges: tuple[EdgeExplanation, ...]
    """The edges of the path; without a path, the edges from both frames up to their roots."""
    error: TfdbError | None
    """The error that the lookup would raise; None if it has an answer."""

    def __str__(self) -> str:
        return self.text

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.text)}</pre>"

    def __bool__(self) -> bool:
        return self.ok


def explain_lookup(
    self: StoreReader,
    target: str,
    source: str,
    stamp: StampLike | None,
    policy: Policy | None,
) -> Explanation:
    """Implements `Buffer.explain`."""
    return from_one_state(
        self, lambda snapshot: _Case(snapshot, target, source, stamp, policy).explain()
    )


def from_one_state(reads: StoreReader, read: Callable[[Snapshot], T]) -> T:
    """Call `read` with a snapshot: the given one, or one of a buffer's newest state."""
    if not isinstance(reads, Buffer):
        return read(cast("Snapshot", reads))
    # In a damaged store each state is too old: limit the attempts.
    for _ in range(999):
        with reads.snapshot() as snapshot, suppress(SnapshotTooOld):
            return read(snapshot)
    with reads.snapshot() as snapshot:
        return read(snapshot)


class _Case:
    """One lookup to explain."""

    def __init__(
        self,
        snapshot: Snapshot,
        target: str,
        source: str,
        stamp: StampLike | None,
        policy: Policy | None,
    ) -> None:
        self.snapshot = snapshot
        self.target = target
        self.source = source
        self.stamp = stamp
        self.policy = policy

    def explain(self) -> Explanation:
        """Look up the transform, and explain the result."""
        try:
            found = self.snapshot.lookup_transform(
                self.target, self.source, self.stamp, self.policy
            )
        except UnknownFrame as error:
            return self._because(error, [], self._others(error))
        except Disconnected as error:
            return self._disconnected(error)
        except _EXPLAINED as error:
            return self._failing_edge(error)
        edges = tuple(
            EdgeExplanation(edge.child, edge.parent, ok=True, text=str(edge))
            for edge in found.report.edges
        )
        text = [f"{found!r}"]
        text += [f"  {edge.text}" for edge in edges]
        if not edges:
            text.append("  target and source are the same frame")
        return self._explanation(text, edges, None)

    def _because(
        self, error: TfdbError, edges: list[EdgeExplanation], advice: list[str]
    ) -> Explanation:
        text = [str(error)]
        text += [f"  {'ok  ' if edge.ok else 'FAIL'} {edge.text}" for edge in edges]
        text += advice
        return self._explanation(text, tuple(edges), error)

    def _explanation(
        self, text: list[str], edges: tuple[EdgeExplanation, ...], error: TfdbError | None
    ) -> Explanation:
        return Explanation(
            self.target,
            self.source,
            ok=error is None,
            text="\n".join(text),
            edges=edges,
            error=error,
        )

    def _others(self, error: UnknownFrame) -> list[str]:
        """List the store's frames, unless the error suggests similar ones."""
        if "did you mean" in str(error):
            return []
        known = self.snapshot.frames()
        if not known:
            return ["The store has no frames."]
        shown = ", ".join(map(repr, known[:8]))
        more = ", ..." if len(known) > 8 else ""
        return [f"The store has {counted(len(known), 'frame')}: {shown}{more}"]

    def _chain(self, tree: dict[str, FrameInfo], name: str) -> list[FrameInfo]:
        """Return the frames with a parent, from `name` up to the root."""
        chain: dict[str, FrameInfo] = {}  # in a damaged store the parents may form a cycle
        info = tree.get(name)
        while info is not None and info.parent is not None and info.name not in chain:
            chain[info.name] = info
            info = tree.get(info.parent)
        return list(chain.values())

    def _disconnected(self, error: Disconnected) -> Explanation:
        tree = {info.name: info for info in self.snapshot.tree(self.stamp)}
        edges = []
        for name in (self.source, self.target):
            edges += [
                EdgeExplanation(
                    info.name, str(info.parent), ok=True, text=f"{_arrow(info)}: {_span(info)}"
                )
                for info in self._chain(tree, name)
            ]
        roots = " and ".join(map(repr, error.frames or ()))
        advice = [f"The frames are in two trees: an edge between {roots} would join them."]
        return self._because(error, edges, advice)

    def _failing_edge(self, error: TfdbError) -> Explanation:
        stamp = error.stamp if self.stamp is None else self.stamp
        tree = {info.name: info for info in self.snapshot.tree(stamp)}
        up = self._chain(tree, self.source)
        down = self._chain(tree, self.target)
        while up and down and up[-1].name == down[-1].name:
            up.pop()
            down.pop()
        edges = [self._edge(info, stamp) for info in up + down]
        return self._because(error, edges, [self._advice(up + down)])

    def _advice(self, edges: list[FrameInfo]) -> str:
        """Describe the stamps that every edge of the path covers."""
        several = describe_clocks(clocks(edges, self.snapshot))
        return f"{_covered(edges)} There are {several}." if several else _covered(edges)

    def _edge(self, info: FrameInfo, stamp: StampLike | None) -> EdgeExplanation:
        parent = str(info.parent)
        try:
            found = self._alone(parent, info.name, stamp)
        except _EXPLAINED as error:
            text = f"{_arrow(info)}: {_reason(error)}; {_span(info)}"
            return EdgeExplanation(info.name, parent, ok=False, text=text)
        return EdgeExplanation(info.name, parent, ok=True, text=str(found.report.edges[0]))

    def _alone(self, parent: str, child: str, stamp: StampLike | None) -> Transform:
        """Look up one edge by itself, because a failing lookup continues up to the root."""
        if stamp is not None:
            with suppress(Disconnected):  # at the stamp it has another parent, or is a root
                return self.snapshot._lookup_edge(parent, child, stamp, self.policy)
        return self.snapshot.lookup_transform(parent, child, stamp, self.policy)


def _arrow(info: FrameInfo) -> str:
    return f"T[{info.parent}<-{info.name}]"


def _span(info: FrameInfo) -> str:
    if info.is_static:
        return "static"
    if info.oldest is None or info.newest is None:
        return "no samples"
    rate = "" if info.rate is None else f" at {info.rate:.3g} Hz"
    return (
        f"{counted(info.samples, 'sample')}{rate} from {format_seconds(info.oldest)} to "
        f"{format_seconds(info.newest)}"
    )


def _reason(error: TfdbError) -> str:
    """Describe briefly why one edge has no answer."""
    asked, limit, before, after = (
        "?" if stamp is None else format_seconds(stamp)
        for stamp in (error.stamp, error.limit, error.before, error.after)
    )
    if isinstance(error, Extrapolation):
        beyond = {"past": "before its first sample", "future": "after its last sample"}
        return f"{asked} is {beyond[error.reason]}" if error.reason in beyond else "no data"
    if isinstance(error, GapTooLarge):
        return f"the gap around {asked}, from {before} to {after}, exceeds {limit}"
    if isinstance(error, Stale) and error.expectation is not None:
        return f"its newest sample, at {before}, is older than its lifespan of {limit}, now {asked}"
    if isinstance(error, Stale):
        return f"its sample at {before} is older than {limit} at {asked}"
    if isinstance(error, NoSampleNear):
        return (
            f"no sample at {asked}" if not error.limit else f"no sample within {limit} of {asked}"
        )
    return str(error)


def _covered(edges: list[FrameInfo]) -> str:
    moving = [edge for edge in edges if edge.oldest is not None and edge.newest is not None]
    if not moving:
        return "No edge of the path moves."
    oldest = max(moving, key=lambda edge: edge.oldest or 0)
    newest = min(moving, key=lambda edge: edge.newest or 0)
    first, last = oldest.oldest or 0, newest.newest or 0
    if first > last:
        return (
            f"The edges of the path have no stamp in common: {_arrow(newest)} ends at "
            f"{format_seconds(last)}, before {_arrow(oldest)} begins at {format_seconds(first)}."
        )
    return (
        f"The whole path has data from {format_seconds(first)} ({_arrow(oldest)}) to "
        f"{format_seconds(last)} ({_arrow(newest)})."
    )


belong_to("tfdb.types", globals(), __all__)

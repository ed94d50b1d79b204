"""Reports of transforms, edge by edge, and their printed form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from tfdb._core import _restore_transform
from tfdb.data.counting import counted
from tfdb.data.errors import TfdbError
from tfdb.data.lazy_names import belong_to
from tfdb.data.stamps import format_seconds

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfdb._core import Buffer, Transform
    from tfdb.data.types import Frozen

__all__ = ["EdgeUse", "Report"]

Used: TypeAlias = Literal[
    "static", "exact", "interpolated", "held", "nearest", "extrapolated", "latest"
]


@dataclass(frozen=True, slots=True)
class EdgeUse:
    """How one edge of the path was used. Times are nanoseconds."""

    child: str
    """Child frame of the edge; `(removed)` if the frame was removed later."""
    parent: str
    """Its parent at that stamp."""
    used: Used
    """`static`; `exact`: the sample at the stamp; `interpolated`: between `before` and `after`;
    `held`: the sample before, unchanged; `nearest`; `extrapolated`: beyond both; `latest`."""
    before: int | None
    """Stamp of the earlier sample; None for a static edge."""
    after: int | None
    """Stamp of the later sample; of a `held` one, the next sample may have another parent. Equal to
    `before` if one sample was used."""
    gap: int
    """Time between the two samples; 0 if one was used."""
    age: int
    """Age of the sample `before` at the transform's stamp: negative if it is newer, 0 for a static
    edge. In a latest lookup: age relative to the newest sample of the path."""
    inverted: bool
    """Whether the path goes from the parent to the child."""

    def __str__(self) -> str:
        name = f"T[{self.parent}<-{self.child}]" + (" inverted" if self.inverted else "")
        if self.before is None or self.after is None:
            return f"{name}: static"
        if self.before == self.after:
            return (
                f"{name}: {self.used}, sample at {format_seconds(self.before)}, "
                f"age {format_seconds(self.age)}"
            )
        return (
            f"{name}: {self.used}, samples at {format_seconds(self.before)} and "
            f"{format_seconds(self.after)}, gap {format_seconds(self.gap)}"
        )


@dataclass(frozen=True, slots=True)
class Report:
    """The samples that a transform T[target<-source] was made from. Times are nanoseconds."""

    target: str
    """Frame into which it maps."""
    source: str
    """Frame from which it maps."""
    stamp: int
    """The stamp of the transform."""
    edges: tuple[EdgeUse, ...]
    """The edges from the source up to the common ancestor, followed by those from the target up.
    Empty for a product of transforms, and for a transform that was not looked up."""

    @property
    def timeless(self) -> bool:
        """Whether the transform holds at all times: the stamp is 0 and no edge moves."""
        return self.stamp == 0 and all(edge.before is None for edge in self.edges)

    @property
    def age(self) -> int:
        """Longest time from a used sample to the stamp of the transform; 0 if no edge moves.

        For the age at this moment: `buf.clock.now() - T.stamp`.
        """
        return max((edge.age for edge in self.edges if edge.before is not None), default=0)

    @property
    def max_gap(self) -> int:
        """Longest gap between the two samples of an edge that was interpolated or held."""
        return max((edge.gap for edge in self.edges), default=0)

    @property
    def oldest(self) -> int | None:
        """Oldest stamp used; None if no edge moves."""
        return min((edge.before for edge in self.edges if edge.before is not None), default=None)

    @property
    def interpolated(self) -> bool:
        """Whether any edge was interpolated."""
        return any(edge.used == "interpolated" for edge in self.edges)

    @property
    def extrapolated(self) -> bool:
        """Whether any edge was extrapolated."""
        return any(edge.used == "extrapolated" for edge in self.edges)

    @property
    def limiting_edge(self) -> EdgeUse | None:
        """The moving edge with the longest gap or greatest age; None if no edge moves."""
        moving = [edge for edge in self.edges if edge.before is not None]
        return max(moving, key=lambda edge: max(edge.gap, abs(edge.age)), default=None)

    def _repr_html_(self) -> str:
        """Write a table for notebooks."""
        from tfdb.data.notebooks import table  # noqa: PLC0415 - needed by few

        rows = [
            (
                f"T[{edge.parent}<-{edge.child}]",
                edge.used,
                "" if edge.before is None else format_seconds(edge.before),
                format_seconds(edge.gap),
                format_seconds(edge.age),
            )
            for edge in self.edges
        ]
        caption = f"T[{self.target}<-{self.source}] at {format_seconds(self.stamp)}"
        return table(caption, ("edge", "used", "sample", "gap", "age"), rows)

    def __str__(self) -> str:
        when = "all times" if self.timeless else format_seconds(self.stamp)
        lines = [f"T[{self.target}<-{self.source}] at {when}"]
        lines += [f"  {edge}" for edge in self.edges]
        limiting = self.limiting_edge
        if limiting is not None:
            lines.append(f"  limited by {limiting.child}")
        return "\n".join(lines)


Row: TypeAlias = tuple[str, str, Used, int, int, bool]


def make_report(target: str, source: str, stamp: int, rows: Sequence[Row]) -> Report:
    """Make the report of a transform from (child, parent, used, before, after, inverted)."""
    newest = max((after for *_, after, _ in rows if after >= 0), default=stamp)
    edges = []
    for child, parent, used, before, after, inverted in rows:
        reference = newest if used == "latest" else stamp
        moving = before >= 0
        edges.append(
            EdgeUse(
                child=child,
                parent=parent,
                used=used,
                before=before if moving else None,
                after=after if moving else None,
                gap=after - before if moving else 0,
                age=reference - before if moving else 0,
                inverted=inverted,
            )
        )
    return Report(target, source, stamp, tuple(edges))


def transform_repr(transform: Transform) -> str:
    """Write `T[map<-camera] at 12.5 s: translation [...] rotation [...]`."""
    timeless = transform.stamp == 0 and transform.report.timeless
    when = "all times" if timeless else format_seconds(transform.stamp)
    translation = ", ".join(f"{value:.6g}" for value in transform.translation)
    rotation = ", ".join(f"{value:.6g}" for value in transform.rotation)
    return (
        f"T[{transform.target}<-{transform.source}] at {when}: "
        f"translation [{translation}], rotation [{rotation}]"
    )


def transform_message(transform: Transform) -> Any:
    """Make the message of `Transform.to_msg`."""
    from tfdb.ros.ros_messages import installed, makers  # noqa: PLC0415 - ROS takes long to import

    make, _ = makers(installed() or "ros2")
    pose = transform.pose.tolist()
    return make(transform.target, transform.source, transform.stamp, pose)


def buffer_repr(
    buffer: Buffer,
    commit: int,
    history: float | None,
    concurrency: str,
    frozen: Frozen | None,
    closed: bool,
) -> str:
    """Write the repr, such as `<tfdb.Buffer at commit 7, history 10 s: ...>`."""
    kept = "unlimited" if history is None else f"{history:g} s"
    engine = "" if concurrency == "snapshot" else f", concurrency {concurrency}"
    file = "" if frozen is None else f", frozen in {frozen.path}"
    end = ", closed" if closed else _extent(buffer)
    return f"<tfdb.Buffer at commit {commit}, history {kept}{engine}{file}{end}>"


def _extent(buffer: Buffer) -> str:
    """Count frames and edges, with the time span; empty if reads are not possible."""
    from .summary import span  # noqa: PLC0415 - it knows this module

    try:
        infos = buffer.tree()
    except TfdbError:
        return ""
    edges = [info for info in infos if info.parent is not None]
    static = sum(info.is_static for info in edges)
    text = f": {counted(len(infos), 'frame')}, {counted(len(edges), 'edge')} ({static} static)"
    known = span(infos)
    if known is None:
        return text
    start, end = known
    return f"{text}, {format_seconds(end - start)} from {format_seconds(start)}"


def restore_transform(*state: object) -> Transform:
    """Unpickle a transform: pickle cannot refer to functions of the extension."""
    return _restore_transform(*state)


belong_to("tfdb.types", globals(), __all__)


def frames_passed(found: Transform) -> list[str]:
    """Return the frames of the path from source to target, both included."""
    up, down = [found.source], []
    for edge in found.report.edges:
        if edge.inverted:
            down.append(edge.child)
        else:
            up.append(edge.parent)
    return up + down[::-1]

"""Which topics belong together, and the edges on which several groups of topics disagree.

`/tf` and `/tf_static` of one namespace are one group. Every other topic is a group of its own, with
the topic that is called the same and ends in `_static`.
"""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING

from tfdb import _core
from tfdb.errors import MixedSources

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Mapping, Sequence
    from typing import TypeAlias

    import numpy as np
    import numpy.typing as npt

    from tfdb import Buffer

    from .choice import Rewriter
    from .containers import Source
    from .recordings import Recording, Run

    Rows: TypeAlias = npt.NDArray[np.intp]

_KEPT = 10.0
"""A relayed sample of a growing recording may come so many seconds after the newest."""
_LISTED = 5
"""An error lists at most so many groups, and so many frames."""


def prefix_of(source: Source) -> str:
    """Return the prefix of a topic's group: `robot1/` for `/robot1/tf`, empty for `/tf`.

    A topic of poses belongs to its namespace.
    """
    return prefix_of_topic(source.topic, transforms=source.holds_transforms)


def prefix_of_topic(name: str, *, transforms: bool) -> str:
    """Do the same for the name of a topic, of transforms or of poses."""
    topic = name.strip("/").removesuffix("_static")
    space, _, last = topic.rpartition("/")
    whole = topic if transforms and last != "tf" else space
    return f"{whole}/" if whole else ""


def refuse_mixture(
    recordings: Sequence[Recording],
    judged: Callable[[Source], bool],
    kind: Callable[[Source], tuple[str, bool]],
    rewriter: Rewriter,
) -> None:
    """Raise MixedSources if groups of topics disagree on an edge.

    One group costs nothing. Of several groups the child frames are compared. Groups that share a
    child frame are stored apart, and their samples of that frame are compared.

    Sources for which `judged` is true are compared. `kind` is that of a `Selection`. `rewriter`
    drops what is not wanted and keeps all names.
    """
    topics, children = _survey(recordings, judged, kind, rewriter)

    def of(groups: Collection[str]) -> Callable[[Source], bool]:
        return lambda each: judged(each) and prefix_of(each) in groups

    stores: dict[str, Buffer] = {}
    shared = _shared(children)
    for group in {group for groups in shared.values() for group in groups}:
        stores[group] = _core.Buffer(history=None)
        for recording in recordings:
            for run in recording.read(of([group]), kind):
                rewriter.ingest(run, stores[group], *kind(run.source))
    mixed = {
        frame: groups
        for frame, groups in sorted(shared.items())
        if disagree([stores[group] for group in groups], frame)
    }
    if mixed:
        raise mixture(_paths(recordings), _named(topics, mixed), tuple(mixed))


def refuse_collision(
    recordings: Sequence[Recording],
    judged: Callable[[Source], bool],
    kind: Callable[[Source], tuple[str, bool]],
    rewriter: Rewriter,
) -> None:
    """Raise MixedSources if frames of several groups get one name from the prefixes of the groups.

    Arguments as in `refuse_mixture`, but `rewriter` puts the prefixes before the names.
    """
    topics, children = _survey(recordings, judged, kind, rewriter)
    shared = _shared(children)
    if shared:
        named, frames = _named(topics, shared), tuple(sorted(shared))
        reason = (
            f"{len(named)} groups of topics get the same frame names from their prefixes, "
            f"{_few(frames, ', ')}: {_listed(named)}. "
            "Name the topics of one group (topics=, --topic)"
        )
        raise _mixed_sources(_paths(recordings), reason, named, frames)


def _survey(
    recordings: Sequence[Recording],
    judged: Callable[[Source], bool],
    kind: Callable[[Source], tuple[str, bool]],
    rewriter: Rewriter,
) -> tuple[dict[str, set[str]], dict[str, set[str]]]:
    """Return the topics and, if there are several groups, the child frames of each group."""
    topics: dict[str, set[str]] = defaultdict(set)
    for recording in recordings:
        for source in filter(judged, recording.all_sources):
            topics[prefix_of(source)].add("/" + source.topic.strip("/"))
    children: dict[str, set[str]] = defaultdict(set)
    for recording in recordings if len(topics) > 1 else ():
        for run in recording.read(judged, kind):
            for group, names in _children(run, rewriter, *kind(run.source)).items():
                children[group] |= names
    return topics, children


class Watch:
    """Finds groups of topics that disagree while a recording grows.

    The first group that states the parent of a frame owns the edge. Another group agrees if its
    samples are among those that the owner has sent until then. Threads: one.

    `rewriter` drops what is not wanted and keeps all names.
    """

    def __init__(self, path: str, rewriter: Rewriter) -> None:
        self._path = path
        self._rewriter = rewriter
        self._owners: dict[str, str] = {}
        self._topics: dict[str, set[str]] = defaultdict(set)
        self._owned: Buffer = _core.Buffer(history=_KEPT)

    def look(self, run: Run, encoding: str, is_static: bool) -> None:
        """Look at messages of one group. Raises MixedSources if they disagree with another."""
        group = prefix_of(run.source)
        names = _children(run, self._rewriter, encoding, is_static)[group]
        self._topics[group].add("/" + run.source.topic.strip("/"))
        foreign = sorted(each for each in names if self._owners.setdefault(each, group) != group)
        fresh: Buffer = _core.Buffer(history=None) if foreign else self._owned
        self._rewriter.ingest(run, fresh, encoding, is_static)
        others = [each for each in foreign if not _is_part(fresh, self._owned, each)]
        if others:
            named = sorted({group, *(self._owners[each] for each in others)})
            topics = {each: sorted(self._topics[each]) for each in named}
            raise mixture(self._path, topics, tuple(others))


def mixture(
    path: str, topics: Mapping[str, Sequence[str]], frames: tuple[str, ...]
) -> MixedSources:
    """Return the error that names the groups, by their prefixes, and the frames of the edges."""
    prefix = max(topics, key=len)
    reason = (
        f"{len(topics)} groups of topics state different transforms of {_few(frames, ', ')}: "
        f"{_listed(topics)}. "
        "Name the topics of one group (topics=, --topic), load each group under its own prefix, "
        f"such as {prefix} (by_namespace=True, --by-namespace), or mix them (mix=True, --mix)"
    )
    return _mixed_sources(path, reason, topics, frames)


def _mixed_sources(
    path: str, reason: str, topics: Mapping[str, Sequence[str]], frames: tuple[str, ...]
) -> MixedSources:
    groups = {"/" + prefix.rstrip("/"): tuple(each) for prefix, each in topics.items()}
    return MixedSources(path, reason, frames=frames, groups=groups)


def _paths(recordings: Sequence[Recording]) -> str:
    return ", ".join(str(recording.path) for recording in recordings)


def _named(
    topics: Mapping[str, Collection[str]], found: Mapping[str, Sequence[str]]
) -> dict[str, list[str]]:
    """Return the topics of the groups that were found for some frame."""
    groups = sorted({group for groups in found.values() for group in groups})
    return {group: sorted(topics[group]) for group in groups}


def _listed(topics: Mapping[str, Sequence[str]]) -> str:
    return _few([" with ".join(each) for each in topics.values()], "; ")


def disagree(stores: Sequence[Buffer], frame: str) -> bool:
    """Return whether stores differ on the edge from a frame to its parent.

    They agree where the samples of all are among the samples of one, as of a topic that relays
    another or a part of it.
    """
    found = [_Edge(store, frame) for store in stores if store.frame_exists(frame)]
    edges = sorted((edge for edge in found if len(edge.stamps)), key=lambda each: len(each.stamps))
    return any(not each.repeats(edges[-1]) for each in edges[:-1])


class _Edge:
    """The samples of one edge in one store. Threads: one."""

    def __init__(self, store: Buffer, frame: str) -> None:
        self._is_static = store.frame_info(frame).is_static
        self.stamps, self._poses, self._parents = store.samples(frame)

    def repeats(self, other: _Edge) -> bool:
        """Return whether `other` has all samples of this edge in the time that both cover.

        A static edge agrees with moving samples that are all of its pose.
        """
        import numpy as np

        if self._is_static or other._is_static:
            ours, theirs = self._first(), other._first()
            return ours == theirs and self._is_constant() and other._is_constant()
        within = (self.stamps >= other.stamps[0]) & (self.stamps <= other.stamps[-1])
        rows = np.flatnonzero(within)
        if not len(rows):
            return False
        at = np.searchsorted(other.stamps, self.stamps[rows])
        return (
            np.array_equal(other.stamps[at], self.stamps[rows])
            and np.array_equal(other._poses[at], self._poses[rows])
            and self._same_parents(rows, other, at)
        )

    def ends_after(self, other: _Edge) -> bool:
        """Return whether this edge has samples that are newer than all of `other`."""
        return bool(self.stamps[-1] > other.stamps[-1])

    def _same_parents(self, rows: Rows, other: _Edge, at: Rows) -> bool:
        if {*self._parents, *other._parents} == {self._parents[0]}:
            return True
        return [other._parents[i] for i in at] == [self._parents[i] for i in rows]

    def _first(self) -> tuple[str, list[float]]:
        return self._parents[0], self._poses[0].tolist()

    def _is_constant(self) -> bool:
        return len(set(self._parents)) == 1 and bool((self._poses == self._poses[0]).all())


def _is_part(store: Buffer, whole: Buffer, frame: str) -> bool:
    """Return whether all samples of an edge are in another store."""
    if not store.frame_exists(frame) or not whole.frame_exists(frame):
        return True  # all of them were refused
    one, other = _Edge(store, frame), _Edge(whole, frame)
    return not len(one.stamps) or (one.repeats(other) and not one.ends_after(other))


def _children(read: Run, rewriter: Rewriter, encoding: str, is_static: bool) -> dict[str, set[str]]:
    """Return the child frames of each group in a run."""
    found: dict[str, set[str]] = defaultdict(set)
    run = rewriter.run(read, static=is_static)
    if run is not None:
        part = run.messages, run.first, run.last
        for id_, names in _core.recorded_children(*part, encoding=encoding).items():
            found[prefix_of(run.sources[id_])] |= names
    return found


def _shared(children: Mapping[str, set[str]]) -> dict[str, list[str]]:
    """Return the frames that several groups have as a child, with these groups."""
    groups: dict[str, list[str]] = defaultdict(list)
    for group, names in sorted(children.items()):
        for name in names:
            groups[name].append(group)
    return {name: owners for name, owners in groups.items() if len(owners) > 1}


def _few(names: Sequence[str], separator: str) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return separator.join(names[:_LISTED]) + more

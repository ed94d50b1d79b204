"""Groups the topics of recordings, and finds edges on which groups or files disagree.

`/tf` and `/tf_static` of one namespace form one group of topics. Every other topic is a group of
its own, together with the topic of the same name plus `_static`; so is a topic of poses. The
messages of a group in one file are a part. Two groups agree on an edge if one repeats samples of
the other. Parts of one group agree unless they contradict each other, so consecutive recordings
agree.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import TYPE_CHECKING

from tfdb import _core
from tfdb.data.errors import MixedSources
from tfdb.recordings.containers import prefix_of
from tfdb.store.summary import find_gaps, static_edges

from .selection import absolute

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
    from typing import TypeAlias

    import numpy as np
    import numpy.typing as npt

    from tfdb._core import Buffer

    from .containers import Source
    from .recording import Recording, Run
    from .rewriter import Rewriter

    Rows: TypeAlias = npt.NDArray[np.intp]
    Floats: TypeAlias = npt.NDArray[np.float64]
    Range: TypeAlias = tuple[int, int]
    Fixed: TypeAlias = tuple[str, list[float]]
    Test: TypeAlias = Callable[[Source], bool]
    Kind: TypeAlias = Callable[[Source], tuple[str, bool]]

_KEPT = 10.0
"""In a growing recording: seconds that a relayed sample may be older than the newest."""
_LISTED = 5
"""Largest number of groups, and of frames, in an error."""
_ROUNDING = 1e-6
"""Largest change of a transform by rounding of printed digits: metres, quaternion parts."""
_FLOAT32 = 2.0**-23
"""Largest relative change of a number by rounding to 32 bits."""
_NEAR = 10
"""Number of samples before and after an overlap from which an edge's usual step is computed."""
_STEPS = 2.0
"""Largest distance of a sample from its neighbours, in usual steps of its edge."""
_SHARE = 0.1
"""Sources contradict each other if a larger share of alternating samples is further away."""


def group_of(source: Source) -> str:
    """Return the group of a topic: `/robot1/tf` for `/robot1/tf_static`."""
    return absolute(spelling_of(source))


def spelling_of(source: Source) -> str:
    """Return the group as the file spells it: with a leading slash or without."""
    return source.topic.removesuffix("_static")


@dataclass(frozen=True, eq=False)
class Part:
    """The messages of one group of topics in one file, under one spelling of its name."""

    recording: Recording
    group: str
    spelling: str
    topics: set[str] = field(default_factory=set)
    moving: dict[str, Range] = field(default_factory=dict)
    """The first and last stamp of each moving child frame, nanoseconds."""
    fixed: dict[str, Fixed] = field(default_factory=dict)
    """Parent and pose of each static child frame."""

    def holds(self, source: Source) -> bool:
        """Return whether a source of the recording is in this part."""
        return spelling_of(source) == self.spelling


class Survey:
    """Compares the sources of recordings. A single part is not read. Threads: one.

    Parameters
    ----------
    recordings
        The open recordings.
    wanted
        True for sources that are loaded.
    kind
        That of a `Selection`.
    rewriter
        Drops unwanted transforms. Keeps all names, or adds only the prefixes of the groups.
    """

    def __init__(
        self, recordings: Sequence[Recording], wanted: Test, kind: Kind, rewriter: Rewriter
    ) -> None:
        self._recordings = recordings
        self._wanted = wanted
        self._kind = kind
        self._rewriter = rewriter
        self._paths = ", ".join(str(recording.path) for recording in recordings)

    def refuse_groups(self, judged: Test, *, apart: bool) -> None:
        """Raise MixedSources if groups of topics disagree on an edge.

        Sources for which `judged` is true are compared. `apart`: the groups have their prefixes,
        and disagree where these make one name.
        """
        sources: dict[str, list[Source]] = defaultdict(list)
        for recording in self._recordings:
            for source in filter(self._wanted, recording.all_sources):
                if judged(source):
                    sources[group_of(source)].append(source)
        if len(sources) < 2:
            return
        shared: dict[str, set[str]] = defaultdict(set)
        for part in self._parts:
            for frame in {*part.moving, *part.fixed} if part.group in sources else ():
                shared[frame].add(part.group)
        shared = {frame: groups for frame, groups in sorted(shared.items()) if len(groups) > 1}
        stores = {
            group: self._stored([part for part in self._parts if part.group == group])
            for group in {group for groups in shared.values() for group in groups}
        }
        mixed = {
            frame: groups
            for frame, groups in shared.items()
            if disagree([stores[group] for group in sorted(groups)], frame)
        }
        if mixed:
            found = {group for groups in mixed.values() for group in groups}
            named = {group: sources[group] for group in found}
            raise (collision if apart else mixture)(self._paths, named, tuple(mixed))

    def refuse_parts(self) -> None:
        """Raise MixedSources if files, or two spellings of a topic, contradict on an edge."""
        groups: dict[str, list[Part]] = defaultdict(list)
        for part in self._bare_parts:
            groups[part.group].append(part)
        if all(len(parts) < 2 for parts in groups.values()):
            return
        groups.clear()
        for part in self._parts:
            groups[part.group].append(part)
        found: dict[str, list[Part]] = defaultdict(list)
        for parts in groups.values():
            for frame, one, other in self._contradictions(parts):
                found[frame] += [each for each in (one, other) if each not in found[frame]]
        if found:
            parts = [part for part in self._parts if any(part in each for each in found.values())]
            raise mixed_parts(self._paths, parts, tuple(sorted(found)))

    def _contradictions(self, parts: Sequence[Part]) -> Iterator[tuple[str, Part, Part]]:
        """Find the frames on which two parts of a group contradict each other."""
        pairs = [
            (frame, one, other)
            for one, other in combinations(parts, 2)
            if not one.recording.store or one.recording.store != other.recording.store
            for frame in {*one.moving, *one.fixed} & {*other.moving, *other.fixed}
            if _may_differ(frame, one, other)
        ]
        compared = dict.fromkeys(part for _, *both in pairs for part in both)
        stores = {part: self._stored([part]) for part in parts if part in compared}
        for frame, one, other in pairs:
            ours, theirs = _edge(stores[one], frame), _edge(stores[other], frame)
            if ours is not None and theirs is not None and ours.contradicts(theirs):
                yield frame, one, other

    @cached_property
    def _bare_parts(self) -> list[Part]:
        """List the parts, without reading them."""
        found: dict[tuple[int, str], Part] = {}
        for number, recording in enumerate(self._recordings):
            for source in filter(self._wanted, recording.all_sources):
                spelling = spelling_of(source)
                part = Part(recording, group_of(source), spelling)
                found.setdefault((number, spelling), part).topics.add(source.topic)
        return list(found.values())

    @cached_property
    def _parts(self) -> list[Part]:
        """List the parts, with the frames of each."""
        for recording in self._recordings:
            mine = {part.spelling: part for part in self._bare_parts if part.recording is recording}
            self._read(recording, mine)
        return self._bare_parts

    def _read(self, recording: Recording, parts: Mapping[str, Part]) -> None:
        def kind(source: Source) -> object:
            made = self._kind(source)
            return made, spelling_of(source) if made[1] else ""

        stores: dict[str, Buffer] = defaultdict(lambda: _core.Buffer(history=None))
        for run in recording.read(self._wanted, kind):
            encoding, is_static = self._kind(run.source)
            if is_static:
                self._rewriter.ingest(run, stores[spelling_of(run.source)], encoding, is_static)
                continue
            for id_, frames in self._rewriter.children(run, encoding, is_static).items():
                moving = parts[spelling_of(run.sources[id_])].moving
                for frame, (first, last) in frames.items():
                    before = moving.get(frame, (first, last))
                    moving[frame] = min(first, before[0]), max(last, before[1])
        for spelling, store in stores.items():
            for info, parent, pose in static_edges(store):
                parts[spelling].fixed[info.name] = parent, pose

    def _stored(self, parts: Sequence[Part]) -> Buffer:
        """Store the transforms of parts."""
        store: Buffer = _core.Buffer(history=None)
        for recording in self._recordings:
            mine = [part for part in parts if part.recording is recording]
            if mine:

                def held(source: Source, mine: Sequence[Part] = mine) -> bool:
                    return self._wanted(source) and any(part.holds(source) for part in mine)

                for run in recording.read(held, self._kind):
                    self._rewriter.ingest(run, store, *self._kind(run.source))
        return store


class Watch:
    """Finds sources that disagree while a recording grows.

    The first part that states the parent of a frame owns the edge. Another group agrees if its
    samples are among those that the owner has sent until then. Threads: one.

    `rewriter` drops unwanted transforms and keeps all names.
    """

    def __init__(self, path: str, rewriter: Rewriter) -> None:
        self._path = path
        self._rewriter = rewriter
        self._owners: dict[str, str] = {}
        self._sources: dict[str, set[Source]] = defaultdict(set)
        self._owned: Buffer = _core.Buffer(history=_KEPT)

    def look(self, run: Run, encoding: str, is_static: bool) -> None:
        """Compare messages of one part. Raises MixedSources if they disagree with another part."""
        part = spelling_of(run.source)
        self._sources[part].add(run.source)
        found = self._rewriter.children(run, encoding, is_static).values()
        names = sorted({name for frames in found for name in frames})
        foreign = [each for each in names if self._owners.setdefault(each, part) != part]
        fresh: Buffer = _core.Buffer(history=None) if foreign else self._owned
        self._rewriter.ingest(run, fresh, encoding, is_static)
        others = [each for each in foreign if not self._agrees(fresh, each, part)]
        if others:
            parts = (part, *(self._owners[frame] for frame in others))
            sources = {each: self._sources[each] for each in parts}
            if len({each.strip("/") for each in sources}) == 1:
                topics = {each: sorted({s.topic for s in of}) for each, of in sources.items()}
                raise mixed_spellings(self._path, topics, tuple(others))
            groups = {group_of(s): of for of in sources.values() for s in of}
            raise mixture(self._path, groups, tuple(others))

    def _agrees(self, fresh: Buffer, frame: str, part: str) -> bool:
        one, other = _edge(fresh, frame), _edge(self._owned, frame)
        if one is None or other is None:
            return True  # all of them were refused
        if self._owners[frame].strip("/") == part.strip("/"):
            return not one.contradicts(other)
        return one.repeats(other) and not one.ends_after(other)


def mixture(
    path: str, groups: Mapping[str, Collection[Source]], frames: tuple[str, ...]
) -> MixedSources:
    """Return the error that names groups that disagree, and the frames of the edges."""
    prefixes = [_prefix(sources) for sources in groups.values()]
    apart = ""
    if len(set(prefixes)) == len(prefixes):
        apart = (
            "load each group under its own prefix, such as "
            f"{max(prefixes, key=len)} (by_namespace=True, --by-namespace), "
        )
    reason = (
        f"{len(groups)} groups of topics state different transforms of {_few(frames, ', ')}: "
        f"{_listed(groups)}. {_choose(groups)}, {apart}or mix them (mix=True, --mix)"
    )
    return _mixed_groups(path, reason, groups, frames)


def collision(
    path: str, groups: Mapping[str, Collection[Source]], frames: tuple[str, ...]
) -> MixedSources:
    """Return the error that names groups whose prefixes give different frames one name."""
    reason = (
        f"{len(groups)} groups of topics get the same frame names from their prefixes, "
        f"{_few(frames, ', ')}: {_listed(groups)}. {_choose(groups)}"
    )
    return _mixed_groups(path, reason, groups, frames)


def mixed_parts(path: str, parts: Sequence[Part], frames: tuple[str, ...]) -> MixedSources:
    """Return the error that names parts that contradict each other."""
    files = {str(part.recording.path) for part in parts}
    if len(files) == 1:
        topics = {part.spelling: sorted(part.topics) for part in parts}
        return mixed_spellings(path, topics, frames)
    groups: dict[str, set[str]] = defaultdict(set)
    for part in parts:
        groups[str(part.recording.path)] |= {absolute(topic) for topic in part.topics}
    listed = [f"{name} ({', '.join(sorted(topics))})" for name, topics in groups.items()]
    reason = (
        f"{len(files)} files state different transforms of {_few(frames, ', ')}: "
        f"{_few(listed, '; ')}. Load one file, give each file its own prefix "
        "(prefix=, --prefix of 'tfdb merge'), or mix them (mix=True, --mix)"
    )
    named = {name: tuple(sorted(topics)) for name, topics in groups.items()}
    return MixedSources(path, reason, frames=frames, groups=named)


def mixed_spellings(
    path: str, topics: Mapping[str, Sequence[str]], frames: tuple[str, ...]
) -> MixedSources:
    """Return the error that names spellings of one topic that contradict each other."""
    spelled = sorted(name for each in topics.values() for name in each)
    reason = (
        f"topics {' and '.join(map(repr, spelled))} are one topic, and state different transforms "
        f"of {_few(frames, ', ')}. Leave the frames out (exclude=, --exclude), or mix the topics "
        "(mix=True, --mix)"
    )
    groups = {name: tuple(each) for name, each in topics.items()}
    return MixedSources(path, reason, frames=frames, groups=groups)


def _mixed_groups(
    path: str, reason: str, groups: Mapping[str, Collection[Source]], frames: tuple[str, ...]
) -> MixedSources:
    """Return an error that names groups by their prefixes; groups of one prefix by a topic."""
    names = {group: "/" + _prefix(sources)[:-1] for group, sources in groups.items()}
    shared = [name for name in names.values() if list(names.values()).count(name) > 1]
    topics = {
        group if names[group] in shared else names[group]: _topics(groups[group])
        for group in _sorted(groups)
    }
    return MixedSources(path, reason, frames=frames, groups=topics)


def _choose(groups: Mapping[str, Collection[Source]]) -> str:
    """Return the remedy of reading one group only."""
    if all(source.holds_transforms for sources in groups.values() for source in sources):
        return "Name the topics of one group (topics=, --topic)"
    return (
        "Leave out the topics of all but one group (exclude=, --exclude), give the poses another "
        "child (pose_topics=, --pose-topic TOPIC=CHILD)"
    )


def _listed(groups: Mapping[str, Collection[Source]]) -> str:
    return _few([" with ".join(_topics(groups[each])) for each in _sorted(groups)], "; ")


def _sorted(groups: Mapping[str, Collection[Source]]) -> list[str]:
    """Sort groups by their prefixes, then by their names."""
    return sorted(groups, key=lambda group: (_prefix(groups[group]), group))


def _prefix(sources: Collection[Source]) -> str:
    return prefix_of(next(iter(sources)))


def _topics(sources: Iterable[Source]) -> tuple[str, ...]:
    return tuple(sorted({absolute(source.topic) for source in sources}))


def disagree(stores: Sequence[Buffer], frame: str) -> bool:
    """Return whether stores differ on the edge from a frame to its parent.

    They agree if one store has all samples of the others, as when a topic relays another.
    """
    edges = [edge for edge in (_edge(store, frame) for store in stores) if edge is not None]
    edges.sort(key=lambda each: len(each.stamps))
    return any(not each.repeats(edges[-1]) for each in edges[:-1])


def _edge(store: Buffer, frame: str) -> _Edge | None:
    """Return the edge from a frame to its parent; None if all its samples were refused."""
    edge = _Edge(store, frame) if store.frame_exists(frame) else None
    return edge if edge is not None and len(edge.stamps) else None


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
            is_same = _is_same(self._first(), other._first())
            return is_same and self._is_constant() and other._is_constant()
        rows = self._rows_within(other)
        if not len(rows):
            return False
        at = np.searchsorted(other.stamps, self.stamps[rows])
        return np.array_equal(other.stamps[at], self.stamps[rows]) and self._equals(rows, other, at)

    def contradicts(self, other: _Edge) -> bool:
        """Return whether the edges differ at a stamp of both, or where their samples alternate.

        A static edge holds at every stamp.
        """
        import numpy as np

        if self._is_static or other._is_static:
            return not self.repeats(other)
        if len(self._rows_within(other)) > len(other._rows_within(self)):
            return other.contradicts(self)
        rows = self._rows_within(other)
        if not len(rows):
            return False
        at = np.searchsorted(other.stamps, self.stamps[rows])
        same = other.stamps[at] == self.stamps[rows]
        if not self._equals(rows[same], other, at[same]):
            return True
        return self._is_far(rows[~same], other, at[~same])

    def ends_after(self, other: _Edge) -> bool:
        """Return whether this edge has samples that are newer than all of `other`."""
        return bool(self.stamps[-1] > other.stamps[-1])

    def _rows_within(self, other: _Edge) -> Rows:
        import numpy as np

        within = (self.stamps >= other.stamps[0]) & (self.stamps <= other.stamps[-1])
        return np.flatnonzero(within)

    def _equals(self, rows: Rows, other: _Edge, at: Rows) -> bool:
        """Return whether rows have the parents and poses of rows of `other`."""
        is_close = _are_close(self._poses[rows], other._poses[at])
        return is_close and self._same_parents(rows, other, at)

    def _same_parents(self, rows: Rows, other: _Edge, at: Rows) -> bool:
        if {*self._parents, *other._parents} == {self._parents[0]}:
            return True
        return [other._parents[i] for i in at] == [self._parents[i] for i in rows]

    def _is_far(self, rows: Rows, other: _Edge, at: Rows) -> bool:
        """Return whether rows lie further from `other` than it moves between samples.

        `at` are the first rows of `other` with later stamps. Rows in gaps of `other` do not count.
        """
        import numpy as np

        gaps = [gap.before for gap in find_gaps(other.stamps)[2]]
        known = ~np.isin(other.stamps[at - 1], gaps)
        rows, at = rows[known], at[known]
        if not len(rows):
            return False
        near = np.arange(max(at[0] - _NEAR, 1), min(at[-1] + _NEAR, len(other.stamps)))
        near = near[~np.isin(other.stamps[near - 1], gaps)]
        steps = _distances(other._poses[near - 1], other._poses[near])
        limit = _STEPS * steps.max(axis=0) + _ROUNDING
        ours = self._poses[rows]
        there = np.minimum(
            _distances(other._poses[at - 1], ours), _distances(other._poses[at], ours)
        )
        far = (there > limit).any(axis=1)
        for index, (row, after) in enumerate(zip(rows, at, strict=True)):
            parents = other._parents[after - 1], other._parents[after]
            far[index] |= self._parents[row] not in parents
        return bool(far.mean() > _SHARE)

    def _first(self) -> Fixed:
        return self._parents[0], self._poses[0].tolist()

    def _is_constant(self) -> bool:
        return len(set(self._parents)) == 1 and _are_close(self._poses, self._poses[:1])


def _may_differ(frame: str, one: Part, other: Part) -> bool:
    """Return whether an edge of two parts must be compared sample by sample."""
    if frame in one.fixed and frame in other.fixed:
        return not _is_same(one.fixed[frame], other.fixed[frame])
    if frame in one.moving and frame in other.moving:
        return _overlap(one.moving[frame], other.moving[frame])
    return True


def _is_same(one: Fixed, other: Fixed) -> bool:
    """Return whether two static transforms have one parent and one pose."""
    import numpy as np

    return one[0] == other[0] and _are_close(np.array([one[1]]), np.array([other[1]]))


def _are_close(one: Floats, other: Floats) -> bool:
    """Return whether rows of poses are equal up to rounding; q and -q are the same rotation."""
    import numpy as np

    sign = np.where(np.sum(one[:, 3:] * other[:, 3:], axis=1, keepdims=True) < 0, -1.0, 1.0)
    turned = np.abs(one[:, 3:] - sign * other[:, 3:]) <= _ROUNDING
    moved = np.isclose(one[:, :3], other[:, :3], rtol=_FLOAT32, atol=_ROUNDING)
    return bool(turned.all() and moved.all())


def _distances(one: Floats, other: Floats) -> Floats:
    """Return how far rows of poses are apart, in metres and in radians."""
    import numpy as np

    metres = np.linalg.norm(one[:, :3] - other[:, :3], axis=1)
    cosines = np.abs(np.sum(one[:, 3:] * other[:, 3:], axis=1))
    return np.column_stack([metres, 2 * np.arccos(np.minimum(cosines, 1.0))])


def _overlap(one: Range, other: Range) -> bool:
    """Return whether two spans overlap by more than a common end stamp.

    A span of one stamp overlaps with each span that contains it.
    """
    first, last = max(one[0], other[0]), min(one[1], other[1])
    return first < last or (first == last and (one[0] == one[1] or other[0] == other[1]))


def _few(names: Sequence[str], separator: str) -> str:
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return separator.join(names[:_LISTED]) + more

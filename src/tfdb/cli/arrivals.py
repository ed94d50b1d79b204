"""A recording's transforms in the order of their arrival, for the doctor."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias, cast

import tfdb
from tfdb.io.choice import OTHERS, Choice
from tfdb.io.recordings import Recording

from .doctor import Log

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from tfdb.io import Source
    from tfdb.io.choice import LoadOptions


Numbers: TypeAlias = tuple[float, ...]


@dataclass(frozen=True)
class Arrivals:
    """The transforms, and whether the containers name their publishers (ROS 1 bags do).

    `mixed` are the frames that some messages write with a leading slash and others without.
    `missed` is how many commits of a live store went by unseen.
    """

    log: Log
    publishers_known: bool
    mixed: tuple[str, ...] = ()
    missed: int = 0


class _Slashes:
    """Which frames are written with a leading slash, which without: decoding drops it."""

    def __init__(self) -> None:
        self._with: set[str] = set()
        self._without: set[str] = set()

    def look(self, data: bytes, names: set[str], encoding: str) -> None:
        if b"/" not in data:
            self._without |= names
            return
        end = b"\0" if encoding == "cdr" else b""
        for name in names:
            plain = name.encode() + end
            slash = b"/" + plain
            for found, text in ((self._with, slash), (self._without, plain)):
                if len(text).to_bytes(4, "little") + text in data:
                    found.add(name)

    def mixed(self) -> tuple[str, ...]:
        return tuple(sorted(self._with & self._without))


class _Stored:
    """A store beside the log, which decides what is refused."""

    def __init__(self, log: Log) -> None:
        self._log = log
        self._store = tfdb.Buffer(history=None)

    def add(self, transforms: Sequence[tfdb.TransformStamped], *, static: bool) -> list[int]:
        """Store transforms of one message; return the indices of those that were not refused."""
        if not transforms:
            return []
        refused = self._store.set_transforms(transforms, static=static, partial=True)
        for member in refused:
            if member.error == "StaticConflict":
                self._log.refuse(transforms[member.index].child, static=static)
        out = {member.index for member in refused}
        return [index for index in range(len(transforms)) if index not in out]


def read_arrivals(
    paths: Sequence[str],
    static: Mapping[str, bool],
    progress: Callable[[int, int], None] | None = None,
    *,
    salvage: bool = False,
    options: LoadOptions | None = None,
) -> Arrivals:
    """Read the topics in `static`, which says of each whether its transforms are static.

    `options` are those with which they were loaded.
    What a store refuses is left out: loading counts it as refused.
    """
    log = Log()
    stored = _Stored(log)
    slashes = _Slashes()
    known = False
    done = 0
    with ExitStack() as stack:
        unit = (options or {}).get("stamp_unit")
        recordings = [
            stack.enter_context(Recording(path, salvage=salvage, stamp_unit=unit)) for path in paths
        ]

        def wants(source: Source) -> bool:
            return source.topic in static

        def kind(source: Source) -> tuple[str, bool]:
            return source.encoding if source.is_tf else OTHERS, static[source.topic]

        choice = Choice(**options or {})
        choice.check_topics(recordings)
        rewriter = choice.resolve(recordings, wants, kind)
        stored.add(rewriter.fixed_joints(), static=True)
        total = sum(s.messages for r in recordings for s in r.all_sources if wants(s))
        for recording in recordings:
            for source, arrival, data in recording.messages(wants):
                done += 1
                if progress is not None and (done % 1000 == 0 or done == total):
                    progress(done, total)
                named = source.authority != source.topic
                known = known or named
                is_static = static[source.topic]
                try:
                    given = rewriter.decoded(data, source, arrival, static=is_static)
                except tfdb.TfdbError:
                    continue
                wanted = [
                    (one, new)
                    for one in given
                    for new in rewriter.transforms([one], source, static=is_static)
                ]
                kept = stored.add([new for _, new in wanted], static=is_static)
                if source.is_tf:
                    space = rewriter.space(source)
                    found = [wanted[index][0] for index in kept]
                    names = {n.removeprefix(space) for o in found for n in (o.parent, o.child)}
                    slashes.look(data, names, source.encoding)
                log.add(
                    (_row(wanted[index][1]) for index in kept),
                    arrival=arrival,
                    publisher=source.authority if named else "",
                    static=is_static,
                )
    return Arrivals(log, known, slashes.mixed())


def _row(one: tfdb.TransformStamped) -> tuple[str, str, int, Sequence[float]]:
    pose = (*cast("Numbers", one.translation), *cast("Numbers", one.rotation))
    return one.parent, one.child, cast("int", one.stamp), pose

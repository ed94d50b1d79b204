"""A recording's transforms in the order of their arrival, for the doctor."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias, cast

import tfdb
from tfdb.io.recordings import Recording

from .doctor import Log

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence


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


def read_arrivals(
    paths: Sequence[str],
    static: Mapping[str, bool],
    progress: Callable[[int, int], None] | None = None,
    *,
    salvage: bool = False,
) -> Arrivals:
    """Read the topics in `static`, which says of each whether its transforms are static.

    Messages that are no TFMessage are passed over: loading them counts them as refused.
    """
    log = Log()
    slashes = _Slashes()
    known = False
    done = 0
    with ExitStack() as stack:
        recordings = [stack.enter_context(Recording(path, salvage=salvage)) for path in paths]
        total = sum(s.messages for r in recordings for s in r.sources if s.topic in static)
        for recording in recordings:
            for source, arrival, data in recording.messages(lambda s: s.topic in static):
                done += 1
                if progress is not None and (done % 1000 == 0 or done == total):
                    progress(done, total)
                named = source.authority != source.topic
                known = known or named
                rows = _rows(data, source.encoding)
                slashes.look(data, {name for row in rows for name in row[:2]}, source.encoding)
                log.add(
                    rows,
                    arrival=arrival,
                    publisher=source.authority if named else "",
                    static=static[source.topic],
                )
    return Arrivals(log, known, slashes.mixed())


def _rows(data: bytes, encoding: str) -> list[tuple[str, str, int, Sequence[float]]]:
    try:
        transforms = tfdb.decode_tf_message(data, encoding)
    except (tfdb.CorruptMessage, tfdb.InvalidName):
        return []
    return [
        (
            t.parent,
            t.child,
            cast("int", t.stamp),
            (*cast("Numbers", t.translation), *cast("Numbers", t.rotation)),
        )
        for t in transforms
    ]

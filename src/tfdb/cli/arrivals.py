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
    """The transforms, and whether the containers name their publishers (ROS 1 bags do)."""

    log: Log
    publishers_known: bool


def read_arrivals(
    paths: Sequence[str],
    static: Mapping[str, bool],
    progress: Callable[[int, int], None] | None = None,
) -> Arrivals:
    """Read the topics in `static`, which says of each whether its transforms are static.

    Messages that are no TFMessage are passed over: loading them counts them as refused.
    """
    log = Log()
    known = False
    done = 0
    with ExitStack() as stack:
        recordings = [stack.enter_context(Recording(path)) for path in paths]
        total = sum(s.messages for r in recordings for s in r.sources if s.topic in static)
        for recording in recordings:
            for source, arrival, data in recording.messages(lambda s: s.topic in static):
                done += 1
                if progress is not None and (done % 1000 == 0 or done == total):
                    progress(done, total)
                named = source.authority != source.topic
                known = known or named
                log.add(
                    _rows(data, source.encoding),
                    arrival=arrival,
                    publisher=source.authority if named else "",
                    static=static[source.topic],
                )
    return Arrivals(log, known)


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

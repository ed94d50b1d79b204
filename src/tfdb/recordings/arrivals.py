"""The chosen transforms of recordings in the order of their arrival, as columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from tfdb import _core

from .choice import OTHERS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy as np
    import numpy.typing as npt

    from .choice import Choice, Rewriter
    from .containers import Source
    from .recording import Recording

    Integers: TypeAlias = npt.NDArray[np.int64]
    Columns: TypeAlias = tuple[Integers, Integers, npt.NDArray[np.float64], Integers, Integers]


@dataclass(frozen=True)
class RecordedArrivals:
    """What a store keeps of recorded transforms, and when it arrived.

    Parameters
    ----------
    edges
        By child frame: stamps, times of arrival, poses, parents, publishers, and one byte for each
        transform that is 1 if it is static. Parents and publishers are indices of `names`.
    names
        The frames and publishers.
    conflicts
        Transforms refused with `StaticConflict`, by child and by whether they are static.
    mixed
        Frames that messages write both with a leading slash and without.
    publishers_known
        Whether a container names its publishers.
    end
        When the last message was received, nanoseconds; 0 without messages.
    rewriter
        What chose the transforms.
    """

    edges: Sequence[tuple[str, Columns, bytes]]
    names: list[str]
    conflicts: Mapping[tuple[str, bool], int]
    mixed: tuple[str, ...]
    publishers_known: bool
    end: int
    rewriter: Rewriter


def publisher_of(source: Source) -> str:
    """Return the name of the node; empty where the container does not name it."""
    return source.authority if source.authority != source.topic else ""


def recorded_arrivals(
    recordings: Sequence[Recording],
    static: Mapping[str, bool],
    choice: Choice,
    progress: Callable[[int, int], None] | None = None,
    publisher: Callable[[Source], str] = publisher_of,
) -> RecordedArrivals:
    """Read the topics in `static`, which says of each whether its transforms are static.

    `progress` is called with the number of messages read and of all.
    """
    reading = _Reading(recordings, static, choice, progress, publisher)
    log = reading.log(with_store=False)
    if not log.is_right:
        log = reading.log(with_store=True)
    names, conflicts, mixed = log.names(), log.conflicts(), tuple(log.mixed())
    return RecordedArrivals(
        log.take(),
        names,
        conflicts,
        mixed,
        reading.publishers_known,
        reading.end,
        reading.rewriter,
    )


class _Reading:
    """Reads the chosen messages of open recordings. Threads: one."""

    def __init__(
        self,
        recordings: Sequence[Recording],
        static: Mapping[str, bool],
        choice: Choice,
        progress: Callable[[int, int], None] | None,
        publisher: Callable[[Source], str],
    ) -> None:
        choice.check_topics(recordings)
        self._recordings = recordings
        self._static = static
        self._choice = choice
        self._progress = progress
        self._publisher = publisher
        self.end = 0
        sources = [s for each in recordings for s in each.all_sources if self._wants(s)]
        self._total = sum(source.messages for source in sources)
        self.publishers_known: bool = any(
            publisher_of(source) for source in sources if source.messages
        )

    def log(self, *, with_store: bool) -> _core.ArrivalLog:
        """Read all messages; `with_store`: a store judges what is refused."""
        log = _core.ArrivalLog(with_store=with_store)
        rewriter = self.rewriter = self._choice.resolve(self._recordings, self._wants, self._kind)
        log.hold(rewriter.fixed_joints())
        done = 0
        for recording in self._recordings:
            for run in recording.read(self._wants, self._kind):
                publishers = {id_: self._publisher(each) for id_, each in run.sources.items()}
                rewriter.log(run, log, *self._kind(run.source), publishers=publishers)
                done += run.last - run.first
                self.end = max(self.end, run.end)
                if self._progress is not None:
                    self._progress(done, self._total)
        return log

    def _wants(self, source: Source) -> bool:
        return source.topic in self._static

    def _kind(self, source: Source) -> tuple[str, bool]:
        return source.encoding if source.is_tf else OTHERS, self._static[source.topic]

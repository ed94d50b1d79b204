"""The chosen transforms of recordings in the order of their arrival, as columns."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from tfdb import _core

from .recording import Run
from .tf_definition import STATE

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    import numpy as np
    import numpy.typing as npt

    from .containers import Source
    from .open_recordings import OpenRecordings
    from .rewriter import Rewriter

    Integers: TypeAlias = npt.NDArray[np.int64]
    Columns: TypeAlias = tuple[Integers, Integers, npt.NDArray[np.float64], Integers, Integers]


@dataclass(frozen=True)
class RecordedArrivals:
    """The recorded transforms that a store keeps, with their receive times.

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
        Receive time of the last message, nanoseconds; 0 without messages.
    rewriter
        The rewriter that selected the transforms.
    """

    edges: Sequence[tuple[str, Columns, bytes]]
    names: list[str]
    conflicts: Mapping[tuple[str, bool], int]
    mixed: tuple[str, ...]
    publishers_known: bool
    end: int
    rewriter: Rewriter


def publisher_of(source: Source) -> str:
    """Return the name of the node; empty if the container does not name it."""
    return source.authority if source.authority != source.topic else ""


class ArrivalReader:
    """Collects transforms while the recordings are read for another purpose. Threads: one.

    Parameters
    ----------
    publisher
        Returns the publisher of a source.
    """

    def __init__(self, publisher: Callable[[Source], str] = publisher_of) -> None:
        self._publisher = publisher
        self.found: RecordedArrivals | None = None
        """The collected transforms, once they are complete."""

    def begin(self, recordings: OpenRecordings, rewriter: Rewriter) -> None:
        """Start again with recordings and their rewriter."""
        self._recordings, self._rewriter = recordings, rewriter
        later = (each for each in recordings.files[1:] if STATE in {t.name for t in each.topics})
        self._states = {id(source): each.start for each in later for source in each.all_sources}
        self._begin(with_store=False)

    def _begin(self, *, with_store: bool) -> None:
        self._log = _core.ArrivalLog(with_store=with_store)
        self._chosen, self._end = self._rewriter.again(), 0
        self._log.hold(self._chosen.fixed_joints())

    def take(self, run: Run) -> None:
        """Add the messages of a run, except those that a split recording repeats."""
        first, state = run.first, self._states.get(id(run.source))
        while first < run.last and run.messages[first][0] == state:
            first += 1
        if first == run.last:
            return
        run = Run(run.messages, first, run.last, run.sources)
        kind = self._recordings.choice.kind(run.source)
        publishers = {id_: self._publisher(each) for id_, each in run.sources.items()}
        self._chosen.log(run, self._log, *kind, publishers=publishers)
        self._end = max(self._end, run.end)

    def end(self) -> None:
        """Complete `found`. If only a store can decide what it keeps, everything is read again."""
        if not self._log.is_right:
            self._begin(with_store=True)
            for run in self._recordings.read():
                self.take(run)
        log, sources = self._log, self._recordings.sources
        names, conflicts, mixed = log.names(), log.conflicts(), tuple(log.mixed())
        known = any(publisher_of(source) for source in sources if source.messages)
        self.found = RecordedArrivals(
            log.take(), names, conflicts, mixed, known, self._end, self._chosen
        )

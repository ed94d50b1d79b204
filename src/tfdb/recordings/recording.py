"""Open recordings: ROS 1 bags, ROS 2 databases and bag folders, MCAP files; trajectory files.

lz4, zstd and YAML are imported on first use.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from tfdb.data.closable import Closable
from tfdb.data.errors import RecordingError
from tfdb.data.path_checks import check_path

from .bag_folder import open_folder
from .bag_reader import open_bag
from .containers import Source, Topic, kind_of
from .db3_reader import open_db3
from .mcap_reader import open_mcap
from .packed_file import open_packed
from .trajectory_file import open_trajectory

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator, Mapping
    from pathlib import Path

    from tfdb._core import Recorded
    from tfdb.data.decimal_time import Unit
    from tfdb.data.loss import Loss
    from tfdb.trajectories.reading_report import TrajectoryRows

    PathLike: TypeAlias = str | os.PathLike[str]

# Long enough for fast storing, short enough for progress and Ctrl-C.
MAX_RUN = 4096


@dataclass
class Run:
    """Consecutive messages that are stored alike: [first, last) of `messages`.

    `sources` are indexed by the numbers in `messages`; `start` and `end` are the receive times (ns)
    of the first and the last.
    """

    messages: Recorded
    first: int
    last: int
    sources: Mapping[int, Source]

    @property
    def source(self) -> Source:
        """Source of the first message."""
        return self.sources[self.messages[self.first][1]]

    @property
    def authorities(self) -> dict[int, str]:
        """Authority of each source, by its number."""
        return {number: source.authority for number, source in self.sources.items()}

    @property
    def start(self) -> int:
        """Receive time of the first message, nanoseconds."""
        return self.messages[self.first][0]

    @property
    def end(self) -> int:
        """Receive time of the last message, nanoseconds."""
        return self.messages[self.last - 1][0]


class Recording(Closable):
    """One open recording: a file or a ROS 2 bag folder. Not for several threads at once.

    Parameters
    ----------
    path
        A ROS 1 `.bag` (also compressed), a ROS 2 `.db3`, an `.mcap`, one of these packed with zstd,
        or a ROS 2 bag folder; the first bytes decide. Or a trajectory: `.tum`, `.txt`, `.csv`,
        `.npz` or `.parquet`.
    salvage
        Read damaged, cut and unindexed files as far as possible; `losses` lists the losses. Rows of
        trajectories are sorted, mended and skipped as by `Trajectory.read`; `rows` counts them.
    stamp_unit
        The unit of stamps in the text of a trajectory; see `Trajectory.read`.

    Raises
    ------
    RecordingError
        The file is not a recording, is damaged or cut short, or a library is not installed. Fields:
        path, reason.
    TrajectoryError
        A file with the extension of a trajectory holds none.
    InvalidArgument
        The path is empty or not a path.
    OSError
        The file cannot be opened or read.
    """

    def __init__(
        self, path: PathLike, *, salvage: bool = False, stamp_unit: Unit | None = None
    ) -> None:
        self.path: Path = check_path(path, RecordingError)
        kind = kind_of(self.path, salvage=salvage)
        if kind == "trajectory":
            self._container = open_trajectory(self.path, salvage=salvage, stamp_unit=stamp_unit)
        else:
            self._container = _OPENERS[kind](self.path, salvage=salvage)

    @property
    def topics(self) -> tuple[Topic, ...]:
        """All topics, with their types and numbers of messages."""
        return self._container.topics

    @property
    def sources(self) -> tuple[Source, ...]:
        """The streams of transforms: topic, encoding, publisher, number of messages."""
        return tuple(filter(_is_tf, self._container.sources))

    @property
    def all_sources(self) -> tuple[Source, ...]:
        """All streams that can be read: transforms, poses and joint states."""
        return self._container.sources

    @property
    def start(self) -> int:
        """Receive time of the first message, nanoseconds; 2**63 - 1 without messages."""
        return self._container.start

    @property
    def store(self) -> str:
        """Id of the store that a tfdb.Recorder recorded; empty for other files."""
        return self._container.store

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on how unfinished or renamed files were read."""
        return tuple(f"{self.path}: {note}" for note in self._container.notes)

    @property
    def losses(self) -> tuple[Loss, ...]:
        """Losses of a salvaged file; empty without `salvage`."""
        return self._container.losses

    @property
    def rows(self) -> TrajectoryRows | None:
        """Counts of the rows of a trajectory file; None for other recordings."""
        return self._container.rows

    def messages(
        self, wanted: Callable[[Source], bool] | None = None, since: int = 0
    ) -> Iterator[tuple[Source, int, bytes]]:
        """Yield source, receive time (ns) and bytes of each TFMessage, sorted by receive time.

        `wanted` selects sources; None: those of transforms. `since` is the earliest receive time;
        with an index, earlier chunks are skipped. Raises `RecordingError` if the file is damaged,
        possibly after some messages.
        """
        return self._container.messages(wanted or _is_tf, since)

    def read(
        self,
        wanted: Callable[[Source], bool] | None = None,
        kind: Callable[[Source], object] | None = None,
        step: Callable[[int], None] | None = None,
    ) -> Iterator[Run]:
        """Return all messages in runs. Raises `RecordingError` before the first run at damage.

        The runs are read lazily: keep the recording open and the file unchanged. A run ends where
        `kind` of the source changes (by default its topic), and between transforms and other
        messages. `step` is called with the number of messages since the last call.
        """
        wanted, kind = wanted or _is_tf, kind or _topic
        parts = self._container.read(wanted, step or _ignore)
        return (run for part in parts for run in runs_of(*part, wanted, kind))

    def close(self) -> None:
        """Close the file."""
        self._container.close()


def runs_of(
    messages: Recorded,
    sources: Mapping[int, Source],
    wanted: Callable[[Source], bool],
    kind: Callable[[Source], object],
) -> Iterator[Run]:
    """Divide messages into the runs of `Recording.read`."""
    numbers: dict[object, int] = {}
    kinds = {
        id_: numbers.setdefault((source.is_tf, kind(source)), len(numbers))
        for id_, source in sources.items()
        if wanted(source)
    }
    for first, last in messages.runs(kinds, MAX_RUN):
        yield Run(messages, first, last, sources)


def _is_tf(source: Source) -> bool:
    return source.is_tf


def _topic(source: Source) -> str:
    return source.topic


def _ignore(_: int) -> None:
    """Count nothing."""


_OPENERS = {
    "bag": open_bag,
    "db3": open_db3,
    "mcap": open_mcap,
    "packed": open_packed,
    "folder": open_folder,
}

"""Open recordings: ROS 1 bags, ROS 2 databases and bag folders, MCAP files.

Kept libraries read the containers (`pip install 'tfdb[recordings]'`); the payloads stay bytes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from tfdb.errors import RecordingError

from . import mcap_reader, rosbags_reader
from .containers import Source, Topic, kind_of

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Iterator
    from typing import Self

    from .containers import Container, Kind

    PathLike: TypeAlias = str | os.PathLike[str]
    Opener: TypeAlias = Callable[[Path], Container]

# Long enough to store fast, short enough that progress and Ctrl-C come through.
MAX_RUN = 4096


@dataclass
class Run:
    """Messages that follow each other and are stored alike, each with its source.

    `start` and `end` are the times of reception (ns) of the first and the last.
    """

    messages: list[bytes]
    sources: list[Source]
    start: int
    end: int


class Recording:
    """One open recording: a file or a ROS 2 bag folder. Not for several threads at once.

    Parameters
    ----------
    path
        A ROS 1 `.bag` (also compressed), a ROS 2 `.db3`, an `.mcap`, or a ROS 2 bag folder. What it
        is, its first bytes tell.

    Raises
    ------
    RecordingError
        No recording, damaged, cut short, or the libraries are not installed. Fields: path, reason.
    OSError
        The file cannot be opened.
    """

    def __init__(self, path: PathLike) -> None:
        self.path = Path(path)
        self._openers = list(_OPENERS[kind_of(self.path)])
        self._container = self._open(None)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def topics(self) -> tuple[Topic, ...]:
        """All topics, with their types and numbers of messages."""
        return self._container.topics

    @property
    def sources(self) -> tuple[Source, ...]:
        """The streams of transforms: topic, encoding, who published, number of messages."""
        return self._container.sources

    @property
    def start(self) -> int:
        """When the first message was received, nanoseconds; 2**63 - 1 without messages."""
        return self._container.start

    def messages(
        self, wanted: Callable[[Source], bool] | None = None
    ) -> Iterator[tuple[Source, int, bytes]]:
        """Source, time of reception (ns) and raw bytes of each TFMessage, in order of reception.

        `wanted` chooses the sources, None takes all. Raises `RecordingError` where the file is
        damaged, which may be after some messages.
        """
        return self._container.messages(wanted or _all)

    def read(
        self,
        wanted: Callable[[Source], bool] | None = None,
        kind: Callable[[Source], object] | None = None,
        step: Callable[[int], None] | None = None,
    ) -> list[Run]:
        """All messages at once, or none: `RecordingError` where the file is damaged.

        Reads with the next library where the first one fails. A run ends where `kind` of the source
        changes; by default, that is its topic. `step` is called with the number of messages since
        the last call.
        """
        while True:
            try:
                return _runs(self.messages(wanted), kind or _topic, step)
            except RecordingError as error:
                self._container.close()
                self._container = self._open(error)

    def close(self) -> None:
        """Close the file."""
        self._container.close()

    def _open(self, failed: RecordingError | None) -> Container:
        """The container by the next opener that takes it; raises when none is left."""
        errors = [] if failed is None else [failed]
        while self._openers:
            opener = self._openers.pop(0)
            try:
                return opener(self.path)
            except RecordingError as error:
                errors.append(error)
        if len({error.reason for error in errors}) == 1:
            raise errors[0]
        first, second = errors
        raise RecordingError(self.path, f"{first.reason}; or: {second.reason}") from first


def _all(_: Source) -> bool:
    return True


def _topic(source: Source) -> str:
    return source.topic


def _runs(
    messages: Iterable[tuple[Source, int, bytes]],
    kind: Callable[[Source], object],
    step: Callable[[int], None] | None,
) -> list[Run]:
    # Containers give the same object for the same source: identity is enough, and faster.
    kinds: dict[int, object] = {}
    runs: list[Run] = []
    current: Source | None = None
    current_kind: object = None
    room = 0
    for source, received, data in messages:
        if source is not current or not room:
            if id(source) not in kinds:
                kinds[id(source)] = kind(source)
            if not room or kinds[id(source)] != current_kind:
                if step is not None and runs:
                    step(len(runs[-1].messages))
                run = Run([], [], received, received)
                runs.append(run)
                room = MAX_RUN
            current, current_kind = source, kinds[id(source)]
        run.messages.append(data)
        run.sources.append(source)
        run.end = received
        room -= 1
    if step is not None and runs:
        step(len(runs[-1].messages))
    return runs


class _Files:
    """Several files as one container, one after the other by their start."""

    def __init__(self, paths: Iterable[Path]) -> None:
        self._files: list[Recording] = []
        try:
            for path in paths:
                self._files.append(Recording(path))
        except BaseException:
            self.close()
            raise
        self._files.sort(key=lambda file: file.start)
        self.start = self._files[0].start
        self.topics = tuple(topic for file in self._files for topic in file.topics)
        self.sources = tuple(source for file in self._files for source in file.sources)

    def messages(self, wanted: Callable[[Source], bool]) -> Iterator[tuple[Source, int, bytes]]:
        """See `Container.messages`."""
        for file in self._files:
            yield from file.messages(wanted)

    def close(self) -> None:
        """Close the files."""
        for file in self._files:
            file.close()


def _open_folder(folder: Path) -> Container:
    """A ROS 2 bag folder as its metadata says; its MCAP files with the faster reader."""
    files = rosbags_reader.mcap_files(folder) if any(folder.glob("*.mcap")) else []
    return _Files(files) if files else rosbags_reader.open_ros2(folder)


def _open_files_of(folder: Path) -> Container:
    """The files of a folder whose metadata is missing or does not fit them."""
    paths = sorted((*folder.glob("*.db3"), *folder.glob("*.mcap")))
    if not paths:
        raise RecordingError(folder, "a folder with neither .db3 nor .mcap files in it")
    return _Files(paths)


_OPENERS: dict[Kind, tuple[Opener, ...]] = {
    "bag": (rosbags_reader.open_bag,),
    "db3": (rosbags_reader.open_ros2,),
    "mcap": (mcap_reader.open_mcap, rosbags_reader.open_ros2),
    "folder": (_open_folder, _open_files_of),
}

"""ROS 1 bags, ROS 2 databases, bag folders and MCAP files through PyPI's `rosbags`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from tfdb.errors import RecordingError

from .bag_chunks import indexed_messages
from .containers import Source, Topic, check_count, encoding_of, is_tf_type, typed_errors

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator

    from .containers import Container


def open_bag(path: Path) -> Container:
    """Open a ROS 1 bag; raises `RecordingError`."""
    with typed_errors(path, "; `rosbag reindex` may save the rest"):
        from rosbags.rosbag1 import Reader  # noqa: PLC0415 - an extra, and slow to import

        reader = Reader(path)
        reader.open()
    return _BagContainer(path, reader)


def mcap_files(folder: Path) -> list[Path]:
    """The MCAP files of a bag folder that are not compressed as a whole or message by message.

    Empty for other folders. Raises `RecordingError` where the metadata is bad or a file is missing.
    """
    with typed_errors(folder):
        from rosbags.rosbag2 import Reader  # noqa: PLC0415 - an extra, and slow to import

        with Reader(folder) as reader:
            if reader.compression_mode:
                return []
            storage: Any = reader.storage
            paths = [Path(file.path) for file in storage.storages]
            return paths if all(path.suffix == ".mcap" for path in paths) else []


def open_ros2(path: Path) -> Container:
    """Open a `.db3` or `.mcap` file or a bag folder; raises `RecordingError`."""
    log = path.with_name(path.name + "-wal")
    if log.is_file() and log.stat().st_size:
        raise RecordingError(
            path,
            f"the recorder did not finish and left messages in {log.name}: merge them with "
            f"`sqlite3 {path.name} 'PRAGMA wal_checkpoint'`",
        )
    with typed_errors(path):
        from rosbags.rosbag2 import Reader  # noqa: PLC0415 - an extra, and slow to import

        reader = Reader(path)
        reader.open()
    return _RosbagsContainer(path, reader)


class _RosbagsContainer:
    """A `Container` over either of the readers of rosbags, which look alike."""

    def __init__(self, path: Path, reader: Any) -> None:
        self._path = path
        self._reader: Any = reader
        self.start: int = reader.start_time
        connections = reader.connections
        counts: dict[tuple[str, str], int] = {}
        for connection in connections:
            key = (connection.topic, connection.msgtype)
            counts[key] = counts.get(key, 0) + connection.msgcount
        self.topics = tuple(Topic(name, kind, count) for (name, kind), count in counts.items())
        tf_connections = [each for each in connections if is_tf_type(each.msgtype)]
        self._sources = {each.id: self._source(each) for each in tf_connections}
        self.sources = tuple(self._sources.values())

    def _source(self, connection: Any) -> Source:
        # Connections of ROS 1 have a caller, those of ROS 2 a serialization format.
        name = getattr(connection.ext, "serialization_format", "ros1")
        return Source(
            topic=connection.topic,
            encoding=encoding_of(self._path, connection.topic, name),
            authority=getattr(connection.ext, "callerid", None) or connection.topic,
            messages=connection.msgcount,
        )

    def messages(self, wanted: Callable[[Source], bool]) -> Iterator[tuple[Source, int, bytes]]:
        """See `Container.messages`."""
        sources = {id_: source for id_, source in self._sources.items() if wanted(source)}
        found = dict.fromkeys(sources, 0)
        with typed_errors(self._path):
            for id_, received, data in self._payloads(sources):
                found[id_] += 1
                yield sources[id_], received, data
        for id_, source in sources.items():
            check_count(self._path, source, found[id_])

    def _payloads(self, ids: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        connections = [each for each in self._reader.connections if each.id in ids]
        if connections:
            for connection, received, data in self._reader.messages(connections=connections):
                yield connection.id, received, data

    def close(self) -> None:
        """Close the file; again is fine."""
        reader, self._reader = self._reader, None
        if reader is not None:
            reader.close()


class _BagContainer(_RosbagsContainer):
    """The same for ROS 1 bags, whose chunks are taken apart here."""

    def _payloads(self, ids: Collection[int]) -> Iterator[tuple[int, int, bytes]]:
        return indexed_messages(self._reader, ids)

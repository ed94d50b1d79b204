"""MCAP files through PyPI's `mcap`, for those that rosbags does not read.

Slower, but it takes any profile (ROS 1 messages, files of Foxglove's tools), channels of other
schemas beside the transforms, chunks without message indexes, and messages that are out of order
and have no index.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, BinaryIO

from .containers import Source, Topic, check_count, encoding_of, is_tf_type, typed_errors

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from .containers import Container


def open_mcap(path: Path) -> Container:
    """Open an MCAP file; raises `RecordingError`."""
    file = path.open("rb")
    try:
        return _McapContainer(path, file)
    except BaseException:
        file.close()
        raise


class _McapContainer:
    """A `Container` over the reader of mcap."""

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self._path = path
        self._file = file
        with typed_errors(path):
            from mcap.reader import make_reader  # noqa: PLC0415 - an extra

            self._reader = make_reader(file, validate_crcs=True)
            channels, counts, self.start = self._survey()
        named = [(channel, schema.name if schema else "") for channel, schema in channels.values()]
        self.topics = tuple(
            Topic(channel.topic, name, counts.get(channel.id, 0)) for channel, name in named
        )
        self._sources = {
            channel.id: Source(
                topic=channel.topic,
                encoding=encoding_of(path, channel.topic, channel.message_encoding),
                authority=channel.topic,
                messages=counts.get(channel.id, 0),
            )
            for channel, name in named
            if is_tf_type(name)
        }
        self.sources = tuple(self._sources.values())

    def _survey(self) -> tuple[dict[int, tuple[Any, Any]], dict[int, int], int]:
        """Channels with schemas, messages by channel, and the start: by summary or by reading."""
        summary = self._reader.get_summary()
        if summary is not None and summary.statistics is not None and summary.channels:
            statistics = summary.statistics
            channels = {
                id_: (channel, summary.schemas.get(channel.schema_id))
                for id_, channel in summary.channels.items()
            }
            start = statistics.message_start_time if statistics.message_count else 2**63 - 1
            return channels, statistics.channel_message_counts, start
        channels, start = {}, 2**63 - 1
        counts: dict[int, int] = {}
        for schema, channel, message in self._reader.iter_messages(log_time_order=False):
            channels[channel.id] = (channel, schema)
            counts[channel.id] = counts.get(channel.id, 0) + 1
            start = min(start, message.log_time)
        return channels, counts, start

    def messages(self, wanted: Callable[[Source], bool]) -> Iterator[tuple[Source, int, bytes]]:
        """See `Container.messages`."""
        sources = {id_: source for id_, source in self._sources.items() if wanted(source)}
        found = dict.fromkeys(sources, 0)
        topics = {source.topic for source in sources.values()}
        if not topics:
            return
        with typed_errors(self._path):
            for _, channel, message in self._reader.iter_messages(topics=topics):
                source = sources.get(channel.id)
                if source is not None:
                    found[channel.id] += 1
                    yield source, message.log_time, message.data
        for id_, source in sources.items():
            check_count(self._path, source, found[id_])

    def close(self) -> None:
        """Close the file."""
        self._file.close()

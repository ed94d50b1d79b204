"""MCAP files through PyPI's `mcap`.

The library reads the summary and decompresses chunks; cutting these into messages is done here, ten
times as fast. Files without a usable summary are left to the library altogether.
"""

from __future__ import annotations

import struct
from bisect import bisect_left
from operator import itemgetter
from typing import TYPE_CHECKING, Any, BinaryIO

from .containers import Source, Topic, check_count, encoding_of, is_tf_type, typed_errors

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from collections.abc import Set as AbstractSet
    from pathlib import Path

    from .containers import Container

_MESSAGE = 0x05
# Opcode, length, channel, sequence, time of logging; the time of publishing and the data follow.
_RECORD = struct.Struct("<BQHIQ")
_HEAD, _DATA = 9, 31
_log_time = itemgetter(0)


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
        self._chunks: list[Any] = []
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
            self._chunks = summary.chunk_indexes
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
        with typed_errors(self._path):
            for received, id_, data in self._payloads(sources.keys()):
                found[id_] += 1
                yield sources[id_], received, data
        for id_, source in sources.items():
            check_count(self._path, source, found[id_])

    def _payloads(self, ids: AbstractSet[int]) -> Iterator[tuple[int, int, bytes]]:
        """Time, channel and payload of the channels' messages, by time."""
        if not self._chunks:
            topics = {self._sources[id_].topic for id_ in ids}
            for _, channel, message in self._reader.iter_messages(topics=topics):
                if channel.id in ids:
                    yield message.log_time, channel.id, message.data
            return
        chunks = sorted(
            (
                chunk
                for chunk in self._chunks
                # Without message indexes, what is in a chunk shows only when it is read.
                if not chunk.message_index_offsets
                or not ids.isdisjoint(chunk.message_index_offsets)
            ),
            key=lambda chunk: (chunk.message_start_time, chunk.chunk_start_offset),
        )
        nexts = [chunk.message_start_time for chunk in chunks[1:]]
        # Chunks may overlap in time: what may still be preceded waits for the next chunk.
        pending: list[tuple[int, int, bytes]] = []
        for chunk, end in zip(chunks, [*nexts, None], strict=True):
            pending += self._messages_in(chunk, ids)
            pending.sort(key=_log_time)
            cut = len(pending) if end is None else bisect_left(pending, end, key=_log_time)
            yield from pending[:cut]
            del pending[:cut]

    def _messages_in(self, index: Any, ids: AbstractSet[int]) -> Iterator[tuple[int, int, bytes]]:
        """The same of one chunk, in the order in which they lie there."""
        from mcap.data_stream import ReadDataStream  # noqa: PLC0415 - an extra
        from mcap.records import Chunk  # noqa: PLC0415
        from mcap.stream_reader import get_chunk_data_stream  # noqa: PLC0415

        self._file.seek(index.chunk_start_offset + _HEAD)
        chunk = Chunk.read(ReadDataStream(self._file))
        stream, size = get_chunk_data_stream(chunk, validate_crc=True)
        if size != chunk.uncompressed_size:
            raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes ends after {size}")
        # Records shorter than a message's head may come last.
        data = stream.read(size) + bytes(_RECORD.size)
        at = 0
        while at < size:
            kind, length, channel, _, log_time = _RECORD.unpack_from(data, at)
            end = at + _HEAD + length
            if end > size:
                raise ValueError(f"a record of {length} bytes goes beyond its chunk")
            if kind == _MESSAGE and channel in ids:
                yield log_time, channel, data[at + _DATA : end]
            at = end

    def close(self) -> None:
        """Close the file."""
        self._file.close()

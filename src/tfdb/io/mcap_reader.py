"""MCAP files (https://mcap.dev/spec).

With the summary at the end of the file only those chunks are read that hold what is wanted. Files
without one, and damaged ones (`salvage`), are walked from their beginning.
"""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_right
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tfdb._core import Recorded
from tfdb.errors import RecordingError

from .containers import (
    NO_START,
    SALVAGE,
    Container,
    Gathered,
    Source,
    Topic,
    encoding_of,
    in_order,
    is_tf_type,
    typed_errors,
    with_next,
)
from .raw_file import BadDataError, BrokenChunkError, RawFile, unpack, unpack_the_start

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator
    from pathlib import Path

    from .containers import Payload

_MAGIC = b"\x89MCAP0\r\n"
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX, _CHUNK_INDEX = range(1, 9)
_STATISTICS, _DATA_END = 0x0B, 0x0F
# Opcode and length.
_RECORD = struct.Struct("<BQ")
_HEAD = 9
_FOOTER_SIZE = _HEAD + 20 + len(_MAGIC)
_CHUNK_HEAD = struct.Struct("<QQQI")
_PAIR = struct.Struct("<HQ")


@dataclass(frozen=True)
class _Channel:
    """One stream of messages."""

    schema: int
    topic: str
    encoding: str


@dataclass(frozen=True)
class _Chunk:
    """Where a chunk lies, and which channels it holds; none named: any."""

    position: int
    start: int
    channels: frozenset[int]


@dataclass
class _Index:
    """What the file says of its messages: their streams, where they lie, how many there are."""

    schemas: dict[int, str] = field(default_factory=dict)
    channels: dict[int, _Channel] = field(default_factory=dict)
    chunks: list[_Chunk] = field(default_factory=list)
    counts: dict[int, int] | None = None
    chunk_count: int = 0
    start: int = NO_START

    def learn(self, kind: int, data: bytes) -> None:
        """Take in a schema, channel, chunk index or statistics record."""
        fields = _Fields(data)
        if kind == _SCHEMA:
            id_ = fields.number(2)
            self.schemas[id_] = fields.text()
        elif kind == _CHANNEL:
            id_ = fields.number(2)
            self.channels[id_] = _Channel(fields.number(2), fields.text(), fields.text())
        elif kind == _CHUNK_INDEX:
            start, _, position = fields.number(8), fields.number(8), fields.number(8)
            fields.number(8)
            self.chunks.append(_Chunk(position, start, frozenset(fields.pairs())))
        elif kind == _STATISTICS:
            count = fields.number(8)
            fields.skip(2 + 4 + 4 + 4)
            self.chunk_count, start = fields.number(4), fields.number(8)
            fields.number(8)
            self.counts, self.start = fields.pairs(), start if count else NO_START

    def is_tf(self, channel: int) -> bool:
        return channel in self.channels and is_tf_type(self.type_of(channel))

    def type_of(self, channel: int) -> str:
        return self.schemas.get(self.channels[channel].schema, "")


class _Fields:
    """Takes the fields of a record one after the other."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def number(self, width: int) -> int:
        return int.from_bytes(self._take(width), "little")

    def text(self) -> str:
        return self._take(self.number(4)).decode()

    def pairs(self) -> dict[int, int]:
        """A map from ids to numbers."""
        data = self._take(self.number(4))
        return dict(_PAIR.iter_unpack(data))

    def skip(self, width: int) -> None:
        self._take(width)

    def _take(self, width: int) -> bytes:
        taken = self._data[self._at : self._at + width]
        if len(taken) != width:
            raise BadDataError(f"a record of {len(self._data)} bytes ends within a field")
        self._at += width
        return taken


def open_mcap(path: Path, *, salvage: bool = False) -> Container:
    """Open an MCAP file; raises `RecordingError`."""
    file = RawFile(path)
    try:
        with typed_errors(path):
            return _salvaged(path, file) if salvage else _whole(path, file)
    except BaseException:
        file.close()
        raise


def _whole(path: Path, file: RawFile) -> Container:
    if not _has_end(file):
        reason = f"cut short, its end is missing: `mcap recover` saves the rest; {SALVAGE}"
        raise RecordingError(path, reason)
    index = _read_summary(file)
    listed = index.counts is not None and index.channels and index.chunks
    if listed and len(index.chunks) == index.chunk_count:
        return _indexed(path, file, index)
    walked = _walked(path, file, index, _gather(file, index, [], strict=True))
    if walked.losses:
        raise BadDataError(walked.losses[0].reason)
    return walked


def _has_end(file: RawFile) -> bool:
    return file.read(file.size - len(_MAGIC), len(_MAGIC)) == _MAGIC


def _indexed(path: Path, file: RawFile, index: _Index) -> Container:
    def chunks(ids: Collection[int]) -> list[tuple[int, int]]:
        # Without message indexes, what is in a chunk shows only when it is read.
        wanted = [c for c in index.chunks if not c.channels or not c.channels.isdisjoint(ids)]
        return [(each.start, each.position) for each in wanted]

    def payloads(ids: Collection[int]) -> Iterator[Payload]:
        return in_order(chunks(ids), lambda at: _messages_in(_raw(file, at), ids.__contains__))

    def recorded(ids: Collection[int], step: Callable[[int], None]) -> Recorded:
        found = Recorded()
        for at, end in with_next(chunks(ids)):
            before = len(found)
            _add_chunk(found, _raw(file, at), ids.__contains__, _nothing)
            found.settle(end)
            step(len(found) - before)
        return found

    counts = index.counts or {}
    return Container(
        path,
        _topics(index, counts),
        _sources(path, index, counts),
        index.start,
        payloads,
        file.close,
        recorded=recorded,
    )


def _salvaged(path: Path, file: RawFile) -> Container:
    try:
        index = _read_summary(file) if _has_end(file) else _Index()
    except (BadDataError, struct.error, UnicodeDecodeError):
        index = _Index()
    gathered = _gather(file, index, [chunk.position for chunk in index.chunks])
    if not _has_end(file) and not gathered.reasons:
        gathered.lose(0, "cut short, its end is missing")
    return _walked(path, file, index, gathered)


def _walked(path: Path, file: RawFile, index: _Index, gathered: Gathered) -> Container:
    for id_, count in (index.counts or {}).items():
        gathered.promised[id_] = max(gathered.promised[id_], count)
    counts = gathered.found()
    sources = _sources(path, index, counts)
    start = min((at for at, _, _ in gathered.messages), default=NO_START)
    return Container(
        path,
        _topics(index, counts),
        sources,
        start,
        gathered.payloads,
        file.close,
        gathered.losses(path, sources),
    )


def _sources(path: Path, index: _Index, counts: dict[int, int]) -> dict[int, Source]:
    return {
        id_: Source(
            channel.topic,
            encoding_of(path, channel.topic, channel.encoding),
            channel.topic,
            counts.get(id_, 0),
        )
        for id_, channel in index.channels.items()
        if index.is_tf(id_)
    }


def _topics(index: _Index, counts: dict[int, int]) -> Iterator[Topic]:
    return (
        Topic(channel.topic, index.type_of(id_), counts.get(id_, 0))
        for id_, channel in index.channels.items()
    )


# -- the top of the file --------------------------------------------------------------------------


def _read_summary(file: RawFile) -> _Index:
    """The summary; an empty one where the file has none."""
    end = file.size - _FOOTER_SIZE
    footer = _Fields(file.read(end, _FOOTER_SIZE))
    if (footer.number(1), footer.number(8)) != (_FOOTER, 20):
        raise BadDataError("no footer at its end")
    index = _Index()
    at = footer.number(8)
    while 0 < at < end:
        kind, size = _RECORD.unpack(file.read(at, _HEAD))
        if kind in (_SCHEMA, _CHANNEL, _CHUNK_INDEX, _STATISTICS):
            index.learn(kind, file.read(at + _HEAD, size))
        at += _HEAD + size
    if at > end:
        raise BadDataError("its summary goes beyond its end")
    if len({chunk.position for chunk in index.chunks}) != len(index.chunks):
        raise BadDataError("its summary names the same chunk twice")
    return index


def _raw(file: RawFile, position: int) -> bytes | memoryview:
    """The records of the chunk there, unpacked and checked."""
    kind, size = _RECORD.unpack(file.read(position, _HEAD))
    if kind != _CHUNK:
        raise BadDataError(f"no chunk at {position}, where the summary has one")
    packing, packed, unpacked, crc = _chunk(file.read(position + _HEAD, size))
    return _checked(unpack(packing, packed, unpacked), crc)


def _chunk(record: bytes, *, cut: bool = False) -> tuple[str, memoryview, int, int]:
    """Packing, packed records, their unpacked size and checksum."""
    _, _, unpacked, crc = _CHUNK_HEAD.unpack_from(record)
    fields = _Fields(record)
    fields.skip(_CHUNK_HEAD.size)
    packing = fields.text()
    size = fields.number(8)
    start = _CHUNK_HEAD.size + 4 + len(packing.encode()) + 8
    packed = memoryview(record)[start : start + size]
    if len(packed) != size and not cut:
        raise BadDataError("a chunk that ends within its records")
    return packing, packed, unpacked, crc


def _checked(raw: bytes | memoryview, crc: int) -> bytes | memoryview:
    if crc and zlib.crc32(raw) != crc:
        raise BadDataError("a chunk whose checksum is wrong")
    return raw


def _gather(file: RawFile, index: _Index, chunks: list[int], *, strict: bool = False) -> Gathered:
    """Walk over the records of the file; where they break off, go on with the next known chunk.

    Adds the schemas and channels that it finds to `index`. With `strict`, raises instead.
    """
    found = Gathered()
    starts = sorted(chunks)
    at = len(_MAGIC)
    while at < file.size:
        try:
            kind, size = _RECORD.unpack(file.read(at, _HEAD))
            if kind in (_DATA_END, _FOOTER):
                break
            _gather_record(file, (kind, at, size), index, found, strict=strict)
            at += _HEAD + size
        except (BadDataError, struct.error, UnicodeDecodeError) as error:
            if strict:
                raise
            place = bisect_right(starts, at)
            following = starts[place] if place < len(starts) else file.size
            found.lose(following - at, error)
            at = following
    return found


def _gather_record(
    file: RawFile, record: tuple[int, int, int], index: _Index, found: Gathered, *, strict: bool
) -> None:
    kind, at, size = record
    there = min(size, file.size - at - _HEAD)
    if kind == _CHUNK and not strict:
        _gather_chunk(file.read(at + _HEAD, there), size, index, found)
    elif there < size or kind == 0:
        raise BadDataError(f"no whole record at {at}, where one of {size} bytes begins")
    elif kind == _CHUNK:
        packing, packed, unpacked, crc = _chunk(file.read(at + _HEAD, size))
        raw = _checked(unpack(packing, packed, unpacked), crc)
        found.messages += _messages_in(raw, index.is_tf, index.learn)
    elif kind in (_SCHEMA, _CHANNEL):
        index.learn(kind, file.read(at + _HEAD, size))
    elif kind == _MESSAGE_INDEX:
        fields = _Fields(file.read(at + _HEAD, size))
        found.promised[fields.number(2)] += fields.number(4) // 16
    elif kind == _MESSAGE:
        raw = file.read(at, _HEAD + size)
        found.messages += _messages_in(raw, index.is_tf, index.learn)


def _gather_chunk(record: bytes, size: int, index: _Index, found: Gathered) -> None:
    """Take what can be had of a chunk that may be cut or damaged."""
    packing, packed, unpacked, crc = _chunk(record, cut=True)
    reason: Exception | None = None
    try:
        raw = unpack(packing, packed, unpacked)
        _checked(raw, crc)
    except BadDataError as error:
        raw, reason = unpack_the_start(packing, packed, unpacked), error
        if len(raw) == unpacked:
            raise  # nobody knows which of its bytes are wrong
    if len(record) < size:
        reason = BadDataError(f"cut short in the middle of a chunk of {size} bytes")
    read = found.take(_messages_in(raw, index.is_tf, index.learn), len(raw))
    if reason is not None or read < len(raw):
        found.lose(unpacked - read, reason or f"a chunk breaks off at {read}")


# -- inside of a chunk ----------------------------------------------------------------------------


def _nothing(_kind: int, _data: bytes) -> None:
    """Learn nothing."""


def _add_chunk(
    found: Recorded,
    raw: bytes | memoryview,
    wanted: Callable[[int], bool],
    learn: Callable[[int, bytes], None],
) -> None:
    """Add the messages of a chunk that are wanted; other records are learned."""
    broken = found.add_mcap_chunk(raw, wanted, learn)
    if broken is not None:
        at, length = broken
        raise BrokenChunkError(f"a record of {length} bytes goes beyond its chunk", at)


def _messages_in(
    raw: bytes | memoryview,
    wanted: Callable[[int], bool],
    learn: Callable[[int, bytes], None] = _nothing,
) -> Iterator[Payload]:
    """The messages of a chunk that are wanted, as they lie there; other records are learned."""
    found = Recorded()
    try:
        _add_chunk(found, raw, wanted, learn)
    except Exception:
        yield from map(found.__getitem__, range(len(found)))
        raise
    yield from map(found.__getitem__, range(len(found)))

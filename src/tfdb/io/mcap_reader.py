"""MCAP files (https://mcap.dev/spec).

With the summary at the end of the file only those chunks are read that hold what is wanted. Files
without one, or whose summary does not name all schemas, channels and chunks, are walked from their
beginning, and so are damaged ones (`salvage`).

Damage is also what the format forbids: checksums that are wrong (zero: there is none), messages
shorter than their head, messages of channels that neither the summary nor anything before them
declares, or whose schema nothing declares, and channels and schemas that are declared again as
something else. `salvage` leaves such messages out, believes the first declaration, and reports it.
"""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass, field
from itertools import accumulate, repeat
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
)
from .raw_file import BadDataError, BrokenChunkError, RawFile, unpack, unpack_the_start

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
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
_PIECE = 2**20
# So many messages are worth the handling of a part of the file.
_PART = 256
_LATEST = 2**64 - 1


@dataclass(frozen=True)
class _Channel:
    """One stream of messages."""

    schema: int
    topic: str
    encoding: str


@dataclass(frozen=True)
class _Chunk:
    """Where a chunk lies, when it starts, and which channels it holds; none named: any."""

    position: int
    start: int
    channels: frozenset[int]


@dataclass
class _Index:
    """What the file says of its messages: their streams, where they lie, how many there are.

    `flaws` are what contradicts the format in well-formed records, with the bytes lost by each.
    """

    schemas: dict[int, str] = field(default_factory=dict)
    channels: dict[int, _Channel] = field(default_factory=dict)
    chunks: list[_Chunk] = field(default_factory=list)
    counts: dict[int, int] | None = None
    chunk_count: int = 0
    start: int = NO_START
    flaws: Counter[str] = field(default_factory=Counter)

    def learn(self, kind: int, data: bytes) -> None:
        """Take in a schema, channel, chunk index or statistics record, or what is no message."""
        fields = _Fields(data)
        if kind == _SCHEMA:
            id_, name = fields.number(2), fields.text()
            if self.schemas.setdefault(id_, name) != name:
                self.flaws[f"schema {id_} is declared again as {name!r}"] += 0
        elif kind == _CHANNEL:
            id_ = fields.number(2)
            channel = _Channel(fields.number(2), fields.text(), fields.text())
            if self.channels.setdefault(id_, channel) != channel:
                self.flaws[f"channel {id_} is declared again, on {channel.topic!r}"] += 0
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
        elif kind == _MESSAGE:
            self.flaws[f"a message of {len(data)} bytes, too short for one"] += _HEAD + len(data)

    def is_whole(self) -> bool:
        """Whether the chunks can be read by it alone."""
        if not self.counts or not self.chunks or len(self.chunks) != self.chunk_count:
            return False
        named = set(self.counts).union(*(chunk.channels for chunk in self.chunks))
        return all(map(self.is_declared, named | self.channels.keys())) and not self.flaws

    def is_declared(self, channel: int) -> bool:
        """Whether channel and schema (0: none) are known; what is not is a flaw of messages."""
        known = self.channels.get(channel)
        return known is not None and (known.schema == 0 or known.schema in self.schemas)

    def is_tf(self, channel: int) -> bool:
        """Whether messages of a channel are of transforms; a flaw where nobody can know."""
        if not self.is_declared(channel):
            self.flaws[f"messages of channel {channel}, declared without a schema or nowhere"] += 0
            return False
        return is_tf_type(self.type_of(channel))

    def refuse_flaws(self) -> None:
        """Raise where there are any."""
        if self.flaws:
            raise BadDataError(next(iter(self.flaws)))

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
    index = _Index()
    _read_summary(file, index)
    if index.is_whole():
        return _indexed(path, file, index)
    gathered = Gathered()
    _gather(file, index, [], gathered, strict=True)
    walked = _walked(path, file, index, gathered)
    if walked.losses:
        raise BadDataError(walked.losses[0].reason)
    return walked


def _has_end(file: RawFile) -> bool:
    if file.size < len(_MAGIC) + _FOOTER_SIZE:
        return False
    return file.read(file.size - len(_MAGIC), len(_MAGIC)) == _MAGIC


def _indexed(path: Path, file: RawFile, index: _Index) -> Container:
    def chunks(ids: Collection[int]) -> list[_Chunk]:
        # Without message indexes, what is in a chunk shows only when it is read.
        wanted = [c for c in index.chunks if not c.channels or not c.channels.isdisjoint(ids)]
        return sorted(wanted, key=lambda each: each.position)

    def add(
        found: Recorded, chunk: _Chunk, ids: Collection[int], *, is_checked: bool = False
    ) -> None:
        raw = _raw(file, chunk, is_checked=is_checked)
        _add_chunk(found, raw, lambda id_: index.is_tf(id_) and id_ in ids, index.learn)
        index.refuse_flaws()

    def messages_of(chunk: _Chunk, ids: Collection[int]) -> Iterable[Payload]:
        found = Recorded()
        add(found, chunk, ids)
        return map(found.__getitem__, range(len(found)))

    def payloads(ids: Collection[int]) -> Iterator[Payload]:
        wanted = ((each.start, each) for each in chunks(ids))
        return in_order(wanted, lambda chunk: messages_of(chunk, ids))

    def survey(
        ids: Collection[int], step: Callable[[int], None]
    ) -> tuple[dict[int, int], Iterator[Recorded]]:
        counts: Counter[int] = Counter()
        spans = []
        for chunk in chunks(ids):
            found = Recorded()
            add(found, chunk, ids)
            if len(found):
                counts.update(found.counts())
                found.sort()
                spans.append(_Span(chunk, len(found), found[0][0], found[len(found) - 1][0]))
            step(len(found))
        return counts, map(recorded, _parts(spans), repeat(ids))

    def recorded(part: list[_Span], ids: Collection[int]) -> Recorded:
        found = Recorded()
        for span in part:
            add(found, span.chunk, ids, is_checked=True)
        if len(found) != sum(span.messages for span in part):
            raise BadDataError("its messages change while it is read")
        found.sort()
        return found

    counts = index.counts or {}
    return Container(
        path,
        _topics(index, counts),
        _sources(path, index, counts),
        index.start,
        payloads,
        file.close,
        survey=survey,
    )


@dataclass(frozen=True)
class _Span:
    """What a chunk holds of the wanted messages: how many, the times of the first and the last."""

    chunk: _Chunk
    messages: int
    first: int
    last: int


def _parts(spans: list[_Span]) -> Iterator[list[_Span]]:
    """Divide a file, in its order, so that no part holds what is older than a part before it."""
    firsts = [span.first for span in reversed(spans)]
    earliest = [*accumulate(firsts, min)][::-1]  # of each and of all behind it
    part: list[_Span] = []
    latest = messages = 0
    for span, following in zip(spans, [*earliest[1:], _LATEST], strict=True):
        part.append(span)
        latest, messages = max(latest, span.last), messages + span.messages
        if latest <= following and (messages >= _PART or span is spans[-1]):
            yield part
            part, messages = [], 0


def _salvaged(path: Path, file: RawFile) -> Container:
    summary = index = _Index()
    gathered = Gathered()
    try:
        if _has_end(file):
            _read_summary(file, summary)
    except (BadDataError, struct.error, UnicodeDecodeError) as error:
        gathered.lose(0, error)
        index = _Index()  # of a damaged summary only the places of chunks are tried
    _gather(file, index, [chunk.position for chunk in summary.chunks], gathered)
    if not _has_end(file) and not gathered.reasons:
        gathered.lose(0, "cut short, its end is missing")
    return _walked(path, file, index, gathered)


def _walked(path: Path, file: RawFile, index: _Index, gathered: Gathered) -> Container:
    for id_, count in (index.counts or {}).items():
        gathered.promised[id_] = max(gathered.promised[id_], count)
    for reason, lost in index.flaws.items():
        gathered.lose(lost, reason)
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


def _read_summary(file: RawFile, index: _Index) -> None:
    """Add what the summary says, if the file has one, to an empty index."""
    end = file.size - _FOOTER_SIZE
    footer = _Fields(file.read(end, _FOOTER_SIZE))
    if (footer.number(1), footer.number(8)) != (_FOOTER, 20):
        raise BadDataError("no footer at its end")
    start = at = footer.number(8)
    footer.skip(8)
    crc = footer.number(4)
    while 0 < at < end:
        kind, size = _RECORD.unpack(file.read(at, _HEAD))
        if kind in (_SCHEMA, _CHANNEL, _CHUNK_INDEX, _STATISTICS):
            index.learn(kind, file.read(at + _HEAD, size))
        at += _HEAD + size
    if at > end:
        raise BadDataError("its summary goes beyond its end")
    if len({chunk.position for chunk in index.chunks}) != len(index.chunks):
        raise BadDataError("its summary names the same chunk twice")
    if start and crc and crc != _crc(file, start, end + _HEAD + 16):
        raise BadDataError("a summary whose checksum is wrong")


def _crc(file: RawFile, at: int, end: int) -> int:
    """The checksum of a part of the file, of any size."""
    crc = 0
    for start in range(at, end, _PIECE):
        crc = zlib.crc32(file.read(start, min(_PIECE, end - start)), crc)
    return crc


def _raw(file: RawFile, chunk: _Chunk, *, is_checked: bool = False) -> bytes | memoryview:
    """The records of a chunk of the summary, unpacked and checked, once."""
    kind, size = _RECORD.unpack(file.read(chunk.position, _HEAD))
    if kind != _CHUNK:
        raise BadDataError(f"no chunk at {chunk.position}, where the summary has one")
    record = file.read(chunk.position + _HEAD, size)
    packing, packed, unpacked, crc = _chunk(record)
    if _CHUNK_HEAD.unpack_from(record)[0] != chunk.start:
        raise BadDataError(f"the chunk at {chunk.position} starts when its summary denies it")
    return _checked(unpack(packing, packed, unpacked), 0 if is_checked else crc)


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


def _gather(
    file: RawFile, index: _Index, chunks: list[int], found: Gathered, *, strict: bool = False
) -> None:
    """Walk over the records of the file; where they break off, go on with the next known chunk.

    Adds the schemas and channels that it finds to `index`. With `strict`, raises instead.
    """
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
    learn: Callable[[int, bytes], None],
) -> Iterator[Payload]:
    """The messages of a chunk that are wanted, as they lie there; other records are learned."""
    found = Recorded()
    try:
        _add_chunk(found, raw, wanted, learn)
    except Exception:
        yield from map(found.__getitem__, range(len(found)))
        raise
    yield from map(found.__getitem__, range(len(found)))

"""MCAP files (https://mcap.dev/spec).

With the summary at the end of the file, only chunks with selected messages are read. Files are
scanned from their beginning if the summary is missing or does not list all schemas, channels and
chunks. So are damaged files (`salvage`).

Violations of the format count as damage:

- a wrong checksum (zero means that it is missing);
- a record in a forbidden position: a second header, a chunk within a chunk or after the data;
- a chunk of the summary that is missing in the file;
- a message that is shorter than its head;
- a message of a channel that neither the summary nor an earlier record declares, or whose schema
  is not declared;
- a channel or schema that is declared again with other content.

`salvage` skips such messages, uses the first readable declaration, and reports the loss. After
damage it continues with the next chunk; in files without chunks, and in chunks without a checksum,
with the next message.

If the data have a checksum, the whole file is read once to verify it.
"""

from __future__ import annotations

import re
import struct
import zlib
from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass, field
from itertools import accumulate, repeat
from typing import TYPE_CHECKING

from tfdb._core import Recorded
from tfdb.data.counting import counted
from tfdb.data.errors import RecordingError

from .containers import (
    NO_START,
    OTHER_START,
    SALVAGE,
    Container,
    Gathered,
    Source,
    Topic,
    are_packed,
    encoding_of,
    in_order,
    is_read_type,
    plain_type,
    typed_errors,
    unpacked,
)
from .raw_file import BadDataError, BrokenChunkError, RawFile, unpack, unpack_the_start
from .record_search import Chunk, find_record
from .tf_definition import LOST, STATE, STORE

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
    from pathlib import Path

    from .containers import Payload
    from .raw_file import Packed
    from .record_search import Bytes

_MAGIC = b"\x89MCAP0\r\n"
_NAMES = (
    "no record",
    "a header",
    "a footer",
    "a schema",
    "a channel",
    "a message",
    "a chunk",
    "a message index",
    "a chunk index",
    "an attachment",
    "an attachment index",
    "a statistics record",
    "a metadata record",
    "a metadata index",
    "a summary offset",
    "an end of the data",
)
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX, _CHUNK_INDEX = range(1, 9)
_ATTACHMENT, _STATISTICS, _METADATA, _DATA_END = 0x09, 0x0B, 0x0C, 0x0F
# Records that the format forbids elsewhere. Unknown kinds are allowed everywhere.
_IN_CHUNK = frozenset({_SCHEMA, _CHANNEL, _MESSAGE})
_IN_DATA = _IN_CHUNK | {_CHUNK, _MESSAGE_INDEX, _ATTACHMENT, _METADATA, _DATA_END}
_KNOWN = frozenset(range(1, len(_NAMES)))
_IN_SUMMARY = _KNOWN - _IN_DATA - {_HEADER, _FOOTER} | {_SCHEMA, _CHANNEL}
# Opcode and length.
_RECORD = struct.Struct("<BQ")
_HEAD = 9
_FOOTER_SIZE = _HEAD + 20 + len(_MAGIC)
_DATA_END_SIZE = _HEAD + 4
_CHUNK_HEAD = struct.Struct("<QQQI")
# A message of less than 4 GiB; a chunk of less than 1 TiB.
_MESSAGE_HEADS = re.compile(rb"\x05.{4}\0{4}", re.DOTALL)
_CHUNK_HEADS = re.compile(rb"\x06.{5}\0{3}.{28}(?:\0{4}|\x03\0{3}lz4|\x04\0{3}zstd)", re.DOTALL)
_FOLLOWING = 3
"""Number of valid records in a row that show that a message begins."""
_PAIR = struct.Struct("<HQ")
_LOST_HEAD = struct.pack("<I", len(LOST)) + LOST.encode()
_PIECE = 2**20
# Parts with fewer messages are not worth their cost.
_PART = 256
_LATEST = 2**64 - 1
_WRONG_DATA = "data whose checksum is wrong"


@dataclass(frozen=True)
class _Channel:
    """One stream of messages."""

    schema: int
    topic: str
    encoding: str


@dataclass(frozen=True)
class _Chunk:
    """The position of a chunk and its message indexes, its times and channels (empty: any)."""

    position: int
    end: int
    start: int
    last: int
    channels: frozenset[int]


@dataclass
class _Index:
    """The index of a file's messages: their streams, positions and counts.

    `data_crc` is the checksum of all bytes before the end of the data; None if the summary states
    another position of this end. `flaws` are violations of the format in well-formed records, each
    with the bytes that it loses.
    """

    schemas: dict[int, str] = field(default_factory=dict)
    channels: dict[int, _Channel] = field(default_factory=dict)
    chunks: list[_Chunk] = field(default_factory=list)
    counts: dict[int, int] | None = None
    chunk_count: int = 0
    start: int = NO_START
    summary: int = 0
    data_crc: int | None = None
    flaws: Counter[str] = field(default_factory=Counter)
    lost: int = 0
    """Number of commits that the recorder lost."""
    store: str = ""
    """Id of the recorded store."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the file."""
        text = f"{counted(self.lost, 'commit')} were lost when it was recorded"
        return (f"{text}: they came faster than the disk took them",) if self.lost else ()

    def learn(self, kind: int, data: bytes) -> None:
        """Add a schema, channel, chunk index, statistics or metadata record."""
        fields = _Fields(data)
        if kind == _SCHEMA:
            id_, name = fields.number(2), fields.text()
            if id_ and self.schemas.setdefault(id_, name) != name:
                self.flaws[f"schema {id_} is declared again as {name!r}"] += 0
                if is_read_type(name) and not is_read_type(self.schemas[id_]):
                    self.schemas[id_] = name  # a damaged name is not readable
        elif kind == _CHANNEL:
            id_ = fields.number(2)
            channel = _Channel(fields.number(2), fields.text(), fields.text())
            if self.channels.setdefault(id_, channel) != channel:
                self.flaws[f"channel {id_} is declared again, on {channel.topic!r}"] += 0
            if channel.topic == STATE:
                self.store = fields.texts().get(STORE, "")
        elif kind == _CHUNK_INDEX:
            start, last, position = fields.number(8), fields.number(8), fields.number(8)
            end = position + fields.number(8)
            channels = frozenset(fields.pairs())
            self.chunks.append(_Chunk(position, end + fields.number(8), start, last, channels))
        elif kind == _STATISTICS:
            count = fields.number(8)
            fields.skip(2 + 4 + 4 + 4)
            self.chunk_count, start = fields.number(4), fields.number(8)
            fields.number(8)
            counts, self.start = fields.pairs(), start if count else NO_START
            if counts and sum(counts.values()) != count:
                self.flaws[f"statistics that do not add up to {count} messages"] += 0
            else:
                self.counts = counts
        elif kind == _METADATA and data.startswith(_LOST_HEAD):
            fields.text()
            commits = fields.texts().get("commits", "")
            self.lost += int(commits) if commits.isdecimal() else 0

    def learn_in_chunk(self, kind: int, data: bytes) -> None:
        """Add a record of a chunk that is not a message, or is too short for one."""
        if kind == _MESSAGE:
            self.flaws[f"a message of {len(data)} bytes, too short for one"] += _HEAD + len(data)
        elif kind in _IN_CHUNK:
            self.learn(kind, data)
        else:
            self.flaws[f"{_NAMES[kind]} within a chunk"] += _HEAD + len(data)

    def is_whole(self) -> bool:
        """Whether the chunks hold all messages, so that only they need to be read."""
        if (
            self.data_crc is None
            or not self.counts
            or not self.chunks
            or len(self.chunks) != self.chunk_count
        ):
            return False
        named = set(self.counts).union(*(chunk.channels for chunk in self.chunks))
        return all(map(self.is_declared, named | self.channels.keys())) and not self.flaws

    def is_declared(self, channel: int) -> bool:
        """Whether channel and schema (0: none) are known. An unknown one becomes a flaw."""
        known = self.channels.get(channel)
        return known is not None and (known.schema == 0 or known.schema in self.schemas)

    def is_read(self, channel: int) -> bool:
        """Whether messages of a channel can be read. An unknown channel becomes a flaw."""
        if not self.is_declared(channel):
            self.flaws[
                f"messages of channel {channel}, which has no schema or is not declared"
            ] += 0
            return False
        return is_read_type(self.type_of(channel))

    def refuse_flaws(self) -> None:
        """Raise if the file has flaws."""
        if self.flaws:
            raise BadDataError(next(iter(self.flaws)))

    def type_of(self, channel: int) -> str:
        return self.schemas.get(self.channels[channel].schema, "")


class _Fields:
    """Reads the fields of a record one after the other."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def number(self, width: int) -> int:
        return int.from_bytes(self._take(width), "little")

    def text(self) -> str:
        return self._take(self.number(4)).decode()

    def pairs(self) -> dict[int, int]:
        """Read a map from ids to numbers."""
        data = self._take(self.number(4))
        return dict(_PAIR.iter_unpack(data))

    def texts(self) -> dict[str, str]:
        """Read a map from texts to texts."""
        fields, found = _Fields(self._take(self.number(4))), {}
        while fields._at < len(fields._data):
            name = fields.text()
            found[name] = fields.text()
        return found

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
    if index.is_whole() and _is_covered(file, index):
        return _indexed(path, file, index)
    gathered, index.lost = Gathered(), 0
    _Walk(file, index, gathered, strict=True).run(index.chunks, are_sure=True)
    walked = _walked(path, file, index, gathered)
    if walked.losses:
        raise BadDataError(walked.losses[0].reason)
    if index.counts and (more := gathered.found() - gathered.promised):
        raise BadDataError(f"{more.total()} more messages than in its statistics")
    return walked


def _is_covered(file: RawFile, index: _Index) -> bool:
    """Return whether the data are a header, the summary's chunks, and valid records between."""
    end = index.summary - _DATA_END_SIZE
    places = [(chunk.position, chunk.end) for chunk in index.chunks]
    forbidden = {0, *_KNOWN} - _IN_DATA | {_CHUNK, _DATA_END}
    kind, size = _RECORD.unpack(file.read(len(_MAGIC), _HEAD))
    if kind != _HEADER:
        return False
    at = len(_MAGIC) + _HEAD + size
    for place, behind in [*places, (end, end)]:
        while at < place:
            kind, size = _RECORD.unpack(file.read(at, _HEAD))
            if kind in forbidden:
                return False
            if kind == _METADATA:
                index.learn(kind, file.read(at + _HEAD, size))
            at += _HEAD + size
        if at != place:
            return False
        at = behind
    return True


def _has_end(file: RawFile) -> bool:
    if file.size < len(_MAGIC) + _FOOTER_SIZE:
        return False
    return file.read(file.size - len(_MAGIC), len(_MAGIC)) == _MAGIC


def _indexed(path: Path, file: RawFile, index: _Index) -> Container:
    counts = index.counts or {}
    sources = _sources(path, index, counts)

    def add(
        found: Recorded, chunk: _Chunk, ids: Collection[int], *, is_checked: bool = False
    ) -> None:
        raw = _raw(file, chunk, is_checked=is_checked)
        _add_chunk(found, raw, lambda id_: index.is_read(id_) and id_ in ids, index.learn_in_chunk)
        index.refuse_flaws()

    def messages_of(chunk: _Chunk, ids: Collection[int]) -> Iterable[Payload]:
        add(found := Recorded(), chunk, ids)
        return map(found.__getitem__, range(len(found)))

    def payloads(ids: Collection[int], since: int) -> Iterator[Payload]:
        wanted = ((each.start, each) for each in _chunks_of(index, ids) if each.last >= since)
        yield from in_order(wanted, lambda chunk: messages_of(chunk, ids))
        if not since:
            _check_data(index, _Checksum(file))

    def survey(
        ids: Collection[int], step: Callable[[int], None]
    ) -> tuple[dict[int, int], bool, Iterator[Recorded]]:
        found_by_id: Counter[int] = Counter()
        packed = False
        spans = []
        checksum = _Checksum(file)
        for chunk in _chunks_of(index, ids):
            found = Recorded()
            add(found, chunk, ids)
            if len(found):
                found_by_id.update(found.counts())
                packed = packed or are_packed(found, sources)
                found.sort()
                spans.append(_Span(chunk, len(found), found[0][0], found[len(found) - 1][0]))
            if index.data_crc:
                checksum.up_to(chunk.position)  # reuses the bytes that were just read
            step(len(found))
        _check_data(index, checksum)
        return found_by_id, packed, map(recorded, _parts(spans), repeat(ids))

    def recorded(part: list[_Span], ids: Collection[int]) -> Recorded:
        found = Recorded()
        for span in part:
            add(found, span.chunk, ids, is_checked=True)
        if len(found) != sum(span.messages for span in part):
            raise BadDataError("its messages change while it is read")
        found.sort()
        return found

    topics = _topics(index, counts)
    made = Container(path, topics, sources, index.start, payloads, file.close, survey=survey)
    made.notes, made.store = index.notes, index.store
    return made


def _chunks_of(index: _Index, ids: Collection[int]) -> list[_Chunk]:
    # Without message indexes, the content of a chunk is unknown until it is read.
    return [c for c in index.chunks if not c.channels or not c.channels.isdisjoint(ids)]


@dataclass(frozen=True)
class _Span:
    """Return the number of selected messages in a chunk, and the first and last of their times."""

    chunk: _Chunk
    messages: int
    first: int
    last: int


def _parts(spans: list[_Span]) -> Iterator[list[_Span]]:
    """Divide a file in its order, so that no part has a message older than an earlier part."""
    firsts = [span.first for span in reversed(spans)]
    earliest = [*accumulate(firsts, min)][::-1]  # earliest times of each chunk and all later ones
    part: list[_Span] = []
    latest = messages = 0
    for span, following in zip(spans, [*earliest, _LATEST][1:], strict=True):
        part.append(span)
        latest, messages = max(latest, span.last), messages + span.messages
        if latest <= following and (messages >= _PART or span is spans[-1]):
            yield part
            part, messages = [], 0


def _salvaged(path: Path, file: RawFile) -> Container:
    summary = index = _Index()
    gathered = Gathered()
    if file.read(0, len(_MAGIC)) != _MAGIC:
        gathered.lose(0, OTHER_START)
    try:
        if _has_end(file):
            _read_summary(file, summary)
    except (BadDataError, struct.error, UnicodeDecodeError) as error:
        gathered.lose(0, error)
        index = _Index()  # only the chunk positions of a damaged summary are used
    _Walk(file, index, gathered).run(summary.chunks, are_sure=index is summary)
    if not _has_end(file) and not gathered.reasons:
        gathered.lose(0, "cut short, its end is missing")
    return _walked(path, file, index, gathered)


def _walked(path: Path, file: RawFile, index: _Index, gathered: Gathered) -> Container:
    if index.counts:
        gathered.promised = Counter(index.counts)
    for reason, lost in index.flaws.items():
        gathered.lose(lost, reason)
    counts = gathered.found()
    sources = _sources(path, index, counts)
    start = min((at for at, _, _ in gathered.messages), default=NO_START)
    topics, losses = _topics(index, counts), gathered.losses(path, sources)
    made = Container(path, topics, sources, start, gathered.payloads, file.close, losses)
    made.notes, made.store = index.notes, index.store
    return made


def _sources(path: Path, index: _Index, counts: dict[int, int]) -> dict[int, Source]:
    return {
        id_: Source(
            channel.topic,
            encoding_of(path, channel.topic, index.type_of(id_), channel.encoding),
            channel.topic,
            counts.get(id_, 0),
            plain_type(index.type_of(id_)),
        )
        for id_, channel in index.channels.items()
        if index.is_read(id_)
    }


def _topics(index: _Index, counts: dict[int, int]) -> Iterator[Topic]:
    return (
        Topic(channel.topic, index.type_of(id_), counts.get(id_, 0))
        for id_, channel in index.channels.items()
    )


class GrowingMcap:
    """An MCAP file that is still being written: returns new messages.

    It returns each complete chunk, and each message outside of chunks, once. It verifies the
    checksums of chunks, but not that of all data. Raises `RecordingError` if the file is damaged,
    is not an MCAP file or shrinks; OSError.
    """

    def __init__(self, path: Path) -> None:
        if path.exists() and not path.is_file():
            raise RecordingError(path, "not a regular file")
        self.path = path
        self._file = RawFile(path)
        self._index = _Index()
        self._at = 0
        self.is_complete: bool = False

    @property
    def size(self) -> int:
        """Size of the file at the last read."""
        return self._file.size

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def read(self) -> Iterator[tuple[Recorded, dict[int, Source]]]:
        """Return the messages since the last call, chunk by chunk, with their sources.

        `is_complete` is then true if the file has its end record.
        """
        with typed_errors(self.path, "a file that is still written has only whole chunks"):
            self._file.look_again()
            while not self.is_complete and (end := self._next()) is not None:
                found = Recorded()
                self._take(end, found)
                self._at = end
                if len(found):
                    found.sort()
                    sources = _sources(self.path, self._index, found.counts())
                    yield unpacked(found, sources), sources

    def _next(self) -> int | None:
        """Return the end of the record that begins here; None: it is incomplete."""
        head = len(_MAGIC) if self._at == 0 else _HEAD
        if self._at + head > self.size:
            return None
        raw = self._file.read(self._at, head)
        if self._at == 0:
            if raw != _MAGIC:
                raise BadDataError("not an MCAP file")
            return head
        kind, size = _RECORD.unpack(raw)
        if kind == 0:
            raise BadDataError(f"no record at {self._at}")
        end: int = self._at + _HEAD + size + (len(_MAGIC) if kind == _FOOTER else 0)
        return end if end <= self.size else None

    def _take(self, end: int, found: Recorded) -> None:
        """Read the record at the position."""
        if self._at == 0:
            return
        kind, size = _RECORD.unpack(self._file.read(self._at, _HEAD))
        index, at = self._index, self._at + _HEAD
        if kind == _FOOTER:
            self.is_complete = True
        elif kind in (_SCHEMA, _CHANNEL):
            index.learn(kind, self._file.read(at, size))
        elif kind == _CHUNK:
            packing, packed, unpacked, crc = _chunk(self._file.read(at, size))
            raw = _checked(unpack(packing, packed, unpacked), crc)
            _add_chunk(found, raw, index.is_read, index.learn_in_chunk)
        elif kind == _MESSAGE:
            raw = self._file.read(self._at, end - self._at)
            _add_chunk(found, raw, index.is_read, index.learn_in_chunk)
        index.refuse_flaws()


# -- the top of the file --------------------------------------------------------------------------


def _read_summary(file: RawFile, index: _Index) -> None:
    """Add the summary, if the file has one, to an empty index."""
    end = file.size - _FOOTER_SIZE
    footer = _Fields(file.read(end, _FOOTER_SIZE))
    if (footer.number(1), footer.number(8)) != (_FOOTER, 20):
        raise BadDataError("no footer at its end")
    start = at = footer.number(8)
    footer.skip(8)
    crc = footer.number(4)
    while 0 < at < end:
        kind, size = _RECORD.unpack(file.read(at, _HEAD))
        if kind < len(_NAMES) and kind not in _IN_SUMMARY:
            raise BadDataError(f"{_NAMES[kind]} in its summary, at {at}")
        if kind in (_SCHEMA, _CHANNEL, _CHUNK_INDEX, _STATISTICS):
            index.learn(kind, file.read(at + _HEAD, size))
        at += _HEAD + size
    if at > end:
        raise BadDataError("its summary goes beyond its end")
    index.chunks.sort(key=lambda each: each.position)
    if len({chunk.position for chunk in index.chunks}) != len(index.chunks):
        raise BadDataError("its summary names the same chunk twice")
    if start and crc and crc != _Checksum(file, start).up_to(end + _HEAD + 16):
        raise BadDataError("a summary whose checksum is wrong")
    index.summary = start
    if start >= len(_MAGIC) + _DATA_END_SIZE:
        data_end = file.read(start - _DATA_END_SIZE, _DATA_END_SIZE)
        if _RECORD.unpack_from(data_end) == (_DATA_END, 4):
            index.data_crc = int.from_bytes(data_end[_HEAD:], "little")


def _check_data(index: _Index, checksum: _Checksum) -> None:
    if index.data_crc and checksum.up_to(index.summary - _DATA_END_SIZE) != index.data_crc:
        raise BadDataError(_WRONG_DATA)


class _Checksum:
    """The checksum of the file from a position, computed in pieces of any size."""

    def __init__(self, file: RawFile, at: int = 0) -> None:
        self._file = file
        self._at = at
        self._crc = 0

    def up_to(self, end: int) -> int:
        """Continue to a later position."""
        while self._at < end:
            piece = self._file.read(self._at, min(_PIECE, end - self._at))
            self._crc = zlib.crc32(piece, self._crc)
            self._at += len(piece)
        return self._crc


def _raw(file: RawFile, chunk: _Chunk, *, is_checked: bool = False) -> bytes | memoryview:
    """Return the records of a chunk of the summary, decompressed and verified once."""
    kind, size = _RECORD.unpack(file.read(chunk.position, _HEAD))
    if kind != _CHUNK:
        raise BadDataError(_no_chunk(chunk.position))
    record = file.read(chunk.position + _HEAD, size)
    packing, packed, unpacked, crc = _chunk(record)
    if _start_of(record) != chunk.start:
        raise BadDataError(_other_start(chunk.position))
    return _checked(unpack(packing, packed, unpacked), 0 if is_checked else crc)


def _chunk(record: bytes, *, cut: bool = False) -> tuple[str, memoryview, int, int]:
    """Parse a chunk: compression, compressed records, their original size and checksum."""
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


@dataclass
class _LastChunk:
    """The chunk to which the next message indexes belong.

    `held` are the messages that it has or should have; `is_sure`: its checksum proves them
    complete. `indexed` are the channels whose index was read; `is_followed`: another record
    followed.
    """

    held: Counter[int] = field(default_factory=Counter)
    indexed: set[int] = field(default_factory=set)
    is_sure: bool = False
    is_followed: bool = False


class _Walk:
    """Scans the records of a file for messages.

    Adds schemas and channels to `index`, and misplaced records to its flaws. With `strict` it
    raises at the first damage. Otherwise it continues at the next record after the damage, or
    with the next chunk of the summary.
    """

    def __init__(
        self, file: RawFile, index: _Index, found: Gathered, *, strict: bool = False
    ) -> None:
        self._file = file
        self._index = index
        self._found = found
        self._strict = strict
        # A cut file has no end record: all bytes count as records.
        self._end = file.size - _FOOTER_SIZE if _has_end(file) else file.size
        self._chunks: list[int] = []
        self._starts: dict[int, int] = {}
        self._missing: set[int] = set()
        self._is_in_data = True
        self._has_chunks: bool | None = None  # not known yet
        self._last = _LastChunk()

    def run(self, chunks: Iterable[_Chunk], *, are_sure: bool) -> None:
        """Scan the file. `chunks` are the summary's; `are_sure`: the summary is undamaged."""
        starts = {chunk.position: chunk.start for chunk in chunks}
        self._chunks = sorted(filter(self._has_chunk, starts))
        self._has_chunks = True if starts else None
        if are_sure:
            self._starts = starts
            self._missing = starts.keys() - self._chunks
        if self._strict:
            self._note_missing()
        at = len(_MAGIC)
        while at < self._end:
            end = self._end
            try:
                kind, size = _RECORD.unpack(self._file.read(at, _HEAD))
                if (kind, size) == (_FOOTER, 20) and at + _FOOTER_SIZE >= self._file.size:
                    break
                end = at + _HEAD + size
                following = self._step(kind, at, size)
            except (BadDataError, struct.error, UnicodeDecodeError) as error:
                if self._strict:
                    raise
                following = self._behind(at, end)
                self._found.lose(following - at, error)
            at = following
        for channel in self._found.found():
            self._index.is_read(channel)  # an unknown one becomes a flaw
        self._note_missing()
        if self._is_in_data and self._index.summary:
            self._note("no end of its data before its summary")

    def _note(self, reason: str) -> None:
        """Report damage that does not have to lose a record."""
        if self._strict:
            raise BadDataError(reason)
        self._index.flaws[reason] += 0

    def _note_missing(self) -> None:
        for place in sorted(self._missing):
            self._note(_no_chunk(place))

    def _step(self, kind: int, at: int, size: int) -> int:
        """Read the record at `at`; return the next position."""
        end = at + _HEAD + size
        if kind != _MESSAGE_INDEX or at in self._missing:
            self._last.is_followed = True
        if at in self._missing:
            self._missing.remove(at)
            raise BadDataError(_no_chunk(at))
        self._check_place(kind, at)
        over = self._within(at, end)
        reason = f"a record at {at} overlaps the chunk at {over}"
        if over is not None and kind != _CHUNK:
            raise BadDataError(reason)
        reasons = len(self._found.reasons)
        self._gather(kind, at, size)
        if over is None:
            is_damaged = len(self._found.reasons) > reasons or not self._has_record(end)
            if self._strict or (kind in _KNOWN and not is_damaged):
                return end
            found = self._find(at + 1, min(end, self._end))  # its size may be wrong
            if found < min(end, self._end):
                self._found.lose(0, f"a record of a wrong size at {at}")
                return found
            return end
        self._note(reason)
        return over

    def _check_place(self, kind: int, at: int) -> None:
        """Add a flaw for a record in a forbidden position."""
        if at == len(_MAGIC):
            if kind != _HEADER:
                self._note("no header at its beginning")
        elif kind in _KNOWN - (_IN_DATA if self._is_in_data else _IN_SUMMARY):
            where = "before" if self._is_in_data else "after"
            self._note(f"{_NAMES[kind]} {where} the end of its data")

    def _gather(self, kind: int, at: int, size: int) -> None:
        """Read one record."""
        there = min(size, self._file.size - at - _HEAD)
        if kind == 0 or (there < size and (self._strict or kind != _CHUNK)):
            raise BadDataError(f"an incomplete record of {size} bytes at {at}")
        if kind == _CHUNK:
            if _find_chunk(self._file, at, at + 1) == at:
                self._has_chunks = True
            record = self._file.read(at + _HEAD, there)
            before = len(self._found.messages)
            self._gather_chunk(record, size)
            if len(self._found.messages) > before:
                self._has_chunks = True
            if self._starts.get(at, start := _start_of(record)) != start:
                self._note(_other_start(at))
        elif kind in (_SCHEMA, _CHANNEL, _METADATA):
            self._index.learn(kind, self._file.read(at + _HEAD, size))
        elif kind == _MESSAGE_INDEX:
            self._gather_message_index(self._file.read(at + _HEAD, size))
        elif kind == _MESSAGE:
            self._take(self._file.read(at, _HEAD + size))
        elif kind == _DATA_END and self._is_in_data:
            self._is_in_data = False
            self._end_data(at, size)

    def _gather_message_index(self, record: bytes) -> None:
        """Expect the messages of an index that its chunk did not have."""
        fields = _Fields(record)
        id_, size = fields.number(2), fields.number(4)
        fields.skip(size)
        if self._last.is_followed and id_ in self._last.indexed:
            self._last = _LastChunk()  # an index without a chunk
        self._last.indexed.add(id_)
        more = size // 16 - self._last.held[id_]
        if more > 0 and not self._last.is_sure:
            self._last.held[id_] += more
            self._found.promised[id_] += more

    def _end_data(self, at: int, size: int) -> None:
        crc = _Fields(self._file.read(at + _HEAD, size)).number(4)
        if crc and crc != _Checksum(self._file).up_to(at):
            self._note(_WRONG_DATA)
        if self._index.summary not in (0, at + _HEAD + size):
            self._note("a summary that does not begin right after the end of its data")

    def _gather_chunk(self, record: bytes, size: int) -> None:
        """Read the messages of a chunk; without `strict` it may be cut or damaged."""
        reason: Exception | None = None
        try:
            parts = _chunk(record)
        except BadDataError as error:
            if self._strict:
                raise
            parts, reason = _chunk(record, cut=True), error
        packing, packed, unpacked, crc = parts
        self._last = _LastChunk()
        try:
            raw = _checked(unpack(packing, packed, unpacked), crc)
        except BadDataError as error:
            if self._strict:
                raise
            raw, reason = unpack_the_start(packing, packed, unpacked), error
            if len(raw) == unpacked:
                raise  # the position of the damage is unknown
        if len(record) < size:
            reason = BadDataError(f"cut short in the middle of a chunk of {size} bytes")
        self._last.is_sure = reason is None and crc != 0
        lost = self._take(raw, is_packed=bool(packing))
        if reason is not None or lost:
            count = unpacked - len(raw) + lost
            self._found.lose(count, reason or f"a chunk with {lost} damaged bytes")

    def _take(self, raw: Packed, *, is_packed: bool = False) -> int:
        """Add the messages of a chunk; return how many bytes were invalid.

        `is_packed`: nothing behind damage is used, because damage of compressed data spreads.
        """
        before = len(self._found.messages)
        at = lost = 0
        while at < len(raw):
            part = memoryview(raw)[at:]
            messages = _messages_in(part, self._is_wanted, self._index.learn_in_chunk)
            if self._strict:
                self._found.messages += messages
                break
            broken = at + self._found.take(messages, len(part))
            at = len(raw) if is_packed else self._next_message(raw, broken)
            lost += at - broken
        held = Counter(id_ for _, id_, _ in self._found.messages[before:])
        self._last.held.update(held)
        self._found.promised.update(held)
        return lost

    def _is_wanted(self, channel: int) -> bool:
        """Whether to keep messages of a channel. `salvage` may find its declaration later."""
        is_unknown = not self._strict and not self._index.is_declared(channel)
        return is_unknown or self._index.is_read(channel)

    def _next_message(self, raw: Packed, broken: int) -> int:
        """Return the position of the next message in a chunk, after a broken record, or its end.

        A chunk that begins earlier shows that this chunk has ended.
        """
        chunk = Chunk(raw)
        end = _find_chunk(chunk, broken, len(raw))
        found = _find_message(chunk, broken + 1, end, self._index)
        return found if found < end else len(raw)

    # -- where to go on ----------------------------------------------------------------------------

    def _has_chunk(self, at: int) -> bool:
        if not len(_MAGIC) <= at <= self._end - _HEAD:
            return False
        kind, size = _RECORD.unpack(self._file.read(at, _HEAD))
        return bool(kind == _CHUNK and at + _HEAD + size <= self._end)

    def _within(self, at: int, end: int) -> int | None:
        """Return the first chunk of the summary that begins after `at` and before `end`."""
        place = bisect_right(self._chunks, at)
        following = self._chunks[place : place + 1]
        return following[0] if following and following[0] < end else None

    def _behind(self, at: int, end: int) -> int:
        """Return the next position at which a record begins, after a damaged one.

        That is the end of the damaged record, unless another record begins within it.
        """
        known = self._within(at, self._end)
        limit = self._end if known is None else known
        found = self._find(at + 1, min(end, limit))
        if found < min(end, limit) or (end <= limit and self._has_record(end)):
            return found
        return self._find(found, limit)

    def _find(self, at: int, end: int) -> int:
        """Return the first position in a range at which a chunk or a message begins, or its end.

        Messages are not searched if the file has chunks.
        """
        limit = end
        if self._has_chunks is not False:
            limit = _find_chunk(self._file, at, end)
        if self._has_chunks is None and end == self._end:
            self._has_chunks = limit < end
        if self._has_chunks:
            return limit
        return _find_message(self._file, at, limit, self._index)

    def _has_record(self, at: int) -> bool:
        if at > self._end - _HEAD:
            return at == self._end
        kind, size = _RECORD.unpack(self._file.read(at, _HEAD))
        return kind in _KNOWN and at + _HEAD + size <= self._end


def _find_chunk(data: Bytes, at: int, end: int) -> int:
    """Return the first position in a range at which a chunk begins, or its end."""

    def start_of(place: int) -> int | None:
        head = place + _HEAD + _CHUNK_HEAD.size
        if head + 16 > data.size:
            return None
        length = int.from_bytes(data.read(place + 1, 8), "little")
        packing = int.from_bytes(data.read(head, 4), "little")
        packed = int.from_bytes(data.read(head + 4 + packing, 8), "little")
        return place if length == _CHUNK_HEAD.size + 4 + packing + 8 + packed else None

    return find_record(data, _CHUNK_HEADS, at, end, start_of)


def _find_message(data: Bytes, at: int, end: int, index: _Index) -> int:
    """Return the first position in a range at which a message begins, or its end.

    Its channel is declared, if any is yet, and valid records follow it.
    """

    def start_of(place: int) -> int | None:
        following = place
        for number in range(_FOLLOWING):
            if following + _HEAD + 2 > data.size:
                return place if number else None
            kind, length = _RECORD.unpack(data.read(following, _HEAD))
            channel = int.from_bytes(data.read(following + _HEAD, 2), "little")
            following += _HEAD + length
            if kind not in _KNOWN or following > data.size:
                return None
            if kind == _MESSAGE and index.channels and channel not in index.channels:
                return None
        return place

    return find_record(data, _MESSAGE_HEADS, at, end, start_of)


def _start_of(record: bytes) -> int:
    start: int = _CHUNK_HEAD.unpack_from(record)[0]
    return start


def _other_start(at: int) -> str:
    return f"the chunk at {at} begins at another time than its summary states"


def _no_chunk(at: int) -> str:
    return f"no chunk at {at}, where the summary has one"


# -- inside of a chunk ----------------------------------------------------------------------------


def _add_chunk(
    found: Recorded,
    raw: bytes | memoryview,
    wanted: Callable[[int], bool],
    learn: Callable[[int, bytes], None],
) -> None:
    """Add the selected messages of a chunk, and its other records."""
    broken = found.add_mcap_chunk(raw, wanted, learn)
    if broken is not None:
        at, length = broken
        raise BrokenChunkError(f"a record of {length} bytes goes beyond its chunk", at)


def _messages_in(
    raw: bytes | memoryview,
    wanted: Callable[[int], bool],
    learn: Callable[[int, bytes], None],
) -> Iterator[Payload]:
    """Return the selected messages of a chunk in its order; add its other records."""
    found = Recorded()
    try:
        _add_chunk(found, raw, wanted, learn)
    except Exception:
        yield from map(found.__getitem__, range(len(found)))
        raise
    yield from map(found.__getitem__, range(len(found)))

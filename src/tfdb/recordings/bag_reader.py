"""ROS 1 bags (http://wiki.ros.org/Bags/Format/2.0).

With the index at the end of the file, only chunks with selected messages are read. `salvage` scans
the file from its beginning. After damage it continues with the next record that it finds: within a
chunk a message, between chunks a chunk.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, NoReturn

from tfdb.data.errors import RecordingError

from .containers import (
    NO_START,
    OTHER_START,
    Container,
    Gathered,
    Source,
    Topic,
    in_order,
    is_read_type,
    plain_type,
    typed_errors,
)
from .raw_file import BadDataError, BrokenChunkError, RawFile, unpack, unpack_the_start
from .record_search import REACH, Chunk, find_record

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterator
    from pathlib import Path

    from .containers import Payload
    from .record_search import Bytes

    Fields = dict[bytes, bytes]

_MAGIC = b"#ROSBAG V2.0\n"
_FIRST_RECORD = len(_MAGIC)
_MESSAGE, _HEADER, _COUNTS, _CHUNK, _CHUNK_INFO, _CONNECTION = 2, 3, 4, 5, 6, 7
_INNER, _OUTER = (_MESSAGE, _CONNECTION), (_COUNTS, _CHUNK)
_KINDS = (_HEADER, _CHUNK, _CONNECTION, _COUNTS, _CHUNK_INFO)
_KIND_FIELD = re.compile(rb"\x04\0{3}op=")
# Bytes of each message in the index of a chunk.
_COUNTED = 12
_HINT = "`rosbag reindex` or salvage=True (--salvage) may save the rest"
# A header has a few numbers and a topic's name.
_MAX_HEADER = 2**20
_u32 = struct.Struct("<I").unpack_from
_u64 = struct.Struct("<Q").unpack_from
_seconds = struct.Struct("<II").unpack_from


@dataclass(frozen=True)
class _Connection:
    """A publisher, its topic and its message type."""

    topic: str
    type: str
    caller: str


@dataclass(frozen=True)
class _Chunk:
    """The position of a chunk, and its number of messages of each connection."""

    position: int
    start: int
    end: int
    counts: dict[int, int]


@dataclass
class _Index:
    """The index at the end of a bag."""

    connections: dict[int, _Connection] = field(default_factory=dict)
    chunks: list[_Chunk] = field(default_factory=list)

    def count(self, connection: int) -> int:
        return sum(chunk.counts.get(connection, 0) for chunk in self.chunks)

    def confirm(self, fields: Fields, data: bytes) -> None:
        """Refuse a connection that differs between chunk and index."""
        id_, there = _number(fields, b"conn", 4), _connection(fields, data)
        here = self.connections.get(id_)
        if here is None or (here.topic, here.type) != (there.topic, there.type):
            raise BadDataError(f"connection {id_} differs between its chunks and its index")


@dataclass(frozen=True)
class _Record:
    """A top-level record of the file, its data not yet read."""

    fields: Fields
    at: int
    size: int

    @property
    def end(self) -> int:
        return self.at + self.size

    @property
    def kind(self) -> int:
        return _number(self.fields, b"op", 1)


def open_bag(path: Path, *, salvage: bool = False) -> Container:
    """Open a ROS 1 bag; raises `RecordingError`."""
    file = RawFile(path)
    try:
        with typed_errors(path, _HINT):
            return _salvaged(path, file) if salvage else _indexed(path, file)
    except BaseException:
        file.close()
        raise


def _indexed(path: Path, file: RawFile) -> Container:
    index = _read_index(path, file)
    counts = {id_: index.count(id_) for id_ in index.connections}

    def payloads(ids: Collection[int], since: int) -> Iterator[Payload]:
        wanted = [
            each
            for each in index.chunks
            if each.end >= since and not each.counts.keys().isdisjoint(ids)
        ]
        wanted.sort(key=lambda each: each.position)
        return in_order(
            ((each.start, each) for each in wanted), partial(_chunk_messages, file, index, ids)
        )

    start = min((each.start for each in index.chunks if each.counts), default=NO_START)
    sources = _sources(index.connections, counts)
    topics = _topics(index.connections, counts)
    return Container(path, topics, sources, start, payloads, file.close, hint=_HINT)


def _salvaged(path: Path, file: RawFile) -> Container:
    try:
        index = _read_index(path, file)
        reason: Exception | None = None
    except (BadDataError, struct.error, UnicodeDecodeError) as error:
        index, reason = _Index(), error
    connections = dict(index.connections)
    gathered = _gather(file, connections)
    missing = _index_position(file) - file.size
    if reason is not None and missing > 0 and not gathered.reasons:
        gathered.lose(missing, f"cut short between two records: {reason}")
    # In a complete file, the records after the chunks have the same counts as the index.
    likelier = max if gathered.reasons else min
    for id_ in index.connections:
        counted, promised = gathered.promised[id_], index.count(id_)
        gathered.promised[id_] = likelier(counted, promised)
        if counted != promised:
            gathered.lose(0, f"its index has another number of messages of connection {id_}")
    counts = gathered.found()
    sources = _sources(connections, counts)
    return Container(
        path,
        _topics(connections, counts),
        sources,
        min((at for at, _, _ in gathered.messages), default=NO_START),
        gathered.payloads,
        file.close,
        gathered.losses(path, sources),
    )


def _sources(connections: dict[int, _Connection], counts: dict[int, int]) -> dict[int, Source]:
    return {
        id_: Source(
            each.topic,
            "ros1",
            each.caller or each.topic,
            counts.get(id_, 0),
            plain_type(each.type),
        )
        for id_, each in connections.items()
        if is_read_type(each.type)
    }


def _topics(connections: dict[int, _Connection], counts: dict[int, int]) -> Iterator[Topic]:
    whole: dict[tuple[str, str], int] = {}
    for id_, each in connections.items():
        key = each.topic, each.type
        whole[key] = whole.get(key, 0) + counts.get(id_, 0)
    return (Topic(name, type_, count) for (name, type_), count in whole.items())


# -- the top of the file --------------------------------------------------------------------------


def _read_index(path: Path, file: RawFile) -> _Index:
    header = _record(file, _FIRST_RECORD, _HEADER)
    if header.fields.get(b"encryptor"):
        raise RecordingError(path, "encrypted bags cannot be read")
    at = _number(header.fields, b"index_pos", 8)
    if at == 0:
        raise BadDataError("it is not indexed, the recorder did not finish (`rosbag reindex`)")
    index = _Index()
    for _ in range(_number(header.fields, b"conn_count", 4)):
        record = _record(file, at, _CONNECTION)
        id_ = _number(record.fields, b"conn", 4)
        connection = _connection(record.fields, file.read(record.at, record.size))
        if index.connections.setdefault(id_, connection) != connection:
            raise BadDataError(f"its index declares connection {id_} twice")
        at = record.end
    positions = set()
    for _ in range(_number(header.fields, b"chunk_count", 4)):
        record = _record(file, at, _CHUNK_INFO)
        index.chunks.append(_chunk_info(record.fields, file.read(record.at, record.size)))
        positions.add(index.chunks[-1].position)
        at = record.end
    if len(positions) != len(index.chunks):
        raise BadDataError("its index names the same chunk twice")
    if at < file.size:
        raise BadDataError(f"{file.size - at} bytes after its index")
    for id_ in {id_ for chunk in index.chunks for id_ in chunk.counts} - index.connections.keys():
        raise BadDataError(
            f"its index counts messages of connection {id_}, but does not declare it"
        )
    return index


def _index_position(file: RawFile) -> int:
    """Return the position of the index; 0 if it cannot be read."""
    try:
        return _number(_record(file, _FIRST_RECORD, _HEADER).fields, b"index_pos", 8)
    except (BadDataError, struct.error):
        return 0


def _record(file: RawFile, at: int, *kinds: int) -> _Record:
    (size,) = _u32(file.read(at, 4))
    if size > _MAX_HEADER:
        raise BadDataError(f"a record at {at} with a header of {size} bytes")
    fields = _fields(file.read(at + 4, size))
    start = at + 4 + size
    (count,) = _u32(file.read(start, 4))
    record = _Record(fields, start + 4, count)
    if record.kind not in kinds:
        raise BadDataError(f"at {at} a record of kind {record.kind}, which does not belong there")
    return record


def _chunk_info(fields: Fields, data: bytes) -> _Chunk:
    if _number(fields, b"ver", 4) != 1:
        raise BadDataError("chunks of an unknown version")
    counts = dict(_seconds(data, 8 * row) for row in range(_number(fields, b"count", 4)))
    if not all(counts.values()):
        raise BadDataError("its index counts no message of a connection in a chunk")
    start, end = _time_of(fields, b"start_time"), _time_of(fields, b"end_time")
    return _Chunk(_number(fields, b"chunk_pos", 8), start, end, counts)


def _chunk_messages(
    file: RawFile, index: _Index, ids: Collection[int], chunk: _Chunk
) -> Iterator[Payload]:
    record = _record(file, chunk.position, _CHUNK)
    raw = unpack(_packing(record), file.read(record.at, record.size), _unpacked_size(record))
    for message in _messages_in(raw, ids.__contains__, index.confirm):
        if not chunk.start <= message[0] <= chunk.end:
            raise BadDataError("a message contradicts the index of its chunk")
        yield message


def _packing(chunk: _Record) -> str:
    packing = chunk.fields.get(b"compression", b"").decode()
    return "" if packing == "none" else packing


def _unpacked_size(chunk: _Record) -> int:
    return _number(chunk.fields, b"size", 4)


def _gather(file: RawFile, connections: dict[int, _Connection]) -> Gathered:
    """Scan the records of the file; after damage, continue with the next chunk.

    Adds the connections that it finds to the known ones.
    """
    found = Gathered()
    if file.read(0, _FIRST_RECORD) != _MAGIC:
        found.lose(0, OTHER_START)
    walked: set[int] = set()

    def learn(fields: Fields, data: bytes) -> None:
        id_, connection = _number(fields, b"conn", 4), _connection(fields, data)
        if connections.setdefault(id_, connection) != connection:
            found.lose(0, f"connection {id_} is declared again, on {connection.topic!r}")
            # The index at the end of the file was read first. A damaged type is not readable.
            if id_ not in walked and is_read_type(connection.type):
                connections[id_] = connection
        walked.add(id_)

    def wanted(id_: int) -> bool:
        # The declaration of an unknown connection may come later.
        return id_ not in connections or is_read_type(connections[id_].type)

    at = since = _FIRST_RECORD  # the size of the record at `since` may be wrong
    while at < file.size:
        try:
            record = _record(file, at, *_KINDS)
            kind, following = record.kind, record.end
            if kind == _CHUNK:
                if not _gather_chunk(file, record, found, wanted, learn):  # its size may be wrong
                    following = _next_chunk(file, record.at, min(record.end, file.size))
            elif record.end > file.size:
                _refuse_cut(at)
            elif kind == _CONNECTION:
                learn(record.fields, file.read(record.at, record.size))
            elif kind == _COUNTS:
                found.promised[_number(record.fields, b"conn", 4)] += _counted(record)
        except (BadDataError, struct.error, UnicodeDecodeError) as error:
            following = _next_chunk(file, since + 1, file.size)
            found.lose(following - at, error)
            at = following
        since, at = at, following
    return found


def _refuse_cut(at: int) -> NoReturn:
    raise BadDataError(f"cut short in the middle of a record at {at}")


def _next_chunk(file: RawFile, at: int, end: int) -> int:
    """Return the first position in a range at which a chunk begins; `end` without one."""

    def start_of(place: int) -> int | None:
        start = _start_of(file, place)
        try:
            is_chunk = start is not None and _unpacked_size(_record(file, start, _CHUNK)) >= 0
        except (BadDataError, struct.error):
            return None
        return start if is_chunk else None

    return find_record(file, _KIND_FIELD, at, end, start_of)


def _start_of(data: Bytes, place: int) -> int | None:
    """Return the start of the record whose header has the field of its kind at a position."""
    first = max(0, place - REACH)
    before = bytes(data.read(first, place - first))
    for at in range(len(before) - 4, -1, -1):
        (size,) = _u32(before, at)
        if place + 8 <= first + at + 4 + size <= min(data.size, place + REACH):
            header = bytes(data.read(first + at + 4, size))
            try:
                if b"op" in _fields(header):
                    return first + at
            except (BadDataError, struct.error):
                continue
    return None


def _counted(record: _Record) -> int:
    """Number of messages of a connection in the previous chunk."""
    count = _number(record.fields, b"count", 4)
    if record.size != count * _COUNTED:
        raise BadDataError(f"an index of {count} messages in {record.size} bytes")
    return count


def _gather_chunk(
    file: RawFile,
    record: _Record,
    found: Gathered,
    wanted: Callable[[int], bool],
    learn: Callable[[Fields, bytes], None],
) -> bool:
    """Read the messages of a chunk that may be damaged; return whether it is not."""
    there = min(record.size, file.size - record.at)
    packed = file.read(record.at, there)
    packing, size = _packing(record), _unpacked_size(record)
    reasons = len(found.reasons)
    reason: object = None
    try:
        raw = unpack(packing, packed, size)
    except BadDataError as error:
        raw, reason = unpack_the_start(packing, packed, size) if packing else packed, error
    if there < record.size:
        reason = f"cut short in the middle of a chunk of {record.size} bytes"
    if reason is not None:
        found.lose(size - len(raw), reason)
    at = 0
    while (broken := found.take(_messages_in(raw, wanted, learn, at), len(raw))) < len(raw):
        # Damage of compressed data spreads, so nothing behind it is used.
        at = len(raw) if packing else _next_inner(raw, broken)
        found.lose(at - broken, f"a chunk ends early, at {broken}")
    return len(found.reasons) == reasons


def _next_inner(raw: bytes, broken: int) -> int:
    """Return the position of the next record of a chunk, after a broken one; its end without one.

    A record that belongs between chunks shows that the chunk has ended.
    """

    def kind_at(place: int) -> int:
        try:
            (size,) = _u32(raw, place)
            header = raw[place + 4 : place + 4 + size]
            return _number(_fields(header), b"op", 1) if len(header) == size else 0
        except (BadDataError, struct.error):
            return 0

    def start_of(place: int) -> int | None:
        start = _start_of(chunk, place)
        return start if start is not None and kind_at(start) in (*_INNER, *_OUTER) else None

    if kind_at(broken) in _OUTER:
        return len(raw)
    chunk = Chunk(raw)
    found = find_record(chunk, _KIND_FIELD, broken + 1, len(raw), start_of)
    return found if kind_at(found) in _INNER else len(raw)


# -- inside of a chunk ----------------------------------------------------------------------------


def _messages_in(
    raw: bytes,
    wanted: Callable[[int], bool],
    learn: Callable[[Fields, bytes], None],
    at: int = 0,
) -> Iterator[Payload]:
    """Return the selected messages of a chunk from `at` on, in its order; add its connections."""
    # Headers of one connection's messages differ only in the time, which comes last.
    known: dict[bytes, int] = {}
    end = len(raw)
    while at < end:
        try:
            (size,) = _u32(raw, at)
            body = at + 4 + size
            header = raw[at + 4 : body]
            (size,) = _u32(raw, body)
            stop = body + 4 + size
            if stop > end:
                _break(f"a record ends {stop - end} bytes beyond its chunk", at)
            id_ = known.get(header[:-8])
            if id_ is None:
                id_ = _message_of(header, raw[body + 4 : stop], learn)
                if id_ is not None and header[-13:-8] == b"time=":
                    known[header[:-8]] = id_
            if id_ is not None and wanted(id_):
                if header[-13:-8] == b"time=":
                    seconds, nanoseconds = _seconds(header, len(header) - 8)
                    received = seconds * 1_000_000_000 + nanoseconds
                else:
                    received = _time_of(_fields(header), b"time")
                yield received, id_, raw[body + 4 : stop]
        except (struct.error, UnicodeDecodeError, BadDataError) as error:
            _break(error, at)
        at = stop


def _break(reason: object, at: int) -> NoReturn:
    raise BrokenChunkError(reason, at)


def _message_of(header: bytes, data: bytes, learn: Callable[[Fields, bytes], None]) -> int | None:
    """Return the connection of a message; None for a connection, which is added."""
    fields = _fields(header)
    kind = _number(fields, b"op", 1)
    if kind == _MESSAGE:
        return _number(fields, b"conn", 4)
    if kind != _CONNECTION:
        raise BadDataError(f"in a chunk a record of kind {kind}, which does not belong there")
    learn(fields, data)
    return None


def _fields(header: bytes) -> Fields:
    fields = {}
    at = 0
    while at < len(header):
        (size,) = _u32(header, at)
        name, equals, value = header[at + 4 : at + 4 + size].partition(b"=")
        if not equals or at + 4 + size > len(header):
            raise BadDataError("a header whose fields are broken")
        fields[name] = value
        at += 4 + size
    return fields


def _number(fields: Fields, name: bytes, width: int) -> int:
    value = fields.get(name, b"")
    if len(value) != width:
        raise BadDataError(f"a record without its field {name.decode()!r}")
    return int.from_bytes(value, "little")


def _time_of(fields: Fields, name: bytes) -> int:
    value = _number(fields, name, 8)
    return (value & 0xFFFFFFFF) * 1_000_000_000 + (value >> 32)


def _connection(fields: Fields, data: bytes) -> _Connection:
    inner = _fields(data)
    topic = fields.get(b"topic", b"").decode()
    name = inner.get(b"type", b"").decode()
    caller = inner.get(b"callerid", b"").decode()
    if not topic or not name:
        raise BadDataError("a connection without a topic or a type")
    package, slash, message = name.partition("/")
    kind = f"{package}/msg/{message}" if slash and "/" not in message else name
    lead = "/" if topic.startswith("/") else ""
    return _Connection(lead + "/".join(filter(None, topic.split("/"))), kind, caller)

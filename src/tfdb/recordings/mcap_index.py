"""Records of MCAP files (https://mcap.dev/spec): the index of a file, its summary, its chunks."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tfdb.data.counting import counted

from .containers import NO_START, is_read_type
from .raw_file import BadDataError, BrokenChunkError
from .tf_definition import LOST, STATE, STORE

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb._core import Recorded

    from .raw_file import RawFile

MAGIC = b"\x89MCAP0\r\n"
NAMES = (
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
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX = range(1, 9)
ATTACHMENT, STATISTICS, METADATA, DATA_END = 0x09, 0x0B, 0x0C, 0x0F
# Records that the format forbids elsewhere. Unknown kinds are allowed everywhere.
IN_CHUNK = frozenset({SCHEMA, CHANNEL, MESSAGE})
IN_DATA = IN_CHUNK | {CHUNK, MESSAGE_INDEX, ATTACHMENT, METADATA, DATA_END}
KNOWN = frozenset(range(1, len(NAMES)))
IN_SUMMARY = KNOWN - IN_DATA - {HEADER, FOOTER} | {SCHEMA, CHANNEL}
# Opcode and length.
RECORD = struct.Struct("<BQ")
HEAD = 9
FOOTER_SIZE = HEAD + 20 + len(MAGIC)
DATA_END_SIZE = HEAD + 4
CHUNK_HEAD = struct.Struct("<QQQI")
_PAIR = struct.Struct("<HQ")
_LOST_HEAD = struct.pack("<I", len(LOST)) + LOST.encode()
_PIECE = 2**20
WRONG_DATA = "data whose checksum is wrong"


@dataclass(frozen=True)
class Channel:
    """One stream of messages."""

    schema: int
    topic: str
    encoding: str


@dataclass(frozen=True)
class ChunkPlace:
    """The position of a chunk and its message indexes, its times and channels (empty: any)."""

    position: int
    end: int
    start: int
    last: int
    channels: frozenset[int]


@dataclass
class Index:
    """The index of a file's messages: their streams, positions and counts.

    `data_crc` is the checksum of all bytes before the end of the data; None if the summary states
    another position of this end. `flaws` are violations of the format in well-formed records, each
    with the bytes that it loses.
    """

    schemas: dict[int, str] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkPlace] = field(default_factory=list)
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
        return (f"{text}: the recorder did not keep up",) if self.lost else ()

    def learn(self, kind: int, data: bytes) -> None:
        """Add a schema, channel, chunk index, statistics or metadata record."""
        fields = Fields(data)
        if kind == SCHEMA:
            id_, name = fields.number(2), fields.text()
            if id_ and self.schemas.setdefault(id_, name) != name:
                self.flaws[f"schema {id_} is declared again as {name!r}"] += 0
                if is_read_type(name) and not is_read_type(self.schemas[id_]):
                    self.schemas[id_] = name  # a damaged name is not readable
        elif kind == CHANNEL:
            id_ = fields.number(2)
            channel = Channel(fields.number(2), fields.text(), fields.text())
            if self.channels.setdefault(id_, channel) != channel:
                self.flaws[f"channel {id_} is declared again, on {channel.topic!r}"] += 0
            if channel.topic == STATE:
                self.store = fields.texts().get(STORE, "")
        elif kind == CHUNK_INDEX:
            start, last, position = fields.number(8), fields.number(8), fields.number(8)
            end = position + fields.number(8)
            channels = frozenset(fields.pairs())
            self.chunks.append(ChunkPlace(position, end + fields.number(8), start, last, channels))
        elif kind == STATISTICS:
            count = fields.number(8)
            fields.skip(2 + 4 + 4 + 4)
            self.chunk_count, start = fields.number(4), fields.number(8)
            fields.number(8)
            counts, self.start = fields.pairs(), start if count else NO_START
            if counts and sum(counts.values()) != count:
                self.flaws[f"statistics that do not add up to {count} messages"] += 0
            else:
                self.counts = counts
        elif kind == METADATA and data.startswith(_LOST_HEAD):
            fields.text()
            commits = fields.texts().get("commits", "")
            self.lost += int(commits) if commits.isdecimal() else 0

    def learn_in_chunk(self, kind: int, data: bytes) -> None:
        """Add a record of a chunk that is not a message, or is too short for one."""
        if kind == MESSAGE:
            self.flaws[f"a message of {len(data)} bytes, too short for one"] += HEAD + len(data)
        elif kind in IN_CHUNK:
            self.learn(kind, data)
        else:
            self.flaws[f"{NAMES[kind]} within a chunk"] += HEAD + len(data)

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
        """Return the name of a channel's schema; empty if it has none."""
        return self.schemas.get(self.channels[channel].schema, "")


class Fields:
    """Reads the fields of a record one after the other."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    def number(self, width: int) -> int:
        """Read a number of `width` bytes."""
        return int.from_bytes(self._take(width), "little")

    def text(self) -> str:
        """Read a text."""
        return self._take(self.number(4)).decode()

    def pairs(self) -> dict[int, int]:
        """Read a map from ids to numbers."""
        data = self._take(self.number(4))
        return dict(_PAIR.iter_unpack(data))

    def texts(self) -> dict[str, str]:
        """Read a map from texts to texts."""
        fields, found = Fields(self._take(self.number(4))), {}
        while fields._at < len(fields._data):
            name = fields.text()
            found[name] = fields.text()
        return found

    def skip(self, width: int) -> None:
        """Skip `width` bytes."""
        self._take(width)

    def _take(self, width: int) -> bytes:
        taken = self._data[self._at : self._at + width]
        if len(taken) != width:
            raise BadDataError(f"a record of {len(self._data)} bytes ends within a field")
        self._at += width
        return taken


def has_end(file: RawFile) -> bool:
    """Return whether the file ends as an MCAP file does."""
    if file.size < len(MAGIC) + FOOTER_SIZE:
        return False
    return file.read(file.size - len(MAGIC), len(MAGIC)) == MAGIC


def read_summary(file: RawFile, index: Index) -> None:
    """Add the summary, if the file has one, to an empty index."""
    end = file.size - FOOTER_SIZE
    footer = Fields(file.read(end, FOOTER_SIZE))
    if (footer.number(1), footer.number(8)) != (FOOTER, 20):
        raise BadDataError("no footer at its end")
    start = at = footer.number(8)
    footer.skip(8)
    crc = footer.number(4)
    while 0 < at < end:
        kind, size = RECORD.unpack(file.read(at, HEAD))
        if kind < len(NAMES) and kind not in IN_SUMMARY:
            raise BadDataError(f"{NAMES[kind]} in its summary, at {at}")
        if kind in (SCHEMA, CHANNEL, CHUNK_INDEX, STATISTICS):
            index.learn(kind, file.read(at + HEAD, size))
        at += HEAD + size
    if at > end:
        raise BadDataError("its summary goes beyond its end")
    index.chunks.sort(key=lambda each: each.position)
    if len({chunk.position for chunk in index.chunks}) != len(index.chunks):
        raise BadDataError("its summary names the same chunk twice")
    if start and crc and crc != Checksum(file, start).up_to(end + HEAD + 16):
        raise BadDataError("a summary whose checksum is wrong")
    index.summary = start
    if start >= len(MAGIC) + DATA_END_SIZE:
        data_end = file.read(start - DATA_END_SIZE, DATA_END_SIZE)
        if RECORD.unpack_from(data_end) == (DATA_END, 4):
            index.data_crc = int.from_bytes(data_end[HEAD:], "little")


class Checksum:
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


def parse_chunk(record: bytes, *, cut: bool = False) -> tuple[str, memoryview, int, int]:
    """Parse a chunk: compression, compressed records, their original size and checksum."""
    _, _, unpacked, crc = CHUNK_HEAD.unpack_from(record)
    fields = Fields(record)
    fields.skip(CHUNK_HEAD.size)
    packing = fields.text()
    size = fields.number(8)
    start = CHUNK_HEAD.size + 4 + len(packing.encode()) + 8
    packed = memoryview(record)[start : start + size]
    if len(packed) != size and not cut:
        raise BadDataError("a chunk that ends within its records")
    return packing, packed, unpacked, crc


def checked(raw: bytes | memoryview, crc: int) -> bytes | memoryview:
    """Return the bytes. Raises BadDataError if they have another checksum; 0: they have none."""
    if crc and zlib.crc32(raw) != crc:
        raise BadDataError("a chunk whose checksum is wrong")
    return raw


def start_of_chunk(record: bytes) -> int:
    """Return the time of a chunk's first message, as its head states it."""
    start: int = CHUNK_HEAD.unpack_from(record)[0]
    return start


def other_start(at: int) -> str:
    """Describe a chunk whose time differs from that in the summary."""
    return f"the chunk at {at} begins at another time than its summary states"


def no_chunk(at: int) -> str:
    """Describe a missing chunk of the summary."""
    return f"no chunk at {at}, where the summary has one"


def add_chunk(
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

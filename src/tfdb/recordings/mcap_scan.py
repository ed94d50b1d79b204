"""Scans MCAP files whose summary does not list everything, or that are damaged.

After damage, `salvage` continues with the next chunk. In files without chunks, and in chunks
without a checksum, it continues with the next message.
"""

from __future__ import annotations

import re
import struct
from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tfdb._core import Recorded

from .mcap_index import (
    CHANNEL,
    CHUNK,
    CHUNK_HEAD,
    DATA_END,
    FOOTER,
    FOOTER_SIZE,
    HEAD,
    HEADER,
    IN_DATA,
    IN_SUMMARY,
    KNOWN,
    MAGIC,
    MESSAGE,
    MESSAGE_INDEX,
    METADATA,
    NAMES,
    RECORD,
    SCHEMA,
    WRONG_DATA,
    Checksum,
    ChunkPlace,
    Fields,
    Index,
    add_chunk,
    checked,
    has_end,
    no_chunk,
    other_start,
    parse_chunk,
    start_of_chunk,
)
from .raw_file import BadDataError, unpack, unpack_the_start
from .record_search import Chunk, find_record

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from .containers import Gathered, Payload
    from .raw_file import Packed, RawFile
    from .record_search import Bytes

# A message of less than 4 GiB; a chunk of less than 1 TiB.
_MESSAGE_HEADS = re.compile(rb"\x05.{4}\0{4}", re.DOTALL)
_CHUNK_HEADS = re.compile(rb"\x06.{5}\0{3}.{28}(?:\0{4}|\x03\0{3}lz4|\x04\0{3}zstd)", re.DOTALL)
_FOLLOWING = 3
"""Number of valid records in a row that show that a message begins."""


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


class Scan:
    """Scans the records of a file for messages.

    Adds schemas and channels to `index`, and misplaced records to its flaws. With `strict` it
    raises at the first damage. Otherwise it continues at the next record after the damage, or
    with the next chunk of the summary.
    """

    def __init__(
        self, file: RawFile, index: Index, found: Gathered, *, strict: bool = False
    ) -> None:
        self._file = file
        self._index = index
        self._found = found
        self._strict = strict
        # A cut file has no end record: all bytes count as records.
        self._end = file.size - FOOTER_SIZE if has_end(file) else file.size
        self._chunks: list[int] = []
        self._starts: dict[int, int] = {}
        self._missing: set[int] = set()
        self._is_in_data = True
        self._has_chunks: bool | None = None  # not known yet
        self._last = _LastChunk()

    def run(self, chunks: Iterable[ChunkPlace], *, are_sure: bool) -> None:
        """Scan the file. `chunks` are the summary's; `are_sure`: the summary is undamaged."""
        starts = {chunk.position: chunk.start for chunk in chunks}
        self._chunks = sorted(filter(self._has_chunk, starts))
        self._has_chunks = True if starts else None
        if are_sure:
            self._starts = starts
            self._missing = starts.keys() - self._chunks
        if self._strict:
            self._note_missing()
        at = len(MAGIC)
        while at < self._end:
            end = self._end
            try:
                kind, size = RECORD.unpack(self._file.read(at, HEAD))
                if (kind, size) == (FOOTER, 20) and at + FOOTER_SIZE >= self._file.size:
                    break
                end = at + HEAD + size
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
            self._note(no_chunk(place))

    def _step(self, kind: int, at: int, size: int) -> int:
        """Read the record at `at`; return the next position."""
        end = at + HEAD + size
        if kind != MESSAGE_INDEX or at in self._missing:
            self._last.is_followed = True
        if at in self._missing:
            self._missing.remove(at)
            raise BadDataError(no_chunk(at))
        self._check_place(kind, at)
        over = self._within(at, end)
        reason = f"a record at {at} overlaps the chunk at {over}"
        if over is not None and kind != CHUNK:
            raise BadDataError(reason)
        reasons = len(self._found.reasons)
        self._gather(kind, at, size)
        if over is None:
            is_damaged = len(self._found.reasons) > reasons or not self._has_record(end)
            if self._strict or (kind in KNOWN and not is_damaged):
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
        if at == len(MAGIC):
            if kind != HEADER:
                self._note("no header at its beginning")
        elif kind in KNOWN - (IN_DATA if self._is_in_data else IN_SUMMARY):
            where = "before" if self._is_in_data else "after"
            self._note(f"{NAMES[kind]} {where} the end of its data")

    def _gather(self, kind: int, at: int, size: int) -> None:
        """Read one record."""
        there = min(size, self._file.size - at - HEAD)
        if kind == 0 or (there < size and (self._strict or kind != CHUNK)):
            raise BadDataError(f"an incomplete record of {size} bytes at {at}")
        if kind == CHUNK:
            if _find_chunk(self._file, at, at + 1) == at:
                self._has_chunks = True
            record = self._file.read(at + HEAD, there)
            before = len(self._found.messages)
            self._gather_chunk(record, size)
            if len(self._found.messages) > before:
                self._has_chunks = True
            if self._starts.get(at, start := start_of_chunk(record)) != start:
                self._note(other_start(at))
        elif kind in (SCHEMA, CHANNEL, METADATA):
            self._index.learn(kind, self._file.read(at + HEAD, size))
        elif kind == MESSAGE_INDEX:
            self._gather_message_index(self._file.read(at + HEAD, size))
        elif kind == MESSAGE:
            self._take(self._file.read(at, HEAD + size))
        elif kind == DATA_END and self._is_in_data:
            self._is_in_data = False
            self._end_data(at, size)

    def _gather_message_index(self, record: bytes) -> None:
        """Expect the messages of an index that its chunk did not have."""
        fields = Fields(record)
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
        crc = Fields(self._file.read(at + HEAD, size)).number(4)
        if crc and crc != Checksum(self._file).up_to(at):
            self._note(WRONG_DATA)
        if self._index.summary not in (0, at + HEAD + size):
            self._note("a summary that does not begin right after the end of its data")

    def _gather_chunk(self, record: bytes, size: int) -> None:
        """Read the messages of a chunk; without `strict` it may be cut or damaged."""
        reason: Exception | None = None
        try:
            parts = parse_chunk(record)
        except BadDataError as error:
            if self._strict:
                raise
            parts, reason = parse_chunk(record, cut=True), error
        packing, packed, unpacked, crc = parts
        self._last = _LastChunk()
        try:
            raw = checked(unpack(packing, packed, unpacked), crc)
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
        if not len(MAGIC) <= at <= self._end - HEAD:
            return False
        kind, size = RECORD.unpack(self._file.read(at, HEAD))
        return bool(kind == CHUNK and at + HEAD + size <= self._end)

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
        if at > self._end - HEAD:
            return at == self._end
        kind, size = RECORD.unpack(self._file.read(at, HEAD))
        return kind in KNOWN and at + HEAD + size <= self._end


def _find_chunk(data: Bytes, at: int, end: int) -> int:
    """Return the first position in a range at which a chunk begins, or its end."""

    def start_of(place: int) -> int | None:
        head = place + HEAD + CHUNK_HEAD.size
        if head + 16 > data.size:
            return None
        length = int.from_bytes(data.read(place + 1, 8), "little")
        packing = int.from_bytes(data.read(head, 4), "little")
        packed = int.from_bytes(data.read(head + 4 + packing, 8), "little")
        return place if length == CHUNK_HEAD.size + 4 + packing + 8 + packed else None

    return find_record(data, _CHUNK_HEADS, at, end, start_of)


def _find_message(data: Bytes, at: int, end: int, index: Index) -> int:
    """Return the first position in a range at which a message begins, or its end.

    Its channel is declared, if any is yet, and valid records follow it.
    """

    def start_of(place: int) -> int | None:
        following = place
        for number in range(_FOLLOWING):
            if following + HEAD + 2 > data.size:
                return place if number else None
            kind, length = RECORD.unpack(data.read(following, HEAD))
            channel = int.from_bytes(data.read(following + HEAD, 2), "little")
            following += HEAD + length
            if kind not in KNOWN or following > data.size:
                return None
            if kind == MESSAGE and index.channels and channel not in index.channels:
                return None
        return place

    return find_record(data, _MESSAGE_HEADS, at, end, start_of)


def _messages_in(
    raw: bytes | memoryview,
    wanted: Callable[[int], bool],
    learn: Callable[[int, bytes], None],
) -> Iterator[Payload]:
    """Return the selected messages of a chunk in its order; add its other records."""
    found = Recorded()
    try:
        add_chunk(found, raw, wanted, learn)
    finally:  # damage ends the chunk; the messages before it are read
        yield from map(found.__getitem__, range(len(found)))

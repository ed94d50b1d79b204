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

import struct
from collections import Counter
from dataclasses import dataclass
from itertools import accumulate, repeat
from typing import TYPE_CHECKING

from tfdb._core import Recorded
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
    plain_type,
    typed_errors,
    unpacked,
)
from .mcap_index import (
    CHANNEL,
    CHUNK,
    DATA_END,
    DATA_END_SIZE,
    FOOTER,
    HEAD,
    HEADER,
    IN_DATA,
    KNOWN,
    MAGIC,
    MESSAGE,
    METADATA,
    RECORD,
    SCHEMA,
    WRONG_DATA,
    Checksum,
    ChunkPlace,
    Index,
    add_chunk,
    checked,
    has_end,
    no_chunk,
    other_start,
    parse_chunk,
    read_summary,
    start_of_chunk,
)
from .mcap_scan import Scan
from .raw_file import BadDataError, RawFile, unpack

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Iterator
    from pathlib import Path

    from .containers import Payload

# Parts with fewer messages are not worth their cost.
_PART = 256
_LATEST = 2**64 - 1


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
    if not has_end(file):
        reason = f"cut short, its end is missing: `mcap recover` saves the rest; {SALVAGE}"
        raise RecordingError(path, reason)
    index = Index()
    read_summary(file, index)
    if index.is_whole() and _is_covered(file, index):
        return _indexed(path, file, index)
    gathered, index.lost = Gathered(), 0
    Scan(file, index, gathered, strict=True).run(index.chunks, are_sure=True)
    scanned = _scanned(path, file, index, gathered)
    if scanned.losses:
        raise BadDataError(scanned.losses[0].reason)
    if index.counts and (more := gathered.found() - gathered.promised):
        raise BadDataError(f"{more.total()} more messages than in its statistics")
    return scanned


def _is_covered(file: RawFile, index: Index) -> bool:
    """Return whether the data are a header, the summary's chunks, and valid records between."""
    end = index.summary - DATA_END_SIZE
    places = [(chunk.position, chunk.end) for chunk in index.chunks]
    forbidden = {0, *KNOWN} - IN_DATA | {CHUNK, DATA_END}
    kind, size = RECORD.unpack(file.read(len(MAGIC), HEAD))
    if kind != HEADER:
        return False
    at = len(MAGIC) + HEAD + size
    for place, behind in [*places, (end, end)]:
        while at < place:
            kind, size = RECORD.unpack(file.read(at, HEAD))
            if kind in forbidden:
                return False
            if kind == METADATA:
                index.learn(kind, file.read(at + HEAD, size))
            at += HEAD + size
        if at != place:
            return False
        at = behind
    return True


def _indexed(path: Path, file: RawFile, index: Index) -> Container:
    counts = index.counts or {}
    sources = _sources(path, index, counts)

    def add(
        found: Recorded, chunk: ChunkPlace, ids: Collection[int], *, is_checked: bool = False
    ) -> None:
        raw = _raw(file, chunk, is_checked=is_checked)
        add_chunk(found, raw, lambda id_: index.is_read(id_) and id_ in ids, index.learn_in_chunk)
        index.refuse_flaws()

    def messages_of(chunk: ChunkPlace, ids: Collection[int]) -> Iterable[Payload]:
        add(found := Recorded(), chunk, ids)
        return map(found.__getitem__, range(len(found)))

    def payloads(ids: Collection[int], since: int) -> Iterator[Payload]:
        wanted = ((each.start, each) for each in _chunks_of(index, ids) if each.last >= since)
        yield from in_order(wanted, lambda chunk: messages_of(chunk, ids))
        if not since:
            _check_data(index, Checksum(file))

    def survey(
        ids: Collection[int], step: Callable[[int], None]
    ) -> tuple[dict[int, int], bool, Iterator[Recorded]]:
        found_by_id: Counter[int] = Counter()
        packed = False
        spans = []
        checksum = Checksum(file)
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


def _chunks_of(index: Index, ids: Collection[int]) -> list[ChunkPlace]:
    # Without message indexes, the content of a chunk is unknown until it is read.
    return [c for c in index.chunks if not c.channels or not c.channels.isdisjoint(ids)]


@dataclass(frozen=True)
class _Span:
    """Return the number of selected messages in a chunk, and the first and last of their times."""

    chunk: ChunkPlace
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
    summary = index = Index()
    gathered = Gathered()
    if file.read(0, len(MAGIC)) != MAGIC:
        gathered.lose(0, OTHER_START)
    try:
        if has_end(file):
            read_summary(file, summary)
    except (BadDataError, struct.error, UnicodeDecodeError) as error:
        gathered.lose(0, error)
        index = Index()  # only the chunk positions of a damaged summary are used
    Scan(file, index, gathered).run(summary.chunks, are_sure=index is summary)
    if not has_end(file) and not gathered.reasons:
        gathered.lose(0, "cut short, its end is missing")
    return _scanned(path, file, index, gathered)


def _scanned(path: Path, file: RawFile, index: Index, gathered: Gathered) -> Container:
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


def _sources(path: Path, index: Index, counts: dict[int, int]) -> dict[int, Source]:
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


def _topics(index: Index, counts: dict[int, int]) -> Iterator[Topic]:
    return (
        Topic(channel.topic, index.type_of(id_), counts.get(id_, 0))
        for id_, channel in index.channels.items()
    )


def _check_data(index: Index, checksum: Checksum) -> None:
    if index.data_crc and checksum.up_to(index.summary - DATA_END_SIZE) != index.data_crc:
        raise BadDataError(WRONG_DATA)


def _raw(file: RawFile, chunk: ChunkPlace, *, is_checked: bool = False) -> bytes | memoryview:
    """Return the records of a chunk of the summary, decompressed and verified once."""
    kind, size = RECORD.unpack(file.read(chunk.position, HEAD))
    if kind != CHUNK:
        raise BadDataError(no_chunk(chunk.position))
    record = file.read(chunk.position + HEAD, size)
    packing, packed, unpacked, crc = parse_chunk(record)
    if start_of_chunk(record) != chunk.start:
        raise BadDataError(other_start(chunk.position))
    return checked(unpack(packing, packed, unpacked), 0 if is_checked else crc)


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
        self._index = Index()
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
        head = len(MAGIC) if self._at == 0 else HEAD
        if self._at + head > self.size:
            return None
        raw = self._file.read(self._at, head)
        if self._at == 0:
            if raw != MAGIC:
                raise RecordingError(
                    self.path, "not an MCAP file; only .mcap files can be read while they grow"
                )
            return head
        kind, size = RECORD.unpack(raw)
        if kind == 0:
            raise BadDataError(f"no record at {self._at}")
        end: int = self._at + HEAD + size + (len(MAGIC) if kind == FOOTER else 0)
        return end if end <= self.size else None

    def _take(self, end: int, found: Recorded) -> None:
        """Read the record at the position."""
        if self._at == 0:
            return
        kind, size = RECORD.unpack(self._file.read(self._at, HEAD))
        index, at = self._index, self._at + HEAD
        if kind == FOOTER:
            self.is_complete = True
        elif kind in (SCHEMA, CHANNEL):
            index.learn(kind, self._file.read(at, size))
        elif kind == CHUNK:
            packing, packed, unpacked, crc = parse_chunk(self._file.read(at, size))
            raw = checked(unpack(packing, packed, unpacked), crc)
            add_chunk(found, raw, index.is_read, index.learn_in_chunk)
        elif kind == MESSAGE:
            raw = self._file.read(self._at, end - self._at)
            add_chunk(found, raw, index.is_read, index.learn_in_chunk)
        index.refuse_flaws()

"""The commits of recorded files, for `Buffer.apply`."""

from __future__ import annotations

from contextlib import closing
from itertools import dropwhile
from typing import TYPE_CHECKING, NamedTuple

from tfdb._core import commit_of_messages
from tfdb.data.argument_checks import check_flag
from tfdb.data.errors import RecordingError
from tfdb.data.path_checks import check_paths, errors_name
from tfdb.data.sample_heads import epoch_of, numbers_of
from tfdb.recordings.tf_definition import STATE

from .channels import (
    COMMITS,
    SEQUENCES,
    TF,
    TF_STATIC,
    missing,
    unwrapped,
)

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator, Sequence
    from pathlib import Path
    from typing import BinaryIO

    from mcap.records import ChunkIndex, Message

    from tfdb.data.types import Paths

_TOPICS = (STATE, COMMITS, TF_STATIC, TF)
_RECORD_HEAD = 9
"""Bytes of a record's kind and length."""


class RecordedCommit(NamedTuple):
    """One commit of a recorded store, or its state, as bytes for `Buffer.apply`."""

    time: int
    """The time at which the recorder read it, nanoseconds."""
    commit: int
    """Its number in the recorded store."""
    is_state: bool
    """Whether it is a state; the first one always is."""
    data: bytes


def recorded_commits(path: Paths, *, salvage: bool = False) -> Iterator[RecordedCommit]:
    """Read the commits of a `Recorder`'s files, in order.

    A store that applies all of them equals the recorded one, with clears, removals and authorities.
    Of the samples before the recording, only the newest of each edge is included.

    Parameters
    ----------
    path
        A file, or the files of one recording.
    salvage
        Read cut or damaged files, each up to the damage.

    Raises
    ------
    RecordingError
        A file is damaged, cut short, or not written by a `Recorder`. Fields: path, reason.
    NotSupported
        PyPI's mcap is not installed.
    OSError
        A file cannot be read.
    """
    check_flag("salvage", salvage)
    return _commits_of(check_paths(path, RecordingError), salvage=salvage)


class RecordedFiles:
    """Recorded files, which can be read from any commit on. Threads: one.

    Raises as `recorded_commits`.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        heads = [_head(path) for path in paths]
        self.stores: int = len({head.epoch for head in heads})
        """Number of recorded stores. Only the commits of a single store can be read."""
        self._paths = _in_order(heads)
        self._indexes: dict[Path, _Index | None] = {}

    def commits(self, since: int, after: bytes) -> Iterator[RecordedCommit]:
        """Read the commits after the commit `after`, which was recorded at `since` (ns).

        Raises as `recorded_commits`.
        """
        reader = _Reader(after)
        for path in self._paths:
            if after and path not in self._indexes:
                self._indexes[path] = _index_of(path)
            index = self._indexes.get(path) if after else None
            for topic, message in _messages(path, index=index, since=since):
                yield from reader.take(topic, message)
            yield from reader.end()


def _commits_of(paths: list[Path], *, salvage: bool) -> Iterator[RecordedCommit]:
    reader = _Reader(b"")
    if len(paths) > 1:
        paths = _in_order([_head(path, salvage=salvage) for path in paths])
    for path in paths:
        for topic, message in _messages(path, salvage=salvage):
            yield from reader.take(topic, message)
        yield from reader.end()


class _Head(NamedTuple):
    """The beginning of a file."""

    path: Path
    epoch: bytes
    commit: int


def _head(path: Path, *, salvage: bool = False) -> _Head:
    with closing(_messages(path, salvage=salvage)) as messages:
        _, first = next(messages)
    sample = unwrapped(first.data)
    return _Head(path, epoch_of(sample), numbers_of(sample)[1])


def _in_order(heads: Sequence[_Head]) -> list[Path]:
    """Sort the files of each store by their first commit."""
    stores = [head.epoch for head in heads]
    ordered = sorted(heads, key=lambda head: (stores.index(head.epoch), head.commit))
    return [head.path for head in ordered]


class _Index(NamedTuple):
    """The positions of a file's messages."""

    topics: dict[int, str]
    """tfdb's own topics, by channel."""
    chunks: Sequence[ChunkIndex]
    """In file order."""

    def messages(self, file: BinaryIO, since: int) -> Iterator[tuple[str, Message]]:
        """Read from the chunk on that has the first message at or after a time."""
        from mcap.data_stream import ReadDataStream  # noqa: PLC0415 - mcap is an extra
        from mcap.records import Chunk, Message  # noqa: PLC0415
        from mcap.stream_reader import breakup_chunk  # noqa: PLC0415

        for each in dropwhile(lambda chunk: chunk.message_end_time < since, self.chunks):
            file.seek(each.chunk_start_offset + _RECORD_HEAD)
            chunk = Chunk.read(ReadDataStream(file))
            for record in breakup_chunk(chunk, validate_crc=True):
                if isinstance(record, Message) and record.channel_id in self.topics:
                    yield self.topics[record.channel_id], record


def _index_of(path: Path) -> _Index | None:
    """Read the index at the end of a file; None if it is missing or damaged."""
    from mcap.exceptions import McapError  # noqa: PLC0415 - mcap is an extra
    from mcap.reader import SeekingReader  # noqa: PLC0415

    with errors_name(path), path.open("rb") as file:
        try:
            found = SeekingReader(file).get_summary()
        except (McapError, ValueError):
            return None
    if found is None or found.statistics is None:
        return None
    chunks = sorted(found.chunk_indexes, key=lambda each: each.chunk_start_offset)
    if len(chunks) != found.statistics.chunk_count:
        return None
    channels = found.channels.values()
    return _Index({each.id: each.topic for each in channels if each.topic in _TOPICS}, chunks)


def _messages(
    path: Path, *, salvage: bool = False, index: _Index | None = None, since: int = 0
) -> Generator[tuple[str, Message], None, None]:
    """Yield topic and message of tfdb's topics, in file order; with an index, from `since` on."""
    try:
        from mcap.exceptions import EndOfFile  # noqa: PLC0415 - mcap is an extra
        from mcap.reader import NonSeekingReader  # noqa: PLC0415
    except ImportError as error:
        raise missing("recorded_commits", error) from error
    begun = index is not None
    with errors_name(path), path.open("rb") as file:
        if index is not None:
            messages = index.messages(file, since)
        else:
            reader = NonSeekingReader(file, validate_crcs=True)
            every = reader.iter_messages(_TOPICS, log_time_order=False)
            messages = ((channel.topic, message) for _, channel, message in every)
        try:
            for topic, message in messages:
                if not begun and topic != STATE:
                    break
                begun = True
                yield topic, message
        except OSError:
            raise
        except Exception as error:  # of mcap, and of what unpacks its chunks
            if not salvage:
                cut = isinstance(error, EndOfFile)
                what = "cut short" if cut else f"damaged, or no MCAP file: {error}"
                reason = f"{what}: salvage=True (--salvage) reads as far as possible"
                raise RecordingError(path, reason) from error
    if not begun:
        reason = f"has no {STATE}, with which tfdb.Recorder begins a file: use tfdb.load"
        raise RecordingError(path, reason)


class _Reader:
    """Makes commits from messages. Threads: one."""

    def __init__(self, after: bytes) -> None:
        self._epoch, self._commit = b"", -1
        if after:
            self._epoch, (_, self._commit) = epoch_of(after), numbers_of(after)
        # The commit that is being read.
        self._time = self._next = -1
        self._parts: dict[str, bytes] = {}

    def take(self, topic: str, message: Message) -> Iterator[RecordedCommit]:
        """Add a message; yield the commit that it completes."""
        time, data = message.log_time, message.data
        if topic in (STATE, COMMITS):
            yield from self.end()
            sample = unwrapped(data)
            _, last = numbers_of(sample)
            if last <= self._commit and epoch_of(sample) == self._epoch:
                return  # it begins another file
            self._commit, self._epoch = last, epoch_of(sample)
            yield RecordedCommit(time, last, topic == STATE, sample)
            return
        after = (message.sequence - self._commit) % SEQUENCES
        if after == 0 or after >= SEQUENCES // 2:
            return  # of a commit that was read
        number = self._commit + after
        if number != self._next:
            yield from self.end()
            self._next, self._time = number, time
        self._parts[topic] = data

    def end(self) -> Iterator[RecordedCommit]:
        """Yield the last commit."""
        if self._parts:
            data = commit_of_messages(
                self._epoch,
                self._commit,
                self._next,
                self._parts.get(TF),
                self._parts.get(TF_STATIC),
            )
            self._commit = self._next
            self._parts = {}
            yield RecordedCommit(self._time, self._commit, is_state=False, data=data)

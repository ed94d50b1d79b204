"""The commits of recorded files, for `Buffer.apply`."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from tfdb._core import commit_of_messages
from tfdb.data.argument_checks import check_flag
from tfdb.data.errors import RecordingError
from tfdb.data.path_checks import check_paths, errors_name

from .channels import (
    COMMITS,
    SEQUENCES,
    STATE,
    TF,
    TF_STATIC,
    epoch_of,
    missing,
    numbers_of,
    unwrapped,
)

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from tfdb.data.types import Paths

_TOPICS = (STATE, COMMITS, TF_STATIC, TF)


class RecordedCommit(NamedTuple):
    """One commit of a recorded store, or its state, as bytes for `Buffer.apply`."""

    time: int
    """When the recorder read it, nanoseconds."""
    commit: int
    """Its number in the store that was recorded."""
    is_state: bool
    """Whether it is a state: the first one always is."""
    data: bytes


def recorded_commits(
    path: Paths, *, salvage: bool = False, after: bytes = b""
) -> Iterator[RecordedCommit]:
    """Read the commits of what a `Recorder` wrote, in their order.

    A store that applies all of them is equal to the one that was recorded, with clears, removals
    and authorities. Samples from before the recording are missing, but for the newest of each edge.

    Parameters
    ----------
    path
        A file, or the files of one recording in their order.
    salvage
        Read files that were cut short or damaged, each up to there.
    after
        Bytes of a commit or state of the same recording: only later commits are read.

    Raises
    ------
    RecordingError
        A file is damaged, cut short, or none of a `Recorder`. Fields: path, reason.
    NotSupported
        PyPI's mcap is not installed.
    OSError
        A file cannot be read.
    """
    check_flag("salvage", salvage)
    return _commits_of(check_paths(path, RecordingError), after, salvage=salvage)


def _commits_of(paths: list[Path], after: bytes, *, salvage: bool) -> Iterator[RecordedCommit]:
    reader = _Reader(after)
    for path in paths:
        for topic, time, sequence, data in _messages(path, salvage=salvage):
            yield from reader.take(topic, time, sequence, data)
        yield from reader.end()


def _messages(path: Path, *, salvage: bool) -> Iterator[tuple[str, int, int, bytes]]:
    """Topic, time, sequence and bytes of each message that tfdb knows, in the file's order."""
    try:
        from mcap.exceptions import EndOfFile  # noqa: PLC0415 - mcap is an extra
        from mcap.reader import NonSeekingReader  # noqa: PLC0415
    except ImportError as error:
        raise missing("recorded_commits", error) from error
    begun = False
    with errors_name(path), path.open("rb") as file:
        reader = NonSeekingReader(file, validate_crcs=True)
        try:
            for _, channel, message in reader.iter_messages(_TOPICS, log_time_order=False):
                if not begun and channel.topic != STATE:
                    break
                begun = True
                yield channel.topic, message.log_time, message.sequence, message.data
        except OSError:
            raise
        except Exception as error:  # of mcap, and of what unpacks its chunks
            if not salvage:
                cut = isinstance(error, EndOfFile)
                what = "cut short" if cut else f"damaged, or no MCAP file: {error}"
                reason = f"{what}: salvage=True (--salvage) reads as far as it goes"
                raise RecordingError(path, reason) from error
    if not begun:
        reason = f"has no {STATE}, with which tfdb.Recorder begins a file: use tfdb.load"
        raise RecordingError(path, reason)


class _Reader:
    """Makes commits of messages. Threads: one."""

    def __init__(self, after: bytes) -> None:
        self._epoch, self._commit = b"", -1
        if after:
            self._epoch, (_, self._commit) = epoch_of(after), numbers_of(after)
        # Of the commit that is being read.
        self._time = self._next = -1
        self._parts: dict[str, bytes] = {}

    def take(self, topic: str, time: int, sequence: int, data: bytes) -> Iterator[RecordedCommit]:
        """Take a message; yields a commit that is complete."""
        if topic in (STATE, COMMITS):
            yield from self.end()
            sample = unwrapped(data)
            _, last = numbers_of(sample)
            if last <= self._commit and epoch_of(sample) == self._epoch:
                return  # it begins another file
            self._commit, self._epoch = last, epoch_of(sample)
            yield RecordedCommit(time, last, topic == STATE, sample)
            return
        after = (sequence - self._commit) % SEQUENCES
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

"""Tapes for the player: the messages of recordings, or the commits of a recorder."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, NamedTuple

from tfdb._core import Buffer, Recorded
from tfdb.recordings.recording import Run, runs_of
from tfdb.recordings.rewriter import Rewriter
from tfdb.recordings.tf_definition import STATE
from tfdb.streams.rows import of_bytes

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tfdb.recorder.commit_reader import RecordedFiles
    from tfdb.recordings.containers import Source
    from tfdb.recordings.load_report import Tally
    from tfdb.recordings.open_recordings import OpenRecordings

_RECORDED = "recorded"
"""The source of recorded commits, in the private store."""


class Part(NamedTuple):
    """A message or a commit, and its receive time (nanoseconds)."""

    received: int
    data: bytes
    source: int = 0
    """Number of a message's source."""


class Tape(ABC):
    """The parts of recordings, sorted by receive time, and the store that they fill.

    Threads: one.
    """

    shifts: bool = True
    """Whether `shift` may be set."""
    shift: int = 0
    """Nanoseconds to add to the stamps of later parts."""

    @abstractmethod
    def begin(self, history: float | None) -> Buffer:
        """Return the store before the first part."""

    @abstractmethod
    def parts(self, received: int, state: bytes) -> Iterator[Part]:
        """Read the parts that were received after a state of `keep`."""

    @abstractmethod
    def store(self, parts: Sequence[Part], store: Buffer, tally: Tally | None) -> None:
        """Store parts, and count them if a tally is given."""

    @abstractmethod
    def keep(self, store: Buffer) -> bytes:
        """Return the newest state of a store, for `restore`."""

    @abstractmethod
    def restore(self, state: bytes, history: float | None) -> Buffer:
        """Return a store with a kept state."""

    @property
    def takes_no_time(self) -> bool:
        """Return whether the next part is before the selected time, and so is played at once."""
        return False


class MessageTape(Tape):
    """The wanted messages of recordings, file by file."""

    def __init__(self, recordings: OpenRecordings, rewriter: Rewriter) -> None:
        self._recordings, self._rewriter = recordings, rewriter
        self._choice = recordings.choice
        every = (source for each in recordings.files for source in each.all_sources)
        self._sources: dict[int, Source] = dict(enumerate(every))
        # Containers give the same object for the same source.
        self._numbers = {id(source): number for number, source in self._sources.items()}

    @property
    def shift(self) -> int:
        """See `Tape`."""
        return self._rewriter.shift

    @shift.setter
    def shift(self, nanoseconds: int) -> None:
        self._rewriter.shift = nanoseconds

    @property
    def takes_no_time(self) -> bool:
        """See `Tape`. Messages before `--start` are played at once."""
        return self._rewriter.window[0] is not None and not self._rewriter.moving

    def begin(self, history: float | None) -> Buffer:
        """See `Tape`. The store has the fixed joints of a robot model."""
        made = Buffer(history)
        if fixed := self._rewriter.fixed_joints():
            made.set_transforms(fixed, static=True, authority=self._rewriter.model_name)
        return made

    def parts(self, received: int, _state: bytes) -> Iterator[Part]:
        """See `Tape`."""
        for recording in self._recordings.files:
            for source, time, data in recording.messages(self._choice.wants, received + 1):
                yield Part(time, data, self._numbers[id(source)])

    def store(self, parts: Sequence[Part], store: Buffer, tally: Tally | None) -> None:
        """See `Tape`."""
        for run in self._runs(parts):
            if tally is not None:
                tally.store(run, self._choice, self._rewriter)
                continue
            encoding, static = self._choice.kind(run.source)
            self._rewriter.ingest(run, store, encoding, static, authorities=run.authorities)

    def keep(self, store: Buffer) -> bytes:
        """See `Tape`."""
        with store.snapshot() as state:
            return state.state_bytes()

    def restore(self, state: bytes, history: float | None) -> Buffer:
        """See `Tape`."""
        made = Buffer(history)
        made.apply(state, source=_RECORDED)
        made.forget_source(_RECORDED)
        return made

    def _runs(self, parts: Sequence[Part]) -> Iterator[Run]:
        """Return messages as runs that are stored alike."""
        recorded = Recorded()
        for received, data, source in parts:
            recorded.add(received, source, data)
        return runs_of(recorded, self._sources, self._choice.wants, self._choice.kind)


class CommitTape(Tape):
    """The commits that `tfdb.Recorder` wrote, with clears, removals and authorities."""

    shifts = False

    def __init__(self, files: RecordedFiles) -> None:
        self._files = files

    def begin(self, history: float | None) -> Buffer:
        """See `Tape`."""
        return Buffer(history)

    def parts(self, received: int, state: bytes) -> Iterator[Part]:
        """See `Tape`."""
        for each in self._files.commits(received, state):
            yield Part(each.time, each.data)

    def store(self, parts: Sequence[Part], store: Buffer, tally: Tally | None) -> None:
        """See `Tape`."""
        for part in parts:
            store.apply(part.data, source=_RECORDED)
            if tally is not None:
                tally.messages += 1
                tally.transforms += len(of_bytes(part.data)[1])

    def keep(self, store: Buffer) -> bytes:
        """See `Tape`."""
        return store._state_bytes_as(_RECORDED)

    def restore(self, state: bytes, history: float | None) -> Buffer:
        """See `Tape`."""
        made = Buffer(history)
        if state:
            made.apply(state, source=_RECORDED)
        return made


def tape_of(recordings: OpenRecordings) -> tuple[Tape, Rewriter]:
    """Return the tape of recordings; of commits, if all data of one recorded store are selected.

    Raises as `OpenRecordings.rewriter`: messages of several files must agree.
    """
    topics = [{topic.name for topic in recording.topics} for recording in recordings.given]
    if not recordings.choice.key and all(STATE in names for names in topics):
        from tfdb.recorder.commit_reader import RecordedFiles  # noqa: PLC0415 - mcap is an extra

        files = RecordedFiles([recording.path for recording in recordings.given])
        if files.stores == 1:
            return CommitTape(files), Rewriter(recordings.choice, (None, None), None)
    rewriter = recordings.rewriter()
    return MessageTape(recordings, rewriter), rewriter

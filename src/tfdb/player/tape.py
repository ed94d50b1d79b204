"""The messages of recordings, from any time on."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from tfdb._core import Recorded
from tfdb.recordings.recording import Run, runs_of

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from tfdb.recordings.containers import Source
    from tfdb.recordings.open_recordings import OpenRecordings


class Message(NamedTuple):
    """One message, and when it was received (nanoseconds)."""

    source: Source
    received: int
    data: bytes


class Tape:
    """The wanted messages of recordings, file by file, in the order of reception. Threads: one."""

    def __init__(self, recordings: OpenRecordings) -> None:
        self._recordings = recordings
        self._choice = recordings.choice

    def messages(self, since: int = 0) -> Iterator[Message]:
        """Read the messages that were received at a time or later."""
        for recording in self._recordings.files:
            for source, received, data in recording.messages(self._choice.wants, since):
                yield Message(source, received, data)

    def runs(self, messages: Iterable[Message]) -> Iterator[Run]:
        """Return messages as runs that are stored alike."""
        recorded = Recorded()
        sources: dict[int, Source] = {}
        numbers: dict[int, int] = {}  # of the sources, by identity
        for source, received, data in messages:
            number = numbers.setdefault(id(source), len(numbers))
            sources[number] = source
            recorded.add(received, number, data)
        return runs_of(recorded, sources, self._choice.wants, self._choice.kind)

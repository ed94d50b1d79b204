"""Rewrites messages into another recording: selected, renamed, in its encoding."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

from tfdb import _core

from .load_report import refused_by, warn_of_refused

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from tfdb.data.refused_transforms import RefusedEdge

    from .containers import Source
    from .open_recordings import OpenRecordings
    from .recording import Recording, Run
    from .recording_writer import RecordingWriter
    from .rewriter import Rewriter
    from .selection import Choice


@dataclass
class Written:
    """Counts of what was written.

    `skipped`: messages that cannot be written. `left_out`: messages without a wanted transform.
    `refused`: transforms of other messages that cannot be written.
    """

    messages: int = 0
    transforms: int = 0
    refused: int = 0
    skipped: int = 0
    left_out: int = 0

    @property
    def read(self) -> int:
        """Number of messages read."""
        return self.messages + self.skipped + self.left_out


class Rewriting:
    """Passes selected messages to a writer. Threads: one.

    Parameters
    ----------
    writer
        The writer of the new recording.
    choice
        The selection, which may rename topics.
    """

    def __init__(self, writer: RecordingWriter, choice: Choice) -> None:
        self._writer = writer
        self._choice = choice
        self._natively = _core.MessageRewriter(writer.encoding)
        self._others = Written()

    @property
    def written(self) -> Written:
        """The counts so far."""
        ours, theirs = self._others, self._natively
        return Written(
            ours.messages + theirs.messages,
            ours.transforms + theirs.transforms,
            ours.refused + theirs.refused,
            ours.skipped + theirs.broken,
            ours.left_out + theirs.left_out,
        )

    def write_fixed_joints(self, rewriters: Iterable[Rewriter], at: int) -> None:
        """Write the static transforms of robot models with the given receive time."""
        for rewriter in rewriters:
            fixed = rewriter.fixed_joints()
            if fixed:
                data = _core.encode_tf_message(fixed, self._writer.encoding)
                who = rewriter.model_name
                self._writer.write(data, at, topic="/tf_static", static=True, authority=who)
                self._others.messages += 1
                self._others.transforms += len(fixed)

    def messages(self, recording: Recording, rewriter: Rewriter) -> Iterator[_core.Recorded]:
        """Yield the wanted part of a recording's messages, in parts, for the writer."""
        for run in recording.read(self._choice.wants, self._choice.kind):
            out = _core.Recorded()
            encoding, static = self._choice.kind(run.source)
            if run.source.is_tf:
                rewriter.rewrite(run, self._natively, out, encoding, static)
            else:
                self._rewrite_others(run, rewriter, out, static=static)
            out.renumber({id_: self._connection(run.sources[id_]) for id_ in out.counts()})
            yield out

    def refusals(self) -> list[RefusedEdge]:
        """Return the refused transforms of TFMessages."""
        return self._natively.refusals()

    def _connection(self, source: Source) -> int:
        topic = self._choice.written_topic(source)
        authority = "" if source.authority == source.topic else source.authority
        return self._writer.connection(topic, authority, static=topic.endswith("/tf_static"))

    def _rewrite_others(
        self, run: Run, rewriter: Rewriter, out: _core.Recorded, *, static: bool
    ) -> None:
        """Yield the wanted part of messages that are not TFMessages."""
        written = self._others
        refused, skipped = len(rewriter.refused_members), len(rewriter.refusals)
        for received, id_, given, left in rewriter.remaining(run, static=static):
            made = rewriter.encoded(left, self._writer.encoding)
            if made is None:
                continue
            if given and not left:
                written.left_out += 1
            else:
                out.add(received, id_, made[0])
                written.messages += 1
                written.transforms += made[1]
        written.refused += len(rewriter.refused_members) - refused
        written.skipped += len(rewriter.refusals) - skipped


def rewrite(
    recordings: OpenRecordings,
    rewriters: Sequence[Rewriter],
    writer: RecordingWriter,
    progress: Callable[[int, int], None] | None = None,
    *,
    by_time: bool = False,
) -> Written:
    """Write recordings through rewriters, one for each of `recordings.given`.

    `by_time`: messages are sorted by their receive times, not written file after file.
    """
    rewriting = Rewriting(writer, recordings.choice)
    rewriting.write_fixed_joints(dict.fromkeys(rewriters), recordings.files[0].start)
    total = recordings.count + rewriting.written.messages
    pairs = list(zip(recordings.given, rewriters, strict=True))
    if not by_time:
        pairs.sort(key=lambda pair: pair[0].start)
    streams = [rewriting.messages(*pair) for pair in pairs]
    for part in merged(streams) if by_time else chain.from_iterable(streams):
        writer.write_messages(part)
        if progress is not None:
            progress(rewriting.written.read, total)
    refused = refused_by(dict.fromkeys(rewriters), rewriting.refusals())
    warn_of_refused([str(each.path) for each in recordings.given], refused, 2)
    return rewriting.written


def merged(streams: Sequence[Iterator[_core.Recorded]]) -> Iterator[_core.Recorded]:
    """Merge messages by receive time; messages of one time come in the order of streams."""
    heads = {number: next(filter(len, stream), None) for number, stream in enumerate(streams)}
    places = dict.fromkeys(heads, 0)
    while waiting := {number: part for number, part in heads.items() if part is not None}:
        end, shortest = min((part.span()[1], number) for number, part in waiting.items())
        together = _core.Recorded()
        for number, part in waiting.items():
            last = len(part)
            if number != shortest:
                last = part.place(end + (number < shortest))
            together.extend(part, places[number], last)
            places[number] = last
            if last == len(part):
                heads[number], places[number] = next(filter(len, streams[number]), None), 0
        together.sort()
        yield together

"""Reports of loads: counts, progress, warnings of refused transforms."""

from __future__ import annotations

import time
import warnings
from collections import Counter
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import TYPE_CHECKING

from tfdb import _core
from tfdb.data.counting import counted
from tfdb.data.decimal_time import NS_PER_SECOND
from tfdb.data.errors import RecordingError, TfdbWarning
from tfdb.data.refused_transforms import RefusedEdge
from tfdb.data.time_text import format_duration

from .static_conflicts import way_on

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from tfdb._core import Buffer
    from tfdb.data.loss import Loss
    from tfdb.data.types import IngestResult
    from tfdb.robots.joint_states import JointReport
    from tfdb.trajectories.reading_report import TrajectoryRows

    from .containers import Source
    from .recording import Recording, Run
    from .rewriter import Rewriter
    from .selection import Choice

NAMED = 8
"""Largest number of refused edges that get a warning each."""


@dataclass(frozen=True)
class TopicReport:
    """Counts of one topic: `messages` read; `static`: its transforms were stored as static."""

    name: str
    messages: int
    static: bool


@dataclass(frozen=True)
class LoadReport:
    """Counts and remarks of a load.

    Parameters
    ----------
    files
        The files in the order of reading, sorted by their start.
    messages
        Messages read from topics of transforms.
    transforms, commits
        Transforms stored, and commits: one for each message of which a transform was stored.
    refused
        Messages of which nothing was stored: damaged, or every transform was refused.
    reasons, first_refusals
        By the name of the error class: number of refused transforms, and the first error message.
        Errors of a whole message, such as `CorruptMessage`, count messages.
    topics
        The topics of transforms that were read.
    start, end
        Receive times of the first and last message, nanoseconds. The stamps inside the messages may
        have another clock.
    seconds, seconds_reading_container
        Time taken in all, and by reading the containers.
    forgotten
        Samples older than the store's `history`, which it does not keep, including those refused
        with `TooOld`. Samples of one stamp count once, unless they arrive after it was dropped.
    lost
        Losses of damaged files that `salvage` read; empty without a loss.
    left_out
        Transforms skipped by `start`, `end`, `keep`, `frames` and `exclude`.
    joints
        Report of the joint states; None without `urdf`.
    trajectories
        Counts of the rows of each trajectory file.
    untimed
        By topic: number of transforms without a timestamp, which Foxglove's messages may omit. They
        get the log time of their message.
    notes
        Remarks on how unfinished or renamed files were read.
    refused_transforms
        Refused transforms, including those of messages that were stored in part.
    refused_edges
        Refused transforms by edge and error, the most frequent first.
    """

    files: tuple[str, ...]
    messages: int
    transforms: int
    commits: int
    refused: int
    reasons: Mapping[str, int]
    first_refusals: Mapping[str, str]
    topics: tuple[TopicReport, ...]
    start: int
    end: int
    seconds: float
    seconds_reading_container: float
    forgotten: int = 0
    lost: tuple[Loss, ...] = ()
    left_out: int = 0
    joints: JointReport | None = None
    trajectories: tuple[TrajectoryRows, ...] = ()
    untimed: Mapping[str, int] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    refused_transforms: int = 0
    refused_edges: tuple[RefusedEdge, ...] = ()

    @property
    def stored_counts(self) -> str:
        """The numbers of transforms and, except for trajectory files, of messages as text."""
        transforms = counted(self.transforms, "transform")
        return f"{transforms} in {counted(self.messages, 'message')}" if self.topics else transforms

    @property
    def refused_counts(self) -> str:
        """The numbers of refused transforms and of messages of which nothing was stored as text."""
        whole = counted(self.refused, "message")
        if not self.refused_transforms:
            return f"{whole} refused"
        some = f"{counted(self.refused_transforms, 'transform')} refused"
        return f"{some}, nothing stored of {whole}" if self.refused else some

    def __str__(self) -> str:
        """Write the counts in one line, with the rows of trajectories and the losses."""
        passed = format_duration(round(self.seconds * NS_PER_SECOND))
        parts = [f"{', '.join(self.files)}: {self.stored_counts}, loaded in {passed}"]
        if self.refused_edges:
            parts.append(self.refused_counts)
        if self.left_out:
            parts.append(f"{counted(self.left_out, 'transform')} left out")
        if self.forgotten:
            parts.append(f"{counted(self.forgotten, 'sample')} older than the history")
        if len(self.trajectories) == len(self.files) == 1:
            return "; ".join([*parts, self.trajectories[0].summary])
        told = {rows.path for rows in self.trajectories}
        losses = (str(loss) for loss in self.lost if loss.path not in told)
        return "; ".join([*parts, *map(str, self.trajectories), *losses])

    def _repr_html_(self) -> str:
        """Write tables for notebooks: the topics, and what was refused."""
        from tfdb.data.notebooks import table  # noqa: PLC0415 - needed by few

        counts = (
            "transforms",
            "commits",
            "refused",
            "refused_transforms",
            "forgotten",
            "left_out",
        )
        told = ", ".join(f"{getattr(self, name)} {name.replace('_', ' ')}" for name in counts)
        caption = f"{', '.join(self.files)}: {self.messages} messages, {told}"
        topics = [(t.name, t.messages, "static" if t.static else "moving") for t in self.topics]
        shown = table(caption, ("topic", "messages", "kind"), topics)
        if not self.refused_edges:
            return shown
        rows = [(each.edge, each.error, each.count, each.first) for each in self.refused_edges]
        return shown + table("refused", ("frame", "error", "count", "the first"), rows)


@dataclass
class Tally:
    """Stores runs of messages and counts stored and refused transforms."""

    buffer: Buffer
    messages: int = 0
    transforms: int = 0
    commits: int = 0
    refused: int = 0
    refused_transforms: int = 0
    reasons: Counter[str] = field(default_factory=Counter)
    first_refusals: dict[str, str] = field(default_factory=dict)
    refused_edges: dict[tuple[str, str, bool], RefusedEdge] = field(default_factory=dict)
    topics: dict[str, TopicReport] = field(default_factory=dict)
    start: int = 2**63 - 1
    end: int = 0
    lost: list[Loss] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    trajectories: list[TrajectoryRows] = field(default_factory=list)
    seconds: float = 0.0

    def __post_init__(self) -> None:
        is_limited = self.buffer.history is not None
        self._forgotten = _core.Forgotten(self.buffer) if is_limited else None

    def count(self, recording: Recording, choice: Choice) -> None:
        """Add the topics of a recording; its reader has checked their numbers of messages.

        A trajectory file has poses, but no topics.
        """
        for source in filter(choice.wants, recording.all_sources):
            if recording.rows is None:
                self.count_messages(source, source.messages, choice)
        self.lost += recording.losses
        self.notes += recording.notes
        if recording.rows is not None:
            self.trajectories.append(recording.rows)

    def store_model(self, rewriter: Rewriter) -> None:
        """Commit the fixed joints of a robot's model."""
        fixed = rewriter.fixed_joints()
        if fixed:
            self.buffer.set_transforms(fixed, static=True, authority=rewriter.model_name)
            self.transforms += len(fixed)
            self.commits += 1

    def store(
        self,
        read: Run,
        choice: Choice,
        rewriter: Rewriter,
        step: Callable[[int], None] | None = None,
    ) -> None:
        """Commit the messages of a run."""
        started = time.perf_counter()
        encoding, static = choice.kind(read.source)
        self.messages += read.last - read.first
        self.start, self.end = min(self.start, read.start), max(self.end, read.end)
        self._add(
            rewriter.ingest(
                read,
                self.buffer,
                encoding,
                static,
                authorities=read.authorities,
                forgotten=self._forgotten,
            )
        )
        self.seconds += time.perf_counter() - started
        if step is not None:
            step(read.last - read.first)

    def count_messages(self, source: Source, messages: int, choice: Choice) -> None:
        """Add messages of a topic."""
        before = self.topics.get(source.topic)
        count = messages + (before.messages if before else 0)
        self.topics[source.topic] = TopicReport(source.topic, count, choice.is_static(source))

    def _add(self, result: IngestResult) -> None:
        self.transforms += result.transforms
        self.commits += result.commits
        self.refused += result.refused
        self.refused_transforms += result.refused_transforms
        for name, refusal in result.reasons.items():
            self.reasons[name] += refusal.count
            self.first_refusals.setdefault(name, refusal.first)
        for each in result.refused_edges:
            key = each.edge, each.error, each.is_message
            before = self.refused_edges.get(key)
            self.refused_edges[key] = each if before is None else _more(before, each.count)

    def _with_way_on(self, refused: RefusedEdge, rewriter: Rewriter) -> RefusedEdge:
        """Add the remedy of loading to the error of an edge that is both static and moving."""
        conflict = "StaticConflict"
        if refused.error != conflict:
            return refused
        frame = rewriter.old_name(refused.edge)
        text = way_on(refused.first, frame, {t.name: t.static for t in self.topics.values()})
        if self.first_refusals[conflict] == refused.first:
            self.first_refusals[conflict] = text
        return replace(refused, first=text)

    def report(
        self, files: tuple[str, ...], seconds: float, rewriter: Rewriter, *, empty: bool = False
    ) -> LoadReport:
        """Return the report; raise RecordingError if nothing was stored, unless that is allowed."""
        self.refused += len(rewriter.refusals)
        self.refused_transforms += len(rewriter.refused_members)
        for error in (*rewriter.refusals, *rewriter.refused_members):
            name = type(error).__name__
            self.reasons[name] += 1
            self.first_refusals.setdefault(name, str(error))
        refused = refused_by([rewriter], self.refused_edges.values())
        refused = [self._with_way_on(each, rewriter) for each in refused]
        if not self.transforms and not empty:
            path = ", ".join(files)
            if not self.refused and rewriter.left_out:
                raise RecordingError(path, rewriter.reason())
            if not self.refused:
                lost = "".join(f"; {loss}" for loss in self.lost)
                raise RecordingError(path, f"its topics have no transform{lost}")
            raise RecordingError(path, f"all messages were refused; {describe_refused(refused[0])}")
        return LoadReport(
            files=files,
            messages=self.messages,
            transforms=self.transforms,
            commits=self.commits,
            refused=self.refused,
            reasons=dict(self.reasons),
            first_refusals=self.first_refusals,
            topics=tuple(self.topics.values()),
            start=self.start,
            end=self.end,
            seconds=seconds,
            seconds_reading_container=seconds - self.seconds,
            forgotten=0 if self._forgotten is None else self._forgotten.count,
            lost=tuple(self.lost),
            trajectories=tuple(self.trajectories),
            left_out=rewriter.left_out,
            joints=rewriter.joints_report(),
            untimed=dict(rewriter.untimed),
            notes=tuple(self.notes),
            refused_transforms=self.refused_transforms,
            refused_edges=tuple(refused),
        )


def warn_of_refused(paths: Iterable[str], refused: Iterable[RefusedEdge], depth: int) -> None:
    """Warn once of each edge and error, except of forgotten samples.

    The caller is `depth` frames up.
    """
    files = ", ".join(paths)
    told = [each for each in refused if each.error != "TooOld"]
    for each in told[:NAMED]:
        text = f"{files}: {describe_refused(each)}"
        warnings.warn(text, TfdbWarning, stacklevel=depth)
    if len(told) > NAMED:
        count = sum(each.count for each in told[NAMED:])
        were = "was" if count == 1 else "were"
        text = (
            f"{files}: {counted(count, 'transform')} of {counted(len(told) - NAMED, 'other edge')} "
            f"{were} refused; `refused_edges` of the load's report lists them"
        )
        warnings.warn(text, TfdbWarning, stacklevel=depth)


def refused_by(
    rewriters: Iterable[Rewriter], natively: Iterable[RefusedEdge] = ()
) -> list[RefusedEdge]:
    """Return the transforms that rewriters refused, by edge and error, the most frequent first.

    `natively`: the refused transforms of TFMessages.
    """
    found = {(each.edge, each.error, each.is_message): each for each in natively}
    for rewriter in rewriters:
        whole = (("", error, True) for error in rewriter.refusals)
        members = ((error.edge or "", error, False) for error in rewriter.refused_members)
        for edge, error, is_message in chain(whole, members):
            key = edge, type(error).__name__, is_message
            found[key] = _more(found.get(key) or RefusedEdge(*key[:2], 0, str(error), is_message))
    return sorted(found.values(), key=lambda each: (-each.count, not each.is_message))


def _more(refused: RefusedEdge, count: int = 1) -> RefusedEdge:
    return replace(refused, count=refused.count + count)


def describe_refused(refused: RefusedEdge) -> str:
    """Describe how many transforms of an edge were refused, with the first error."""
    one = refused.count == 1
    name = refused.edge if len(refused.edge) <= 64 else f"{refused.edge[:64]}..."
    what = f"{'transform' if one else 'transforms'} of frame {name!r}"
    if refused.is_message:
        what = "message" if one else "messages"
    elif not refused.edge:
        what = "transform without a child frame" if one else "transforms without a child frame"
    were = "was" if one else "were"
    return f"{refused.count:,} {what} {were} refused with {refused.error}: {refused.first}"

"""Recordings into a store: one message is one commit."""

from __future__ import annotations

import time
import warnings
from collections import Counter, deque
from collections.abc import Iterable, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from itertools import chain
from numbers import Real
from typing import TYPE_CHECKING, Any, TypeAlias

from tfdb import _core
from tfdb.data.argument_checks import given_flag, refuse_without
from tfdb.data.counting import counted
from tfdb.data.errors import InvalidArgument, RecordingError, TfdbWarning
from tfdb.data.path_checks import given_path, given_paths
from tfdb.data.refused import RefusedEdge
from tfdb.store.forgotten import warn_of_forgotten

from .choice import OTHERS, Choice, absolute, held_by, no_name, no_topic, not_read
from .containers import FRAME_TRANSFORMS, POSE_TYPES, encodings_of
from .mcap_reader import GrowingMcap
from .recording import Recording, runs_of
from .static_conflicts import way_on
from .topic_groups import Survey, Watch, spelling_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence
    from typing import Unpack

    from tfdb._core import Buffer, Recorded
    from tfdb.data.errors import TfdbError
    from tfdb.data.loss import Loss
    from tfdb.data.types import IngestResult
    from tfdb.robots.joint_states import JointReport
    from tfdb.trajectories.reading_report import TrajectoryRows

    from .choice import LoadOptions, Rewriter
    from .containers import Source
    from .recording import PathLike, Run

    Progress: TypeAlias = Callable[[int, int], None]
    Topics: TypeAlias = str | Iterable[str] | Mapping[str, str]

NAMED = 8
"""How many refused edges are named, each by a warning."""
ROLES = ("tf", "tf_static")
"""The last part of a topic's name; by it transforms are moving or static."""


@dataclass(frozen=True)
class TopicReport:
    """What one topic gave: `messages` read, `static` if its transforms were stored as such."""

    name: str
    messages: int
    static: bool


@dataclass(frozen=True)
class LoadReport:
    """What a load did.

    Parameters
    ----------
    files
        In the order of reading, that of their start.
    messages
        Read from the topics of transforms.
    transforms, commits
        Stored; each message of which a transform was stored is one commit.
    refused
        Messages of which nothing was stored: damaged, or every transform was refused.
    reasons, first_refusals
        Name of the error class to how many transforms were refused with it, and to the first of its
        messages. Errors of a message as a whole, such as `CorruptMessage`, count messages.
    topics
        The topics of transforms that were read.
    start, end
        When the first and last message were received, nanoseconds. The stamps inside the messages
        may run on another clock.
    seconds, seconds_reading_container
        Time taken; the second is the part that read the containers.
    forgotten
        Samples of the recordings that the store does not keep, because they are older than its
        `history` allows; those refused with `TooOld` included. Samples of one stamp count once,
        unless they come after it was forgotten.
    lost
        What `salvage` could not save of damaged files; empty where nothing was lost.
    left_out
        Transforms that were read and not wanted, by `start`, `end`, `keep`, `frames` and `exclude`.
    joints
        What the joint states made of the robot's model; None without `urdf`.
    trajectories
        Counts of the rows of each trajectory file.
    untimed
        Topic to the number of its transforms without a timestamp: Foxglove's messages may leave it
        out. They have the log time of their message.
    notes
        Remarks on unfinished or renamed files: how they were read.
    refused_transforms
        Transforms that were refused, those of messages that were stored in part included.
    refused_edges
        What was refused, by edge and error, the most frequent first.
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


def load_recordings(
    buffer: Buffer,
    paths: PathLike | Sequence[PathLike],
    topics: Topics | None = None,
    progress: Progress | None = None,
    *,
    salvage: bool = False,
    **options: Unpack[LoadOptions],
) -> LoadReport:
    """Load the transforms of recordings into a store.

    The files are looked through before the first commit, so a damaged one leaves the store as it
    was. One that changes while it is loaded may leave a part of its messages there.
    Then each message is one commit, in the order of its reception. A transform that the store
    refuses is counted and left out; the others of its message are stored.

    Parameters
    ----------
    buffer
        Where to store. `Buffer(history=None)` keeps everything.
    paths
        One recording or several, such as the parts of a split one: `.bag`, `.db3`, `.mcap`, ROS 2
        bag folders. They are read in the order of their start.
    topics
        Which topics to read; None reads all that hold transforms, TFMessage or Foxglove's
        FrameTransform and FrameTransforms. A mapping renames them, as in
        `{"/robot1/tf": "tf", "/robot1/tf_static": "tf_static"}`; a new name ends in `tf` or
        `tf_static`. Transforms are static when the last part of the topic's name is `tf_static`,
        wherever in the file they lie; Foxglove's, when the name ends in `_static`.
    progress
        Called with (done, total); each message counts once when read and once when stored.
    salvage
        Read damaged and cut files as far as they go, and folders of which files are missing; the
        report counts what was lost.
    **options
        `start`, `end`, `frames`, `exclude`, `keep`, `rename`, `prefix`, `pose_topics`, `urdf`,
        `joint_topic`, `by_namespace`, `mix` and `stamp_unit`, as in `Buffer.load`.

    Raises
    ------
    RecordingError
        A file is not a recording, damaged or cut short; a topic is missing or holds no transforms;
        nothing could be stored. The store is unchanged. Fields: path, reason.
    MixedSources
        Groups of topics disagree, as in `Buffer.load`. The store is unchanged.
    InvalidArgument
        No path, an empty one, or topics that are none, no names, or renamed to something else.
    OSError
        A file cannot be opened.
    """
    started = time.perf_counter()
    refuse_without(buffer, "buffer", "a Buffer", "set_transforms", "history")
    salvage = given_flag("salvage", salvage)
    tally = _Tally(buffer)
    files = given_paths(paths, RecordingError)
    if not files:
        raise InvalidArgument("no recording to load: paths is empty")
    choice = Choice(**options)
    selection = Selection(topics, choice)
    with ExitStack() as stack:
        recordings = [
            stack.enter_context(Recording(path, salvage=salvage, stamp_unit=choice.stamp_unit))
            for path in files
        ]
        choice.check_unit(recordings)
        selection.check(recordings)
        recordings.sort(key=lambda recording: recording.start)
        names = tuple(str(recording.path) for recording in recordings)
        meter = _Meter(selection.count(recordings), progress, 3 if choice.needs_survey else 2)
        rewriter = selection.resolve(recordings, meter.step)
        tally.store_model(rewriter)
        readings: deque[Iterator[Run]] = deque()
        for recording in recordings:
            readings.append(recording.read(selection.wants, selection.kind, meter.step))
            tally.count(recording, selection)
        while readings:
            for run in readings.popleft():
                tally.store(run, selection, rewriter, meter)
    report = tally.report(names, time.perf_counter() - started, rewriter)
    for note in report.notes:
        warnings.warn(note, TfdbWarning, stacklevel=4)
    rewriter.warn(", ".join(names), 5)
    warn_of_refused(report.files, report.refused_edges, 5)
    for text in (each for rows in report.trajectories for each in rows.complaints()):
        warnings.warn(text, TfdbWarning, stacklevel=4)
    if report.forgotten:
        warn_of_forgotten(buffer, report.forgotten, 5)
    return report


def follow_recording(
    buffer: Buffer,
    path: PathLike,
    topics: Topics | None = None,
    *,
    timeout: float | None = None,
    interval: float = 0.2,
    **options: Unpack[LoadOptions],
) -> LoadReport:
    """Load an MCAP file while it is written, chunk by chunk, until its end is there.

    Each message is one commit, as soon as its chunk is in the file: how soon that is, the recorder
    decides (`--max-cache-size` of `ros2 bag record`). Meanwhile others read the store, in other
    threads, or processes where it is shared. Ctrl-C ends it; what came until then is stored.

    Parameters
    ----------
    buffer
        Where to store. Its `history` limits what it keeps.
    path
        The file; it may still be empty. Damaged messages are refused and counted, as by `load`.
    topics
        As in `Buffer.load`; a topic may come later than the file.
    timeout
        Seconds without growth after which the writer is taken for dead; None: it is waited for.
    interval
        Seconds between two looks at the file's size.
    **options
        `start` and `end` as stamps, `exclude`, `rename`, `prefix`, `pose_topics`, `by_namespace`
        and `mix`, as in `Buffer.load`. The others need the whole file.

    Raises
    ------
    RecordingError
        No MCAP file, damaged, or it shrank; its writer stopped: it has no end and has not grown for
        `timeout` (what was whole is stored; `load(salvage=True)` reads the rest); it ended without
        transforms, or without one of the topics (what came of the others is stored).
    MixedSources
        Groups of topics disagree, as in `Buffer.load`; the messages before are stored.
    InvalidArgument
        Options that need the whole file, and a timeout or interval that is none.
    OSError
        The file cannot be opened or read.
    """
    following = Following(buffer, path, topics, timeout=timeout, interval=interval, **options)
    following.run()
    return following.report(3)


class Following:
    """One use of `follow_recording`, whose report can be had where a signal ends it."""

    def __init__(
        self,
        buffer: Buffer,
        path: PathLike,
        topics: Topics | None = None,
        *,
        timeout: float | None = None,
        interval: float = 0.2,
        **options: Unpack[LoadOptions],
    ) -> None:
        """Check the arguments."""
        self._started = time.perf_counter()
        refuse_without(buffer, "buffer", "a Buffer", "set_transforms", "history")
        self._path = given_path(path, RecordingError)
        _check_seconds("interval", interval)
        if timeout is not None:
            _check_seconds("timeout", timeout)
        self._timeout, self._interval = timeout, interval
        choice = Choice(**options)
        self._rewriter = choice.without_survey()
        self._selection = Selection(topics, choice)
        self._tally = _Tally(buffer)

    def run(self) -> None:
        """Store what comes until the file is complete."""
        tally, selection, given = self._tally, self._selection, self._path
        watch = selection.watch(str(given), self._rewriter)
        with closing(GrowingMcap(given)) as file:
            grown, size = time.monotonic(), file.size
            while True:
                for messages, sources in file.read():
                    tally.take(messages, sources, selection, self._rewriter, watch)
                if file.is_complete:
                    break
                now = time.monotonic()
                if file.size != size:
                    grown, size = now, file.size
                elif self._timeout is not None and now - grown > self._timeout:
                    raise RecordingError(
                        given,
                        f"it has not grown for {self._timeout:g} s and has no end: its writer "
                        "stopped; salvage=True (--salvage) reads what it has",
                    )
                time.sleep(self._interval)
            if not tally.transforms or selection.names - {absolute(name) for name in tally.topics}:
                with Recording(given) as whole:
                    selection.check([whole])

    def report(self, level: int, *, whole: bool = True) -> LoadReport:
        """Return what was stored so far; warnings name the caller `level` calls up.

        A recording that was `whole` and had no transform is an error.
        """
        seconds = time.perf_counter() - self._started
        report = self._tally.report((str(self._path),), seconds, self._rewriter, empty=not whole)
        self._rewriter.warn(str(self._path), level + 1)
        warn_of_refused(report.files, report.refused_edges, level + 1)
        return report


def refuse_mixture_so_far(
    path: PathLike, topics: Topics | None = None, **options: Unpack[LoadOptions]
) -> None:
    """Raise what `follow_recording` raises for the part of a file that is written already.

    Raises MixedSources, RecordingError and InvalidArgument.
    """
    choice = Choice(**options)
    selection = Selection(topics, choice)
    watch = selection.watch(str(path), choice.without_survey())
    with closing(GrowingMcap(given_path(path, RecordingError))) as file:
        for messages, sources in file.read():
            if watch is None:
                break
            for _ in _runs_that_came(messages, sources, selection, watch):
                pass


def _runs_that_came(
    messages: Recorded,
    sources: Mapping[int, Source],
    selection: Selection,
    watch: Watch | None,
) -> Iterator[Run]:
    """Give the runs that are wanted of messages that just came, after a look at each."""

    def kind(source: Source) -> object:
        return selection.kind(source), "" if watch is None else spelling_of(source)

    wanted = {id_ for id_, source in sources.items() if selection.wants(source)}
    picked = _core.Recorded()
    for index in range(len(messages)):
        received, id_, data = messages[index]
        if id_ in wanted:
            picked.add(received, id_, data)
    for run in runs_of(picked, sources, selection.wants, kind):
        if watch is not None and selection.is_judged(run.source):
            watch.look(run, *selection.kind(run.source))
        yield run


def _check_seconds(name: str, value: Any) -> None:
    is_number = isinstance(value, Real) and not isinstance(value, bool)
    if not is_number or not 0 < value < 10**9:
        raise InvalidArgument(f"{name} is a positive number of seconds, not {value!r}", value=value)


def warn_of_refused(paths: Iterable[str], refused: Iterable[RefusedEdge], depth: int) -> None:
    """Warn of each edge and error, but for what is forgotten; `depth` frames up is the caller."""
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
    """What rewriters refused, by edge and error, the most frequent first.

    `natively`: what was refused of TFMessages.
    """
    found = {(each.edge, each.error, each.is_message): each for each in natively}
    for rewriter in rewriters:
        whole = (("", error, True) for error in rewriter.refusals)
        members = ((error.edge or "", error, False) for error in rewriter.refused_members)
        for edge, error, is_message in chain(whole, members):
            key = edge, type(error).__name__, is_message
            before = found.get(key) or RefusedEdge(*key[:2], 0, str(error), is_message)
            found[key] = replace(before, count=before.count + 1)
    return sorted(found.values(), key=lambda each: (-each.count, not each.is_message))


def describe_refused(refused: RefusedEdge) -> str:
    """Say how many transforms of an edge were refused, and why the first was."""
    one = refused.count == 1
    name = refused.edge if len(refused.edge) <= 64 else f"{refused.edge[:64]}..."
    what = f"{'transform' if one else 'transforms'} of frame {name!r}"
    if refused.is_message:
        what = "message" if one else "messages"
    elif not refused.edge:
        what = "transform without a child frame" if one else "transforms without a child frame"
    were = "was" if one else "were"
    return f"{refused.count:,} {what} {were} refused with {refused.error}: {refused.first}"


class Selection:
    """Which topics are read, what of, and which of them are static."""

    def __init__(self, topics: Topics | None, choice: Choice | None = None) -> None:
        self._choice = choice or Choice()
        if topics is None:
            self._roles: dict[str, str] | None = None
        elif isinstance(topics, Mapping):
            self._roles = {absolute(name): role_of(name, role) for name, role in topics.items()}
        elif isinstance(topics, str | bytes):
            self._roles = {absolute(topics): absolute(topics)}
        elif isinstance(topics, Iterable):
            self._roles = {absolute(name): absolute(name) for name in topics}
        else:
            raise no_name(topics)

    @property
    def names(self) -> set[str]:
        """The topics that were asked for by name."""
        return {*(self._roles or ()), *self._choice.pose_topics}

    def wants(self, source: Source) -> bool:
        """Whether it is to be read."""
        named = self._roles is None or absolute(source.topic) in self._roles
        if source.is_tf or (source.holds_transforms and named):
            return named
        return self._choice.wants_other(source)

    def is_static(self, source: Source) -> bool:
        """Whether its transforms are."""
        name = absolute(source.topic)
        role = (self._roles or {}).get(name, name)
        if role == name:
            return source.is_static
        return source.holds_transforms and role.rsplit("/", 1)[-1] == "tf_static"

    def kind(self, source: Source) -> tuple[str, bool]:
        """What all messages of one run have in common: the encoding to store, and if static."""
        return source.encoding if source.is_tf else OTHERS, self.is_static(source)

    def count(self, recordings: Sequence[Recording]) -> int:
        """Messages to be read."""
        sources = [source for recording in recordings for source in recording.all_sources]
        return sum(source.messages for source in sources if self.wants(source))

    def check(self, recordings: Sequence[Recording]) -> None:
        """Refuse recordings without any of the topics, topics that no recording has, and none."""
        path, types, held = held_by(recordings)
        others = [source for recording in recordings for source in recording.all_sources]
        sources = {absolute(source.topic) for source in others if source.holds_transforms}
        self._choice.check_topics(recordings)
        if self._roles is None and not sources and not self._choice.reads_others:
            more = next((_way_on(source) for source in others if source.type in POSE_TYPES), "")
            raise RecordingError(path, f"no topic with transforms{more}; its topics: {held}")
        if self._roles is not None and not self._roles and not self._choice.reads_others:
            raise InvalidArgument(
                f"topics is empty: name some of {path}, or give None to read all that hold "
                f"transforms; its topics: {held}",
                value=[],
                path=path,
            )
        unread = {absolute(s.topic): s for s in others if s.type in FRAME_TRANSFORMS}
        for name in sorted(set(self._roles or ()) - sources):
            if name in unread:
                raise RecordingError(path, f"topic {name!r} {not_read(unread[name])}")
            if name in types:
                raise RecordingError(path, f"topic {name!r} holds {types[name]}, not transforms")
            raise no_topic(path, name, held, sources)

    def resolve(
        self, recordings: Sequence[Recording], step: Callable[[int], None] | None = None
    ) -> Rewriter:
        """Make the rewriter of recordings that `check` has passed, for one store.

        Raises MixedSources where files contradict, or no topic was named and groups of topics
        disagree; the others as `Choice.resolve`.
        """
        rewriter = self._choice.resolve(recordings, self.wants, self.kind, step)
        self.refuse_mixture(recordings, rewriter)
        return rewriter

    def refuse_mixture(self, recordings: Sequence[Recording], rewriter: Rewriter) -> None:
        """Raise MixedSources where groups of topics disagree, or files contradict."""
        survey = self._survey(recordings, rewriter)
        self._refuse_groups(survey)
        self._refuse_parts(survey)

    def refuse_groups(self, recordings: Sequence[Recording], rewriter: Rewriter) -> None:
        """Raise MixedSources where no topic was named and groups of topics disagree.

        Groups that are kept apart by prefixes disagree if different frames of each get one name.
        """
        self._refuse_groups(self._survey(recordings, rewriter))

    def refuse_parts(self, recordings: Sequence[Recording], rewriter: Rewriter) -> None:
        """Raise MixedSources where files, or spellings of a topic, contradict each other."""
        self._refuse_parts(self._survey(recordings, rewriter))

    def _survey(self, recordings: Sequence[Recording], rewriter: Rewriter) -> Survey:
        return Survey(recordings, self.wants, self.kind, rewriter.without_names())

    def _refuse_groups(self, survey: Survey) -> None:
        if self._roles is None and not self._choice.mix:
            survey.refuse_groups(self.is_judged, apart=self._choice.by_namespace)

    def _refuse_parts(self, survey: Survey) -> None:
        if not self._choice.mix:
            survey.refuse_parts()

    def watch(self, path: str, rewriter: Rewriter) -> Watch | None:
        """What finds groups that disagree while a file grows; None where they are not judged."""
        choice = self._choice
        is_judged = self._roles is None and not choice.mix and not choice.by_namespace
        return Watch(path, rewriter.without_names()) if is_judged else None

    def is_judged(self, source: Source) -> bool:
        """Whether it holds transforms and was not asked for by name."""
        is_named = absolute(source.topic) in self._choice.pose_topics
        return source.holds_transforms and self.wants(source) and not is_named


def _way_on(source: Source) -> str:
    """How the poses of a topic are read, where no topic has transforms."""
    if source.encoding in encodings_of(source.type):
        return f"; pose_topics={source.topic!r} (--pose-topic {source.topic}) reads its poses"
    return f"; topic {source.topic!r} {not_read(source)}"


class _Meter:
    """Counts the work done: each message each time that it is read, and once when stored."""

    def __init__(self, messages: int, progress: Progress | None, times: int) -> None:
        self._total = times * messages
        self._done = 0
        self._progress = progress

    def step(self, messages: int) -> None:
        # A file read again by another library counts again, but never beyond its share.
        self._done = min(self._done + messages, self._total)
        if self._progress is not None:
            self._progress(self._done, self._total)


@dataclass
class _Tally:
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

    def count(self, recording: Recording, selection: Selection) -> None:
        """Add the topics of a recording; its reader has checked their numbers of messages."""
        for source in filter(selection.wants, recording.all_sources):
            before = self.topics.get(source.topic)
            messages = source.messages + (before.messages if before else 0)
            static = selection.is_static(source)
            self.topics[source.topic] = TopicReport(source.topic, messages, static)
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

    def store(self, read: Run, selection: Selection, rewriter: Rewriter, meter: _Meter) -> None:
        """Commit the messages of a run."""
        started = time.perf_counter()
        encoding, static = selection.kind(read.source)
        self.messages += read.last - read.first
        self.start, self.end = min(self.start, read.start), max(self.end, read.end)
        authorities = {id_: source.authority for id_, source in read.sources.items()}
        self._add(
            rewriter.ingest(
                read,
                self.buffer,
                encoding,
                static,
                authorities=authorities,
                forgotten=self._forgotten,
            )
        )
        self.seconds += time.perf_counter() - started
        meter.step(read.last - read.first)

    def take(
        self,
        messages: Recorded,
        sources: Mapping[int, Source],
        selection: Selection,
        rewriter: Rewriter,
        watch: Watch | None,
    ) -> None:
        """Commit what is wanted of messages that just came, and count their topics."""
        counts = messages.counts()
        for id_, source in sources.items():
            if not selection.wants(source):
                continue
            before = self.topics.get(source.topic)
            count = counts.get(id_, 0) + (before.messages if before else 0)
            static = selection.is_static(source)
            self.topics[source.topic] = TopicReport(source.topic, count, static)
        for run in _runs_that_came(messages, sources, selection, watch):
            self.store(run, selection, rewriter, _Meter(0, None, 1))

    def _add(self, result: IngestResult) -> None:
        self.transforms += result.transforms
        self.commits += result.commits
        self.refused += result.refused
        self.refused_transforms += result.refused_transforms
        for name, refusal in result.reasons.items():
            self.reasons[name] += refusal.count
            self.first_refusals.setdefault(name, refusal.first)
        for each in result.refused_edges:
            self._add_refused(each)

    def _add_refused(self, refused: RefusedEdge) -> None:
        key = refused.edge, refused.error, refused.is_message
        before = self.refused_edges.get(key)
        if before is not None:
            refused = replace(before, count=before.count + refused.count)
        self.refused_edges[key] = refused

    def _add_error(self, error: TfdbError, edge: str, *, is_message: bool) -> None:
        """Count what was refused before the store saw it."""
        name = type(error).__name__
        self.reasons[name] += 1
        self.first_refusals.setdefault(name, str(error))
        self._add_refused(RefusedEdge(edge, name, 1, str(error), is_message))

    def _name_ways_on(self, rewriter: Rewriter) -> None:
        """Name the options of loading in the errors of edges that are static and move."""
        conflict = "StaticConflict"
        for key, each in self.refused_edges.items():
            if each.error != conflict:
                continue
            frame = rewriter.old_name(each.edge)
            text = way_on(each.first, frame, {t.name: t.static for t in self.topics.values()})
            if self.first_refusals[conflict] == each.first:
                self.first_refusals[conflict] = text
            self.refused_edges[key] = replace(each, first=text)

    def report(
        self, files: tuple[str, ...], seconds: float, rewriter: Rewriter, *, empty: bool = False
    ) -> LoadReport:
        for error in rewriter.refusals:
            self.refused += 1
            self._add_error(error, "", is_message=True)
        for error in rewriter.refused_members:
            self.refused_transforms += 1
            self._add_error(error, error.edge or "", is_message=False)
        self._name_ways_on(rewriter)
        if not self.transforms and not empty:
            path = ", ".join(files)
            if not self.refused and rewriter.left_out:
                raise RecordingError(path, rewriter.reason())
            if not self.refused:
                lost = "".join(f"; {loss}" for loss in self.lost)
                raise RecordingError(path, f"its topics of transforms hold no transform{lost}")
            most = max(self.refused_edges.values(), key=lambda each: each.count)
            raise RecordingError(path, f"all messages were refused; {describe_refused(most)}")
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
            refused_edges=tuple(
                sorted(self.refused_edges.values(), key=lambda each: each.count, reverse=True)
            ),
        )


def role_of(topic: str, name: Any) -> str:
    """What a topic is read as; raises InvalidArgument for what says neither moving nor static."""
    role = absolute(name)
    if role.rsplit("/", 1)[-1] in ROLES or role == absolute(topic):
        return role
    reason = f"topic {topic!r} cannot be read as {name!r}, only as {' or '.join(ROLES)}"
    raise InvalidArgument(reason, value=name)

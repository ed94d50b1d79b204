"""What of recordings is loaded, and under which names: the options of `Buffer.load`.

A `Choice` is what was asked for; `resolve` looks at the recordings where it must and makes the
`Rewriter`, through which every message goes on its way into the store.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import replace
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict

from tfdb import _core
from tfdb.data.argument_checks import given_flag, given_word
from tfdb.data.counting import counted
from tfdb.data.decimal_time import UNITS, Unit
from tfdb.data.errors import InvalidArgument, RecordingError, TfdbError, TfdbWarning, UnknownFrame
from tfdb.data.given_time import time_of
from tfdb.data.refused import Refused
from tfdb.data.stamps import format_seconds, shown
from tfdb.data.suggestions import near_names

from .containers import JOINT_STATE, POSE_TYPES, POSES_WITHOUT_CHILD, Source, encodings_of
from .edge_rules import EdgeRules
from .pose_messages import decode_joint_state, decode_poses
from .recorded_edges import RecordedEdges

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tfdb._core import Buffer, Recorded
    from tfdb.data.given_time import Time
    from tfdb.data.stamps import StampLike
    from tfdb.data.types import IngestResult, TransformStamped
    from tfdb.robots.joint_states import JointReport, JointStates
    from tfdb.robots.robot_model import RobotModel

    from .recording import PathLike, Recording, Run

    class _Chosen(TypedDict):
        selection: _core.Selection | None
        rules: dict[int, int]

    Window: TypeAlias = tuple[int | None, int | None]
    PoseTopics: TypeAlias = str | Iterable[str] | Mapping[str, str | None]

OTHERS: Literal["ros1"] = "ros1"
"""How transforms are encoded that come from messages of other kinds."""


class LoadOptions(TypedDict, total=False):
    """The options of `Buffer.load` that say what of a recording is loaded, and how it is called."""

    start: StampLike | str | None
    end: StampLike | str | None
    frames: str | Iterable[str] | None
    exclude: str | Iterable[str]
    keep: float | None
    rename: Mapping[str, str] | None
    prefix: str
    pose_topics: PoseTopics | None
    urdf: PathLike | RobotModel | None
    joint_topic: str | None
    by_namespace: bool
    mix: bool
    stamp_unit: Unit | None


class Choice:
    """Which part of recordings is loaded, and how its frames are called; see `Buffer.load`.

    Raises InvalidArgument and InvalidStamp for what none of it can be.
    """

    def __init__(
        self,
        *,
        start: StampLike | str | None = None,
        end: StampLike | str | None = None,
        frames: str | Iterable[str] | None = None,
        exclude: str | Iterable[str] = (),
        keep: float | None = None,
        rename: Mapping[str, str] | None = None,
        prefix: Any = "",
        pose_topics: PoseTopics | None = None,
        urdf: PathLike | RobotModel | None = None,
        joint_topic: str | None = None,
        by_namespace: Any = False,
        mix: Any = False,
        stamp_unit: Unit | None = None,
    ) -> None:
        self.start: Time | None = time_of("start", start)
        self.end: Time | None = time_of("end", end)
        self.frames: tuple[str, ...] | None = None if frames is None else _names("frames", frames)
        if self.frames is not None and not self.frames:
            raise InvalidArgument("frames is empty: name some, or give None for all", value=())
        self.exclude: tuple[str, ...] = _names("exclude", exclude)
        self.keep: int | None = _seconds(keep)
        self.rename: dict[str, str] = _mapping(rename)
        if not isinstance(prefix, str):
            kind = type(prefix).__name__
            raise InvalidArgument(f"prefix is what to put before names, got a {kind}", value=prefix)
        self.prefix: str = prefix.removeprefix("/")
        self.pose_topics: dict[str, str | None] = _pose_topics(pose_topics)
        self.model: RobotModel | None = _model(urdf)
        if joint_topic is not None and self.model is None:
            raise InvalidArgument("joint_topic goes with urdf, the model of the robot")
        self.joint_topic = None if joint_topic is None else absolute(joint_topic)
        self.by_namespace: bool = given_flag("by_namespace", by_namespace)
        self.mix: bool = given_flag("mix", mix)
        if self.mix and self.by_namespace:
            raise InvalidArgument(
                "mix puts groups of topics together, by_namespace keeps them apart"
            )
        if self.model is not None and self.by_namespace:
            raise InvalidArgument(
                "by_namespace keeps robots apart, and urdf is the model of one robot: name the "
                "topics of that robot"
            )
        self.stamp_unit: Unit | None = _unit(stamp_unit)

    def check_unit(self, recordings: Sequence[Recording]) -> None:
        """Refuse a unit where no file is a trajectory."""
        if self.stamp_unit is not None and all(each.rows is None for each in recordings):
            paths = ", ".join(str(each.path) for each in recordings)
            reason = f"stamp_unit goes with trajectories in text, and {paths} has stamps of its own"
            raise InvalidArgument(reason, value=self.stamp_unit, path=paths)

    @property
    def reads_others(self) -> bool:
        """Whether anything is read beside transforms."""
        return bool(self.pose_topics or self.model)

    def wants_other(self, source: Source) -> bool:
        """Whether a source that is none of transforms is read."""
        topic = absolute(source.topic)
        if source.type == JOINT_STATE:
            return self.model is not None and topic == self.joint_topic
        return topic in self.pose_topics

    def check_topics(self, recordings: Sequence[Recording]) -> None:
        """Refuse topics of poses that are not there, or hold none; find that of joint states."""
        path, types, held = held_by(recordings)
        sources = [source for recording in recordings for source in recording.all_sources]
        by_topic = {absolute(source.topic): source for source in sources}
        for topic, child in self.pose_topics.items():
            source = by_topic.get(topic)
            if topic not in types:
                raise no_topic(path, topic, held, types)
            if source is None or source.type not in POSE_TYPES:
                kinds = ", ".join(sorted(POSE_TYPES))
                raise RecordingError(
                    path, f"topic {topic!r} holds {types[topic]}, not poses: those are {kinds}"
                )
            if source.encoding not in encodings_of(source.type):
                raise RecordingError(path, f"topic {topic!r} {not_read(source)}")
            if child is None and source.type in POSES_WITHOUT_CHILD:
                raise RecordingError(
                    path,
                    f"topic {topic!r} holds {types[topic]}, which does not say of which frame its "
                    f"poses are: name it, pose_topics={{{topic!r}: 'base_link'}} "
                    f"(--pose-topic {topic}=base_link)",
                )
        if self.model is not None:
            self._find_joint_topic(path, by_topic, held)

    def _find_joint_topic(self, path: str, sources: Mapping[str, Source], held: str) -> None:
        found = {
            topic: source
            for topic, source in sources.items()
            if source.type == JOINT_STATE and source.encoding in ("ros1", "cdr")
        }
        wanted = self.joint_topic
        if wanted is None:
            usual = "/joint_states"
            if len(found) > 1 and usual not in found:
                listed = ", ".join(sorted(found))
                raise RecordingError(
                    path, f"several topics of joint states, name one by joint_topic: {listed}"
                )
            wanted = usual if usual in found else next(iter(found), usual)
        if wanted not in found:
            raise RecordingError(
                path, f"no topic {wanted!r} with joint states for the model; its topics: {held}"
            )
        self.joint_topic = wanted

    @property
    def limits(self) -> str:
        """What is left out and renamed, in words; empty: nothing."""
        given = {
            "start": self.start,
            "end": self.end,
            "frames": self.frames and sorted(self.frames),
            "exclude": sorted(self.exclude),
            "keep": self.keep,
            "rename": sorted(self.rename.items()),
            "prefix": self.prefix,
            "stamp_unit": self.stamp_unit,
        }
        return ", ".join(f"{name}={value!r}" for name, value in given.items() if value)

    @property
    def key(self) -> str:
        """The choice in words that are the same for the same choice; empty: that of everything."""
        limits = self.limits
        if self.mix or self.by_namespace:
            limits += ", mix" if self.mix else ", by_namespace"
        if not self.reads_others:
            return limits
        joints = None if self.model is None else sorted(self.model.joints.items())
        poses = sorted(self.pose_topics.items(), key=str)
        return f"{limits}; {poses}, {joints}, {self.joint_topic}"

    @property
    def needs_survey(self) -> bool:
        """Whether the recordings are looked through before."""
        offsets = any(time is not None and time.since for time in (self.start, self.end))
        return bool(offsets or self.keep or self.frames or self.rename or self.model)

    def resolve(
        self,
        recordings: Sequence[Recording],
        wants: Callable[[Source], bool],
        kind: Callable[[Source], tuple[str, bool]],
        step: Callable[[int], None] | None = None,
    ) -> Rewriter:
        """Look through the recordings where need be.

        `wants` and `kind` (encoding, whether static) are those of a `Selection`; `step` as in
        `Recording.read`.

        Raises
        ------
        UnknownFrame
            A frame of `frames` is not there.
        InvalidArgument
            `end` before `start`; an offset where nothing moves; two frames would have one name.
        RecordingError
        """
        return self.resolve_apart([(self.prefix, recordings)], wants, kind, step)[0]

    def resolve_apart(
        self,
        robots: Sequence[tuple[str, Sequence[Recording]]],
        wants: Callable[[Source], bool],
        kind: Callable[[Source], tuple[str, bool]],
        step: Callable[[int], None] | None = None,
    ) -> list[Rewriter]:
        """Look through recordings whose frames are kept apart by prefixes; each has a tree.

        Offsets count from the first and to the last stamp of all. Else as `resolve`.
        """
        chosen = [self._prefixed(prefix) for prefix, _ in robots]
        if not self.needs_survey:
            return [Rewriter(each, _window(each, None), None) for each in chosen]
        found = [self._survey(recordings, wants, kind, step) for _, recordings in robots]
        frames = sorted({frame for edges, _ in found for frame in edges.frames})
        for frame in sorted(set(self.frames or ()) - set(frames)):
            raise _no_frame("frames", frame, frames)
        ends = [stamp for edges, _ in found for stamp in edges.span or ()]
        window = _window(self, (min(ends), max(ends)) if ends else None)
        made = []
        for each, (edges, joints) in zip(chosen, found, strict=True):
            each._check_names(edges.frames)
            children = None if self.frames is None else edges.between(self.frames)
            made.append(Rewriter(each, window, children, joints))
        return made

    def _prefixed(self, prefix: str) -> Choice:
        made = copy(self)
        made.prefix = prefix.removeprefix("/")
        return made

    def _survey(
        self,
        recordings: Sequence[Recording],
        wants: Callable[[Source], bool],
        kind: Callable[[Source], tuple[str, bool]],
        step: Callable[[int], None] | None,
    ) -> tuple[RecordedEdges, JointStates | None]:
        """All that recordings hold, under old names; what makes transforms of joint states."""
        first = Rewriter(self._without_names(), (None, None), None)
        if self.model is None:
            survey = _core.EdgeSurvey()
            for recording in recordings:
                for run in recording.read(wants, kind, step):
                    first.survey(run, survey, *kind(run.source))
            found = survey.edges()
            if found is not None:
                return RecordedEdges.of_survey(found), None
            first = Rewriter(self._without_names(), (None, None), None)
        everything: Buffer = _core.Buffer(history=None)

        def store(wanted: Callable[[Source], bool]) -> None:
            for recording in recordings:
                for run in recording.read(wanted, kind, step):
                    first.ingest(run, everything, *kind(run.source))

        joints = None
        store(lambda source: wants(source) and source.type != JOINT_STATE)
        if self.model is not None:
            # What the recording says itself of a frame is taken from there.
            taken = [info.name for info in everything.tree() if info.parent is not None]
            joints = _joint_states(self.model, taken)
            first.joints = _joint_states(self.model, taken)
            fixed = first.fixed_joints()
            if fixed:
                everything.set_transforms(fixed, static=True)
            store(lambda source: wants(source) and source.type == JOINT_STATE)
        return RecordedEdges.of_store(everything), joints

    def without_survey(self) -> Rewriter:
        """The rewriter where nothing can be looked through; InvalidArgument where it must be."""
        needed = {
            "frames": self.frames,
            "keep": self.keep,
            "urdf": self.model,
            "stamp_unit": self.stamp_unit,
            "start as an offset": self.start is not None and self.start.since,
            "end as an offset": self.end is not None and self.end.since,
        }
        given = ", ".join(name for name, value in needed.items() if value)
        if given:
            raise InvalidArgument(f"{given}: these need a finished file; this one is still written")
        return Rewriter(self, _window(self, None), None)

    def _without_names(self) -> Choice:
        """What decides where a transform comes from."""
        return Choice(
            exclude=self.exclude,
            pose_topics=self.pose_topics or None,
            by_namespace=self.by_namespace,
        )

    def _check_names(self, frames: Sequence[str]) -> None:
        """Refuse new names that others have."""
        found: dict[str, str] = {}
        for frame in frames:
            new = self.rename.get(frame, frame)
            other = found.setdefault(new, frame)
            if other != frame:
                raise InvalidArgument(
                    f"rename: {other!r} and {frame!r} would both be called {new!r}", value=new
                )


class Rewriter:
    """Leaves out of messages what was not chosen, and gives frames their names.

    Parameters
    ----------
    choice
        What was asked for.
    window
        First and last stamp of moving transforms that are kept.
    children
        The child frames of the edges that are kept; None: all.
    joints
        What makes transforms of joint states.
    """

    def __init__(
        self,
        choice: Choice,
        window: Window,
        children: frozenset[str] | None,
        joints: JointStates | None = None,
    ) -> None:
        self._choice = choice
        self._rules = EdgeRules(choice, children)
        self.window = window
        self._selection = _core.Selection(self._rules.edge, *map(_as_stamp, window))
        self.joints = joints
        self.refusals: list[TfdbError] = []
        """Errors of messages of which nothing is left."""
        self.refused_members: list[TfdbError] = []
        """Errors of transforms of which the rest of the message is left."""
        self._empty: Buffer | None = None
        self.is_idle: bool = not (choice.limits or choice.by_namespace)
        # Of messages that are rewritten here; `_selection` counts the others.
        self._names: dict[str, str] = {}
        self._left_out = 0
        self._moving = 0
        self._outside: tuple[int, int] | None = None
        self.untimed: Counter[str] = Counter()

    @property
    def left_out(self) -> int:
        """How many transforms were not wanted."""
        return self._left_out + self._selection.left_out

    def ingest(
        self,
        run: Run,
        store: Buffer,
        encoding: str,
        static: bool,
        *,
        authorities: Mapping[int, str] | None = None,
        forgotten: _core.Forgotten | None = None,
    ) -> IngestResult:
        """Store what is wanted of a run, as `_core.ingest_recorded` does."""
        part, chosen = self._part(run, static=static)
        return _core.ingest_recorded(
            store,
            *part,
            encoding=encoding,
            static=static,
            authorities=dict(authorities or {}),
            forgotten=forgotten,
            **chosen,
        )

    def rewrite(
        self,
        run: Run,
        rewriter: _core.MessageRewriter,
        out: Recorded,
        encoding: str,
        static: bool,
    ) -> None:
        """Add what is wanted of a run of TFMessages to messages that will be written."""
        sources = {
            id_: (source.authority, self._rules.number(source), self._renames(source))
            for id_, source in run.sources.items()
        }
        rewriter.rewrite(
            out,
            run.messages,
            run.first,
            run.last,
            encoding=encoding,
            static=static,
            sources=sources,
            selection=None if self.is_idle else self._selection,
        )

    def survey(self, run: Run, survey: _core.EdgeSurvey, encoding: str, static: bool) -> None:
        """Add what is wanted of a run to a survey."""
        part, chosen = self._part(run, static=static)
        _core.survey_recorded(survey, *part, encoding=encoding, static=static, **chosen)

    def log(
        self,
        run: Run,
        log: _core.ArrivalLog,
        encoding: str,
        static: bool,
        *,
        publishers: Mapping[int, str],
    ) -> None:
        """Add what is wanted of a run to a log; `publishers` by source."""
        part, chosen = self._part(run, static=static)
        log.add(
            *part,
            encoding=encoding,
            static=static,
            publishers=dict(publishers),
            note_slashes=run.source.is_tf,
            **chosen,
        )

    def children(
        self, run: Run, encoding: str, static: bool
    ) -> dict[int, dict[str, tuple[int, int]]]:
        """Return the child frames of what is wanted of a run, by source.

        Each has its first and last stamp.
        """
        part, chosen = self._part(run, static=static)
        return _core.recorded_children(*part, encoding=encoding, static=static, **chosen)

    def _part(self, run: Run, *, static: bool) -> tuple[tuple[Recorded, int, int], _Chosen]:
        """Messages of transforms, and what chooses among them."""
        if not run.source.is_tf:
            made = self._made(run, static=static)
            return (made, 0, len(made)), {"selection": None, "rules": {}}
        part = run.messages, run.first, run.last
        if self.is_idle:
            return part, {"selection": None, "rules": {}}
        rules = {id_: self._rules.number(source) for id_, source in run.sources.items()}
        return part, {"selection": self._selection, "rules": rules}

    def _made(self, run: Run, *, static: bool) -> Recorded:
        """What is wanted of other messages, as messages of transforms."""
        made = _core.Recorded()
        for index in range(run.first, run.last):
            received, id_, data = run.messages[index]
            left = self.message(data, run.sources[id_], received, static=static)
            if left is not None:
                made.add(received, id_, left)
        return made

    def message(self, data: bytes, source: Source, received: int, *, static: bool) -> bytes | None:
        """The bytes of a TFMessage; None where nothing of it is left.

        `received` is when the message was, nanoseconds.

        A damaged one is left as it is, for the store to refuse it; what makes no transforms is
        added to `refusals`.
        """
        if self.is_idle and source.is_tf:
            return data
        before = len(self.refused_members)
        try:
            given = self.decoded(data, source, received, static=static)
        except TfdbError as error:
            if source.is_tf:
                return data
            self.refusals.append(error)
            return None
        left = self.transforms(given, source, static=static)
        if not left:
            return None if given or not source.is_tf else data
        if not source.is_tf:
            encoded = self.encoded(left, OTHERS)
            return None if encoded is None else encoded[0]
        is_whole = len(left) == len(given) and len(self.refused_members) == before
        if is_whole and not self._renames(source):
            return data
        return _core.encode_tf_message(left, source.encoding)

    def encoded(
        self, transforms: Sequence[TransformStamped], encoding: str
    ) -> tuple[bytes, int] | None:
        """A TFMessage of those transforms that have a place in one, and how many; None: none has.

        The errors of the others are added to `refused_members`, or that of all to `refusals`.
        """
        try:
            return _core.encode_tf_message(transforms, encoding), len(transforms)
        except TfdbError as error:
            whole = error
        good: list[TransformStamped] = []
        bad: list[TfdbError] = []
        for each in transforms:
            try:
                _core.encode_tf_message([each], encoding)
            except TfdbError as error:
                error.edge = each.child
                bad.append(error)
            else:
                good.append(each)
        if not good:
            self.refusals.append(whole)
            return None
        self.refused_members += bad
        return _core.encode_tf_message(good, encoding), len(good)

    def decoded(
        self, data: bytes, source: Source, received: int, *, static: bool
    ) -> list[TransformStamped]:
        """The transforms of one message; one that cannot be read is added to `refused_members`.

        Raises CorruptMessage, or the first one's error if none can be read, with all of them in
        `refused`. Those without a timestamp have that of the reception, `received`.
        """
        given = self._decoded(data, source, received, static=static)
        space = self.space(source)
        if not space:
            return given
        return [replace(one, parent=space + one.parent, child=space + one.child) for one in given]

    def _renames(self, source: Source) -> bool:
        return bool(self._choice.rename or self._choice.prefix or self.space(source))

    def space(self, source: Source) -> str:
        """The prefix that `by_namespace` gives to the frames of a topic."""
        return self._rules.space(source)

    def old_name(self, frame: str) -> str:
        """The name in the recording of a frame that was loaded."""
        return next((old for old, new in self._loaded().items() if new == frame), frame)

    def _loaded(self) -> dict[str, str]:
        """The new names of frames that were loaded, by their old ones, where frames are renamed."""
        names = dict(self._names)
        for edge in self._selection.kept() if self._rules.renames else ():
            frames = [each for each in self._rules.frames(*edge) if each and each.isprintable()]
            names |= {frame: self._rules.name(frame) for frame in frames}
        return names

    def without_names(self) -> Rewriter:
        """Make a rewriter that leaves out the same, and keeps all names."""
        choice = copy(self._choice)
        choice.prefix, choice.rename = "", {}
        joints = None if self.joints is None else self.joints.again()
        return Rewriter(choice, self.window, self._rules.children, joints)

    def _decoded(
        self, data: bytes, source: Source, received: int, *, static: bool
    ) -> list[TransformStamped]:
        if source.is_tf:
            members = _core.decode_members(
                data, source.encoding, static=static, authority=source.authority
            )
            if self._renames(source):
                members = [self._named(each, source) for each in members]
            good = [each for each in members if not isinstance(each, TfdbError)]
            bad = [each for each in members if isinstance(each, TfdbError)]
            if bad and not good:
                bad[0].refused = tuple(
                    Refused(n, type(each).__name__, str(each), each.reason or "")
                    for n, each in enumerate(bad)
                )
                raise bad[0]
            self.refused_members += bad
            return good
        if source.type == JOINT_STATE:
            state = decode_joint_state(data, source)
            return (
                [] if self.joints is None else self.joints.transforms(state.stamp, state.positions)
            )
        topic = absolute(source.topic)
        found = decode_poses(data, source, self._choice.pose_topics.get(topic), received)
        self.refused_members += found.refused
        if found.untimed and not static:
            self.untimed[topic] += found.untimed
        return found.transforms

    def _named(
        self, one: TransformStamped | TfdbError, source: Source
    ) -> TransformStamped | TfdbError:
        """A transform of which both names are there; else the error of a store that gets it."""
        if isinstance(one, TfdbError) or (one.parent and one.child):
            return one
        if self._empty is None:  # a store takes address space, which may be scarce
            self._empty = _core.Buffer()
        try:
            self._empty.set_transforms([one], authority=source.authority)
        except TfdbError as error:
            error.edge = one.child
            return error
        return one

    @property
    def model_name(self) -> str:
        """Who says where the fixed joints are."""
        return "urdf"

    def fixed_joints(self) -> list[TransformStamped]:
        """The static transforms of the robot's model that are wanted."""
        if self.joints is None:
            return []
        source = Source(self.model_name, OTHERS, self.model_name, 0)
        return self.transforms(self.joints.fixed, source, static=True)

    def joints_report(self) -> JointReport | None:
        """How many joint states were used and refused; None without a model."""
        return None if self.joints is None else self.joints.report()

    def transforms(
        self, given: Sequence[TransformStamped], source: Source, *, static: bool
    ) -> list[TransformStamped]:
        """What is left of the transforms of one message."""
        if self.is_idle:
            return list(given)
        is_out = self._rules.excludes_source(source)
        left = [
            self._renamed(each)
            for each in given
            if not is_out
            and self._rules.takes(source, each.parent, each.child)
            and (static or self._is_inside(each))
        ]
        self._left_out += len(given) - len(left)
        self._moving += 0 if static else len(left)
        return left

    def warn(self, what: str, depth: int) -> None:
        """Say which options did nothing, or too much; `depth` frames up is who asked for it."""
        for message in () if self.joints is None else self.joints.report().complaints():
            warnings.warn(f"{what}: {message}", TfdbWarning, stacklevel=depth)
        choice = self._choice
        unused = [entry for entry in choice.exclude if entry not in self._rules.used]
        if unused:
            plain = [entry for entry in unused if not set(entry) & set("*?")]
            hint = did_you_mean(plain, self._rules.names)
            message = f"exclude: no frame, topic or node of {what} is called {_few(unused)}{hint}"
            warnings.warn(message, TfdbWarning, stacklevel=depth)
        names = self._loaded()
        unknown = sorted(set(choice.rename) - names.keys())
        if unknown:
            hint = did_you_mean(unknown, names)
            message = f"rename: nothing was loaded of {what} that is called {_few(unknown)}{hint}"
            warnings.warn(message, TfdbWarning, stacklevel=depth)
        if self._all_outside() and not self._moving + self._selection.moving:
            message = f"{what}: nothing moves {self._described()}"
            warnings.warn(message, TfdbWarning, stacklevel=depth)
        for topic, count in self.untimed.items():
            message = f"{what}: {describe_untimed(topic, count)}"
            warnings.warn(message, TfdbWarning, stacklevel=depth)

    def check_renamed(self) -> None:
        """Raise UnknownFrame for a frame to be renamed of which no message spoke."""
        names = self._loaded()
        for frame in sorted(set(self._choice.rename) - names.keys()):
            raise _no_frame("rename", frame, sorted(names))

    def reason(self) -> str:
        """Why nothing is left."""
        one = self.left_out == 1
        what = "the only transform is" if one else f"all {self.left_out:,} transforms are"
        count = f"{what} left out by {self._choice.limits}"
        return f"{count}: nothing moves {self._described()}" if self._all_outside() else count

    def _all_outside(self) -> tuple[int, int] | None:
        """The first and last moving stamp that only the time window left out."""
        found = [ends for ends in (self._outside, self._selection.outside) if ends is not None]
        return (min(a for a, _ in found), max(b for _, b in found)) if found else None

    def _described(self) -> str:
        first, last = self.window
        since = "" if first is None else f" from {format_seconds(first)}"
        until = "" if last is None else f" to {format_seconds(last)}"
        outside = self._all_outside()
        there = " to ".join(map(format_seconds, outside or ()))
        given = [time for time in (self._choice.start, self._choice.end) if time is not None]
        meant = [time for time in given if time.may_be_offset(outside)]
        offsets = " and ".join(f"'+{format_seconds(each.ns)}'".replace(" s", "") for each in meant)
        hint = f"; did you mean {offsets}, from the start?" if meant else ""
        return f"{since}{until}, its stamps run from {there}{hint}".lstrip()

    def _is_inside(self, transform: TransformStamped) -> bool:
        first, last = self.window
        stamp: int = transform.stamp  # type: ignore[assignment]  # as it was decoded
        if (first is None or stamp >= first) and (last is None or stamp <= last):
            return True
        low, high = self._outside or (stamp, stamp)
        self._outside = min(low, stamp), max(high, stamp)
        return False

    def _renamed(self, transform: TransformStamped) -> TransformStamped:
        if not self._rules.renames:
            return transform
        parent, child = self._name(transform.parent), self._name(transform.child)
        return replace(transform, parent=parent, child=child)

    def _name(self, frame: str) -> str:
        name = self._names.get(frame)
        if name is None:
            name = self._names[frame] = self._rules.name(frame)
        return name


def describe_untimed(topic: str, count: int) -> str:
    """Say how many transforms of a topic have no timestamp."""
    what = f"{counted(count, 'transform')} of topic {topic!r}"
    if count == 1:
        return f"{what} has no timestamp and gets the log time of its message"
    return f"{what} have no timestamp and get the log time of their message"


def _window(choice: Choice, found: tuple[int, int] | None) -> Window:
    """The first and the last stamp that are wanted."""
    first = None if choice.start is None else choice.start.resolve(found)
    last = None if choice.end is None else choice.end.resolve(found)
    if choice.keep is not None:
        if found is None:
            raise InvalidArgument("keep counts back from the last moving stamp, and nothing moves")
        newest = found[1] if last is None else min(last, found[1])
        first = max(newest - choice.keep, 0 if first is None else first)
    if first is not None and last is not None and first > last:
        ends = f"{format_seconds(last)} lies before start, {format_seconds(first)}"
        raise InvalidArgument(f"end, {ends}", value=last)
    return first, last


def _seconds(keep: Any) -> int | None:
    """Nanoseconds of a positive number of seconds."""
    if keep is None:
        return None
    is_number = isinstance(keep, Real) and not isinstance(keep, bool)
    if not is_number or not 5e-10 < keep < 2**31:
        raise InvalidArgument(
            f"keep is how many seconds before the last moving stamp are kept, not {shown(keep)}",
            value=keep,
        )
    return round(float(keep) * 10**9)


def _names(option: str, given: Any) -> tuple[str, ...]:
    """Names of frames and others, without their leading slash."""
    one = isinstance(given, str | bytes) or not isinstance(given, Iterable)
    if getattr(given, "ndim", 1) == 0:  # an array of no dimension
        given, one = given.item(), True
    several = [given] if one else list(given)
    for name in several:
        if not isinstance(name, str) or not name.strip("/"):
            raise InvalidArgument(f"{option} are names, got {shown(name)}", value=name)
    return tuple(name.removeprefix("/") for name in several)


def _mapping(given: Any) -> dict[str, str]:
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise InvalidArgument(f"rename maps names to names, got {shown(given)}", value=given)
    old, new = _names("rename", given.keys()), _names("rename", given.values())
    for name in old:
        if old.count(name) > 1:
            raise InvalidArgument(f"rename: {name!r} is given two names", value=given)
    return dict(zip(old, new, strict=True))


def held_by(recordings: Sequence[Recording]) -> tuple[str, dict[str, str], str]:
    """The names of the files, their topics with types, and these in words."""
    path = ", ".join(str(recording.path) for recording in recordings)
    types = {absolute(t.name): t.type for recording in recordings for t in recording.topics}
    listed = ", ".join(f"{name} ({types[name]})" for name in sorted(types)[:20])
    return path, types, listed or "none at all"


def not_read(source: Source) -> str:
    """What is said of a topic whose messages have an encoding that is not read."""
    listed = ", ".join(encodings_of(source.type))
    return f"is encoded as {source.encoding[:40]!r}, which is not read: {listed} are"


def _pose_topics(given: Any) -> dict[str, str | None]:
    """Child frames, or None, by topic."""
    if given is None:
        return {}
    if isinstance(given, Mapping):
        return {
            absolute(topic): None if child is None else _names("pose_topics", child)[0]
            for topic, child in given.items()
        }
    if isinstance(given, str | bytes):
        return {absolute(given): None}
    if isinstance(given, Iterable):
        return {absolute(topic): None for topic in given}
    raise no_name(given)


def _unit(unit: Any) -> Unit | None:
    return None if unit is None else given_word("stamp_unit", unit, UNITS)


def _model(urdf: Any) -> RobotModel | None:
    if urdf is None:
        return None
    from tfdb.robots.robot_model import RobotModel  # noqa: PLC0415 - needs numpy
    from tfdb.robots.urdf import load_urdf  # noqa: PLC0415

    return urdf if isinstance(urdf, RobotModel) else load_urdf(urdf)


def _joint_states(model: RobotModel, taken: Iterable[str]) -> JointStates:
    from tfdb.robots.joint_states import JointStates  # noqa: PLC0415 - needs numpy

    return JointStates(model, taken)


def absolute(topic: Any) -> str:
    """The name of a topic with its leading slash."""
    if not isinstance(topic, str):
        raise no_name(topic)
    return "/" + topic.strip("/")


def no_name(topic: Any) -> InvalidArgument:
    """What is raised for a topic that is none."""
    kind = type(topic).__name__
    return InvalidArgument(f"topics are names or map names to names, got a {kind}", value=topic)


def no_topic(path: str, topic: str, held: str, known: Iterable[str]) -> RecordingError:
    """What is raised for a topic that is not there, of which `held` are."""
    hint = did_you_mean([topic], known)
    return RecordingError(path, f"no topic {topic!r}; its topics: {held}{hint}")


def _as_stamp(time: int | None) -> int | None:
    """A time in the range of stamps that the core compares."""
    return None if time is None else max(-(2**63), min(time, 2**63 - 1))


def _no_frame(option: str, frame: str, frames: Sequence[str]) -> UnknownFrame:
    near = near_names(frame, frames)
    hint = f"there are {_few(frames)}"
    if near:
        hint = f"did you mean {', '.join(map(repr, near))}?"
    return UnknownFrame(f"{option}: frame {frame!r} does not exist; {hint}", frame=frame)


def did_you_mean(names: Iterable[str], known: Iterable[str]) -> str:
    """Ask whether the names nearest to some that are not there were meant; empty: none is near."""
    known = sorted(known)
    near = dict.fromkeys(each for name in names for each in near_names(name, known, most=1))
    return f"; did you mean {', '.join(map(repr, near))}?" if near else ""


def _few(names: Sequence[str]) -> str:
    more = f" and {len(names) - 10} more" if len(names) > 10 else ""
    return ", ".join(map(repr, sorted(names)[:10])) + more

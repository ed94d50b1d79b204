"""Opens and checks recordings that are read together, under a selection."""

from __future__ import annotations

import os
from collections import deque
from contextlib import ExitStack
from copy import copy
from typing import TYPE_CHECKING

from tfdb import _core
from tfdb.data.errors import InvalidArgument, RecordingError, UnknownFrame
from tfdb.data.path_checks import check_paths
from tfdb.data.suggestions import did_you_mean, no_frame
from tfdb.data.time_arguments import check_order

from .containers import (
    FRAME_TRANSFORMS,
    POSE_TYPES,
    POSES_WITHOUT_CHILD,
    Source,
    encodings_of,
)
from .edge_rules import EdgeRules
from .recorded_edges import RecordedEdges
from .recording import Recording
from .rewriter import Rewriter
from .selection import absolute
from .topic_groups import Survey

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
    from pathlib import Path
    from typing import Self

    from tfdb._core import Buffer
    from tfdb.data.types import Paths
    from tfdb.robots.joint_states import JointStates
    from tfdb.robots.robot_model import RobotModel

    from .recording import Run
    from .rewriter import Window
    from .selection import Choice, Selection

    Step = Callable[[int], None]


def each_once(given: Paths) -> list[Path]:
    """List the paths; refuse one that comes twice."""
    paths = check_paths(given, RecordingError)
    seen: set[str] = set()
    for path in paths:
        real = os.path.realpath(path)
        if real in seen:
            raise InvalidArgument(f"{path} is given twice", path=str(path))
        seen.add(real)
    return paths


class OpenRecordings:
    """Recordings that are read together, under a selection: `given`, and `files` by their start.

    A context manager, which closes them. Threads: one.

    Raises
    ------
    RecordingError
        A file is not a recording, is damaged or cut short; a topic is missing or has another type.
    InvalidArgument
        No file, or a `stamp_unit` where no file is a trajectory.
    OSError
        A file cannot be opened.
    """

    def __init__(self, files: Paths, selection: Selection) -> None:
        self.choice: Choice = copy(selection.choice)
        paths = check_paths(files, RecordingError)
        if not paths:
            raise InvalidArgument("no recording to load: paths is empty")
        with ExitStack() as stack:
            self.given: list[Recording] = [
                stack.enter_context(
                    Recording(path, salvage=self.choice.salvage, stamp_unit=self.choice.stamp_unit)
                )
                for path in paths
            ]
            self._check()
            self.files: list[Recording] = sorted(self.given, key=lambda recording: recording.start)
            self._closing = stack.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._closing.close()

    @property
    def names(self) -> str:
        """The paths of the files."""
        return ", ".join(str(recording.path) for recording in self.given)

    @property
    def sources(self) -> list[Source]:
        """The sources that are read."""
        sources = [source for each in self.files for source in each.all_sources]
        return list(filter(self.choice.wants, sources))

    @property
    def count(self) -> int:
        """Number of messages that are read."""
        return sum(source.messages for source in self.sources)

    def read(self, step: Step | None = None) -> Iterator[Run]:
        """Read all messages, file by file; `step` as in `Recording.read`.

        Raises RecordingError at once if a file is damaged.
        """
        parts = deque(self.read_one(recording, step) for recording in self.files)
        return (run for _ in range(len(parts)) for run in parts.popleft())

    def read_one(self, recording: Recording, step: Step | None = None) -> Iterator[Run]:
        """Read the messages of one file."""
        return recording.read(self.choice.wants, self.choice.kind, step)

    def rewriter(self, step: Step | None = None, *, one_tree: bool = True) -> Rewriter:
        """Return the rewriter that selects and renames the transforms of all files, for one store.

        `one_tree`: they are read together, so groups of topics must agree. Otherwise they are
        written, and groups must agree that are written on one topic.

        Raises
        ------
        MixedSources
            Files contradict each other, or no topic was named and groups of topics disagree.
        UnknownFrame
            A frame of `frames` does not exist.
        InvalidArgument
            `end` before `start`; an offset without a moving transform; two frames would have one
            name.
        """
        return self.rewriters([(self.choice.prefix, self.files)], step, one_tree=one_tree)[0]

    def rewriters(
        self,
        robots: Sequence[tuple[str, Sequence[Recording]]],
        step: Step | None = None,
        *,
        one_tree: bool = True,
    ) -> list[Rewriter]:
        """Return one rewriter for each robot; each has its own prefix.

        Only a robot whose recordings have the joint states gets the joints of `urdf`.
        Offsets refer to the first and last stamp of all robots. Raises the errors of `rewriter`.
        """
        chosen = [self.choice.prefixed(prefix) for prefix, _ in robots]
        if self.choice.needs_survey:
            found = [self._survey(recordings, step) for _, recordings in robots]
            frames = sorted({frame for edges, _ in found for frame in edges.frames})
            for frame in sorted(set(self.choice.frames or ()) - set(frames)):
                if EdgeRules(self.choice, None).excludes_frame(frame):
                    entries = sorted(self.choice.exclude)
                    text = f"frames: frame {frame!r} is left out by exclude={entries}"
                    raise UnknownFrame(text, frame=frame)
                raise no_frame("frames", frame, frames)
            ends = [stamp for edges, _ in found for stamp in edges.span or ()]
            window = window_of(self.choice, (min(ends), max(ends)) if ends else None)
            made = []
            for each, (edges, joints), (_, recordings) in zip(chosen, found, robots, strict=True):
                self._check_names(each, edges, recordings, step)
                children = None if each.frames is None else edges.between(each.frames)
                made.append(Rewriter(each, window, children, joints))
        else:
            made = [Rewriter(each, window_of(each, None), None) for each in chosen]
        for rewriter, (_, recordings) in zip(made, robots, strict=True):
            if not self.choice.mix:
                self._refuse_mixture(recordings, rewriter, one_tree=one_tree)
        return made

    def _refuse_mixture(
        self, recordings: Sequence[Recording], rewriter: Rewriter, *, one_tree: bool
    ) -> None:
        choice = self.choice
        survey = Survey(recordings, choice.wants, choice.kind, rewriter.without_names())
        if choice.judges_groups and one_tree:
            survey.refuse_groups(choice.is_judged, apart=choice.by_namespace)
        elif choice.judges_groups:
            for group in sorted({_written(choice, source) for source in self.sources}):

                def joined(source: Source, group: str = group) -> bool:
                    return choice.is_judged(source) and _written(choice, source) == group

                survey.refuse_groups(joined, apart=choice.by_namespace)
        survey.refuse_parts()

    def _survey(
        self, recordings: Sequence[Recording], step: Step | None
    ) -> tuple[RecordedEdges, JointStates | None]:
        """Return the edges of recordings under their old names, and the joint-state converter."""
        choice = self.choice

        def filtered() -> Rewriter:
            return Rewriter(choice.of_origins(), (None, None), None)

        if choice.model is None:
            found = survey_edges(self, recordings, filtered(), step)
            if found is not None:
                return found, None
        everything: Buffer = _core.Buffer(history=None)
        first = filtered()

        def store(wanted: Callable[[Source], bool]) -> None:
            for recording in recordings:
                for run in recording.read(wanted, choice.kind, step):
                    first.ingest(run, everything, *choice.kind(run.source))

        joints = None
        store(lambda source: choice.wants(source) and not source.holds_joint_states)
        if choice.model is not None and any(map(self._has_joint_states, recordings)):
            # Frames of the recording's own transforms are not computed from joint states.
            taken = [info.name for info in everything.tree() if info.parent is not None]
            joints = _joint_states(choice.model, taken)
            first.joints = joints.again()
            fixed = first.fixed_joints()
            if fixed:
                everything.set_transforms(fixed, static=True)
            store(lambda source: choice.wants(source) and source.holds_joint_states)
        return RecordedEdges.of_store(everything), joints

    def _has_joint_states(self, recording: Recording) -> bool:
        """Return whether a recording has the topic of the model's joint states."""
        wanted = filter(self.choice.wants, recording.all_sources)
        return any(source.holds_joint_states for source in wanted)

    def _check_names(
        self,
        choice: Choice,
        edges: RecordedEdges,
        recordings: Sequence[Recording],
        step: Step | None,
    ) -> None:
        """Refuse new names that other frames have.

        Frames of different files may get one name if at most one of them has a parent.
        """
        groups: dict[str, list[str]] = {}
        for frame in edges.frames:
            new = choice.prefix + choice.rename.get(frame, frame)
            groups.setdefault(new, []).append(frame)
        joined = {new: group for new, group in groups.items() if len(group) > 1}
        if not joined:
            return
        files = [self._survey([recording], step)[0].frames for recording in recordings]
        for new, group in joined.items():
            for names in (edges.parents, *files):
                both = [frame for frame in group if frame in names]
                if len(both) > 1:
                    raise InvalidArgument(
                        f"rename: {both[0]!r} and {both[1]!r} would both be called {new!r}; give "
                        "one of them another name",
                        value=new,
                    )

    def _check(self) -> None:
        """Refuse topics that are missing or cannot be read, and files without a readable topic."""
        choice = self.choice
        unit = choice.stamp_unit
        if unit is not None and all(each.rows is None for each in self.given):
            reason = f"stamp_unit is valid for text trajectories only; {self.names} is a recording"
            raise InvalidArgument(reason, value=unit, path=self.names)
        types = {absolute(t.name): t.type for each in self.given for t in each.topics}
        held = ", ".join(f"{name} ({types[name]})" for name in sorted(types)[:20]) or "none at all"
        sources = [source for recording in self.given for source in recording.all_sources]
        self._check_poses({absolute(s.topic): s for s in sources}, types, held)
        given = {absolute(source.topic) for source in sources if source.holds_transforms}
        roles = choice.roles
        if roles is None and not given and not choice.reads_others:
            more = next((_way_on(source) for source in sources if source.type in POSE_TYPES), "")
            raise RecordingError(self.names, f"no topic with transforms{more}; its topics: {held}")
        if roles is not None and not roles and not choice.reads_others:
            raise InvalidArgument(
                f"topics is empty: name topics of {self.names}, or pass None for every topic of "
                f"transforms; its topics: {held}",
                value=[],
                path=self.names,
            )
        unread = {absolute(s.topic): s for s in sources if s.type in FRAME_TRANSFORMS}
        for name in sorted(set(roles or ()) - given):
            if name in unread:
                raise RecordingError(self.names, f"topic {name!r} {_not_read(unread[name])}")
            if name in types:
                raise RecordingError(
                    self.names, f"topic {name!r} holds {types[name]}, not transforms"
                )
            raise self._no_topic(name, held, given)

    def _check_poses(
        self, by_topic: Mapping[str, Source], types: Mapping[str, str], held: str
    ) -> None:
        """Refuse pose topics that are missing or hold no poses; find the topic of joint states."""
        for topic, child in self.choice.pose_topics.items():
            source = by_topic.get(topic)
            if topic not in types:
                raise self._no_topic(topic, held, types)
            if source is None or source.type not in POSE_TYPES:
                kinds = ", ".join(sorted(POSE_TYPES))
                raise RecordingError(
                    self.names,
                    f"topic {topic!r} holds {types[topic]}, not poses: those are {kinds}",
                )
            if source.encoding not in encodings_of(source.type):
                raise RecordingError(self.names, f"topic {topic!r} {_not_read(source)}")
            if child is None and source.type in POSES_WITHOUT_CHILD:
                raise RecordingError(
                    self.names,
                    f"topic {topic!r} holds {types[topic]}, which does not name the child frame: "
                    f"give it, pose_topics={{{topic!r}: 'base_link'}} "
                    f"(--pose-topic {topic}=base_link)",
                )
        if self.choice.model is not None:
            self.choice.joint_topic = self._joint_topic(by_topic, held)

    def _joint_topic(self, sources: Mapping[str, Source], held: str) -> str:
        found = {
            topic: source
            for topic, source in sources.items()
            if source.holds_joint_states and source.encoding in ("ros1", "cdr")
        }
        wanted = self.choice.joint_topic
        if wanted is None:
            usual = "/joint_states"
            if len(found) > 1 and usual not in found:
                listed = ", ".join(sorted(found))
                raise RecordingError(
                    self.names, f"several topics of joint states, name one by joint_topic: {listed}"
                )
            wanted = usual if usual in found else next(iter(found), usual)
        if wanted not in found:
            raise RecordingError(
                self.names,
                f"no topic {wanted!r} with joint states for the model; its topics: {held}",
            )
        return wanted

    def _no_topic(self, topic: str, held: str, known: Iterable[str]) -> RecordingError:
        hint = did_you_mean([topic], known)
        return RecordingError(self.names, f"no topic {topic!r}; its topics: {held}{hint}")


def survey_edges(
    opened: OpenRecordings,
    recordings: Sequence[Recording],
    rewriter: Rewriter,
    step: Step | None = None,
) -> RecordedEdges | None:
    """Return the edges that a rewriter keeps of recordings; None if only a store can tell."""
    survey = _core.EdgeSurvey()
    for recording in recordings:
        for run in opened.read_one(recording, step):
            rewriter.survey(run, survey, *opened.choice.kind(run.source))
    found = survey.edges()
    return None if found is None else RecordedEdges.of_survey(found)


def rewriter_without_survey(choice: Choice) -> Rewriter:
    """Return the rewriter of a growing file. Refuses options that need the whole file."""
    needed = {
        "frames": choice.frames,
        "keep": choice.keep,
        "urdf": choice.model,
        "stamp_unit": choice.stamp_unit,
        "salvage": choice.salvage,
        "start as an offset": choice.start is not None and choice.start.since,
        "end as an offset": choice.end is not None and choice.end.since,
    }
    given = ", ".join(name for name, value in needed.items() if value)
    if given:
        raise InvalidArgument(f"{given}: not valid while the file is still being written")
    return Rewriter(choice, window_of(choice, None), None)


def window_of(choice: Choice, found: tuple[int, int] | None) -> Window:
    """Return the first and last selected stamp; `found` has the first and last stored one."""
    first = None if choice.start is None else choice.start.resolve(found)
    last = None if choice.end is None else choice.end.resolve(found)
    if choice.keep is not None:
        if found is None:
            raise InvalidArgument(
                "keep counts back from the last moving stamp, but the selection has no moving "
                "transform"
            )
        newest = found[1] if last is None else min(last, found[1])
        first = max(newest - choice.keep, 0 if first is None else first)
    if first is not None and last is not None:
        check_order(first, last)
    return first, last


def _written(choice: Choice, source: Source) -> str:
    """Return the group of the topic on which a source is written."""
    return choice.written_topic(source).removesuffix("_static")


def _way_on(source: Source) -> str:
    """Hint at the option that reads the poses of a topic, if no topic has transforms."""
    if source.encoding in encodings_of(source.type):
        return f"; pose_topics={source.topic!r} (--pose-topic {source.topic}) reads its poses"
    return f"; topic {source.topic!r} {_not_read(source)}"


def _not_read(source: Source) -> str:
    """Describe the unknown encoding of a topic."""
    listed = ", ".join(encodings_of(source.type))
    return f"is encoded as {source.encoding[:40]!r}; tfdb reads {listed}"


def _joint_states(model: RobotModel, taken: Iterable[str]) -> JointStates:
    from tfdb.robots.joint_states import JointStates  # noqa: PLC0415 - needs numpy

    return JointStates(model, taken)

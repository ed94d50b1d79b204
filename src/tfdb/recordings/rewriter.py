"""Selects and renames recorded messages on their way into a store or a file."""

from __future__ import annotations

import warnings
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias, TypedDict, cast

from tfdb import _core
from tfdb.data.counting import counted
from tfdb.data.errors import TfdbError, TfdbWarning, UnknownFrame
from tfdb.data.refused_transforms import Refused
from tfdb.data.stamps import format_seconds
from tfdb.data.suggestions import did_you_mean, first_few, no_frame

from .containers import Source
from .edge_rules import EdgeRules
from .pose_messages import decode_joint_state, decode_poses
from .selection import OTHERS, absolute

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

    from tfdb._core import Buffer, Recorded
    from tfdb.data.types import IngestResult, TransformStamped
    from tfdb.robots.joint_states import JointReport, JointStates

    from .recording import Run
    from .selection import Choice

    class _Chosen(TypedDict):
        selection: _core.Selection | None
        rules: dict[int, int]

    Window: TypeAlias = tuple[int | None, int | None]


class Rewriter:
    """Selects transforms of messages, and renames frames.

    Parameters
    ----------
    choice
        The selection.
    window
        First and last stamp of moving transforms to keep.
    children
        Child frames of the edges to keep; None: all.
    joints
        Converter of joint states to transforms.
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
        """Errors of messages without a valid transform."""
        self.refused_members: list[TfdbError] = []
        """Errors of transforms whose message has other, valid transforms."""
        self.is_idle: bool = choice.is_idle
        # Counts of messages that are rewritten in Python; `_selection` counts the others.
        self._names: dict[str, str] = {}
        self._left_out = 0
        self._moving = 0
        self._outside: tuple[int, int] | None = None
        self.untimed: Counter[str] = Counter()

    @property
    def shift(self) -> int:
        """Nanoseconds to add to the stamps of moving transforms, after the selection by time."""
        return self._selection.shift

    @shift.setter
    def shift(self, nanoseconds: int) -> None:
        self._selection.shift = nanoseconds
        self.is_idle = self._choice.is_idle and not nanoseconds

    @property
    def left_out(self) -> int:
        """Number of skipped transforms."""
        return self._left_out + self._selection.left_out

    @property
    def moving(self) -> int:
        """Number of kept moving transforms, if there is a choice."""
        return self._moving + self._selection.moving

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
        """Store the wanted part of a run, as `_core.ingest_recorded` does."""
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
        """Add the wanted part of a run of TFMessages to messages to write."""
        sources = {
            id_: (source.authority, self._rules.number(source))
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
        """Add the wanted part of a run to a survey."""
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
        """Add the wanted part of a run to a log; `publishers` by source."""
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
        """Return the child frames of the wanted part of a run, by source.

        Each has its first and last stamp.
        """
        part, chosen = self._part(run, static=static)
        return _core.recorded_children(*part, encoding=encoding, static=static, **chosen)

    def _part(self, run: Run, *, static: bool) -> tuple[tuple[Recorded, int, int], _Chosen]:
        """Return a run of messages with transforms, and its selection."""
        if not run.source.is_tf:
            made = self._made(run, static=static)
            return (made, 0, len(made)), {"selection": None, "rules": {}}
        part = run.messages, run.first, run.last
        if self.is_idle:
            return part, {"selection": None, "rules": {}}
        rules = {id_: self._rules.number(source) for id_, source in run.sources.items()}
        return part, {"selection": self._selection, "rules": rules}

    def _made(self, run: Run, *, static: bool) -> Recorded:
        """Convert the wanted part of other messages to messages with transforms."""
        made = _core.Recorded()
        for received, id_, _, left in self.remaining(run, static=static):
            encoded = self.encoded(left, OTHERS) if left else None
            if encoded is not None:
                made.add(received, id_, encoded[0])
        return made

    def remaining(
        self, run: Run, *, static: bool
    ) -> Iterator[tuple[int, int, int, list[TransformStamped]]]:
        """Yield receive time, source, number of transforms and kept transforms of each message.

        The error of a message that cannot be read is added to `refusals`.
        """
        for index in range(run.first, run.last):
            received, id_, data = run.messages[index]
            source = run.sources[id_]
            try:
                given = self.decoded(data, source, received, static=static)
            except TfdbError as error:
                self.refusals.append(error)
            else:
                yield received, id_, len(given), self.transforms(given, source, static=static)

    def encoded(
        self, transforms: Sequence[TransformStamped], encoding: str
    ) -> tuple[bytes, int] | None:
        """Encode transforms as a TFMessage; return it with their number. None if none is valid.

        The errors of invalid transforms are added to `refused_members`; without a valid one, the
        first error is added to `refusals`.
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
        """Decode the transforms of one message; errors of members are added to `refused_members`.

        Raises CorruptMessage, or the first error if no member can be read, with all errors in
        `refused`. Transforms without a timestamp get the receive time `received`.
        """
        given = self._decoded(data, source, received, static=static)
        space = self.space(source)
        if not space:
            return given
        return [
            replace(one, parent=space + one.parent, child=space + one.child)
            if one.parent and one.child
            else one
            for one in given
        ]

    def space(self, source: Source) -> str:
        """Return the prefix that `by_namespace` gives to the frames of a topic."""
        return self._rules.space(source)

    def old_name(self, frame: str) -> str:
        """Return the name that a loaded frame has in the recording."""
        return next((old for old, new in self._loaded().items() if new == frame), frame)

    def _loaded(self) -> dict[str, str]:
        """Return the new names of loaded frames by their old ones; empty without renaming."""
        names = dict(self._names)
        for edge in self._selection.kept() if self._choice.renames else ():
            frames = [each for each in self._rules.frames(*edge) if each and each.isprintable()]
            names |= {frame: self._rules.name(frame) for frame in frames}
        return names

    def again(self) -> Rewriter:
        """Make an equal rewriter with empty counts."""
        return self._with(self._choice)

    def without_names(self) -> Rewriter:
        """Make a rewriter with the same selection that keeps all names."""
        return self._with(self._choice.without_names())

    def _with(self, choice: Choice) -> Rewriter:
        joints = None if self.joints is None else self.joints.again()
        return Rewriter(choice, self.window, self._rules.children, joints)

    def _decoded(
        self, data: bytes, source: Source, received: int, *, static: bool
    ) -> list[TransformStamped]:
        if source.is_tf:
            members = _core.decode_members(
                data, source.encoding, static=static, authority=source.authority
            )
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
        if source.holds_joint_states:
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

    @property
    def model_name(self) -> str:
        """Return the authority of the fixed joints."""
        return "urdf"

    def fixed_joints(self) -> list[TransformStamped]:
        """Return the wanted static transforms of the robot's model."""
        if self.joints is None:
            return []
        source = Source(self.model_name, OTHERS, self.model_name, 0)
        return self.transforms(self.joints.fixed, source, static=True)

    def joints_report(self) -> JointReport | None:
        """Return the counts of used and refused joint states; None without a model."""
        return None if self.joints is None else self.joints.report()

    def transforms(
        self, given: Sequence[TransformStamped], source: Source, *, static: bool
    ) -> list[TransformStamped]:
        """Return the wanted transforms of one message."""
        if self.is_idle:
            return list(given)
        is_out = self._rules.excludes_source(source)
        left = [
            self._renamed(each)
            for each in given
            if self._rules.takes(source, each.parent, each.child)
            and not is_out
            and (static or self._is_inside(each))
        ]
        self._left_out += len(given) - len(left)
        if static:
            return left
        self._moving += len(left)
        shift = self.shift
        return (
            [replace(each, stamp=cast("int", each.stamp) + shift) for each in left]
            if shift
            else left
        )

    def warn(self, what: str, depth: int, *, untimed: bool = True) -> None:
        """Warn of options without effect, or that skip everything; the caller is `depth` frames up.

        `untimed`: warn also of transforms without a timestamp.
        """
        warn_of_names([self], what, depth + 1)
        self.warn_of_data(what, depth + 1, untimed=untimed)

    def warn_of_data(self, what: str, depth: int, *, untimed: bool = True) -> None:
        """Warn as `warn`, but not of names in options."""
        for message in () if self.joints is None else self.joints.report().complaints():
            warnings.warn(f"{what}: {message}", TfdbWarning, stacklevel=depth)
        if self._all_outside() and not self.moving:
            message = f"{what}: no moving transform {self._described()}"
            warnings.warn(message, TfdbWarning, stacklevel=depth)
        for topic, count in self.untimed.items() if untimed else ():
            message = f"{what}: {describe_untimed(topic, count)}"
            warnings.warn(message, TfdbWarning, stacklevel=depth)

    def check_renamed(self) -> None:
        """Raise UnknownFrame for a frame to be renamed that is missing or left out."""
        known = self._known()
        for frame in sorted(set(self._choice.rename) - known):
            raise no_frame("rename", frame, sorted(known))
        for frame in sorted((self._choice.rename.keys() & known) - self._loaded().keys()):
            text = f"rename: frame {frame!r} is left out by {self._choice.limits}"
            raise UnknownFrame(text, frame=frame)

    def _known(self) -> set[str]:
        """Return the old names of all seen frames, for error texts."""
        found = self._loaded().keys() | self._rules.seen
        return {each for each in found if each and each.isprintable()}

    def reason(self) -> str:
        """Return why no transform is left."""
        one = self.left_out == 1
        what = "the only transform is" if one else f"all {self.left_out:,} transforms are"
        count = f"{what} left out by {self._choice.limits}"
        return f"{count}: no moving transform {self._described()}" if self._all_outside() else count

    def _all_outside(self) -> tuple[int, int] | None:
        """Return the first and last moving stamp that only the time window left out."""
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
        return f"{since}{until}; the stamps run from {there}{hint}".lstrip()

    def _is_inside(self, transform: TransformStamped) -> bool:
        first, last = self.window
        stamp: int = transform.stamp  # type: ignore[assignment]  # as it was decoded
        if (first is None or stamp >= first) and (last is None or stamp <= last):
            return True
        low, high = self._outside or (stamp, stamp)
        self._outside = min(low, stamp), max(high, stamp)
        return False

    def _renamed(self, transform: TransformStamped) -> TransformStamped:
        if not (self._choice.renames and transform.parent and transform.child):
            return transform
        parent, child = self._name(transform.parent), self._name(transform.child)
        return replace(transform, parent=parent, child=child)

    def _name(self, frame: str) -> str:
        name = self._names.get(frame)
        if name is None:
            name = self._names[frame] = self._rules.name(frame)
        return name


def warn_of_names(rewriters: Sequence[Rewriter], what: str, depth: int) -> None:
    """Warn of names in `exclude` and `rename` that match nothing in `what`, which was rewritten.

    The rewriters differ only in their prefix. The caller is `depth` frames up.
    """
    choice = rewriters[0]._choice
    used = {entry for each in rewriters for entry in each._rules.used}
    unused = [entry for entry in choice.exclude if entry not in used]
    if unused:
        plain = [entry for entry in unused if not set(entry) & set("*?")]
        hint = did_you_mean(plain, {name for each in rewriters for name in each._rules.names})
        names = first_few([choice.written[entry] for entry in unused])
        message = f"exclude: no frame, topic or node of {what} matches {names}{hint}"
        warnings.warn(message, TfdbWarning, stacklevel=depth)
    known = {name for each in rewriters for name in each._known()}
    unknown = sorted(choice.rename.keys() - known)
    if unknown:
        hint = did_you_mean(unknown, known)
        message = f"rename: no frame of {what} is called {first_few(unknown)}{hint}"
        warnings.warn(message, TfdbWarning, stacklevel=depth)
    loaded = {name for each in rewriters for name in each._loaded()}
    left_out = sorted((choice.rename.keys() & known) - loaded)
    if left_out:
        message = f"rename: {first_few(left_out)} of {what} is left out by {choice.limits}"
        warnings.warn(message, TfdbWarning, stacklevel=depth)


def describe_untimed(topic: str, count: int) -> str:
    """Describe how many transforms of a topic have no timestamp."""
    what = f"{counted(count, 'transform')} of topic {topic!r}"
    if count == 1:
        return f"{what} has no timestamp and gets the log time of its message"
    return f"{what} have no timestamp and get the log time of their message"


def _as_stamp(time: int | None) -> int | None:
    """Limit a time to the range of stamps that the core compares."""
    return None if time is None else max(-(2**63), min(time, 2**63 - 1))

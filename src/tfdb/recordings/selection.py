"""The part of recordings to read, and new frame names."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from numbers import Real
from typing import TYPE_CHECKING, Any, Literal

from tfdb.data.argument_checks import check_flag, check_word
from tfdb.data.decimal_time import UNITS
from tfdb.data.errors import InvalidArgument
from tfdb.data.stamps import shown
from tfdb.data.time_arguments import time_of

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

    from tfdb.data.decimal_time import Unit
    from tfdb.data.stamps import StampLike
    from tfdb.data.time_arguments import Time
    from tfdb.data.types import PoseTopics, Topics
    from tfdb.robots.robot_model import RobotModel

    from .containers import Source
    from .selected import Selected

OTHERS: Literal["ros1"] = "ros1"
"""Encoding of transforms from messages that are not TFMessages."""
ROLES = ("tf", "tf_static")
"""The last part of a topic's name, which decides whether transforms are moving or static."""


def _option(metavar: str, text: str) -> dict[str, str]:
    """Describe a field for `--help`."""
    return {"metavar": metavar, "help": text}


@dataclass(frozen=True, kw_only=True)
class Selection:
    """The part of recordings to read, and new frame names.

    The fields are the keywords of `tfdb.load`, `Buffer.load` and `follow_recording`, and the
    options of the commands that read recordings: `start="+1"` is `--start +1`.

    Parameters
    ----------
    topics
        Topics to read; None: all topics with transforms (TFMessage, and Foxglove's FrameTransform
        and FrameTransforms). A mapping renames them, as in
        `{"/robot1/tf": "tf", "/robot1/tf_static": "tf_static"}`; a new name ends in `tf` or
        `tf_static`. TFMessages are static if the last part of the topic's name is `tf_static`.
        Foxglove's transforms are static if the name ends in `_static`.
    start, end
        First and last stamp of the moving transforms to read: nanoseconds, or text as on the
        command line. Text is in seconds (`"1700000012.5"`), in nanoseconds
        (`"1700000012500000000ns"`), or a date, in UTC unless it has a time zone
        (`"2026-05-17T12:00:00.25+02:00"`). `"+12.5"` counts from the first moving stamp of the
        recordings, `"-0.5"` back from the last. These two stamps depend on `exclude`, but not on
        `frames`. Static transforms are always read.
    keep
        Read only the last seconds of the data: this many before the last moving stamp, or before
        `end` if that is earlier.
    frames
        Read only the edges that connect these frames. If only one of them is in a tree, it is
        connected to the root.
    exclude
        Frames, topics or publishing nodes to skip; `*` stands for any characters, `?` for one. The
        name of a frame skips all its edges, so the frames below it become a separate tree. `frames`
        looks for paths without skipped edges. `"/tf_static:base_link"` skips one edge on one topic,
        named by its child frame.
    rename
        New frame names by the old ones, as in `{"map": "world"}`. `frames` and `exclude` use the
        old names.
    pose_topics
        Topics whose poses become moving edges: Odometry, TransformStamped, PoseStamped,
        PoseWithCovarianceStamped, Path, and Foxglove's PoseInFrame. The parent is the frame of the
        header, the child the one that the message names. A mapping sets the child:
        `{"/pose": "base_link"}`. With `topics=()` no other topic is read. Their poses must not
        disagree with each other or with the other topics, except with `mix`.
    urdf
        Robot model, or its file: joint states become moving edges, fixed joints static edges.
        Frames of the recording's own transforms are not overwritten by the model. The report's
        `joints` lists joints that are missing, unknown or beyond their limits.
    joint_topic
        Topic of the joint states; None: `/joint_states`, or the only one.
    stamp_unit
        Unit of the stamps in trajectory files: `"s"`, `"ms"`, `"us"` or `"ns"`. None: the unit in
        the header, otherwise by the size of the stamps, with a warning.
    prefix
        Text before the name of each frame, after `rename`: `"robot1/"`.
    by_namespace
        Prefix the frames of each group of topics: `robot1/` for `/robot1/tf` and
        `/robot1/tf_static`, `tf_old/` for `/tf_old`, none for `/tf`. Topics of poses get the prefix
        of their namespace. The other options use the prefixed names. Not with `urdf`.
    mix
        Load all topics and files into one tree, even if they disagree on an edge. At one stamp the
        last sample counts; lookups interpolate between samples of different sources.
    salvage
        Read damaged, cut and unindexed files as far as possible, and bag folders without their
        missing files; the report lists the losses. Rows of trajectories are sorted by their stamps.
        Rows without a valid stamp or pose are skipped.

    Raises
    ------
    InvalidArgument, InvalidStamp
        An invalid value of a field, or fields that exclude each other.
    ModelError
        `urdf` is not a robot model.
    """

    topics: Topics | None = field(
        default=None,
        metadata=_option(
            "FROM[:TO]",
            "Read only the topic FROM. FROM:TO also renames it to TO, which must end in tf or "
            "tf_static. Repeatable.  [default: all topics with transforms]",
        ),
    )
    start: StampLike | str | None = field(
        default=None,
        metadata=_option(
            "TIME", "Read no moving transform before this time. '+2' is 2 s after the first."
        ),
    )
    end: StampLike | str | None = field(
        default=None, metadata=_option("TIME", "Read no moving transform after this time.")
    )
    keep: float | None = field(
        default=None, metadata=_option("SECONDS", "Read only the last SECONDS of the data.")
    )
    frames: str | Iterable[str] | None = field(
        default=None,
        metadata=_option(
            "NAME",
            "Read only the edges that connect these frames; repeatable. A single frame is "
            "connected to its root.",
        ),
    )
    exclude: str | Iterable[str] = field(
        default=(),
        metadata=_option(
            "NAME",
            "Leave out the frame, topic or node NAME; * and ? work as in a shell. TOPIC:FRAME "
            "leaves out only the edge of FRAME on TOPIC. Repeatable.",
        ),
    )
    rename: Mapping[str, str] | None = field(
        default=None, metadata=_option("FROM:=TO", "Rename the frame FROM to TO; repeatable.")
    )
    pose_topics: PoseTopics | None = field(
        default=None,
        metadata=_option(
            "TOPIC[=CHILD]",
            "Also read the poses on TOPIC (Odometry, PoseStamped, Path ...) as poses of the frame "
            "CHILD; repeatable.",
        ),
    )
    urdf: str | os.PathLike[str] | RobotModel | None = field(
        default=None,
        metadata=_option("FILE", "Compute transforms from joint states with this robot model."),
    )
    joint_topic: str | None = field(
        default=None,
        metadata=_option(
            "TOPIC", "Topic of the joint states for --urdf.  [default: /joint_states]"
        ),
    )
    stamp_unit: Literal["s", "ms", "us", "ns"] | None = field(
        default=None,
        metadata=_option(
            "s|ms|us|ns",
            "Unit of the stamps in trajectory files.  [default: that of the header, otherwise "
            "guessed from the numbers]",
        ),
    )
    prefix: str = field(
        default="", metadata=_option("TEXT", "Put TEXT before the name of each frame.")
    )
    by_namespace: bool = field(
        default=False,
        metadata=_option(
            "",
            "Put the namespace of a topic before its frames: robot1/ before the frames of "
            "/robot1/tf.",
        ),
    )
    mix: bool = field(
        default=False,
        metadata=_option(
            "",
            "Load all data into one tree, even if topics or files disagree on an edge.",
        ),
    )
    salvage: bool = field(
        default=False,
        metadata=_option(
            "",
            "Read damaged, cut and unindexed files as far as possible. Sort the rows of "
            "trajectories and skip invalid rows. Print what is lost.",
        ),
    )

    def __post_init__(self) -> None:
        _ = self.choice

    @cached_property
    def choice(self) -> Choice:
        """The values in their normal form."""
        return Choice(self)


def selected(function: Callable[..., Any], options: Selected) -> Selection:
    """Make the selection from a function's `**options`. Raises TypeError for unknown names."""
    unknown = [name for name in options if name not in Selection.__dataclass_fields__]
    if unknown:
        from tfdb.data.signatures import describe_misfit, read_signature  # noqa: PLC0415 - rare

        parameters = list(read_signature(function).parameters.values())
        placed = sum(each.default is each.empty for each in parameters)
        raise TypeError(describe_misfit(function.__name__, parameters, placed, unknown))
    return Selection(**options)


class Choice:
    """A `Selection` with its values in normal form. Raises the errors of `Selection`."""

    def __init__(self, given: Selection) -> None:
        self.salvage: bool = check_flag("salvage", given.salvage)
        self.start: Time | None = time_of("start", given.start)
        self.end: Time | None = time_of("end", given.end)
        self.frames: tuple[str, ...] | None = (
            None if given.frames is None else _names("frames", given.frames)
        )
        if self.frames is not None and not self.frames:
            raise InvalidArgument("frames is empty: name frames, or give None for all", value=())
        written = _written_names("exclude", given.exclude)
        self.exclude: tuple[str, ...] = _without_slash(written)
        self.written: dict[str, str] = dict(zip(self.exclude, written, strict=True))
        """The entries of `exclude` as given, for warnings."""
        self.keep: int | None = _seconds(given.keep)
        self.rename: dict[str, str] = _mapping(given.rename)
        self.prefix: str = _prefix(given.prefix)
        self.pose_topics: dict[str, str | None] = _pose_topics(given.pose_topics)
        self.model: RobotModel | None = _model(given.urdf)
        if given.joint_topic is not None and self.model is None:
            raise InvalidArgument("joint_topic needs urdf: pass the robot's model as well")
        self.joint_topic: str | None = (
            None if given.joint_topic is None else absolute(given.joint_topic)
        )
        self.by_namespace: bool = check_flag("by_namespace", given.by_namespace)
        self.mix: bool = check_flag("mix", given.mix)
        if self.mix and self.by_namespace:
            raise InvalidArgument(
                "mix and by_namespace exclude each other: mix makes one tree, by_namespace several"
            )
        if self.model is not None and self.by_namespace:
            raise InvalidArgument(
                "by_namespace and urdf exclude each other: urdf describes one robot, so give its "
                "topics"
            )
        unit = given.stamp_unit
        self.stamp_unit: Unit | None = None
        if unit is not None:
            self.stamp_unit = check_word("stamp_unit", unit, UNITS)
        self.roles: dict[str, str] | None = _roles(given.topics)
        """The name to read each topic as; None: all topics under their own names."""

    @property
    def topics(self) -> set[str]:
        """The topics that the user names."""
        return {*(self.roles or ()), *self.pose_topics}

    @property
    def reads_others(self) -> bool:
        """Whether messages other than transforms are read."""
        return bool(self.pose_topics or self.model)

    @property
    def judges_groups(self) -> bool:
        """Whether groups of topics must agree. Named topics of transforms alone need not."""
        return not self.mix and (self.roles is None or bool(self.pose_topics))

    def wants(self, source: Source) -> bool:
        """Return whether a source is to be read."""
        topic = absolute(source.topic)
        named = self.roles is None or topic in self.roles
        if source.is_tf or (source.holds_transforms and named):
            return named
        if source.holds_joint_states:
            return self.model is not None and topic == self.joint_topic
        return topic in self.pose_topics

    def is_static(self, source: Source) -> bool:
        """Return whether the transforms of a source are static."""
        name = absolute(source.topic)
        role = (self.roles or {}).get(name, name)
        if role == name:
            return source.is_static
        return source.holds_transforms and role.rsplit("/", 1)[-1] == "tf_static"

    def kind(self, source: Source) -> tuple[str, bool]:
        """Return the shared properties of a run: the stored encoding, and whether it is static."""
        return source.encoding if source.is_tf else OTHERS, self.is_static(source)

    def is_judged(self, source: Source) -> bool:
        """Return whether a source has wanted transforms or poses."""
        return self.wants(source) and not source.holds_joint_states

    def written_topic(self, source: Source) -> str:
        """Return the topic on which the transforms of a source are written in a recording."""
        topic, roles = absolute(source.topic), self.roles or {}
        if not source.holds_transforms:
            return roles.get("/tf", "/tf")
        if topic in roles or source.is_tf:
            return roles.get(topic, topic)
        # The names of tf's topics: by them transforms are moving or static.
        return f"{topic.rpartition('/')[0]}/{'tf_static' if self.is_static(source) else 'tf'}"

    @property
    def limits(self) -> str:
        """The options that skip edges or stamps, as text; empty without one."""
        return _in_words(
            start=self.start,
            end=self.end,
            frames=self.frames and sorted(self.frames),
            exclude=sorted(self.exclude),
            keep=self.keep,
        )

    @property
    def renames(self) -> bool:
        """Whether frames are renamed, apart from the prefixes of `by_namespace`."""
        return bool(self.rename or self.prefix)

    @property
    def is_idle(self) -> bool:
        """Whether all transforms of the topics are kept under their names."""
        return not (self.limits or self.renames or self.by_namespace)

    @property
    def key(self) -> str:
        """A text that identifies the choice; empty for the default choice."""
        others = _in_words(
            rename=sorted(self.rename.items()),
            prefix=self.prefix,
            stamp_unit=self.stamp_unit,
            pose_topics=sorted(self.pose_topics.items(), key=str),
            urdf=self.model and sorted(self.model.joints.items()),
            joint_topic=self.joint_topic,
            by_namespace=self.by_namespace,
            mix=self.mix,
            salvage=self.salvage,
        )
        topics = "" if self.roles is None else f"topics={sorted(self.roles.items())}"
        return "; ".join(filter(None, (self.limits, others, topics)))

    @property
    def needs_survey(self) -> bool:
        """Whether the recordings must first be read once."""
        offsets = any(time is not None and time.since for time in (self.start, self.end))
        return bool(offsets or self.keep or self.frames or self.rename or self.model)

    def without_names(self) -> Choice:
        """Make the same choice without new names."""
        return self._but(prefix="", rename={})

    def of_origins(self) -> Choice:
        """Keep only the fields that select transforms by their origin."""
        everything = Choice(Selection())
        kept = ("exclude", "written", "pose_topics", "by_namespace", "roles")
        return everything._but(**{name: getattr(self, name) for name in kept})

    def prefixed(self, prefix: str) -> Choice:
        """Make the same choice with another prefix."""
        return self._but(prefix=_prefix(prefix))

    def _but(self, **values: Any) -> Choice:
        """Make a copy with other values."""
        made = copy(self)
        vars(made).update(values)
        return made


def _in_words(**values: object) -> str:
    """List the given values with their names."""
    return ", ".join(f"{name}={value!r}" for name, value in values.items() if value)


def _roles(topics: Any) -> dict[str, str] | None:
    if topics is None:
        return None
    if isinstance(topics, Mapping):
        return {absolute(name): role_of(name, role) for name, role in topics.items()}
    if isinstance(topics, str | bytes) or not isinstance(topics, Iterable):
        topics = [topics]
    return {absolute(name): absolute(name) for name in topics}


def role_of(topic: str, name: Any) -> str:
    """The name to read a topic as; raises InvalidArgument unless it ends in tf or tf_static."""
    role = absolute(name)
    if role.rsplit("/", 1)[-1] in ROLES or role == absolute(topic):
        return role
    reason = f"topic {topic!r} cannot be read as {name!r}, only as {' or '.join(ROLES)}"
    raise InvalidArgument(reason, value=name)


def _prefix(given: Any) -> str:
    if not isinstance(given, str):
        kind = type(given).__name__
        raise InvalidArgument(f"prefix must be a str, got {kind}", value=given)
    return given.removeprefix("/")


def _seconds(keep: Any) -> int | None:
    """Nanoseconds of a positive number of seconds."""
    if keep is None:
        return None
    is_number = isinstance(keep, Real) and not isinstance(keep, bool)
    if not is_number or not 5e-10 < keep < 2**31:
        raise InvalidArgument(
            f"keep must be a positive number of seconds below 2**31, got {shown(keep)}",
            value=keep,
        )
    return round(float(keep) * 10**9)


def _names(option: str, given: Any) -> tuple[str, ...]:
    """Names of frames and others, without their leading slash."""
    return _without_slash(_written_names(option, given))


def _without_slash(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(name.removeprefix("/") for name in names)


def _written_names(option: str, given: Any) -> tuple[str, ...]:
    """Names of frames and others, as given."""
    one = isinstance(given, str | bytes) or not isinstance(given, Iterable)
    if getattr(given, "ndim", 1) == 0:  # an array of no dimension
        given, one = given.item(), True
    several = [given] if one else list(given)
    for name in several:
        if not isinstance(name, str) or not name.strip("/"):
            raise InvalidArgument(f"{option} must be frame names, got {shown(name)}", value=name)
    return tuple(several)


def _mapping(given: Any) -> dict[str, str]:
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise InvalidArgument(f"rename must map names to names, got {shown(given)}", value=given)
    old, new = _names("rename", given.keys()), _names("rename", given.values())
    for name in old:
        if old.count(name) > 1:
            raise InvalidArgument(f"rename: {name!r} has two new names", value=given)
    return dict(zip(old, new, strict=True))


def _pose_topics(given: Any) -> dict[str, str | None]:
    """Child frames, or None, by topic."""
    if given is None:
        return {}
    if isinstance(given, Mapping):
        return {
            absolute(topic): None if child is None else _names("pose_topics", child)[0]
            for topic, child in given.items()
        }
    if isinstance(given, str | bytes) or not isinstance(given, Iterable):
        given = [given]
    return {absolute(topic): None for topic in given}


def _model(urdf: Any) -> RobotModel | None:
    if urdf is None:
        return None
    from tfdb.robots.robot_model import RobotModel  # noqa: PLC0415 - needs numpy
    from tfdb.robots.urdf import load_urdf  # noqa: PLC0415

    return urdf if isinstance(urdf, RobotModel) else load_urdf(urdf)


def absolute(topic: Any) -> str:
    """Return the name of a topic with its leading slash."""
    if not isinstance(topic, str):
        kind = type(topic).__name__
        raise InvalidArgument(
            f"topics must be names, or map names to names, got {kind}", value=topic
        )
    return "/" + topic.strip("/")

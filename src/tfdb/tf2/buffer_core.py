"""`BufferCore`: the calls of tf2_py.BufferCore on a `tfdb.Buffer`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NoReturn

from tfdb import _core
from tfdb._core import CoreCalls
from tfdb.data import errors
from tfdb.data.argument_checks import check_name, not_one_of
from tfdb.data.errors import (
    Disconnected,
    Extrapolation,
    InvalidArgument,
    InvalidTransform,
    TfdbError,
    UnknownFrame,
)
from tfdb.ros import msgs
from tfdb.ros.ros_messages import installed, makers
from tfdb.ros.times import SECOND, Flavor, duration, flavor_of, nanoseconds
from tfdb.store import waiting
from tfdb.store.report import frames_passed

from . import all_frames, phrases, refusals
from .exceptions import (
    ConnectivityException,
    InvalidArgumentException,
    LookupException,
    TransformException,
    with_fields_of,
)
from .lookup_failures import Gap, TwoTrees, lookup_failure

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfdb._core import Snapshot, Transform

__all__ = ["BufferCore"]

DEFAULT_CACHE_TIME = 10 * SECOND
LAST_STAMP = 2**61 - 1
Question = tuple[str, str, int]
Full = tuple[str, int, str, int, str]
Velocity = tuple[tuple[float, float, float], tuple[float, float, float]]


def _by_role(target: str, source: str, fixed: str | None = None) -> dict[str, str]:
    """Frame names by their role in tf2, in the order of the checks."""
    names = {"target_frame": target, "source_frame": source}
    if fixed is not None:
        names["fixed_frame"] = fixed
    return names


def _check_text(names: dict[str, str]) -> None:
    """Raise TypeError for the first of some names, by role, that is not a str."""
    for role, name in names.items():
        check_name(role, name)


class BufferCore(CoreCalls):
    """A store of transforms with the calls, texts and rules of `tf2_py.BufferCore`.

    Each call reads one committed state of a `tfdb.Buffer`. Times are those of any ROS library, of
    `tfdb.tf2.msgs`, or integer nanoseconds; time 0 is the latest common time. Results are real
    messages if the flavor's geometry_msgs is installed, otherwise those of `tfdb.tf2.msgs`.

    Parameters
    ----------
    cache_time
        A duration: how long samples are kept, relative to the newest of their edge. None: 10 s.
    flavor
        `ros1` or `ros2`: whose rules and texts to follow. None: detected from `cache_time`, the
        first stamp, or the installed ROS; otherwise `ros2`.
    buffer
        The store; None: a new one. It has its own history, so `cache_time` must be None.

    Raises InvalidArgumentException for a negative `cache_time` or an unknown flavor, TypeError for
    another type of time or buffer.
    """

    def __init__(
        self,
        cache_time: Any = None,
        *,
        flavor: Flavor | None = None,
        buffer: _core.Buffer | None = None,
    ) -> None:
        if flavor is not None and flavor not in ("ros1", "ros2"):
            text = not_one_of("flavor", flavor, ("ros1", "ros2"), "None")
            raise InvalidArgumentException(text, value=flavor)
        if buffer is not None and not isinstance(buffer, _core.Buffer):
            raise TypeError(f"buffer must be a tfdb.Buffer, got {type(buffer).__name__}")
        self._flavor: Flavor | None = flavor or flavor_of(cache_time)
        length = DEFAULT_CACHE_TIME
        if cache_time is not None:
            length = duration(cache_time, self.flavor, "cache_time")
            if buffer is not None:
                text = "a buffer has its own history: leave cache_time out"
                raise InvalidArgumentException(text, value=cache_time)
            if length < 0:
                text = f"cache_time must not be negative, got {length} ns"
                raise InvalidArgumentException(text, value=cache_time)
        # With length 0, tf2 keeps only the newest sample; 1 ns has the same effect.
        self._buffer = _core.Buffer(history=max(length, 1) / SECOND) if buffer is None else buffer
        self._flavor_known = False
        self._normalized: set[tuple[str, str]] = set()  # edges with a logged warning

    @property
    def buffer(self) -> _core.Buffer:
        """The store itself: snapshots, transactions, batches."""
        return self._buffer

    @property
    def flavor(self) -> Flavor:
        """The ROS version whose rules and texts apply: given, or detected."""
        return self._flavor or installed() or "ros2"

    def _nanoseconds(self, time: Any) -> int:
        """Return the nanoseconds of a time argument; its type sets an unknown flavor."""
        if not self._flavor_known:
            self._set_flavor(self._flavor or flavor_of(time))
        return nanoseconds(time, self._flavor)

    def _question(self, target_frame: str, source_frame: str, time: Any) -> Question:
        """Frames and stamp of a lookup's arguments. Raises TypeError."""
        check_name("target_frame", target_frame)
        check_name("source_frame", source_frame)
        return target_frame, source_frame, self._nanoseconds(time)

    def _full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> Full:
        """Frames and stamps of a full lookup's arguments. Raises TypeError."""
        target, source, target_stamp = self._question(target_frame, source_frame, target_time)
        check_name("fixed_frame", fixed_frame)
        return target, target_stamp, source, self._nanoseconds(source_time), fixed_frame

    def _set_flavor(self, flavor: Flavor | None) -> None:
        """Set the flavor, and let native calls answer plain lookups."""
        self._flavor = flavor
        self._flavor_known = flavor is not None
        self._answer_by(
            self._buffer,
            makers(self.flavor)[0],
            # A time of another class would determine the flavor.
            None if self._flavor_known else msgs.Time,
            change_kind=self.flavor == "ros2",
            only_new=self.flavor == "ros1",
        )

    # Writes

    def _set_transform(self, transform: Any, authority: str) -> None:
        """`set_transform` for all arguments."""
        self._set(transform, authority, static=False)

    def set_transform_static(self, transform: Any, authority: str) -> None:
        """Store T[header.frame_id<-child_frame_id] for all stamps, until another replaces it.

        As `set_transform`. A moving frame stays moving in ROS 1, and loses its samples in ROS 2.
        """
        self._set(transform, authority, static=True)

    def _set(self, transform: Any, authority: str, *, static: bool) -> bool:
        """Store a message; False if it was refused."""
        return self._store(
            refusals.Write.of(transform, authority, self._nanoseconds), static=static
        )

    def _store(self, write: refusals.Write, *, static: bool) -> bool:
        """Store a transform by the rules of the flavor; False if it was refused."""
        store = self._store_ros1 if self.flavor == "ros1" else self._store_ros2
        try:
            waiting.write(self._buffer, lambda: store(write, static=static))
        except TfdbError as error:
            write.check_members()
            if self.flavor == "ros2" and isinstance(error, InvalidTransform):
                unit = write.normalized()
                if unit is not None:
                    return self._store_normalized(write, unit, error, static=static)
            text = refusals.phrase(write, error, self.flavor)
            if text is None:
                raise
            refusals.log(text, error)
            return False
        return True

    def _store_normalized(
        self, write: refusals.Write, unit: refusals.Write, error: TfdbError, *, static: bool
    ) -> bool:
        """Store `unit`, which is `write` with a quaternion of length one; False if refused."""
        if not self._store(unit, static=static):
            return False
        edge = (write.parent, write.child)
        if edge not in self._normalized:
            self._normalized.add(edge)
            text = phrases.normalized(write.authority, write.child, write.rotation, write.length)
            refusals.log(text, error)
        return True

    def _store_ros1(self, write: refusals.Write, *, static: bool) -> None:
        """Store by ROS 1's rules: a frame keeps its first kind, and a stamp its first value."""
        buffer, parent, child = self._buffer, write.parent, write.child
        pose, authority = (write.translation, write.rotation), write.authority
        if static and not self._was_cleared(child):
            try:
                buffer.set_static_transform(parent, child, *pose, authority=authority)
            except errors.StaticConflict:
                pass
            else:
                return
        try:
            buffer.set_transform(
                parent, child, write.stamp, *pose, authority=authority, only_new=True
            )
        except errors.StaticConflict:
            buffer.set_static_transform(parent, child, *pose, authority=authority)

    def _was_cleared(self, frame: str) -> bool:
        """Whether a frame is moving and has been cleared, without samples since."""
        return self._buffer.frame_exists(frame) and self._buffer.frame_info(frame).cleared

    def _store_ros2(self, write: refusals.Write, *, static: bool) -> None:
        """Store by ROS 2's rules: a frame gets the new kind, and a stamp its last value."""
        parent, child, pose = write.parent, write.child, (write.translation, write.rotation)
        buffer, authority = self._buffer, write.authority
        if static:
            buffer.set_static_transform(parent, child, *pose, authority=authority, change_kind=True)
        else:
            buffer.set_transform(
                parent, child, write.stamp, *pose, authority=authority, change_kind=True
            )

    def clear(self) -> None:
        """Drop all moving samples; frames and static transforms stay."""
        self._buffer.clear()

    # Lookups

    def _lookup_transform_core(self, target_frame: str, source_frame: str, time: Any) -> Any:
        """`lookup_transform_core` for all arguments."""
        question = self._question(target_frame, source_frame, time)
        try:
            found = self._buffer.lookup_transform(target_frame, source_frame, question[2] or None)
        except TfdbError as error:
            found, stamp = self._answer_or_raise(question, error)
        else:
            stamp = found.stamp
        return makers(self.flavor)[0](target_frame, source_frame, stamp, found.pose.tolist())

    def lookup_transform_full_core(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> Any:
        """T[target_frame at target_time <- source_frame at source_time], through fixed_frame.

        Both halves read one state. The result has the target's stamp; arguments and errors as in
        `lookup_transform_core`.
        """
        asked = (target_frame, target_time, source_frame, source_time, fixed_frame)
        _, target_stamp, _, source_stamp, _ = self._full(*asked)
        try:
            found = self._buffer.lookup_transform_full(
                target_frame, target_stamp or None, source_frame, source_stamp or None, fixed_frame
            )
        except TfdbError as error:
            names = _by_role(target_frame, source_frame, fixed_frame)
            with self._buffer.snapshot() as snapshot:
                self._check_names(snapshot, names, "lookupTransform", error)
                source_half = (fixed_frame, source_frame, source_stamp)
                target_half = (target_frame, fixed_frame, target_stamp)
                below, _ = self._answer_in(snapshot, source_half, error)
                above, stamp = self._answer_in(snapshot, target_half, error)
                found = above @ below
        else:
            stamp = found.stamp
        return makers(self.flavor)[0](target_frame, source_frame, stamp, found.pose.tolist())

    def _can_transform_core(
        self, target_frame: str, source_frame: str, time: Any
    ) -> tuple[int, str]:
        """`can_transform_core` for all arguments."""
        _, _, stamp = self._question(target_frame, source_frame, time)
        if 0 <= stamp <= LAST_STAMP and self._buffer.can_transform(
            target_frame, source_frame, stamp or None
        ):
            return 1, ""
        return self._why_not(target_frame, source_frame, stamp)

    def can_transform_full_core(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> tuple[int, str]:
        """Whether `lookup_transform_full_core` succeeds: (1, '') or (0, reason)."""
        target_stamp = self._nanoseconds(target_time)
        source_stamp = self._nanoseconds(source_time)
        names = _by_role(target_frame, source_frame, fixed_frame)
        halves = [
            (target_frame, fixed_frame, target_stamp),
            (fixed_frame, source_frame, source_stamp),
        ]
        return self._can(names, halves)

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> Any:
        """Newest time at which every moving edge between two frames has data; 0 if nothing moves.

        A rospy.Time, an rclpy.time.Time or a `tfdb.tf2.msgs.Time`. Raises LookupException,
        InvalidArgumentException, ConnectivityException.
        """
        _check_text(_by_role(target_frame, source_frame))
        try:
            stamp = self._buffer.latest_common_time(target_frame, source_frame)
        except TfdbError as error:
            with self._buffer.snapshot() as snapshot:
                for name in (target_frame, source_frame):
                    self._check_names(snapshot, {"": name}, "get_latest_common_time", error)
                try:
                    stamp = snapshot.latest_common_time(target_frame, source_frame)
                except Disconnected as cause:
                    text = phrases.two_trees(target_frame, source_frame)
                    raise with_fields_of(cause, ConnectivityException, text) from cause
        return makers(self.flavor)[1](stamp)

    def lookupVelocityCore(  # noqa: N802 - tf2's name
        self, tracking_frame: str, observation_frame: str, time: Any, averaging_interval: Any
    ) -> Velocity:
        """Velocity of `tracking_frame` as seen from and in the axes of `observation_frame`.

        A finite difference over `averaging_interval` around `time` (0: the latest common time).
        Returns ((vx, vy, vz), (wx, wy, wz)) in m/s and rad/s.

        Raises what `lookup_transform_core` raises.
        """
        return self._velocity(
            (tracking_frame, observation_frame), time, averaging_interval, None, (0, 0, 0), None
        )

    def lookupVelocityFullCore(  # noqa: N802 - tf2's name
        self,
        tracking_frame: str,
        observation_frame: str,
        reference_frame: str,
        reference_point: Sequence[float],
        reference_point_frame: str,
        time: Any,
        averaging_interval: Any,
    ) -> Velocity:
        """As `lookupVelocityCore`, of a point on the tracked frame, in `reference_frame`.

        `reference_point` is in coordinates of `reference_point_frame`, metres.
        """
        frames = (tracking_frame, observation_frame)
        point, point_frame = reference_point, reference_point_frame
        return self._velocity(frames, time, averaging_interval, reference_frame, point, point_frame)

    def _velocity(
        self,
        frames: tuple[str, str],
        time: Any,
        interval: Any,
        reference: str | None,
        point: Sequence[float],
        point_frame: str | None,
    ) -> Velocity:
        roles = ("tracking_frame", "observation_frame", "reference_frame", "reference_point_frame")
        given = (*frames, reference, point_frame)
        names = {role: name for role, name in zip(roles, given, strict=True) if name is not None}
        _check_text(names)
        stamp = self._nanoseconds(time)
        span = duration(interval, self.flavor, "averaging_interval") / SECOND
        try:
            found = self._buffer.lookup_velocity(
                *frames[::-1],
                stamp or None,
                span,
                reference=reference,
                point=point,
                point_frame=point_frame,
            )
        except TfdbError as error:
            with self._buffer.snapshot() as snapshot:
                self._check_names(snapshot, names, "lookupVelocity", error)
                if isinstance(error, Extrapolation) and error.oldest == error.newest == error.stamp:
                    # Only one sample is in the interval.
                    start = max(0, (error.stamp or 0) - round(span * SECOND))
                    gap = Gap(error.edge or "", start, error.oldest, error.newest)
                    asked = (frames[1], frames[0], start)
                    raise self._refused(gap, asked, error) from error
                self._raise(snapshot, (frames[1], frames[0], stamp), error)
        vx, vy, vz = found.linear.tolist()
        wx, wy, wz = found.angular.tolist()
        return (vx, vy, vz), (wx, wy, wz)

    # Listings

    def all_frames_as_yaml(self) -> str:
        """All frames with a parent, as YAML: parent, broadcaster, rate, stamps, buffer length."""
        return all_frames.as_yaml(self._buffer.tree(), self.flavor)

    def all_frames_as_string(self) -> str:
        """All frames that have, or had, a parent: one line each."""
        return all_frames.as_string(self._buffer.tree())

    def _allFramesAsDot(self, time: Any = None) -> str:  # noqa: N802 - tf2's name
        """Return the tree as a DOT graph; with `time`, also the age of each edge."""
        stamp = None if time is None else self._nanoseconds(time)
        return all_frames.as_dot(self._buffer.tree(), stamp)

    def _chain(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> list[str]:
        """Return the frames on the path from source through fixed frame to target."""
        halves = [
            (fixed_frame, source_frame, self._nanoseconds(source_time)),
            (target_frame, fixed_frame, self._nanoseconds(target_time)),
        ]
        names = _by_role(target_frame, source_frame, fixed_frame)
        passed = [source_frame]
        with self._buffer.snapshot() as snapshot:
            self._check_names(snapshot, names, "lookupTransform", None)
            for half in halves:
                found, _ = self._answer_in(snapshot, half, None)
                for frame in frames_passed(found):
                    # Up to the fixed frame and down the same path.
                    if frame in passed:
                        del passed[passed.index(frame) :]
                    passed.append(frame)
        return passed

    def _frameExists(self, frame_id: str) -> bool:  # noqa: N802 - tf2's name
        """Whether a frame of that name exists."""
        return self._buffer.frame_exists(check_name("frame_id", frame_id))

    def _getFrameStrings(self) -> list[str]:  # noqa: N802 - tf2's name
        """Return the names of all frames, sorted."""
        return self._buffer.frames()

    # Texts for a missing answer

    def _why_not(self, target: str, source: str, stamp: int) -> tuple[int, str]:
        """The result of `can_transform_core` for a failed lookup."""
        question = target, source, stamp
        failure = lookup_failure(self._buffer, target, source, stamp)
        if failure is None:
            return self._can(_by_role(target, source), [question])
        return 0, refusals.reason(failure, self.flavor, target, source)

    def _can(self, names: dict[str, str], questions: list[Question]) -> tuple[int, str]:
        """Return (1, '') if all lookups succeed in one state, else 0 and the reason."""
        with self._buffer.snapshot() as snapshot:
            fault = self._name_fault(snapshot, names, "canTransform")
            if fault is not None:
                return 0, fault[1]
            try:
                for question in questions:
                    failure = self._failure_in(snapshot, question)
                    if failure is not None:
                        return 0, failure
            except TransformException as error:
                return 0, str(error)
        return 1, ""

    def _failure_in(self, snapshot: Snapshot, question: Question) -> str | None:
        """Return tf2's text for a failing lookup; None: it succeeds. Mostly without exceptions."""
        target, source, stamp = question
        if 0 <= stamp <= LAST_STAMP and snapshot.can_transform(target, source, stamp or None):
            return None
        failure = lookup_failure(snapshot, target, source, stamp)
        if failure is None:
            self._answer_in(snapshot, question, None)
            return None
        return refusals.reason(failure, self.flavor, target, source)

    def _answer_or_raise(self, question: Question, error: TfdbError) -> tuple[Transform, int]:
        """Return a transform if it is available by now, or raise tf2's error."""
        target, source, _ = question
        failure = lookup_failure(self._buffer, *question)
        if failure is not None:
            raise self._refused(failure, question, error) from error
        names = _by_role(target, source)
        with self._buffer.snapshot() as snapshot:
            self._check_names(snapshot, names, "lookupTransform", error)
            return self._answer_in(snapshot, question, error)

    def _answer_in(
        self, snapshot: Snapshot, question: Question, error: TfdbError | None
    ) -> tuple[Transform, int]:
        """T[target<-source] and its stamp in a snapshot, or tf2's error. The frames exist."""
        target, source, stamp = question
        if not 0 <= stamp <= LAST_STAMP:
            if lookup_failure(snapshot, target, source, stamp) is None:
                # The path has static edges only.
                return snapshot.lookup_transform(target, source), stamp
            self._raise(snapshot, question, error or InvalidArgument(stamp=stamp))
        try:
            found = snapshot.lookup_transform(target, source, stamp or None)
        except TfdbError as cause:
            self._raise(snapshot, question, cause)
        return found, found.stamp

    def _name_fault(
        self, snapshot: Snapshot, names: dict[str, str], function: str
    ) -> tuple[str, str] | None:
        """Return the role of the first name without a frame, and tf2's text for it."""
        _check_text(names)
        for role, name in names.items():
            if not name or name.startswith("/"):
                return name, phrases.bad_name(self.flavor, function, role, name)
            if not snapshot.frame_exists(name):
                return name, phrases.unknown(self.flavor, function, role, name)
        return None

    def _check_names(
        self, snapshot: Snapshot, names: dict[str, str], function: str, cause: TfdbError | None
    ) -> None:
        """Raise tf2's error for the first of some names, by role, without a frame."""
        fault = self._name_fault(snapshot, names, function)
        if fault is None:
            return
        name, text = fault
        if not name or name.startswith("/"):
            raise InvalidArgumentException(text, value=name) from cause
        error = UnknownFrame(frame=name) if cause is None else cause
        raise with_fields_of(error, LookupException, text, frame=name) from cause

    def _raise(self, snapshot: Snapshot, question: Question, cause: TfdbError) -> NoReturn:
        """Raise tf2's error for a lookup of existing frames."""
        target, source, stamp = question
        failure = lookup_failure(snapshot, target, source, stamp)
        if failure is None:
            raise refusals.translated(cause, self.flavor, target, source) from cause
        raise self._refused(failure, question, cause) from cause

    def _refused(
        self, failure: Gap | TwoTrees, question: Question, cause: TfdbError
    ) -> TransformException:
        """Make tf2's error for a failed lookup."""
        target, source, _ = question
        if isinstance(failure, Gap):
            return refusals.extrapolation(failure, self.flavor, target, source, cause)
        text = refusals.reason(failure, self.flavor, target, source)
        return with_fields_of(cause, ConnectivityException, text)

"""The compiled part of tfdb. Use the names that `tfdb` exports."""

from collections.abc import Callable, Iterable, Sequence
import os
from threading import Lock
from typing import Any, Literal, Self, final, overload

import numpy
import numpy.typing

import tfdb
from tfdb import (
    Buffer as Buffer,
    Snapshot as Snapshot,
    Transaction as Transaction
)
import tfdb.types


__version__: str

class Policy:
    """How a stamp picks a pose from an edge's samples. Use a subclass."""

    def __init__(self, kind: str, limit_ns: int | None = None) -> None: ...

    @property
    def kind(self) -> str:
        """Name of the rule."""

    @property
    def limit_ns(self) -> int | None:
        """Its limit in nanoseconds; None: no limit."""

@final
class Transform:
    """
    A rigid transform T[target<-source] at a stamp: p_target = T p_source. Immutable.

    Lookups return it; it can also be made from a translation (metres) and a unit quaternion
    (x, y, z, w) or a Rotation of scipy, `rpy` or `wxyz`, or from a whole pose in place of the
    translation: see `Buffer.set_transform`. `A @ B` chains T[a<-b] and T[b<-c] to T[a<-c] and raises InvalidArgument if
    A.source is not B.target, and InvalidTransform if the result is not finite; the result has
    the older of the two stamps (0: at all times).
    Equal ones (frames, stamp and pose) have the same hash. Its arrays are read-only.
    """

    def __new__(
        cls,
        target: str,
        source: str,
        translation: tfdb.types.VectorLike | tfdb.types.PoseLike,
        rotation: tfdb.types.QuaternionLike | None = None,
        stamp: tfdb.types.StampLike = 0,
        *,
        rpy: tfdb.types.VectorLike | None = None,
        wxyz: tfdb.types.WxyzLike | None = None,
    ) -> Self: ...

    def __hash__(self) -> int: ...

    def __eq__(self, other: object, /) -> bool: ...

    def __matmul__(self, other: Transform, /) -> Transform: ...

    @classmethod
    def from_matrix(
        cls,
        matrix: numpy.typing.ArrayLike,
        target: str,
        source: str,
        stamp: tfdb.types.StampLike = 0,
    ) -> Self:
        """
        T[target<-source] from a homogeneous matrix (4, 4): p_target = matrix p_source.

        Raises InvalidArray, and InvalidTransform, which says by how much, where it is not rigid: a
        last row other than 0 0 0 1, a reflection, a scale, a shear, numbers that are not finite.
        """

    def to_msg(self) -> Any:
        """
        A geometry_msgs/TransformStamped: the installed ROS's, or where there is none the one of
        `tfdb.tf2.msgs`. Its header.frame_id is the target, its child_frame_id the source.
        """

    def _numbers(
        self,
    ) -> tuple[
        tuple[float, float, float],
        tuple[float, float, float, float],
        tuple[float, float, float],
        tuple[tuple[float, float, float, float], ...],
    ]:
        """
        Translation, rotation, roll pitch yaw and the rows of the matrix, as floats.
        """

    def _repr_html_(self) -> str:
        """A table for notebooks."""

    def inverse(self) -> Transform:
        """
        T[source<-target]: the same in the other direction.

        Raises InvalidTransform where a translation is too large for the result to be finite.
        """

    @overload
    def apply(
        self, points: numpy.typing.NDArray[tfdb.types.Float]
    ) -> numpy.typing.NDArray[tfdb.types.Float]:
        """
        Map points of the source frame into the target frame.

        `points` is (3,) or (N, 3), float32 or float64 (anything else is converted to float64).
        A coordinate that is not a finite number is taken as it is. Returns a new array of the same
        shape and dtype. Raises InvalidArray, and InvalidTransform, with `index`, where a finite
        point has no finite place in that dtype.
        """
    @overload
    def apply(
        self, points: tfdb.types.ListsOrIntegers
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    @overload
    def apply(self, points: numpy.typing.ArrayLike) -> numpy.typing.NDArray[Any]: ...

    def __copy__(self) -> Self: ...

    def __deepcopy__(self, memo: object, /) -> Self: ...

    @property
    def translation(self) -> numpy.typing.NDArray[numpy.float64]:
        """Metres, x y z: float64 array (3,), read-only."""

    @property
    def rotation(self) -> numpy.typing.NDArray[numpy.float64]:
        """Unit quaternion, x y z w: float64 array (4,), read-only."""

    @property
    def pose(self) -> numpy.typing.NDArray[numpy.float64]:
        """x y z qx qy qz qw: float64 array (7,), read-only."""

    @property
    def matrix(self) -> numpy.typing.NDArray[numpy.float64]:
        """Homogeneous matrix: float64 array (4, 4), read-only."""

    @property
    def rpy(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        Roll, pitch, yaw in radians about fixed axes x, y, z, as in URDF: float64 array (3,),
        read-only. At a pitch of 90 degrees only their sum is defined, and roll is 0.
        """

    @property
    def stamp(self) -> int:
        """Its stamp, in nanoseconds."""

    @property
    def commit(self) -> int:
        """Number of the snapshot it was read from; 0 if it was not looked up."""

    @property
    def target(self) -> str:
        """The frame into which it maps."""

    @property
    def source(self) -> str:
        """The frame from which it maps."""

    @property
    def report(self) -> tfdb.types.Report:
        """
        How it was computed, edge by edge. Without edges if it was not looked up, or was
        multiplied.
        """

def _restore_transform(*state: object) -> Transform: ...

def _enough_rows(stamps: numpy.typing.NDArray[numpy.int64], poses: numpy.typing.NDArray[numpy.float64], metres: float, radians: float) -> numpy.typing.NDArray[numpy.int64]: ...

class StoreReader:
    """
    What Buffer and Snapshot can be asked.

    Each call on a Buffer is answered from one fresh snapshot; each call on a Snapshot from its own.
    """

    def __init__(self) -> None: ...

    def lookup_transform_full(self, target: str, target_stamp: tfdb.types.StampLike | None, source: str, source_stamp: tfdb.types.StampLike | None, fixed_frame: str, policy: Policy | None = None) -> Transform:
        """
        T[target at target_stamp <- source at source_stamp], through a frame that stays put.

        That is T[target<-fixed_frame] at `target_stamp` times T[fixed_frame<-source] at `source_stamp`:
        where a point that `source` saw then is for `target` now, if `fixed_frame` did not move.

        Parameters
        ----------
        target, source, fixed_frame
            Frame names.
        target_stamp, source_stamp
            Stamps in nanoseconds. None: the latest common time of that frame and `fixed_frame`, each from
            the same state. 0 is a stamp like any other.
        policy
            As in `lookup_transform`.

        Returns
        -------
        Transform
            Its stamp is the target's.

        Raises what `lookup_transform` raises.
        """

    def can_transform_full(self, target: str, target_stamp: tfdb.types.StampLike | None, source: str, source_stamp: tfdb.types.StampLike | None, fixed_frame: str, policy: Policy | None = None) -> bool:
        """Whether `lookup_transform_full` with these arguments has an answer."""

    def latest_common_time(self, target: str, source: str) -> int:
        """
        The newest stamp at which every moving edge between two frames has data.

        Nanoseconds; 0 if nothing moves. Of a frame and itself it is that of the frame's newest sample, as
        for tf2. Raises UnknownFrame, Disconnected.
        """

    def common_times(self, target: str, source: str) -> tuple[int, int]:
        """
        The oldest and the newest stamp at which the path between two frames has data.

        The path is that of the newest tree; at each stamp from the oldest to the newest every moving edge
        of it has data and the parent that it has there. The newest is `latest_common_time`; both are of one
        state. Where the oldest is above the newest, no stamp is covered by the whole path.

        Returns
        -------
        (int, int)
            Nanoseconds; both 0 if nothing moves. Of a frame and itself: those of its own samples, as for
            tf2.

        Raises UnknownFrame, Disconnected.
        """

    def lookup_velocity(self, target: str, source: str, stamp: tfdb.types.StampLike | None = None, interval: float = 0.1, *, reference: str | None = None, point: tfdb.types.VectorLike = (0, 0, 0), point_frame: str | None = None) -> tfdb.types.Twist:
        """
        Velocity of `source` as seen from `target`, by finite difference.

        Parameters
        ----------
        target, source
            Frame names, in the order of `lookup_transform`.
        stamp
            Middle of the interval, nanoseconds; None: the latest common time.
        interval
            Seconds over which the difference is taken. Where the data or a parent begins or ends, the
            interval is moved to lie inside; where there is less than that, it is all there is.
        reference
            The frame in whose axes the result is given; None: `target`.
        point, point_frame
            The point whose velocity `linear` is, in coordinates of `point_frame` (None: `source`).

        Returns
        -------
        Twist
            `linear` in m/s, `angular` in rad/s, both float64 (3,).

        Raises what `lookup_transform` raises; Extrapolation (`no data`) where there is one stamp only.
        """

    def _path_stamps(self, target: str, source: str, start: tfdb.types.StampLike | None, end: tfdb.types.StampLike | None) -> numpy.typing.NDArray[numpy.int64]:
        """
        Stored stamps of the moving edges between two frames, where every edge has data.
        """

    @property
    def commit(self) -> int:
        """
        Number of the newest commit; of a snapshot, its commit. 0 in an empty store. Raises BufferClosed.
        """

    @overload
    def lookup_edges(
        self,
        frames: Iterable[str],
        stamp: tfdb.types.StampLike | None = None,
        policy: Policy | None = None,
        *,
        out: numpy.typing.NDArray[tfdb.types.Float],
        dtype: None = None,
        missing: Literal['raise', 'nan'] = 'nan',
    ) -> numpy.typing.NDArray[tfdb.types.Float]:
        """
        T[parent<-frame] of many frames at one stamp, all from one snapshot.

        Row i is what `lookup_transform(parent, frames[i], stamp, policy)` gives in that snapshot, bit for
        bit, where `parent` is the parent that the frame has at that stamp: `parent_of(frames[i], stamp)`,
        or `tree_columns(stamp).parents` for all. Frames above the parent are not looked at.

        Parameters
        ----------
        frames
            Frame names.
        stamp
            Nanoseconds, the same for all. None: each edge's newest sample.
        policy
            How stamps between samples are answered. None: Interpolate().
        out
            Array to write to: float64 or float32, C-contiguous, (N, 7). An error, or Ctrl-C, may leave it
            partly written.
        dtype
            `numpy.float64` or `numpy.float32`, which rounds. None: that of `out`, or float64.
        missing
            `nan`: NaN in the row of a frame that does not exist, is a root at that stamp or has no data
            there. `raise`: the error of the first of them, with its `index`.

        Returns
        -------
        numpy.ndarray
            `out`, or a new array (N, 7): x y z qx qy qz qw.

        Raises InvalidArray, InvalidArgument, InvalidStamp; with `missing="raise"` UnknownFrame, Disconnected
        (a root), and what else `lookup_transform` raises.
        """
    @overload
    def lookup_edges(
        self,
        frames: Iterable[str],
        stamp: tfdb.types.StampLike | None = None,
        policy: Policy | None = None,
        *,
        out: numpy.typing.NDArray[tfdb.types.Float] | None = None,
        dtype: type[tfdb.types.Float] | numpy.dtype[tfdb.types.Float],
        missing: Literal['raise', 'nan'] = 'nan',
    ) -> numpy.typing.NDArray[tfdb.types.Float]: ...
    @overload
    def lookup_edges(
        self,
        frames: Iterable[str],
        stamp: tfdb.types.StampLike | None = None,
        policy: Policy | None = None,
        *,
        out: None = None,
        dtype: type[float] | None = None,
        missing: Literal['raise', 'nan'] = 'nan',
    ) -> numpy.typing.NDArray[numpy.float64]: ...

    @overload
    def transform_points(
        self,
        target: str,
        source: str,
        points: numpy.typing.NDArray[tfdb.types.Float],
        stamps: tfdb.types.StampsLike | tfdb.types.StampLike,
        policy: Policy | None = None,
        *,
        out: numpy.typing.NDArray[tfdb.types.Float] | None = None,
        missing: Literal['raise', 'nan'] = 'raise',
    ) -> numpy.typing.NDArray[tfdb.types.Float]:
        """
        Map points of `source` into `target`, each at its own stamp.

        Undoes the motion during a scan: `p_target[i] = T[target<-source](stamps[i]) p_source[i]`, all from
        one snapshot. Each is what `lookup_transform(target, source, stamps[i], policy).apply(points[i])`
        gives there, bit for bit; a coordinate that is not a number stays one. Where `apply` refuses a place
        that is not finite in the points' dtype, it is infinite or not a number here.

        Parameters
        ----------
        target, source
            Frame names.
        points
            (N, 3), float32 or float64; rows may be strided, as in `cloud[:, :3]`.
        stamps
            (N,) int64 nanoseconds, or one stamp for all points.
        policy
            How stamps between samples are answered. None: Interpolate().
        out
            Array to write to, like the points; the points themselves to work in place. It must not overlap
            the points otherwise, nor the stamps.
        missing
            `raise`: the error of the first stamp without an answer, with its `index`. `nan`: NaN for its
            points instead, whatever the reason; only a frame that does not exist is then an error.

        Returns
        -------
        numpy.ndarray
            `out`, or a new array (N, 3) of the points' dtype. Computed in float64.

        Raises InvalidArray, InvalidStamp, InvalidArgument, and what `lookup_transform` raises, with
        `index`.
        """
    @overload
    def transform_points(
        self,
        target: str,
        source: str,
        points: tfdb.types.ListsOrIntegers,
        stamps: tfdb.types.StampsLike | tfdb.types.StampLike,
        policy: Policy | None = None,
        *,
        out: numpy.typing.NDArray[numpy.float64] | None = None,
        missing: Literal['raise', 'nan'] = 'raise',
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    @overload
    def transform_points(
        self,
        target: str,
        source: str,
        points: numpy.typing.ArrayLike,
        stamps: tfdb.types.StampsLike | tfdb.types.StampLike,
        policy: Policy | None = None,
        *,
        out: numpy.typing.NDArray[numpy.floating[Any]] | None = None,
        missing: Literal['raise', 'nan'] = 'raise',
    ) -> numpy.typing.NDArray[Any]: ...

    def frames(self) -> list[str]:
        """Names of all frames, sorted."""

    def frame_exists(self, name: str) -> bool:
        """Return whether a frame has that name. Raises SnapshotTooOld."""

    def frame_info(self, name: str) -> tfdb.types.FrameInfo:
        """
        Return facts about one frame and the edge to its parent. Raises UnknownFrame.
        """

    def parent_of(self, name: str, stamp: tfdb.types.StampLike | None = None) -> str | None:
        """
        The parent that a frame has at a stamp (None: in its newest sample); None for a root.

        A sample's parent holds from its stamp to the next sample's; before the first sample and after the
        last one the nearest one's counts. A frame whose first parents would form a cycle is a root
        before its first sample. A static edge has its parent at every stamp. Raises UnknownFrame.
        """

    def _reach(self, target: str, source: str, stamp: int | None) -> tuple[str | None, int, int | None, int | None] | None:
        """
        Where walks up from two frames stop for want of data; None: they meet, or one does not exist.

        Walks up from the source to its root, then from the target to where that ended, as far as each edge
        has data. Returns the edge that the second walk stopped at, else that of the first (None: both
        ended at roots), the stamp, and the edge's oldest and newest stamp (None: it was cleared).
        """

    def tree(self, stamp: tfdb.types.StampLike | None = None) -> list[tfdb.types.FrameInfo]:
        """
        All frames, sorted by name, with the parents they have at a stamp (None: newest).
        """

    def tree_columns(self, stamp: tfdb.types.StampLike | None = None) -> tfdb.types.TreeColumns:
        """
        The frames and facts of `tree(stamp)` as columns, for stores of many frames.

        Row i is the i-th frame by name; the values are those of its FrameInfo, and an array holds -1 or NaN
        where that has None.
        """

    def _span(self) -> tuple[int, int] | None:
        """
        The first and the last stamp of all moving edges; None where nothing moves.
        """

    def samples(self, name: str) -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64], list[str]]:
        """
        All retained samples T[parent<-name] of the edge from `name` to its parents.

        Returns (stamps (N,) int64, poses (N, 7) float64, N names of parents), sorted by stamp. A static
        edge has one, with stamp 0; a root none. Raises UnknownFrame.
        """

    def lookup_transform(
        self,
        target: str,
        source: str,
        stamp: tfdb.types.StampLike | None = None,
        policy: Policy | None = None,
        *,
        timeout: float | None = None,
    ) -> Transform:
        """
        T[target<-source] at a stamp: maps points of `source` into `target`.

        Parameters
        ----------
        target, source
            Frame names.
        stamp
            Stamp in nanoseconds (or an object that holds one). None: the latest common time,
            at which every moving edge of the path has data.
        policy
            How a stamp between samples is answered. None: Interpolate().
        timeout
            Longest wait for an answer, in seconds; None: no wait. Only a buffer takes it. At
            its end the error of a plain lookup is raised; see `wait_for_transform`.

        Returns
        -------
        Transform
            With a report of the samples that were used.

        Raises
        ------
        UnknownFrame, Disconnected, Extrapolation, GapTooLarge, Stale, NoSampleNear, InvalidStamp,
        InvalidTransform (the numbers on the path are so large that the result is not finite),
        SnapshotTooOld, SnapshotClosed
        """

    def lookup_latest_transform(
        self,
        target: str,
        source: str,
        max_age: float | None = None,
        now: tfdb.types.StampLike | None = None,
    ) -> Transform:
        """
        T[target<-source] from each edge's own newest sample; nothing is interpolated.

        Parameters
        ----------
        target, source
            Frame names.
        max_age
            Seconds. An edge whose newest sample is older than `now - max_age` is refused.
        now
            Stamp in nanoseconds; None asks the buffer's clock.

        Returns
        -------
        Transform
            Its stamp is the oldest of the stamps used, 0 if nothing moves.

        Raises
        ------
        UnknownFrame, Disconnected, Extrapolation (an edge has no data), Stale,
        InvalidStamp, InvalidArgument, SnapshotTooOld, SnapshotClosed
        """

    def _lookup_edge(
        self, target: str, source: str, stamp: tfdb.types.StampLike | None, policy: Policy | None
    ) -> Transform:
        """
        `lookup_transform` over the edge from `source` to its parent `target`: no other edge is read.

        Raises Disconnected if the edge has another parent at the stamp, and what `lookup_transform`
        raises.
        """

    def can_transform(
        self,
        target: str,
        source: str,
        stamp: tfdb.types.StampLike | None = None,
        policy: Policy | None = None,
    ) -> bool:
        """
        Return whether `lookup_transform` with these arguments has an answer.

        Raises
        ------
        InvalidStamp, SnapshotTooOld, SnapshotClosed
        """

    def lookup_transforms(
        self,
        target: str,
        source: str,
        stamps: tfdb.types.StampsLike,
        policy: Policy | None = None,
        *,
        layout: Literal['pose', 'matrix'] = 'pose',
        out: numpy.typing.NDArray[numpy.float64] | None = None,
        missing: Literal['raise', 'nan'] = 'raise',
    ) -> numpy.typing.NDArray[numpy.float64]:
        """
        T[target<-source] at each of N stamps, all from one snapshot.

        Row i is what `lookup_transform(target, source, stamps[i], policy)` gives in that snapshot, bit for
        bit, and much faster: whatever the other stamps are and whichever instructions the processor has. A
        stored sample that is used as it is comes out as it was stored.

        Parameters
        ----------
        target, source
            Frame names.
        stamps
            (N,) int64 nanoseconds or datetime64, or a list of stamps; in any order.
        policy
            How stamps between samples are answered. None: Interpolate().
        layout
            `pose`: rows x y z qx qy qz qw. `matrix`: homogeneous 4x4 matrices, as `Transform.matrix`.
        out
            Array to write to: float64, C-contiguous, (N, 7) or (N, 4, 4), apart from the stamps in memory.
            An error, or Ctrl-C, may leave it partly written.
        missing
            `raise`: the error of the first stamp without an answer, with its `index`. `nan`: NaN in its
            row instead, whatever the reason; only a frame that does not exist is then an error.

        Returns
        -------
        numpy.ndarray
            `out`, or a new float64 array (N, 7) or (N, 4, 4).

        Raises InvalidArray, InvalidStamp, InvalidArgument, and what `lookup_transform` raises.
        """

class NativeSnapshot(StoreReader):
    """The native part of `Snapshot`."""

    def __init__(self) -> None: ...

    def state_bytes(self, *, frames: str | Iterable[str] | None = None, newest: int | None = None) -> bytes:
        """
        Return this state as bytes, for `apply` of another buffer.

        Parameters
        ----------
        frames
            Frames, or one: only these and their edges. A frame that the state lacks is left out: the commits
            that follow (`commits_bytes` with the same frames) make it. None: all.
        newest
            Largest number of samples of each edge, the newest ones. None: all.

        Raises SnapshotTooOld, SnapshotClosed; InvalidName for a name that no frame can have.
        """

    def at(self, commit: int) -> Snapshot:
        """
        Return a snapshot of a later commit.

        A held snapshot protects its own state and all later ones, so a follower of `changes` can open the
        state of each commit. Either of the two may be closed first. The returned one keeps as much memory
        as this one: take a new snapshot from time to time.

        Parameters
        ----------
        commit
            Number of the commit: this snapshot's own or a greater one.

        Returns
        -------
        Snapshot
            Its reads raise SnapshotTooOld if `snapshot_memory` did not suffice.

        Raises
        ------
        InvalidArgument
            The commit is older than this snapshot's, or does not exist yet.
        SnapshotClosed
        """

    def close(self) -> None:
        """
        Release the samples that only this snapshot needs. A second call does nothing.
        """

    @property
    def closed(self) -> bool:
        """True after close()."""

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: object, error: object, traceback: object) -> None: ...

    def __repr__(self) -> str: ...

class NativeBuffer(StoreReader):
    """The native part of `Buffer`."""

    def __init__(self, history: float | None = 10.0, *, max_frames: int = 1048575, memory_limit: int | None = None, snapshot_memory: int = 1073741824, clock: Callable[[], int] | None = None, concurrency: tfdb.types.Concurrency = 'snapshot') -> None: ...

    @property
    def shared(self) -> tfdb.types.Shared | None:
        """
        Facts about a shared store; None if the store is private to this process.
        """

    @overload
    def set_transform(
        self,
        transform: tfdb.types.TransformStampedLike,
        /,
        *,
        authority: str = "",
        change_kind: bool = False,
        only_new: bool = False,
    ) -> int:
        """
        Store T[parent<-child], the pose of `child` in `parent` at a stamp.

        `set_transform(T)` stores a `Transform` that a lookup returned: T.target is the parent, T.source
        the child, T.stamp the stamp. A `TransformStamped` and a ROS message of that name work as well.
        `authority`, `change_kind` and `only_new` may follow by keyword. A Transform with stamp 0 holds at
        all times and raises InvalidStamp: `set_transforms([T], static=True)` stores it.

        Parameters
        ----------
        parent, child
            Frame names; new ones become frames.
        stamp
            Nanoseconds (or an object that holds a stamp).
        translation
            Metres, x y z: a sequence, an array, or an object with x, y, z. Or the whole
            pose: a 4x4 matrix, 7 numbers x y z qx qy qz qw, a `Transform` T[parent<-child], or an
            object with translation and rotation.
        rotation
            Unit quaternion, x y z w, likewise, or a Rotation of scipy. Normalised if
            slightly off. None, without the next two: not rotated.
        rpy
            Instead: roll, pitch, yaw in radians about fixed axes x, y, z, as in URDF.
        wxyz
            Instead: unit quaternion w x y z.
        authority
            Name of the writer.
        change_kind
            A static edge becomes moving: its pose is dropped in the same commit, the
            frames below it stay.
        only_new
            Refuse a stamp that the edge has already; else the later value replaces it.

        Returns
        -------
        int
            Number of the commit.

        Raises
        ------
        InvalidName, InvalidStamp, InvalidArray, InvalidTransform, TooOld,
        StaticConflict, RepeatedStamp, CycleError, CapacityExceeded. Then nothing was stored.
        """
    @overload
    def set_transform(
        self,
        parent: str,
        child: str,
        stamp: tfdb.types.StampLike,
        translation: tfdb.types.VectorLike | tfdb.types.PoseLike,
        rotation: tfdb.types.QuaternionLike | None = None,
        *,
        rpy: tfdb.types.VectorLike | None = None,
        wxyz: tfdb.types.WxyzLike | None = None,
        authority: str = "",
        change_kind: bool = False,
        only_new: bool = False,
    ) -> int: ...

    def set_static_transform(self, parent: str, child: str, translation: tfdb.types.VectorLike | tfdb.types.PoseLike, rotation: tfdb.types.QuaternionLike | None = None, *, rpy: tfdb.types.VectorLike | None = None, wxyz: tfdb.types.WxyzLike | None = None, authority: str = '', change_kind: bool = False) -> int:
        """
        Store T[parent<-child] for every stamp, until a later commit replaces it.

        Arguments, result and errors as in `set_transform`; with `change_kind` a moving edge becomes static
        and its samples are dropped.
        """

    @overload
    def set_transforms(
        self,
        batch: Iterable[tfdb.types.TransformStampedLike] | tfdb.Columns,
        *,
        static: bool = False,
        authority: str = "",
        partial: Literal[False] = False,
        change_kind: bool = False,
        only_new: bool = False,
    ) -> int:
        """
        Store a batch of transforms T[parent<-child] in one commit: all or nothing.

        Parameters
        ----------
        batch
            A sequence of `TransformStamped` or of ROS messages of that name, or one `Columns`. Of two with
            the same child and stamp the later wins.
        static
            Whether they hold at every stamp until replaced.
        authority
            Name of the writer.
        partial
            Store the members that can be stored, still in one commit, and return the others.
        change_kind
            Members of the other kind than their edge, static or moving, change it: the samples that the
            edge has are dropped in the same commit, the frames below it stay.
        only_new
            Refuse members whose stamp their edge has already, or an earlier member: the first value stays.
            Not with `static`.

        Returns
        -------
        int
            Number of the commit; of the current one if the batch is empty.
        list[Refused]
            With `partial`: every member that was refused, and why, in their order.

        Raises InvalidName, InvalidStamp, InvalidArray, InvalidTransform, TooOld, StaticConflict,
        RepeatedStamp, CycleError: that of the first refused member, with its `index`, and all of them in
        `refused`. Raises CapacityExceeded. Then nothing was stored. With `partial` only CapacityExceeded is
        left, and
        TypeError for what is not a transform at all.
        """
    @overload
    def set_transforms(
        self,
        batch: Iterable[tfdb.types.TransformStampedLike] | tfdb.Columns,
        *,
        static: bool = False,
        authority: str = "",
        partial: Literal[True],
        change_kind: bool = False,
        only_new: bool = False,
    ) -> list[tfdb.types.Refused]: ...
    @overload
    def set_transforms(
        self,
        batch: Iterable[tfdb.types.TransformStampedLike] | tfdb.Columns,
        *,
        static: bool = False,
        authority: str = "",
        partial: bool = False,
        change_kind: bool = False,
        only_new: bool = False,
    ) -> int | list[tfdb.types.Refused]: ...

    def remove_frames(self, names: str | Iterable[str], *, recursive: bool = False) -> int:
        """
        Remove a frame, or several, with their edges in one commit, all or none.

        Their order does not matter: a frame may go together with all its children. With `recursive` all
        frames below them go as well. Returns the commit's number, the current one without names.

        A frame of a mirrored store (`apply`) stays, and so does all below it. It loses the parent that a
        local writer stored; without one, ReadOnly is raised.

        Raises UnknownFrame, FrameInUse (naming the children), with `index` and, for every name, `refused`,
        and ReadOnly.
        """

    def clear(self) -> int:
        """
        Drop all moving samples in one commit; frames and static edges stay.

        The samples that `apply` brings of another store stay, too: only this store clears them.

        The commit itself takes a little memory for each moving edge. Raises CapacityExceeded where
        `memory_limit` leaves none; nothing was then dropped.
        """

    def compact(self) -> bool:
        """
        Return unused memory to the operating system.

        A store uses memory that became free for what comes next, and keeps it. After a burst, after
        `clear`, or once samples have outlived `history` (whose memory an edge otherwise gives up bit by
        bit, as it is written to), this returns it: from a shared store to the file system that it lies on.
        It moves no samples, so memory goes back only where a piece of it is free from end to end: 256 KiB
        of a shared store (1/4096 of its size above 1 GiB), 2 MiB of another. What is free between edges
        that grew side by side is kept for what comes next.

        Nobody writes meanwhile (5 ms for 10 million samples, 15 ms for 60,000 frames, and 10 ms for each
        100 MiB that a shared store gives back); reads go on.

        Returns False, and gives nothing back, while an older state than the newest is held by a snapshot
        or a transaction, or a read is under way that writers have overtaken again and again: try again
        later. An open transaction, and the fourth of the snapshots that a process holds, may count as older
        than they are. Raises ReadOnly, TransactionActive, Forked, LockTimeout where another process
        keeps the lock, CorruptStore where the file was damaged.
        """

    def changes(self, since: int, limit: int | None = None, *, frames: str | Iterable[str] | None = None) -> list[tfdb.types.Changes]:
        """
        Return the changes of each commit after `since`, in order.

        All data of the newest state are in the record of the commit that stored them. Data that were
        evicted, replaced, cleared or removed since then may be missing: `gone` counts them. While a
        snapshot of commit `since`, or of an older one, is held and can be read, nothing that it or a later
        state shows is gone. A record does not say in which order a transaction did what it did: the guide
        "Follow the changes" keeps a copy by records where they suffice, and by snapshots else.

        Parameters
        ----------
        since
            A commit: that of a snapshot, or the last one that was followed. 0: from the beginning.
        limit
            Largest number of records; None: all.
        frames
            A frame, or several: only what commits did to these frames and their edges, and no record of a
            commit that did nothing to them. A follower reads `commit` of the buffer before the call, and
            goes on from there where fewer than `limit` records come. A frame may be missing yet. None: all
            frames.

        Returns
        -------
        list[Changes]
            Empty if nothing was committed since.

        Raises
        ------
        FeedLapped
            The feed, which holds the last 16,384 commits or fewer if they are large, does not reach back
            that far: take a snapshot and follow from its `commit`, or go on from the error's `commit` and
            miss the commits before. The error's `oldest` is overwritten next.
        InvalidArgument
            The commit does not exist yet, or `limit` is not positive.
        InvalidName
            No frame can have a name of `frames`.
        NotSupported
            The engine keeps no feed: `snapshot` and `giant` do.
        TransactionActive
            This thread has a transaction open in the store.
        """

    def commits_bytes(self, since: int, *, max_commits: int = 64, max_bytes: int = 1048576, frames: str | Iterable[str] | None = None) -> bytes:
        """
        Return the commits after `since` as bytes, for `apply` of another buffer.

        Each commit is whole, with everything that it stored, cleared and removed, poses to the last bit.
        `docs/wire.md` describes the bytes.

        Parameters
        ----------
        since
            A commit: that of a snapshot, or of the position that `apply` returned. 0: from the beginning.
        max_commits
            Largest number of commits.
        max_bytes
            Largest size. A single commit is never cut; a larger one is returned alone.
        frames
            Frames, or one: only these and their edges. A frame may be missing yet: the commit that makes it
            is returned. None: all.

        Returns
        -------
        bytes
            Empty if nothing was committed since.

        Raises
        ------
        FeedLapped
            The feed does not reach back that far: take `state_bytes` of a snapshot.
        Gone
            A sample of these commits is no longer kept. Hold a snapshot of your position to prevent it.
        InvalidArgument
            The commit does not exist yet, or a limit is not positive.
        InvalidName
            No frame can have a name of `frames`.
        NotSupported
            The engine keeps no feed: `snapshot` and `giant` do.
        TransactionActive
            This thread has a transaction open in the store.
        """

    def forget_source(self, source: str) -> bool:
        """
        Forget how far the commits of a source have been applied.

        For a source that begins anew while its clock is behind, so that `apply` raises Fenced, or for one that
        has ended. Its frames stay, and may be written by any writer. The next bytes of it must be a state, of
        any epoch, which replaces what it had. Its name and its prefix stay taken.

        Returns False, and changes nothing, if nothing of the source was applied. Raises as a write:
        ReadOnly, LockTimeout, NotSupported, TransactionActive.
        """

    def positions(self) -> list[tfdb.types.Position]:
        """
        Return how far the commits of each source have been applied.

        In the order in which the sources came first. A frozen store has none.
        """

    def _state_bytes_as(self, source: str) -> bytes:
        """
        Return the newest state as bytes that the later commits of this source follow; b"" if nothing of it was applied.
        """

    def _hand_over(self, source: str, how: Literal['follow', 'release', 'adopt'], epoch: tfdb.types.Epoch, commit: int = 0, from_: tfdb.types.Position | None = None) -> tuple[int, bool, int] | None:
        """
        Set the position of a source, in one commit, since its home is another one.

        `follow`: the new home goes on exactly at the position. `release`: this store is the home now, and its
        writers may write. `adopt`: it was the home, and what they stored is the source's from now on.
        `from_`: where the position must be; then `adopt` is for a store that was made the home there, and
        `follow` for one that was not. Returns the commit, whether the store was equal to the source before,
        and the source's commit then. Returns None, and changes nothing, if the position is elsewhere, or
        `adopt` names an earlier epoch than the position.
        """

    @property
    def epoch(self) -> tfdb.types.Epoch:
        """
        The store's epoch: a new store has a later one. Its commits are numbered in it.
        """

    def apply(self, data: bytes, *, source: str = '', prefix: str = '', shared: str | Iterable[str] = ()) -> tfdb.types.Position:
        """
        Apply commits or a state of another store, from `commits_bytes` or `state_bytes`.

        Each commit becomes one commit here. A state becomes one commit, which first takes away what this
        source had: no reader sees an empty or a mixed store. The position is stored by the same commit, so
        a process that is killed finds in `positions()` where to go on. Commits at or before the position
        are skipped.

        Frames of a source are read-only for all other writers (ReadOnly) until `forget_source`. But a frame
        that is a root at its source may get a parent here, by any writer. It is kept until the
        source itself gives the frame a parent, which a TfdbWarning then names. A frame that the source removes
        stays, without its samples, if a frame of another writer is its child.

        Parameters
        ----------
        data
            The bytes.
        prefix
            Text before the name of each frame, such as `robot1/`. It is fixed by the first call, and must
            not be the beginning of another source's prefix.
        shared
            Frames that get no prefix, such as `map`. Give the same ones with every call; a state may be
            applied with others.
        source
            What this store calls the other one.

        Returns
        -------
        Position
            How far the source's commits are applied: pass its `commit` to `commits_bytes`.

        Raises
        ------
        OutOfOrder
            Commits before these are missing, or they are of a later epoch, or the position was reached
            with other frames (`frames` of `commits_bytes` and `state_bytes`, or `shared`): apply a state
            first.
        Fenced
            They are of an epoch that has ended. If the clock of the source was set back, call
            `forget_source`, then apply a state.
        CorruptMessage
            The bytes are damaged, cut short, or of another version; `offset` is the byte.
        InvalidName, InvalidTransform, InvalidStamp, CycleError, FrameInUse
            They cannot be stored; InvalidTransform also for a commit that stores an edge twice.
        InvalidArgument
            The prefix is not the one of the first call, or it overlaps another source's.
        CapacityExceeded, ReadOnly, LockTimeout, NotSupported, TransactionActive
            As of a write.

        Of these bytes the commits before the refused one are applied; it and later ones are not.
        """

    def _applier(self, source: str, prefix: str, shared: Iterable[str]) -> Applier:
        """Return an object that applies messages of one source."""

    def wait_for_transform(
        self,
        target: str,
        source: str,
        stamp: tfdb.types.StampLike | None = None,
        timeout: float | None = None,
        *,
        policy: Policy | None = None,
    ) -> Transform:
        """
        Wait until `lookup_transform` has an answer, and return it.

        The commit that touches a frame of the path, or creates a missing one, ends the wait, from any
        thread or process. Other threads run meanwhile, and signal handlers without delay.

        Parameters
        ----------
        target, source, stamp, policy
            As in `lookup_transform`.
        timeout
            Seconds, at most; None: for ever.

        Returns
        -------
        Transform

        Raises
        ------
        At the end of the timeout what `lookup_transform` raises, and how long the wait took;
        InvalidName at once for a name that no frame can have; BufferClosed (`close` was called
        meanwhile), NoSuchStore (the shared store was removed meanwhile),
        TransactionActive, NotSupported (a research engine; or this process may not write to the
        control file of the store), InvalidArgument
        """

    def wait_for_commit(self, after: int, timeout: float | None = None) -> int:
        """
        Wait until there is a commit with a number greater than `after`.

        The commit wakes it, from any thread or process, at most once per millisecond: faster commits
        are seen together.

        Parameters
        ----------
        after
            The last commit that the caller knows: `commit`, or what this returned.
        timeout
            Seconds, at most; None: for ever.

        Returns
        -------
        int
            Number of the newest commit.

        Raises
        ------
        WaitTimeout, BufferClosed (`close` was called meanwhile), NoSuchStore (the shared store was
        removed meanwhile), TransactionActive, NotSupported (a research engine; or the store
        is frozen; or this process may not write to its control file), InvalidArgument
        """

    def _begin_wait(self, target: str, source: str, stamp: tfdb.types.StampLike | None, policy: Policy | None) -> int:
        """
        Number of a wait that `_ended_waits` will tell of; 0: the answer is there.
        """

    def _begin_wait_full(self, target: str, target_stamp: tfdb.types.StampLike | None, source: str, source_stamp: tfdb.types.StampLike | None, fixed_frame: str) -> int:
        """The same for an answer through a fixed frame."""

    def _begin_wait_as_new(self, target: str, source: str, stamp: tfdb.types.StampLike) -> int:
        """The same for a latest common time of `stamp` or newer."""

    def _begin_wait_for_commit(self, after: int) -> int:
        """The same for a commit with a greater number."""

    def _cancel_wait(self, number: int) -> bool:
        """Whether the wait had not ended; its end will not be reported."""

    def _ended_waits(self, timeout: float | None) -> dict[int, int]:
        """
        Wait until some of those that were begun end: their numbers, in order, and how they did.
        """

    def _await_ended_waits(self, timeout: float | None) -> None:
        """The same, but `_ended_waits(0)`, of any thread, is to take them."""

    def _set_waits_begun(self, begun: bool) -> None:
        """
        Whether `waiting.write` is to make the writes of tfdb.tf2, for waits were begun.
        """

    def _check_wait(self, how: int) -> int:
        """
        Raise what ended a wait, if it was not its time; else give the newest commit.
        """

    @staticmethod
    def _may_be_frame(name: str) -> bool:
        """Whether a frame can have the name."""

    def _stop_waits(self, stop: bool) -> None:
        """
        End all waits, and those to come, as if their time were over, until called with False.
        """

    def close(self) -> None:
        """
        End all waits with BufferClosed; later reads, writes and waits raise it.

        `commit`, `memory` and `counters` raise it as well. `history`, `concurrency`, `shared`, `frozen`
        and the repr can still be read.
        Snapshots and transactions that are open stay so. The memory goes with the last reference to them
        and to the buffer. Closing twice does nothing.
        """

    @property
    def closed(self) -> bool:
        """True after close()."""

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: object, error: object, traceback: object) -> None: ...

    def ingest(self, data: tfdb.types.BytesLike, *, encoding: str = 'cdr', static: bool = False, authority: str = '', change_kind: bool = False, only_new: bool = False) -> int:
        """
        Store one tf2_msgs/TFMessage from its bytes, as one commit.

        Refused transforms are left out, as in tf2, and the others are stored.

        Parameters
        ----------
        data
            The message: bytes, bytearray, memoryview.
        encoding
            `cdr` (ROS 2, with the encapsulation header), `ros1`, or one layout exactly: `cdr_le`,
            `cdr_be`, `cdr2_le`, `cdr2_be`, `cdr_bare_le`, `cdr_bare_be`.
        static
            Whether it came from /tf_static.
        authority
            Name of the sender.
        change_kind, only_new
            As in `set_transforms`.

        Returns
        -------
        int
            Number of the commit.

        Raises
        ------
        CorruptMessage
            The bytes are not a TFMessage. Fields: offset, reason.

        And what `set_transforms` raises, if no transform of the message can be stored. Nothing was stored
        where it raises.

        Warns
        -----
        TfdbWarning
            A transform was refused and others of its message were stored: once for each edge and error.

        One leading '/' of a frame name is dropped, as tf does.
        """

    def ingest_many(self, messages: Iterable[tfdb.types.BytesLike], *, encoding: str, static: bool = False, authority: str | Sequence[str] = '') -> tfdb.types.IngestResult:
        """
        Store many TFMessages, one commit each.

        A transform that is refused is counted, by its edge and error, and the others of its message are
        stored. A message that is damaged is counted and left out. Arguments as in `ingest`; `messages` is
        an iterable of bytes-like objects. `authority` may also be a sequence, with one name for each
        message. Raises InvalidArgument if it then differs in length; nothing was stored. Ctrl-C ends it
        between two messages; those before are stored.
        """

    def transaction(self, priority: int = 0) -> Transaction:
        """
        Return a transaction: `with buf.transaction() as tx:` reads and writes in isolation.

        Begun by the `with` statement, committed at its end. `priority` is an integer from 0 to 7: above 0
        it commits before ordinary writers, and where the engine makes one of two start again, the higher
        goes first. Raises InvalidArgument; the `with` statement raises Conflict, TransactionActive, and
        CycleError, CapacityExceeded at the commit.
        """

    def _attempt(self, priority: int, alone: bool, age: int) -> Transaction:
        """A transaction that may run alone, and keeps the age of one that lost."""

    def watch(self, frames: str | Iterable[str] = (), pairs: Iterable[tuple[str, str]] = (), *, every: bool = False) -> Watch:
        """
        Return a watch of frames and paths: `next` waits for the commits that touch them.

        A commit touches a frame if it stores samples of it, or moves, clears, makes or removes it. It
        touches a pair if it touches a frame of the path between the two, as the newest parents give it
        before the commit or after it. The path is followed when a frame of it is moved, removed or made.

        Parameters
        ----------
        frames
            Names of frames, one or several; they may be missing yet.
        pairs
            Pairs (target, source) of frame names, as for `lookup_transform`. Of two frames that nothing
            joins, the path goes up to both roots.
        every
            Whether every commit counts. A record says which frames and pairs it touched; it may be none.

        Returns
        -------
        Watch

        Raises
        ------
        InvalidArgument
            Neither frames nor pairs are given.
        InvalidName
            No frame can have the name.
        NotSupported
            Waits are not supported either: a research engine, a frozen store, or a shared one whose control
            file this process may not write to.
        BufferClosed, TransactionActive
        """

    @property
    def clock(self) -> Clock:
        """
        Clock of the store, the same for all processes that have it open. A function given as `clock=` replaces it in the lookups of this Buffer.
        """

    def snapshot(self) -> Snapshot:
        """
        Return a snapshot of the newest commit: many reads of one state, in a `with` statement.
        """

    def memory(self) -> tfdb.types.MemoryUse:
        """Memory use of the store, in bytes."""

    def counters(self) -> tfdb.types.Counters:
        """
        Counts of commits, conflicts, waits, normalised quaternions and repeated reads.
        """

    @property
    def history(self) -> float | None:
        """Seconds of history that are kept; None: all."""

    @property
    def concurrency(self) -> tfdb.types.Concurrency:
        """Name of the concurrency-control engine."""

    @property
    def _clock(self) -> Callable[[], int] | None:
        """The function of the time, nanoseconds; None: the system's clock."""

    def _enforce(self, lifespans: list[tuple[str, str, int, str]]) -> None:
        """
        Refuse lookups over edges that are older: parent, child, nanoseconds, name in errors.
        """

    def __repr__(self) -> str: ...

    @property
    def frozen(self) -> tfdb.types.Frozen | None:
        """Facts about a frozen store; None if the store is not frozen."""

class Applier:
    """Applies messages of one source."""

    def __init__(self) -> None: ...

    def apply(self, data: bytes) -> tfdb.types.Position:
        """Apply commits or a state, as Buffer.apply does."""

    def take(self, data: bytes) -> bool:
        """
        Apply commits that begin as `follow` demands, without waiting for `apply`.

        Returns False if not all of them are applied: `apply` then raises the reason.
        """

    def follow(self, front: bytes | None) -> None:
        """Set how bytes begin that `take` applies. None: it applies none."""

    def taken(self) -> tuple[int, float] | None:
        """
        Return the bytes that `take` has applied since the last call, and the time.

        The time is of the last ones, in seconds as of time.monotonic(). None: nothing.
        """

    @property
    def position(self) -> tfdb.types.Position | None:
        """The source's position in the store. None: nothing was applied."""

class Recorded:
    """Messages of a recording, outside of Python."""

    def __init__(self) -> None: ...

    def add_mcap_chunk(self, chunk: bytes | memoryview, wanted: Callable[[int], bool], learn: Callable[[int, bytes], None]) -> tuple[int, int] | None:
        """
        Add the wanted messages of an unpacked chunk, as they lie there.

        `learn` gets the kind and content of the other records that the format knows, and of what is too short for a message.
        Returns where the records break off, and how long the one says that it is which goes beyond the chunk.
        """

    def add(self, received: int, source: int, data: bytes) -> None:
        """Add one message."""

    def extend(self, messages: Recorded, first: int, last: int) -> None:
        """Add the messages at [first, last) of others."""

    def renumber(self, numbers: dict[int, int]) -> None:
        """Give the sources other numbers, by the ones that they have."""

    def place(self, received: int) -> int:
        """
        Where the first message is that was received then or later; they are sorted.
        """

    def sort(self) -> None:
        """
        Sort by the time of reception; messages of one time stay as they were added.
        """

    def __len__(self) -> int: ...

    def __getitem__(self, index: int) -> tuple[int, int, bytes]: ...

    def span(self) -> tuple[int, int]:
        """When the first and the last were received; at least one message."""

    def counts(self) -> dict[int, int]:
        """How many messages there are of each source."""

    def runs(self, kinds: dict[int, int], most: int) -> list[tuple[int, int]]:
        """
        First and last + 1 of messages that follow each other and are of one kind.
        """

class Selection:
    """Which recorded transforms are kept, and the names of their frames."""

    def __init__(self, choose: Callable[[int, str, str], tuple[str, str] | None], first: int | None = None, last: int | None = None) -> None:
        """
        `choose` gets a source's rule, parent and child: once for each edge. It returns the new names; None leaves the edge out.
        Moving transforms are kept from stamp `first` to `last`, both included.
        """

    @property
    def shift(self) -> int:
        """Nanoseconds that are added to the stamps of kept moving transforms."""

    @shift.setter
    def shift(self, arg: int, /) -> None: ...

    @property
    def left_out(self) -> int:
        """Number of transforms that were left out."""

    @property
    def moving(self) -> int:
        """Number of moving transforms that were kept."""

    @property
    def outside(self) -> tuple[int, int] | None:
        """First and last stamp that the time window left out of chosen edges."""

    def kept(self) -> list[tuple[int, str, str]]:
        """
        Rule, parent and child, by their old names, of the edges that were kept.
        """

class Forgotten:
    """Counts samples that a limited history drops."""

    def __init__(self, buffer: Buffer) -> None:
        """By the history of `buffer`."""

    @property
    def count(self) -> int:
        """Number of samples."""

class EdgeSurvey:
    """The edges that recorded transforms would make."""

    def __init__(self) -> None: ...

    def edges(self) -> dict[str, tuple[str, tuple[int, int] | None]] | None:
        """
        Parent, and first and last stamp of a moving edge, by child.

        None: an edge had several parents, or edges form a circle. Only a store can tell what it keeps then.
        """

class ArrivalLog:
    """Recorded transforms in the order of their arrival, by child frame."""

    def __init__(self, *, with_store: bool) -> None:
        """
        `with_store`: a store judges what is refused, needed where `is_right` is False.
        """

    def add(self, messages: Recorded, first: int, last: int, *, encoding: str, static: bool, publishers: dict[int, str], note_slashes: bool, selection: Selection | None, rules: dict[int, int]) -> None:
        """
        Add what a store keeps of the messages at [first, last). `publishers` and `rules` are by source.
        """

    def hold(self, transforms: Sequence[tfdb.TransformStamped]) -> None:
        """Store static transforms that did not arrive."""

    @property
    def is_right(self) -> bool:
        """
        False: parents changed, and a store must judge: read again `with_store`.
        """

    def take(self) -> list[tuple[str, tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.int64]], bytes]]:
        """
        Child, and stamps, times of arrival, poses, parents, publishers, and whether static, sorted by child.

        Parents and publishers are indices of `names`. The log is empty then.
        """

    def names(self) -> list[str]:
        """Names of parents and publishers."""

    def mixed(self) -> list[str]:
        """Frames that messages write both with a leading slash and without."""

    def conflicts(self) -> dict[tuple[str, bool], int]:
        """
        Number of transforms refused with StaticConflict, by child and whether static.
        """

class MessageRewriter:
    """Writes recorded TFMessages again: chosen, renamed, encoded."""

    def __init__(self, encoding: str) -> None:
        """`encoding`: that of the messages to be written."""

    def rewrite(self, out: Recorded, messages: Recorded, first: int, last: int, *, encoding: str, static: bool, sources: dict[int, tuple[str, int]], selection: Selection | None) -> None:
        """
        Add to `out` what is left of the messages at [first, last).

        `sources` are by source: publisher, rule of `selection`, and whether empty names are refused.
        """

    @property
    def messages(self) -> int:
        """Messages written."""

    @property
    def transforms(self) -> int:
        """Transforms in these."""

    @property
    def refused(self) -> int:
        """Transforms refused of messages of which others were not."""

    @property
    def broken(self) -> int:
        """Messages of which nothing can be written."""

    @property
    def left_out(self) -> int:
        """Messages of which nothing was chosen."""

    def refusals(self) -> list[tfdb.types.RefusedEdge]:
        """What was refused, by edge and error."""

class MessageChunk:
    """A chunk of an MCAP file or a bag that is written."""

    def __init__(self, format: str) -> None:
        """`format`: 'mcap' or 'bag'."""

    def add_record(self, record: bytes) -> None:
        """Add a record as it is."""

    def fill(self, messages: Recorded, first: int, size: int) -> int:
        """
        Add messages from `first` on until the chunk is larger than `size` bytes; a source is a channel or connection.

        Returns the position of the next message.
        """

    def clear(self) -> None:
        """Remove all records."""

    def __len__(self) -> int: ...

    def records(self) -> bytes:
        """The bytes of all records."""

    def indexes(self) -> list[tuple[int, int, bytes]]:
        """Channel or connection, number of messages, and their index entries."""

    @property
    def start(self) -> int:
        """Time of the first message, nanoseconds."""

    @property
    def end(self) -> int:
        """Time of the last message, nanoseconds."""

def ingest_recorded(buffer: Buffer, messages: Recorded, first: int, last: int, *, encoding: str, static: bool, authorities: dict[int, str], selection: Selection | None = None, rules: dict[int, int] = {}, forgotten: Forgotten | None = None) -> tfdb.types.IngestResult:
    """
    As `ingest_many`, of the messages at [first, last).

    `authorities` and the `rules` of `selection` are by source, rule 0 the default. `forgotten` counts what the buffer's history drops.
    """

def survey_recorded(survey: EdgeSurvey, messages: Recorded, first: int, last: int, *, encoding: str, static: bool, selection: Selection | None, rules: dict[int, int]) -> None:
    """
    Add the messages at [first, last) to `survey`. `selection` and `rules` as in `ingest_recorded`.
    """

def recorded_children(messages: Recorded, first: int, last: int, *, encoding: str, static: bool, selection: Selection | None, rules: dict[int, int]) -> dict[int, dict[str, tuple[int, int]]]:
    """
    The child frames of the messages at [first, last), by source, each with its first and last stamp in nanoseconds. `selection` and `rules` as in `ingest_recorded`.
    """

def ingest_members(buffer: Buffer, data: tfdb.types.BytesLike, *, encoding: str, static: bool, authority: str, change_kind: bool, only_new: bool) -> list[tfdb.types.Refused]:
    """
    As `Buffer.ingest`; returns the refused members instead of a warning or an error.
    """

def decode_members(data: tfdb.types.BytesLike, encoding: str, *, static: bool, authority: str) -> list[tfdb.TransformStamped | tfdb.TfdbError]:
    """
    As `decode_tf_message`; the error of a member that cannot be read is in its place.
    """

def encode_tf_message(transforms: Iterable[tfdb.types.TransformStampedLike] | tfdb.Columns, encoding: str = 'cdr') -> bytes:
    """
    Bytes of one tf2_msgs/TFMessage, of what `set_transforms` takes; Columns without stamps get
    stamp 0. Raises InvalidStamp, InvalidName, InvalidArray, with `index`.
    """

def decode_tf_message(data: tfdb.types.BytesLike, encoding: str = 'cdr') -> list[tfdb.TransformStamped]:
    """
    Transforms of one tf2_msgs/TFMessage. Raises CorruptMessage; InvalidName, InvalidStamp, with
    `index`.
    """

class NativeTransaction:
    """The native part of `Transaction`."""

    def __init__(self) -> None: ...

    def lookup_transform_full(self, target: str, target_stamp: tfdb.types.StampLike | None, source: str, source_stamp: tfdb.types.StampLike | None, fixed_frame: str, policy: Policy | None = None) -> Transform:
        """
        T[target at target_stamp <- source at source_stamp], as `Buffer.lookup_transform_full`.

        Raises what that raises, and Conflict, TransactionClosed, WrongThread.
        """

    def can_transform_full(self, target: str, target_stamp: tfdb.types.StampLike | None, source: str, source_stamp: tfdb.types.StampLike | None, fixed_frame: str, policy: Policy | None = None) -> bool:
        """Whether `lookup_transform_full` with these arguments has an answer."""

    def lookup_transform(self, target: str, source: str, stamp: tfdb.types.StampLike | None = None, policy: Policy | None = None) -> Transform:
        """
        T[target<-source] at a stamp, as `Buffer.lookup_transform`.

        Its report stays right after the transaction has ended. Raises what that raises, and Conflict,
        TransactionClosed, WrongThread.
        """

    def lookup_latest_transform(self, target: str, source: str, max_age: float | None = None, now: tfdb.types.StampLike | None = None) -> Transform:
        """
        T[target<-source] from each edge's newest sample, as `Buffer.lookup_latest_transform`.

        Raises what that raises, and Conflict, TransactionClosed, WrongThread.
        """

    def lookup_transforms(self, target: str, source: str, stamps: tfdb.types.StampsLike, policy: Policy | None = None, *, layout: Literal['pose', 'matrix'] = 'pose', out: numpy.typing.NDArray[numpy.float64] | None = None, missing: Literal['raise', 'nan'] = 'raise') -> numpy.typing.NDArray[numpy.float64]:
        """
        T[target<-source] at each of N stamps: float64 (N, 7) or (N, 4, 4).

        Arguments, result and errors as in `Buffer.lookup_transforms`; and Conflict, TransactionClosed,
        WrongThread.
        """

    def can_transform(self, target: str, source: str, stamp: tfdb.types.StampLike | None = None, policy: Policy | None = None) -> bool:
        """
        Whether `lookup_transform` with these arguments has an answer.

        The answer counts as a read: a commit that changes it is a Conflict.
        """

    def latest_common_time(self, target: str, source: str) -> int:
        """
        The newest stamp at which every moving edge between two frames has data.
        """

    def common_times(self, target: str, source: str) -> tuple[int, int]:
        """
        The oldest and the newest stamp at which the path between two frames has data, as `Buffer.common_times`.
        """

    def parent_of(self, name: str, stamp: tfdb.types.StampLike | None = None) -> str | None:
        """
        The parent that a frame has at a stamp (None: in its newest sample), as `Buffer.parent_of`.
        """

    def frame_exists(self, name: str) -> bool:
        """Return whether a frame has that name."""

    def frames(self) -> list[str]:
        """
        Names of all frames, sorted. A frame that comes or goes meanwhile is a Conflict.
        """

    def frame_info(self, name: str) -> tfdb.types.FrameInfo:
        """One frame and the edge to its parent, as `Buffer.frame_info`."""

    def tree(self, stamp: tfdb.types.StampLike | None = None) -> list[tfdb.types.FrameInfo]:
        """
        All frames with their parents, as `Buffer.tree`. It depends on every edge.
        """

    def tree_columns(self, stamp: tfdb.types.StampLike | None = None) -> tfdb.types.TreeColumns:
        """The facts of `tree` as columns, as `Buffer.tree_columns`."""

    def samples(self, name: str) -> tuple[numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64], list[str]]:
        """All samples of a frame's edge, as `Buffer.samples`."""

    def _path_stamps(self, target: str, source: str, start: tfdb.types.StampLike | None, end: tfdb.types.StampLike | None) -> numpy.typing.NDArray[numpy.int64]:
        """As of `StoreReader`."""

    def _lookup_edge(
        self, target: str, source: str, stamp: tfdb.types.StampLike | None, policy: Policy | None
    ) -> Transform:
        """As of `StoreReader`."""

    def lookup_velocity(self, target: str, source: str, stamp: tfdb.types.StampLike | None = None, interval: float = 0.1, *, reference: str | None = None, point: tfdb.types.VectorLike = (0, 0, 0), point_frame: str | None = None) -> tfdb.types.Twist:
        """
        Velocity of `source` as seen from `target`, as `Buffer.lookup_velocity`.
        """

    @overload
    def lookup_edges(
        self,
        frames: Iterable[str],
        stamp: tfdb.types.StampLike | None = None,
        policy: Policy | None = None,
        *,
        out: numpy.typing.NDArray[tfdb.types.Float],
        dtype: None = None,
        missing: Literal['raise', 'nan'] = 'nan',
    ) -> numpy.typing.NDArray[tfdb.types.Float]:
        """
        T[parent<-frame] of many frames at one stamp, as `Buffer.lookup_edges`.
        """
    @overload
    def lookup_edges(
        self,
        frames: Iterable[str],
        stamp: tfdb.types.StampLike | None = None,
        policy: Policy | None = None,
        *,
        out: numpy.typing.NDArray[tfdb.types.Float] | None = None,
        dtype: type[tfdb.types.Float] | numpy.dtype[tfdb.types.Float],
        missing: Literal['raise', 'nan'] = 'nan',
    ) -> numpy.typing.NDArray[tfdb.types.Float]: ...
    @overload
    def lookup_edges(
        self,
        frames: Iterable[str],
        stamp: tfdb.types.StampLike | None = None,
        policy: Policy | None = None,
        *,
        out: None = None,
        dtype: type[float] | None = None,
        missing: Literal['raise', 'nan'] = 'nan',
    ) -> numpy.typing.NDArray[numpy.float64]: ...

    @overload
    def transform_points(
        self,
        target: str,
        source: str,
        points: numpy.typing.NDArray[tfdb.types.Float],
        stamps: tfdb.types.StampsLike | tfdb.types.StampLike,
        policy: Policy | None = None,
        *,
        out: numpy.typing.NDArray[tfdb.types.Float] | None = None,
        missing: Literal['raise', 'nan'] = 'raise',
    ) -> numpy.typing.NDArray[tfdb.types.Float]:
        """Points of `source` mapped into `target`, as `Buffer.transform_points`."""
    @overload
    def transform_points(
        self,
        target: str,
        source: str,
        points: tfdb.types.ListsOrIntegers,
        stamps: tfdb.types.StampsLike | tfdb.types.StampLike,
        policy: Policy | None = None,
        *,
        out: numpy.typing.NDArray[numpy.float64] | None = None,
        missing: Literal['raise', 'nan'] = 'raise',
    ) -> numpy.typing.NDArray[numpy.float64]: ...
    @overload
    def transform_points(
        self,
        target: str,
        source: str,
        points: numpy.typing.ArrayLike,
        stamps: tfdb.types.StampsLike | tfdb.types.StampLike,
        policy: Policy | None = None,
        *,
        out: numpy.typing.NDArray[numpy.floating[Any]] | None = None,
        missing: Literal['raise', 'nan'] = 'raise',
    ) -> numpy.typing.NDArray[Any]: ...

    @overload
    def set_transform(
        self, transform: tfdb.types.TransformStampedLike, /, *, authority: str = ""
    ) -> None:
        """
        Store T[parent<-child] at a stamp, at the commit; this transaction sees it at once.

        Arguments and errors as in `Buffer.set_transform`, also of `set_transform(T)`, but CycleError
        only at the commit. `change_kind` is missing: a transaction drops the samples of all moving
        frames, by `clear`, or of none. `only_new` is missing: a transaction can read first which stamps are stored.
        """
    @overload
    def set_transform(
        self,
        parent: str,
        child: str,
        stamp: tfdb.types.StampLike,
        translation: tfdb.types.VectorLike | tfdb.types.PoseLike,
        rotation: tfdb.types.QuaternionLike | None = None,
        *,
        rpy: tfdb.types.VectorLike | None = None,
        wxyz: tfdb.types.WxyzLike | None = None,
        authority: str = "",
    ) -> None: ...

    def set_static_transform(self, parent: str, child: str, translation: tfdb.types.VectorLike | tfdb.types.PoseLike, rotation: tfdb.types.QuaternionLike | None = None, *, rpy: tfdb.types.VectorLike | None = None, wxyz: tfdb.types.WxyzLike | None = None, authority: str = '') -> None:
        """
        Store T[parent<-child] for every stamp, at the commit.

        Arguments and errors as in `Buffer.set_static_transform`, but CycleError only at the commit.
        `change_kind` is missing, as in `set_transform`.
        """

    def set_transforms(self, batch: Iterable[tfdb.types.TransformStampedLike] | tfdb.Columns, *, static: bool = False, authority: str = '') -> None:
        """
        Store a batch of transforms T[parent<-child], at the commit.

        Arguments and errors as in `Buffer.set_transforms`, but CycleError only at the commit. A batch that
        is refused leaves the transaction as it was, and open. `change_kind` and `only_new` are missing as
        in `set_transform`. `partial` is missing: write one by one, and catch the errors.
        """

    def remove_frames(self, names: str | Iterable[str], *, recursive: bool = False) -> None:
        """
        Remove a frame, or several, at the commit.

        Arguments and errors as in `Buffer.remove_frames`. The commit raises ReadOnly for every frame of a
        mirrored store.
        """

    def clear(self) -> None:
        """
        Drop all moving samples at the commit; frames and static transforms stay.

        The commit raises ReadOnly if there are moving samples that `apply` brings of another store.

        What the transaction stored before goes as well, but for static transforms; what it stores
        afterwards is stored by the same commit, so no reader finds the store empty. An edge may then become
        static, or moving, as after `Buffer.clear`. The samples that others store until the commit are
        dropped, which is no Conflict; another transaction that read one of the dropped samples has one.
        """

    def reparent(self, child: str, parent: str, stamp: tfdb.types.StampLike | None = None, translation: tfdb.types.VectorLike | tfdb.types.PoseLike | None = None, rotation: tfdb.types.QuaternionLike | None = None, *, rpy: tfdb.types.VectorLike | None = None, wxyz: tfdb.types.WxyzLike | None = None, authority: str = '') -> None:
        """
        Give `child` another parent, from a stamp on.

        Parameters
        ----------
        child, parent
            Frame names.
        stamp
            Nanoseconds: before it the child keeps its parent. None: a static edge, at every stamp.
        translation, rotation, rpy, wxyz
            T[parent<-child], as in `Buffer.set_transform`. Without all of them the child stays where it is:
            T[parent<-child] at `stamp`, as this transaction sees it, where there is data at that stamp.
            Without a rotation: not rotated.
        authority
            Name of the writer.

        Raises what `lookup_transform` and `set_transform` raise; InvalidArgument for a rotation without a
        translation.
        """

    def abort(self) -> None:
        """
        Abort: nothing of the transaction is stored. The `with` block may be left normally.

        Does nothing after an abort, a Conflict or another error at the commit. Raises TransactionClosed if
        it was committed, or never begun.
        """

    @property
    def closed(self) -> bool:
        """True before its begin and after its end."""

    @property
    def commit(self) -> int | None:
        """
        Number of its commit, or of the state that it read if it wrote nothing; None unless it was committed.
        """

    @property
    def _age(self) -> int:
        """Its seniority, for the next attempt."""

    @property
    def _lost(self) -> bool:
        """Whether it ended by a Conflict of its own."""

    @property
    def _has_written(self) -> bool:
        """Whether `commit` is its own, not that of the state that it read."""

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: object, error: object, traceback: object) -> None: ...

    def __repr__(self) -> str: ...

class Watch:
    """
    Frames and paths whose commits a follower wants.

    `Buffer.watch()` makes it. Use it as a context manager, or close() it.
    """

    def __init__(self) -> None: ...

    def next(self, after: int, timeout: float | None = None, limit: int | None = None) -> list[tfdb.types.Touched]:
        """
        Wait for commits after `after` that touch what is watched; return all of them so far.

        It sleeps and reads the feed without the GIL. Other commits cost no Python and wake no thread. No
        commit is missed, and none comes twice to a caller that goes on with the last one's number. A watch
        whose `next` waits is not lapped by commits that do not touch it.

        While a frame of a pair's path, or above it, has samples of several parents, every commit touches
        the pair: which frames are on its path depends on the stamp. The same holds from a commit whose
        state can be read no more on, as it may happen to a follower that is late, until the path can be
        read again. A held snapshot of `after` prevents that.

        Parameters
        ----------
        after
            A commit: that of a snapshot, or of the last record.
        timeout
            Seconds, at most; None: for ever. 0: what is there.
        limit
            Largest number of records; None: all.

        Returns
        -------
        list[Touched]
            In the order of commits, each with what it touched: names, and pairs as tuples. Empty at the end
            of the timeout, and when the process ends.

        Raises
        ------
        FeedLapped
            The feed of changes does not reach back to `after`: as for `Buffer.changes`.
        InvalidArgument
            The commit does not exist yet.
        WatchClosed, BufferClosed (also if `close` was called meanwhile), NoSuchStore (the shared store was
        removed meanwhile), Forked (in a child of the process that made the watch), TransactionActive
        """

    def close(self) -> None:
        """
        End `next` in all threads with WatchClosed. A second call does nothing.
        """

    @property
    def closed(self) -> bool:
        """True after close()."""

    @property
    def frames(self) -> tuple[str, ...]:
        """The watched frames, each once."""

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """The watched pairs (target, source), each once."""

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: object, error: object, traceback: object) -> None: ...

    def __repr__(self) -> str: ...

class Clock:
    """
    The time of a store: that of the system, until it is set. `Buffer.clock` returns it.

    All processes that have a shared store open see one clock: what one of them sets, all follow, and
    their sleeps wake. `max_age=` of lookups goes by it. A recording that is played sets it.

    A process that may not write to the store's control file sees the system's clock. So does every
    frozen store.
    """

    def __init__(self) -> None: ...

    def now(self) -> int:
        """Return what the clock shows, nanoseconds."""

    def sleep(self, seconds: float, timeout: float | None = None) -> bool:
        """
        Sleep for so many seconds of this clock.

        Parameters
        ----------
        seconds
            Seconds of this clock: at double speed they pass in half of the time.
        timeout
            As in `sleep_until`.

        Returns
        -------
        bool
            False: the timeout passed first.

        Raises
        ------
        InvalidArgument, BufferClosed, NoSuchStore
            As `sleep_until`.
        """

    def sleep_until(self, stamp: tfdb.types.StampLike, timeout: float | None = None) -> bool:
        """
        Sleep until the clock shows a stamp, or a later one.

        While the clock is paused it shows no later stamp. The sleep follows a pause, a seek and a change of
        speed at once.

        Parameters
        ----------
        stamp
            Nanoseconds.
        timeout
            Seconds of real time, at most; None: for ever.

        Returns
        -------
        bool
            False: the timeout passed first.

        Raises
        ------
        InvalidStamp, BufferClosed (also if `close` was called meanwhile), NoSuchStore (the shared store was
        removed meanwhile)
        """

    def seek(self, stamp: tfdb.types.StampLike) -> None:
        """
        Let the clock show a stamp now; it goes on from there, or stays paused.

        Parameters
        ----------
        stamp
            Nanoseconds.

        Raises
        ------
        InvalidStamp, ReadOnly, LockTimeout, BufferClosed, TransactionActive
        """

    def pause(self) -> None:
        """
        Let the clock stand still. A second call does nothing.

        Raises
        ------
        ReadOnly, LockTimeout, BufferClosed, TransactionActive
        """

    def resume(self) -> None:
        """
        Let a paused clock go on.

        Raises
        ------
        ReadOnly, LockTimeout, BufferClosed, TransactionActive
        """

    def follow_system(self) -> None:
        """
        Let the clock show the system's time again.

        Raises
        ------
        ReadOnly, LockTimeout, BufferClosed, TransactionActive
        """

    @property
    def speed(self) -> float:
        """
        Seconds of this clock in a real second: above 0. Raises as `pause`, and InvalidArgument.
        """

    @speed.setter
    def speed(self, speed: float, /) -> None: ...

    @property
    def paused(self) -> bool:
        """Whether it stands still."""

    @property
    def is_system(self) -> bool:
        """Whether it shows the system's time."""

    @property
    def _set_to(self) -> int:
        """What the clock showed when it was set last."""

    @property
    def _set_since(self) -> int | None:
        """
        When it was set last, as `time.monotonic_ns` counts; None: it follows the system.
        """

    @property
    def _settings(self) -> int:
        """How often the clock was set."""

    def _sleep_unless_set(self, stamp: int, timeout: float | None, settings: int) -> bool:
        """
        As `sleep_until`; False, too, once the clock was set more than `settings` times.
        """

    def __repr__(self) -> str: ...

def create_store(path: os.PathLike[str], history: float | None, max_frames: int, snapshot_memory: int, size: int, permissions: int, group: int | None) -> None:
    """
    Make the files of a store that processes share. Raises as `Buffer.open`.
    """

def open_store(path: os.PathLike[str], writable: bool, lock_timeout: float | None, clock: Callable[[], int] | None) -> Buffer:
    """Open the store in that file. Raises as `Buffer.open`."""

def unlink_store(path: os.PathLike[str]) -> None:
    """Remove the files of a store. Raises as `Buffer.unlink`."""

def open(
    path: str | os.PathLike[str],
    *,
    verify: bool = False,
    clock: Callable[[], int] | None = None,
) -> Buffer:
    """
    Open a frozen store: what `freeze` or `tfdb freeze` wrote.

    It is a `Buffer` that answers as the state that was frozen, to the last bit, at once, whatever its
    size: the file is mapped, and its pages come as they are used. All processes that have it open share
    them. Nothing can be written to it (ReadOnly). It is pickled by its path.

    Parameters
    ----------
    path
        The file. Do not cut or rewrite it while it is open, as by `cp` over it: processes that read it
        would be ended by SIGBUS, or read nonsense. `freeze(overwrite=True)` is safe: it puts another
        file in its place, and processes that have the old one open keep it.
    verify
        Read all of it, and compare it with its checksum. Otherwise only the front of the file is
        checked; damage elsewhere makes wrong answers or errors, never a crash.
    clock
        As in `Buffer`.

    Returns
    -------
    Buffer

    Raises
    ------
    NoSuchStore
        There is no such file.
    CorruptStore
        The file is not a frozen store, or one of another version of tfdb or kind of machine, or cut, or
        damaged. Freeze what it was made from again.
    InvalidArgument
        The path is empty, or no name that a file can have.
    ReadOnly, CapacityExceeded
    """

def freeze_store(reads: StoreReader, path: os.PathLike[str], origin: str) -> None:
    """Write a state into that file. Raises as `StoreReader.freeze`."""

class MessageMaker:
    """
    Makes the messages that a function of Python makes, faster.

    How is found from two messages that the function makes: the classes of their objects, and the slots
    in which they hold its arguments. Where there is more to them than objects with `__slots__`, the
    function is called each time.

    Parameters
    ----------
    make
        Makes a message of a target, a source, a stamp in nanoseconds and a pose x y z qx qy qz qw.
    """

    def __init__(self, make: Callable[[str, str, int, Sequence[float]], Any]) -> None: ...

    def __call__(self, target: str, source: str, stamp: int, pose: Sequence[float]) -> Any:
        """A message T[target<-source]. Raises what the function raises."""

    @property
    def is_quick(self) -> bool:
        """Whether the function need not be called."""

class CoreCalls:
    """
    The hottest calls of `tfdb.tf2.BufferCore`, its base class.

    Each is answered here where that is plain, else by the method in Python of the same name
    behind an underscore.
    """

    def lookup_transform_core(self, target_frame: str, source_frame: str, time: Any) -> Any:
        """
        T[target_frame<-source_frame] at a time: maps points of the source into the target.

        Parameters
        ----------
        target_frame, source_frame
            Frame names.
        time
            When; 0: the latest common time.

        Returns
        -------
        geometry_msgs.msg.TransformStamped
            Its stamp is the time, or the latest common time.

        Raises LookupException, ConnectivityException, ExtrapolationException,
        InvalidArgumentException; TypeError for what is not a time.
        """

    def can_transform_core(
        self, target_frame: str, source_frame: str, time: Any
    ) -> tuple[int, str]:
        """
        Whether `lookup_transform_core` has an answer: (1, '') or (0, why not).

        Raises TypeError for what is not a time or no name.
        """

    def set_transform(self, transform: Any, authority: str) -> None:
        """
        Store T[header.frame_id<-child_frame_id] at header.stamp.

        One leading '/' of each frame name is dropped. What is refused is logged (logger
        `tfdb.tf2`) in tf2's words. Of the same stamp again the first value stays in ROS 1, the last
        one counts in ROS 2. A static frame stays static in ROS 1, and becomes moving in ROS 2.

        Parameters
        ----------
        transform
            A `geometry_msgs/TransformStamped` of any library.
        authority
            Name of the writer.

        Raises TypeError for other messages. What is wrong with the store, not with the
        transform, is raised as `tfdb.Buffer` raises it: CapacityExceeded, ReadOnly, LockTimeout.
        """

    def _answer_by(
        self,
        buffer: Buffer,
        maker: MessageMaker,
        only_time: type | None,
        *,
        change_kind: bool,
        only_new: bool,
    ) -> None:
        """
        Answer what is plain from now on, without the methods in Python.

        Parameters
        ----------
        buffer
            The store. Of a subclass of `Buffer` nothing is plain.
        maker
            The MessageMaker of what lookups return.
        only_time
            The one class of times that is plain, beside int; None: any time is.
        change_kind, only_new
            As in `Buffer.set_transform`.
        """

class BufferCalls(CoreCalls):
    """
    The hottest calls of `tfdb.tf2.Buffer`, a base class of it beside `BufferCore`.

    As `CoreCalls`. Where a subclass has a `lookup_transform_core` or `can_transform_core` of its
    own, the methods in Python are called.
    """

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Any, timeout: Any = None
    ) -> Any:
        """
        T[target_frame<-source_frame] at a time, once it is there.

        Parameters
        ----------
        target_frame, source_frame
            Frame names.
        time
            When; 0: the latest common time.
        timeout
            A duration, or seconds as a float: how long to wait for it at most.

        Returns
        -------
        geometry_msgs.msg.TransformStamped
            Maps points of the source into the target: p_target = T p_source.

        Raises what `lookup_transform_core` raises, once the time is up;
        InvalidArgumentException at once.
        """

    @overload
    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Any = None,
        return_debug_tuple: Literal[False] = False,
    ) -> bool:
        """
        Whether `lookup_transform` has an answer, or has one in time.

        `return_debug_tuple`: return (whether, why not). Arguments as in `lookup_transform`.
        """
    @overload
    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Any = None,
        *,
        return_debug_tuple: Literal[True],
    ) -> tuple[bool, str]: ...
    @overload
    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Any = None,
        return_debug_tuple: bool = False,
    ) -> bool | tuple[bool, str]: ...

def to_nanoseconds(stamp: tfdb.types.StampLike) -> int:
    """
    Nanoseconds of anything that is taken for a stamp. Raises InvalidStamp.
    """

def duration_to_nanoseconds(seconds: float, name: str) -> int:
    """
    Nanoseconds of what is taken for a duration. Raises InvalidArgument, which names it.
    """

def pose_parts(parent: str, child: str, translation: Any, rpy: Any, wxyz: Any) -> tuple[tuple[float, ...], tuple[float, ...]] | None:
    """
    Translation and rotation of a pose T[parent<-child]; None: it has no rotation.
    """

def poses_of_matrices(matrices: numpy.typing.ArrayLike, missing: bool = False) -> numpy.typing.NDArray[numpy.float64]:
    """
    Poses (N, 7) of matrices (N, 4, 4), w not below 0; NaN of those that are NaN as a whole, if they may be missing. Raises InvalidArray, InvalidTransform with `index`.
    """

def adopt_classes(buffer: type[Buffer], snapshot: type[Snapshot], transaction: type[Transaction]) -> None:
    """Make objects of these subclasses of the native classes from now on."""

def rows_of_commits(data: bytes) -> tuple[int, tuple[list[str], list[str], numpy.typing.NDArray[numpy.int64], numpy.typing.NDArray[numpy.float64], numpy.typing.NDArray[numpy.bool_], numpy.typing.NDArray[numpy.int64], list[str]], list[tuple[int, int, list[str]]]]:
    """
    Read the samples in bytes of `commits_bytes` or `state_bytes`.

    Returns the last commit; parents, children, stamps, poses, which rows are static, commits and authorities; and, before a row, the frames that a commit cleared or removed.
    """

class StreamRows:
    """The native part of `Stream`: the rows that it has read, and the next one."""

    _lock: Lock
    _next: int
    _has_read: bool
    _ended: bool
    def _set_rows(
        self,
        parents: list[str],
        children: list[str],
        stamps: numpy.typing.NDArray[numpy.int64],
        poses: numpy.typing.NDArray[numpy.float64],
        statics: numpy.typing.NDArray[numpy.bool_],
        commits: numpy.typing.NDArray[numpy.int64],
        authorities: list[str],
        /,
    ) -> None:
        """Hold the columns that `rows_of_commits` returned."""
    def _sample(self, row: int, /) -> tfdb.types.Sample:
        """Return a row of those as a Sample."""
    def __next__(self) -> tfdb.types.Sample:
        """Read the next sample: as `read_next`, which it calls where no row is unread."""

def messages_of_commits(data: bytes, since: int, choose: Callable[[str], tuple[str, bool]] | None) -> list[tuple[int, bytes | None, bytes | None, bytes | None]]:
    """
    The messages of commits, or of a state.

    Returns of each commit its number, the TFMessages of the moving and of the static edges, and the bytes for `apply` where these do not say all; a state has them always. They go on from the commit before, the first from `since`. `choose` gives a frame's new name, and whether the edge to its parent is kept.
    """

def commit_of_messages(epoch: bytes, since: int, commit: int, moving: bytes | None, static: bytes | None) -> bytes:
    """
    The bytes for `apply` of a commit that stores the transforms of TFMessages.

    `epoch` is the 24 bytes that the source's samples have at 8.
    """

def crc32c(data: bytes | memoryview) -> int:
    """The CRC-32C of bytes, with which samples end."""

def checked(function: Callable[..., Any]) -> Any:
    """The function, with our words for calls that do not fit its parameters."""

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

    Lookups return it. The constructor takes a pose in each form of `Buffer.set_transform`: a
    translation in metres and a unit quaternion x y z w, `rpy` or `wxyz`, or a whole pose. `A
    @ B` chains T[a<-b] and T[b<-c] to T[a<-c], with the older of the two stamps (0: at all
    times). It raises InvalidArgument if A.source is not B.target, and InvalidTransform if the
    result is not finite. Transforms with equal frames, stamp and pose are equal and have the
    same hash. The arrays are read-only.
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

        Raises InvalidArray for a wrong shape. Raises InvalidTransform, with the deviation, for a
        matrix that is not rigid: another last row than 0 0 0 1, a reflection, scale or shear, or
        numbers that are not finite.
        """

    def to_msg(self) -> Any:
        """
        Return a geometry_msgs/TransformStamped of the installed ROS, without ROS one of
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
        Return T[source<-target].

        Raises InvalidTransform if the result is not finite, as of a huge translation.
        """

    @overload
    def apply(
        self, points: numpy.typing.NDArray[tfdb.types.Float]
    ) -> numpy.typing.NDArray[tfdb.types.Float]:
        """
        Map points of the source frame into the target frame.

        `points` is (3,) or (N, 3), float32 or float64; other types are converted to float64. NaN
        and infinite coordinates are allowed. Returns a new array of the same shape and dtype.
        Raises InvalidArray. Raises InvalidTransform, with `index`, if the result of a finite
        point is not finite in that dtype.
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
        How it was computed, edge by edge. Only the direct result of a lookup has edges in it.
        """

def _restore_transform(*state: object) -> Transform: ...

def _enough_rows(stamps: numpy.typing.NDArray[numpy.int64], poses: numpy.typing.NDArray[numpy.float64], metres: float, radians: float) -> numpy.typing.NDArray[numpy.int64]: ...

class StoreReader:
    """
    The reads of Buffer and Snapshot.

    Each call on a Buffer reads one new snapshot; each call on a Snapshot reads that snapshot.
    """

    def __init__(self) -> None: ...

    def lookup_transform_full(self, target: str, target_stamp: tfdb.types.StampLike | None, source: str, source_stamp: tfdb.types.StampLike | None, fixed_frame: str, policy: Policy | None = None) -> Transform:
        """
        T[target at target_stamp <- source at source_stamp], through a fixed frame.

        The product of T[target<-fixed_frame] at `target_stamp` and T[fixed_frame<-source] at
        `source_stamp`. It maps a point that `source` saw at its stamp into `target` at the other stamp, if
        `fixed_frame` did not move.

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
        """
        Return whether `lookup_transform_full` with these arguments returns a transform.
        """

    def latest_common_time(self, target: str, source: str) -> int:
        """
        The newest stamp at which every moving edge between two frames has data.

        In nanoseconds; 0 if no edge of the path moves. If both frames are the same, it is the stamp of the
        frame's newest sample, as in tf2. Raises UnknownFrame, Disconnected.
        """

    def common_times(self, target: str, source: str) -> tuple[int, int]:
        """
        The oldest and the newest stamp at which the path between two frames has data.

        The path is that of the newest tree. From the oldest to the newest stamp, each moving edge of it has
        data, and the same parent as in the newest tree. The newest stamp is `latest_common_time`; both are
        of one state. If the oldest is greater than the newest, no stamp is covered by the whole path.

        Returns
        -------
        (int, int)
            Nanoseconds; both 0 if no edge of the path moves. If both frames are the same, they are those of
            the frame's own samples, as in tf2.

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
            interval moves inside. If there is less data than the interval, all of it is used.
        reference
            The frame in whose axes the result is given; None: `target`.
        point, point_frame
            The point whose velocity `linear` is, in coordinates of `point_frame` (None: `source`).

        Returns
        -------
        Twist
            `linear` in m/s, `angular` in rad/s, both float64 (3,).

        Raises what `lookup_transform` raises; Extrapolation (`no data`) if there is only one stamp.
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

        Row i equals `lookup_transform(parent, frames[i], stamp, policy)` in that snapshot, bit for bit.
        `parent` is the frame's parent at that stamp: `parent_of(frames[i], stamp)`, or
        `tree_columns(stamp).parents` for all. Frames above the parent are not read.

        Parameters
        ----------
        frames
            Frame names.
        stamp
            Nanoseconds, the same for all. None: each edge's newest sample.
        policy
            How a pose between samples is computed. None: Interpolate().
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
        one snapshot. Row i equals `lookup_transform(target, source, stamps[i], policy).apply(points[i])`
        there, bit for bit. NaN coordinates stay NaN. A result too large for the points' dtype is infinite
        or NaN; `apply` raises for it.

        Parameters
        ----------
        target, source
            Frame names.
        points
            (N, 3), float32 or float64; integers become float64. Rows may be strided, as in `cloud[:, :3]`.
        stamps
            (N,) int64 nanoseconds, or one stamp for all points.
        policy
            How a pose between samples is computed. None: Interpolate().
        out
            Array to write to, with the shape and dtype of the points; float64 for integers. It may be the
            points themselves. It must not overlap a part of them, nor the stamps.
        missing
            `raise`: raise the error of the first stamp without a pose, with its `index`. `nan`: its points
            become NaN, for any reason except an unknown frame, which raises.

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

        A sample's parent holds from its stamp to that of the next sample. Before the first and after the
        last sample, the parent of the nearest one holds. If first parents would form a cycle, their frames
        are roots before their first samples. A static edge has its parent at every stamp. Raises
        UnknownFrame.
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

        Row i is the i-th frame by name; the values are those of its FrameInfo. Arrays have -1 or NaN in
        place of None.
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
            Stamp in nanoseconds (or an object that holds one). None: the latest common
            time, at which every moving edge of the path has data.
        policy
            How a pose between samples is computed. None: Interpolate().
        timeout
            Longest wait for the data, in seconds; None: no wait. Only a Buffer takes
            it. At its end the error of a lookup without timeout is raised; see
            `wait_for_transform`.

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
            Its stamp is the oldest of the stamps used, 0 if nothing
            moves.

        Raises
        ------
        UnknownFrame, Disconnected, Extrapolation (an edge has no data), Stale,
        InvalidStamp, InvalidArgument, SnapshotTooOld, SnapshotClosed
        """

    def _lookup_edge(
        self, target: str, source: str, stamp: tfdb.types.StampLike | None, policy: Policy | None
    ) -> Transform:
        """
        `lookup_transform` over the edge from `source` to its parent `target`: no other edge is
        read.

        Raises Disconnected if the edge has another parent at the stamp, and what
        `lookup_transform` raises.
        """

    def can_transform(
        self,
        target: str,
        source: str,
        stamp: tfdb.types.StampLike | None = None,
        policy: Policy | None = None,
    ) -> bool:
        """
        Return whether `lookup_transform` with these arguments returns a transform.

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

        Row i equals `lookup_transform(target, source, stamps[i], policy)` in that snapshot, bit for bit, on
        every processor. A result that is a single stored sample equals that sample.

        Parameters
        ----------
        target, source
            Frame names.
        stamps
            (N,) int64 nanoseconds or datetime64, or a list of stamps; in any order.
        policy
            How a pose between samples is computed. None: Interpolate().
        layout
            `pose`: rows x y z qx qy qz qw. `matrix`: homogeneous 4x4 matrices, as `Transform.matrix`.
        out
            Array to write to: float64, C-contiguous, (N, 7) or (N, 4, 4), apart from the stamps in memory.
            An error, or Ctrl-C, may leave it partly written.
        missing
            `raise`: raise the error of the first stamp without a pose, with its `index`. `nan`: its row
            becomes NaN, for any reason except an unknown frame, which raises.

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
            A frame, or several: only these and their edges. A missing frame is left out; later commits
            (`commits_bytes` with the same frames) create it. None: all.
        newest
            Largest number of samples of each edge, the newest ones. None: all.

        Raises SnapshotTooOld, SnapshotClosed; InvalidName for a name that no frame can have.
        """

    def at(self, commit: int) -> Snapshot:
        """
        Return a snapshot of a later commit.

        A held snapshot protects its own state and all later ones, so a follower of `changes` can open the
        state of each commit. Either snapshot may be closed first. The returned one keeps as much memory as
        this one, so a follower should take a new snapshot from time to time.

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
            Frame names. New names create frames.
        stamp
            Nanoseconds (or an object that holds a stamp).
        translation
            Metres, x y z: a sequence, an array, or an object with x, y, z. Or the whole pose: a 4x4
            matrix, 7 numbers x y z qx qy qz qw, a `Transform` T[parent<-child], or an object with
            translation and rotation.
        rotation
            Unit quaternion x y z w, or a Rotation of scipy. A quaternion that is slightly off is
            normalised. Without `rotation`, `rpy` and `wxyz`: not rotated.
        rpy
            In place of `rotation`: roll, pitch, yaw in radians about fixed axes x, y, z, as in URDF.
        wxyz
            In place of `rotation`: unit quaternion w x y z.
        authority
            Name of the writer.
        change_kind
            Let a static edge become moving. Its static pose is dropped in the same commit; the frames
            below it stay.
        only_new
            Refuse a stamp that the edge has already. Without it, the later value replaces the stored one.

        Returns
        -------
        int
            Number of the commit.

        Raises
        ------
        InvalidName, InvalidStamp, InvalidArray, InvalidTransform, TooOld, StaticConflict, RepeatedStamp,
        CycleError, CapacityExceeded
            Nothing was stored.
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
            A sequence of `TransformStamped` or of ROS messages of that name, or one `Columns`. Of two
            members with the same child and stamp, the later one is stored.
        static
            Whether they hold at every stamp until replaced.
        authority
            Name of the writer.
        partial
            Store the valid members in one commit, and return the others.
        change_kind
            Let members change the kind of their edge, static or moving. The edge's stored samples are
            dropped in the same commit; the frames below it stay.
        only_new
            Refuse members with a stamp that their edge, or an earlier member, has already. Not with
            `static`.

        Returns
        -------
        int
            Number of the commit; of the current one if the batch is empty.
        list[Refused]
            With `partial`: the refused members with their errors, in order.

        Raises the error of the first refused member, with its `index`; `refused` has the errors of all.
        They are InvalidName, InvalidStamp, InvalidArray, InvalidTransform, TooOld, StaticConflict,
        RepeatedStamp and CycleError. Raises CapacityExceeded. Nothing is stored if it raises. With
        `partial` it raises only CapacityExceeded, and TypeError for a member that is not a transform.
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

        The order of the names does not matter: a frame may be removed together with all its children. With
        `recursive` all frames below are removed as well. Returns the number of the commit; without names,
        of the newest one.

        A frame of a mirrored store (`apply`) is not removed, nor are the frames below it. Only the parent
        edge that a local writer gave it is removed; without such an edge, ReadOnly is raised.

        Raises UnknownFrame, FrameInUse (with the names of the children) and ReadOnly. The first two have
        `index`, and `refused` with the errors of all names.
        """

    def clear(self) -> int:
        """
        Drop all moving samples in one commit; frames and static edges stay.

        Samples of another store (`apply`) stay: only that store clears them.

        The commit needs a little memory for each moving edge. Raises CapacityExceeded if `memory_limit`
        leaves none; then nothing is dropped.
        """

    def compact(self) -> bool:
        """
        Return unused memory to the operating system.

        A store keeps freed memory for later samples. This call drops samples beyond `history`, and returns
        free memory to the system, that of a shared store to its file system. It moves no samples. So it
        returns only pieces that are wholly free: of 256 KiB in a shared store (1/4096 of its size above 1
        GiB), of 2 MiB in others.

        Writers wait during the call: 5 ms for 10 million samples, 15 ms for 60,000 frames, and 10 ms for
        each 100 MiB that a shared store returns. Reads go on.

        Returns False, and returns no memory, while a snapshot, a transaction or a repeated read uses an
        older state than the newest: call it again later. It may do so as well while a transaction or more
        than three snapshots are open. Raises ReadOnly, TransactionActive and Forked;
        LockTimeout if another process holds the lock; CorruptStore if the file is damaged.
        """

    def changes(self, since: int, limit: int | None = None, *, frames: str | Iterable[str] | None = None) -> list[tfdb.types.Changes]:
        """
        Return the changes of each commit after `since`, in order.

        A record has all data of its commit that the newest state still has. Data that were evicted,
        replaced, cleared or removed since then may be missing; `gone` counts them. A held snapshot of
        commit `since`, or of an older one, prevents this. A record does not contain the order of a
        transaction's operations; the guide "Follow the changes" shows how to keep a copy.

        Parameters
        ----------
        since
            Number of a commit: that of a snapshot, or of the last record. 0: from the beginning.
        limit
            Largest number of records; None: all.
        frames
            A frame, or several: only changes of these frames and their edges, and only commits that have
            some. A frame may be created later. A follower should read the buffer's `commit` before the
            call: if fewer than `limit` records come, that commit is its next `since`. None: all frames.

        Returns
        -------
        list[Changes]
            Empty if nothing was committed since.

        Raises
        ------
        FeedLapped
            The feed no longer has the commit after `since`: it keeps the last 16,384 commits, fewer if they
            are large. Take a snapshot and follow from its `commit`, or continue from the error's `commit`
            and miss the commits before. The error's `oldest` is the commit that is overwritten next.
        InvalidArgument
            The commit does not exist yet, or `limit` is not positive.
        InvalidName
            A name in `frames` is invalid.
        NotSupported
            The engine has no feed; only `snapshot` and `giant` have one.
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
            Largest size. A commit is never cut: a larger one is returned alone.
        frames
            A frame, or several: only these and their edges. A frame may be created later: the commit that
            creates it is returned. None: all.

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
            A name in `frames` is invalid.
        NotSupported
            The engine has no feed; only `snapshot` and `giant` have one.
        TransactionActive
            This thread has a transaction open in the store.
        """

    def forget_source(self, source: str) -> bool:
        """
        Forget how far the commits of a source have been applied.

        Use it if a source has ended, or if `apply` raises Fenced because the clock of the source was set
        back. Its frames stay, and every writer may write them. The next bytes of this source must be a
        state, of any epoch, which replaces its frames. The source's name and prefix stay in use.

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

        Each commit becomes one commit here. A state becomes one commit, which replaces all that the source
        had stored: no reader sees an empty or a mixed store. The same commit stores the position, so
        `positions()` shows where to continue after a kill. Commits at or before the position are skipped.

        Frames of a source are read-only for all other writers (ReadOnly) until `forget_source`. An
        exception: any writer may give a parent to a frame that is a root at its source. This parent is kept
        until the source itself gives the frame one, with a TfdbWarning. If the source removes a frame with
        a child of another writer, the frame stays, without samples.

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
            Name of the other store in this one.

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
            The data cannot be stored. InvalidTransform also if a commit stores an edge twice.
        InvalidArgument
            The prefix is not the one of the first call, or it overlaps another source's.
        CapacityExceeded, ReadOnly, LockTimeout, NotSupported, TransactionActive
            As a write raises them.

        The commits before the refused one are applied; it and later ones are not.
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
        Wait until `lookup_transform` succeeds, and return its result.

        A commit of any thread or process that touches the path, or creates a missing frame, wakes
        it. Other threads and signal handlers run meanwhile.

        Parameters
        ----------
        target, source, stamp, policy
            As in `lookup_transform`.
        timeout
            Longest wait in seconds; None: no limit.

        Returns
        -------
        Transform

        Raises
        ------
        At the end of the timeout the error of `lookup_transform`, with the length of the wait;
        InvalidName at once for an invalid name; BufferClosed (`close` was called meanwhile),
        NoSuchStore (the shared store was removed), TransactionActive, NotSupported (a
        research engine; or this process may not write to the control file of the
        store), InvalidArgument
        """

    def wait_for_commit(self, after: int, timeout: float | None = None) -> int:
        """
        Wait until there is a commit with a number greater than `after`.

        Commits of any thread or process wake it, at most once per millisecond.

        Parameters
        ----------
        after
            The last commit that the caller knows: `commit`, or what this returned.
        timeout
            Longest wait in seconds; None: no limit.

        Returns
        -------
        int
            Number of the newest commit.

        Raises
        ------
        WaitTimeout, BufferClosed (`close` was called meanwhile), NoSuchStore (the shared store was
        removed), TransactionActive, NotSupported (a research engine; or the store
        is frozen; or this process may not write to its control file), InvalidArgument
        """

    def _begin_wait(self, target: str, source: str, stamp: tfdb.types.StampLike | None, policy: Policy | None) -> int:
        """
        Begin a wait, and return its number for `_ended_waits`; 0: the result is present.
        """

    def _begin_wait_full(self, target: str, target_stamp: tfdb.types.StampLike | None, source: str, source_stamp: tfdb.types.StampLike | None, fixed_frame: str) -> int:
        """Begin a wait for `lookup_transform_full`, as `_begin_wait`."""

    def _begin_wait_as_new(self, target: str, source: str, stamp: tfdb.types.StampLike) -> int:
        """Begin a wait for a latest common time of `stamp` or newer."""

    def _begin_wait_for_commit(self, after: int) -> int:
        """Begin a wait for a commit with a greater number."""

    @property
    def _last_to_follow(self) -> int:
        """
        The newest commit for a follower: none after the removal of the store was noticed.
        """

    def _cancel_wait(self, number: int) -> bool:
        """Cancel a wait. Returns False if it has ended before."""

    def _ended_waits(self, timeout: float | None) -> dict[int, int]:
        """
        Wait until begun waits end. Returns how each ended, by its number, in order.
        """

    def _await_ended_waits(self, timeout: float | None) -> None:
        """
        Wait until begun waits end; `_ended_waits(0)` of any thread then returns them.
        """

    def _set_waits_begun(self, begun: bool) -> None:
        """
        Set whether writes of tfdb.tf2 go through `waiting.write`, as they must while waits are begun.
        """

    def _check_wait(self, how: int) -> int:
        """
        Raise the error that ended a wait. After a timeout, return the newest commit.
        """

    @staticmethod
    def _may_be_frame(name: str) -> bool:
        """Whether a frame can have the name."""

    def _stop_waits(self, stop: bool) -> None:
        """
        With True, end all present and future waits as by their timeout, until called with False.
        """

    def close(self) -> None:
        """
        End all waits with BufferClosed; later reads, writes and waits raise it.

        `commit`, `memory` and `counters` raise it as well. `history`, `concurrency`, `shared`, `frozen`
        and the repr can still be read.
        Open snapshots and transactions stay open. The memory is freed with the last reference to them and
        to the buffer. A second call does nothing.
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

        And the errors of `set_transforms`, if no transform of the message can be stored. Nothing is stored
        if it raises.

        Warns
        -----
        TfdbWarning
            A transform was refused and others of its message were stored: once for each edge and error.

        One leading '/' of a frame name is dropped, as tf does.
        """

    def ingest_many(self, messages: Iterable[tfdb.types.BytesLike], *, encoding: str, static: bool = False, authority: str | Sequence[str] = '') -> tfdb.types.IngestResult:
        """
        Store many TFMessages, one commit each.

        Refused transforms are counted by edge and error, and the others of their message are stored.
        Damaged messages are counted and left out. Arguments as in `ingest`. `authority` may be a sequence
        with one name for each message; with another length it raises InvalidArgument, and nothing is
        stored. Ctrl-C ends the call between two messages; those before are stored.
        """

    def transaction(self, priority: int = 0) -> Transaction:
        """
        Return a transaction: `with buf.transaction() as tx:` reads and writes in isolation.

        The `with` statement begins it, and commits at its end. `priority` is an integer from 0 to 7. Above
        0 it commits before ordinary writers. If an engine restarts one of two transactions, the higher
        priority continues. Raises InvalidArgument. The `with` statement raises Conflict, TransactionActive
        and, at the commit, CycleError and CapacityExceeded.
        """

    def _attempt(self, priority: int, alone: bool, age: int) -> Transaction:
        """
        Return a transaction for another attempt: it may run alone, and keeps the age of the aborted one.
        """

    def watch(self, frames: str | Iterable[str] = (), pairs: Iterable[tuple[str, str]] = (), *, every: bool = False) -> Watch:
        """
        Return a watch of frames and paths: `next` waits for the commits that touch them.

        A commit touches a frame if it stores samples of the frame, or moves, clears, creates or removes it.
        A commit touches a pair if it touches a frame of the path between the two, before or after the
        commit. If a commit changes the path, the watch follows the new one.

        Parameters
        ----------
        frames
            Names of frames, one or several. They may be created later.
        pairs
            Pairs (target, source) of frame names, as for `lookup_transform`. If no path joins the two, the
            paths from both to their roots are watched.
        every
            Return a record for every commit, also if it touches nothing watched.

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
            The store has no waits: a research engine, a frozen store, or a shared one whose control file
            this process may not write to.
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
        Set the ages above which lookups raise Stale: parent, child, nanoseconds, name in errors.
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

        `learn` gets kind and content of the format's other records, and of messages that are too short.
        Returns where the records break off, and how long the one says that it is which goes beyond the chunk.
        """

    def add(self, received: int, source: int, data: bytes) -> None:
        """Add one message."""

    def extend(self, messages: Recorded, first: int, last: int) -> None:
        """Add the messages at [first, last) of others."""

    def renumber(self, numbers: dict[int, int]) -> None:
        """Replace the numbers of sources, by a dict from old to new."""

    def place(self, received: int) -> int:
        """
        Index of the first message received at that time or later. The messages must be sorted.
        """

    def sort(self) -> None:
        """
        Sort by the time of reception; messages of one time stay as they were added.
        """

    def __len__(self) -> int: ...

    def __getitem__(self, index: int) -> tuple[int, int, bytes]: ...

    def span(self) -> tuple[int, int]:
        """
        Times of reception of the first and the last message; there must be one.
        """

    def counts(self) -> dict[int, int]:
        """Number of messages by source."""

    def runs(self, kinds: dict[int, int], most: int) -> list[tuple[int, int]]:
        """Ranges [first, last) of successive messages of one kind."""

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

        None: an edge has several parents, or edges form a cycle. Then a store must judge what it keeps.
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
    """Rewrites recorded TFMessages: selects, renames and encodes them."""

    def __init__(self, encoding: str) -> None:
        """`encoding`: that of the messages to be written."""

    def rewrite(self, out: Recorded, messages: Recorded, first: int, last: int, *, encoding: str, static: bool, sources: dict[int, tuple[str, int]], selection: Selection | None) -> None:
        """
        Add the selected parts of the messages at [first, last) to `out`.

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
        """Refused transforms in messages with accepted ones."""

    @property
    def broken(self) -> int:
        """Messages of which nothing can be written."""

    @property
    def left_out(self) -> int:
        """Messages without a selected transform."""

    def refusals(self) -> list[tfdb.types.RefusedEdge]:
        """Refused transforms, by edge and error."""

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

        Raises the errors of that method, and Conflict, TransactionClosed, WrongThread.
        """

    def can_transform_full(self, target: str, target_stamp: tfdb.types.StampLike | None, source: str, source_stamp: tfdb.types.StampLike | None, fixed_frame: str, policy: Policy | None = None) -> bool:
        """
        Return whether `lookup_transform_full` with these arguments returns a transform.
        """

    def lookup_transform(self, target: str, source: str, stamp: tfdb.types.StampLike | None = None, policy: Policy | None = None) -> Transform:
        """
        T[target<-source] at a stamp, as `Buffer.lookup_transform`.

        Its report stays valid after the end of the transaction. Raises the errors of that method, and
        Conflict, TransactionClosed, WrongThread.
        """

    def lookup_latest_transform(self, target: str, source: str, max_age: float | None = None, now: tfdb.types.StampLike | None = None) -> Transform:
        """
        T[target<-source] from each edge's newest sample, as `Buffer.lookup_latest_transform`.

        Raises the errors of that method, and Conflict, TransactionClosed, WrongThread.
        """

    def lookup_transforms(self, target: str, source: str, stamps: tfdb.types.StampsLike, policy: Policy | None = None, *, layout: Literal['pose', 'matrix'] = 'pose', out: numpy.typing.NDArray[numpy.float64] | None = None, missing: Literal['raise', 'nan'] = 'raise') -> numpy.typing.NDArray[numpy.float64]:
        """
        T[target<-source] at each of N stamps: float64 (N, 7) or (N, 4, 4).

        Arguments, result and errors as in `Buffer.lookup_transforms`; and Conflict, TransactionClosed,
        WrongThread.
        """

    def can_transform(self, target: str, source: str, stamp: tfdb.types.StampLike | None = None, policy: Policy | None = None) -> bool:
        """
        Return whether `lookup_transform` with these arguments returns a transform.

        The result counts as a read: a commit that changes it causes a Conflict.
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
        Names of all frames, sorted. A commit that creates or removes a frame causes a Conflict.
        """

    def frame_info(self, name: str) -> tfdb.types.FrameInfo:
        """One frame and the edge to its parent, as `Buffer.frame_info`."""

    def tree(self, stamp: tfdb.types.StampLike | None = None) -> list[tfdb.types.FrameInfo]:
        """
        All frames with their parents, as `Buffer.tree`. It counts as a read of every edge.
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

        Arguments and errors as in `Buffer.set_transform`, but CycleError comes at the commit.
        `change_kind` and `only_new` are missing: a transaction can `clear`, and can read the stored stamps first.
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

        Arguments and errors as in `Buffer.set_static_transform`, but CycleError comes at the commit.
        `change_kind` is missing, as in `set_transform`.
        """

    def set_transforms(self, batch: Iterable[tfdb.types.TransformStampedLike] | tfdb.Columns, *, static: bool = False, authority: str = '') -> None:
        """
        Store a batch of transforms T[parent<-child], at the commit.

        Arguments and errors as in `Buffer.set_transforms`, but CycleError comes at the commit. A refused
        batch leaves the transaction open and unchanged. `change_kind` and `only_new` are missing as in
        `set_transform`. `partial` is missing: write one by one, and catch the errors.
        """

    def remove_frames(self, names: str | Iterable[str], *, recursive: bool = False) -> None:
        """
        Remove a frame, or several, at the commit.

        Arguments and errors as in `Buffer.remove_frames`. The commit raises ReadOnly for frames of a
        mirrored store.
        """

    def clear(self) -> None:
        """
        Drop all moving samples at the commit; frames and static transforms stay.

        Moving samples that the transaction stored before are dropped as well. The same commit stores those
        that it stores afterwards, so no reader finds the store empty. An edge may then become static, or
        moving, as after `Buffer.clear`.

        Samples that other writers store before the commit are dropped without a Conflict. Other
        transactions that read dropped samples get a Conflict. The commit raises ReadOnly if the store has
        moving samples of another store (`apply`).
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
            T[parent<-child], as in `Buffer.set_transform`. Without any of them the child stays in place:
            T[parent<-child] is looked up at `stamp`, which needs data there. With a translation alone: not
            rotated.
        authority
            Name of the writer.

        Raises what `lookup_transform` and `set_transform` raise; InvalidArgument for a rotation without a
        translation.
        """

    def abort(self) -> None:
        """
        Abort the transaction: nothing of it is stored. The `with` block may end normally.

        Does nothing after an abort, a Conflict or another error at the commit. Raises TransactionClosed if
        it was committed, or never begun.
        """

    @property
    def closed(self) -> bool:
        """True before the transaction begins and after it ends."""

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
    Waits for commits that touch some frames or paths.

    `Buffer.watch()` returns it. Use it as a context manager, or close() it.
    """

    def __init__(self) -> None: ...

    def next(self, after: int, timeout: float | None = None, limit: int | None = None) -> list[tfdb.types.Touched]:
        """
        Wait for commits after `after` that touch the watched frames or pairs, and return them all.

        It waits and reads the feed without the GIL. Other commits run no Python code, wake no thread, and
        do not lap a waiting `next`. A caller that passes the last record's commit as the next `after`
        misses no commit, and gets none twice.

        While a frame of a pair's path, or above it, has samples with several parents, every commit touches
        the pair, because its path depends on the stamp. The same holds while a late follower cannot read
        the state of a commit. A held snapshot of `after` prevents the latter.

        Parameters
        ----------
        after
            A commit: that of a snapshot, or of the last record.
        timeout
            Longest wait in seconds; None: no limit. 0: return what is present.
        limit
            Largest number of records; None: all.

        Returns
        -------
        list[Touched]
            In commit order, each with the touched frames and pairs. Empty at the end of the timeout, and
            when the process ends.

        Raises
        ------
        FeedLapped
            The feed no longer has the commit after `after`, as in `Buffer.changes`.
        InvalidArgument
            The commit does not exist yet.
        WatchClosed, BufferClosed (also if `close` was called meanwhile), NoSuchStore (the shared store was
        removed), Forked (in a child of the process that made the watch), TransactionActive
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
    The clock of a store. `Buffer.clock` returns it.

    It shows the system's time until it is set. All processes that have a shared store open share one
    clock: if one sets it, the sleeps of all react. `max_age=` of `lookup_latest_transform` uses it. A player (`tfdb
    play`) sets it.

    A process that may not write to the store's control file sees the system's clock. So does every
    frozen store.
    """

    def __init__(self) -> None: ...

    def now(self) -> int:
        """Return what the clock shows, nanoseconds."""

    def sleep(self, seconds: float, timeout: float | None = None) -> bool:
        """
        Sleep for a number of seconds of this clock.

        Parameters
        ----------
        seconds
            Seconds of this clock: at double speed they pass in half the time.
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

        A paused clock reaches no later stamp. The sleep reacts at once to a pause, a seek and a change of
        speed.

        Parameters
        ----------
        stamp
            Nanoseconds.
        timeout
            Longest wait in seconds of real time; None: no limit.

        Returns
        -------
        bool
            False: the timeout passed first.

        Raises
        ------
        InvalidStamp, BufferClosed (also if `close` was called meanwhile), NoSuchStore (the shared store was
        removed)
        """

    def seek(self, stamp: tfdb.types.StampLike) -> None:
        """
        Set the clock to a stamp. A running clock continues from there; a paused one stays paused.

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
        Pause the clock. A second call does nothing.

        Raises
        ------
        ReadOnly, LockTimeout, BufferClosed, TransactionActive
        """

    def resume(self) -> None:
        """
        Resume a paused clock.

        Raises
        ------
        ReadOnly, LockTimeout, BufferClosed, TransactionActive
        """

    def follow_system(self) -> None:
        """
        Set the clock back to the system's time.

        Raises
        ------
        ReadOnly, LockTimeout, BufferClosed, TransactionActive
        """

    @property
    def speed(self) -> float:
        """
        Seconds of this clock per real second; must be positive. Raises as `pause`, and InvalidArgument.
        """

    @speed.setter
    def speed(self, speed: float, /) -> None: ...

    @property
    def paused(self) -> bool:
        """Whether the clock is paused."""

    @property
    def is_system(self) -> bool:
        """Whether the clock shows the system's time."""

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
    Open a frozen store, a file of `freeze` or `tfdb freeze`.

    Reads of the returned `Buffer` equal those of the frozen state, bit for bit. The file is mapped:
    opening takes constant time, and all processes share its pages. Writes raise ReadOnly. The Buffer is
    pickled by its path.

    Parameters
    ----------
    path
        The file. Do not truncate or overwrite it while it is open, as `cp` does: SIGBUS would kill its
        readers, or they would read wrong values. `freeze(overwrite=True)` is safe: it replaces the
        file, and processes that have the old one open keep it.
    verify
        Read the whole file, and compare it with its checksum. Without it only the front of the file is
        checked: damage elsewhere causes wrong results or errors, never a crash.
    clock
        As in `Buffer`.

    Returns
    -------
    Buffer

    Raises
    ------
    NoSuchStore
        The file is missing.
    CorruptStore
        The file is damaged, cut, or not a frozen store, or it is of another version of tfdb or kind of
        machine. Freeze its recording again.
    InvalidArgument
        The path is empty or invalid.
    ReadOnly, CapacityExceeded
    """

def freeze_store(reads: StoreReader, path: os.PathLike[str], origin: str) -> None:
    """Write a state into that file. Raises as `StoreReader.freeze`."""

class MessageMaker:
    """
    Makes the same messages as a Python function, faster.

    It calls the function twice, and reads from the two messages the classes of their objects, and the
    slots that hold the arguments. If the messages have other parts than objects with `__slots__`, it
    calls the function each time.

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
    Native versions of the most used calls of `tfdb.tf2.BufferCore`.

    Simple calls run natively. Others call the Python method of the same name with an
    underscore.
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
        InvalidArgumentException; TypeError for an invalid time.
        """

    def can_transform_core(
        self, target_frame: str, source_frame: str, time: Any
    ) -> tuple[int, str]:
        """
        Whether `lookup_transform_core` succeeds: (1, '') or (0, reason).

        Raises TypeError for an invalid time or name.
        """

    def set_transform(self, transform: Any, authority: str) -> None:
        """
        Store T[header.frame_id<-child_frame_id] at header.stamp.

        One leading '/' of each frame name is dropped. Refused transforms are logged
        (logger `tfdb.tf2`) with tf2's text. A repeated stamp keeps its first value in ROS 1, and
        its last in ROS 2. A static frame stays static in ROS 1, and becomes moving in ROS 2.

        Parameters
        ----------
        transform
            A `geometry_msgs/TransformStamped` of any library.
        authority
            Name of the writer.

        Raises TypeError for other messages. Errors of the store itself are raised as by
        `tfdb.Buffer`: CapacityExceeded, ReadOnly, LockTimeout.
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
        Run simple calls natively from now on.

        Parameters
        ----------
        buffer
            The store. With a subclass of `Buffer`, all calls run in Python.
        maker
            Makes the messages that lookups return.
        only_time
            The only class of times, beside int, that runs natively. None: any class.
        change_kind, only_new
            As in `Buffer.set_transform`.
        """

class BufferCalls(CoreCalls):
    """
    Native versions of the most used calls of `tfdb.tf2.Buffer`, as `CoreCalls` of
    `BufferCore`.

    If a subclass overrides `lookup_transform_core` or `can_transform_core`, the Python methods
    run.
    """

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Any, timeout: Any = None
    ) -> Any:
        """
        Wait for T[target_frame<-source_frame] at a time, and return it.

        Parameters
        ----------
        target_frame, source_frame
            Frame names.
        time
            When; 0: the latest common time.
        timeout
            Longest wait: a duration, or seconds as a float.

        Returns
        -------
        geometry_msgs.msg.TransformStamped
            Maps points of the source into the target: p_target = T p_source.

        Raises the errors of `lookup_transform_core` at the end of the timeout;
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
        Whether `lookup_transform` succeeds within the timeout.

        `return_debug_tuple`: return (result, reason). Arguments as in `lookup_transform`.
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
    """Nanoseconds of a stamp in any accepted form. Raises InvalidStamp."""

def duration_to_nanoseconds(seconds: float, name: str) -> int:
    """
    Nanoseconds of a duration in seconds. Raises InvalidArgument with its name.
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
        row: int,
        /,
    ) -> None:
        """Hold the columns that `rows_of_commits` returned, and set the next row."""
    def _commit_of_next(self) -> int | None:
        """Return the commit of the next row; None: all were read."""
    def _sample(self, row: int, /) -> tfdb.types.Sample:
        """Return a row of those as a Sample."""
    def __next__(self) -> tfdb.types.Sample:
        """Read the next sample: as `read_next`, which it calls where no row is unread."""

def messages_of_commits(data: bytes, since: int, choose: Callable[[str], tuple[str, bool]] | None) -> list[tuple[int, bytes | None, bytes | None, bytes | None]]:
    """
    The messages of commits, or of a state.

    Returns a tuple for each commit: its number, the TFMessages of its moving and its static edges, and the bytes for `apply` if the messages do not contain everything. A state always has these bytes. They follow the commit before, the first ones `since`. `choose` returns a frame's new name, and whether the edge to its parent is kept.
    """

def commit_of_messages(epoch: bytes, since: int, commit: int, moving: bytes | None, static: bytes | None) -> bytes:
    """
    The bytes for `apply` of a commit that stores the transforms of TFMessages.

    `epoch` is the 24 bytes that the source's samples have at 8.
    """

def crc32c(data: bytes | memoryview) -> int:
    """The CRC-32C of bytes, with which samples end."""

def checked(function: Callable[..., Any]) -> Any:
    """
    The function, with tfdb's errors for calls that do not fit its parameters.
    """

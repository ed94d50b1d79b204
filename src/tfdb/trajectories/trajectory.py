"""The motion of one frame in another: stamps, poses and the operations on them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, overload

from tfdb._core import Buffer, Transform, _enough_rows, poses_of_matrices, to_nanoseconds
from tfdb.data import poses as geometry
from tfdb.data.errors import (
    Extrapolation,
    InvalidArgument,
    InvalidArray,
    InvalidTransform,
    NoSampleNear,
    NotSupported,
)
from tfdb.data.lazy_names import belong_to
from tfdb.data.stamps import MAX_STAMP, check_increasing, format_seconds, increasing_stamps, shown
from tfdb.data.time_arguments import check_order, time_of
from tfdb.data.types import Columns, Twist
from tfdb.store.report import restore_transform

from .arguments import are_many, are_none, chains, check_chain, nanoseconds_of, tolerance

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator, Sequence

    import numpy as np
    import numpy.typing as npt
    import pandas as pd
    import polars as pl
    from matplotlib.figure import Figure

    from tfdb._core import Policy
    from tfdb.data.decimal_time import Unit
    from tfdb.data.stamps import StampLike, StampsLike
    from tfdb.data.types import AsQuat

    from .file_formats import Format

    Missing = Literal["raise", "nan", "skip"]
    Rows = slice | npt.NDArray[np.bool_ | np.integer[Any]] | Sequence[int] | Sequence[bool]

__all__ = ["Trajectory"]


class Trajectory:  # noqa: PLW1641 - as arrays, it has no hash
    """T[target<-source] over time: N poses at increasing stamps. Immutable.

    Returned by `Buffer.trajectory` and `Trajectory.read`, or made of arrays. The row of a missing
    pose is NaN. Between its poses a trajectory interpolates as a store does.

    `len(t)` counts poses, `np.asarray(t)` is `t.poses`, `t == other` compares exactly. `t[5]` is a
    `Transform`; `t[10:20]`, a mask or an array of rows is a `Trajectory`. `T[a<-b] @ t` and
    `t @ T[b<-c]` chain it with a constant transform.

    Parameters
    ----------
    target, source
        Frame names: the poses map from `source` into `target`.
    stamps
        (N,) increasing nanoseconds, or other stamps, such as `datetime` or `numpy.datetime64`.
    poses
        (N, 7) float64: x y z in metres, unit quaternion x y z w.
    translations, rotations
        In place of `poses`: (N, 3), and (N, 4) or a scipy Rotation of length N.
    matrices
        In place of both: (N, 4, 4) rigid transforms. Rounding is corrected as in
        `Transform.from_matrix`.
    repeated
        Value of the property `repeated`.

    Raises
    ------
    InvalidArray
        Wrong shapes, or stamps that do not increase (with `index`).
    InvalidTransform
        A row that is neither a rigid transform nor NaN as a whole (with `index`).
    InvalidArgument
        Poses from a Trajectory or Transform between other frames.
    InvalidStamp, InvalidName

    Examples
    --------
    >>> import numpy as np
    >>> import tfdb
    >>> stamps = np.arange(5) * 1_000_000_000
    >>> places = np.outer(np.arange(5), [1.0, 0.5, 0.0])
    >>> turned = np.tile([0, 0, 0.6, 0.8], (5, 1))
    >>> t = tfdb.Trajectory("map", "base", stamps, translations=places, rotations=turned)
    >>> t
    <tfdb.Trajectory T[map<-base], 5 poses from 0 s to 4 s>
    >>> t[2].translation
    array([2., 1., 0.])
    >>> t[1:3].stamps
    array([1000000000, 2000000000])
    >>> tfdb.Transform("world", "map", (10, 0, 0)) @ t
    <tfdb.Trajectory T[world<-base], 5 poses from 0 s to 4 s>
    """

    __slots__ = ("_poses", "_repeated", "_source", "_stamps", "_store", "_target")
    _poses: npt.NDArray[np.float64]
    _repeated: int
    _source: str
    _stamps: npt.NDArray[np.int64]
    _store: tuple[Buffer, str] | None
    _target: str

    def __init__(
        self,
        target: str,
        source: str,
        stamps: StampsLike,
        poses: npt.ArrayLike | None = None,
        *,
        translations: npt.ArrayLike | None = None,
        rotations: npt.ArrayLike | AsQuat | None = None,
        matrices: npt.ArrayLike | None = None,
        repeated: int = 0,
    ) -> None:
        for role, name in (("target", target), ("source", source)):
            if not isinstance(name, str):
                raise TypeError(f"{role} must be str, the name of a frame, got {shown(name)}")
        Transform(target, source, (0, 0, 0))  # or raises
        if matrices is not None:
            if not (poses is None and translations is None and rotations is None):
                raise InvalidArray("give matrices, or poses, or translations and rotations")
            poses = poses_of_matrices(matrices, missing=True)
        rows = Columns(
            target, source, None, poses, translations=translations, rotations=rotations
        ).poses
        checked = increasing_stamps(stamps)
        if len(checked) != len(rows):
            counts = f"{len(checked)} stamps, but {len(rows)} poses"
            raise InvalidArray(counts, reason=counts)
        self._set(target, source, checked, geometry.checked(rows), repeated)

    def _set(
        self,
        target: str,
        source: str,
        stamps: npt.NDArray[np.int64],
        poses: npt.NDArray[np.float64],
        repeated: int = 0,
    ) -> None:
        """Set the arrays; the caller must not change them afterwards."""
        self._target, self._source, self._repeated = target, source, repeated
        self._stamps, self._poses = stamps.view(), poses.view()
        self._stamps.setflags(write=False)
        self._poses.setflags(write=False)
        self._store = None

    @classmethod
    def _made(
        cls,
        target: str,
        source: str,
        stamps: npt.NDArray[np.int64],
        poses: npt.NDArray[np.float64],
        repeated: int = 0,
    ) -> Trajectory:
        """Make a trajectory from valid arrays, without checks."""
        made = cls.__new__(cls)
        made._set(target, source, stamps, poses, repeated)
        return made

    @classmethod
    def from_table(cls, target: str, source: str, table: Any) -> Trajectory:
        """Make a trajectory of a table with columns stamp_ns, x, y, z, qx, qy, qz, qw.

        Parameters
        ----------
        target, source
            Frame names.
        table
            A pandas or polars DataFrame, an Arrow table, a dict, a structured array, or another
            object with named columns. Other columns are ignored. `stamp_ns` may hold integers or
            times.

        Raises
        ------
        InvalidArray
            A column is missing or holds something else.
        InvalidTransform, InvalidStamp, InvalidName

        Examples
        --------
        >>> import pandas as pd
        >>> import tfdb
        >>> row = {"stamp_ns": 5, "x": 1, "y": 2, "z": 3, "qx": 0, "qy": 0, "qz": 0.6, "qw": 0.8}
        >>> tfdb.Trajectory.from_table("map", "base", pd.DataFrame([row])).translations
        array([[1., 2., 3.]])
        """
        from .tables import columns_of  # noqa: PLC0415 - most programs do without

        return cls(target, source, *columns_of(table))

    # -- what it holds -----------------------------------------------------------------------------

    @property
    def target(self) -> str:
        """Frame into which the poses map."""
        return self._target

    @property
    def source(self) -> str:
        """Frame from which they map."""
        return self._source

    @property
    def stamps(self) -> npt.NDArray[np.int64]:
        """(N,) nanoseconds, increasing; read-only."""
        return self._stamps

    @property
    def poses(self) -> npt.NDArray[np.float64]:
        """(N, 7) x y z qx qy qz qw; read-only."""
        return self._poses

    @property
    def translations(self) -> npt.NDArray[np.float64]:
        """(N, 3) view of the poses, in metres: positions of the source's origin in the target."""
        return self._poses[:, :3]

    @property
    def rotations(self) -> npt.NDArray[np.float64]:
        """(N, 4) view of the poses: unit quaternions x y z w.

        They fit scipy's `Rotation.from_quat`.
        """
        return self._poses[:, 3:]

    @property
    def rpy(self) -> npt.NDArray[np.float64]:
        """(N, 3) roll, pitch, yaw in radians, a new array; NaN where the pose is missing.

        R = Rz(yaw) Ry(pitch) Rx(roll): rotations about the fixed axes x, y, z of `target`, as in
        `Transform.rpy` and URDF. Roll and yaw are in [-pi, pi], pitch in [-pi/2, pi/2]. At a pitch
        of 90 degrees roll and yaw share one axis, and roll is 0.

        Examples
        --------
        >>> import tfdb
        >>> t = tfdb.Trajectory("map", "base", [0], [[1, 2, 3, 0, 0, 0.6, 0.8]])
        >>> t.rpy.round(3)
        array([[0.   , 0.   , 1.287]])
        """
        return geometry.rpy(self.rotations)

    @property
    def matrices(self) -> npt.NDArray[np.float64]:
        """(N, 4, 4) homogeneous matrices, a new array.

        Examples
        --------
        >>> import tfdb
        >>> t = tfdb.Trajectory("map", "base", [0], [[1, 2, 3, 0, 0, 1, 0]])
        >>> t.matrices[0]
        array([[-1.,  0.,  0.,  1.],
               [ 0., -1.,  0.,  2.],
               [ 0.,  0.,  1.,  3.],
               [ 0.,  0.,  0.,  1.]])
        """
        return geometry.matrices(self._poses)

    @property
    def valid(self) -> npt.NDArray[np.bool_]:
        """(N,) False for each missing pose (its row is NaN): `t[t.valid]` drops those rows."""
        return geometry.found(self._poses)

    @property
    def repeated(self) -> int:
        """Number of poses in the file that a later pose with the same stamp replaced."""
        return self._repeated

    @property
    def duration(self) -> float:
        """Seconds from the first to the last stamp."""
        return float(self._stamps[-1] - self._stamps[0]) / 1e9 if len(self) else 0.0

    @property
    def length(self) -> float:
        """Length of the path in metres, straight from pose to pose, without missing poses.

        Examples
        --------
        >>> import tfdb
        >>> poses = [[0, 0, 0, 0, 0, 0, 1], [3, 4, 0, 0, 0, 0, 1]]
        >>> t = tfdb.Trajectory("map", "base", [0, 10], poses)
        >>> t.length
        5.0
        """
        import numpy as np

        with np.errstate(over="ignore"):
            x, y, z = np.diff(self.translations[self.valid], axis=0).T
            return float(np.hypot(np.hypot(x, y), z).sum())  # also of denormal numbers

    @property
    def seconds(self) -> npt.NDArray[np.float64]:
        """(N,) seconds since the first stamp: (stamps - stamps[0]) / 1e9, a new array.

        Examples
        --------
        >>> import tfdb
        >>> poses = [[1, 2, 3, 0, 0, 0, 1]] * 3
        >>> tfdb.Trajectory("map", "base", tfdb.stamp(["10", "10.5", "12"]), poses).seconds
        array([0. , 0.5, 2. ])
        """
        return (self._stamps - self._stamps[:1]) / 1e9

    @property
    def speed(self) -> npt.NDArray[np.float64]:
        """(N,) speed of the source's origin in m/s: the length of each `velocities().linear`.

        NaN for missing poses. The interval is 0.1 s; `velocities` takes others. Raises
        Extrapolation as `velocities`.

        Examples
        --------
        >>> import numpy as np
        >>> import tfdb
        >>> places = np.outer(np.arange(11), [0.3, 0.4, 0])
        >>> turned = np.tile([0, 0, 0.6, 0.8], (11, 1))
        >>> stamps = np.arange(11) * 100_000_000
        >>> path = tfdb.Trajectory("map", "base", stamps, translations=places, rotations=turned)
        >>> path.speed[4].round(6)
        np.float64(5.0)
        """
        import numpy as np

        x, y, z = self.velocities().linear.T
        with np.errstate(over="ignore"):
            return np.asarray(np.hypot(np.hypot(x, y), z))

    def __len__(self) -> int:
        return len(self._stamps)

    def __array__(
        self, dtype: npt.DTypeLike | None = None, copy: bool | None = None
    ) -> npt.NDArray[Any]:
        """Return the poses: `np.asarray(trajectory)` is (N, 7).

        `pandas.DataFrame(trajectory)` reads this array, so it has no stamps: use `to_pandas`.
        """
        import numpy as np

        wanted = np.dtype(self._poses.dtype if dtype is None else dtype)
        if copy is False and wanted != self._poses.dtype:
            raise ValueError(f"the poses are {self._poses.dtype}: {wanted} needs a copy")
        return self._poses.astype(wanted, copy=bool(copy))

    @overload
    def __getitem__(self, rows: int | np.integer[Any]) -> Transform: ...
    @overload
    def __getitem__(self, rows: Rows) -> Trajectory: ...
    def __getitem__(self, rows: Any) -> Transform | Trajectory:
        """Return one pose as a Transform, or some as a Trajectory.

        Raises InvalidIndex for a row out of range, InvalidArray for an invalid index or one that
        reorders the stamps, NoSampleNear for a single missing pose.
        """
        from .indexing import checked_rows  # noqa: PLC0415 - needs numpy

        wanted = checked_rows(rows, len(self))
        return self._one(wanted) if isinstance(wanted, int) else self._select(wanted)

    def __iter__(self) -> Iterator[Transform]:
        """Iterate over the poses as Transforms. Raises NoSampleNear at a missing pose."""
        for row in range(len(self)):
            yield self._one(row)

    def __eq__(self, other: object) -> bool:
        """Compare frames, stamps and poses, all exactly; a missing pose equals a missing one."""
        import numpy as np

        if not isinstance(other, Trajectory):
            return NotImplemented
        return (
            (self._target, self._source) == (other._target, other._source)
            and np.array_equal(self._stamps, other._stamps)
            and np.array_equal(self._poses, other._poses, equal_nan=True)
        )

    def __reduce__(self) -> tuple[Any, ...]:
        held = (self._target, self._source, self._stamps, self._poses, self._repeated)
        return _restore, held

    def __repr__(self) -> str:
        name = f"T[{self._target}<-{self._source}]"
        if len(self) == 0:
            return f"<tfdb.Trajectory {name}, no poses>"
        first, last = format_seconds(int(self._stamps[0])), format_seconds(int(self._stamps[-1]))
        poses = "1 pose" if len(self) == 1 else f"{len(self)} poses"
        return f"<tfdb.Trajectory {name}, {poses} from {first} to {last}>"

    def _repr_html_(self) -> str:
        """Show it in a notebook, with the first and last poses."""
        from tfdb.data.notebooks import of_poses  # noqa: PLC0415 - most programs do without

        caption = f"{self!r}: {self.duration:.6g} s, {self.length:.6g} m"
        return of_poses(caption, self._stamps, self._poses)

    # -- between the poses -------------------------------------------------------------------------

    @overload
    def at(self, stamps: StampLike, policy: Policy | None = None) -> Transform: ...
    @overload
    def at(
        self,
        stamps: StampsLike,
        policy: Policy | None = None,
        *,
        missing: Literal["raise", "nan"] = "raise",
    ) -> npt.NDArray[np.float64]: ...
    def at(
        self,
        stamps: Any,
        policy: Policy | None = None,
        *,
        missing: Literal["raise", "nan"] = "raise",
    ) -> Transform | npt.NDArray[np.float64]:
        """T[target<-source] at one stamp or many, as a store with these poses returns it.

        Missing poses are ignored, so they widen the gap that `Interpolate(max_gap=...)` limits.

        Parameters
        ----------
        stamps
            One stamp in nanoseconds; or (N,) of them, in any order.
        policy
            The policy for stamps between poses. None: Interpolate().
        missing
            For many stamps: `raise`, or `nan` for NaN rows, as in `lookup_transforms`.

        Returns
        -------
        Transform or numpy.ndarray
            A Transform at one stamp, (N, 7) poses at many. `resample` returns a Trajectory.

        Raises
        ------
        Extrapolation
            The stamp is outside the trajectory.
        GapTooLarge, Stale, NoSampleNear
            The policy refuses the stamp.
        InvalidStamp, InvalidArray, InvalidArgument

        Examples
        --------
        >>> import tfdb
        >>> poses = [[0, 0, 0, 0, 0, 0, 1], [4, 0, 0, 0, 0, 0, 1]]
        >>> t = tfdb.Trajectory("map", "base", [0, 10], poses)
        >>> t.at(5)
        T[map<-base] at 0.000000005 s: translation [2, 0, 0], rotation [0, 0, 0, 1]
        >>> t.at([9, 1])[:, 0]
        array([3.6, 0.4])
        >>> t.at(11, tfdb.Extrapolate(max=1.0)).translation
        array([4.4, 0. , 0. ])
        """
        if are_many(stamps):
            store, child = self._stored("nan" if are_none(stamps) else missing)
            return store.lookup_transforms(self._target, child, stamps, policy, missing=missing)
        store, child = self._stored()
        answer = store.lookup_transform(self._target, child, to_nanoseconds(stamps), policy)
        return answer if answer.source == self._source else self._as(answer.stamp, answer.pose)

    def crop(
        self, start: StampLike | str | None = None, end: StampLike | str | None = None
    ) -> Trajectory:
        """Return the poses with start <= stamp <= end; None: no limit.

        Or text, as in `tfdb.recordings.Selection`: `"+1.5"` is 1.5 s after the first stamp, `"-2"`
        2 s before the last.
        Raises InvalidArgument if `end` lies before `start`, and InvalidStamp.

        Examples
        --------
        >>> import tfdb
        >>> t = tfdb.Trajectory("map", "base", [0, 5, 10], [[0, 0, 0, 0, 0, 0, 1]] * 3)
        >>> t.crop(5).stamps
        array([ 5, 10])
        """
        ends = (int(self._stamps[0]), int(self._stamps[-1])) if len(self) else None
        begin, stop = time_of("start", start), time_of("end", end)
        first = 0 if begin is None else begin.resolve(ends)
        last = MAX_STAMP if stop is None else stop.resolve(ends)
        check_order(first, last)
        low = int(self._stamps.searchsorted(first, "left"))
        return self._select(slice(low, int(self._stamps.searchsorted(last, "right"))))

    def resample(
        self,
        rate: float | None = None,
        *,
        stamps: StampsLike | None = None,
        policy: Policy | None = None,
        missing: Missing = "raise",
    ) -> Trajectory:
        """Interpolate at evenly spaced stamps, or at given stamps.

        Parameters
        ----------
        rate
            Poses per second, from the first to the last pose that is not missing.
        stamps
            In place of the rate: (N,) increasing nanoseconds, such as `other.stamps`.
        policy, missing
            As in `Buffer.trajectory`.

        Raises
        ------
        InvalidArgument
            Neither or both of rate and stamps, or a rate that is not positive.
        Extrapolation, GapTooLarge, Stale, NoSampleNear
            As `at` raises them.

        Examples
        --------
        >>> import tfdb
        >>> t = tfdb.Trajectory("map", "base", [0, 10**9], [[0, 0, 0, 0, 0, 0, 1]] * 2)
        >>> len(t.resample(100.0))
        101
        """
        from tfdb.store.sampling import sample, sample_at  # noqa: PLC0415 - most programs do without

        if (rate is None) == (stamps is None):
            raise InvalidArgument(
                "pass either rate or stamps: resample(100.0), resample(stamps=...)"
            )
        if rate is not None:
            store, child = self._stored()
            made = sample(store, self._target, child, rate, None, None, policy, missing)
        else:
            wanted = increasing_stamps(stamps)
            store, child = self._stored(missing if len(wanted) else "nan")
            made = sample_at(store, self._target, child, wanted, policy, missing)
        return self._made(self._target, self._source, *made)

    def simplify(self, metres: float, radians: float) -> Trajectory:
        """Return fewer poses that keep the interpolated path within a tolerance.

        At every time, not only at the stamps, the new trajectory differs by at most `metres` and
        `radians`. The first and the last pose stay; missing poses are omitted. The search is
        greedy: it keeps about 5 % more poses than the optimum.

        Parameters
        ----------
        metres
            Largest error of a translation; `math.inf`: no limit.
        radians
            Largest error of a rotation; `math.pi` or more: no limit.

        Raises InvalidArgument for a tolerance that is negative, NaN or not a number.

        Examples
        --------
        >>> import numpy as np
        >>> import tfdb
        >>> poses = np.tile([0.0, 0, 0, 0, 0, 0, 1], (101, 1))
        >>> poses[:, 0] = np.abs(np.arange(101) - 50)  # there and back
        >>> t = tfdb.Trajectory("map", "base", np.arange(101) * 10_000_000, poses)
        >>> t.simplify(0.01, 0.01).translations[:, 0]
        array([50.,  0., 50.])
        """
        limits = [tolerance(metres, "metres"), tolerance(radians, "radians")]
        path = self if bool(self.valid.all()) else self._select(self.valid)
        return path._select(_enough_rows(path._stamps, path._poses, *limits))

    def velocities(self, interval: float = 0.1) -> Twist:
        """Velocity of `source` seen from `target` at each pose, as `lookup_velocity` defines it.

        It is computed from the poses at both ends of an interval around the stamp. Near the ends of
        the trajectory, the interval is shifted to lie within it.

        Parameters
        ----------
        interval
            Length of the interval in seconds.

        Returns
        -------
        Twist
            `linear` (N, 3) in m/s, of the source's origin, and `angular` (N, 3) in rad/s, in the
            axes of `target`. NaN where the pose is missing.

        Raises
        ------
        Extrapolation
            The trajectory has only one pose.
        InvalidArgument
            The interval is not positive.

        Examples
        --------
        >>> import numpy as np
        >>> import tfdb
        >>> poses = np.tile([0.0, 0, 0, 0, 0, 0, 1], (11, 1))
        >>> poses[:, 0] = np.arange(11) * 0.2
        >>> t = tfdb.Trajectory("map", "base", np.arange(11) * 100_000_000, poses)
        >>> t.velocities().linear[5].round(6)
        array([2., 0., 0.])
        """
        from .motion import velocities_of  # noqa: PLC0415 - most programs do without

        length = nanoseconds_of(interval)
        store, child = self._stored()
        here = self.valid
        names = self._target, self._source, child
        return Twist(*velocities_of(store, names, self._stamps, here, length))

    # -- other frames, other stamps ----------------------------------------------------------------

    def inverse(self) -> Trajectory:
        """T[source<-target]: the inverse of each pose.

        Raises InvalidTransform, with `index`, if a result is not finite.

        Examples
        --------
        >>> import tfdb
        >>> tfdb.Trajectory("map", "base", [0], [[1, 2, 3, 0, 0, 1, 0]]).inverse().translations
        array([[ 1.,  2., -3.]])
        """
        return self._moved(self._source, self._target, lambda: geometry.inverse(self._poses))

    def __matmul__(self, other: Transform) -> Trajectory:
        """Chain with a constant T[b<-c]: T[a<-b] over time becomes T[a<-c] over time.

        Raises InvalidArgument if the frames do not chain, InvalidTransform as `inverse`.
        """
        if not chains(other, "t @ T", "np.asarray(t) @ array multiplies numbers"):
            return NotImplemented
        check_chain(self._target, self._source, other.target, other.source)
        end = other.pose
        return self._moved(self._target, other.source, lambda: geometry.compose(self._poses, end))

    def __rmatmul__(self, other: Transform) -> Trajectory:
        """Chain with a constant T[a<-b]: T[b<-c] over time becomes T[a<-c] over time."""
        if not chains(other, "T @ t", "array @ np.asarray(t) multiplies numbers"):
            return NotImplemented
        check_chain(other.target, other.source, self._target, self._source)
        begin = other.pose
        return self._moved(other.target, self._source, lambda: geometry.compose(begin, self._poses))

    def merge(self, *others: Trajectory) -> Trajectory:
        """Merge with trajectories of the same frames, sorted by stamp.

        If several trajectories have a pose at one stamp, the pose of the last one is kept. A
        missing pose replaces no other.

        Raises InvalidArgument for a trajectory of other frames.

        Examples
        --------
        >>> import tfdb
        >>> pose = [[1, 2, 3, 0, 0, 0, 1]]
        >>> morning = tfdb.Trajectory("map", "base", [10], pose)
        >>> tfdb.Trajectory("map", "base", [20], pose).merge(morning).stamps
        array([10, 20])
        """
        import numpy as np

        for other in others:
            if not isinstance(other, Trajectory):
                raise TypeError(f"merge() takes trajectories, got {shown(other)}")
            if (other.target, other.source) != (self._target, self._source):
                raise InvalidArgument(
                    f"T[{self._target}<-{self._source}] and T[{other.target}<-{other.source}] "
                    "cannot be merged: their frames differ",
                    target=other.target,
                    source=other.source,
                )
        parts = (self, *others)
        stamps = np.concatenate([part._stamps for part in parts])
        poses = np.concatenate([part._poses for part in parts])
        order = np.lexsort((geometry.found(poses), stamps))  # stable: the last one stays last
        last = np.append(np.diff(stamps[order]) > 0, True)[: len(order)]
        rows = order[last]
        return self._made(self._target, self._source, stamps[rows], poses[rows])

    # -- files -------------------------------------------------------------------------------------

    @classmethod
    def read(
        cls,
        path: str | os.PathLike[str],
        format: Format | None = None,  # noqa: A002 - numpy and pandas call it so, too
        *,
        times: str | os.PathLike[str] | None = None,
        target: str | None = None,
        source: str | None = None,
        salvage: bool = False,
        stamp_unit: Unit | None = None,
    ) -> Trajectory:
        """Read a trajectory file: TUM, KITTI, EuRoC, CSV, NPZ or Parquet.

        Text may separate columns by blanks, tabs, commas or semicolons, and may have comments after
        `#` and a header. The header names the columns, as in TUM, EuRoC, `rostopic echo -p`, bagpy
        and PlotJuggler (`timestamp`, `x`, `qw`, `.pose.position.x`). Other columns are ignored.
        Quaternions that are slightly off unit length are normalised. If several rows have one
        stamp, the last is used; `repeated` counts the others.

        Parameters
        ----------
        path
            The file.
        format
            `"tum"` (`seconds x y z qx qy qz qw`), `"kitti"` (the 12 numbers of a 3x4 matrix; stamps
            in a separate file), `"euroc"` (`nanoseconds,x,y,z,qw,qx,qy,qz,...`, also VINS), `"csv"`
            (columns `stamp_ns,x,y,z,qx,qy,qz,qw`, or those of its header), `"npz"` or `"parquet"`
            (as written by `save`). None: by the file's first bytes, its header and its number of
            columns. The last three formats can have missing poses: NaN, or empty cells in a CSV.
        times
            KITTI only: the file with the stamp of each pose in seconds. None: `NAME_times.txt` or
            `times.txt` beside the poses.
        target, source
            Names of the frames: the poses are `T[target<-source]`. None: the names in a Parquet
            file, otherwise `world` and `body`.
        salvage
            Sort rows by their stamps, normalise quaternions that are up to 5 % off unit length, and
            skip rows without a valid stamp or pose. A warning counts all of them.
        stamp_unit
            `"s"`, `"ms"`, `"us"` or `"ns"`, the unit of stamps in text. None: the unit of the
            header or the format, otherwise by the size of the stamps.

        Raises
        ------
        TrajectoryError
            A line that does not match the format, ambiguous columns, an invalid rotation, stamps
            that decrease, or a file without poses. Fields: path, line, reason.
        NotSupported
            Parquet without polars.
        OSError
            The file cannot be opened.

        Warns
        -----
        TfdbWarning
            Rows with the same stamp; rows that `salvage` sorted, normalised or skipped; a unit that
            was guessed by size; columns that were guessed by their number.
        """
        from .reading import read_with_rows  # noqa: PLC0415 - most programs do without
        from .reading_report import warn_of_rows  # noqa: PLC0415 - as above

        trajectory, rows = read_with_rows(
            cls,
            path,
            format,
            times=times,
            target=target,
            source=source,
            salvage=salvage,
            stamp_unit=stamp_unit,
        )
        warn_of_rows(rows, 2)
        return trajectory

    def save(
        self,
        path: str | os.PathLike[str],
        format: Format | None = None,  # noqa: A002 - as in `read`
        *,
        overwrite: bool = False,
    ) -> None:
        """Write the trajectory to a file, which appears when it is complete.

        All formats but KITTI restore each float64 exactly. KITTI stores matrices, so quaternions
        differ by rounding. Stamps are exact decimals. TUM, KITTI and EuRoC files omit missing
        poses; the other formats keep them as NaN. Parquet keeps the frame names.

        Parameters
        ----------
        path
            The file.
        format
            `"tum"`, `"kitti"` (the stamps go to `NAME_times.txt` beside it), `"euroc"`, `"csv"`,
            `"npz"` or `"parquet"`. None: by the ending of `path`: `.tum`, `.txt` (TUM), `.csv`,
            `.npz`, `.parquet`.
        overwrite
            Replace an existing file.

        Raises
        ------
        TrajectoryError
            The file exists and `overwrite` is off, or the format is unknown.
        NotSupported
            Parquet without polars: `pip install 'tfdb[tables]'`.
        OSError
            The file cannot be written. An existing file stays unchanged.

        Examples
        --------
        >>> import tempfile, tfdb
        >>> t = tfdb.Trajectory("map", "base", [5], [[1, 2, 3, 0, 0, 0.6, 0.8]])
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     t.save(f"{folder}/path.tum")
        ...     again = tfdb.Trajectory.read(f"{folder}/path.tum", target="map", source="base")
        >>> again == t
        True
        """
        from .writing import write_trajectory  # noqa: PLC0415 - most programs do without

        write_trajectory(path, self, format, overwrite=overwrite)

    # -- to others ---------------------------------------------------------------------------------

    def to_numpy(self) -> npt.NDArray[np.void]:
        """Make a numpy structured array (N,) with fields stamp_ns, x, y, z, qx, qy, qz, qw.

        `stamp_ns` is int64 nanoseconds, the others are float64: metres and a unit quaternion. A
        missing pose has NaN in all fields except its stamp. `from_table` reads it back. The plain
        arrays are `stamps` (N,) and `poses` (N, 7).

        Examples
        --------
        >>> import tfdb
        >>> rows = tfdb.Trajectory("map", "base", [5], [[1, 2, 3, 0, 0, 0.6, 0.8]]).to_numpy()
        >>> rows["x"], rows["stamp_ns"]
        (array([1.]), array([5]))
        """
        from .tables import as_records  # noqa: PLC0415 - most programs do without

        return as_records(self._stamps, self._poses)

    def to_pandas(self) -> pd.DataFrame:
        """Make a pandas DataFrame with columns stamp_ns, x, y, z, qx, qy, qz, qw.

        `pandas.DataFrame(trajectory)` holds the poses only; `pandas.DataFrame.from_arrow`
        (pandas 3) keeps all columns.

        Raises NotSupported without pandas: `pip install 'tfdb[tables]'`.

        Examples
        --------
        >>> import tfdb
        >>> tfdb.Trajectory("map", "base", [5], [[1, 2, 3, 0, 0, 0, 1]]).to_pandas()
           stamp_ns    x    y    z   qx   qy   qz   qw
        0         5  1.0  2.0  3.0  0.0  0.0  0.0  1.0
        """
        from .tables import as_pandas  # noqa: PLC0415 - most programs do without

        return as_pandas(self._stamps, self._poses)

    def to_polars(self) -> pl.DataFrame:
        """Make a polars DataFrame with columns stamp_ns, x, y, z, qx, qy, qz, qw.

        A missing pose is NaN, not null. Raises NotSupported without polars.

        Examples
        --------
        >>> import tfdb
        >>> tfdb.Trajectory("map", "base", [5], [[1, 2, 3, 0, 0, 0, 1]]).to_polars().shape
        (1, 8)
        """
        from .tables import as_polars  # noqa: PLC0415 - most programs do without

        return as_polars(self._stamps, self._poses)

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """Return the table of `to_polars` to libraries that read Arrow: `pyarrow.table(t)`.

        Raises NotSupported if polars is not installed.
        """
        from .tables import as_polars  # noqa: PLC0415 - most programs do without

        table = as_polars(self._stamps, self._poses, "Arrow")
        stream: object = table.__arrow_c_stream__(requested_schema)
        return stream

    def plot(
        self,
        *others: Trajectory,
        axes: Literal["xy", "xz", "yz", "xyz"] | None = None,
        color: Literal["time", "speed"] | None = None,
        title: str | None = None,
    ) -> Figure:
        """Draw the trajectory, alone or with others: `t.plot().savefig("path.png")`.

        Parameters
        ----------
        *others
            More trajectories for the same picture.
        axes, color, title
            As in `tfdb.plot.trajectory`.

        Returns
        -------
        matplotlib.figure.Figure
            The figure, to save or to show.

        Raises
        ------
        InvalidArgument
            All poses are missing.
        NotSupported
            matplotlib is not installed: `pip install 'tfdb[plot]'`.
        """
        try:
            from tfdb.plot import trajectory  # noqa: PLC0415 - most programs do without
        except ImportError as error:
            message = "plot() needs matplotlib: pip install 'tfdb[plot]'"
            raise NotSupported(message) from error
        return trajectory(self, *others, axes=axes, color=color, title=title)

    # -- inside ------------------------------------------------------------------------------------

    def _stored(self, missing: Missing = "raise") -> tuple[Buffer, str]:
        """Return a store of the poses that are not missing, and its name for the source.

        Without such a pose the store has the frames only, for lookups with `missing="nan"`.
        """
        if self._store is None:
            here = self.valid
            if not here.any() and missing != "nan":
                raise Extrapolation(
                    f"T[{self._target}<-{self._source}] has no pose to interpolate",
                    target=self._target,
                    source=self._source,
                    reason="no data",
                )
            child = self._source
            if child == self._target:  # a store has no such edge
                child = "moving" if child != "moving" else "moved"
            store = Buffer(history=None)
            if not here.any():
                others = [name for name in "abcd" if name not in (self._target, child)]
                store.set_static_transform(others[0], self._target, (0, 0, 0))
                store.set_static_transform(others[1], child, (0, 0, 0))
                return store, child
            store.set_transforms(
                Columns(self._target, child, self._stamps[here], self._poses[here])
            )
            self._store = store, child
        return self._store

    def _as(self, stamp: int, pose: npt.NDArray[np.float64], *edges: object) -> Transform:
        return restore_transform(self._target, self._source, (pose[:3], pose[3:]), stamp, 0, edges)

    def _one(self, row: int) -> Transform:
        import numpy as np

        pose, stamp = self._poses[row], int(self._stamps[row])
        if not np.isfinite(pose).all():
            raise NoSampleNear(
                f"pose {row} of T[{self._target}<-{self._source}] at {format_seconds(stamp)} is "
                "missing: t[t.valid] is without such poses",
                edge=self._source,
                stamp=stamp,
                index=row,
            )
        edge = (self._source, self._target, "exact", stamp, stamp, False)
        return self._as(stamp, pose, edge)

    def _select(self, rows: Any) -> Trajectory:
        stamps = self._stamps[rows]
        check_increasing(stamps)
        return self._made(self._target, self._source, stamps, self._poses[rows])

    def _moved(
        self, target: str, source: str, compute: Callable[[], npt.NDArray[np.float64]]
    ) -> Trajectory:
        """Make a computed trajectory; raise InvalidTransform if it is not finite."""
        import numpy as np

        with np.errstate(over="ignore", invalid="ignore"):
            poses = compute()
        lost = np.flatnonzero(self.valid & ~geometry.found(poses))
        if len(lost):
            stamp = int(self._stamps[lost[0]])
            raise InvalidTransform(
                f"pose {lost[0]} of T[{target}<-{source}] at {format_seconds(stamp)} is not "
                "finite: the numbers are too large for 64-bit floating point",
                target=target,
                source=source,
                stamp=stamp,
                index=int(lost[0]),
                reason="not finite",
            )
        return self._made(target, source, self._stamps, poses)


def _restore(*held: Any) -> Trajectory:
    return Trajectory._made(*held)


belong_to("tfdb", globals(), __all__)

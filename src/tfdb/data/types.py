"""Plain data of stores: arguments and results."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    Protocol,
    TypeAlias,
    TypeVar,
)

from tfdb._core import pose_parts, poses_of_matrices

from .argument_checks import refuse_without
from .errors import InvalidArgument, InvalidArray
from .lazy_names import belong_to
from .refused_transforms import Refusal, Refused, RefusedEdge

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Mapping, Sequence

    import numpy as np
    import numpy.typing as npt

    from tfdb._core import Transform

    from .stamps import StampLike, StampsLike

    Float = TypeVar("Float", np.float32, np.float64)

__all__ = [
    "Batch",
    "Changes",
    "Columns",
    "Counters",
    "Epoch",
    "FrameInfo",
    "Frozen",
    "IngestResult",
    "MemoryUse",
    "Position",
    "Refusal",
    "Refused",
    "RefusedEdge",
    "Sample",
    "Shared",
    "Touched",
    "TransformStamped",
    "TreeColumns",
    "Twist",
]


class Xyz(Protocol):
    """Anything with x, y and z."""

    @property
    def x(self) -> float:
        """Along x."""

    @property
    def y(self) -> float:
        """Along y."""

    @property
    def z(self) -> float:
        """Along z."""


class Xyzw(Xyz, Protocol):
    """Anything with x, y, z and w."""

    @property
    def w(self) -> float:
        """The real part."""


class AsQuat(Protocol):
    """A `scipy.spatial.transform.Rotation`, of one rotation."""

    def as_quat(self) -> npt.NDArray[np.floating[Any]]:
        """Return its unit quaternion x y z w."""


class TrajectoryLike(Protocol):
    """Anything with stamps and poses, such as a `Trajectory`."""

    @property
    def stamps(self) -> npt.NDArray[np.int64]:
        """Nanoseconds, shape (N,)."""

    @property
    def poses(self) -> npt.NDArray[np.float64]:
        """Rows `[x y z qx qy qz qw]`, shape (N, 7)."""


class Posed(Protocol):
    """A `Transform`, a `geometry_msgs/Transform`."""

    @property
    def translation(self) -> VectorLike:
        """Metres."""

    @property
    def rotation(self) -> QuaternionLike:
        """Unit quaternion."""


Numbers: TypeAlias = "Sequence[float] | npt.NDArray[np.floating[Any] | np.integer[Any]]"
"""A sequence or array of numbers."""

VectorLike: TypeAlias = "Numbers | Xyz"
"""Three numbers x, y, z in metres."""

QuaternionLike: TypeAlias = "Numbers | Xyzw | AsQuat"
"""Four numbers x, y, z, w of length one, or a Rotation of scipy."""

WxyzLike: TypeAlias = "Numbers"
"""Four numbers w, x, y, z of length one."""

PoseLike: TypeAlias = "Sequence[Sequence[float]] | Numbers | Posed"
"""A 4x4 matrix, seven numbers x y z qx qy qz qw, or an object with translation and rotation."""

ListsOrIntegers: TypeAlias = (
    "Sequence[Sequence[float]] | Sequence[float] | npt.NDArray[np.integer[Any]]"
)
"""Numbers that convert to float64."""

BytesLike: TypeAlias = bytes | bytearray | memoryview
"""Bytes of a message."""

Name: TypeAlias = "str | os.PathLike[str]"
"""A shared store: its name, or the path of its file."""

Paths: TypeAlias = "str | os.PathLike[str] | Sequence[str | os.PathLike[str]]"
"""One file or several."""

Topics: TypeAlias = "str | Iterable[str] | Mapping[str, str]"
"""Topics to read; a mapping renames them."""

PoseTopics: TypeAlias = "str | Iterable[str] | Mapping[str, str | None]"
"""Topics of poses to read; a mapping names the child frame of each topic."""

Progress: TypeAlias = "Callable[[int, int], None]"
"""Called with (done, total) while a recording loads."""

Concurrency: TypeAlias = Literal[
    "snapshot", "giant", "fine", "2pl-no-wait", "2pl-wait-die", "2pl-wound-wait", "silo"
]
"""How the store isolates concurrent lookups, writes and transactions: see `Buffer`."""


@dataclass(frozen=True, slots=True, init=False)
class TransformStamped:  # noqa: PLW1641 - dataclass makes __hash__
    """A transform T[parent<-child] at a stamp: p_parent = T p_child.

    Parameters
    ----------
    parent, child, stamp, translation, rotation, rpy, wxyz
        As in `Buffer.set_transform`: `translation` may be a whole pose.

    Raises
    ------
    InvalidArray, InvalidTransform, InvalidArgument
        A whole pose, `rpy` or `wxyz` is invalid. The other arguments are checked when it is stored.
    """

    parent: str
    """Frame into which it maps."""
    child: str
    """Frame from which it maps."""
    stamp: StampLike
    """Nanoseconds, or an object that holds a stamp."""
    translation: VectorLike
    """Metres, x y z: a sequence, an array, or an object with x, y, z; a tuple if made of a pose."""
    rotation: QuaternionLike
    """Unit quaternion, x y z w: a sequence, an array, or an object with x, y, z, w."""

    def __init__(
        self,
        parent: str,
        child: str,
        stamp: StampLike,
        translation: VectorLike | PoseLike,
        rotation: QuaternionLike | None = None,
        *,
        rpy: VectorLike | None = None,
        wxyz: WxyzLike | None = None,
    ) -> None:
        if rotation is None:
            parts = pose_parts(parent, child, translation, rpy, wxyz)
            translation, rotation = parts or (translation, (0.0, 0.0, 0.0, 1.0))
        elif rpy is not None or wxyz is not None:
            raise InvalidArgument("rotation, rpy and wxyz exclude each other; pass one")
        values = (parent, child, stamp, translation, rotation)
        for name, value in zip(TransformStamped.__slots__, values, strict=True):
            object.__setattr__(self, name, value)

    def __eq__(self, other: object) -> bool:
        """Compare all fields; arrays are equal if all their numbers are."""
        if type(other) is not TransformStamped:
            return NotImplemented
        return all(
            _equal(getattr(self, name), getattr(other, name)) for name in TransformStamped.__slots__
        )


def _equal(a: object, b: object) -> bool:
    if hasattr(a, "__array__") or hasattr(b, "__array__"):
        import numpy as np

        return np.array_equal(np.asarray(a), np.asarray(b))
    return a == b


class RosHeader(Protocol):
    """A `std_msgs/Header`."""

    @property
    def frame_id(self) -> str:
        """The parent."""

    @property
    def stamp(self) -> StampLike:
        """The stamp."""


class RosTransformStamped(Protocol):
    """A `geometry_msgs/TransformStamped` of any ROS library."""

    @property
    def header(self) -> RosHeader:
        """Parent and stamp."""

    @property
    def child_frame_id(self) -> str:
        """The child."""

    @property
    def transform(self) -> Posed:
        """T[parent<-child]."""


TransformStampedLike: TypeAlias = "TransformStamped | RosTransformStamped | Transform"
"""A member of the batches of `Buffer.set_transforms`."""


class Columns:
    """A batch of N transforms T[parent<-child] as columns.

    Parameters
    ----------
    parents, children
        N names each, or one name for all rows.
    stamps
        (N,) int64 nanoseconds, or None for static transforms.
    poses
        (N, 7) float64: x y z in metres, unit quaternion x y z w.
    translations, rotations
        In place of `poses`: (N, 3), and (N, 4) or a scipy Rotation of length N.
    matrices
        In place of `poses`: homogeneous matrices (N, 4, 4).

    Raises
    ------
    InvalidArray
        None or several of these forms are given, or a shape is wrong.
    InvalidTransform
        A matrix is not a rigid transform; the error has its `index` and the size of the error.
    InvalidArgument
        A Trajectory, or a Transform among the poses, is between other frames.
    """

    __slots__ = ("children", "parents", "poses", "stamps")
    children: str | Sequence[str]
    parents: str | Sequence[str]
    poses: npt.NDArray[np.float64]
    stamps: StampsLike | None

    def __init__(
        self,
        parents: str | Sequence[str],
        children: str | Sequence[str],
        stamps: StampsLike | None,
        poses: npt.ArrayLike | None = None,
        *,
        translations: npt.ArrayLike | None = None,
        rotations: npt.ArrayLike | AsQuat | None = None,
        matrices: npt.ArrayLike | None = None,
    ) -> None:
        for name, given in (("parents", parents), ("children", children)):
            refuse_without(given, name, "a name, or N names", "__iter__")
        self.parents = parents
        self.children = children
        # An iterator can be read only once.
        self.stamps = list(stamps) if isinstance(stamps, Iterator) else stamps
        if matrices is not None:
            if not (poses is None and translations is None and rotations is None):
                raise InvalidArray("give matrices, or poses, or translations and rotations")
            poses = poses_of_matrices(matrices)
        elif poses is None:
            if translations is None or rotations is None:
                raise InvalidArray("give poses, or both translations and rotations")
            import numpy as np

            places = _rows(translations, 3, "translations")
            turns = _rows(_quaternions(rotations), 4, "rotations")
            if len(places) != len(turns):
                raise InvalidArray(f"{len(places)} translations, but {len(turns)} rotations")
            poses = np.concatenate([places, turns], axis=1)
        elif translations is not None or rotations is not None:
            raise InvalidArray("give poses, or translations and rotations, not both")
        else:
            _refuse_other_frames(poses, parents, children)
        self.poses = _rows(poses, 7, "poses")

    def __len__(self) -> int:
        return len(self.poses)

    def __repr__(self) -> str:
        return f"<tfdb.Columns of {len(self)} transforms>"

    def _repr_html_(self) -> str:
        """Write a table for notebooks."""
        from .notebooks import of_columns  # noqa: PLC0415 - needed by few

        return of_columns(self)


def _refuse_other_frames(poses: Any, target: object, source: object) -> None:
    """Refuse a Transform or Trajectory between other frames: it may be the inverse."""
    rows = poses if isinstance(poses, list | tuple) else [poses]
    if not (rows and isinstance(target, str) and isinstance(source, str)):
        return
    for each in rows if hasattr(rows[0], "target") else ():
        frames = getattr(each, "target", target), getattr(each, "source", source)
        if frames != (target, source):
            raise InvalidArgument(
                f"T[{frames[0]}<-{frames[1]}] was given for T[{target}<-{source}]: give its "
                "inverse() for the other direction, or its numbers (.pose, .poses) if the frames "
                "have other names",
                value=each,
            )


def _quaternions(rotations: Any) -> Any:
    """Return (N, 4) of a scipy Rotation; other values are returned unchanged."""
    as_quat = getattr(rotations, "as_quat", None)
    return as_quat() if callable(as_quat) else rotations


def _rows(values: npt.ArrayLike, width: int, role: str) -> npt.NDArray[np.float64]:
    """Return an array (N, width) of float64; raise InvalidArray for anything else."""
    from .poses import doubles  # noqa: PLC0415 - numpy is not needed before

    try:
        array = doubles(values)
        got = f"{array.shape}"
    except (TypeError, ValueError):
        array, got = None, type(values).__name__
        if hasattr(values, "dtype"):
            got = f"{values.dtype} {getattr(values, 'shape', '')}"
    if array is not None and array.shape == (0,):
        return array.reshape(0, width)
    if array is None or array.ndim != 2 or array.shape[1] != width:
        reason = f"expected an array (N, {width}) of float64, got {got}"
        raise InvalidArray(f"{role}: {reason}", reason=reason)
    return array


@dataclass(frozen=True, slots=True, eq=False)
class Changes:
    """The effects of one commit, from `Buffer.changes`. Frames have their names at that commit."""

    commit: int
    """Number of the commit."""
    stored: Columns
    """The stored moving samples T[parent<-child], edge by edge, in stamp order."""
    stored_static: Columns
    """The stored static transforms T[parent<-child]."""
    authorities: tuple[str, ...]
    """The writer of each row of `stored`, followed by those of `stored_static`."""
    made: tuple[str, ...]
    """New frames."""
    moved: tuple[str, ...]
    """Existing frames whose newest parent changed, or that became roots."""
    cleared: tuple[str, ...]
    """Frames whose samples were dropped before the commit stored new ones."""
    removed: tuple[str, ...]
    """Removed frames."""
    passing: tuple[str, ...]
    """Frames that a transaction made and removed again; other samples may name them."""
    gone: dict[str, int]
    """Number of stored samples, by child, that are missing here: evicted, replaced, cleared or
    removed since."""

    def __repr__(self) -> str:
        what = {
            "stored": len(self.stored) + len(self.stored_static),
            "made": len(self.made),
            "moved": len(self.moved),
            "cleared": len(self.cleared),
            "removed": len(self.removed) + len(self.passing),
            "gone": sum(self.gone.values()),
        }
        told = ", ".join(f"{count} {name}" for name, count in what.items() if count)
        return f"<tfdb.types.Changes of commit {self.commit}: {told or 'nothing'}>"

    def _repr_html_(self) -> str:
        """Write a table for notebooks."""
        from .notebooks import of_changes  # noqa: PLC0415 - needed by few

        return of_changes(self)


class Sample(NamedTuple):
    """One stored sample of an edge, from `Buffer.follow`."""

    transform: Transform
    """T[parent<-child]: its `target` is the parent, its `source` the child."""
    stamp: int | None
    """Nanoseconds; None for a static transform."""
    commit: int
    """The commit that stored it; with `since="held"`, the first samples have their state's."""
    authority: str
    """Its writer; with `since="held"`, the first samples have the edge's last writer."""


class Batch(NamedTuple):
    """The samples of several commits, from `Stream.batches`, in the order of commits."""

    stored: Columns
    """The moving samples T[parent<-child]."""
    stored_static: Columns
    """The static transforms T[parent<-child]."""
    commits: npt.NDArray[np.int64]
    """The commit of each row of `stored`, followed by those of `stored_static`."""
    authorities: tuple[str, ...]
    """The writer of each row, in the same order."""


@dataclass(frozen=True, order=True, slots=True)
class Epoch:
    """The lifetime of a store, in which its commits are numbered. A later epoch is greater."""

    number: int
    """Nanoseconds since 1970 when the store was made."""
    id: bytes
    """16 random bytes, which distinguish stores with the same number."""


@dataclass(frozen=True, slots=True)
class Position:
    """How far the commits of another store have been applied, from `Buffer.apply`."""

    source: str
    """What this store calls the other one."""
    epoch: Epoch
    """The epoch of the other store."""
    commit: int
    """The last commit of it that has been applied."""
    prefix: str
    """Text before the names of its frames here."""


class Touched(NamedTuple):
    """A commit that touched a watched frame or pair, from `Watch.next`."""

    commit: int
    """Number of the commit."""
    what: tuple[str | tuple[str, str], ...]
    """The watched items that it touched: names of frames, then pairs (target, source)."""


@dataclass(frozen=True, slots=True)
class FrameInfo:
    """A frame and its edge T[parent<-name] to its parent."""

    name: str
    """The frame."""
    parent: str | None
    """Its parent; None for a root."""
    is_static: bool
    """Whether the edge is static."""
    samples: int
    """Retained samples; 1 for a static edge."""
    oldest: int | None
    """First retained stamp, nanoseconds; None if it does not move."""
    newest: int | None
    """Last stamp, nanoseconds; None if it does not move."""
    rate: float | None
    """Mean rate of the samples in Hz; None with fewer than two."""
    authority: str
    """Name of the last writer, or empty. A snapshot also reports the newest one."""
    late: int = 0
    """Number of samples that arrived out of order; those of one commit and stamp count once. A
    snapshot also reports the number up to now."""
    longest_gap: int = 0
    """Longest time between two neighbouring samples, nanoseconds."""
    cleared: bool = False
    """Whether `clear` dropped its samples and no sample followed."""

    def _repr_html_(self) -> str:
        """Write a table for notebooks."""
        from .notebooks import of_frame  # noqa: PLC0415 - needed by few

        return of_frame(self)


@dataclass(frozen=True, slots=True, eq=False)
class TreeColumns:
    """The facts of N frames and their edges T[parent<-name] as columns, sorted by name.

    From `Buffer.tree_columns`. Each value is that of the frame's `FrameInfo`.
    """

    names: tuple[str, ...]
    """The frames."""
    parents: tuple[str | None, ...]
    """Their parents; None for a root."""
    is_static: npt.NDArray[np.bool_]
    """Whether the edge is static, shape (N,) as all arrays here."""
    samples: npt.NDArray[np.int64]
    """Retained samples; 1 for a static edge."""
    oldest: npt.NDArray[np.int64]
    """First retained stamp, nanoseconds; -1 if the frame does not move."""
    newest: npt.NDArray[np.int64]
    """Last stamp, nanoseconds; -1 if the frame does not move."""
    rate: npt.NDArray[np.float64]
    """Mean rate of the samples in Hz; NaN with fewer than two."""
    authorities: tuple[str, ...]
    """Names of the last writers, or empty. A snapshot also reports the newest ones."""
    late: npt.NDArray[np.int64]
    """Number of samples that arrived out of order, as `FrameInfo.late`."""
    longest_gap: npt.NDArray[np.int64]
    """Longest time between two neighbouring samples, nanoseconds."""
    cleared: npt.NDArray[np.bool_]
    """Whether `clear` dropped the frame's samples and no sample followed."""

    def __len__(self) -> int:
        """Count the frames."""
        return len(self.names)

    def __repr__(self) -> str:
        return f"<tfdb.types.TreeColumns of {len(self)} frames>"


@dataclass(frozen=True, slots=True)
class MemoryUse:
    """Memory use of a store."""

    used_bytes: int
    """Bytes in use by frames, names and samples."""
    free_bytes: int
    """Bytes kept for reuse, some only after snapshots are closed."""
    frames: int
    """Frame slots in use."""
    samples: int
    """Samples in memory, including expired ones."""
    frame_bytes: int
    """Bytes of the frames' headers, part of `used_bytes`."""
    authority_bytes: int
    """Bytes of the names of authorities, not part of `used_bytes`."""


@dataclass(frozen=True, slots=True)
class Counters:
    """Counters of a store since it was made."""

    commits: int
    """Commits."""
    normalised: int
    """Quaternions that were slightly off unit length and normalised."""
    lapped_reads: int
    """Lookup attempts that a writer overtook."""
    pinned_reads: int
    """Lookups that pinned their state after four overtaken attempts."""
    aborts: int = 0
    """Transactions that ended without a commit, including conflicts."""
    conflicts: int = 0
    """Transactions that conflicted with another commit."""
    retries: int = 0
    """Lookups and writes that the engine started again."""
    lock_waits: int = 0
    """Waits for the lock of a frame."""


@dataclass(frozen=True, slots=True)
class Shared:
    """Properties of a shared store."""

    path: str
    """Its file."""
    mode: str
    """Mode of this opening: `r` or `rw`."""
    lock_timeout: float | None
    """Seconds that writes wait for another process; None: forever."""
    size: int
    """Largest size in bytes."""
    repairs: int
    """Number of commits that the next writer took back, because their writer died."""
    processes: int
    """Processes that have it open, including this one; 0: unknown without permission."""


@dataclass(frozen=True, slots=True)
class Frozen:
    """Properties of a frozen store."""

    path: str
    """Its file."""
    size: int
    """Bytes of the file."""
    origin: str
    """Source of a cache of `load(cache=True)`, as JSON; otherwise empty."""


@dataclass(frozen=True, slots=True, eq=False)
class Twist:
    """A velocity, or one for each of the N poses of a trajectory. `==` compares exactly."""

    linear: npt.NDArray[np.float64]
    """(3,) or (N, 3) in m/s."""
    angular: npt.NDArray[np.float64]
    """(3,) or (N, 3) in rad/s."""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Twist):
            return NotImplemented
        import numpy as np

        pairs = ((self.linear, other.linear), (self.angular, other.angular))
        return all(np.array_equal(a, b, equal_nan=True) for a, b in pairs)

    __hash__: ClassVar[None] = None  # type: ignore[assignment]

    def _repr_html_(self) -> str:
        """Write a table for notebooks."""
        from .notebooks import of_twist  # noqa: PLC0415 - needed by few

        return of_twist(self)


@dataclass(frozen=True, slots=True)
class IngestResult:
    """Counts of stored and refused messages and transforms."""

    messages: int
    """Read messages."""
    transforms: int
    """Transforms stored."""
    commits: int
    """Commits made, one for each message of which a transform was stored."""
    refused: int
    """Messages of which nothing was stored: damaged, or every transform was refused."""
    commit: int
    """Number of the newest commit."""
    reasons: dict[str, Refusal] = field(default_factory=dict)
    """Refused transforms by error class."""
    refused_transforms: int = 0
    """Transforms refused, those of messages that were stored in part included."""
    refused_edges: tuple[RefusedEdge, ...] = ()
    """Refused transforms by edge and error."""


belong_to("tfdb.types", globals(), __all__)
belong_to("tfdb", globals(), ("Columns", "TransformStamped"))

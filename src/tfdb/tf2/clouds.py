"""Transforms PointCloud2 messages, as tf2_sensor_msgs does; de-skews them point by point.

Clouds are messages of ROS 1, ROS 2 or `tfdb.tf2.msgs`, of any layout: fields in any order and at
any offset, float32 or float64, either byte order, rows with padding, NaN points. The result is a
new message of the same class and layout. Positions and normals are transformed, all other bytes are
equal. Normals are the fields `normal_x`, `normal_y`, `normal_z` or `nx`, `ny`, `nz`, if all three
have floating-point numbers.
"""

from __future__ import annotations

from array import array
from contextlib import contextmanager, nullcontext
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Literal

from tfdb import _core
from tfdb.data import errors
from tfdb.data.argument_checks import not_one_of
from tfdb.data.lazy_names import belong_to
from tfdb.data.stamps import MAX_STAMP
from tfdb.ros.ros_messages import fill_header, fill_stamp
from tfdb.ros.times import SECOND, nanoseconds

from .buffer_interface import ConvertRegistration, TransformRegistration
from .exceptions import InvalidArgumentException
from .geometry import from_msg_msg, rotation_of, to_msg_msg
from .message_checks import refuse_unlike
from .transform_argument import fill_result_header, rigid

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator

    import numpy as np
    import numpy.typing as npt

__all__ = ["deskew_cloud", "do_transform_cloud"]

_LONG_SCAN = 60.0
"""Times of a scan that span more seconds are probably in another unit."""

NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""Types of numpy by a PointField's datatype."""
PLACE = ("x", "y", "z")
NORMALS = (("normal_x", "normal_y", "normal_z"), ("nx", "ny", "nz"))
UNITS = {"s": SECOND, "ms": 1_000_000, "us": 1_000, "ns": 1}


class _Points:
    """A copy of a cloud's points: its fields as arrays (height, width).

    Raises InvalidArgumentException for a cloud that contradicts its header.
    """

    def __init__(self, cloud: Any) -> None:
        members = ("height", "width", "fields", "point_step", "row_step", "data", "header")
        refuse_unlike(cloud, "cloud", "a PointCloud2", *members)
        self.cloud = cloud
        self.data = bytearray(cloud.data)
        self.shape = (cloud.height, cloud.width)
        self.count = cloud.height * cloud.width
        self.steps = (cloud.row_step, cloud.point_step)
        self.order = ">" if cloud.is_bigendian else "<"
        # Padding fields may share a name, such as `_`.
        self.fields = {field.name: field for field in cloud.fields}
        missing = [name for name in PLACE if name not in self.fields]
        if missing:
            text = "Point cloud needs the fields x, y, and z for the transformation"
            there = ", ".join(self.fields) or "none"
            text = f"{text}: {', '.join(missing)} missing among {there}"
            raise InvalidArgumentException(text)
        self.check_size()
        self.place = self.floats(PLACE)
        self.normals = [self.floats(names) for names in NORMALS if all(map(self.is_float, names))]

    def check_size(self) -> None:
        """Raise if the bytes are too few for the points."""
        (height, width), (row_step, point_step) = self.shape, self.steps
        row = width * point_step
        needed = (height - 1) * row_step + row if self.count else 0
        if min(*self.shape, *self.steps) < 0 or (height > 1 and row_step < row):
            text = (
                f"{height} rows of {width} points of {point_step} bytes cannot be {row_step} apart"
            )
        elif needed > len(self.data):
            text = f"{height} x {width} points need {needed} bytes of data, got {len(self.data)}"
        else:
            return
        raise InvalidArgumentException(text, value=self.shape)

    def is_float(self, name: str) -> bool:
        """Whether a field of that name exists and has floating-point numbers."""
        return name in self.fields and NUMBERS.get(self.fields[name].datatype) in {"f4", "f8"}

    def numbers(self, name: str) -> npt.NDArray[Any]:
        """A view of a field's numbers, (height, width)."""
        import numpy as np

        field = self.fields.get(name)
        if field is None:
            text = f"the cloud has no field {name!r} among {', '.join(self.fields)}"
            raise InvalidArgumentException(text, value=name)
        if field.datatype not in NUMBERS:
            text = f"field {name!r} has the unknown datatype {field.datatype}"
            raise InvalidArgumentException(text, value=field.datatype)
        # Drivers write 0 for 1.
        if field.count not in {0, 1}:
            text = f"field {name!r} has {field.count} numbers, must have one"
            raise InvalidArgumentException(text, value=field.count)
        if sum(other.name == name for other in self.cloud.fields) > 1:
            raise InvalidArgumentException(f"the cloud has two fields {name!r}", value=name)
        kind = np.dtype(self.order + NUMBERS[field.datatype])
        if not self.count:
            return np.empty(self.shape, kind)
        if not 0 <= field.offset <= self.steps[1] - kind.itemsize:
            text = f"field {name!r} at {field.offset} lies outside a point of {self.steps[1]} bytes"
            raise InvalidArgumentException(text, value=field.offset)
        return np.ndarray(self.shape, kind, self.data, field.offset, self.steps)

    def floats(self, names: tuple[str, ...]) -> list[npt.NDArray[Any]]:
        """Views of three different fields of floating-point numbers."""
        for name in names:
            if not self.is_float(name):
                kind = self.fields[name].datatype
                text = f"field {name!r} must be FLOAT32 or FLOAT64, got datatype {kind}"
                raise InvalidArgumentException(text, value=kind)
        found = [self.numbers(name) for name in names]
        spans = sorted(
            (self.fields[name].offset, column.itemsize, name)
            for name, column in zip(names, found, strict=True)
        )
        for (start, size, name), (after, _, other) in pairwise(spans):
            if after < start + size:
                raise InvalidArgumentException(f"fields {name!r} and {other!r} overlap")
        return found

    def rows(self, columns: list[npt.NDArray[Any]]) -> npt.NDArray[Any]:
        """The numbers of three fields as an array (N, 3), float32 where all of them are."""
        import numpy as np

        narrow = all(column.itemsize == 4 for column in columns)
        rows = np.empty((self.count, 3), np.float32 if narrow else np.float64)
        for index, column in enumerate(columns):
            rows[:, index].reshape(self.shape)[...] = column
        return rows

    def put(self, columns: list[npt.NDArray[Any]], rows: npt.NDArray[Any]) -> None:
        """Write an array (N, 3) into three fields."""
        import numpy as np

        try:
            with np.errstate(over="raise"):
                for index, column in enumerate(columns):
                    column[...] = rows[:, index].reshape(self.shape)
        except FloatingPointError:
            raise errors.InvalidTransform("a transformed point is not finite in float32") from None

    def message(self) -> Any:
        """A new cloud of these bytes, with a copy of the old one's header."""
        made = type(self.cloud)()
        fill_header(made.header, self.cloud.header)
        for name in ("height", "width", "is_bigendian", "point_step", "row_step", "is_dense"):
            setattr(made, name, getattr(self.cloud, name))
        made.fields = [_copied(field) for field in self.cloud.fields]
        made.data = array("B", self.data) if isinstance(made.data, array) else bytes(self.data)
        return made


def _copied(field: Any) -> Any:
    """A PointField like another."""
    made = type(field)()
    for name in ("name", "offset", "datatype", "count"):
        setattr(made, name, getattr(field, name))
    return made


def do_transform_cloud(cloud: Any, transform: Any) -> Any:
    """Transform a PointCloud2 into the target frame: p_target = T p_source; normals are rotated.

    Parameters
    ----------
    cloud
        A cloud of any layout; it is not changed. Coordinates that are not finite stay unchanged.
    transform
        T[target<-source]: a TransformStamped, a Transform, or a `tfdb.Transform`.

    Returns
    -------
    PointCloud2
        A cloud with the class and layout of `cloud`. Its header is a copy of the transform's
        header, or of the cloud's if the transform has none.

    Raises InvalidArgumentException for an invalid transform, and for a cloud without x, y and z as
    floating point numbers or whose data contradict its header; `InvalidTransform`, with `index`, if
    the position of a finite point is not finite.
    """
    rigid_transform = rigid(transform)
    points = _Points(cloud)
    points.put(points.place, rigid_transform.apply(points.rows(points.place)))
    turn = rotation_of(rigid_transform)
    for normal in points.normals:
        points.put(normal, turn.apply(points.rows(normal)))
    made = points.message()
    fill_result_header(made, cloud, transform)
    return made


def deskew_cloud(
    cloud: Any,
    buffer: Any,
    target_frame: str,
    *,
    time_field: str,
    unit: Literal["s", "ms", "us", "ns"] | None = None,
    since: Literal["header", "epoch"] = "header",
    fixed_frame: str | None = None,
    target_time: Any = None,
) -> Any:
    """De-skew a PointCloud2: transform each point by the pose at its own stamp.

    p_target[i] = T[target<-source](t[i]) p_source[i], or with a fixed frame
    T[target<-fixed](target_time) T[fixed<-source](t[i]) p_source[i], all in one state; normals are
    rotated likewise. The source is the frame of the cloud's header.

    Parameters
    ----------
    cloud
        A cloud of any layout; it is not changed. A point that is not finite stays unchanged.
    buffer
        A `tfdb.Buffer` or snapshot, or a buffer of `tfdb.tf2`, for the lookups.
    target_frame
        Frame of the result: a fixed one, such as the map, or any with `fixed_frame`.
    time_field
        Field with the time of each point, such as `t` or `timestamp`.
    unit
        Unit of the field. None: seconds for floating point numbers, nanoseconds for integers.
    since
        `header`: times are relative to the stamp of the cloud's header; `epoch`: they are stamps.
    fixed_frame
        A frame that does not move during the scan, needed if the target frame moves. For example,
        `deskew_cloud(cloud, buffer, lidar, fixed_frame="odom")` returns the cloud in the lidar's
        frame at one stamp.
    target_time
        With `fixed_frame`: stamp of the target. None: the stamp of the header.

    Returns
    -------
    PointCloud2
        A cloud with the class and layout of `cloud`. With a fixed frame it has the stamp of the
        target, otherwise that of `cloud`.

    Raises InvalidArgumentException as `do_transform_cloud`, and for a time field that is missing or
    not finite; and the errors of `tfdb.Buffer.transform_points`, with `index`, row by row.
    """
    import numpy as np

    points = _Points(cloud)
    made_at = nanoseconds(cloud.header.stamp if target_time is None else target_time)
    source = cloud.header.frame_id
    rows = points.rows(points.place).astype(np.float64)
    wanted = np.asarray(np.isfinite(rows).all(axis=1))
    stamps = _stamps(points, time_field, unit, since, wanted)
    store = getattr(buffer, "buffer", buffer)
    with (
        _unit_in_errors(stamps, unit),
        store.snapshot() if isinstance(store, _core.Buffer) else nullcontext(store) as state,
    ):
        move = _PointMapper(state, (target_frame, source), stamps, fixed_frame, made_at)
        if wanted.any():
            points.put(points.place, move(rows))
        if wanted.any() and points.normals:
            origins = move(np.zeros_like(rows))
            for normal in points.normals:
                points.put(normal, move(points.rows(normal).astype(np.float64)) - origins)
    made = points.message()
    made.header.frame_id = target_frame
    if fixed_frame is not None:
        fill_stamp(made.header, made_at)
    return made


@contextmanager
def _unit_in_errors(stamps: npt.NDArray[np.int64], unit: str | None) -> Iterator[None]:
    """Add a note to an error of a stamp without data if the times seem to be in another unit."""
    try:
        yield
    except errors.Extrapolation as error:
        seconds = (stamps.max() - stamps.min()) / SECOND
        if unit is None and seconds > _LONG_SCAN:
            text = f"the times of the points span {seconds:,.0f} s: if their unit is another one, "
            error.add_note(f"{text}pass it, for example unit='us'")
        raise


class _PointMapper:
    """Transforms points of a source frame, each at its stamp."""

    def __init__(
        self,
        state: Any,
        frames: tuple[str, str],
        stamps: npt.NDArray[np.int64],
        fixed: str | None,
        moment: int,
    ) -> None:
        target, source = frames
        self.state, self.stamps = state, stamps
        self.frames = (target if fixed is None else fixed, source)
        self.back = None if fixed is None else state.lookup_transform(target, fixed, moment)

    def __call__(self, rows: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        moved: npt.NDArray[np.float64]
        moved = self.state.transform_points(*self.frames, rows, self.stamps)
        return moved if self.back is None else self.back.apply(moved)


def _check_word(name: str, value: object, words: Collection[str]) -> None:
    if not isinstance(value, str) or value not in words:
        raise InvalidArgumentException(not_one_of(name, value, words), value=value)


def _stamps(
    points: _Points, name: str, unit: str | None, since: str, wanted: npt.NDArray[np.bool_]
) -> npt.NDArray[np.int64]:
    """The stamp of each point, (N,) nanoseconds; unused points get the stamp of a used one."""
    import numpy as np

    _check_word("since", since, ("header", "epoch"))
    if unit is not None:
        _check_word("unit", unit, UNITS)
    numbers = points.numbers(name).reshape(-1)
    whole = numbers.dtype.kind != "f"
    scale = UNITS[unit or ("ns" if whole else "s")]
    if not wanted.any():
        return np.zeros(len(numbers), np.int64)
    numbers = np.where(wanted, numbers, numbers[wanted.argmax()])
    first = nanoseconds(points.cloud.header.stamp) if since == "header" else 0
    if whole:
        return _within(first + numbers.astype(np.int64) * scale, name, since)
    with np.errstate(over="ignore"):
        spans = np.rint(numbers.astype(np.float64) * scale)
    # A comparison with NaN is false.
    bad = ~(np.abs(spans) <= 2.0**61)
    if bad.any():
        index = int(bad.argmax())
        text = f"field {name!r} of point {index} is not a time: {numbers[index]}"
        raise InvalidArgumentException(text, index=index, value=float(numbers[index]))
    return _within(first + spans.astype(np.int64), name, since)


def _within(stamps: npt.NDArray[np.int64], name: str, since: str) -> npt.NDArray[np.int64]:
    """Return the stamps; raise if they count from another time than the argument states."""
    late = stamps > MAX_STAMP
    if since == "header" and late.any():
        index = int(late.argmax())
        text = (
            f"field {name!r} of point {index}, counted from the header's stamp, is beyond the "
            "greatest stamp: since='epoch' reads the field as a whole stamp"
        )
        raise InvalidArgumentException(text, index=index, value=int(stamps[index]))
    return stamps


TransformRegistration().add("sensor_msgs/PointCloud2", do_transform_cloud)
ConvertRegistration().add_to_msg("sensor_msgs/PointCloud2", to_msg_msg)
ConvertRegistration().add_from_msg("sensor_msgs/PointCloud2", from_msg_msg)

belong_to(__name__, globals(), __all__)

"""Decodes messages with poses that are not TFMessages, and joint states.

- Odometry, TransformStamped, PoseStamped, PoseWithCovarianceStamped and Path of ROS 1 and ROS 2
- Foxglove's FrameTransform, FrameTransforms and PoseInFrame, in protobuf, JSON, and as ROS messages
  (https://docs.foxglove.dev/docs/visualization/message-schemas/introduction)

Unused fields, such as covariances, twists and efforts, are skipped.
"""

from __future__ import annotations

import json
import re
import struct
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

from tfdb.data.decimal_time import rfc3339_ns
from tfdb.data.errors import CorruptMessage, InvalidStamp, TfdbError
from tfdb.data.stamps import MAX_STAMP
from tfdb.data.types import TransformStamped

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from .containers import Source

    Floats: TypeAlias = tuple[float, ...]

_NS = 1_000_000_000
_DOUBLE, _FLOAT = struct.Struct("<d"), struct.Struct("<f")
_INTEGER = re.compile(r"-?[0-9]{1,20}")
_BROKEN = (
    *(struct.error, ValueError, TypeError, KeyError),
    *(IndexError, OverflowError, RecursionError),
)
"""Errors that invalid bytes cause."""


@dataclass(frozen=True)
class JointState:
    """One message of joint states: the stamp, and positions by the joints' names."""

    stamp: int
    positions: dict[str, float]


@dataclass(frozen=True)
class Poses:
    """The poses of one message, as transforms.

    `untimed` of them have no timestamp and got the receive time. `refused` are the errors of
    members that cannot be read.
    """

    transforms: list[TransformStamped]
    untimed: int
    refused: list[TfdbError]


def decode_poses(data: bytes, source: Source, child: str | None, received: int) -> Poses:
    """Decode one message. `child` is the frame of its poses; None: the message names it.

    Raises CorruptMessage or InvalidStamp if the message, or each of its members, cannot be read.
    """
    try:
        if source.encoding in ("ros1", "cdr"):
            found = list(_ROS[source.type](_Fields(data, cdr=source.encoding == "cdr")))
        elif source.encoding == "json":
            found = list(_of_foxglove(source.type, _Json(json.loads(data), "")))
        else:
            found = list(_of_foxglove(source.type, _Protobuf(data)))
    except TfdbError:
        raise
    except _BROKEN as error:
        raise _corrupt(source, _unreadable(source, error)) from None
    made: list[TransformStamped] = []
    refused: list[TfdbError] = []
    untimed = 0
    for each in found:
        if isinstance(each, TfdbError):
            refused.append(each)
            continue
        if isinstance(each, Exception):
            refused.append(_corrupt(source, _unreadable(source, each)))
            continue
        stamp, above, named, pose = each
        # One leading slash is dropped, as in every message.
        parent, of = above.removeprefix("/"), child or named.removeprefix("/")
        if not parent or not of:
            what = f"it names no {'parent' if not parent else 'child'} frame"
            refused.append(_corrupt(source, what))
            continue
        untimed += stamp is None
        at = received if stamp is None else stamp
        made.append(TransformStamped(parent, of, at, pose[:3], pose[3:]))
    if refused and not made:
        raise refused[0]
    return Poses(made, untimed, refused)


def _unreadable(source: Source, error: Exception) -> str:
    return f"no {source.type} in {source.encoding}: {error}"


def _corrupt(source: Source, reason: str) -> CorruptMessage:
    return CorruptMessage(f"topic {source.topic!r}: {reason}", reason=reason)


def decode_joint_state(data: bytes, source: Source) -> JointState:
    """Return the positions of one sensor_msgs/JointState; raises CorruptMessage, InvalidStamp."""
    try:
        fields = _Fields(data, cdr=source.encoding == "cdr")
        stamp, _ = fields.header()
        names = [fields.text() for _ in range(fields.count(4))]
        positions = fields.doubles(fields.count(8))
    except TfdbError:
        raise
    except (struct.error, ValueError) as error:
        raise _corrupt(source, _unreadable(source, error)) from None
    if positions and len(positions) != len(names):
        raise _corrupt(source, f"{len(names)} joints and {len(positions)} positions")
    return JointState(stamp, dict(zip(names, positions, strict=False)))


# -- messages of ROS ------------------------------------------------------------------------------


class _Fields:
    """Reads the fields of a ROS message one after the other."""

    def __init__(self, data: bytes, *, cdr: bool) -> None:
        self._data = data
        self._cdr = cdr
        self._at = self._start = 4 if cdr else 0
        self._order = "<"
        if cdr:
            if data[:2] not in (b"\0\0", b"\0\1"):
                raise ValueError(f"the encapsulation {data[:2].hex()} is not that of plain CDR")
            self._order = "<" if data[1] else ">"

    def _take(self, kind: str, width: int, count: int = 1) -> tuple[Any, ...]:
        if self._cdr and count:
            self._at += -(self._at - self._start) % width
        found = struct.unpack_from(f"{self._order}{count}{kind}", self._data, self._at)
        self._at += width * count
        return found

    def doubles(self, count: int) -> Floats:
        return self._take("d", 8, count)

    def count(self, width: int) -> int:
        """Read the length of a sequence; `width` is the smallest size of a member in bytes."""
        (count,) = self._take("I", 4)
        left = len(self._data) - self._at
        if count * width > left:
            raise ValueError(f"{count} members in the last {left} bytes")
        return int(count)

    def text(self) -> str:
        size = self.count(1)
        raw = self._data[self._at : self._at + size]
        self._at += size
        return (raw.removesuffix(b"\0") if self._cdr else raw).decode()

    def time(self) -> tuple[int, int]:
        """Read a stamp: seconds and nanoseconds."""
        (seconds,), (nanoseconds,) = self._take("i" if self._cdr else "I", 4), self._take("I", 4)
        return seconds, nanoseconds

    def stamp(self) -> int:
        return _stamp(*self.time())

    def header(self) -> tuple[int, str]:
        if not self._cdr:
            self._take("I", 4)  # the sequence number
        return self.stamp(), self.text()

    def pose(self) -> Floats:
        return self.doubles(7)


def _stamp(seconds: int, nanoseconds: int, field: str = "stamp") -> int:
    stamp = seconds * _NS + nanoseconds
    if not 0 <= stamp <= MAX_STAMP or not 0 <= nanoseconds < _NS:
        what = f"{field}: {seconds} s and {nanoseconds} ns are not a stamp"
        raise InvalidStamp(what, value=(seconds, nanoseconds))
    return stamp


_Found: TypeAlias = "Iterator[tuple[int | None, str, str, Floats] | Exception]"
"""Stamp (None: missing), parent, child (empty: missing) and pose; or the error of a member."""


def _with_child(fields: _Fields) -> _Found:
    stamp, parent = fields.header()
    child = fields.text()
    yield stamp, parent, child, fields.pose()


def _without_child(fields: _Fields) -> _Found:
    stamp, parent = fields.header()
    yield stamp, parent, "", fields.pose()


def _path(fields: _Fields) -> _Found:
    """Read the poses of a path; empty fields of their headers come from the path's header."""
    of_all, parent = fields.header()
    stamps = set()
    # Smallest size of a header and a pose.
    count = fields.count(68)
    for _ in range(count):
        stamp, own = fields.header()
        stamps.add(stamp)
        yield stamp or of_all, own or parent, "", fields.pose()
    if count > 1 and len(stamps) == 1:
        raise InvalidStamp(f"a path of {count} poses with one stamp: a plan, not a motion")


def _frame_transform(fields: _Fields) -> _Found:
    stamp, parent, child = fields.stamp(), fields.text(), fields.text()
    yield stamp, parent, child, fields.pose()


def _frame_transforms(fields: _Fields) -> _Found:
    for _ in range(fields.count(72)):
        time, parent, child = fields.time(), fields.text(), fields.text()
        pose = fields.pose()
        try:
            yield _stamp(*time), parent, child, pose
        except InvalidStamp as error:
            yield error


def _pose_in_frame(fields: _Fields) -> _Found:
    stamp, parent = fields.stamp(), fields.text()
    yield stamp, parent, "", fields.pose()


_ROS: Mapping[str, Callable[[_Fields], _Found]] = {
    "nav_msgs/Odometry": _with_child,
    "geometry_msgs/TransformStamped": _with_child,
    "geometry_msgs/PoseStamped": _without_child,
    "geometry_msgs/PoseWithCovarianceStamped": _without_child,
    "nav_msgs/Path": _path,
    "foxglove.FrameTransform": _frame_transform,
    "foxglove.FrameTransforms": _frame_transforms,
    "foxglove.PoseInFrame": _pose_in_frame,
}


# -- messages of Foxglove -------------------------------------------------------------------------


class _Json:
    """A JSON message: fields by name, as spelled by Foxglove or by protobuf's JSON mapping.

    Missing and null fields have their defaults, as in that mapping. Errors name the field.
    """

    def __init__(self, found: Any, where: str) -> None:
        self._prefix = f"{where}." if where else ""
        if not isinstance(found, dict):
            raise TypeError(f"{where or 'the message'} is not an object")
        self._found = found

    def _get(self, name: str) -> Any:
        value = self._found.get(name)
        first, *others = name.split("_")
        return self._found.get(first + "".join(map(str.title, others))) if value is None else value

    def stamp(self, _number: int, name: str) -> int | None:
        value, field = self._get(name), self._prefix + name
        if value is None:
            return None
        if isinstance(value, str):
            try:
                stamp = rfc3339_ns(value)
            except ValueError as error:
                raise ValueError(f"{field}: {error}") from None
            return _stamp(*divmod(stamp, _NS), field)
        if not isinstance(value, dict):
            raise TypeError(f"{field} is neither an object of sec and nsec nor an RFC 3339 string")
        seconds = _integer(value.get("sec"), f"{field}.sec")
        return _stamp(seconds, _integer(value.get("nsec"), f"{field}.nsec"), field)

    def text(self, _number: int, name: str) -> str:
        value = self._get(name)
        if not isinstance(value, str | None):
            raise TypeError(f"{self._prefix}{name} is not a string")
        return value or ""

    def part(self, _number: int, name: str) -> _Json:
        value = self._get(name)
        return _Json({} if value is None else value, self._prefix + name)

    def parts(self, _number: int, name: str) -> list[Callable[[], _Json]]:
        value = self._get(name)
        if value is None and not self._found:
            return []
        if not isinstance(value, list):
            raise TypeError(f"{self._prefix}{name} is not a list")
        return [partial(_Json, each, f"{self._prefix}{name}[{n}]") for n, each in enumerate(value)]

    def doubles(self, names: str) -> Floats:
        if self._found and self._found.keys().isdisjoint(names):
            raise TypeError(f"{self._prefix.rstrip('.')} has none of the fields {', '.join(names)}")
        return tuple(map(self._double, names))

    def _double(self, name: str) -> float:
        value = self._get(name)
        # Protobuf's mapping writes numbers that JSON lacks as text, such as "NaN".
        if not isinstance(value, int | float | str | None) or isinstance(value, bool):
            raise TypeError(f"{self._prefix}{name} is not a number")
        try:
            return 0.0 if value is None else float(value)
        except (ValueError, OverflowError):
            raise ValueError(f"{self._prefix}{name} is not a number: {str(value)[:40]!r}") from None


def _integer(value: Any, field: str) -> int:
    """Read a JSON integer, or its text: protobuf's mapping writes 64-bit integers as text."""
    if isinstance(value, str) and _INTEGER.fullmatch(value):
        return int(value)
    if not isinstance(value, int) or isinstance(value, bool):
        raise TypeError(f"{field} is not an integer: {str(value)[:40]}")
    return value


class _Protobuf:
    """A protobuf message: fields by number (https://protobuf.dev/programming-guides/encoding)."""

    def __init__(self, data: bytes) -> None:
        self._found: dict[int, list[Any]] = {}
        at, end = 0, len(data)
        while at < end:
            key, at = self._varint(data, at)
            kind = key & 7
            value: Any
            if kind == 2:
                size, at = self._varint(data, at)
                if at + size > end:
                    raise ValueError("a field is longer than its message")
                value, at = data[at : at + size], at + size
            elif kind == 1:
                (value,), at = _DOUBLE.unpack_from(data, at), at + 8
            elif kind == 0:
                value, at = self._varint(data, at)
            elif kind == 5:
                (value,), at = _FLOAT.unpack_from(data, at), at + 4
            else:
                raise ValueError(f"unknown wire type {kind}")
            self._found.setdefault(key >> 3, []).append(value)

    @staticmethod
    def _varint(data: bytes, at: int) -> tuple[int, int]:
        if data[at] < 0x80:
            return data[at], at + 1
        value = shift = 0
        while shift < 70:
            byte = data[at]
            value |= (byte & 0x7F) << shift
            at, shift = at + 1, shift + 7
            if byte < 0x80:
                return value, at
        raise ValueError("a varint has more than 10 bytes")

    def _last(self, number: int, name: str, default: Any, kind: type) -> Any:
        value = self._found.get(number, [default])[-1]
        if not isinstance(value, kind):
            raise TypeError(f"{name} (field {number}) has another wire type")
        return value

    def stamp(self, number: int, name: str) -> int | None:
        if number not in self._found:
            return None
        time = self.part(number, name)
        seconds = time._last(1, f"{name}.seconds", 0, int)
        nanoseconds = time._last(2, f"{name}.nanos", 0, int)
        return _stamp(seconds - (seconds >> 63 << 64), nanoseconds, name)

    def text(self, number: int, name: str) -> str:
        return str(self._last(number, name, b"", bytes), "utf-8")

    def part(self, number: int, name: str) -> _Protobuf:
        data = self._last(number, name, b"", bytes)
        try:
            return _Protobuf(data)
        except (ValueError, IndexError, struct.error) as error:
            raise ValueError(f"{name} (field {number}): {error}") from None

    def parts(self, number: int, name: str) -> list[Callable[[], _Protobuf]]:
        found = self._found.get(number, [])
        if not all(isinstance(each, bytes) for each in found):
            raise TypeError(f"{name} (field {number}) has another wire type")
        return [partial(_Protobuf, each) for each in found]

    def doubles(self, names: str) -> Floats:
        found = self._found
        made = tuple([found[n][-1] if n in found else 0.0 for n in range(1, len(names) + 1)])
        for number, value in enumerate(made):
            if type(value) is not float:
                raise TypeError(f"{names[number]} (field {number + 1}) has another wire type")
        return made


def _of_foxglove(type_: str, message: _Json | _Protobuf) -> _Found:
    if type_ == "foxglove.FrameTransforms":
        for part in message.parts(1, "transforms"):
            try:
                yield from _of_foxglove("foxglove.FrameTransform", part())
            except _BROKEN as error:
                yield error
        return
    stamp = message.stamp(1, "timestamp")
    if type_ == "foxglove.PoseInFrame":
        pose = message.part(3, "pose")
        move, turn = pose.part(1, "position"), pose.part(2, "orientation")
        yield stamp, message.text(2, "frame_id"), "", move.doubles("xyz") + turn.doubles("xyzw")
        return
    parent, child = message.text(2, "parent_frame_id"), message.text(3, "child_frame_id")
    move, turn = message.part(4, "translation"), message.part(5, "rotation")
    yield stamp, parent, child, move.doubles("xyz") + turn.doubles("xyzw")

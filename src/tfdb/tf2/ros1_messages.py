"""Bytes of the messages of the action LookupTransform in ROS 1.

Numbers are little-endian, a string is its length and its bytes, a time is two uint32.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from tfdb.data.errors import CorruptMessage
from tfdb.ros.ros_messages import makers
from tfdb.ros.times import SECOND, nanoseconds

from .lookup_action import LookupGoal, LookupResult

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = [
    "GoalId",
    "Status",
    "decode_goal",
    "decode_goal_id",
    "decode_result",
    "encode_goal",
    "encode_goal_id",
    "encode_result",
    "encode_status_list",
]


@dataclass(frozen=True, slots=True)
class GoalId:
    """An actionlib_msgs/GoalID, its stamp in nanoseconds."""

    stamp: int = 0
    id: str = ""


@dataclass(frozen=True, slots=True)
class Status:
    """An actionlib_msgs/GoalStatus."""

    goal_id: GoalId
    status: int
    text: str = ""

    def with_status(self, status: int, text: str = "") -> Status:
        """Make the next status of the same goal."""
        return replace(self, status=status, text=text)


class _Reader:
    """Reads a message; raises CorruptMessage if it ends too early."""

    def __init__(self, data: bytes | memoryview, kind: str) -> None:
        self._data, self._kind, self._at = memoryview(data), kind, 0

    def take(self, layout: str) -> tuple[Any, ...]:
        """Read numbers."""
        size = struct.calcsize(f"<{layout}")
        self._need(size)
        found = struct.unpack_from(f"<{layout}", self._data, self._at)
        self._at += size
        return found

    def number(self) -> int:
        """Read a uint8."""
        (found,) = self.take("B")
        return int(found)

    def text(self) -> str:
        """Read a string."""
        (length,) = self.take("I")
        self._need(length)
        found = bytes(self._data[self._at : self._at + length])
        self._at += length
        return found.decode(errors="replace")

    def time(self) -> int:
        """Read a time."""
        seconds, rest = self.take("II")
        return int(seconds) * SECOND + int(rest)

    def duration(self) -> int:
        """Read a duration."""
        seconds, rest = self.take("ii")
        return int(seconds) * SECOND + int(rest)

    def header(self) -> tuple[int, str]:
        """Read a std_msgs/Header: stamp and frame."""
        self.take("I")
        return self.time(), self.text()

    def goal_id(self) -> GoalId:
        """Read an actionlib_msgs/GoalID."""
        return GoalId(self.time(), self.text())

    def status(self) -> Status:
        """Read an actionlib_msgs/GoalStatus."""
        return Status(self.goal_id(), self.number(), self.text())

    def _need(self, size: int) -> None:
        if self._at + size > len(self._data):
            raise CorruptMessage(
                f"a {self._kind} of {len(self._data)} bytes ends within a field at byte {self._at}",
                offset=self._at,
                reason="truncated",
            )


def _text(value: str) -> bytes:
    data = value.encode()
    return struct.pack("<I", len(data)) + data


def _time(value: int) -> bytes:
    seconds, rest = divmod(value, SECOND)
    return struct.pack("<II", seconds & 0xFFFFFFFF, rest)


def _duration(value: int) -> bytes:
    seconds, rest = divmod(value, SECOND)
    return struct.pack("<ii", max(-(1 << 31), min(seconds, (1 << 31) - 1)), rest)


def _header(stamp: int, frame: str = "") -> bytes:
    return struct.pack("<I", 0) + _time(stamp) + _text(frame)


def _status(status: Status) -> bytes:
    return encode_goal_id(status.goal_id) + bytes([status.status]) + _text(status.text)


def encode_goal_id(goal_id: GoalId) -> bytes:
    """Make an actionlib_msgs/GoalID."""
    return _time(goal_id.stamp) + _text(goal_id.id)


def decode_goal_id(data: bytes | memoryview) -> GoalId:
    """Read an actionlib_msgs/GoalID."""
    return _Reader(data, "actionlib_msgs/GoalID").goal_id()


def encode_status_list(now: int, statuses: Iterable[Status]) -> bytes:
    """Make an actionlib_msgs/GoalStatusArray."""
    parts = [_status(status) for status in statuses]
    return _header(now) + struct.pack("<I", len(parts)) + b"".join(parts)


def encode_goal(now: int, goal_id: GoalId, goal: LookupGoal) -> bytes:
    """Make a tf2_msgs/LookupTransformActionGoal."""
    return b"".join(
        [
            _header(now),
            encode_goal_id(goal_id),
            _text(goal.target_frame),
            _text(goal.source_frame),
            _time(goal.source_time),
            _duration(goal.timeout),
            _time(goal.target_time),
            _text(goal.fixed_frame),
            bytes([goal.advanced]),
        ]
    )


def decode_goal(data: bytes | memoryview) -> tuple[GoalId, LookupGoal]:
    """Read a tf2_msgs/LookupTransformActionGoal."""
    reader = _Reader(data, "tf2_msgs/LookupTransformActionGoal")
    reader.header()
    return reader.goal_id(), LookupGoal(
        target_frame=reader.text(),
        source_frame=reader.text(),
        source_time=reader.time(),
        timeout=reader.duration(),
        target_time=reader.time(),
        fixed_frame=reader.text(),
        advanced=bool(reader.number()),
    )


def encode_result(now: int, status: Status, result: LookupResult) -> bytes:
    """Make a tf2_msgs/LookupTransformActionResult."""
    return b"".join(
        [
            _header(now),
            _status(status),
            _transform(result.transform),
            bytes([result.error]),
            _text(result.error_string),
        ]
    )


def decode_result(data: bytes | memoryview) -> tuple[Status, LookupResult]:
    """Read a tf2_msgs/LookupTransformActionResult; without frames it has no transform."""
    reader = _Reader(data, "tf2_msgs/LookupTransformActionResult")
    reader.header()
    status = reader.status()
    stamp, target = reader.header()
    source, pose = reader.text(), reader.take("7d")
    make, _ = makers("ros1")
    transform = make(target, source, stamp, pose) if target or source else None
    return status, LookupResult(transform, reader.number(), reader.text())


def _transform(message: Any) -> bytes:
    if message is None:
        return _header(0) + _text("") + bytes(7 * 8)
    move, turn = message.transform.translation, message.transform.rotation
    pose = move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w
    return b"".join(
        [
            _header(nanoseconds(message.header.stamp), message.header.frame_id),
            _text(message.child_frame_id),
            struct.pack("<7d", *pose),
        ]
    )

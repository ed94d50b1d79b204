"""`rclpy.time.Time` and `rclpy.duration.Duration` for programs on machines without ROS."""

from __future__ import annotations

from functools import total_ordering
from typing import Any, Self

from tfdb.ros import msgs
from tfdb.ros.times import SECOND

__all__ = ["Duration", "Time"]


@total_ordering
class _Nanoseconds:
    """A number of nanoseconds, as in rclpy."""

    def __init__(self, *, seconds: float = 0, nanoseconds: float = 0) -> None:
        whole = seconds * SECOND if isinstance(seconds, int) else int(seconds * SECOND)
        self._nanoseconds = whole + int(nanoseconds)

    @property
    def nanoseconds(self) -> int:
        """The whole value in nanoseconds."""
        return self._nanoseconds

    def seconds_nanoseconds(self) -> tuple[int, int]:
        """Whole seconds, and the nanoseconds beyond them."""
        return divmod(self._nanoseconds, SECOND)

    def __repr__(self) -> str:
        return f"{type(self).__name__}(nanoseconds={self._nanoseconds})"

    def __eq__(self, other: object) -> bool:
        return type(other) is type(self) and other._nanoseconds == self._nanoseconds

    def __lt__(self, other: Self) -> bool:
        if type(other) is not type(self):
            return NotImplemented
        return self._nanoseconds < other._nanoseconds

    def __hash__(self) -> int:
        return hash(self._nanoseconds)


class Duration(_Nanoseconds):
    """A duration."""

    def to_msg(self) -> msgs.Duration:
        """Make it a message."""
        return msgs.Duration.from_nanoseconds(self._nanoseconds)

    @classmethod
    def from_msg(cls, msg: Any) -> Self:
        """Make it of a message."""
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec)


class Time(_Nanoseconds):
    """A point in time."""

    def __init__(
        self, *, seconds: float = 0, nanoseconds: float = 0, clock_type: Any = None
    ) -> None:
        super().__init__(seconds=seconds, nanoseconds=nanoseconds)
        self.clock_type = clock_type
        """The given value."""

    def __add__(self, other: Duration) -> Time:
        if not isinstance(other, Duration):
            return NotImplemented
        return Time(nanoseconds=self._nanoseconds + other.nanoseconds)

    def __sub__(self, other: Any) -> Any:
        if isinstance(other, Time):
            return Duration(nanoseconds=self._nanoseconds - other.nanoseconds)
        if isinstance(other, Duration):
            return Time(nanoseconds=self._nanoseconds - other.nanoseconds)
        return NotImplemented

    def to_msg(self) -> msgs.Time:
        """Make it a message."""
        return msgs.Time.from_nanoseconds(self._nanoseconds)

    @classmethod
    def from_msg(cls, msg: Any, clock_type: Any = None) -> Self:
        """Make it of a message."""
        return cls(seconds=msg.sec, nanoseconds=msg.nanosec, clock_type=clock_type)

"""Messages of geometry_msgs for programs without ROS: the same fields, the same defaults.

Any function of `tfdb.tf2` takes these and the real ones alike.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Self

__all__ = [
    "Duration",
    "Header",
    "Quaternion",
    "Time",
    "Transform",
    "TransformStamped",
    "Vector3",
]

SECOND = 1_000_000_000


@dataclass(slots=True, order=True)
class _Span:
    """Seconds and nanoseconds, under the names of ROS 2 and of ROS 1."""

    sec: int = 0
    """Whole seconds, rounded down."""
    nanosec: int = 0
    """Nanoseconds beyond them, from 0 to 999,999,999."""

    @classmethod
    def from_nanoseconds(cls, nanoseconds: int) -> Self:
        """Make it of nanoseconds alone."""
        return cls(*divmod(nanoseconds, SECOND))

    @property
    def nanoseconds(self) -> int:
        """All of it in nanoseconds."""
        return self.sec * SECOND + self.nanosec

    @property
    def secs(self) -> int:
        """`sec` under ROS 1's name."""
        return self.sec

    @property
    def nsecs(self) -> int:
        """`nanosec` under ROS 1's name."""
        return self.nanosec

    def to_nsec(self) -> int:
        """All of it in nanoseconds, as rospy says it."""
        return self.nanoseconds

    def to_sec(self) -> float:
        """All of it in seconds: a float does not hold every nanosecond."""
        return self.nanoseconds / 1e9


class Time(_Span):
    """A `builtin_interfaces/Time`; 0 means the latest common time in lookups."""

    __slots__ = ()


class Duration(_Span):
    """A `builtin_interfaces/Duration`."""

    __slots__ = ()


@dataclass(slots=True)
class Header:
    """A `std_msgs/Header`."""

    stamp: Time = field(default_factory=Time)
    """The stamp."""
    frame_id: str = ""
    """The parent, or target, frame."""


@dataclass(slots=True)
class Vector3:
    """A `geometry_msgs/Vector3`."""

    x: float = 0.0
    """Along x, metres in a translation."""
    y: float = 0.0
    """Along y."""
    z: float = 0.0
    """Along z."""


@dataclass(slots=True)
class Quaternion:
    """A `geometry_msgs/Quaternion`, the identity by default."""

    x: float = 0.0
    """Along x."""
    y: float = 0.0
    """Along y."""
    z: float = 0.0
    """Along z."""
    w: float = 1.0
    """The real part."""


@dataclass(slots=True)
class Transform:
    """A `geometry_msgs/Transform`."""

    translation: Vector3 = field(default_factory=Vector3)
    """Metres."""
    rotation: Quaternion = field(default_factory=Quaternion)
    """Unit quaternion."""


@dataclass(slots=True)
class TransformStamped:
    """A `geometry_msgs/TransformStamped`: T[header.frame_id<-child_frame_id] at header.stamp."""

    header: Header = field(default_factory=Header)
    """Parent, or target, and stamp."""
    child_frame_id: str = ""
    """Child, or source."""
    transform: Transform = field(default_factory=Transform)
    """p_parent = transform p_child."""

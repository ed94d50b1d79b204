"""Messages for programs without ROS, with the fields of geometry_msgs and ROS 2's defaults.

All functions of `tfdb.tf2` accept these and real messages. `_type` is the name of a message.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Self

from tfdb.data.lazy_names import belong_to

__all__ = [
    "ChannelFloat32",
    "Duration",
    "Header",
    "Point",
    "Point32",
    "PointCloud",
    "PointCloud2",
    "PointField",
    "PointStamped",
    "Polygon",
    "PolygonStamped",
    "Pose",
    "PoseStamped",
    "PoseWithCovariance",
    "PoseWithCovarianceStamped",
    "Quaternion",
    "QuaternionStamped",
    "TFMessage",
    "Time",
    "Transform",
    "TransformStamped",
    "Twist",
    "TwistStamped",
    "Vector3",
    "Vector3Stamped",
    "Wrench",
    "WrenchStamped",
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
        """Make it from nanoseconds."""
        return cls(*divmod(nanoseconds, SECOND))

    @property
    def nanoseconds(self) -> int:
        """The whole time in nanoseconds."""
        return self.sec * SECOND + self.nanosec

    @property
    def secs(self) -> int:
        """`sec` under ROS 1's name."""
        return self.sec

    @secs.setter
    def secs(self, secs: int) -> None:
        self.sec = secs

    @property
    def nsecs(self) -> int:
        """`nanosec` under ROS 1's name."""
        return self.nanosec

    @nsecs.setter
    def nsecs(self, nsecs: int) -> None:
        self.nanosec = nsecs

    def to_nsec(self) -> int:
        """Total nanoseconds, under rospy's name."""
        return self.nanoseconds

    def to_sec(self) -> float:
        """The whole time in seconds, as a float without exact nanoseconds."""
        return self.nanoseconds / 1e9


class Time(_Span):
    """A `builtin_interfaces/Time`; 0 means the latest common time in lookups."""

    __slots__ = ()
    _type: ClassVar[str] = "builtin_interfaces/Time"


class Duration(_Span):
    """A `builtin_interfaces/Duration`."""

    __slots__ = ()
    _type: ClassVar[str] = "builtin_interfaces/Duration"


@dataclass(slots=True)
class Header:
    """A `std_msgs/Header`."""

    _type: ClassVar[str] = "std_msgs/Header"

    stamp: Time = field(default_factory=Time)
    """The stamp."""
    frame_id: str = ""
    """The parent, or target, frame."""


@dataclass(slots=True)
class Vector3:
    """A `geometry_msgs/Vector3`."""

    _type: ClassVar[str] = "geometry_msgs/Vector3"

    x: float = 0.0
    """Along x, metres in a translation."""
    y: float = 0.0
    """Along y."""
    z: float = 0.0
    """Along z."""


@dataclass(slots=True)
class Quaternion:
    """A `geometry_msgs/Quaternion`, the identity by default."""

    _type: ClassVar[str] = "geometry_msgs/Quaternion"

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

    _type: ClassVar[str] = "geometry_msgs/Transform"

    translation: Vector3 = field(default_factory=Vector3)
    """Metres."""
    rotation: Quaternion = field(default_factory=Quaternion)
    """Unit quaternion."""


@dataclass(slots=True)
class TransformStamped:
    """A `geometry_msgs/TransformStamped`: T[header.frame_id<-child_frame_id] at header.stamp."""

    _type: ClassVar[str] = "geometry_msgs/TransformStamped"

    header: Header = field(default_factory=Header)
    """Parent, or target, and stamp."""
    child_frame_id: str = ""
    """Child, or source."""
    transform: Transform = field(default_factory=Transform)
    """p_parent = transform p_child."""


@dataclass(slots=True)
class Point:
    """A `geometry_msgs/Point`."""

    _type: ClassVar[str] = "geometry_msgs/Point"

    x: float = 0.0
    """Along x, metres."""
    y: float = 0.0
    """Along y."""
    z: float = 0.0
    """Along z."""


@dataclass(slots=True)
class Point32:
    """A `geometry_msgs/Point32`: float32 on the wire."""

    _type: ClassVar[str] = "geometry_msgs/Point32"

    x: float = 0.0
    """Along x, metres."""
    y: float = 0.0
    """Along y."""
    z: float = 0.0
    """Along z."""


@dataclass(slots=True)
class PointStamped:
    """A `geometry_msgs/PointStamped`."""

    _type: ClassVar[str] = "geometry_msgs/PointStamped"

    header: Header = field(default_factory=Header)
    """Frame and stamp."""
    point: Point = field(default_factory=Point)
    """In coordinates of the header's frame."""


@dataclass(slots=True)
class Vector3Stamped:
    """A `geometry_msgs/Vector3Stamped`."""

    _type: ClassVar[str] = "geometry_msgs/Vector3Stamped"

    header: Header = field(default_factory=Header)
    """Frame and stamp."""
    vector: Vector3 = field(default_factory=Vector3)
    """A direction, on the axes of the header's frame."""


@dataclass(slots=True)
class QuaternionStamped:
    """A `geometry_msgs/QuaternionStamped`."""

    _type: ClassVar[str] = "geometry_msgs/QuaternionStamped"

    header: Header = field(default_factory=Header)
    """Frame and stamp."""
    quaternion: Quaternion = field(default_factory=Quaternion)
    """An orientation in the header's frame."""


@dataclass(slots=True)
class Pose:
    """A `geometry_msgs/Pose`."""

    _type: ClassVar[str] = "geometry_msgs/Pose"

    position: Point = field(default_factory=Point)
    """Metres."""
    orientation: Quaternion = field(default_factory=Quaternion)
    """Unit quaternion."""


@dataclass(slots=True)
class PoseStamped:
    """A `geometry_msgs/PoseStamped`."""

    _type: ClassVar[str] = "geometry_msgs/PoseStamped"

    header: Header = field(default_factory=Header)
    """Frame and stamp."""
    pose: Pose = field(default_factory=Pose)
    """In the header's frame."""


@dataclass(slots=True)
class PoseWithCovariance:
    """A `geometry_msgs/PoseWithCovariance`."""

    _type: ClassVar[str] = "geometry_msgs/PoseWithCovariance"

    pose: Pose = field(default_factory=Pose)
    """The mean."""
    covariance: list[float] = field(default_factory=lambda: [0.0] * 36)
    """6 x 6 in row-major order, of x, y, z and of rotations about the fixed axes x, y, z."""


@dataclass(slots=True)
class PoseWithCovarianceStamped:
    """A `geometry_msgs/PoseWithCovarianceStamped`."""

    _type: ClassVar[str] = "geometry_msgs/PoseWithCovarianceStamped"

    header: Header = field(default_factory=Header)
    """Frame and stamp."""
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)
    """In the header's frame."""


@dataclass(slots=True)
class Polygon:
    """A `geometry_msgs/Polygon`."""

    _type: ClassVar[str] = "geometry_msgs/Polygon"

    points: list[Point32] = field(default_factory=list)
    """The corners; the last one is connected to the first."""


@dataclass(slots=True)
class PolygonStamped:
    """A `geometry_msgs/PolygonStamped`."""

    _type: ClassVar[str] = "geometry_msgs/PolygonStamped"

    header: Header = field(default_factory=Header)
    """Frame and stamp."""
    polygon: Polygon = field(default_factory=Polygon)
    """In the header's frame."""


@dataclass(slots=True)
class Twist:
    """A `geometry_msgs/Twist`."""

    _type: ClassVar[str] = "geometry_msgs/Twist"

    linear: Vector3 = field(default_factory=Vector3)
    """m/s."""
    angular: Vector3 = field(default_factory=Vector3)
    """rad/s."""


@dataclass(slots=True)
class TwistStamped:
    """A `geometry_msgs/TwistStamped`."""

    _type: ClassVar[str] = "geometry_msgs/TwistStamped"

    header: Header = field(default_factory=Header)
    """Frame and stamp."""
    twist: Twist = field(default_factory=Twist)
    """On the axes of the header's frame."""


@dataclass(slots=True)
class Wrench:
    """A `geometry_msgs/Wrench`."""

    _type: ClassVar[str] = "geometry_msgs/Wrench"

    force: Vector3 = field(default_factory=Vector3)
    """Newtons."""
    torque: Vector3 = field(default_factory=Vector3)
    """Newton metres."""


@dataclass(slots=True)
class WrenchStamped:
    """A `geometry_msgs/WrenchStamped`."""

    _type: ClassVar[str] = "geometry_msgs/WrenchStamped"

    header: Header = field(default_factory=Header)
    """Frame and stamp."""
    wrench: Wrench = field(default_factory=Wrench)
    """On the axes of the header's frame."""


@dataclass(slots=True)
class ChannelFloat32:
    """A `sensor_msgs/ChannelFloat32`."""

    _type: ClassVar[str] = "sensor_msgs/ChannelFloat32"

    name: str = ""
    """Meaning of the values."""
    values: list[float] = field(default_factory=list)
    """One for each point."""


@dataclass(slots=True)
class PointCloud:
    """A `sensor_msgs/PointCloud`."""

    _type: ClassVar[str] = "sensor_msgs/PointCloud"

    header: Header = field(default_factory=Header)
    """Frame and stamp."""
    points: list[Point32] = field(default_factory=list)
    """In the header's frame."""
    channels: list[ChannelFloat32] = field(default_factory=list)
    """More values for each point."""


@dataclass(slots=True)
class PointField:
    """A `sensor_msgs/PointField`: the place of a number in each point."""

    _type: ClassVar[str] = "sensor_msgs/PointField"
    INT8: ClassVar[int] = 1
    UINT8: ClassVar[int] = 2
    INT16: ClassVar[int] = 3
    UINT16: ClassVar[int] = 4
    INT32: ClassVar[int] = 5
    UINT32: ClassVar[int] = 6
    FLOAT32: ClassVar[int] = 7
    FLOAT64: ClassVar[int] = 8

    name: str = ""
    """Such as `x` or `intensity`."""
    offset: int = 0
    """Bytes from the start of a point."""
    datatype: int = 0
    """`INT8` to `FLOAT64`."""
    count: int = 0
    """Number of values."""


@dataclass(slots=True)
class PointCloud2:
    """A `sensor_msgs/PointCloud2`."""

    _type: ClassVar[str] = "sensor_msgs/PointCloud2"

    header: Header = field(default_factory=Header)
    """Frame and stamp."""
    height: int = 0
    """Number of rows; 1: the cloud is unordered."""
    width: int = 0
    """Points in a row."""
    fields: list[PointField] = field(default_factory=list)
    """Fields of each point."""
    is_bigendian: bool = False
    """Whether the numbers are big-endian."""
    point_step: int = 0
    """Bytes of a point."""
    row_step: int = 0
    """Bytes of a row."""
    data: bytes = b""
    """`height` rows of `row_step` bytes."""
    is_dense: bool = False
    """Whether all numbers are finite."""


@dataclass(slots=True)
class TFMessage:
    """A `tf2_msgs/TFMessage`."""

    _type: ClassVar[str] = "tf2_msgs/TFMessage"

    transforms: list[TransformStamped] = field(default_factory=list)
    """Any number of transforms, with any stamps."""


belong_to(__name__, globals(), __all__)

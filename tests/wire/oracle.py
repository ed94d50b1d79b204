"""Messages through PyPI rosbags, whose serialisers are the oracle."""

from __future__ import annotations

import functools
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

MESSAGE = "tf2_msgs/msg/TFMessage"
OLD_MESSAGE = "tf/msg/tfMessage"
ENCODINGS = ("ros1", "cdr", "cdr_le", "cdr_be", "cdr2_le", "cdr2_be", "cdr_bare_le", "cdr_bare_be")
# Those that rosbags knows; it always writes the encapsulation header.
THEIRS = ("ros1", "cdr", "cdr_le", "cdr_be", "cdr_bare_le", "cdr_bare_be")
LAST_NANOSECOND = 2**31 * 10**9 - 1  # of the stamps that CDR can hold


@dataclass(frozen=True)
class Row:
    """One transform T[parent<-child]; equal means equal to the last bit."""

    parent: str
    child: str
    stamp: int
    numbers: bytes  # 7 float64, native order

    @property
    def pose(self) -> tuple[float, ...]:
        """The numbers x y z qx qy qz qw."""
        return struct.unpack("=7d", self.numbers)


def row(parent: str, child: str, stamp: int, pose: Any) -> Row:
    """Make a row of seven numbers."""
    return Row(parent, child, stamp, struct.pack("=7d", *pose))


def rows_of(transforms: Any) -> list[Row]:
    """Rows of `tfdb.TransformStamped` objects."""
    return [row(t.parent, t.child, t.stamp, (*t.translation, *t.rotation)) for t in transforms]


@functools.cache
def typestore(*, ros1: bool) -> Any:
    """Type store of one ROS, with the types of transforms registered."""
    if not ros1:
        return get_typestore(Stores.ROS2_JAZZY)
    store = get_typestore(Stores.ROS1_NOETIC)
    for name in (MESSAGE, OLD_MESSAGE):
        definition = "geometry_msgs/TransformStamped[] transforms"
        store.register(get_types_from_msg(definition, name))
    return store


def _message(rows: list[Row], ros1: bool, name: str, seq: int) -> Any:
    types = typestore(ros1=ros1).types
    transforms = []
    for r in rows:
        sec, nanosec = divmod(r.stamp, 10**9)
        stamp = types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)
        extra = {"seq": seq} if ros1 else {}
        header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=r.parent, **extra)
        transform = types["geometry_msgs/msg/Transform"](
            translation=types["geometry_msgs/msg/Vector3"](*r.pose[:3]),
            rotation=types["geometry_msgs/msg/Quaternion"](*r.pose[3:]),
        )
        stamped = types["geometry_msgs/msg/TransformStamped"]
        transforms.append(stamped(header=header, child_frame_id=r.child, transform=transform))
    return types[name](transforms=transforms)


def encode(rows: list[Row], encoding: str, *, name: str = MESSAGE, seq: int = 0) -> bytes:
    """Bytes of one message as rosbags writes them."""
    ros1 = encoding == "ros1"
    message = _message(rows, ros1, name, seq)
    if ros1:
        return bytes(typestore(ros1=True).serialize_ros1(message, name))
    little = not encoding.endswith("_be")
    data = bytes(typestore(ros1=False).serialize_cdr(message, name, little_endian=little))
    return data[4:] if "bare" in encoding else data


def decode(data: bytes, encoding: str, *, name: str = MESSAGE) -> list[Row]:
    """Rows of one message as rosbags reads them; leading slashes stay."""
    ros1 = encoding == "ros1"
    if "bare" in encoding:
        data = bytes((0, 0 if encoding.endswith("_be") else 1, 0, 0)) + data
    store = typestore(ros1=ros1)
    message = store.deserialize_ros1(data, name) if ros1 else store.deserialize_cdr(data, name)
    result = []
    for t in message.transforms:
        p, q = t.transform.translation, t.transform.rotation
        stamp = t.header.stamp.sec * 10**9 + t.header.stamp.nanosec
        pose = (p.x, p.y, p.z, q.x, q.y, q.z, q.w)
        result.append(row(t.header.frame_id, t.child_frame_id, stamp, pose))
    return result


def without_slash(name: str) -> str:
    """What tf makes of a frame name."""
    return name.removeprefix("/")


# Anything that the bytes can carry: the store would refuse much of it.
any_names = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=24)
any_stamps = st.integers(0, LAST_NANOSECOND)
any_rows = st.builds(
    Row, any_names, any_names, any_stamps, st.binary(min_size=56, max_size=56)
) | st.builds(
    row,
    any_names,
    any_names,
    any_stamps,
    st.tuples(*[st.floats(allow_nan=False)] * 7),
)
any_messages = st.lists(any_rows, max_size=6)

_whole = st.integers(-9, 9)
unit_quaternions = (
    st.tuples(_whole, _whole, _whole, _whole)
    .filter(any)
    .map(lambda q: tuple((np.array(q) / np.linalg.norm(q)).tolist()))
)
good_poses = st.builds(
    lambda t, q: (*t, *q), st.tuples(*[st.floats(-100.0, 100.0)] * 3), unit_quaternions
)


@st.composite
def good_messages(draw: st.DrawFn, *, static: bool = False, frames: int = 6) -> list[list[Row]]:
    """Messages that a store takes: a parent's number is below its child's, so nothing cycles."""
    word = "fixed" if static else "moving"
    names = [f"{word}/{'x' * i}{i}" for i in range(frames)]
    messages = []
    for _ in range(draw(st.integers(1, 6))):
        message = []
        for _ in range(draw(st.integers(0, 4))):
            child = draw(st.integers(1, frames - 1))
            parent = draw(st.integers(0, child - 1))
            stamp = draw(st.integers(0, 40)) * 250_000_000 + 1_700_000_000_000_000_000
            message.append(row(names[parent], names[child], stamp, draw(good_poses)))
        messages.append(message)
    return messages

"""The topics of a recorded MCAP file, and the bytes of its own two."""

from __future__ import annotations

import struct
from typing import TypeAlias

from tfdb.data.errors import NotSupported
from tfdb.recordings.tf_definition import ROS2_TEXT

Messages: TypeAlias = "tuple[int, bytes | None, bytes | None, bytes | None]"
"""A commit or state: its number, and its messages from `messages_of_commits`."""

TF = "/tf"
TF_STATIC = "/tf_static"
COMMITS = "/tfdb/commits"
SEQUENCES = 1 << 32
"""A message's sequence number is the number of its commit modulo this."""

TRANSFORMS = ("tf2_msgs/msg/TFMessage", ROS2_TEXT)
_RULE = "=" * 80
# A standard ROS 2 type, so that tools that copy or play all topics include these.
BYTES = (
    "std_msgs/msg/UInt8MultiArray",
    f"""\
std_msgs/MultiArrayLayout layout
uint8[] data
{_RULE}
MSG: std_msgs/MultiArrayLayout
std_msgs/MultiArrayDimension[] dim
uint32 data_offset
{_RULE}
MSG: std_msgs/MultiArrayDimension
string label
uint32 size
uint32 stride
""",
)
# CDR, little-endian: no dimensions, offset 0, the number of bytes.
_HEAD = struct.Struct("<4sIII")
_CDR = b"\0\1\0\0"


def wrapped(data: bytes) -> bytes:
    """Return the UInt8MultiArray of some bytes."""
    return _HEAD.pack(_CDR, 0, 0, len(data)) + data


def unwrapped(message: bytes) -> bytes:
    """Return the bytes of a UInt8MultiArray that `wrapped` made. Raises ValueError for others."""
    if len(message) < _HEAD.size or message[: _HEAD.size] != _HEAD.pack(
        _CDR, 0, 0, len(message) - _HEAD.size
    ):
        raise ValueError("a message that tfdb did not record")
    return message[_HEAD.size :]


def missing(name: str, error: ImportError) -> NotSupported:
    """Make the error of a missing library."""
    return NotSupported(
        f"tfdb.{name} needs mcap: pip install 'tfdb[recordings]' ({error})", reason="mcap"
    )

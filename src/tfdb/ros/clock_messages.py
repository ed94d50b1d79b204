"""Bytes of a rosgraph_msgs/Clock, for ROS 1 and ROS 2."""

from __future__ import annotations

import struct

from tfdb.data.decimal_time import NS_PER_SECOND
from tfdb.data.errors import CorruptMessage

CLOCK, CLOCK_KIND = "/clock", "rosgraph_msgs/Clock"
_HEADER = b"\0\1\0\0"  # of CDR
_ROS1, _ROS2 = struct.Struct("<II"), struct.Struct("<iI")


def encode_clock(stamp: int, *, cdr: bool) -> bytes:
    """Return the bytes; `cdr`: for ROS 2, with the header.

    Stamps are between 0 and 2**31 seconds.
    """
    form = _ROS2 if cdr else _ROS1
    return (_HEADER if cdr else b"") + form.pack(*divmod(stamp, NS_PER_SECOND))


def decode_clock(data: bytes | memoryview, *, cdr: bool) -> int:
    """Return nanoseconds. Raises CorruptMessage for a wrong length; CDR may end with padding."""
    form, header = (_ROS2, len(_HEADER)) if cdr else (_ROS1, 0)
    size = header + form.size
    if len(data) < size or (len(data) > size and not cdr):
        text = f"a {CLOCK_KIND} of {len(data)} bytes; it has {size}"
        raise CorruptMessage(text, offset=0, reason="length")
    seconds, nanoseconds = form.unpack_from(data, header)
    found: int = seconds * NS_PER_SECOND + nanoseconds
    return found

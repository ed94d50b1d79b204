"""Messages of ROS 1 as bytes."""

from __future__ import annotations

import struct

import tfdb
from tfdb.tf2 import msgs


def transforms(*edges: tuple[str, str, int, float]) -> bytes:
    """A TFMessage of (parent, child, stamp, x) each, none of them an identity."""
    return tfdb.encode_tf_message(
        [
            msgs.TransformStamped(
                msgs.Header(msgs.Time.from_nanoseconds(stamp), parent),
                child,
                msgs.Transform(msgs.Vector3(x, 2.0, -3.0), msgs.Quaternion(0.6, 0.0, 0.0, 0.8)),
            )
            for parent, child, stamp, x in edges
        ],
        encoding="ros1",
    )


def clock(nanoseconds: int) -> bytes:
    """A rosgraph_msgs/Clock."""
    return struct.pack("<II", *divmod(nanoseconds, 1_000_000_000))

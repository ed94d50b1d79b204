"""tfdb.tf2 with its own messages, called as tf2_ros is."""

from __future__ import annotations

from typing import Any

from tf2_calls import Tf2Calls

import tfdb
from tfdb import tf2
from tfdb.tf2 import msgs


def encode(transforms: list[Any]) -> bytes:
    """Make the bytes of a message on /tf."""
    return tfdb.encode_tf_message(transforms, "ros1")


def receive(buffer: tf2.Buffer, data: bytes) -> None:
    """Store such bytes, as the listener does."""
    buffer.buffer.ingest(data, encoding="ros1", only_new=True, authority="bench")


class Contender(Tf2Calls):
    """What tfdb.tf2 does."""

    def __init__(self) -> None:
        super().__init__(
            lambda: tf2.Buffer(msgs.Duration(10), flavor="ros1"),
            msgs.Time.from_nanoseconds,
            msgs.TransformStamped,
            encode,
            receive,
        )

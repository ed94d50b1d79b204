"""Messages for nodes without ROS, and their receiver."""

from __future__ import annotations

import queue
import time
from typing import Any

import tfdb
from tfdb.tf2 import msgs

TF = "tf2_msgs/TFMessage"
LIMIT = 20.0
S = 1_000_000_000


def message(x: float, parent: str = "map", child: str = "base", stamp: int = 5 * S) -> bytes:
    moved = msgs.Transform(msgs.Vector3(x, 2.0, -3.0), msgs.Quaternion(0.6, 0.0, 0.0, 0.8))
    header = msgs.Header(msgs.Time.from_nanoseconds(stamp), parent)
    return tfdb.encode_tf_message([msgs.TransformStamped(header, child, moved)], "cdr")


class Heard:
    """Received messages, with their publishers."""

    def __init__(self) -> None:
        self.messages: queue.Queue[tuple[bytes, str]] = queue.Queue()

    def __call__(self, data: bytes | memoryview, publisher: str) -> None:
        self.messages.put((bytes(data), publisher))

    def next(self) -> tuple[bytes, str]:
        return self.messages.get(timeout=LIMIT)


def published_until_heard(publisher: Any, heard: Heard, data: bytes) -> tuple[bytes, str]:
    """Publish until a message arrives: a subscription needs some time to reach the publisher."""
    until = time.monotonic() + LIMIT
    while heard.messages.empty():
        assert time.monotonic() < until
        publisher.publish(data)
        try:
            return heard.messages.get(timeout=0.05)
        except queue.Empty:
            continue
    return heard.next()

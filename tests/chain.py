"""A small chain of frames for the tests of transactions."""

from __future__ import annotations

import tfdb
from oracle import quaternion
from tests.stored import stored

TURN = quaternion((1, -2, 0.5), 0.9)
BACK = quaternion((0, 1, 3), -1.4)


def chain() -> tfdb.Buffer:
    """T[map<-base] at stamps 10, 20, 30, and a static camera."""
    buffer = tfdb.Buffer(history=None)
    for stamp in (10, 20, 30):
        buffer.set_transform("map", "base", stamp, (stamp, 1, 2), TURN)
    buffer.set_static_transform("base", "camera", (0, 0.5, 1), BACK)
    return buffer


def contents(buffer: tfdb.Buffer) -> object:
    return buffer.commit, stored(buffer)

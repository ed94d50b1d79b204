"""tfdb.tf2 with its own messages, called as tf2_ros is."""

from __future__ import annotations

from tf2_calls import Tf2Calls

from tfdb import tf2
from tfdb.tf2 import msgs


class Contender(Tf2Calls):
    """What tfdb.tf2 does."""

    def __init__(self) -> None:
        super().__init__(
            lambda: tf2.Buffer(msgs.Duration(10), flavor="ros1"),
            msgs.Time.from_nanoseconds,
            msgs.TransformStamped,
        )

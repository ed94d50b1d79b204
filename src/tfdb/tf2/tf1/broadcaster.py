"""`TransformBroadcaster` of tf: publishes transforms on /tf."""

# ruff: noqa: N802  (tf's names)

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tfdb.ros.ros_messages import makers
from tfdb.ros.times import nanoseconds

from ..transform_broadcaster import TransformBroadcaster as Broadcaster

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["TransformBroadcaster"]


class TransformBroadcaster:
    """Publishes transforms on /tf.

    Parameters
    ----------
    queue_size
        Accepted as in tf, without effect.
    node
        As in `tfdb.tf2.TransformBroadcaster`.
    """

    def __init__(self, queue_size: int = 100, *, node: Any = None) -> None:  # noqa: ARG002 - tf's
        self.tf2_broadcaster: Broadcaster = Broadcaster(node)
        """The broadcaster of tf2."""

    def sendTransform(
        self,
        translation: Sequence[float],
        rotation: Sequence[float],
        time: Any,
        child: str,
        parent: str,
    ) -> None:
        """Send T[parent<-child] of a translation (metres) and a quaternion x, y, z, w at a time."""
        make, _ = makers(self.tf2_broadcaster.node.flavor)
        pose = [float(value) for value in (*translation, *rotation)]
        self.sendTransformMessage(make(parent, child, nanoseconds(time), pose))

    def sendTransformMessage(self, transform: Any) -> None:
        """Send a TransformStamped."""
        self.tf2_broadcaster.sendTransform([transform])

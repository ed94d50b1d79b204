"""`TransformListener`: what is published on /tf and /tf_static goes into a buffer."""

from __future__ import annotations

import logging
import threading
from collections import Counter
from typing import TYPE_CHECKING, Any

from tfdb.errors import CorruptMessage
from tfdb.ros import node_for

from .buffer import Buffer
from .buffer_core import BufferCore
from .incoming import Incoming, decoded
from .times import SECOND
from .transform_broadcaster import KIND

if TYPE_CHECKING:
    from tfdb.ros import Node

__all__ = ["StaticTransformListener", "TransformListener"]

LOGGER = logging.getLogger("tfdb.tf2")
UNKNOWN = "default_authority"


class TransformListener:
    """Fills a buffer with what is published on /tf and /tf_static.

    Messages go as bytes into the native decoder, and each is one commit: what is published together
    is seen together. The publisher's name is the authority. What is damaged is left out, logged
    once for each publisher, and counted. When simulated time jumps back the buffer is cleared.

    It listens until `unregister`, also when nothing refers to it any more. Messages come in a
    thread of the node's; where a subclass of BufferCore has a `set_transform` of its own, that is
    called for each transform instead.

    Parameters
    ----------
    buffer
        A `Buffer`, a `BufferCore`, or anything with `set_transform` and `set_transform_static`.
    node
        A node of rclpy or `tfdb.ros`; None: that of the process, in rospy or without any ROS. An
        integer is ROS 1's `queue_size`.
    queue_size
        How many messages of a topic may wait; None: 100.
    spin_thread
        In a node of rclpy: take messages in a thread of its own, which is cheapest and lets
        callbacks of the node wait for transforms; False: in the node's executor.
    qos, static_qos
        In a node of rclpy: QoS profiles instead of tf2's.
    tf_topic, tf_static_topic
        Names of the topics.
    static_only
        Listen to the static ones alone.
    buff_size, tcp_nodelay
        Taken as ROS 1 takes them, and without effect.
    """

    def __init__(
        self,
        buffer: Any,
        node: Any = None,
        buff_size: int = 65536,  # noqa: ARG002 - ROS 1's
        tcp_nodelay: bool = False,  # noqa: ARG002 - ROS 1's
        *,
        queue_size: int | None = None,
        spin_thread: bool = False,
        qos: Any = None,
        static_qos: Any = None,
        tf_topic: str = "/tf",
        tf_static_topic: str = "/tf_static",
        static_only: bool = False,
    ) -> None:
        if isinstance(node, int):
            node, queue_size = None, node
        self.buffer = buffer
        self.node: Node = node_for(node, own_thread=spin_thread)
        """The node that it listens in."""
        self.corrupt: Counter[str] = Counter()
        """How many damaged messages each publisher sent."""
        self._now = self.node.now()
        self._lock = threading.Lock()
        core = buffer if isinstance(buffer, BufferCore) else None
        if core is not None and core._flavor is None:
            core._settle(self.node.flavor)
        if isinstance(buffer, Buffer) and buffer.clock is None:
            buffer.clock = self.node
        self._raw = core if core is not None and _is_plain(core) else None
        topics = [(tf_static_topic, True, static_qos)]
        if not static_only:
            topics.append((tf_topic, False, qos))
        self._open = [
            self.node.subscribe(
                topic,
                KIND,
                self._taker(static=static),
                latched=static,
                depth=queue_size or 100,
                qos=profile,
            )
            for topic, static, profile in topics
        ]
        self._open.append(self.node.on_clock(self._look_at_clock))

    def _taker(self, *, static: bool) -> Any:
        """Make what takes the messages of a topic."""
        buffer, encoding, corrupt = self.buffer, self.node.encoding, self.corrupt
        incoming = None
        if self._raw is not None:
            incoming = Incoming(self._raw, self.node, static=static)

        def take(data: bytes | memoryview, publisher: str) -> None:
            authority = publisher or UNKNOWN
            try:
                if incoming is not None:
                    incoming.store(data, authority)
                else:
                    store = buffer.set_transform_static if static else buffer.set_transform
                    for message in decoded(data, encoding):
                        store(message, authority)
            except CorruptMessage as error:
                corrupt[authority] += 1
                if corrupt[authority] == 1:
                    text = "left out a damaged message of %s: %s"
                    LOGGER.warning(text, authority, error, extra={"error": error})

        return take

    def _look_at_clock(self, now: int) -> None:
        """Clear the buffer when simulated time has gone back."""
        with self._lock:
            back, self._now = self._now - now, now
        if back > 0 and self.node.simulated:
            LOGGER.warning("Detected jump back in time of %fs. Clearing TF buffer.", back / SECOND)
            self.buffer.clear()

    def unregister(self) -> None:
        """Listen no more."""
        while self._open:
            self._open.pop().close()


class StaticTransformListener(TransformListener):
    """Fills a buffer with what is published on /tf_static alone."""

    def __init__(self, buffer: Any, node: Any = None, **options: Any) -> None:
        super().__init__(buffer, node, static_only=True, **options)


def _is_plain(core: BufferCore) -> bool:
    """Whether bytes may go straight into the store: no subclass looks at each transform."""
    kind = type(core)
    return all(
        getattr(kind, name) is getattr(BufferCore, name)
        for name in ("set_transform", "set_transform_static")
    )

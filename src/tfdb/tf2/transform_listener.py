"""`TransformListener`: stores the messages on /tf and /tf_static in a buffer."""

from __future__ import annotations

import logging
import threading
from collections import Counter
from typing import TYPE_CHECKING, Any, Self

from tfdb.data.argument_checks import refuse_without
from tfdb.data.errors import CorruptMessage
from tfdb.ros import node_for
from tfdb.ros.ros_messages import new_group
from tfdb.ros.times import SECOND

from .buffer import Buffer
from .buffer_core import BufferCore
from .handles import handle_of, native_node
from .message_checks import refuse_unlike
from .received_messages import SETTERS, UNKNOWN, received, sink_of
from .transform_broadcaster import KIND

if TYPE_CHECKING:
    from tfdb.ros import Node

    from .received_messages import Sink

__all__ = ["StaticTransformListener", "TransformListener"]

LOGGER = logging.getLogger("tfdb.tf2")


class TransformListener:
    """Fills a buffer with the messages on /tf and /tf_static.

    Messages are decoded natively, and each is one commit, so readers see all its transforms at
    once. The publisher's name is the authority. A refused transform is logged and counted; the
    other transforms of its message are stored. A damaged message is skipped, counted, and logged
    once for each publisher. If simulated time jumps back, the buffer is cleared.

    It listens until `unregister`, even if no reference to it remains. Messages arrive in a thread
    of the node. If a subclass overrides `callback` or `static_callback`, each message of the topic
    is passed to it. If a subclass of BufferCore overrides `set_transform`, each transform is passed
    to it.

    Parameters
    ----------
    buffer
        A `Buffer`, a `BufferCore`, or an object with `set_transform` and `set_transform_static`.
    node
        A node of rclpy or `tfdb.ros`. None: rospy's node; after `rclpy.init` a new rclpy node;
        otherwise a node without ROS. An integer is ROS 1's `queue_size`.
    queue_size
        Largest number of queued messages of a topic; None: 100.
    spin_thread
        In an rclpy node. True: receive messages in a separate thread, so that callbacks of the node
        may wait for transforms; this needs the least CPU. Another thread spins the node, unless the
        node has an executor. False: receive messages in the node's executor.
    qos, static_qos
        In an rclpy node: QoS profiles in place of tf2's.
    tf_topic, tf_static_topic
        Names of the topics.
    static_only
        Listen to /tf_static only.
    buff_size, tcp_nodelay
        Accepted as in ROS 1, without effect.
    """

    node: Any
    """The listening node, of rclpy or `tfdb.ros`."""
    tf_sub: Any
    """Subscription to /tf, of rclpy or rospy; destroying it ends listening to /tf."""
    tf_static_sub: Any
    """Subscription to /tf_static, of rclpy or rospy."""
    group: Any
    """In an rclpy node: a reentrant callback group."""
    executor: Any
    """With `spin_thread`: the executor of rclpy; its `shutdown` ends listening."""
    dedicated_listener_thread: threading.Thread
    """With `spin_thread`: the thread in which the executor spins."""

    corrupt: Counter[str]
    """Number of damaged messages by publisher."""
    refused: Counter[str]
    """Number of refused transforms by publisher."""
    _lock: threading.Lock
    _open: list[Any]
    _spinning: Any
    # A subclass may omit `super().__init__()`.
    _node: Node | None = None
    _clock: Node | None = None
    _now = 0
    _sinks: tuple[Sink, Sink] | None = None

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
        refuse_without(
            buffer, "buffer", f"a tfdb.tf2.Buffer, or have {' and '.join(SETTERS)}", *SETTERS
        )
        self._node = self._clock = listening = node_for(node, own_thread=spin_thread)
        self.node = native_node(listening)
        self._now = listening.now()
        self.buffer = buffer
        topics = [("tf_static_sub", tf_static_topic, static_qos)]
        if not static_only:
            topics.append(("tf_sub", tf_topic, qos))
        for name, topic, profile in topics:
            static = name == "tf_static_sub"
            opened = listening.subscribe(
                topic,
                KIND,
                self._taker(listening, topic, static=static),
                latched=static,
                depth=queue_size or 100,
                qos=profile,
            )
            self._open.append(opened)
            setattr(self, name, handle_of(opened, listening.encoding))
        self._open.append(listening.on_clock(lambda _: self.check_for_reset()))
        if listening.flavor == "ros2" and hasattr(listening, "spin"):
            self._be_of_rclpy(listening, spin_thread=spin_thread)

    def __new__(cls, *_: Any, **__: Any) -> Self:
        """Set the attributes, even if a subclass omits `__init__`."""
        made = super().__new__(cls)
        made.corrupt = Counter()
        made.refused = Counter()
        made._lock = threading.Lock()
        made._open = []
        made._spinning = None
        return made

    @property
    def buffer(self) -> Any:
        """The buffer to fill. A new one gets later messages."""
        return self._buffer

    @buffer.setter
    def buffer(self, buffer: Any) -> None:
        self._buffer = buffer
        node = self._node
        if node is None:  # a subclass subscribes itself
            return
        if isinstance(buffer, BufferCore) and buffer._flavor is None:
            buffer._set_flavor(node.flavor)
        if isinstance(buffer, Buffer) and (buffer.clock is None or buffer.clock.closed):
            buffer.clock = node
        self._sinks = (sink_of(buffer, node, static=False), sink_of(buffer, node, static=True))

    def callback(self, data: Any) -> None:
        """Store a TFMessage of moving transforms, one transform at a time.

        The listener calls it only if a subclass overrides it. Programs may use it as a callback.
        """
        self._store_message(data, self.buffer.set_transform)

    def static_callback(self, data: Any) -> None:
        """Store a TFMessage of static transforms, as `callback`."""
        self._store_message(data, self.buffer.set_transform_static)

    def check_for_reset(self) -> None:
        """Clear the buffer if simulated time has gone back. The node's clock calls it."""
        clock = self._clock
        if clock is None:
            clock = self._clock = node_for(self.__dict__.get("node"))
            self._now = clock.now()
        with self._lock:
            now = clock.now()
            back, self._now = self._now - now, now
        if back > 0 and clock.simulated:
            LOGGER.warning("Detected jump back in time of %fs. Clearing TF buffer.", back / SECOND)
            self.buffer.clear()

    def unregister(self) -> None:
        """Stop listening."""
        self._stop()
        if self._spinning is not None and not self._spinning.has_node:
            self._spinning.close()
        if self._node is None:  # a subclass has subscribed itself
            for subscription in (self.tf_sub, self.tf_static_sub):
                if hasattr(subscription, "unregister"):
                    subscription.unregister()
                else:
                    self.node.destroy_subscription(subscription)

    def _be_of_rclpy(self, node: Any, *, spin_thread: bool) -> None:
        """Set the attributes of tf2's listener in a node of rclpy."""
        self.group = new_group()
        if spin_thread:
            self._spinning = node.spin(self._stop)
            self.executor = self._spinning.executor
            self.dedicated_listener_thread = self._spinning.thread

    def _taker(self, node: Node, topic: str, *, static: bool) -> Any:
        """Return the function that receives the messages of a topic."""
        called = self.static_callback if static else self.callback
        function = getattr(called, "__func__", None)
        overridden = getattr(function, "__wrapped__", function) not in PLAIN

        def take(data: bytes | memoryview, publisher: str) -> None:
            authority = publisher or UNKNOWN
            try:
                if overridden:
                    called(received(data, node, topic, publisher))
                elif self._sinks is not None:
                    refused = self._sinks[static](data, authority)
                    if refused:
                        self.refused[authority] += refused
            except CorruptMessage as error:
                self.corrupt[authority] += 1
                if self.corrupt[authority] == 1:
                    text = "skipped a damaged message of %s: %s"
                    LOGGER.warning(text, authority, error, extra={"error": error})

        return take

    def _store_message(self, data: Any, store: Any) -> None:
        refuse_unlike(data, "data", "a TFMessage", "transforms")
        connection = getattr(data, "_connection_header", None)
        if connection is not None:  # ROS 1's
            self.check_for_reset()
        authority = (connection or {}).get("callerid") or UNKNOWN
        for transform in data.transforms:
            store(transform, authority)

    def _stop(self) -> None:
        with self._lock:
            opened, self._open = self._open, []
        for each in opened:
            each.close()


PLAIN = (TransformListener.callback, TransformListener.static_callback)
"""Callbacks that are not called, because the store decodes the bytes."""


class StaticTransformListener(TransformListener):
    """Fills a buffer with the messages on /tf_static only."""

    def __init__(self, buffer: Any, node: Any = None, **options: Any) -> None:
        super().__init__(buffer, node, static_only=True, **options)

"""Nodes of rclpy for a test, spun until a condition holds."""

from __future__ import annotations

import math
import threading
import time
from typing import TYPE_CHECKING, Any

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import serialize_message
from tf2_msgs.msg import TFMessage

import tfdb
from tfdb.ros.rclpy_node import RclpyNode

if TYPE_CHECKING:
    from collections.abc import Callable

LIMIT = 20.0
TF = "tf2_msgs/TFMessage"


class Graph:
    """A context with nodes; the requested ones are spun in one thread."""

    def __init__(self, context: Any) -> None:
        self.context = context
        rclpy.init(context=context, args=[])
        self.nodes: list[RclpyNode] = []
        self.executor = SingleThreadedExecutor(context=context)
        self._theirs: list[Any] = []
        self.at_end: list[Callable[[], object]] = []
        self._spinner: threading.Thread | None = None
        self._over = False

    def node(self, name: str, *, spin: bool = False, **more: Any) -> Any:
        """A node of rclpy."""
        node = rclpy.create_node(name, context=self.context, **more)
        self._theirs.append(node)
        if spin:
            self.executor.add_node(node)
            if self._spinner is None:
                self._spinner = threading.Thread(target=self._spin, name="spinner")
                self._spinner.start()
        return node

    def ours(self, node: Any, *, own_thread: bool) -> RclpyNode:
        """Return a RclpyNode on an rclpy node."""
        made = RclpyNode(node, own_thread=own_thread)
        self.nodes.append(made)
        return made

    def end(self) -> None:
        """Close the RclpyNodes, then the rclpy nodes, then the context."""
        for each in self.nodes:
            each.close()
        if self._spinner is not None:
            self._over = True
            self.executor.create_task(lambda: None)
            self._spinner.join(LIMIT)
            assert not self._spinner.is_alive()
        self.executor.shutdown()
        for call in self.at_end:
            call()
        for each in self._theirs:
            each.destroy_node()
        if self.context.ok():
            self.context.shutdown()
        self.context.destroy()

    def _spin(self) -> None:
        while not self._over:
            self.executor.spin_once()


class Heard:
    """Received messages, each with its receiving thread."""

    def __init__(self) -> None:
        self.messages: list[bytes] = []
        self.publishers: list[str] = []
        self.threads: list[str] = []
        self._came = threading.Condition()

    def __call__(self, data: bytes | memoryview, publisher: str) -> None:
        with self._came:
            self.messages.append(bytes(data))
            self.publishers.append(publisher)
            self.threads.append(threading.current_thread().name)
            self._came.notify_all()

    def until(self, holds: Callable[[Heard], bool]) -> None:
        """Wait until a condition holds for the received messages."""
        with self._came:
            assert self._came.wait_for(lambda: holds(self), LIMIT), (
                f"heard {len(self.messages)} messages, from {set(self.publishers)}"
            )


def until(holds: Callable[[], bool], *, meanwhile: Callable[[], object] | None = None) -> None:
    """Poll a condition until it holds."""
    ends = time.monotonic() + LIMIT
    pause = threading.Event()
    while not holds():
        assert time.monotonic() < ends, "it does not come true"
        if meanwhile is not None:
            meanwhile()
        pause.wait(0.005)


def connected(publisher: Any, subscribers: int = 1) -> None:
    """Wait until a publisher of rclpy has found so many subscribers."""
    until(lambda: publisher.get_subscription_count() >= subscribers)


def message(number: int, frames: int = 1, parent: str = "base") -> TFMessage:
    """Return transforms whose x is their number; none is the identity."""
    result = TFMessage()
    for index in range(frames):
        each = TransformStamped()
        each.header.stamp.sec, each.header.stamp.nanosec = 100 + number, index
        each.header.frame_id, each.child_frame_id = parent, f"frame{index}"
        each.transform.translation.x = float(number)
        each.transform.rotation.z = math.sin(0.2)
        each.transform.rotation.w = math.cos(0.2)
        result.transforms.append(each)
    return result


def as_bytes(number: int, frames: int = 1, parent: str = "base") -> bytes:
    """Return the same message, serialized by rclpy."""
    data: bytes = serialize_message(message(number, frames, parent))
    return data


def numbers(data: list[bytes]) -> list[int]:
    """Return the numbers of these messages."""
    return [int(tfdb.decode_tf_message(each)[0].translation[0]) for each in data]

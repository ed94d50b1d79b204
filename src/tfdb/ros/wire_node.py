"""A ROS 2 node without ROS packages: names, clock and callbacks. A link carries the bytes."""

from __future__ import annotations

import os
import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from tfdb.data.errors import InvalidArgument, NodeClosed, NotSupported

from .clock_messages import CLOCK, CLOCK_KIND, decode_clock
from .clocked_node import ClockedNode, open_nodes
from .loop import warn_of_message
from .ros2_names import kind_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from .node import Encoding, Flavor, Publisher, Service, Subscription
    from .refusals import Refusals
    from .ros2_names import Kind, Ros2Names

__all__ = ["Link", "Topic", "WireNode"]


@dataclass(frozen=True)
class Topic:
    """The topic of an endpoint."""

    name: str
    kind: Kind
    latched: bool
    depth: int


class Opened(Protocol):
    """An open endpoint."""

    def close(self) -> None:
        """Close the endpoint."""


class Sender(Opened, Protocol):
    """An endpoint that sends. Threads: one at a time."""

    def send(self, data: bytes) -> None:
        """Send a message."""


class Link(Protocol):
    """A connection to a graph. Threads: any."""

    refusals: Refusals
    graph: str
    """Name of the graph."""
    gids: set[bytes]
    """Gids of its publishers, including closed ones."""

    def hear(self, topic: Topic, take: Callable[[bytes, str], None]) -> Opened:
        """Call `take(data, sender)` for each message of a topic, in their order."""

    def offer(self, topic: Topic) -> Sender:
        """Offer a topic."""

    def close(self) -> None:
        """Close it, with its endpoints."""


class WireNode(ClockedNode):
    """A ROS 2 node over a `Link`. It closes the link, even if its constructor raises.

    Threads: any may call anything. Each subscription has a thread for its callback, so a callback
    that waits delays only its own subscription.
    """

    flavor: Flavor = "ros2"
    encoding: Encoding = "cdr"

    def __init__(self, names: Ros2Names, link: Link) -> None:
        super().__init__(names.node, simulated=names.use_sim_time)
        self.graph: str = link.graph
        """Name of its graph, such as `ros2+zenoh:7`."""
        self._names, self._link = names, link
        self._opened: set[_Entity] = set()
        self._ended = False
        open_nodes.add(self)
        if self._simulated:
            try:
                self.subscribe(CLOCK, CLOCK_KIND, self._take_clock, depth=1)
            except BaseException:
                self.close()
                raise

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {self.name}{', closed' if self._ended else ''}>"

    def subscribe(
        self,
        topic: str,
        kind: str,
        on_message: Callable[[bytes | memoryview, str], None],
        *,
        latched: bool = False,
        depth: int = 100,
        qos: Any = None,
    ) -> Subscription:
        """Call `on_message(data, publisher)` for each message of a topic, in their order.

        `publisher` is the name of the publisher's node. If no token names it, it is the publisher's
        gid in hexadecimal digits. Beyond `depth` waiting messages the oldest are dropped. Raises
        InvalidName, InvalidArgument, NodeClosed.
        """
        _refuse_profile(qos)
        wanted = Topic(self._names.resolve(topic), kind_of(kind), latched, depth)
        failed: set[str] = set()

        def take(data: bytes, sender: str) -> None:
            try:
                on_message(data, sender)
            except Exception as error:
                if sender not in failed and len(failed) < 1000:
                    failed.add(sender)
                    warn_of_message(wanted.name, sender, error)

        with self._lock:
            self._check_open()
            return self._keep(_Entity(self, self._link.hear(wanted, take)))

    def advertise(
        self,
        topic: str,
        kind: str,
        *,
        latched: bool = False,
        depth: int = 100,
        qos: Any = None,
    ) -> Publisher:
        """Offer a topic. If it is latched, nodes that join later get the last `depth` messages.

        Raises InvalidName, InvalidArgument, NodeClosed.
        """
        _refuse_profile(qos)
        wanted = Topic(self._names.resolve(topic), kind_of(kind), latched, depth)
        with self._lock:
            self._check_open()
            publisher = _Publisher(self, self._link.offer(wanted), wanted.name)
            self._keep(publisher)
            return publisher

    def serve(self, name: str, kind: str, answer: Callable[[bytes], bytes]) -> Service:  # noqa: ARG002
        """Raise NotSupported: services need rclpy."""
        raise NotSupported(f"the service {name} needs a node of rclpy; {self.name} has topics only")

    @property
    def refused(self) -> int:
        """Count of refused messages, with an unexpected type, type hash or attachment."""
        return self._link.refusals.count

    @property
    def senders(self) -> frozenset[str]:
        """Publisher names of this node's messages at other nodes: its name and its gids."""
        return frozenset({self.name, *(gid.hex() for gid in self._link.gids)})

    @property
    def closed(self) -> bool:
        """Whether the node was closed."""
        return self._ended

    def close(self) -> None:
        """Close the node and all its entities. A second call does nothing."""
        with self._lock:
            if self._ended:
                return
            self._ended = True
            opened, self._opened = self._opened, set()
        open_nodes.discard(self)
        self._report_clock()  # callbacks of topics may wait for the node's end
        if os.getpid() != self._process:
            return  # a child of `fork` has no threads of the link
        for each in opened:
            each.close()
        self._link.close()

    def _take_clock(self, data: bytes | memoryview, _: str) -> None:
        self._set_clock(decode_clock(data, cdr=True))

    def _check_open(self) -> None:
        if self._ended:
            raise NodeClosed(f"the node {self.name} is closed", reason="it was closed")

    def _keep(self, entity: _Entity) -> _Entity:
        self._opened.add(entity)
        return entity

    def _forget(self, entity: _Entity) -> None:
        with self._lock:
            self._opened.discard(entity)


class _Entity:
    """A subscription or publisher of a node. Threads: any."""

    native: Any = None

    def __init__(self, node: WireNode, opened: Opened) -> None:
        self._node = node
        self._end: Opened | None = opened

    def close(self) -> None:
        """Close the entity. A second call does nothing."""
        opened, self._end = self._end, None
        self._node._forget(self)
        if opened is not None:
            opened.close()


class _Publisher(_Entity):
    """A sender of a topic. Threads: any."""

    def __init__(self, node: WireNode, sender: Sender, topic: str) -> None:
        super().__init__(node, sender)
        self._sender, self._topic = sender, topic
        self._lock = threading.RLock()  # a signal handler may close the node during `publish`

    def publish(self, data: bytes) -> None:
        """Send one serialized message. Raises NodeClosed."""
        with self._lock:
            if self._end is None:
                text = f"this publisher of {self._topic} is closed"
                raise NodeClosed(text, value=self._topic)
            self._sender.send(bytes(data))

    def close(self) -> None:
        """Close the publisher, after a message that another thread is sending."""
        with self._lock:
            super().close()


def _refuse_profile(qos: Any) -> None:
    if qos is not None:
        raise InvalidArgument(
            "QoS profiles need rclpy: pass latched and depth instead", value=str(qos)
        )

"""The interface of ROS 1 and ROS 2 nodes for listeners, broadcasters and servers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Encoding", "Flavor", "Node", "Publisher", "Service", "Subscription"]

Flavor: TypeAlias = Literal["ros1", "ros2"]
"""ROS 1 or ROS 2, for its rules, texts and messages."""
Encoding: TypeAlias = Literal["ros1", "cdr"]
"""Encoding of messages, as in `Buffer.ingest`."""


class Subscription(Protocol):
    """A subscribed topic."""

    native: Any
    """The object of the node's ROS library, such as rospy's Subscriber; None without a library."""

    def close(self) -> None:
        """Stop listening. A callback that is running in another thread may still end.

        A second call does nothing.
        """


class Publisher(Protocol):
    """A published topic."""

    native: Any
    """The object of the node's ROS library, such as rospy's Publisher; None without a library."""

    def publish(self, data: bytes) -> None:
        """Send one serialized message, in the node's encoding."""

    def close(self) -> None:
        """Unregister the topic."""


class Service(Protocol):
    """An offered service."""

    native: Any
    """The object of the node's ROS library, such as rospy's Service; None without a library."""

    def close(self) -> None:
        """Unregister the service."""


class Node(Protocol):
    """A node of ROS 1 or ROS 2: bytes in, bytes out, and a clock. Any thread may call it."""

    flavor: Flavor
    """ROS 1 or ROS 2."""
    encoding: Encoding
    """Encoding of its messages."""
    name: str
    """Its full name in the graph."""

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

        Parameters
        ----------
        topic
            Its name, resolved by the rules of the node.
        kind
            Type, such as `tf2_msgs/TFMessage`.
        on_message
            Called with the serialized message, which is valid until the return, and the name of the
            publishing node ("" if unknown). Its exceptions are logged.
        latched
            Whether nodes that join later get earlier messages (ROS 2: transient local).
        depth
            Largest number of waiting messages.
        qos
            In an rclpy node: a QoS profile, in place of `latched` and `depth`. Otherwise None.
        """

    def advertise(
        self,
        topic: str,
        kind: str,
        *,
        latched: bool = False,
        depth: int = 100,
        qos: Any = None,
    ) -> Publisher:
        """Offer a topic; arguments as in `subscribe`."""

    def serve(self, name: str, kind: str, answer: Callable[[bytes], bytes]) -> Service:
        """Offer a service: `answer` makes the serialized response of a serialized request."""

    def now(self) -> int:
        """Nanoseconds by the node's clock: the system's, or /clock with `use_sim_time`."""

    @property
    def simulated(self) -> bool:
        """Whether `now` is simulated time."""

    @property
    def closed(self) -> bool:
        """Whether the node has ended: closed, or shut down with rospy or rclpy."""

    def on_clock(self, called: Callable[[int], None]) -> Subscription:
        """Call `called(now)` whenever simulated time is set, and once when the node ends."""

    def close(self) -> None:
        """Close the entities of this node. A rospy or rclpy node of the user stays open."""

"""Interface of nodes of either ROS for listeners, broadcasters and servers."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias

if TYPE_CHECKING:
    from collections.abc import Callable

__all__ = ["Encoding", "Flavor", "Node", "Publisher", "Service", "Subscription"]

Flavor: TypeAlias = Literal["ros1", "ros2"]
"""A side of ROS, for its rules, texts and messages."""
Encoding: TypeAlias = Literal["ros1", "cdr"]
"""Encoding of messages, as in `Buffer.ingest`."""


class Subscription(Protocol):
    """A topic that is listened to."""

    native: Any
    """The same in the node's ROS library, such as rospy's Subscriber; None without a library."""

    def close(self) -> None:
        """Stop listening. A callback that runs in another thread may still end.

        Again: nothing happens.
        """


class Publisher(Protocol):
    """A topic that is published to."""

    native: Any
    """The same in the node's ROS library, such as rospy's Publisher; None without a library."""

    def publish(self, data: bytes) -> None:
        """Send one serialized message, in the node's encoding."""

    def close(self) -> None:
        """Take the topic back."""


class Service(Protocol):
    """A service that is offered."""

    native: Any
    """The same in the node's ROS library, such as rospy's Service; None without a library."""

    def close(self) -> None:
        """Take it back."""


class Node(Protocol):
    """A node of ROS 1 or ROS 2: bytes in, bytes out, and a clock. Any thread may call it."""

    flavor: Flavor
    """Side of ROS."""
    encoding: Encoding
    """Of the messages it carries."""
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
            Its name, resolved as the node's own rules say.
        kind
            Type, such as `tf2_msgs/TFMessage`.
        on_message
            Gets the serialized message, which is valid until it returns, and the name of the
            publisher's node ("" where that is not known). What it raises is logged.
        latched
            Whether late joiners get what was sent before (ROS 2: transient local).
        depth
            How many messages may wait.
        qos
            In a node of rclpy: a QoS profile, instead of `latched` and `depth`. Elsewhere None.
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
        """Nanoseconds on the node's clock: the wall's, or that of /clock with `use_sim_time`."""

    @property
    def simulated(self) -> bool:
        """Whether `now` is simulated time."""

    @property
    def closed(self) -> bool:
        """Whether the node has ended: closed, or shut down with its ROS."""

    def on_clock(self, called: Callable[[int], None]) -> Subscription:
        """Call `called(now)` whenever simulated time is set, and once when the node ends."""

    def close(self) -> None:
        """Close the node's entities; a user's rospy or rclpy node stays."""

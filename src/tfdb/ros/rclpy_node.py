"""A ROS 2 node on the user's rclpy node, with serialized messages.

`rclpy_receiving.py` receives messages, in a separate thread or in the node's executor.
"""

from __future__ import annotations

import threading
import traceback
from importlib import import_module
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

import rclpy
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.validate_topic_name import validate_topic_name

from tfdb.data.errors import InvalidArgument, NodeClosed

from .rclpy_receiving import (
    DisabledGroup,
    ExecutorReceiver,
    GraphEntity,
    NodeEntity,
    SerialGroup,
    ThreadReceiver,
)
from .rclpy_spinning import Spinning, is_up, watch

if TYPE_CHECKING:
    from collections.abc import Callable

    from .node import Encoding, Flavor, Publisher, Service, Subscription
    from .rclpy_receiving import Receiver

__all__ = ["RclpyNode", "own_node"]

# rclpy's names for a node that is not known yet, and for a program without a ROS node.
_NO_NAMES: Final = ("_NODE_NAME_UNKNOWN_", "_CREATED_BY_BARE_DDS_APP_")
# Seconds between two queries of a topic's publishers, if the last one found no name.
_ASK_EVERY: Final = 1.0


class RclpyNode:
    """Adapts an rclpy node to the interface `Node`.

    The rclpy node belongs to the user: `close` closes the entities that were opened here, but not
    the rclpy node. When the rclpy node is destroyed or its context shut down, messages end and
    `closed` is true. After any of these, opening an entity raises NodeClosed.

    Threads: any thread may call anything. With `own_thread` all messages arrive in one thread of
    this object. Without it they arrive in the threads of the node's executor, those of one topic
    one at a time. In both cases services and the clock need an executor that spins the node.

    Parameters
    ----------
    node
        A node of rclpy.
    own_thread
        Whether messages are received in a thread of this object instead of the node's executor.
    """

    flavor: Flavor = "ros2"
    encoding: Encoding = "cdr"

    def __init__(self, node: Any, *, own_thread: bool) -> None:
        self.name: str = node.get_fully_qualified_name()
        self.given: Any = node
        """The node of rclpy."""
        self._node = node
        self._own_thread = own_thread
        self._receiver: Receiver | None = None
        self._opened: set[GraphEntity] = set()
        self._on_clock: list[Callable[[int], None]] = []
        self._spinning: list[Spinning] = []
        self._ended = False
        self._lock = threading.RLock()
        self._forget_node = _when_destroyed(node, self._end)
        node.context.on_shutdown(self._end)

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
            Its name, which the node resolves and remaps.
        kind
            Type, such as `tf2_msgs/TFMessage`.
        on_message
            Called with the serialized message, and the name of the publishing node if the topic has
            only one. Otherwise the name is "", because rclpy does not report which node sent a
            message. Exceptions are logged once for each publisher.
        latched
            Whether nodes that join later get earlier messages (transient local).
        depth
            Largest number of waiting messages.
        qos
            A QoS profile in place of `latched` and `depth`.

        Raises NodeClosed, InvalidArgument for a type that is not installed, and rclpy's error for
        an invalid name.
        """
        message = _type_of(kind, "msg")
        self._raise_if_closed()
        validate_topic_name(topic)
        failed: set[str] = set()
        senders = _SenderNames(self._node, self._node.resolve_topic_name(topic))

        def deliver(data: bytes, info: dict[str, Any]) -> None:
            sender = senders.sender_of(info)
            try:
                on_message(data, sender)
            except Exception:
                if sender not in failed:
                    failed.add(sender)
                    self._log_failure(f"a callback of {topic} for {sender or 'an unknown node'}")

        quality = qos or _quality(latched=latched, depth=depth)
        with self._lock:
            self._raise_if_closed()
            if self._receiver is None:
                own = self._own_thread
                self._receiver = (
                    ThreadReceiver(self._node, self._end) if own else ExecutorReceiver(self._node)
                )
            return self._keep(self._receiver.subscribe(message, topic, deliver, quality))

    def advertise(
        self,
        topic: str,
        kind: str,
        *,
        latched: bool = False,
        depth: int = 100,
        qos: Any = None,
    ) -> Publisher:
        """Offer a topic; arguments and errors as in `subscribe`."""
        message = _type_of(kind, "msg")
        self._raise_if_closed()
        quality = qos or _quality(latched=latched, depth=depth)
        publisher = self._node.create_publisher(message, topic, quality)
        opened = _OpenedPublisher(self._node, publisher)
        self._keep(opened)
        return opened

    def serve(self, name: str, kind: str, answer: Callable[[bytes], bytes]) -> Service:
        """Offer a service: `answer` makes the serialized response of a serialized request.

        The node's executor calls it. Its exceptions are logged, and the caller then gets an empty
        response, because a ROS 2 service cannot fail. Raises the errors of `subscribe`.
        """
        service_type = _type_of(kind, "srv")
        self._raise_if_closed()

        def respond(request: Any, response: Any) -> Any:
            try:
                data = answer(serialize_message(request))
                return deserialize_message(data, service_type.Response)
            except Exception:
                self._log_failure(f"the service {name}")
                return response

        group = SerialGroup()
        service = self._node.create_service(service_type, name, respond, callback_group=group)
        return self.adopt(lambda: self._node.destroy_service(service), service)

    def adopt(self, destroy: Callable[[], object], native: Any = None) -> Service:
        """Register an entity of the rclpy node, so that `close` destroys it."""
        return self._keep(NodeEntity(self._node, destroy, native))

    def now(self) -> int:
        """Nanoseconds by the node's clock: the system's, or /clock with `use_sim_time`."""
        return int(self._node.get_clock().now().nanoseconds)

    @property
    def simulated(self) -> bool:
        """Whether `now` is simulated time."""
        return bool(self._node.get_clock().ros_time_is_active)

    @property
    def closed(self) -> bool:
        """Whether this object was closed, the rclpy node destroyed, or its context shut down."""
        return self._ended or not is_up(self._node)

    def on_clock(self, called: Callable[[int], None]) -> Subscription:
        """Call `called(now)` whenever simulated time is set, and once when the node ends.

        The node's executor calls it during the callback of /clock. At the end of the node, for any
        reason, it is called as well; at once if the node has already ended. It must not block.
        """
        clock = self._node.get_clock()

        def guarded(now: int) -> None:
            try:
                called(now)
            except Exception:
                self._log_failure("a callback for the clock")

        def jumped(_jump: Any) -> None:
            if clock.ros_time_is_active:
                guarded(self.now())

        forward, backward = Duration(nanoseconds=1), Duration(nanoseconds=-1)
        threshold = JumpThreshold(min_forward=forward, min_backward=backward)
        if self.closed:
            guarded(self.now())
            return GraphEntity(lambda: None)
        watch(self)
        with self._lock:
            handle = clock.create_jump_callback(threshold, post_callback=jumped)
            self._on_clock.append(guarded)

            def take_back() -> None:
                handle.unregister()
                with self._lock:
                    self._on_clock = [each for each in self._on_clock if each is not guarded]

            return self._keep(GraphEntity(take_back))

    def close(self) -> None:
        """Close everything that was opened here; the rclpy node stays open."""
        self._end()
        with self._lock:
            opened, self._opened = self._opened, set()
        for each in opened:
            each.close()
        self._forget_node()

    def spin(self, ended: Callable[[], object] = lambda: None) -> Spinning:
        """Spin the rclpy node in a thread until either ends, unless another executor has the node.

        `ended` is called when the thread ends. Raises NodeClosed.
        """
        with self._lock:
            self._raise_if_closed()
            spinning = Spinning(self._node, ended)
            self._spinning.append(spinning)
        return spinning

    def wake(self) -> None:
        """Wake the node's executor: a coroutine in it may continue."""
        executor = self._node.executor
        if executor is not None:
            executor.wake()

    def _end(self) -> None:
        """Stop listening. It does not wait, because rclpy may call it with a lock held."""
        with self._lock:
            was_ended, self._ended = self._ended, True
            on_clock, receiver, spinning = self._on_clock, self._receiver, list(self._spinning)
        if was_ended:
            return
        if receiver is not None:
            receiver.close()
        for each in spinning:
            each.close()
        for called in on_clock:
            called(self.now())

    def _raise_if_closed(self) -> None:
        if self.closed:
            reason = "it was closed, destroyed, or its context shut down"
            raise NodeClosed(f"the node {self.name} is closed", reason=reason)

    def _keep(self, opened: GraphEntity) -> GraphEntity:
        with self._lock:
            self._opened = {each for each in self._opened if each.is_open} | {opened}
        return opened

    def _log_failure(self, what: str) -> None:
        self._node.get_logger().error(f"{what} failed:\n{traceback.format_exc()}")


def own_node(name: str) -> RclpyNode:
    """Create a new rclpy node in the default context, and spin it in a thread."""
    theirs = rclpy.create_node(
        name,
        # The program's arguments must not rename this node.
        cli_args=["--ros-args", "-r", f"__node:={name}"],
        enable_rosout=False,
        start_parameter_services=False,
    )
    node = RclpyNode(theirs, own_thread=True)
    node.spin()
    return node


class _OpenedPublisher(NodeEntity):
    """A publisher of bytes.

    Threads: any may call it.
    """

    def __init__(self, node: Any, publisher: Any) -> None:
        super().__init__(node, lambda: node.destroy_publisher(publisher), publisher)
        self._node = node
        self._publisher = publisher

    def publish(self, data: bytes) -> None:
        """Send one serialized message. Raises NodeClosed."""
        try:
            self._publisher.publish(data)
        except RuntimeError as error:
            if self.is_open and not isinstance(error, InvalidHandle) and is_up(self._node):
                raise
            raise NodeClosed(f"{error}", reason=f"{error}") from error


class _SenderNames:
    """Finds which node sent a message, as far as rclpy allows.

    A message has a sequence number of its publisher, but not the publisher's name. So the name is
    known only while all publishers of the topic belong to one node. If the numbers are not
    consecutive, a publisher was added or removed, or a message was lost. The graph is then queried
    again.

    Threads: one at a time.
    """

    def __init__(self, node: Any, topic: str) -> None:
        self._node = node
        self._topic = topic
        self._name = ""
        self._expected = -1
        self._ask_at = 0.0

    def sender_of(self, info: dict[str, Any]) -> str:
        """The full name of the sender's node, or ""."""
        number = info["publication_sequence_number"]
        if number != self._expected or not self._name:
            self._name = self._ask()
        self._expected = number + 1
        return self._name

    def _ask(self) -> str:
        now = monotonic()
        if now < self._ask_at:
            return ""
        try:
            publishers = self._node.get_publishers_info_by_topic(self._topic)
        except InvalidHandle:  # the node was destroyed, but its last messages still arrive
            publishers = []
        nodes = {(each.node_namespace, each.node_name) for each in publishers}
        namespace, name = nodes.pop() if len(nodes) == 1 else ("", _NO_NAMES[0])
        if name in _NO_NAMES:
            self._ask_at = now + _ASK_EVERY
            return ""
        return f"{namespace.rstrip('/')}/{name}"


def _when_destroyed(node: Any, called: Callable[[], None]) -> Callable[[], object]:
    """Call `called` when the node is destroyed, or when the returned function is called.

    A node reports its end only to its own entities; this uses a timer that never fires.
    """
    timer = node.create_timer(1e6, lambda: None, callback_group=DisabledGroup())
    timer.cancel()
    destroy = timer.destroy

    def destroyed() -> None:
        destroy()
        called()

    timer.destroy = destroyed
    return lambda: node.destroy_timer(timer)


def _quality(*, latched: bool, depth: int) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def _type_of(kind: str, section: str) -> Any:
    """Return the class of `package/Name`, or of ROS 2's form `package/msg/Name`."""
    package, *_, name = kind.split("/")
    try:
        return getattr(import_module(f"{package}.{section}"), name)
    except (ImportError, AttributeError) as error:
        raise InvalidArgument(f"the type {kind} is not installed: {error}") from error

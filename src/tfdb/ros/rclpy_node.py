"""A ROS 2 node on the user's rclpy node: serialized messages in and out.

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

# What stands for the name of a node that is not known yet, and of one that is none of ROS.
_NO_NAMES: Final = ("_NODE_NAME_UNKNOWN_", "_CREATED_BY_BARE_DDS_APP_")
# Seconds between two questions for a topic's publishers, where the last gave no name.
_ASK_EVERY: Final = 1.0


class RclpyNode:
    """An rclpy node as the rest of tfdb sees a node.

    The rclpy node stays the user's: `close` takes back what was opened here and leaves it alive.
    When the rclpy node is destroyed or its context shut down, messages end and `closed` is true.
    What is opened after any of these raises NodeClosed.

    Threads: any thread may call anything. With `own_thread` all messages come in one thread that
    this object has; without it in the threads of the node's executor, those of one topic one after
    the other. Services and the clock need the node's executor to spin in either case.

    Parameters
    ----------
    node
        A node of rclpy.
    own_thread
        Whether messages are taken in a thread of this object's own, and none by the node's
        executor.
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
            Its name, resolved and remapped as the node does.
        kind
            Type, such as `tf2_msgs/TFMessage`.
        on_message
            Gets the serialized message, and the name of the publisher's node while only one
            publishes the topic: rclpy does not tell which of several sent a message, which gives
            "". What it raises is logged, once for each publisher.
        latched
            Whether late joiners get what was sent before (transient local).
        depth
            How many messages may wait.
        qos
            Stands for `latched` and `depth`.

        Raises NodeClosed, InvalidArgument for a type that is not installed, and what rclpy raises
        for a name that is none.
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
                    self._log_failure(f"what hears {topic} from {sender or 'an unknown node'}")

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

        The node's executor calls it. What it raises is logged, and the caller gets an empty
        response, since a service of ROS 2 cannot fail. Raises as `subscribe` does.
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
        """Keep something that was made in the rclpy node, which `close` is to destroy."""
        return self._keep(NodeEntity(self._node, destroy, native))

    def now(self) -> int:
        """Nanoseconds on the node's clock: the wall's, or that of /clock with `use_sim_time`."""
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

        The node's executor calls it, amid the callback of /clock; at its end, from any cause, and
        at once where it has ended. It must not block.
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
        """Take back everything that was opened here; the rclpy node stays."""
        self._end()
        with self._lock:
            opened, self._opened = self._opened, set()
        for each in opened:
            each.close()
        self._forget_node()

    def spin(self, ended: Callable[[], object] = lambda: None) -> Spinning:
        """Spin the rclpy node in a thread, unless another executor has it, until one of both ends.

        `ended` is called when the thread ends. Raises NodeClosed.
        """
        with self._lock:
            self._raise_if_closed()
            spinning = Spinning(self._node, ended)
            self._spinning.append(spinning)
        return spinning

    def wake(self) -> None:
        """Let the node's executor look again: a coroutine in it may go on."""
        executor = self._node.executor
        if executor is not None:
            executor.wake()

    def _end(self) -> None:
        """Listen no more. It waits for nothing: rclpy may call it with a lock of its own held."""
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
    """Make a node of rclpy that no program has, in the default context, and spin it in a thread."""
    theirs = rclpy.create_node(
        name,
        # Not the name that the program's arguments give to its own node.
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
    """Says which node sent a message, as far as rclpy lets it be known.

    A message comes with its number among those of its publisher, not with the publisher's name. So
    a name can be told while all publishers of the topic are of one node. The graph is asked anew
    when the numbers do not follow each other: then a publisher has come or gone, or a message was
    lost.

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
        except InvalidHandle:  # the node was destroyed, and its last messages are on their way
            publishers = []
        nodes = {(each.node_namespace, each.node_name) for each in publishers}
        namespace, name = nodes.pop() if len(nodes) == 1 else ("", _NO_NAMES[0])
        if name in _NO_NAMES:
            self._ask_at = now + _ASK_EVERY
            return ""
        return f"{namespace.rstrip('/')}/{name}"


def _when_destroyed(node: Any, called: Callable[[], None]) -> Callable[[], object]:
    """Call `called` when the node is destroyed, or when what is returned is called.

    A node reports its end only to what it made: here a timer that never runs.
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
    """The class of `package/Name`, or of `package/msg/Name` as ROS 2 writes it itself."""
    package, *_, name = kind.split("/")
    try:
        return getattr(import_module(f"{package}.{section}"), name)
    except (ImportError, AttributeError) as error:
        raise InvalidArgument(f"the type {kind} is not installed: {error}") from error

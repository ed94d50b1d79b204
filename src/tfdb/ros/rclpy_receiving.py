"""Receives serialized messages through rclpy: in a separate thread, or in the node's executor.

The thread has a wait set with only its own subscriptions, which needs a third of the CPU of an
executor. It uses private parts of rclpy. If these are not as expected, the thread spins an
executor.
"""

from __future__ import annotations

import threading
import weakref
from contextlib import ExitStack, suppress
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeAlias
from uuid import uuid4

import rclpy
from rclpy.exceptions import InvalidHandle
from rclpy.qos import qos_policy_name_from_kind
from rclpy.signals import SignalHandlerGuardCondition
from rclpy.waitable import NumberOfEntities, Waitable

from .rclpy_spinning import NodeThread, Spinning, is_up

if TYPE_CHECKING:
    from collections.abc import Callable

    Deliver: TypeAlias = Callable[[bytes, dict[str, Any]], None]
    CallbackGroup = object  # rclpy is not typed
else:
    from rclpy.callback_groups import CallbackGroup

__all__ = [
    "DisabledGroup",
    "ExecutorReceiver",
    "GraphEntity",
    "NodeEntity",
    "Receiver",
    "SerialGroup",
    "ThreadReceiver",
]

# Errors if rclpy has other private names.
_NOT_AS_EXPECTED: Final = (AttributeError, ImportError, TypeError, ValueError)
# Seconds between two checks for publishers with an incompatible QoS.
_WARN_EVERY: Final = 1.0
# Name of the receiving threads.
_LISTENER: Final = "tfdb listener"
_BUSY: Final = 0.005
"""Seconds of work without a wait after which the thread pauses. Between two of its short waits no
other thread may get the interpreter lock, for seconds."""
_PAUSE: Final = 0.0001


class GraphEntity:
    """A subscription, publisher, service or callback of a node.

    Threads: any may close it.
    """

    def __init__(self, take_back: Callable[[], object], native: Any = None) -> None:
        self.is_open: bool = True
        self.native: Any = native
        """The object of rclpy, such as its Subscription; None: rclpy has none."""
        self._take_back = take_back
        self._lock = threading.Lock()

    def close(self) -> None:
        """Close it; a second call does nothing."""
        with self._lock:
            was_open, self.is_open = self.is_open, False
        if was_open:
            self._take_back()


class NodeEntity(GraphEntity):
    """An entity that an rclpy node creates and destroys.

    Threads: any may close it. A spinning executor fails if another thread destroys one of its
    entities, so the executor itself destroys it.
    """

    def __init__(self, node: Any, destroy: Callable[[], object], native: Any = None) -> None:
        def take_back() -> None:
            executor = node.executor
            if executor is None:
                destroy()
                return
            try:
                executor.create_task(destroy)
            except (AttributeError, InvalidHandle):  # the executor was shut down
                destroy()

        super().__init__(take_back, native)


class Receiver(Protocol):
    """Receives messages. Thread-safe."""

    def subscribe(self, kind: Any, topic: str, deliver: Deliver, qos: Any) -> GraphEntity:
        """Call `deliver(data, info)` for each message of a topic, of class `kind`."""

    def close(self) -> None:
        """Stop receiving."""


class _SubscriptionReceiver:
    """Receives messages through rclpy's subscriptions, in the executor of their node.

    Each has its own callback group: its messages arrive in order, and neither wait for other
    callbacks of the node nor delay them.

    Threads: any may call it.
    """

    def __init__(self, node: Any) -> None:
        self._node = node

    def subscribe(self, kind: Any, topic: str, deliver: Deliver, qos: Any) -> GraphEntity:
        def while_open(data: bytes, info: dict[str, Any]) -> None:
            if opened.is_open:
                deliver(data, info)

        subscription = self._node.create_subscription(
            kind, topic, while_open, qos, callback_group=SerialGroup(), raw=True
        )
        destroy = self._node.destroy_subscription
        opened = NodeEntity(self._node, lambda: destroy(subscription), subscription)
        return opened

    def close(self) -> None:
        """Do nothing: the executor belongs to the program."""


class ExecutorReceiver:
    """Receives messages in the executor of a node, with less CPU than rclpy's subscriptions.

    Threads: any may call it.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._subscriptions_receiver: _SubscriptionReceiver | None = None
        self._opened: weakref.WeakSet[GraphEntity] = weakref.WeakSet()

    def subscribe(self, kind: Any, topic: str, deliver: Deliver, qos: Any) -> GraphEntity:
        """Call `deliver(data, info)` for each message of a topic, of class `kind`."""
        try:
            added = _Topic(self._node, kind, topic, deliver, qos)
        except _NOT_AS_EXPECTED as error:
            if self._subscriptions_receiver is None:
                _warn_unexpected(self._node, error)
                self._subscriptions_receiver = _SubscriptionReceiver(self._node)
            return self._subscriptions_receiver.subscribe(kind, topic, deliver, qos)
        # A message that was taken wakes no executor.
        added.take_all()
        waited = _Waited(added)
        self._node.add_waitable(waited)

        def take_back() -> None:
            with suppress(ValueError):  # a destroyed node may have forgotten it
                self._node.remove_waitable(waited)
            added.close()

        opened = added.opened(take_back)
        self._opened.add(opened)
        return opened

    def close(self) -> None:
        """Stop receiving."""
        for each in list(self._opened):
            each.close()


class _Waited(Waitable):  # type: ignore[misc]  # rclpy is not typed
    """A topic for which an executor waits. It is one waitable; a subscription of rclpy is three.

    A subscription of rclpy and its two events cost an executor six checks in Python per message.

    Threads: the executor's. A topic that is closed meanwhile is skipped.
    """

    def __init__(self, topic: _Topic) -> None:
        super().__init__(SerialGroup())
        self._topic = topic
        # Number of calls of `enter` without `leave`, and whether the last `enter` succeeded.
        self._entered: list[bool] = []
        self._is_there = False
        self._event = -1

    def get_num_entities(self) -> Any:
        if not self._is_there:
            return NumberOfEntities()
        return NumberOfEntities(1, num_events=int(self._topic.event is not None))

    def add_to_wait_set(self, wait_set: Any) -> None:
        if self._is_there:
            self._topic.add_to(wait_set)
            if self._topic.event is not None:
                self._event = wait_set.add_event(self._topic.event)

    def is_ready(self, wait_set: Any) -> bool:
        if not self._is_there:
            return False
        if self._event >= 0 and wait_set.is_ready("event", self._event):
            self._topic.warn()
        return self._topic.is_ready(wait_set)

    def take_data(self) -> None:
        """Take nothing: `execute` takes the messages, one at a time."""

    async def execute(self, taken_data: None) -> None:  # noqa: ARG002  (the name is rclpy's)
        self._topic.take_all()

    def __enter__(self) -> None:
        self._is_there = self._topic.enter()
        self._entered.append(self._is_there)

    def __exit__(self, *_: object) -> None:
        if self._entered.pop(0):
            self._topic.leave()


class _Topic:
    """A subscription of rclpy outside its executors.

    Threads: one at a time; any may close it.
    """

    def __init__(self, node: Any, kind: Any, topic: str, deliver: Deliver, qos: Any) -> None:
        # rclpy's private parts have them.
        from rclpy.event_handler import SubscriptionEventCallbacks  # noqa: PLC0415
        from rclpy.subscription import Subscription  # noqa: PLC0415
        from rclpy.type_support import check_for_type_support  # noqa: PLC0415

        check_for_type_support(kind)
        rcl = _implementation()
        with node.handle:
            profile = qos.get_c_qos_profile()
            self.handle = rcl.Subscription(node.handle, kind, topic, profile)
        incompatible = rcl.rcl_subscription_event_type_t.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS
        try:
            with self.handle:
                self.event: Any = rcl.EventHandle(self.handle, incompatible)
        except rcl.UnsupportedEventTypeError:
            self.event = None
        events = SubscriptionEventCallbacks(use_default_callbacks=False)
        self._subscription = Subscription(
            *(self.handle, kind, topic, deliver, DisabledGroup(), qos, True, events)
        )
        self._node = node
        self._kind = kind
        self._topic = topic
        self._deliver = deliver
        self._is_open = True
        self._place = 0
        # Largest number of consecutive messages, so that other topics have their turn.
        self._at_once = max(qos.depth, 1)
        # The first call tests whether rclpy returns messages as expected; it may return one.
        self._first = self._take()

    def opened(self, take_back: Callable[[], object]) -> GraphEntity:
        """Return its entity; `node.destroy_subscription(opened.native)` also closes it."""
        opened = GraphEntity(take_back, self._subscription)
        self._subscription.destroy = opened.close
        _allow_destroy(self._node, self._subscription)
        return opened

    def enter(self) -> bool:
        """Prevent its destruction until `leave`. Return whether it still exists."""
        try:
            self.handle.__enter__()
        except InvalidHandle:
            return False
        try:
            if self.event is not None:
                self.event.__enter__()
        except InvalidHandle:
            self.handle.__exit__(None, None, None)
            return False
        return True

    def leave(self) -> None:
        self.handle.__exit__(None, None, None)
        if self.event is not None:
            self.event.__exit__(None, None, None)

    def add_to(self, wait_set: Any) -> None:
        self._place = wait_set.add_subscription(self.handle)

    def is_ready(self, wait_set: Any) -> bool:
        """Whether a message is ready."""
        return self._first is not None or bool(wait_set.is_ready("subscription", self._place))

    def warn(self) -> None:
        """Log new QoS warnings, as rclpy does. Call it between `enter` and `leave`."""
        status = None if self.event is None else self.event.take_event()
        if status is not None and status.total_count_change > 0:
            policy = qos_policy_name_from_kind(status.last_policy_kind)
            self._node.get_logger().warning(
                f"New publisher discovered on topic '{self._topic}', offering incompatible QoS. "
                f"No messages will be received from it. Last incompatible policy: {policy}"
            )

    def take_all(self) -> None:
        """Deliver the received messages."""
        if self._first is not None:
            first, self._first = self._first, None
            self._deliver(*first)
        with suppress(InvalidHandle):  # it was closed
            for _ in range(self._at_once):
                taken = self._take() if self._is_open else None
                if taken is None:
                    return
                self._deliver(*taken)

    def close(self) -> None:
        self._is_open = False
        if self.event is not None:
            self.event.destroy_when_not_in_use()
        self.handle.destroy_when_not_in_use()

    def _take(self) -> tuple[bytes, dict[str, Any]] | None:
        with self.handle:
            taken = self.handle.take_message(self._kind, True)  # noqa: FBT003
        if taken is None:
            return None
        data, info = taken
        return data, info


class ThreadReceiver(NodeThread):
    """Receives messages in a thread, which waits for its subscriptions and ends with the last.

    Threads: any may call it.
    """

    def __init__(self, node: Any, ended: Callable[[], None]) -> None:
        super().__init__(node, _LISTENER)
        self._ended = ended
        # rclpy's signal handler shuts contexts down, and triggers only guard conditions of this
        # kind.
        self._bell = SignalHandlerGuardCondition(node.context)
        self._topics: tuple[_Topic, ...] = ()
        self._runs = False
        self._instead: _OwnExecutor | None = None
        self._lock = threading.Lock()

    def subscribe(self, kind: Any, topic: str, deliver: Deliver, qos: Any) -> GraphEntity:
        """Call `deliver(data, info)` for each message of a topic, of class `kind`."""
        with self._lock:
            try:
                added = _Topic(self._node, kind, topic, deliver, qos)
                self._new_wait_set(1)
            except _NOT_AS_EXPECTED as error:
                return self._in_executor(error).subscribe(kind, topic, deliver, qos)
            self._topics = (*self._topics, added)
            if not self._runs:
                self._runs = True
                self._start()
        self._ring()
        return added.opened(lambda: self._remove(added))

    def close(self) -> None:
        """Stop receiving."""
        super().close()
        if self._instead is not None:
            self._instead.close()

    def _in_executor(self, error: Exception) -> _OwnExecutor:
        if self._instead is None:
            _warn_unexpected(self._node, error)
            self._instead = _OwnExecutor(self._node, self._ended)
        return self._instead

    def _remove(self, topic: _Topic) -> None:
        with self._lock:
            self._topics = tuple(each for each in self._topics if each is not topic)
        topic.close()
        self._ring()

    def _ring(self) -> None:
        self._bell.trigger()

    def _run(self) -> None:
        is_idle = False
        try:
            is_idle = self._listen_until_idle()
        except RuntimeError:  # rclpy's RCLError: the context was shut down just before
            if is_up(self._node):
                raise
        finally:
            if not is_idle:
                for topic in self._topics:
                    topic.close()
                self._ended()

    def _listen_until_idle(self) -> bool:
        """Listen. Return True if it ended because no topic is left."""
        while self._is_running():
            with self._lock:
                topics = self._topics
                self._runs = bool(topics)
            if not topics:
                return True
            self._listen(topics)
        return False

    def _listen(self, topics: tuple[_Topic, ...]) -> None:
        """Receive messages of these topics until the topics change."""
        with ExitStack() as in_use:
            for topic in topics:
                if not topic.enter():
                    return  # a topic was closed meanwhile, so the topics have changed
                in_use.callback(topic.leave)
            wait_set = self._new_wait_set(len(topics))
            # Some topics may have received a message before this wait.
            ready = list(topics)
            worked_from = monotonic()
            warn_at = worked_from + _WARN_EVERY
            while topics is self._topics and self._is_running():
                for topic in ready:
                    topic.take_all()
                wait_set.clear_entities()
                for topic in topics:
                    topic.add_to(wait_set)
                wait_set.add_guard_condition(self._bell.handle)
                # Waiting for the events of topics as well would need a fifth more CPU.
                waits_from = monotonic()
                wait_set.wait(int(_WARN_EVERY * 1e9))
                ready = [topic for topic in topics if topic.is_ready(wait_set)]
                now = monotonic()
                if now - waits_from > _PAUSE:
                    worked_from = now
                elif now - worked_from > _BUSY:
                    sleep(_PAUSE)
                    worked_from = monotonic()
                if now >= warn_at:
                    warn_at += _WARN_EVERY
                    for topic in topics:
                        topic.warn()

    def _new_wait_set(self, topics: int) -> Any:
        context = self._node.context.handle
        with context:
            return _implementation().WaitSet(topics, 1, 0, 0, 0, 0, context)


class _OwnExecutor:
    """Receives messages in a thread that spins a separate executor with a separate node.

    Threads: any may call it.
    """

    def __init__(self, node: Any, ended: Callable[[], None]) -> None:
        self._node = node
        own_node = rclpy.create_node(
            f"{node.get_name()}_listener_{uuid4().hex[:12]}",
            namespace=node.get_namespace(),
            context=node.context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )

        def over() -> None:
            own_node.destroy_node()
            ended()

        self._receiver = _SubscriptionReceiver(own_node)
        self._spinning = Spinning(own_node, over, _LISTENER)

    def subscribe(self, kind: Any, topic: str, deliver: Deliver, qos: Any) -> GraphEntity:
        # The user's node resolves the name.
        return self._receiver.subscribe(kind, self._node.resolve_topic_name(topic), deliver, qos)

    def close(self) -> None:
        self._spinning.close()


class DisabledGroup(CallbackGroup):
    """A callback group that no executor runs.

    Threads: any.
    """

    def can_execute(self, entity: Any) -> bool:  # noqa: ARG002  (the name is rclpy's)
        """No."""
        return False

    def beginning_execution(self, entity: Any) -> bool:  # noqa: ARG002
        """No."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing, because no callback runs in this group."""


class SerialGroup(CallbackGroup):
    """Runs one callback at a time, with less CPU than rclpy's MutuallyExclusiveCallbackGroup.

    Threads: any.
    """

    def __init__(self) -> None:
        super().__init__()
        self._turn = threading.Lock()

    def can_execute(self, entity: Any) -> bool:  # noqa: ARG002  (the name is rclpy's)
        """Whether no callback of the group runs."""
        return not self._turn.locked()

    def beginning_execution(self, entity: Any) -> bool:  # noqa: ARG002
        """Start a callback unless another one runs."""
        return self._turn.acquire(blocking=False)

    def ending_execution(self, entity: Any) -> None:  # noqa: ARG002
        """End a callback."""
        self._turn.release()


_destroyable: weakref.WeakSet[Any] = weakref.WeakSet()
"""Subscriptions that are not in their node's list."""


def _allow_destroy(node: Any, subscription: Any) -> None:
    """Let `node.destroy_subscription` end a subscription that is not in the node's list."""
    _destroyable.add(subscription)
    destroy = node.destroy_subscription
    if getattr(destroy, "knows_destroyable", False):
        return

    def destroy_subscription(given: Any) -> bool:
        if given in _destroyable:
            _destroyable.discard(given)
            given.destroy()
            return True
        return bool(destroy(given))

    destroy_subscription.knows_destroyable = True  # type: ignore[attr-defined]
    node.destroy_subscription = destroy_subscription


def _implementation() -> Any:
    """Return the private parts of rclpy, which may change."""
    from rclpy.impl.implementation_singleton import rclpy_implementation  # noqa: PLC0415

    return rclpy_implementation


def _warn_unexpected(node: Any, error: Exception) -> None:
    node.get_logger().warning(
        "listening through rclpy's own subscriptions, which need more CPU: rclpy's private parts "
        f"are not as expected ({type(error).__name__}: {error})"
    )

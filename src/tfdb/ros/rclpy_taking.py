"""How messages of rclpy are taken as bytes: in a thread of their own, or in the node's executor.

The thread has a wait set for its subscriptions alone, which costs a third of an executor that does
the same. That is rclpy's private face: where it is not as expected, the thread spins an executor.
"""

from __future__ import annotations

import atexit
import threading
import weakref
from abc import ABC, abstractmethod
from contextlib import ExitStack, suppress
from time import monotonic
from typing import TYPE_CHECKING, Any, Final, Protocol, TypeAlias
from uuid import uuid4

import rclpy
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import qos_policy_name_from_kind
from rclpy.signals import SignalHandlerGuardCondition
from rclpy.waitable import NumberOfEntities, Waitable

if TYPE_CHECKING:
    from collections.abc import Callable

    Deliver: TypeAlias = Callable[[bytes, dict[str, Any]], None]
    CallbackGroup = object  # rclpy is not typed
else:
    from rclpy.callback_groups import CallbackGroup

__all__ = ["InExecutor", "InTurn", "Made", "Opened", "OwnThread", "Taker", "is_up"]

# What tells that rclpy's private face is another.
_NOT_AS_EXPECTED: Final = (AttributeError, ImportError, TypeError, ValueError)
# Seconds between two looks for publishers that cannot be heard.
_WARN_EVERY: Final = 1.0
# Seconds that the interpreter waits at its end for a thread to leave.
_LEAVE_WITHIN: Final = 2.0


class Opened:
    """Something of the graph that is taken back once.

    Threads: any may close it.
    """

    def __init__(self, take_back: Callable[[], object]) -> None:
        self.is_open: bool = True
        self._take_back = take_back
        self._lock = threading.Lock()

    def close(self) -> None:
        """Take it back, unless that is done."""
        with self._lock:
            was_open, self.is_open = self.is_open, False
        if was_open:
            self._take_back()


class Made(Opened):
    """Something that an rclpy node made and destroys.

    Threads: any may close it. An executor that spins fails when something of its is destroyed by
    another thread, so it is asked to do that itself.
    """

    def __init__(self, node: Any, destroy: Callable[[], object]) -> None:
        def take_back() -> None:
            executor = node.executor
            if executor is None:
                destroy()
                return
            try:
                executor.create_task(destroy)
            except (AttributeError, InvalidHandle):  # it was shut down
                destroy()

        super().__init__(take_back)


class Taker(Protocol):
    """How messages are taken. Any thread may call it."""

    def subscribe(self, kind: Any, topic: str, deliver: Deliver, qos: Any) -> Opened:
        """Call `deliver(data, info)` for each message of a topic, of class `kind`."""

    def close(self) -> None:
        """Take no more messages."""


class _BySubscription:
    """Takes messages by rclpy's subscriptions, in the executor of their node.

    Each has a callback group of its own: its messages come in their order, and neither wait for
    other callbacks of the node nor hold them up.

    Threads: any may call it.
    """

    def __init__(self, node: Any) -> None:
        self._node = node

    def subscribe(self, kind: Any, topic: str, deliver: Deliver, qos: Any) -> Opened:
        def while_open(data: bytes, info: dict[str, Any]) -> None:
            if opened.is_open:
                deliver(data, info)

        subscription = self._node.create_subscription(
            kind, topic, while_open, qos, callback_group=InTurn(), raw=True
        )
        opened = Made(self._node, lambda: self._node.destroy_subscription(subscription))
        return opened

    def close(self) -> None:
        """Nothing is left: the executor is another's."""


class InExecutor:
    """Takes messages in the executor of a node, for less than rclpy's subscriptions do.

    Threads: any may call it.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._by_subscription: _BySubscription | None = None
        self._opened: weakref.WeakSet[Opened] = weakref.WeakSet()

    def subscribe(self, kind: Any, topic: str, deliver: Deliver, qos: Any) -> Opened:
        """Call `deliver(data, info)` for each message of a topic, of class `kind`."""
        try:
            added = _Topic(self._node, kind, topic, deliver, qos)
        except _NOT_AS_EXPECTED as error:
            if self._by_subscription is None:
                _say_not_as_expected(self._node, error)
                self._by_subscription = _BySubscription(self._node)
            return self._by_subscription.subscribe(kind, topic, deliver, qos)
        # No executor is woken by a message that was taken.
        added.take_all()
        waited = _Waited(added)
        self._node.add_waitable(waited)

        def take_back() -> None:
            with suppress(ValueError):  # a destroyed node may have forgotten it
                self._node.remove_waitable(waited)
            added.close()

        opened = Opened(take_back)
        self._opened.add(opened)
        return opened

    def close(self) -> None:
        """Take no more messages."""
        for each in list(self._opened):
            each.close()


class _Waited(Waitable):  # type: ignore[misc]  # rclpy is not typed
    """A topic that an executor waits for: one thing where a subscription of rclpy's is three.

    It is itself and two events, and an executor looks at each twice for every message, in Python.

    Threads: the executor's. What is closed meanwhile is passed over.
    """

    def __init__(self, topic: _Topic) -> None:
        super().__init__(InTurn())
        self._topic = topic
        # How often it was entered and not left, and whether the last time it was there.
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
        """Nothing: `execute` takes one message after the other, while others wait for it."""

    async def execute(self, taken_data: None) -> None:  # noqa: ARG002  (the name is rclpy's)
        self._topic.take_all()

    def __enter__(self) -> None:
        self._is_there = self._topic.enter()
        self._entered.append(self._is_there)

    def __exit__(self, *_: object) -> None:
        if self._entered.pop(0):
            self._topic.leave()


class _Thread(ABC):
    """A thread that listens until it is closed or its context is shut down.

    Threads: any may call it. `close` does not wait: what runs may still end.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._stopped = False
        self._thread: threading.Thread | None = None

    def close(self) -> None:
        self._stopped = True
        self._ring()

    def join(self) -> None:
        """Wait for its end, not for ever."""
        if self._thread is not None:
            self._thread.join(_LEAVE_WITHIN)

    def _start(self) -> None:
        _threads.add(self)
        self._thread = threading.Thread(target=self._run, name="tfdb listener", daemon=True)
        self._thread.start()

    def _goes_on(self) -> bool:
        return not self._stopped and is_up(self._node)

    @abstractmethod
    def _ring(self) -> None:
        """Make it look about."""

    @abstractmethod
    def _run(self) -> None:
        """Listen until it is to end."""


_threads: weakref.WeakSet[_Thread] = weakref.WeakSet()


@atexit.register
def _leave() -> None:
    """A thread that came back from a wait after the interpreter's end would crash."""
    left = list(_threads)
    for each in left:
        each.close()
    for each in left:
        each.join()


class _Topic:
    """A subscription that is rclpy's, and of which its executors do not know.

    Threads: one at a time; any may close it.
    """

    def __init__(self, node: Any, kind: Any, topic: str, deliver: Deliver, qos: Any) -> None:
        from rclpy.type_support import check_for_type_support  # noqa: PLC0415  (private)

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
        self._node = node
        self._kind = kind
        self._topic = topic
        self._deliver = deliver
        self._is_open = True
        self._place = 0
        # So many in a row that other topics have their turn.
        self._at_once = max(qos.depth, 1)
        # The first try shows whether messages come as expected; it may bring one.
        self._first = self._take()

    def enter(self) -> bool:
        """Keep it from being destroyed until `leave`; whether it is there to be kept."""
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
        """Whether there is something to take."""
        return self._first is not None or bool(wait_set.is_ready("subscription", self._place))

    def warn(self) -> None:
        """Say what rclpy says of its own subscriptions, if there is something new. Once entered."""
        status = None if self.event is None else self.event.take_event()
        if status is not None and status.total_count_change > 0:
            policy = qos_policy_name_from_kind(status.last_policy_kind)
            self._node.get_logger().warning(
                f"New publisher discovered on topic '{self._topic}', offering incompatible QoS. "
                f"No messages will be received from it. Last incompatible policy: {policy}"
            )

    def take_all(self) -> None:
        """Deliver what has come."""
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


class OwnThread(_Thread):
    """Takes messages in a thread that waits for its own subscriptions alone; it lives while any is.

    Threads: any may call it.
    """

    def __init__(self, node: Any, ended: Callable[[], None]) -> None:
        super().__init__(node)
        self._ended = ended
        # rclpy's signal handler shuts contexts down, and rings those of this kind alone.
        self._bell = SignalHandlerGuardCondition(node.context)
        self._topics: tuple[_Topic, ...] = ()
        self._runs = False
        self._instead: _OwnExecutor | None = None
        self._lock = threading.Lock()

    def subscribe(self, kind: Any, topic: str, deliver: Deliver, qos: Any) -> Opened:
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
        return Opened(lambda: self._remove(added))

    def close(self) -> None:
        """Take no more messages."""
        super().close()
        if self._instead is not None:
            self._instead.close()

    def _in_executor(self, error: Exception) -> _OwnExecutor:
        if self._instead is None:
            _say_not_as_expected(self._node, error)
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
        finally:
            if not is_idle:
                for topic in self._topics:
                    topic.close()
                self._ended()

    def _listen_until_idle(self) -> bool:
        """Listen; whether it ended as no topic is left: the next one starts another thread."""
        while self._goes_on():
            with self._lock:
                topics = self._topics
                self._runs = bool(topics)
            if not topics:
                return True
            self._listen(topics)
        return False

    def _listen(self, topics: tuple[_Topic, ...]) -> None:
        """Take the messages of these topics, until they are others."""
        with ExitStack() as in_use:
            for topic in topics:
                if not topic.enter():
                    return  # it was closed meanwhile: the topics are others
                in_use.callback(topic.leave)
            wait_set = self._new_wait_set(len(topics))
            # Some may have brought a message before they were waited for.
            ready = list(topics)
            warn_at = monotonic() + _WARN_EVERY
            while topics is self._topics and self._goes_on():
                for topic in ready:
                    topic.take_all()
                wait_set.clear_entities()
                for topic in topics:
                    topic.add_to(wait_set)
                wait_set.add_guard_condition(self._bell.handle)
                # To wait for the topics' events as well would cost a fifth more.
                wait_set.wait(int(_WARN_EVERY * 1e9))
                ready = [topic for topic in topics if topic.is_ready(wait_set)]
                if monotonic() >= warn_at:
                    warn_at += _WARN_EVERY
                    for topic in topics:
                        topic.warn()

    def _new_wait_set(self, topics: int) -> Any:
        context = self._node.context.handle
        with context:
            return _implementation().WaitSet(topics, 1, 0, 0, 0, 0, context)


class _OwnExecutor(_Thread):
    """Takes messages in an executor of its own, which spins a node of its own in a thread.

    Threads: any may call it.
    """

    def __init__(self, node: Any, ended: Callable[[], None]) -> None:
        super().__init__(node)
        self._ended = ended
        self._own_node = rclpy.create_node(
            f"{node.get_name()}_listener_{uuid4().hex[:12]}",
            namespace=node.get_namespace(),
            context=node.context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self._executor = SingleThreadedExecutor(context=node.context)
        self._executor.add_node(self._own_node)
        self._lock = threading.Lock()
        self._over = False
        self._taker = _BySubscription(self._own_node)
        self._start()

    def subscribe(self, kind: Any, topic: str, deliver: Deliver, qos: Any) -> Opened:
        # The user's node says what the name means.
        return self._taker.subscribe(kind, self._node.resolve_topic_name(topic), deliver, qos)

    def _ring(self) -> None:
        with self._lock:
            if not self._over:
                # A step ends when something was done in it.
                self._executor.create_task(lambda: None)

    def _run(self) -> None:
        try:
            while self._goes_on():
                self._executor.spin_once()
        except (ExternalShutdownException, InvalidHandle):
            return  # the context was shut down or destroyed, which is one way to end
        finally:
            with self._lock:
                self._over = True
            self._executor.shutdown()
            self._own_node.destroy_node()
            self._ended()


class InTurn(CallbackGroup):
    """One callback after the other, for less than rclpy's MutuallyExclusiveCallbackGroup.

    Threads: any may ask.
    """

    def __init__(self) -> None:
        super().__init__()
        self._turn = threading.Lock()

    def can_execute(self, entity: Any) -> bool:  # noqa: ARG002  (the name is rclpy's)
        """Whether nothing of it runs."""
        return not self._turn.locked()

    def beginning_execution(self, entity: Any) -> bool:  # noqa: ARG002
        """Take the turn, if it is free."""
        return self._turn.acquire(blocking=False)

    def ending_execution(self, entity: Any) -> None:  # noqa: ARG002
        """Give the turn back."""
        self._turn.release()


def is_up(node: Any) -> bool:
    """Whether the node's context is neither shut down nor destroyed."""
    try:
        return bool(node.context.ok())
    except InvalidHandle:
        return False


def _implementation() -> Any:
    """Rclpy's private face, which may become another."""
    from rclpy.impl.implementation_singleton import rclpy_implementation  # noqa: PLC0415

    return rclpy_implementation


def _say_not_as_expected(node: Any, error: Exception) -> None:
    node.get_logger().warning(
        "listening by rclpy's own subscriptions, which cost more: what is below them is not as "
        f"expected ({type(error).__name__}: {error})"
    )

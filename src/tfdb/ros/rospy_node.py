"""The ROS 1 node of a rospy process, with messages as bytes."""

from __future__ import annotations

import importlib
import io
import threading
from functools import cache
from typing import TYPE_CHECKING, Any, TypeVar

import rospy
from rospy.impl.tcpros_base import DEFAULT_BUFF_SIZE

from tfdb.data.errors import InvalidArgument, NodeClosed, NotSupported

from .clock_messages import CLOCK, CLOCK_KIND
from .loop import LOG, warn_of_message
from .message_kinds import known_kind, service_kind

if TYPE_CHECKING:
    from collections.abc import Callable

    from .node import Encoding, Flavor, Publisher, Service, Subscription
    from .tcpros_subscription import OnMessage

    Message = object  # genpy is not typed
else:
    from genpy import Message

__all__ = ["RospyNode"]

_AnyEntity = TypeVar("_AnyEntity", bound="_NodeEntity")

AT_ONCE = max(1 << 20, DEFAULT_BUFF_SIZE)  # bytes that are received in one call


class RospyNode:
    """The rospy node of the process; rospy makes its connections and threads.

    Threads: any may call anything. As in rospy, each publisher of a topic has its own receiving
    thread, so callbacks of one topic may run at the same time. `close` closes the entities that
    were opened through this object; the rospy node stays open.

    If the program subscribes to the same topic, both share rospy's connections: the program gets
    messages of its type, and tfdb gets bytes.

    Raises NotSupported before `rospy.init_node`.
    """

    flavor: Flavor = "ros1"
    encoding: Encoding = "ros1"

    def __init__(self) -> None:
        if not rospy.core.is_initialized():
            raise NotSupported(
                "rospy has no node yet: call rospy.init_node first, or use TcprosNode"
            )
        self.name: str = rospy.get_name()
        """Its full name in the graph."""
        self._lock = threading.Lock()
        self._open: list[_NodeEntity] = []
        self._ended = False

    def __repr__(self) -> str:
        return f"<RospyNode {self.name}>"

    def __eq__(self, other: object) -> bool:
        # A process has only one rospy node, however many RospyNodes it has.
        return isinstance(other, RospyNode)

    def __hash__(self) -> int:
        return hash(RospyNode)

    def subscribe(
        self,
        topic: str,
        kind: str,
        on_message: OnMessage,
        *,
        latched: bool = False,  # noqa: ARG002  (the publisher says so itself)
        depth: int = 100,  # noqa: ARG002  (rospy holds what waits)
        qos: Any = None,  # noqa: ARG002  (of ROS 2)
    ) -> Subscription:
        """Call `on_message(data, publisher)` for each message of a topic, in their order.

        No message is dropped here: while a callback runs, new messages wait in the connection, then
        at the publisher. Raises NodeClosed.
        """
        failed: set[str] = set()

        def called(message: Any) -> None:
            publisher = message._connection_header.get("callerid", "")
            try:
                on_message(bytes_of(message), publisher)
            except Exception as error:
                if publisher not in failed:
                    failed.add(publisher)
                    warn_of_message(topic, publisher, error)

        self._check_open()
        made = rospy.Subscriber(topic, raw_class(kind), called, buff_size=AT_ONCE, tcp_nodelay=True)
        return self._kept(_RospySubscription(self, made))

    def advertise(
        self,
        topic: str,
        kind: str,
        *,
        latched: bool = False,
        depth: int = 100,
        qos: Any = None,  # noqa: ARG002  (of ROS 2)
    ) -> Publisher:
        """Offer a topic; if it is latched, nodes that join later get its last message.

        At most `depth` messages wait for a slow subscriber. Raises InvalidArgument for a type that
        is neither installed nor known, NodeClosed.
        """
        self._check_open()
        if raw_class(kind)._md5sum == rospy.AnyMsg._md5sum:
            known_kind(kind)
        made = rospy.Publisher(topic, raw_class(kind), latch=latched, queue_size=max(1, depth))
        return self._kept(_RospyPublisher(self, made, raw_class(kind)))

    def serve(self, name: str, kind: str, answer: Callable[[bytes], bytes]) -> Service:
        """Offer a service: `answer` makes the serialized response of a serialized request.

        Each client is answered in its own thread. Raises InvalidArgument for an unknown type or a
        name that is already served, NodeClosed.
        """
        self._check_open()
        service = raw_service(kind)
        try:
            made = rospy.Service(
                name, service, lambda request: service._response_class(answer(request.data))
            )
        except rospy.ServiceException as error:  # this is its only cause
            full = rospy.resolve_name(name)
            raise InvalidArgument(f"this node already serves {full}", value=full) from error
        return self._kept(_NodeEntity(self, lambda: made.shutdown("it was closed"), native=made))

    def now(self) -> int:
        """Nanoseconds by rospy's clock."""
        found: int = rospy.get_rostime().to_nsec()
        return found

    @property
    def simulated(self) -> bool:
        """Whether `now` is simulated time."""
        return not rospy.rostime.is_wallclock()

    @property
    def closed(self) -> bool:
        """Whether this object was closed, or rospy's shutdown requested."""
        # Hooks of rospy.on_shutdown run before rospy.is_shutdown() is true.
        return self._ended or bool(rospy.core.is_shutdown_requested() or rospy.is_shutdown())

    def on_clock(self, called: Callable[[int], None]) -> Subscription:
        """Call `called(now)` whenever simulated time is set, and once when the node ends.

        If the node has already ended, call it at once.
        """
        if self.closed:
            called(self.now())
            return _NodeEntity(self, lambda: None)
        clock = the_clock()
        clock.add(called)
        return self._kept(
            _NodeEntity(self, lambda: clock.remove(called), lambda: clock.end(called))
        )

    def close(self) -> None:
        """Close the entities that were opened here."""
        with self._lock:
            self._ended = True
            opened = list(self._open)
        for each in opened:
            each.ended()
            each.close()

    def _check_open(self) -> None:
        # Shutdown hooks of the program may still publish.
        if self._ended or rospy.is_shutdown():
            raise NodeClosed(f"the node {self.name} is closed", reason="it was closed")

    def _kept(self, opened: _AnyEntity) -> _AnyEntity:
        with self._lock:
            self._open.append(opened)
        return opened


class _NodeEntity:
    """An entity that was opened in the node. Threads: any."""

    def __init__(
        self,
        node: RospyNode,
        close: Callable[[], None],
        ended: Callable[[], None] = lambda: None,
        native: Any = None,
    ) -> None:
        self.ended = ended
        """Function that is called at the end of the node."""
        self.native: Any = native
        """The object of rospy, such as its Subscriber; None: rospy has none."""
        self._node, self._close = node, close

    def close(self) -> None:
        """Close the entity. A second call does nothing."""
        with self._node._lock:
            if self not in self._node._open:
                return
            self._node._open.remove(self)
        self._close()


class _Clock:
    """Callbacks for changes of rospy's time and for its end. Threads: any."""

    def __init__(self) -> None:
        self._lock = threading.RLock()  # a signal handler may run during a call
        self._told: list[Callable[[int], None]] = []
        rospy.on_shutdown(self._set)
        if not rospy.rostime.is_wallclock():
            # rospy also subscribes to /clock, and sets its time before it calls this.
            rospy.Subscriber(CLOCK, class_of(CLOCK_KIND), self._set)

    def add(self, called: Callable[[int], None]) -> None:
        with self._lock:
            self._told.append(called)

    def remove(self, called: Callable[[int], None]) -> None:
        with self._lock:
            if called in self._told:
                self._told.remove(called)

    def end(self, called: Callable[[int], None]) -> None:
        """Call the callbacks for the end."""
        self._report_clock([called])

    def _set(self, _: Any = None) -> None:
        with self._lock:
            told = list(self._told)
        self._report_clock(told)

    def _report_clock(self, told: list[Callable[[int], None]]) -> None:
        now = rospy.get_rostime().to_nsec()
        for called in told:
            try:
                called(now)
            except Exception:
                LOG.exception("a callback of rospy's clock failed")


@cache
def the_clock() -> _Clock:
    """Return the clock of the process."""
    return _Clock()


class _RospySubscription(_NodeEntity):
    """A topic to which rospy listens. Threads: any."""

    def __init__(self, node: RospyNode, subscriber: Any) -> None:
        super().__init__(node, subscriber.unregister, native=subscriber)
        self._subscriber = subscriber

    @property
    def publishers(self) -> list[str]:
        """Names of the nodes that are connected."""
        impl = self._subscriber.impl
        return [] if impl is None else [each.callerid_pub for each in impl.connections]


class _RospyPublisher(_NodeEntity):
    """A topic that rospy publishes. Threads: any."""

    def __init__(self, node: RospyNode, publisher: Any, kind: Any) -> None:
        super().__init__(node, publisher.unregister, native=publisher)
        self._publisher, self._kind = publisher, kind

    @property
    def subscribers(self) -> list[str]:
        """Names of the nodes that are connected."""
        impl = self._publisher.impl
        return [] if impl is None else [each.endpoint_id for each in impl.connections]

    def publish(self, data: bytes) -> None:
        """Send one serialized message. Raises NodeClosed."""
        try:
            self._publisher.publish(self._kind().deserialize(data))
        except rospy.ROSException as error:
            raise NodeClosed(f"{error}", reason=f"{error}") from error


class _RawMessage:
    """Mixin of a message class that keeps the bytes, and decodes them at the first access.

    Threads: one at a time.
    """

    _whole: Any  # the plain message class
    _data: bytes | None = None  # until one of the fields is read

    def __init__(self, *fields: Any, **named: Any) -> None:
        if fields or named:  # a program creates one by `Publisher.publish(...)`
            self._whole.__init__(self, *fields, **named)
        else:
            # In place of the class's `__init__`: the fields are set when one of them is first read.
            self._data = b""

    def deserialize(self, data: bytes) -> Any:
        """Keep the bytes."""
        self._data = data
        return self

    def serialize(self, out: Any) -> None:
        """Write the bytes, or the fields if these may have changed."""
        if self._data is None:
            self._whole.serialize(self, out)
        else:
            out.write(self._data)

    def __getattr__(self, name: str) -> Any:
        if name not in self._whole.__slots__ or self._data is None:
            raise AttributeError(f"{type(self).__name__!r} has no attribute {name!r}")
        data, self._data = self._data, None
        self._whole.__init__(self)
        self._whole.deserialize(self, data)
        return getattr(self, name)

    def __reduce__(self) -> Any:
        """Make copies and pickles messages of the plain class."""
        return _remade, (self._whole, bytes_of(self))


def _remade(whole: Any, data: bytes) -> Any:
    return whole().deserialize(data)


def class_of(kind: str) -> Any:
    """Return the message class of a type: the installed one, otherwise AnyMsg."""
    package, _, name = kind.partition("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        return rospy.AnyMsg


@cache
def raw_class(kind: str) -> Any:
    """Return the message class of a type that keeps the bytes.

    It is a subclass of the installed class, so that other subscribers of rospy's connection get
    messages of their type. If none is installed, it is made from tfdb's definition of the type,
    otherwise it is AnyMsg.
    """
    whole = class_of(kind)
    if whole is rospy.AnyMsg:
        try:
            known = known_kind(kind)
        except ValueError:
            return whole
        whole = type(
            kind.rpartition("/")[2],
            (Message,),
            {
                "_type": known.name,
                "_md5sum": known.md5sum,
                "_full_text": known.definition,
                "_has_header": False,
                "__slots__": [],
                "_slot_types": [],
            },
        )
    return type(
        whole.__name__, (_RawMessage, whole), {"_whole": whole, "__module__": whole.__module__}
    )


def bytes_of(message: Any) -> bytes:
    """Return the serialized form of a rospy message."""
    kept = getattr(message, "_data", None) or getattr(message, "_buff", None)
    if kept is not None:
        data: bytes = kept
        return data
    out = io.BytesIO()
    message.serialize(out)
    return out.getvalue()


class RawRequest(Message):
    """A request in bytes."""

    __slots__ = ["data"]

    def deserialize(self, data: bytes) -> RawRequest:
        """Keep the bytes."""
        self.data: bytes = data
        return self


class RawResponse(Message):
    """A response in bytes."""

    __slots__ = ["data"]

    def __init__(self, data: bytes = b"") -> None:
        self.data: bytes = data

    def serialize(self, out: Any) -> None:
        """Write the bytes."""
        out.write(self.data)


@cache
def raw_service(kind: str) -> Any:
    """Return the class of a service with serialized requests and responses."""
    known = service_kind(kind)
    name = kind.rpartition("/")[2]
    request, response = (
        type(f"{name}{part}", (base,), {"_type": f"{kind}{part}", "__slots__": []})
        for part, base in (("Request", RawRequest), ("Response", RawResponse))
    )
    return type(
        name,
        (),
        {
            "_type": known.name,
            "_md5sum": known.md5sum,
            "_request_class": request,
            "_response_class": response,
        },
    )

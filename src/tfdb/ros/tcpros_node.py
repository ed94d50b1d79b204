"""A ROS 1 node on the standard library, without ROS packages."""

from __future__ import annotations

import os
import threading
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

from tfdb.data.errors import InvalidArgument, MasterRefused, NodeClosed, NoMaster

from .clock_messages import CLOCK, CLOCK_KIND, decode_clock
from .clocked_node import ClockedNode, open_nodes
from .loop import LOG, Loop
from .master import Master
from .message_kinds import Kind, kind_of, known_kind, service_kind
from .names import Names, anonymous, is_loopback
from .slave import SlaveServer
from .tcpros_server import AdvertisedTopic, Peer, ServedName, TcprosServer
from .tcpros_subscription import OnMessage, SubscribedTopic

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

    from .node import Encoding, Flavor, Publisher, Service, Subscription

__all__ = ["TcprosNode"]

LAST_CALLBACKS_SECONDS = 1.0
_Entry = TypeVar("_Entry", SubscribedTopic, AdvertisedTopic, ServedName)


class TcprosNode(ClockedNode):
    """A node of ROS 1: topics, services and a clock, over XML-RPC and TCPROS.

    Threads: any may call anything. Each publisher of a topic has its own receiving thread. One
    callback of a topic runs at a time, so a callback that waits delays only its own topic.
    Publishing does not wait for subscribers.

    A subscriber reconnects when its publisher comes back. The master closes a node when
    another node with its name starts. Later calls raise NodeClosed with the reason.

    Parameters
    ----------
    name
        Name without namespace; None: a unique one.
    master
        URI of the master; None: that of `__master:=` or ROS_MASTER_URI.
    arguments
        Arguments of the program, for remappings (`from:=to`, `__name:=`, `__ns:=`). None:
        `sys.argv`.

    Raises NoMaster if no master answers, InvalidName for an invalid name.
    """

    flavor: Flavor = "ros1"
    encoding: Encoding = "ros1"

    def __init__(
        self,
        name: str | None = None,
        *,
        master: str | None = None,
        arguments: Sequence[str] | None = None,
    ) -> None:
        names = Names(anonymous("tfdb") if name is None else name, arguments, os.environ)
        self._names = names
        self._master = Master(names.master if master is None else master, names.node)
        super().__init__(names.node, simulated=bool(self._master.parameter("/use_sim_time")))
        self.graph: str = f"ros1:{self._master.uri}".rstrip("/")
        """Name of its graph, such as `ros1:http://localhost:11311`."""
        self._registering = threading.RLock()  # a signal handler may close the node meanwhile
        self._subscribed: dict[str, SubscribedTopic] = {}
        self._advertised: dict[str, AdvertisedTopic] = {}
        self._senders: dict[str, list[_Publisher]] = {}
        self._served: dict[str, ServedName] = {}
        self._end = ""  # reason why the node was closed
        self._ended = threading.Event()
        self._loop = Loop(f"tfdb ROS node {self.name}")
        interface = "127.0.0.1" if is_loopback(names.host) else ""
        self._server = TcprosServer(self._loop, interface, self._accept)
        self._slave = SlaveServer(self._loop, interface, _Slave(self))
        self.uri: str = f"http://{names.host}:{self._slave.port}/"
        """URI for calls of the master and other nodes."""
        self._service_uri = f"rosrpc://{names.host}:{self._server.port}"
        self._loop.start()
        open_nodes.add(self)
        if self._simulated:
            self._take_clock()

    def __repr__(self) -> str:
        state = f", closed ({self._end})" if self._end else ""
        return f"<TcprosNode {self.name} at {self._master.uri}{state}>"

    def subscribe(
        self,
        topic: str,
        kind: str,
        on_message: OnMessage,
        *,
        latched: bool = False,  # noqa: ARG002  (the publisher says so itself)
        depth: int = 100,  # noqa: ARG002  (TCP holds what waits)
        qos: Any = None,  # noqa: ARG002  (of ROS 2)
    ) -> Subscription:
        """Call `on_message(data, publisher)` for each message of a topic, in their order.

        `data` is valid until the callback returns. No message is dropped here: while a callback
        runs, new messages wait in the connection, then at the publisher. A type with an unknown
        definition matches any publisher's. Raises InvalidName, InvalidArgument, NoMaster,
        MasterRefused, NodeClosed.
        """
        full, wanted = self._names.resolve(topic), kind_of(kind)
        with self._registering:
            with self._lock:
                self._check_open()
                there = self._subscribed.get(full)
                if there is not None:
                    _check_same(full, there.kind, wanted)
                    there.users += 1
            if there is None:
                made = SubscribedTopic(full, wanted, self.name, on_message)
                with self._adding(self._subscribed, made):
                    made.update(self._master.register_subscriber(full, wanted.name, self.uri))
        if there is not None:
            there.add(on_message)
        return _Subscription(self, full, on_message)

    def advertise(
        self,
        topic: str,
        kind: str,
        *,
        latched: bool = False,
        depth: int = 100,
        qos: Any = None,  # noqa: ARG002  (of ROS 2)
    ) -> Publisher:
        """Offer a topic. Nodes that join later get the last message of each latched publisher.

        At most `depth` messages wait for a slow subscriber; beyond that the oldest are dropped.
        Several publishers of one topic share its connections. Raises InvalidName, InvalidArgument
        for a type without definition, NoMaster, MasterRefused, NodeClosed.
        """
        full, wanted = self._names.resolve(topic), known_kind(kind)
        with self._registering:
            with self._lock:
                self._check_open()
                advertised = self._advertised.get(full)
                if advertised is not None:
                    _check_same(full, advertised.kind, wanted)
                    if latched and not advertised.latched:
                        raise InvalidArgument(
                            f"this node already publishes {full}, not latched", value=full
                        )
            if advertised is None:
                advertised = AdvertisedTopic(full, wanted, self.name, latched=latched, depth=depth)
                with self._adding(self._advertised, advertised):
                    self._master.register_publisher(full, kind, self.uri)
            publisher = _Publisher(self, advertised)
            with self._lock:
                self._senders.setdefault(full, []).append(publisher)
        return publisher

    def serve(self, name: str, kind: str, answer: Callable[[bytes], bytes]) -> Service:
        """Offer a service: `answer` makes the serialized response of a serialized request.

        `answer` is called in a thread of the service. Its exceptions are sent to the client as
        errors. Raises InvalidName, InvalidArgument for a type with an unknown definition or a name
        that is already served, NoMaster, MasterRefused, NodeClosed.
        """
        full, wanted = self._names.resolve(name), service_kind(kind)
        with self._registering:
            with self._lock:
                self._check_open()
                if full in self._served:
                    raise InvalidArgument(f"this node already serves {full}", value=full)
            with self._adding(self._served, ServedName(full, wanted, self.name, answer)):
                self._master.register_service(full, self._service_uri, self.uri)
        return _Service(self, full)

    @property
    def senders(self) -> frozenset[str]:
        """Publisher names of this node's messages at other nodes: its name."""
        return frozenset({self.name})

    @property
    def closed(self) -> bool:
        """Whether the node has ended, by `close` or by a request."""
        return bool(self._end)

    def wait_closed(self, timeout: float | None = None) -> bool:
        """Wait until the node is closed, by `close` or by the master. Return whether it is."""
        return self._ended.wait(timeout)

    def close(self) -> None:
        """Unregister everything from the master, and disconnect. A second call does nothing."""
        self._close("it was closed")

    def _close(self, why: str) -> None:
        with self._registering, self._lock:
            if self._end:
                return
            self._end = why
            subscribed = dict(self._subscribed)
            advertised = dict(self._advertised)
            served = dict(self._served)
        open_nodes.discard(self)
        self._report_clock()  # callbacks of topics may wait for the node's end
        if os.getpid() != self._process:
            self._ended.set()
            return  # a child of `fork` has no threads of the node, and its parent stays registered
        self._unregister(subscribed, advertised, served)
        for topic in subscribed.values():
            topic.close(LAST_CALLBACKS_SECONDS)
        for name in served.values():
            name.close()
        for offered in advertised.values():
            offered.close()
        self._loop.close()
        self._slave.server_close()
        self._ended.set()

    def _unregister(
        self, subscribed: Iterable[str], advertised: Iterable[str], served: Iterable[str]
    ) -> None:
        """Unregister from the master, if it still runs."""
        master = self._master
        calls: list[Callable[[], None]] = [
            *(
                lambda name=name: master.unregister_subscriber(name, self.uri)
                for name in subscribed
            ),
            *(lambda name=name: master.unregister_publisher(name, self.uri) for name in advertised),
            *(
                lambda name=name: master.unregister_service(name, self._service_uri)
                for name in served
            ),
        ]
        for unregister in calls:
            try:
                unregister()
            except NoMaster as error:
                LOG.info("%s ends without its master: %s", self.name, error)
                return
            except MasterRefused as error:
                LOG.info("%s ends: %s", self.name, error)

    def _check_open(self) -> None:
        if self._end:
            raise NodeClosed(f"the node {self.name} is closed: {self._end}", reason=self._end)

    def _take_clock(self) -> None:
        def take(data: bytes | memoryview, _: str) -> None:
            self._set_clock(decode_clock(data, cdr=False))

        try:
            self.subscribe(CLOCK, CLOCK_KIND, take)
        except Exception:
            self.close()
            raise

    @contextmanager
    def _adding(self, entries: dict[str, _Entry], entry: _Entry) -> Iterator[None]:
        """Add an entry, which the block registers at the master.

        Remove it if the master refuses it, or if a signal handler closes the node in the block.
        """
        with self._lock:
            entries[entry.name] = entry
        try:
            try:
                yield
            finally:
                if self._end:  # the master may have read the registration last
                    self._unregister(self._subscribed, self._advertised, self._served)
            self._check_open()
        except (NoMaster, MasterRefused, NodeClosed):
            with self._lock:
                del entries[entry.name]
            entry.close()
            raise

    def _accept(self, peer: Peer, fields: dict[str, str]) -> None:
        """Pass a peer to the topic or service in its header."""
        peer.name = fields.get("callerid", "?")
        with self._lock:
            wanted: AdvertisedTopic | ServedName | None
            if "service" in fields:
                wanted = self._served.get(fields["service"])
            else:
                wanted = self._advertised.get(fields.get("topic", ""))
        if wanted is None:
            what = fields.get("service") or fields.get("topic") or "nothing"
            peer.refuse(f"{self.name} does not offer {what}")
        else:
            wanted.accept(peer, fields)

    def _leave_topic(self, topic: str, on_message: OnMessage) -> None:
        with self._registering:
            with self._lock:
                subscribed = self._subscribed.get(topic)
                if self._end or subscribed is None:
                    return
                subscribed.remove(on_message)
                subscribed.users -= 1
                if subscribed.users:
                    return
                del self._subscribed[topic]
            self._unregister([topic], [], [])
        subscribed.close()

    def _leave_publisher(self, publisher: _Publisher, topic: AdvertisedTopic) -> None:
        with self._registering:
            with self._lock:
                senders = self._senders.get(topic.name, [])
                if self._end or publisher not in senders:
                    return
                senders.remove(publisher)
                topic.forget(publisher)
                if senders:
                    return
                del self._advertised[topic.name]
            self._unregister([], [topic.name], [])
        topic.close()

    def _leave_service(self, name: str) -> None:
        with self._registering:
            with self._lock:
                served = self._served.pop(name, None)
            if self._end or served is None:
                return
            self._unregister([], [], [name])
        served.close()


class _Subscription:
    """One callback of a topic. Threads: any."""

    native = None

    def __init__(self, node: TcprosNode, topic: str, on_message: OnMessage) -> None:
        self._node, self._topic = node, topic
        self._on_message: OnMessage | None = on_message

    @property
    def publishers(self) -> list[str]:
        """Names of the nodes that are connected."""
        with self._node._lock:
            topic = self._node._subscribed.get(self._topic)
        return [] if topic is None else list(topic.publishers.values())

    def close(self) -> None:
        """Stop listening."""
        on_message, self._on_message = self._on_message, None
        if on_message is not None:
            self._node._leave_topic(self._topic, on_message)


class _Publisher:
    """One sender of a topic. Threads: any."""

    native = None

    def __init__(self, node: TcprosNode, topic: AdvertisedTopic) -> None:
        self._node, self._topic = node, topic
        self._closed = False

    @property
    def subscribers(self) -> list[str]:
        """Names of the nodes that are connected."""
        return self._topic.subscribers

    def publish(self, data: bytes) -> None:
        """Send one serialized message to all subscribers. Raises NodeClosed."""
        if self._closed:
            raise NodeClosed(
                f"this publisher of {self._topic.name} is closed", value=self._topic.name
            )
        self._topic.publish(data, self)

    def close(self) -> None:
        """Close the publisher. The last publisher of a topic unregisters the topic."""
        self._closed = True
        self._node._leave_publisher(self, self._topic)


class _Service:
    """An offered service. Threads: any."""

    native = None

    def __init__(self, node: TcprosNode, name: str) -> None:
        self._node, self._name = node, name

    def close(self) -> None:
        """Unregister the service."""
        self._node._leave_service(self._name)


class _Slave:
    """Answers of the Slave API. Threads: any."""

    def __init__(self, node: TcprosNode) -> None:
        self._node = node

    def subscriptions(self) -> Mapping[str, str]:
        with self._node._lock:
            return {name: topic.kind.name for name, topic in self._node._subscribed.items()}

    def publications(self) -> Mapping[str, str]:
        with self._node._lock:
            return {name: topic.kind.name for name, topic in self._node._advertised.items()}

    def connections(self) -> list[tuple[str, str, str]]:
        with self._node._lock:
            subscribed = list(self._node._subscribed.values())
            advertised = list(self._node._advertised.values())
        return [
            *((uri, "i", topic.name) for topic in subscribed for uri in topic.publishers),
            *((peer, "o", topic.name) for topic in advertised for peer in topic.subscribers),
        ]

    def publishers_changed(self, topic: str, uris: list[str]) -> None:
        # This update is newer than the master's answer to a registration in progress.
        with self._node._registering, self._node._lock:
            subscribed = self._node._subscribed.get(topic)
        if subscribed is not None:
            subscribed.update(uris)

    def parameter_changed(self, name: str, value: object) -> None:
        LOG.debug("%s: the master reports that %s is %r", self._node.name, name, value)

    def topic_address(self, topic: str) -> tuple[str, int] | None:
        with self._node._lock:
            if topic not in self._node._advertised:
                return None
        return self._node._names.host, self._node._server.port

    def shutdown_requested(self, reason: str) -> None:
        why = f"it was ended by a request: {reason or 'no reason given'}"
        LOG.warning("%s is closed: %s", self._node.name, why)
        self._node._close(why)

    def master_uri(self) -> str:
        return self._node._master.uri


def _check_same(topic: str, there: Kind, wanted: Kind) -> None:
    if there.md5sum != wanted.md5sum:
        raise InvalidArgument(
            f"{topic} already has the type {there.name} in this node, not {wanted.name}",
            value=wanted.name,
        )

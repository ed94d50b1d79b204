"""DDS for a ROS 2 node; the only file that imports cyclonedds."""

from __future__ import annotations

import os
import re
import threading
import weakref
from typing import TYPE_CHECKING, Any

from cyclonedds._clayer import ddspy_take, ddspy_write
from cyclonedds.core import (
    DDSException,
    GuardCondition,
    InstanceState,
    Policy,
    Qos,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic as DdsTopic
from cyclonedds.util import duration

from tfdb.data.errors import InvalidArgument

from .discovery_messages import DISCOVERY, DISCOVERY_TYPE, encode_participant
from .loop import LOG
from .refusals import Refusals

if TYPE_CHECKING:
    from collections.abc import Callable

    from .ros2_names import Ros2Names
    from .wire_node import Topic

__all__ = ["DdsGraph"]

_ANY = SampleState.Any | ViewState.Any | InstanceState.Any
_AT_ONCE = 64
"""Largest number of messages that one call reads."""
_HASH = re.compile(rb"typehash=([^;]*);")
_MOST_SENDERS = 10_000
_LEAST = 16
"""Bytes of the smallest message: cyclonedds interprets a smaller one as a disposal."""
_EMPTY = 8
"""Bytes of a TFMessage without transforms."""
_COMMON = """<CycloneDDS><Domain id="any">
<Compatibility><IgnoreTypeInformation>1.15</IgnoreTypeInformation></Compatibility>
<Discovery><ParticipantIndex>auto</ParticipantIndex>
<MaxAutoParticipantIndex>32</MaxAutoParticipantIndex></Discovery>
</Domain></CycloneDDS>"""
_LOOPBACK = """<CycloneDDS><Domain id="any"><General><AllowMulticast>false</AllowMulticast>
<Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/></Interfaces></General>
<Discovery><Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""

_BLOCKS = duration(milliseconds=100)
"""Longest wait of a publisher for slow subscribers."""
_ENCLAVE = Qos(Policy.Userdata(b"enclave=/;"))
"""Without this, ROS nodes treat the participant as a program without ROS."""

_lock = threading.Lock()
_domains: weakref.WeakValueDictionary[int, Any] = weakref.WeakValueDictionary()


def _configuration() -> str:
    parts = [_COMMON]
    local = os.environ.get("ROS_LOCALHOST_ONLY") == "1"
    if local or os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "").upper() == "LOCALHOST":
        parts.append(_LOOPBACK)
    return ",".join([*parts, *filter(None, [os.environ.get("CYCLONEDDS_URI")])])


def _domain_of(number: int) -> Any:
    """Configure and open a domain of this process, once. None: the program has configured it."""
    with _lock:
        domain = _domains.get(number)
        if domain is None:
            text = _configuration()
            try:
                domain = Domain(number, text)
            except DDSException as error:
                if error.code == DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:
                    return None
                raise InvalidArgument(
                    f"DDS does not start ({error.msg}): CYCLONEDDS_URI must be a Cyclone DDS"
                    f" configuration, got {os.environ.get('CYCLONEDDS_URI', '')!r}",
                    value=text,
                ) from error
            _domains[number] = domain
        return domain


def _quality(*, latched: bool, depth: int, kind_hash: str = "") -> Any:
    durability = Policy.Durability
    policies = [
        Policy.Reliability.Reliable(_BLOCKS),
        durability.TransientLocal if latched else durability.Volatile,
        Policy.History.KeepLast(max(depth, 1)),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    ]
    if kind_hash:
        policies.append(Policy.Userdata(f"typehash={kind_hash};".encode()))
    return Qos(*policies)


def _quality_of(topic: Topic) -> Any:
    return _quality(latched=topic.latched, depth=topic.depth, kind_hash=topic.kind.hash)


class DdsGraph:
    """See `Link`. Threads: any."""

    def __init__(self, names: Ros2Names, domain: int) -> None:
        self.refusals: Refusals = Refusals()
        self.graph: str = f"ros2+dds:{domain}"
        self._names = names
        self._domain = _domain_of(domain)
        try:
            self._participant: Any = DomainParticipant(domain, qos=_ENCLAVE)
        except DDSException as error:
            text = f"DDS does not start in domain {domain}: {error.msg}"
            raise ConnectionError(text) from error
        self._topics: dict[tuple[str, str], Any] = {}
        self._lock = threading.Lock()
        self.gids: set[bytes] = set()
        self._readers: set[bytes] = set()
        self._writers: set[bytes] = set()
        self._discovery: Any = DataWriter(
            self._participant,
            self._topic(DISCOVERY, DISCOVERY_TYPE),
            _quality(latched=True, depth=1),
        )
        self._announce()

    def hear(self, topic: Topic, take: Callable[[bytes, str], None]) -> _Hearing:
        """See `Link`."""
        kind = self._topic(f"rt{topic.name}", topic.kind.wire)
        reader = DataReader(self._participant, kind, _quality_of(topic))
        end = self._announced(self._readers, reader.get_guid().bytes)
        return _Hearing(self, self._participant, topic, reader, take, end)

    def offer(self, topic: Topic) -> _Offering:
        """See `Link`."""
        kind = self._topic(f"rt{topic.name}", topic.kind.wire)
        writer = DataWriter(self._participant, kind, _quality_of(topic))
        gid = writer.get_guid().bytes
        self.gids.add(gid)
        return _Offering(writer, topic.name, self._announced(self._writers, gid))

    def close(self) -> None:
        """See `Link`."""
        with self._lock:
            self._topics.clear()
            self._participant = self._domain = self._discovery = None

    def _announced(self, endpoints: set[bytes], gid: bytes) -> Callable[[], None]:
        """Announce an endpoint to other nodes. Returns the function that announces its end."""

        def end() -> None:
            with self._lock:
                endpoints.discard(gid)
                self._announce()

        with self._lock:
            endpoints.add(gid)
            self._announce()
        return end

    def _announce(self) -> None:
        """Announce the name and the endpoints of this node to others. The lock is held."""
        if self._discovery is None:  # the graph was closed
            return
        names, gid = self._names, self._participant.get_guid().bytes
        data = encode_participant(gid, names.namespace, names.base, self._readers, self._writers)
        _write(self._discovery, data, DISCOVERY)

    def name_of(self, gid: bytes) -> str:
        """Name of the node for a publisher of this process, otherwise the publisher's gid."""
        return self._names.node if gid in self.gids else gid.hex()

    def _topic(self, name: str, kind: str) -> Any:
        """The DDS topic.

        cyclonedds passes on serialized messages unchanged, but checks them against their type. So
        each topic has a type with one byte.
        """
        key = (name, kind)
        with self._lock:
            if key not in self._topics:
                serialized = make_idl_struct("Serialized", kind, {"first": types.uint8})
                self._topics[key] = DdsTopic(self._participant, name, serialized)
            return self._topics[key]


class _Hearing:
    """A subscription, and the thread that receives. Threads: any may close it."""

    def __init__(
        self,
        graph: DdsGraph,
        participant: Any,
        topic: Topic,
        reader: Any,
        take: Callable[[bytes, str], None],
        on_end: Callable[[], None],
    ) -> None:
        self._graph, self._topic, self._take, self._on_end = graph, topic, take, on_end
        self._senders: dict[int, tuple[str, str]] = {}
        self._end = GuardCondition(participant)
        self._closed = threading.Event()
        self._thread = threading.Thread(
            target=self._run,
            args=(reader, participant),
            name=f"tfdb ROS {topic.name}",
            daemon=True,
        )
        self._thread.start()

    def close(self) -> None:
        """End it."""
        self._on_end()
        self._closed.set()
        self._end.set(True)
        if self._thread is not threading.current_thread():
            self._thread.join(1.0)  # a callback may wait

    def _run(self, reader: Any, participant: Any) -> None:
        waiting = WaitSet(participant)
        waiting.attach(ReadCondition(reader, _ANY))
        waiting.attach(self._end)
        while not self._closed.is_set():
            waiting.wait(duration(infinite=True))
            samples = ddspy_take(reader._ref, _ANY, _AT_ONCE)
            if isinstance(samples, int):
                return  # the domain was closed
            for data, info in samples:
                if self._closed.is_set():
                    return
                if info.valid_data:
                    self._hand_on(reader, data, info.publication_handle)

    def _hand_on(self, reader: Any, data: bytes, handle: int) -> None:
        sender = self._senders.get(handle)
        if sender is None:
            sender = self._sender(reader, handle)
        name, why = sender
        if why:
            self._graph.refusals.add(self._topic.name, name, why)
        else:
            # `send` pads an empty TFMessage, but the decoder of TFMessages refuses padding.
            is_short = self._topic.kind.name == "tf2_msgs/TFMessage" and len(data) == _LEAST
            is_empty = is_short and not any(data[_EMPTY:])
            self._take(data[:_EMPTY] if is_empty else data, name)

    def _sender(self, reader: Any, handle: int) -> tuple[str, str]:
        """Name of a publisher, and the reason why its messages are refused, if any."""
        endpoint = reader.get_matched_publication_data(handle)
        if endpoint is None:  # the publisher has left the graph
            return f"{handle & (1 << 64) - 1:016x}", ""
        user_data = endpoint.qos[Policy.Userdata]
        found = _HASH.search(b"" if user_data is None else user_data.data)
        wanted, why = self._topic.kind.hash, ""
        if found is not None and (their := found[1].decode(errors="replace")) != wanted:
            why = f"its type hash is {their}, expected {wanted}"
        if len(self._senders) >= _MOST_SENDERS:
            self._senders.clear()
        sender = self._graph.name_of(endpoint.key.bytes), why
        self._senders[handle] = sender
        return sender


class _Offering:
    """A publisher. Threads: one at a time."""

    def __init__(self, writer: Any, topic: str, on_end: Callable[[], None]) -> None:
        self._writer, self._topic, self._on_end = writer, topic, on_end

    def send(self, data: bytes) -> None:
        """Send a message. Slow subscribers lose it after 100 ms; the log reports this."""
        _write(self._writer, data, self._topic)

    def close(self) -> None:
        """End it."""
        self._on_end()
        self._writer = None


def _write(writer: Any, data: bytes, topic: str) -> None:
    size = max(len(data) + 3 & ~3, _LEAST)
    code = ddspy_write(writer._ref, data.ljust(size, b"\0"))
    if code < 0:
        LOG.warning("a message on %s was not sent: %s", topic, DDSException(code))

"""Zenoh for a ROS 2 node; the only file of this room that imports Zenoh."""

from __future__ import annotations

import json
import os
import threading
import time
from collections import deque
from contextlib import suppress
from itertools import count
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import xxhash
import zenoh

from tfdb.data.errors import InvalidArgument

from .refusals import Refusals
from .zenoh_keys import NO_HASH, Attachment, node_of, publishers, quality, token, topic_key

if TYPE_CHECKING:
    from collections.abc import Callable

    from .ros2_names import Ros2Names
    from .wire_node import Topic

__all__ = ["ZenohGraph"]

_ROUTER = "tcp/localhost:7447"
_CONNECT_MS = 3000
_DROP_AFTER = 100_000  # microseconds for which a publisher waits for a full link
_PATIENCE = 2.0  # seconds to wait for the tokens of a graph
_HEARTBEAT = 0.5  # seconds, as in rmw_zenoh
_MOST_NAMES = 10_000


def gid_of(text: str) -> bytes:
    """Return the gid of an endpoint: a hash of its token, as in rmw_zenoh."""
    found: int = xxhash.xxh3_128_intdigest(text.encode())
    return found.to_bytes(16, "little")


def _configuration(router: str | None) -> tuple[Any, str]:
    """Return the configuration of a session, and its router. Raises InvalidArgument."""
    file = "" if router else os.environ.get("ZENOH_SESSION_CONFIG_URI", "")
    override = os.environ.get("ZENOH_CONFIG_OVERRIDE", "")
    where = file or router or _ROUTER
    try:
        if file:
            config = zenoh.Config.from_file(urlsplit(file).path if "://" in file else file)
        else:
            config = zenoh.Config()
            for key, value in (
                ("mode", "client"),
                ("connect/endpoints", [where]),
                ("connect/timeout_ms", _CONNECT_MS),
                ("connect/exit_on_failure", True),
                ("transport/link/tx/queue/congestion_control/drop/wait_before_drop", _DROP_AFTER),
                ("scouting/multicast/enabled", False),
                ("scouting/gossip/enabled", False),
            ):
                config.insert_json5(key, json.dumps(value))
        # The cache of a publisher needs timestamps.
        config.insert_json5("timestamping/enabled", "true")
        for each in filter(None, (part.strip() for part in override.split(";"))):
            key, _, text = each.partition("=")
            config.insert_json5(key, text)
            where = text if key == "connect/endpoints" else where
    except zenoh.ZError as error:
        text = (
            "ZENOH_SESSION_CONFIG_URI must name a file of Zenoh's configuration, the router be an"
        )
        text += " endpoint such as tcp/localhost:7447, and ZENOH_CONFIG_OVERRIDE be KEY=VALUE;..."
        raise InvalidArgument(f"{text}; got {where!r} and {override!r}", value=where) from error
    return config, where


class ZenohGraph:
    """See `Link`. Threads: any."""

    def __init__(self, names: Ros2Names, domain: int, router: str | None) -> None:
        config, where = _configuration(router)
        try:
            self._session = zenoh.open(config)
        except zenoh.ZError as error:
            text = f"no Zenoh router at {where}: start one, such as 'ros2 run rmw_zenoh_cpp "
            text += "rmw_zenohd', or name it in ZENOH_CONFIG_OVERRIDE"
            raise ConnectionError(text) from error
        self.refusals: Refusals = Refusals()
        self.graph: str = f"ros2+zenoh:{domain}"
        self._names, self._domain = names, domain
        self._id = str(self._session.zid())
        self._numbers = count(1)
        self._lock = threading.Lock()
        self._nodes: dict[bytes, str] = {}
        self.gids: set[bytes] = set()
        node = token(domain, self._id, 0, "NN", names.namespace, names.base)
        self._token = self._session.liveliness().declare_token(node)

    def hear(self, topic: Topic, take: Callable[[bytes, str], None]) -> _Hearing:
        """See `Link`."""
        key = f"{self._domain}/{topic.name.strip('/')}/*/*"
        hearing = _Hearing(self, topic, take)
        if topic.latched:
            subscriber = zenoh.ext.declare_advanced_subscriber(
                self._session,
                key,
                hearing.put,
                history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
                recovery=zenoh.ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
                subscriber_detection=True,
            )
        else:
            subscriber = self._session.declare_subscriber(key, hearing.put)
        live = self._session.liveliness().declare_token(self._endpoint("MS", topic))
        hearing.begin(live, subscriber)
        return hearing

    def offer(self, topic: Topic) -> _Offering:
        """See `Link`."""
        key, text = topic_key(self._domain, topic.name, topic.kind), self._endpoint("MP", topic)
        drop = zenoh.CongestionControl.DROP
        if topic.latched:
            publisher = zenoh.ext.declare_advanced_publisher(
                self._session,
                key,
                congestion_control=drop,
                cache=zenoh.ext.CacheConfig(max(topic.depth, 1)),
                sample_miss_detection=zenoh.ext.MissDetectionConfig(
                    heartbeat=None, sporadic_heartbeat=_HEARTBEAT
                ),
                publisher_detection=True,
            )
        else:
            publisher = self._session.declare_publisher(key, congestion_control=drop)
        gid = gid_of(text)
        with self._lock:
            self.gids.add(gid)
        return _Offering(publisher, self._session.liveliness().declare_token(text), gid)

    def close(self) -> None:
        """See `Link`."""
        with suppress(zenoh.ZError):  # Zenoh's own timeout has passed
            self._session.close()

    def key_of(self, topic: Topic) -> str:
        """Return the key for a topic's messages of the wanted type."""
        return topic_key(self._domain, topic.name, topic.kind)

    def node_of(self, gid: bytes) -> str:
        """Return the name of a publisher's node, or its gid if it has no token.

        Also return the gid if another node has the name of this one.
        """
        if gid in self.gids:
            return self._names.node
        found = self._nodes.get(gid)
        if found is None:
            with self._lock:
                if len(self._nodes) >= _MOST_NAMES:
                    self._nodes.clear()
            self._ask()
            found = self._nodes.setdefault(gid, gid.hex())
        return found

    def _ask(self) -> None:
        """Query the tokens of publishers."""
        with suppress(zenoh.ZError):  # the session was closed
            replies: Any = self._session.liveliness().get(
                publishers(self._domain), timeout=_PATIENCE
            )
            for reply in replies:
                if reply.ok is not None:
                    text = str(reply.ok.key_expr)
                    with suppress(ValueError):  # a token with a newer layout
                        gid, name = gid_of(text), node_of(text)
                        self._nodes[gid] = gid.hex() if name == self._names.node else name

    def _endpoint(self, role: str, topic: Topic) -> str:
        names, number = self._names, next(self._numbers)
        return token(
            self._domain,
            self._id,
            number,
            role,
            names.namespace,
            names.base,
            topic.name,
            topic.kind.wire,
            topic.kind.hash,
            quality(latched=topic.latched, depth=topic.depth),
        )


class _Hearing:
    """A subscription, and the thread that receives. Threads: any may close it."""

    def __init__(self, graph: ZenohGraph, topic: Topic, take: Callable[[bytes, str], None]) -> None:
        self._graph, self._topic, self._take = graph, topic, take
        self._declared: tuple[Any, ...] = ()
        self._is_closed = False
        # Beyond this number of messages, the oldest are dropped.
        self._waiting: deque[Any] = deque(maxlen=max(topic.depth, 1))
        self._wake = threading.Condition()
        self._key = graph.key_of(topic)
        self._thread = threading.Thread(
            target=self._run, name=f"tfdb ROS {topic.name}", daemon=True
        )

    def begin(self, *declared: Any) -> None:
        """Pass on samples, until `close` ends the declarations."""
        self._declared = declared
        self._thread.start()

    def close(self) -> None:
        """End it."""
        with self._wake:
            self._is_closed = True
            self._wake.notify()
        _take_back(*self._declared)
        if self._thread is not threading.current_thread():
            self._thread.join(1.0)  # a callback may wait

    def put(self, sample: Any) -> None:
        """Pass a sample to the thread. A thread of Zenoh calls it."""
        with self._wake:
            self._waiting.append(sample)
            self._wake.notify()

    def _run(self) -> None:
        while True:
            with self._wake:
                while not (self._waiting or self._is_closed):
                    self._wake.wait()
                if self._is_closed:
                    return
                sample = self._waiting.popleft()
            key = str(sample.key_expr)
            if not self._is_wanted(key):
                continue
            attached = sample.attachment
            try:
                attachment = Attachment.decode(b"" if attached is None else attached.to_bytes())
            except ValueError as error:
                self._graph.refusals.add(self._topic.name, key, str(error))
                continue
            self._take(sample.payload.to_bytes(), self._graph.node_of(attachment.gid))

    def _is_wanted(self, key: str) -> bool:
        if key == self._key:
            return True
        kind = self._topic.kind
        name, found = key.split("/")[-2:]
        if (name, found) == (kind.wire, NO_HASH):
            return True
        why = f"its type is {name} with hash {found}, expected {kind.wire} with hash {kind.hash}"
        self._graph.refusals.add(self._topic.name, key, why)
        return False


class _Offering:
    """A publisher. Threads: one at a time."""

    def __init__(self, publisher: Any, live: Any, gid: bytes) -> None:
        self._publisher, self._live, self._gid = publisher, live, gid
        self._sent = 0

    def send(self, data: bytes) -> None:
        """Send a message."""
        self._sent += 1
        attachment = Attachment(self._sent, time.time_ns(), self._gid)
        self._publisher.put(data, attachment=attachment.encode())

    def close(self) -> None:
        """End it."""
        _take_back(self._live, self._publisher)


def _take_back(*declared: Any) -> None:
    for each in declared:
        with suppress(zenoh.ZError):  # the session was closed before
            each.undeclare()

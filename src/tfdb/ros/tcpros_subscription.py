"""A subscription of a ROS 1 node: one connection to each publisher."""

from __future__ import annotations

import logging
import socket
import threading
import time
from functools import partial
from typing import TYPE_CHECKING, TypeAlias

from tfdb.data.errors import TfdbError

from .loop import LOG, warn_of_message
from .master import CALL_ERRORS, TIMEOUT, call
from .tcpros import MESSAGE_LIMIT, Frames, encode_header, receive_header

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from .message_kinds import Kind

__all__ = ["OnMessage", "SubscribedTopic"]

OnMessage: TypeAlias = "Callable[[bytes | memoryview, str], None]"

FIRST_PAUSE, LONGEST_PAUSE = 0.05, 5.0  # seconds between two attempts to connect
ANY = "*"
# The loss of a publisher's machine is detected after about two and a half minutes.
KEEP_ALIVE = {"TCP_KEEPIDLE": 60, "TCP_KEEPINTVL": 10, "TCP_KEEPCNT": 9}


class _RefusedError(Exception):
    """A publisher refused the connection, or sends another type; the text is the reason."""


class Link:
    """A connection to one publisher; if it ends, it is opened again.

    Threads: it receives in its own thread; any may call `start` and `close`.
    """

    def __init__(self, topic: SubscribedTopic, uri: str) -> None:
        self.publisher: str = ""
        """Name of the publisher's node, once its header has arrived."""
        self.connected: bool = False
        """Whether the connection is open."""
        self.last: bytes | None = None
        """The last message of a latching publisher."""
        self._topic, self._uri = topic, uri
        self._told: set[str] = set()
        self._latching = False
        self._connection: socket.socket | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(
            target=self._run, name=f"tfdb ROS {topic.name} of {uri}", daemon=True
        )

    def start(self) -> None:
        """Connect."""
        self._thread.start()

    def close(self) -> None:
        """Disconnect; `join` waits for the end of the thread."""
        self._closing.set()
        connection = self._connection
        if connection is not None:
            try:
                connection.shutdown(socket.SHUT_RDWR)
            except OSError as error:
                LOG.debug("%s had ended before: %s", self._uri, error)

    def join(self, seconds: float) -> None:
        """Wait for the thread, unless it is the calling one."""
        if self._thread.ident is not None and self._thread is not threading.current_thread():
            self._thread.join(seconds)

    def _run(self) -> None:
        pause = FIRST_PAUSE
        while not self._closing.is_set():
            try:
                with self._connect() as connection:
                    self._connection = connection
                    connection.sendall(self._topic.header)
                    self._check(receive_header(connection, TIMEOUT))
                    pause = FIRST_PAUSE
                    self.connected = True
                    if not self._closing.is_set():
                        self._receive(connection)
            except Exception as error:
                self._log_error(error)
            self.connected, self._connection = False, None
            if self._closing.wait(pause):
                return
            pause = min(2 * pause, LONGEST_PAUSE)

    def _log_error(self, error: Exception) -> None:
        """Log the end of a connection, each kind once."""
        if self._closing.is_set():
            return
        kind = f"{type(error).__name__}: {error}"
        unexpected = not isinstance(error, (*CALL_ERRORS, TfdbError, _RefusedError))
        if kind not in self._told or unexpected:
            # A missing publisher is usual, because the master still lists killed nodes.
            LOG.log(
                logging.INFO if isinstance(error, ConnectionRefusedError) else logging.WARNING,
                "%s of %s: %s; retrying; logged once",
                self._topic.name,
                self.publisher or self._uri,
                error,
                exc_info=unexpected,
            )
        if len(self._told) < 100:
            self._told.add(kind)

    def _connect(self) -> socket.socket:
        """Request the address of the topic from the publisher, and connect."""
        topic = self._topic
        code, message, value = call(self._uri, "requestTopic", topic.node, topic.name, [["TCPROS"]])
        if code != 1:
            raise _RefusedError(f"the publisher at {self._uri} does not offer it: {message}")
        if not (isinstance(value, list) and len(value) >= 3 and value[0] == "TCPROS"):
            raise _RefusedError(f"the publisher at {self._uri} has no TCPROS, but {value!r}")
        connection = socket.create_connection((str(value[1]), int(value[2])), timeout=TIMEOUT)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for option, number in KEEP_ALIVE.items():
            if hasattr(socket, option):
                connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), number)
        return connection

    def _check(self, header: dict[str, str]) -> None:
        self.publisher = header.get("callerid", self.publisher)
        if "error" in header:
            raise _RefusedError(f"the publisher refuses: {header['error']}")
        wanted, found = self._topic.kind.md5sum, header.get("md5sum", "")
        if found != wanted and ANY not in {found, wanted}:
            raise _RefusedError(
                f"it sends {header.get('type', '?')} of md5sum {found or '?'}, but"
                f" {self._topic.kind.name} of md5sum {wanted} is expected"
            )
        self._latching = header.get("latching") == "1"

    def _receive(self, connection: socket.socket) -> None:
        keeper = self if self._latching else None
        deliver = partial(self._topic.deliver, self.publisher, keeper)
        frames = Frames(MESSAGE_LIMIT)
        while frames.fill(connection):
            frames.each(deliver)


class SubscribedTopic:
    """A topic with its publishers, and its subscribers in this process.

    Threads: any. One callback runs at a time, in the thread of the connection that received the
    message. A callback that waits delays only this topic.
    """

    def __init__(self, name: str, kind: Kind, node: str, callback: OnMessage) -> None:
        self.name = name
        """Full name of the topic."""
        self.kind = kind
        """Type of its messages."""
        self.node = node
        """Full name of the node."""
        self.users = 1
        """Number of subscribers, including those that are being added; the node counts them."""
        self.header: bytes = encode_header(
            {
                "callerid": node,
                "md5sum": kind.md5sum,
                "message_definition": kind.definition,
                "tcp_nodelay": "1",
                "topic": name,
                "type": kind.name,
            }
        )
        """The header for each publisher."""
        self._turn = threading.RLock()  # guards the callbacks
        self._lock = threading.RLock()  # guards the links and changes of the callbacks
        self._callbacks: tuple[OnMessage, ...] = (callback,)
        self._failed: set[tuple[OnMessage, str]] = set()
        self._links: dict[str, Link] = {}
        self._closed = False

    @property
    def publishers(self) -> dict[str, str]:
        """Name of each connected publisher's node by its URI."""
        with self._lock:
            return {uri: link.publisher for uri, link in self._links.items() if link.connected}

    def deliver(self, publisher: str, keeper: Link | None, data: memoryview) -> None:
        """Call all callbacks with a message; `keeper` stores it for later callbacks.

        Their exceptions are logged once for each publisher.
        """
        with self._turn:
            if keeper is not None:
                keeper.last = bytes(data)
            for callback in self._callbacks:
                try:
                    callback(data, publisher)
                except Exception as error:
                    self._log_error(error, callback, publisher)

    def add(self, callback: OnMessage) -> None:
        """Add a callback, and call it at once with the last messages of latching publishers."""
        with self._turn:
            with self._lock:
                self._callbacks = (*self._callbacks, callback)
                kept = [(link.last, link.publisher) for link in self._links.values()]
            for data, publisher in kept:
                if data is not None:
                    try:
                        callback(data, publisher)
                    except Exception as error:
                        self._log_error(error, callback, publisher)

    def remove(self, callback: OnMessage) -> None:
        """Remove a callback."""
        with self._lock:
            kept = list(self._callbacks)
            if callback in kept:
                kept.remove(callback)
            self._callbacks = tuple(kept)

    def update(self, uris: Iterable[str]) -> None:
        """Connect to these publishers only."""
        with self._lock:
            wanted = dict.fromkeys(uris)
            gone = [self._links.pop(uri) for uri in list(self._links) if uri not in wanted]
            new = {uri: Link(self, uri) for uri in wanted if uri not in self._links}
            self._links.update(new)
        if self._closed:  # before, or by a signal handler meanwhile
            self.close()
        for link in gone:
            link.close()
        for link in new.values():
            link.start()

    def close(self, seconds: float = 0.0) -> None:
        """Disconnect from all publishers; wait up to that time for running callbacks."""
        with self._lock:
            self._closed = True
            links, self._links = list(self._links.values()), {}
        for link in links:
            link.close()
        until = time.monotonic() + seconds
        for link in links:
            link.join(max(0.0, until - time.monotonic()))

    def _log_error(self, error: Exception, callback: OnMessage, publisher: str) -> None:
        told = (callback, publisher) in self._failed
        if told or len(self._failed) >= 1000:
            return
        self._failed.add((callback, publisher))
        warn_of_message(self.name, publisher, error)

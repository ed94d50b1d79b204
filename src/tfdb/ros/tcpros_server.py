"""Peers of a ROS 1 node: the subscribers of its topics and the clients of its services."""

from __future__ import annotations

import queue
import selectors
import socket
import threading
from collections import deque
from typing import TYPE_CHECKING

from tfdb.data.errors import CorruptMessage, NodeClosed

from .loop import LOG
from .tcpros import HEADER_LIMIT, MESSAGE_LIMIT, Frames, decode_header, encode_header, frame

if TYPE_CHECKING:
    from collections.abc import Callable

    from .loop import Loop
    from .message_kinds import Kind

__all__ = ["AdvertisedTopic", "ServedName", "TcprosServer"]

HANDSHAKE_SECONDS = 10.0
NO_ROOM_SECONDS = (
    1.0  # seconds between two attempts to accept if the process has no free descriptor
)
FIRST_SIZE = 1 << 12  # size of a peer's buffer; most peers send only a header
ANY = "*"


class Peer:
    """A connection that another node opened to this one. It never blocks this node.

    Threads: any may call `send` and `close`; only the loop's thread calls the others.
    """

    def __init__(self, loop: Loop, connection: socket.socket) -> None:
        self.name: str = ""
        """Name of the connected node, once its header has arrived."""
        self.dropped: int = 0
        """Number of dropped frames, because the peer was too slow."""
        self._loop, self._connection = loop, connection
        self._lock = threading.RLock()  # a signal handler may close the node in any call
        self._waiting: deque[bytes] = deque()
        self._begun: memoryview | None = None  # the rest of the frame that is being sent
        self._blocked = self._closed = False
        self._frames = Frames(HEADER_LIMIT, FIRST_SIZE)
        self._on_frame: Callable[[memoryview], None] | None = None
        self._on_close: Callable[[Peer], None] | None = None

    def begin(self, on_header: Callable[[Peer, dict[str, str]], None]) -> None:
        """Wait some seconds for its header, and pass the header on."""
        self._on_frame = lambda data: on_header(self, decode_header(data))
        self._loop.watch(self._connection, selectors.EVENT_READ, self._ready)
        self._loop.later(HANDSHAKE_SECONDS, self._refuse_without_header)

    def go_on(
        self,
        header: bytes,
        depth: int | None,
        on_frame: Callable[[memoryview], None] | None,
        on_close: Callable[[Peer], None],
    ) -> None:
        """Answer its header. From now on at most `depth` frames wait; the oldest are dropped.

        `on_frame` is called with its frames; None: they are ignored.
        """
        self._begun = memoryview(header)
        self._waiting = deque(maxlen=depth)
        self._on_frame, self._on_close = on_frame, on_close
        self._frames.limit = MESSAGE_LIMIT
        self.name = self.name or "?"
        self.send(None)

    def refuse(self, reason: str) -> None:
        """Send the reason of the refusal, if that is possible at once, and close."""
        LOG.warning("refused a connection of %s: %s", self.name or "a peer", reason)
        try:
            self._connection.send(encode_header({"error": reason}))
        except OSError as error:
            LOG.debug("the reason could not be sent: %s", error)
        self.close()

    def send(self, data: bytes | None) -> None:
        """Send a frame, now or when the socket has space. None: send the waiting frames."""
        with self._lock:
            if self._closed:
                return
            if data is not None:
                if len(self._waiting) == self._waiting.maxlen:
                    self.dropped += 1
                    if self.dropped == 1:
                        LOG.warning(
                            "%s receives messages too slowly: the oldest are dropped", self.name
                        )
                self._waiting.append(data)
            if self._blocked:
                return
            self._blocked = True  # a signal handler that sends meanwhile only appends
            try:
                self._blocked = not self._flush()
            except OSError:
                self._loop.soon(self.close)
                return
            if self._blocked:
                self._loop.soon(self._watch_writable)

    def close(self) -> None:
        """End it."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        self._loop.soon(lambda: self._loop.forget(self._connection))
        if self._on_close is not None:
            self._on_close(self)

    def _flush(self) -> bool:
        """Send until no frame waits (True) or the socket is full (False)."""
        while True:
            if self._begun is None:
                if not self._waiting:
                    return True
                self._begun = memoryview(self._waiting.popleft())
            try:
                sent = self._connection.send(self._begun)
            except BlockingIOError:
                return False
            self._begun = self._begun[sent:] if sent < len(self._begun) else None

    def _watch_writable(self) -> None:
        if not self._closed:
            both = selectors.EVENT_READ | selectors.EVENT_WRITE
            self._loop.watch(self._connection, both, self._ready)

    def _ready(self, events: int) -> None:
        try:
            if events & selectors.EVENT_WRITE:
                self._send_waiting()
            if events & selectors.EVENT_READ:
                self._receive()
        except (OSError, CorruptMessage) as error:
            LOG.debug("the connection of %s ends: %s", self.name or "a peer", error)
            self.close()

    def _send_waiting(self) -> None:
        with self._lock:
            self._blocked = not self._flush()
            if not self._blocked:
                self._loop.watch(self._connection, selectors.EVENT_READ, self._ready)

    def _receive(self) -> None:
        if self._frames.fill(self._connection) == 0:
            self.close()
            return
        self._frames.each(self._take)

    def _take(self, data: memoryview) -> None:
        if self._on_frame is not None and not self._closed:
            self._on_frame(data)

    def _refuse_without_header(self) -> None:
        if self._on_close is None and not self._closed:
            self.refuse(f"no header came within {HANDSHAKE_SECONDS:g} s")


class AdvertisedTopic:
    """A topic that the node publishes.

    Threads: any. `publish` does not wait for subscribers. At most `depth` frames of a subscriber
    wait (beyond that the oldest are dropped), and the loop's thread sends them.
    """

    def __init__(self, name: str, kind: Kind, node: str, *, latched: bool, depth: int) -> None:
        self.name = name
        """Full name of the topic."""
        self.kind = kind
        """Type of its messages."""
        self.latched = latched
        """Whether nodes that join later get the last message."""
        self.depth: int = max(1, depth)
        """Largest number of waiting messages per subscriber."""
        self._header = encode_header(
            {
                "callerid": node,
                "latching": "1" if latched else "0",
                "md5sum": kind.md5sum,
                "message_definition": kind.definition,
                "topic": name,
                "type": kind.name,
            }
        )
        self._lock = threading.RLock()  # as in Peer
        self._peers: list[Peer] = []
        self._last: dict[object, bytes] = {}
        self._closed = False

    @property
    def subscribers(self) -> list[str]:
        """Names of the nodes that are connected."""
        with self._lock:
            return [peer.name for peer in self._peers]

    def publish(self, data: bytes, sender: object) -> None:
        """Send one message to all; store the last one of each sender. Raises NodeClosed."""
        whole = frame(data)
        with self._lock:
            if self._closed:
                raise NodeClosed(f"{self.name} is not published any more", value=self.name)
            if self.latched:
                self._last[sender] = whole
            for peer in self._peers:
                peer.send(whole)

    def accept(self, peer: Peer, fields: dict[str, str]) -> None:
        """Accept a subscriber by its header."""
        wanted = fields.get("md5sum", "")
        if wanted not in {ANY, self.kind.md5sum}:
            peer.refuse(
                f"{self.name} has messages {self.kind.name} of md5sum {self.kind.md5sum}, but the"
                f" subscriber expects {fields.get('type', '?')} of md5sum {wanted or '?'}"
            )
            return
        with self._lock:
            if self._closed:
                peer.refuse(f"{self.name} is not published any more")
                return
            peer.go_on(self._header, self.depth, None, self._forget)
            self._peers.append(peer)
            for whole in self._last.values():
                peer.send(whole)

    def forget(self, sender: object) -> None:
        """Drop its last message."""
        with self._lock:
            self._last.pop(sender, None)

    def close(self) -> None:
        """End all connections."""
        with self._lock:
            self._closed = True
            peers, self._peers = self._peers, []
        for peer in peers:
            peer.close()

    def _forget(self, peer: Peer) -> None:
        with self._lock:
            if peer in self._peers:
                self._peers.remove(peer)


class ServedName:
    """A service of the node, which answers one request at a time in its own thread.

    Threads: any.
    """

    def __init__(self, name: str, kind: Kind, node: str, answer: Callable[[bytes], bytes]) -> None:
        self.name = name
        """Full name of the service."""
        self._md5sum = kind.md5sum
        self._header = encode_header(
            {
                "callerid": node,
                "md5sum": kind.md5sum,
                "request_type": f"{kind.name}Request",
                "response_type": f"{kind.name}Response",
                "service": name,
                "type": kind.name,
            }
        )
        self._answer = answer
        self._asked: queue.SimpleQueue[tuple[Peer, bytes] | None] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._peers: dict[Peer, bool] = {}  # whether a request of this client is in progress
        threading.Thread(target=self._run, name=f"tfdb ROS service {name}", daemon=True).start()

    def accept(self, peer: Peer, fields: dict[str, str]) -> None:
        """Accept a client by its header."""
        wanted = fields.get("md5sum", "")
        if wanted not in {ANY, self._md5sum}:
            peer.refuse(
                f"{self.name} has the md5sum {self._md5sum}, but the client expects {wanted or '?'}"
            )
            return
        with self._lock:
            self._peers[peer] = False
        peer.go_on(self._header, None, lambda data: self._ask(peer, data), self._forget)

    def close(self) -> None:
        """Stop answering."""
        self._asked.put(None)
        with self._lock:
            peers, self._peers = list(self._peers), {}
        for peer in peers:
            peer.close()

    def _ask(self, peer: Peer, data: memoryview) -> None:
        with self._lock:
            waits = self._peers.get(peer, True)
            self._peers[peer] = True
        if waits:
            # Clients wait for an answer before the next request. Others could fill the memory.
            peer.close()
        else:
            self._asked.put((peer, bytes(data)))

    def _run(self) -> None:
        while (asked := self._asked.get()) is not None:
            peer, request = asked
            try:
                answered = b"\x01" + frame(self._answer(request))
            except Exception as error:
                LOG.exception("service %s failed", self.name)
                answered = b"\x00" + frame(str(error).encode())
            with self._lock:
                if peer in self._peers:
                    self._peers[peer] = False
            peer.send(answered)

    def _forget(self, peer: Peer) -> None:
        with self._lock:
            self._peers.pop(peer, None)


class TcprosServer:
    """The port of a node for connections to its topics and services.

    Threads: any may read `address`; only the loop's thread calls the others.

    Parameters
    ----------
    loop
        The loop that handles all connections.
    host
        Interface to listen on; "": all interfaces.
    accept
        Called with each peer and the fields of its header.
    """

    def __init__(
        self, loop: Loop, host: str, accept: Callable[[Peer, dict[str, str]], None]
    ) -> None:
        self._loop, self._accept = loop, accept
        self._listener = socket.create_server((host, 0), backlog=128)
        self._listener.setblocking(False)  # noqa: FBT003
        self.port: int = self._listener.getsockname()[1]
        """Port on which it listens."""
        self._watch()

    def _watch(self) -> None:
        self._loop.watch(self._listener, selectors.EVENT_READ, self._ready)

    def _ready(self, _: int) -> None:
        try:
            connection, _address = self._listener.accept()
        except BlockingIOError:
            return
        except OSError as error:
            LOG.warning("no connection is accepted for %g s: %s", NO_ROOM_SECONDS, error)
            self._loop.leave(self._listener)
            self._loop.later(NO_ROOM_SECONDS, self._watch)
            return
        connection.setblocking(False)  # noqa: FBT003
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        Peer(self._loop, connection).begin(self._accept)

"""The Slave API: XML-RPC requests to a ROS 1 node.

It is described at https://wiki.ros.org/ROS/Slave_API.
"""

from __future__ import annotations

import inspect
import os
import selectors
from socketserver import ThreadingMixIn
from typing import TYPE_CHECKING, Any, Protocol
from xmlrpc.server import SimpleXMLRPCRequestHandler, SimpleXMLRPCServer

from .loop import LOG

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from .loop import Loop

__all__ = ["SlaveNode", "SlaveServer"]

REQUEST_LIMIT = 16 << 20
SILENCE_SECONDS = 20.0  # seconds to wait for an incomplete request
TOO_LARGE = 413
DONE, REFUSED, FAILED = 1, 0, -1
METHODS = {
    "getBusStats": "_bus_stats",
    "getBusInfo": "_bus_info",
    "getMasterUri": "_master_uri",
    "shutdown": "_shutdown",
    "getPid": "_pid",
    "getSubscriptions": "_subscriptions",
    "getPublications": "_publications",
    "paramUpdate": "_param_update",
    "publisherUpdate": "_publisher_update",
    "requestTopic": "_request_topic",
}


class SlaveNode(Protocol):
    """Interface of a node to the requests of its peers."""

    def subscriptions(self) -> Mapping[str, str]:
        """Types of the subscribed topics."""

    def publications(self) -> Mapping[str, str]:
        """Types of the published topics."""

    def connections(self) -> Iterable[tuple[str, str, str]]:
        """Peer, direction (`i` or `o`) and topic of each connection."""

    def publishers_changed(self, topic: str, uris: list[str]) -> None:
        """The master reports the publishers of a topic."""

    def parameter_changed(self, name: str, value: object) -> None:
        """The master reports a new value of a parameter."""

    def topic_address(self, topic: str) -> tuple[str, int] | None:
        """Return the address for subscribers of a topic; None if the topic is not published."""

    def shutdown_requested(self, reason: str) -> None:
        """The master, or a tool, ends the node."""

    def master_uri(self) -> str:
        """URI of its master."""


class _Handler(SimpleXMLRPCRequestHandler):
    """One request."""

    rpc_paths = ("/", "/RPC2")
    timeout = SILENCE_SECONDS

    def do_POST(self) -> None:  # noqa: N802  (the name above)
        """Answer the request, unless it is too large."""
        length = self.headers.get("content-length", "")
        if not length.isdecimal() or int(length) > REQUEST_LIMIT:
            self.send_error(TOO_LARGE)
            return
        super().do_POST()
        self.wfile.flush()
        if isinstance(self.server, SlaveServer):
            self.server.was_answered()

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002  (the name above)
        LOG.debug("XML-RPC: %s", format % args)


class SlaveServer(ThreadingMixIn, SimpleXMLRPCServer):
    """Answers requests of the master and other nodes, each in a thread.

    Threads: `port` any; the loop's thread accepts.
    """

    daemon_threads = True
    allow_reuse_address = False
    request_queue_size = 128

    def __init__(self, loop: Loop, host: str, node: SlaveNode) -> None:
        super().__init__((host, 0), _Handler, logRequests=False)
        self.socket.setblocking(False)  # noqa: FBT003
        self.port: int = self.server_address[1]
        """Port on which it listens."""
        self._node = node
        self._told_to_end: str | None = None
        loop.watch(self.socket, selectors.EVENT_READ, lambda _: self.handle_request())

    def handle_error(self, request: Any, client_address: Any) -> None:  # noqa: ARG002
        """Log the error of a request, which concerns the peer only."""
        LOG.debug("XML-RPC request of %s failed", client_address, exc_info=True)

    def _dispatch(self, method: str, params: Iterable[Any]) -> list[Any]:
        if method not in METHODS:
            return [FAILED, f"unknown method {method!r}", 0]
        answer = getattr(self, METHODS[method])
        _caller, *arguments = (*params,) or ("",)
        try:
            inspect.signature(answer).bind(*arguments)
        except TypeError:
            return [FAILED, f"{method} does not take {len(arguments) + 1} arguments", 0]
        found: list[Any] = answer(*arguments)
        return found

    def _bus_stats(self) -> list[Any]:
        return [DONE, "", [[], [], []]]

    def _bus_info(self) -> list[Any]:
        rows = [
            [number, peer, direction, "TCPROS", topic, True]
            for number, (peer, direction, topic) in enumerate(self._node.connections())
        ]
        return [DONE, "", rows]

    def _master_uri(self) -> list[Any]:
        return [DONE, "", self._node.master_uri()]

    def was_answered(self) -> None:
        """End the node after a shutdown request, once its answer is sent."""
        reason, self._told_to_end = self._told_to_end, None
        if reason is not None:
            self._node.shutdown_requested(reason)

    def _shutdown(self, reason: object = "") -> list[Any]:
        self._told_to_end = str(reason)
        return [DONE, "shutdown", 0]

    def _pid(self) -> list[Any]:
        return [DONE, "", os.getpid()]

    def _subscriptions(self) -> list[Any]:
        return [DONE, "", [list(each) for each in self._node.subscriptions().items()]]

    def _publications(self) -> list[Any]:
        return [DONE, "", [list(each) for each in self._node.publications().items()]]

    def _param_update(self, name: object, value: object) -> list[Any]:
        self._node.parameter_changed(str(name), value)
        return [DONE, "", 0]

    def _publisher_update(self, topic: object, publishers: object) -> list[Any]:
        if not isinstance(publishers, list):
            return [FAILED, "publishers are a list of URIs", 0]
        self._node.publishers_changed(str(topic), [str(uri) for uri in publishers])
        return [DONE, "", 0]

    def _request_topic(self, topic: object, protocols: object) -> list[Any]:
        address = self._node.topic_address(str(topic))
        if address is None:
            return [FAILED, f"{topic} is not published here", 0]
        wanted = protocols if isinstance(protocols, list) else []
        if not any(isinstance(each, list) and each[:1] == ["TCPROS"] for each in wanted):
            return [REFUSED, "TCPROS is the only protocol here", 0]
        return [DONE, "", ["TCPROS", *address]]

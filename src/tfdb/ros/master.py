"""XML-RPC calls of a ROS 1 node: to the master, and to the publishers of a topic.

The interfaces are those of https://wiki.ros.org/ROS/Master_API and Slave_API.
"""

from __future__ import annotations

import http.client
import xmlrpc.client
from typing import TYPE_CHECKING, Any
from xml.parsers import expat

from tfdb.data.errors import MasterRefused, NoMaster

from .names import host_and_port

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["CALL_ERRORS", "TIMEOUT", "Master", "call"]

TIMEOUT = 10.0
"""Timeout in seconds for each step of an answer."""
ANSWER_LIMIT = 16 << 20
SUCCESS = 1
CALL_ERRORS = (OSError, http.client.HTTPException, xmlrpc.client.Error, expat.ExpatError)
"""Exceptions of a call to a missing peer, or to one that violates the protocol."""


class _Transport(xmlrpc.client.Transport):
    """HTTP with a timeout for a silent peer, and a limit for long answers."""

    accept_gzip_encoding = False

    def make_connection(self, host: Any) -> http.client.HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = TIMEOUT
        return connection

    def parse_response(self, response: http.client.HTTPResponse) -> Any:
        body = response.read(ANSWER_LIMIT + 1)
        if len(body) > ANSWER_LIMIT:
            raise http.client.HTTPException(f"an answer of more than {ANSWER_LIMIT} bytes")
        parser, unmarshaller = self.getparser()
        parser.feed(body)
        parser.close()
        return unmarshaller.close()


def call(uri: str, method: str, *arguments: Any) -> tuple[int, str, Any]:
    """Call a master or a node: code (1: done), message, value. Raises one of CALL_ERRORS."""
    host_and_port(uri)
    with xmlrpc.client.ServerProxy(uri, transport=_Transport()) as peer:
        answer: Any = getattr(peer, method)(*arguments)
    if not (isinstance(answer, list) and len(answer) == 3 and isinstance(answer[0], int)):
        raise xmlrpc.client.ResponseError(
            f"{method} at {uri} did not answer with code, message and value"
        )
    return answer[0], str(answer[1]), answer[2]


class Master:
    """The master of a graph, for the calls of one node.

    Threads: any; each call opens its own connection.

    Every call raises NoMaster if no master answers, and MasterRefused if it refuses.
    """

    def __init__(self, uri: str, node: str) -> None:
        self.uri = uri
        """URI of the master."""
        self._node = node

    def _ask(self, method: str, *arguments: Any) -> tuple[int, str, Any]:
        try:
            return call(self.uri, method, self._node, *arguments)
        except CALL_ERRORS as error:
            raise NoMaster(
                f"no ROS master answers at {self.uri} ({error}): start `roscore`, or set"
                " ROS_MASTER_URI to the URI of a running one",
                uri=self.uri,
                reason=str(error),
            ) from error

    def _done(self, method: str, *arguments: Any) -> Any:
        code, message, value = self._ask(method, *arguments)
        if code != SUCCESS:
            raise MasterRefused(
                f"the ROS master at {self.uri} refused {method}{arguments} of {self._node}:"
                f" {message}",
                uri=self.uri,
                reason=message,
            )
        return value

    def parameter(self, name: str) -> Any:
        """Value of a parameter; None if it is not set."""
        code, _, value = self._ask("getParam", name)
        return value if code == SUCCESS else None

    def register_subscriber(self, topic: str, kind: str, node_uri: str) -> Sequence[str]:
        """Register a subscriber; returns the URIs of the publishers."""
        found = self._done("registerSubscriber", topic, kind, node_uri)
        return [str(each) for each in found]

    def unregister_subscriber(self, topic: str, node_uri: str) -> None:
        """Unregister a subscriber."""
        self._done("unregisterSubscriber", topic, node_uri)

    def register_publisher(self, topic: str, kind: str, node_uri: str) -> None:
        """Register a publisher."""
        self._done("registerPublisher", topic, kind, node_uri)

    def unregister_publisher(self, topic: str, node_uri: str) -> None:
        """Unregister a publisher."""
        self._done("unregisterPublisher", topic, node_uri)

    def register_service(self, name: str, service_uri: str, node_uri: str) -> None:
        """Register a service."""
        self._done("registerService", name, service_uri, node_uri)

    def unregister_service(self, name: str, service_uri: str) -> None:
        """Unregister a service."""
        self._done("unregisterService", name, service_uri)

"""`Bridge`: copies transforms between a store and a ROS graph, in both directions."""

from __future__ import annotations

import re
import threading
from typing import TYPE_CHECKING

from tfdb import tf2
from tfdb._core import duration_to_nanoseconds
from tfdb.data.argument_checks import check_name, refuse_without
from tfdb.data.closable import Closable
from tfdb.data.errors import InvalidName, NodeClosed, ReadOnly

from .claim import Claim
from .sending import BridgeStats, CommitSender

if TYPE_CHECKING:
    from typing import Any

    from tfdb._core import Buffer
    from tfdb.ros import DdsNode, Node, TcprosNode, ZenohNode

__all__ = ["Bridge", "check_origin"]

_WAITING = 1000
"""Largest number of waiting messages per topic; with several graphs, bursts are longer."""
_ORIGIN = re.compile(r"[^/\s]+(?:://[^/\s]+)?")
"""A name, or a name with a URI as in ROS 1. Another `/` would end the name in an authority."""


def check_origin(origin: str) -> str:
    """Return a graph's name. Raises InvalidName."""
    if _ORIGIN.fullmatch(check_name("origin", origin)) is None or not origin.isprintable():
        raise InvalidName(
            f"origin {origin!r} is not a valid name of a graph: it must be a name without / and"
            " spaces, such as ros2+zenoh:7",
            value=origin,
        )
    return origin


class Bridge(Closable):
    """Sends the commits of a store to a graph, and stores the messages of the graph in it.

    ```python
    with ZenohNode("bridge") as node, Bridge(buf, node) as bridge:
        bridge.wait()
    ```

    Each message on /tf and /tf_static becomes one commit, as with a `TransformListener`. Its
    authority is `origin`, a `/`, and the publisher. Commits with such an authority are not sent
    back to the graph, even after a restart. The node's own messages are not stored.

    Each other commit becomes one message on /tf. /tf_static carries one message with all static
    transforms of the store. It is sent again when they change, and nodes that join later get it.

    /tf cannot express that a frame was removed or cleared. The next message on /tf_static omits a
    removed static transform, but nodes that already have it keep it.

    Threads: any may call anything.

    Parameters
    ----------
    buffer
        The store, private or shared. It must be writable.
    node
        A node of `tfdb.ros` that reports the sender of a message: ZenohNode, DdsNode or
        TcprosNode. It stays open.
    origin
        Name of the graph in authorities, without `/` and spaces. None: that of the node, such as
        `ros2+zenoh:7`. If one store has bridges to two graphs with the same domain, these need
        different names.

    Raises
    ------
    NotSupported
        The buffer's engine has no feed.
    InvalidArgument
        The store already has a bridge to a graph with this name, in this or another process.
    ReadOnly
        The store was opened for reading only.
    NodeClosed, InvalidName, TypeError
    """

    def __init__(
        self,
        buffer: Buffer,
        node: ZenohNode | DdsNode | TcprosNode,
        *,
        origin: str | None = None,
    ) -> None:
        refuse_without(buffer, "buffer", "a Buffer", "changes", "snapshot", "watch")
        refuse_without(
            node, "node", "a ZenohNode, DdsNode or TcprosNode of tfdb.ros", "subscribe", "graph"
        )
        if buffer.shared is not None and buffer.shared.mode == "r":
            raise ReadOnly(
                "a bridge stores messages: open the store with mode='rw'", path=buffer.shared.path
            )
        self._origin = node.graph if origin is None else check_origin(origin)
        self._node = node
        self._error: BaseException | None = None
        self._ended = threading.Event()
        self._claim = Claim(buffer, self._origin)
        try:
            self._sender = CommitSender(buffer, node, self._origin)
        except BaseException:
            self._claim.close()
            raise
        try:
            store = tf2.Buffer(buffer=buffer, clock=node, flavor=node.flavor)
            self._listener = _Listener(store, node, self._origin)
        except BaseException:
            self._sender.close()
            self._claim.close()
            raise
        self._thread = threading.Thread(
            target=self._run, name=f"tfdb bridge {self._origin}", daemon=True
        )
        self._thread.start()
        self._clock = node.on_clock(lambda _: self._sender.end() if node.closed else None)

    @property
    def origin(self) -> str:
        """Name of the graph in authorities."""
        return self._origin

    @property
    def listener(self) -> tf2.TransformListener:
        """The listener that fills the store. It counts damaged messages and refused transforms."""
        return self._listener

    @property
    def stats(self) -> BridgeStats:
        """Counts of the bridge."""
        sender = self._sender
        return BridgeStats(
            self._listener.received,
            sender.sent,
            sender.sent_static,
            sender.refused,
            sender.missed,
            sender.gone,
        )

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the bridge has ended. False: it has not ended after `timeout` seconds.

        Raises the error that ended the bridge: NodeClosed, or one of the store, such as
        NoSuchStore.
        """
        left = None if timeout is None else duration_to_nanoseconds(timeout, "timeout") / 1e9
        ended = self._ended.wait(left)
        if self._error is not None:
            raise self._error
        return ended

    def close(self) -> None:
        """Send all earlier commits, and stop. The node stays open."""
        self._listener.unregister()
        self._clock.close()
        self._sender.end()
        if self._thread is not threading.current_thread():
            self._thread.join()

    def _run(self) -> None:
        try:
            self._sender.run()
            if self._node.closed:
                text = f"the node {self._node.name} was closed"
                self._error = NodeClosed(text, reason="it was closed")
        except Exception as error:  # `wait` raises it
            self._error = error
        finally:
            self._listener.unregister()
            self._sender.close()
            self._claim.close()
            self._ended.set()


class _Listener(tf2.TransformListener):
    """Stores messages of other nodes, with the graph's name before the publisher's."""

    def __init__(self, buffer: tf2.Buffer, node: Node, origin: str) -> None:
        self._origin = origin
        self.received = 0
        super().__init__(buffer, node, queue_size=_WAITING)

    def _taker(self, node: Node, topic: str, *, static: bool) -> Any:
        take = super()._taker(node, topic, static=static)

        def take_others(data: bytes | memoryview, publisher: str) -> None:
            if publisher != node.name:
                self.received += 1
                take(data, f"{self._origin}/{publisher.lstrip('/')}")

        return take_others

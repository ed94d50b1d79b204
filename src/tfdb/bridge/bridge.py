"""`Bridge`: a store and a graph of ROS, both ways."""

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
"""Messages of a topic that may wait: bursts are longer where several graphs meet."""
_ORIGIN = re.compile(r"[^/\s]+(?:://[^/\s]+)?")
"""A name, or one with a URI as ROS 1's: another `/` would end it in an authority."""


def check_origin(origin: str) -> str:
    """Return a graph's name. Raises InvalidName."""
    if _ORIGIN.fullmatch(check_name("origin", origin)) is None or not origin.isprintable():
        raise InvalidName(
            f"{origin!r} is not a name of a graph (origin): it has no / and no space, such as"
            " ros2+zenoh:7",
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
    authority is `origin`, a `/`, and the publisher. Commits with such an authority do not return to
    the graph, also after a restart, and the node's own messages are not stored.

    Each commit becomes one message on /tf. All static transforms of the store are one message on
    /tf_static, sent again when they change. Late joiners get it.

    /tf cannot express a removed or cleared frame. A removed static transform is missing in the next
    message on /tf_static; nodes that have it keep it.

    Threads: any may call anything.

    Parameters
    ----------
    buffer
        The store, also one that other processes share. It must be writable.
    node
        A node of `tfdb.ros` that reports the sender of a message: ZenohNode, DdsNode or
        TcprosNode. It stays open.
    origin
        Name of the graph in authorities, without `/` and spaces. None: that of the node, such as
        `ros2+zenoh:7`. Two graphs with the same domain need two names, if one store has bridges to
        both.

    Raises
    ------
    NotSupported
        The buffer's engine keeps no feed.
    InvalidArgument
        The store has a bridge to a graph with this name already, also in another process.
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
        """What fills the store. It counts damaged messages and refused transforms."""
        return self._listener

    @property
    def stats(self) -> BridgeStats:
        """What it has done."""
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
        """Wait until it has ended; False: it has not after `timeout` seconds.

        Raises the error that ended it: NodeClosed, or of the store, such as NoSuchStore.
        """
        left = None if timeout is None else duration_to_nanoseconds(timeout, "timeout") / 1e9
        ended = self._ended.wait(left)
        if self._error is not None:
            raise self._error
        return ended

    def close(self) -> None:
        """Send the commits that were made before, and stop. The node stays open."""
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
            self._sender.close()
            self._claim.close()
            self._ended.set()


class _Listener(tf2.TransformListener):
    """Stores what other nodes send, with the graph's name before the publisher's."""

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

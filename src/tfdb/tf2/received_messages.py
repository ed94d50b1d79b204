"""Stores messages of /tf and /tf_static from bytes, one commit each, by the rules of their ROS."""

from __future__ import annotations

import logging
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

from tfdb import _core
from tfdb.data import errors
from tfdb.ros import msgs
from tfdb.ros.ros_messages import make_ours, real_tf_message
from tfdb.ros.times import SECOND
from tfdb.store import waiting

from . import phrases, refusals
from .buffer_core import BufferCore

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence

    from tfdb.data.refused_transforms import Refused
    from tfdb.ros import Encoding, Node

__all__ = ["SETTERS", "UNKNOWN", "BufferWriter", "Sink", "decoded", "received", "sink_of"]

LOGGER = logging.getLogger("tfdb.tf2")
Sink: TypeAlias = "Callable[[bytes | memoryview, str], int]"
"""Stores a serialized TFMessage with its authority. Raises CorruptMessage."""
SETTERS = ("set_transform", "set_transform_static")
"""Methods of a buffer that store transforms."""
UNKNOWN = "default_authority"
"""Authority of a message with an unknown publisher."""
AHEAD = 60 * SECOND
"""A stamp further ahead of the node's clock than this is an error of its publisher."""


def decoded(
    data: bytes | memoryview, encoding: Encoding, authority: str, *, static: bool
) -> Iterator[msgs.TransformStamped | errors.TfdbError]:
    """Decode a TFMessage into tfdb's messages; an unreadable transform becomes its error.

    Raises CorruptMessage.
    """
    one: Any
    for one in _core.decode_members(data, encoding, static=static, authority=authority):
        if isinstance(one, errors.TfdbError):
            yield one
        else:
            yield make_ours(one.parent, one.child, one.stamp, (*one.translation, *one.rotation))


def readable(
    members: Iterable[msgs.TransformStamped | errors.TfdbError], authority: str
) -> list[msgs.TransformStamped]:
    """The readable transforms of a message; the errors of the others are logged."""
    good = []
    for each in members:
        if isinstance(each, errors.TfdbError):
            refusals.log_unread(each, authority)
        else:
            good.append(each)
    return good


def received(data: bytes | memoryview, node: Node, topic: str, publisher: str) -> Any:
    """Make the TFMessage for a callback, of the node's ROS. Raises CorruptMessage."""
    authority = publisher or UNKNOWN
    members = decoded(data, node.encoding, authority, static=False)
    transforms = readable(members, authority)
    message = real_tf_message(bytes(data), node.flavor)
    if message is None:
        message = _Received(transforms)
    if node.flavor == "ros1":
        header = {"callerid": authority, "topic": topic, "type": "tf2_msgs/TFMessage"}
        message._connection_header = header
    return message


class _Received(msgs.TFMessage):
    """A received message of tfdb, with a `__dict__`."""


def sink_of(buffer: Any, node: Node, *, static: bool) -> Sink:
    """Make a function that stores messages of a node, and returns the number of refused transforms.

    The store decodes the bytes, unless a subclass handles each transform.
    """
    kind = type(buffer)
    if isinstance(buffer, BufferCore) and all(
        getattr(kind, name) is getattr(BufferCore, name) for name in SETTERS
    ):
        return BufferWriter(buffer, node, static=static).store
    store = getattr(buffer, SETTERS[static])

    def store_each(data: bytes | memoryview, authority: str) -> int:
        members = [*decoded(data, node.encoding, authority, static=static)]
        good = readable(members, authority)
        refused = [store(each, authority) is False for each in good]
        return len(members) - len(good) + sum(refused)

    return store_each


class BufferWriter:
    """Stores the received messages of a topic. Any thread may call it."""

    def __init__(self, core: BufferCore, node: Node, *, static: bool) -> None:
        self._core, self._node, self._static = core, node, static
        self._ahead: set[tuple[str, int]] = set()
        ros1 = core.flavor == "ros1"
        rules: dict[str, Any] = {
            "static": static,
            "change_kind": not ros1,
            "only_new": ros1 and not static,
        }
        # Created once, to save time for each message.
        self._ingest: Any = partial(
            _core.ingest_members, core.buffer, encoding=node.encoding, **rules
        )

    def store(self, data: bytes | memoryview, authority: str) -> int:
        """Store a TFMessage in one commit; log the transforms that tf2 refuses, store the others.

        Returns the number of refused transforms. Raises CorruptMessage, and then stores nothing.
        """
        refused: Any = waiting.write(
            self._core.buffer, lambda: self._ingest(data, authority=authority)
        )
        return self._log_refused(data, refused, authority) if refused else 0

    def _log_refused(
        self, data: bytes | memoryview, refused: Sequence[Refused], authority: str
    ) -> int:
        """Log refused transforms with tf2's texts; return the number of lost ones."""
        transforms = [*decoded(data, self._node.encoding, authority, static=self._static)]
        lost = 0
        for member in refused:
            transform = transforms[member.index]
            if isinstance(transform, errors.TfdbError):
                refusals.log_unread(transform, authority)
                lost += 1
                continue
            # Stored again alone, it is refused with tf2's text, or stored by ROS 1's rules for
            # kinds.
            lost += not self._core._set(transform, authority, static=self._static)
            if member.error == "TooOld":
                self._log_future_stamp(transform.child_frame_id)
        return lost

    def _log_future_stamp(self, child: str) -> None:
        """Log the publisher of a stamp in the future that makes valid ones too old."""
        info = self._core.buffer.frame_info(child.removeprefix("/"))
        ahead = (info.newest or 0) - self._node.now()
        if ahead < AHEAD or info.newest is None or (child, info.newest) in self._ahead:
            return
        self._ahead.add((child, info.newest))
        error = errors.TooOld(edge=child, newest=info.newest, authority=info.authority)
        LOGGER.warning(
            "%s",
            phrases.future_data(info.authority, child, info.newest, ahead),
            extra={"error": error},
        )

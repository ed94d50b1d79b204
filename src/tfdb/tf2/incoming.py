"""What arrives on /tf and /tf_static: bytes, one message one commit, by the rules of its side."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Any

import tfdb
from tfdb import errors

from . import phrases, refusals
from .ros_messages import make_ours
from .times import SECOND

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tfdb.ros import Encoding, Node

    from . import msgs
    from .buffer_core import BufferCore

__all__ = ["Incoming", "decoded"]

LOGGER = logging.getLogger("tfdb.tf2")
AHEAD = 60 * SECOND
"""A stamp that is so far ahead of the node's clock was never meant."""


def decoded(data: bytes | memoryview, encoding: Encoding) -> Iterator[msgs.TransformStamped]:
    """Take a TFMessage apart, into messages of ours. Raises CorruptMessage."""
    one: Any
    for one in tfdb.decode_tf_message(data, encoding):
        yield make_ours(one.parent, one.child, one.stamp, (*one.translation, *one.rotation))


class Incoming:
    """Stores the messages that a node gets. Any thread may call it."""

    def __init__(self, core: BufferCore, node: Node) -> None:
        self._core = core
        self._node = node
        self._ahead: set[tuple[str, int]] = set()

    def store(self, data: bytes | memoryview, authority: str, *, static: bool) -> int:
        """Store a TFMessage in one commit; what tf2 refuses is logged, the rest of it stored.

        Returns how many transforms were refused. Raises CorruptMessage: nothing was stored.
        """
        ros1 = self._core.flavor == "ros1"
        rules = {"change_kind": not ros1, "only_new": ros1 and not static}
        try:
            self._core.buffer.ingest(
                data, encoding=self._node.encoding, static=static, authority=authority, **rules
            )
        except errors.TfdbError as error:
            if not refusals.is_of_a_transform(error):
                raise
        else:
            return 0
        transforms = [*decoded(data, self._node.encoding)]
        refused = self._core.buffer.set_transforms(
            transforms, static=static, authority=authority, partial=True, **rules
        )
        lost = 0
        for member in refused:
            transform = transforms[member.index]
            # Asked again by itself it is refused in tf2's words, or is of ROS 1's other kind.
            lost += not self._core._set(transform, authority, static=static)
            if member.error == "TooOld":
                self._look_ahead(transform.child_frame_id)
        return lost

    def _look_ahead(self, child: str) -> None:
        """Say whose stamp, far in the future, made the right ones of an edge too old."""
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

"""What arrives on /tf and /tf_static: bytes, one message one commit, by the rules of its side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import tfdb
from tfdb import errors

from . import refusals
from .ros_messages import make_ours

if TYPE_CHECKING:
    from collections.abc import Iterator

    from tfdb.ros import Encoding

    from . import msgs
    from .buffer_core import BufferCore

__all__ = ["decoded", "store_message"]


def decoded(data: bytes | memoryview, encoding: Encoding) -> Iterator[msgs.TransformStamped]:
    """Take a TFMessage apart, into messages of ours. Raises CorruptMessage."""
    one: Any
    for one in tfdb.decode_tf_message(data, encoding):
        yield make_ours(one.parent, one.child, one.stamp, (*one.translation, *one.rotation))


def store_message(
    core: BufferCore,
    data: bytes | memoryview,
    encoding: Encoding,
    authority: str,
    *,
    static: bool,
) -> int:
    """Store a TFMessage in one commit; what tf2 refuses is logged, the rest of it stored.

    Returns how many transforms were refused. Raises CorruptMessage: nothing was stored.
    """
    ros1 = core.flavor == "ros1"
    try:
        core.buffer.ingest(
            data,
            encoding=encoding,
            static=static,
            authority=authority,
            change_kind=not ros1,
            only_new=ros1 and not static,
        )
    except errors.CorruptMessage:
        raise
    except errors.TfdbError as error:
        if refusals.is_of_a_transform(error):
            return _store_members(core, data, encoding, authority, static=static)
        raise
    return 0


def _store_members(
    core: BufferCore,
    data: bytes | memoryview,
    encoding: Encoding,
    authority: str,
    *,
    static: bool,
) -> int:
    """Store those members of a message that are not refused, in one commit; log the others."""
    transforms = [*decoded(data, encoding)]
    ros1 = core.flavor == "ros1"
    refused = core.buffer.set_transforms(
        transforms,
        static=static,
        authority=authority,
        partial=True,
        change_kind=not ros1,
        only_new=ros1 and not static,
    )
    lost = 0
    for member in refused:
        # Asked again by itself it is refused in tf2's words, or is of ROS 1's other kind.
        lost += not core._set(transforms[member.index], authority, static=static)
    return lost

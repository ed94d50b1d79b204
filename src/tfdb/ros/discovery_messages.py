"""Names of nodes over DDS as messages, `rmw_dds_common/msg/ParticipantEntitiesInfo`.

This is the layout of Jazzy, whose gids have 16 bytes.
"""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

__all__ = ["DISCOVERY", "DISCOVERY_TYPE", "encode_participant"]

DISCOVERY = "ros_discovery_info"
"""Name of the DDS topic."""
DISCOVERY_TYPE = "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"


def encode_participant(
    gid: bytes,
    namespace: str,
    name: str,
    readers: Collection[bytes],
    writers: Collection[bytes],
) -> bytes:
    """CDR of a participant that is one node with these endpoints."""
    head = gid + struct.pack("<I", 1) + _text(namespace) + _text(name)
    gids = (struct.pack("<I", len(each)) + b"".join(each) for each in (readers, writers))
    return b"\0\1\0\0" + head + b"".join(gids)


def _text(text: str) -> bytes:
    """A string, and zeros up to the next number."""
    data = text.encode() + b"\0"
    return struct.pack("<I", len(data)) + data.ljust(len(data) + 3 & ~3, b"\0")

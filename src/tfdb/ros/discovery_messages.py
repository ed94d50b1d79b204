"""Messages with the names of nodes over DDS: `rmw_dds_common/msg/ParticipantEntitiesInfo`.

The layout is that of Jazzy, whose gids have 16 bytes.
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
    """Return the CDR of a participant with one node and these endpoints."""
    head = gid + struct.pack("<I", 1) + _text(namespace) + _text(name)
    gids = (struct.pack("<I", len(each)) + b"".join(each) for each in (readers, writers))
    return b"\0\1\0\0" + head + b"".join(gids)


def _text(text: str) -> bytes:
    """Return a string, padded with zeros for the next number."""
    data = text.encode() + b"\0"
    return struct.pack("<I", len(data)) + data.ljust(len(data) + 3 & ~3, b"\0")

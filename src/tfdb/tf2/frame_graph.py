"""The service `tf2_frames`: the tree as YAML, for view_frames and similar tools."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

from tfdb.data.errors import InvalidArgument, NotSupported

if TYPE_CHECKING:
    from tfdb.ros import Encoding, Node, Service

    from .buffer_core import BufferCore

__all__ = ["offer_frame_graph"]


def offer_frame_graph(core: BufferCore, node: Node) -> Service | None:
    """Offer the service in a node; None: another buffer has it, or the node has no services."""
    name = "~tf2_frames" if node.flavor == "ros1" else "tf2_frames"
    encoding = node.encoding
    try:
        return node.serve(
            name, "tf2_msgs/FrameGraph", lambda _: _response(core.all_frames_as_yaml(), encoding)
        )
    except (InvalidArgument, NotSupported):  # NotSupported: a node without services
        return None


def _response(text: str, encoding: Encoding) -> bytes:
    """Serialize a FrameGraph response, which is one string."""
    data = text.encode()
    if encoding == "ros1":
        return struct.pack("<I", len(data)) + data
    return b"\0\1\0\0" + struct.pack("<I", len(data) + 1) + data + b"\0"

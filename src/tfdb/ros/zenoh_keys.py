"""Keys, liveliness tokens and attachments of rmw_zenoh."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .ros2_names import Kind

__all__ = [
    "GID_SIZE",
    "NO_HASH",
    "Attachment",
    "node_of",
    "publishers",
    "quality",
    "token",
    "topic_key",
]

GID_SIZE = 16
NO_HASH = "TypeHashNotSupported"
"""Used in place of a hash by nodes of Humble."""
_HEAD = struct.Struct("<qqB")
_PARTS = (13, 14)
"""Number of parts in a publisher's token. Since Lyrical the fourteenth is `backends:...`."""
_TOKENS = "@ros2_lv"


@dataclass(frozen=True)
class Attachment:
    """The attachment of each message."""

    number: int
    """Sequence number at its publisher, from 1."""
    time: int
    """Time of sending, nanoseconds."""
    gid: bytes
    """Gid of its publisher."""

    def encode(self) -> bytes:
        """Return its bytes."""
        return _HEAD.pack(self.number, self.time, GID_SIZE) + self.gid

    @staticmethod
    def decode(data: bytes) -> Attachment:
        """Read the bytes. Raises ValueError for another layout."""
        size = _HEAD.size + GID_SIZE
        if len(data) != size or data[_HEAD.size - 1] != GID_SIZE:
            text = f"its attachment has {len(data)} bytes, and rmw_zenoh's has {size}"
            if len(data) > size:
                text += "; rmw_zenoh before 0.6.0 or 0.1.2 must be updated"
            raise ValueError(text)
        number, time, _ = _HEAD.unpack_from(data)
        return Attachment(number, time, data[_HEAD.size :])


def topic_key(domain: int, topic: str, kind: Kind) -> str:
    """Key of a topic's messages."""
    return f"{domain}/{topic.strip('/')}/{kind.wire}/{kind.hash}"


def quality(*, latched: bool, depth: int) -> str:
    """QoS in a token: reliable, and its durability and depth."""
    return f":{'1' if latched else ''}:,{depth}:,:,:,,"


def token(
    domain: int, session: str, number: int, role: str, namespace: str, name: str, *topic: str
) -> str:
    """Token of a node, or of an endpoint with topic, type, hash and QoS."""
    parts = [str(domain), session, "0", str(number), role, "%"]
    parts += [_mangled(namespace), _mangled(name)]
    if topic:
        first, *others = topic
        parts += [_mangled(first), *others]
    return "/".join([_TOKENS, *parts])


def publishers(domain: int) -> str:
    """Key of all publishers' tokens."""
    return f"{_TOKENS}/{domain}/*/*/*/MP/**"


def node_of(text: str) -> str:
    """Full name of the node in a publisher's token. Raises ValueError if it is none."""
    parts = text.split("/")
    if len(parts) not in _PARTS or parts[0] != _TOKENS or parts[5] != "MP":
        raise ValueError(f"not a token of a publisher: {text}")
    namespace, name = (part.replace("%", "/").strip("/") for part in parts[7:9])
    if not name:
        raise ValueError(f"no node in a token: {text}")
    return f"/{namespace}/{name}" if namespace else f"/{name}"


def _mangled(name: str) -> str:
    return name.replace("/", "%") or "%"

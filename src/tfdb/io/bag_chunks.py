"""Messages out of the chunks of a ROS 1 bag, once its index is known.

rosbags reads the index and decompresses; it takes five times as long as this to cut a chunk into
messages, and that would be most of the time that loading a bag takes.
"""

from __future__ import annotations

import struct
from operator import itemgetter
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

_MESSAGE, _CONNECTION = b"\x02", b"\x07"
_u32 = struct.Struct("<I").unpack_from
_time = struct.Struct("<II").unpack_from


class BagError(Exception):
    """The chunk does not hold what the index says."""


def indexed_messages(reader: Any, ids: Iterable[int]) -> Iterator[tuple[int, int, bytes]]:
    """Connection, time of reception (ns) and payload of the connections' messages, by time.

    `reader` is an open reader of rosbags for ROS 1. Raises `BagError` and whatever decompression
    raises on damaged data.
    """
    entries = [(at, chunk, offset, id_) for id_ in ids for at, chunk, offset in reader.indexes[id_]]
    entries.sort(key=itemgetter(0))
    # Headers of one connection's messages differ in the time alone: by id, what stands around it.
    around: dict[int, tuple[bytes, int, bytes]] = {}
    current, raw = -1, b""
    for at, chunk, offset, id_ in entries:
        if chunk != current:
            current, raw = chunk, _read_chunk(reader, chunk)
        try:
            start, (size,) = offset + 4, _u32(raw, offset)
            header = raw[start : start + size]
            before, place, after = around.get(id_, (b"\0", 0, b""))
            if not (header.startswith(before) and header[place + 8 :] == after):
                start, header = _find_message(raw, offset, id_)
                place = header.index(b"time=") + 5
                around[id_] = header[:place], place, header[place + 8 :]
            seconds, nanoseconds = _time(header, place)
            start += len(header) + 4
            (size,) = _u32(raw, start - 4)
        except (struct.error, ValueError) as error:
            raise BagError(f"no message where the index has one: {error}") from error
        data = raw[start : start + size]
        if len(data) != size or seconds * 1_000_000_000 + nanoseconds != at:
            raise BagError("a message differs from its entry in the index")
        yield id_, at, data


def _read_chunk(reader: Any, position: int) -> bytes:
    chunk = reader.chunks[position]
    reader.bio.seek(chunk.datapos)
    packed = reader.bio.read(chunk.datasize)
    if len(packed) != chunk.datasize:
        raise BagError(f"a chunk of {chunk.datasize} bytes ends after {len(packed)}")
    raw: bytes = chunk.decompressor(packed)
    return raw


def _find_message(raw: bytes, offset: int, id_: int) -> tuple[int, bytes]:
    """Start and bytes of the next message's header; records of connections may lie before it."""
    while True:
        start, (size,) = offset + 4, _u32(raw, offset)
        header = raw[start : start + size]
        fields = _fields(header)
        if fields.get(b"op") != _CONNECTION:
            break
        offset = start + size
        offset += 4 + _u32(raw, offset)[0]
    if fields.get(b"op") != _MESSAGE or fields.get(b"conn") != id_.to_bytes(4, "little"):
        raise BagError("the index points to something else than a message of its connection")
    return start, header


def _fields(header: bytes) -> dict[bytes, bytes]:
    fields = {}
    at = 0
    while at < len(header):
        (size,) = _u32(header, at)
        name, _, value = header[at + 4 : at + 4 + size].partition(b"=")
        fields[name] = value
        at += 4 + size
    return fields

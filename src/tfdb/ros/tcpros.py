"""The bytes of TCPROS: frames (a length and that many bytes), headers of `key=value` fields.

The protocol is described at https://wiki.ros.org/ROS/TCPROS. This file does not decode messages.
"""

from __future__ import annotations

import struct
import time
from typing import TYPE_CHECKING

from tfdb.data.errors import CorruptMessage

if TYPE_CHECKING:
    import socket
    from collections.abc import Callable, Mapping

__all__ = [
    "HEADER_LIMIT",
    "MESSAGE_LIMIT",
    "Frames",
    "decode_header",
    "encode_header",
    "frame",
    "receive_header",
]

HEADER_LIMIT = 1 << 20
"""Largest size of a header, which includes the message definition, in bytes."""
MESSAGE_LIMIT = 256 << 20
"""Largest size of a message in bytes; a larger length counts as damage."""
FIRST_SIZE = 1 << 20  # size of the buffer; one call reads all received bytes
LENGTH = struct.Struct("<I")
_measure = LENGTH.unpack_from


def frame(data: bytes) -> bytes:
    """Bytes with their length before them."""
    return LENGTH.pack(len(data)) + data


def encode_header(fields: Mapping[str, str]) -> bytes:
    """Make the frame of a header."""
    return frame(b"".join(frame(f"{key}={value}".encode()) for key, value in fields.items()))


def decode_header(data: bytes | memoryview) -> dict[str, str]:
    """Return the fields of a header without length. Raises CorruptMessage if it is invalid."""
    fields = {}
    begin = 0
    while begin < len(data):
        if begin + LENGTH.size > len(data):
            raise CorruptMessage(
                f"a TCPROS header ends in a length, at byte {begin} of {len(data)}",
                offset=begin,
                reason="truncated",
            )
        (length,) = LENGTH.unpack_from(data, begin)
        begin += LENGTH.size
        field = bytes(data[begin : begin + length])
        if len(field) < length or b"=" not in field:
            why = "is not key=value" if len(field) == length else f"claims {length} bytes"
            raise CorruptMessage(
                f"a TCPROS header's field at byte {begin} of {len(data)} {why}",
                offset=begin,
                reason="not a header",
            )
        key, _, value = field.partition(b"=")
        fields[key.decode(errors="replace")] = value.decode(errors="replace")
        begin += length
    return fields


def receive_header(connection: socket.socket, seconds: float) -> dict[str, str]:
    """Receive the header at the start of a connection, but nothing after it; return its fields.

    Raises TimeoutError if it does not arrive in time, ConnectionError if the connection ends
    before, CorruptMessage if it is invalid. The connection has no timeout afterwards.
    """
    deadline = time.monotonic() + seconds

    def receive(count: int) -> bytes:
        found = b""
        while len(found) < count:
            connection.settimeout(max(0.001, deadline - time.monotonic()))
            piece = connection.recv(count - len(found))
            if not piece:
                raise ConnectionError("the connection ended before its header")
            found += piece
        return found

    (length,) = LENGTH.unpack(receive(LENGTH.size))
    if length > HEADER_LIMIT:
        raise _too_long(length, HEADER_LIMIT)
    found = decode_header(receive(length))
    connection.settimeout(None)
    return found


def _too_long(length: int, limit: int) -> CorruptMessage:
    return CorruptMessage(
        f"a frame has {length} bytes; at most {limit} are allowed",
        reason="too long",
        limit=limit,
    )


class Frames:
    """Divides the received bytes of a connection into frames, without copying.

    Threads: one at a time.
    """

    def __init__(self, limit: int, size: int = FIRST_SIZE) -> None:
        self.limit = limit
        """Largest size of a frame in bytes."""
        self._buffer = bytearray(size)
        self._view = memoryview(self._buffer)
        self._begin = self._end = 0

    def fill(self, connection: socket.socket) -> int:
        """Receive once into the rest of the buffer. 0: the connection has ended."""
        if self._end == len(self._buffer):
            self._move_to(min(2 * len(self._buffer), self.limit + LENGTH.size))
        count = connection.recv_into(self._view[self._end :])
        self._end += count
        return count

    def each(self, take: Callable[[memoryview], object]) -> None:
        """Call `take` with each complete frame, without its length. The frame is valid in the call.

        Exceptions of `take` are raised, and its frame counts as processed. Raises CorruptMessage
        for a length beyond the limit.
        """
        while self._end - self._begin >= LENGTH.size:
            (length,) = _measure(self._buffer, self._begin)
            if length > self.limit:
                raise _too_long(length, self.limit)
            begin = self._begin + LENGTH.size
            end = begin + length
            if end > self._end:
                break
            self._begin = end
            found = self._view[begin:end]
            take(found)
            try:
                found.release()
            except BufferError:
                # A receiver keeps a view of the buffer, so the buffer must not change any more.
                self._move_to(len(self._buffer))
        if self._begin == self._end:
            self._begin = self._end = 0
        elif self._begin:
            rest = self._end - self._begin
            self._buffer[:rest] = self._buffer[self._begin : self._end]
            self._begin, self._end = 0, rest

    def _move_to(self, size: int) -> None:
        """Allocate a buffer of that size, and move the rest to it."""
        rest = self._buffer[self._begin : self._end]
        self._buffer = bytearray(size)
        self._view = memoryview(self._buffer)
        self._buffer[: len(rest)] = rest
        self._begin, self._end = 0, len(rest)

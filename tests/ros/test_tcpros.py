"""Frames and headers of TCPROS, without ROS."""

from __future__ import annotations

import itertools
import socket
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

import tfdb
from tfdb.ros.tcpros import Frames, decode_header, encode_header, frame, receive_header


def receive(pieces: list[bytes], limit: int = 1000, size: int = 64) -> list[bytes]:
    """Return the frames of bytes that are received in these pieces."""
    ours, theirs = socket.socketpair()
    frames, found = Frames(limit, size), []
    with ours, theirs:
        for piece in pieces:
            theirs.sendall(piece)
            left = len(piece)
            while left:
                left -= frames.fill(ours)
                frames.each(lambda data: found.append(bytes(data)))
        theirs.close()
        assert frames.fill(ours) == 0
    return found


@given(st.lists(st.binary(max_size=200), max_size=8), st.lists(st.integers(1, 1600), max_size=12))
def test_frames_come_out_however_they_are_cut(messages: list[bytes], cuts: list[int]) -> None:
    whole = b"".join(map(frame, messages))
    bounds = sorted({0, len(whole), *(cut for cut in cuts if cut < len(whole))})
    pieces = [whole[a:b] for a, b in itertools.pairwise(bounds)]
    assert receive(pieces) == messages


def test_one_byte_at_a_time() -> None:
    messages = [b"", b"a", bytes(range(256)), b"\0\0\0\0"]
    whole = b"".join(map(frame, messages))
    assert receive([whole[i : i + 1] for i in range(len(whole))]) == messages


def test_a_length_beyond_the_limit_is_refused_before_it_is_received() -> None:
    with pytest.raises(
        tfdb.errors.CorruptMessage, match="4294967295 bytes; at most 1000"
    ) as caught:
        receive([frame(b"good"), b"\xff\xff\xff\xff"])
    assert caught.value.limit == 1000
    assert receive([frame(b"x" * 1000)]) == [b"x" * 1000]
    with pytest.raises(tfdb.errors.CorruptMessage):
        receive([frame(b"x" * 1001)])


def test_a_frame_is_valid_until_the_next_unless_it_is_kept() -> None:
    ours, theirs = socket.socketpair()
    frames, taken = Frames(1000, 64), []
    kept: list[memoryview] = []

    def take(data: memoryview) -> None:
        taken.append(data)
        if data == b"second":
            kept.append(memoryview(data))  # a reference to one of these keeps the buffer alive

    with ours, theirs:
        for sent in (frame(b"first") + frame(b"second") + frame(b"third"), frame(b"another")):
            theirs.sendall(sent)
            frames.fill(ours)
            frames.each(take)
    assert [len(data) for data in kept] == [6]
    assert kept[0] == b"second"
    assert len(taken) == 4
    for data in (taken[0], taken[2], taken[3]):
        with pytest.raises(ValueError, match="released"):
            bytes(data)


def test_a_frame_is_done_if_its_handler_fails() -> None:
    ours, theirs = socket.socketpair()
    frames, found = Frames(1000, 64), []

    def take(data: memoryview) -> None:
        found.append(bytes(data))
        if data == b"bad":
            raise ZeroDivisionError

    with ours, theirs:
        theirs.sendall(frame(b"bad") + frame(b"good") + b"\5")
        frames.fill(ours)
        with pytest.raises(ZeroDivisionError):
            frames.each(take)
        frames.each(take)
        theirs.sendall(frame(b"later")[1:])
        frames.fill(ours)
        frames.each(take)
    assert found == [b"bad", b"good", b"later"]


def test_a_header_is_received_and_nothing_after_it() -> None:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.sendall(encode_header({"a": "b"}) + b"rest")
        assert receive_header(ours, 5.0) == {"a": "b"}
        assert ours.gettimeout() is None
        assert ours.recv(10) == b"rest"
        theirs.sendall(b"\5\0")
        with pytest.raises(TimeoutError):
            receive_header(ours, 0.01)
        theirs.sendall(b"\xff\xff\xff\xff")
        with pytest.raises(tfdb.errors.CorruptMessage, match="at most 1048576 are allowed"):
            receive_header(ours, 5.0)
        theirs.close()
        with pytest.raises(ConnectionError, match="before its header"):
            receive_header(ours, 5.0)


def test_headers_come_back_as_they_were() -> None:
    fields = {"callerid": "/a", "message_definition": "x=1\n===\ny", "empty": ""}
    whole = encode_header(fields)
    assert struct.unpack_from("<I", whole)[0] == len(whole) - 4
    assert decode_header(whole[4:]) == fields


@pytest.mark.parametrize(
    ("data", "offset", "text"),
    [
        (b"\x05\0", 0, "ends in a length, at byte 0 of 2"),
        (b"\x05\0\0\0a=b", 4, "field at byte 4 of 7 claims 5 bytes"),
        (b"\xff\xff\xff\xffa=b", 4, "claims 4294967295 bytes"),
        (b"\x03\0\0\0abc", 4, "is not key=value"),
        (frame(b"a=b") + b"\0", 7, "ends in a length, at byte 7 of 8"),
    ],
)
def test_invalid_headers_are_refused(data: bytes, offset: int, text: str) -> None:
    with pytest.raises(tfdb.errors.CorruptMessage, match=text) as caught:
        decode_header(data)
    assert caught.value.offset == offset


@given(st.binary(max_size=60))
def test_a_header_of_any_bytes_is_read_or_refused(data: bytes) -> None:
    try:
        decode_header(data)
    except tfdb.errors.CorruptMessage as error:
        assert error.offset is not None
        assert 0 <= error.offset <= len(data)

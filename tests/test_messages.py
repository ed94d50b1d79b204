"""Encoding and decoding of TFMessage bytes."""

from __future__ import annotations

import pytest

import tfdb
from oracle import quaternion

TURN = quaternion((1, -2, 0.5), 0.9)
BACK = quaternion((0, 1, 3), -1.4)


BATCH = [
    tfdb.TransformStamped("map", "base", 1_500_000_007, (1.0, 2.0, 3.0), TURN),
    tfdb.TransformStamped("base", "höhe", 2_000_000_009, (-1.0, 0.5, 0.25), BACK),
]


@pytest.mark.parametrize("encoding", ["cdr", "ros1", "cdr_le", "cdr_be", "cdr2_le", "cdr_bare_be"])
@pytest.mark.parametrize("kind", [bytes, bytearray, memoryview])
def test_messages_come_in_as_they_went_out(encoding: str, kind: type) -> None:
    data = tfdb.encode_tf_message(BATCH, encoding)
    assert tfdb.decode_tf_message(kind(data), encoding) == BATCH
    buffer = tfdb.Buffer()
    assert buffer.ingest(kind(data), encoding=encoding, authority="wire") == 1
    found = buffer.lookup_transform("base", "höhe", 2_000_000_009)
    assert found.pose == pytest.approx([-1, 0.5, 0.25, *BACK])
    assert buffer.frame_info("höhe").authority == "wire"


def test_static_messages_hold_at_every_stamp() -> None:
    buffer = tfdb.Buffer()
    buffer.ingest(tfdb.encode_tf_message(BATCH), static=True)
    assert buffer.lookup_transform("map", "höhe", 10**18).stamp == 10**18


def test_one_leading_slash_is_dropped_on_the_wire_only() -> None:
    buffer = tfdb.Buffer()
    data = tfdb.encode_tf_message(BATCH, "ros1").replace(b"\x03\0\0\0map", b"\x03\0\0\0/mp")
    buffer.ingest(data, encoding="ros1")
    assert "mp" in buffer.frames()
    buffer.set_transform("/map", "x", 5, (1, 2, 3), TURN)
    assert "/map" in buffer.frames()


def test_many_messages_are_one_commit_each() -> None:
    buffer = tfdb.Buffer(history=None)
    messages = [
        tfdb.encode_tf_message(
            [tfdb.TransformStamped("map", "base", stamp, (stamp, 2, 3), TURN) for _ in range(3)]
        )
        for stamp in range(3000)
    ]
    messages[7] = messages[7][:-5]
    messages[2000] = tfdb.encode_tf_message([tfdb.TransformStamped("x", "x", 1, (1, 2, 3))])
    messages[2001] = messages[2001][:9]
    messages.append(tfdb.encode_tf_message([]))
    result = buffer.ingest_many(iter(messages), encoding="cdr")
    assert (result.messages, result.refused) == (3001, 3)
    assert (result.commits, result.transforms) == (2997, 3 * 2997)
    assert result.commit == buffer.commit == 2997
    assert set(result.reasons) == {"CorruptMessage", "InvalidTransform"}
    assert result.reasons["CorruptMessage"].count == 2
    assert result.reasons["CorruptMessage"].index == 7
    assert "byte" in result.reasons["CorruptMessage"].first
    assert result.reasons["InvalidTransform"].index == 2000
    assert buffer.frame_info("base").samples == 2997


def test_a_failing_iterator_keeps_stored_messages() -> None:
    def messages() -> object:
        for _ in range(1500):
            yield tfdb.encode_tf_message(BATCH)
        raise OSError("unplugged")

    buffer = tfdb.Buffer()
    with pytest.raises(OSError, match="unplugged"):
        buffer.ingest_many(messages(), encoding="cdr")
    assert buffer.commit == 1024

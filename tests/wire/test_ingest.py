"""`Buffer.ingest` and `Buffer.ingest_many` of rosbags' bytes equal `set_transforms`."""

from __future__ import annotations

import struct
from array import array
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import tfdb
from tests.stored import stored
from tests.wire import oracle

POSE = (1.25, -2.5, 3.75, 0.0, 0.6, 0.0, 0.8)
STAMP = 1_700_000_000_123_456_789
ROWS = [oracle.row("map", "odom", STAMP, POSE), oracle.row("odom", "base", STAMP + 5, POSE)]


def store(rows: list[oracle.Row], buf: tfdb.Buffer, static: bool) -> int:
    """Commit rows without their bytes."""
    return buf.set_transforms(
        [tfdb.TransformStamped(r.parent, r.child, r.stamp, r.pose[:3], r.pose[3:]) for r in rows],
        static=static,
    )


def contents(buf: tfdb.Buffer) -> object:
    return buf.commit, stored(buf)


def answers(buf: tfdb.Buffer, stamps: list[int]) -> list[Any]:
    """Every lookup between two frames: the pose's bytes, or the class of the error."""
    result: list[Any] = []
    for target in buf.frames():
        for source in buf.frames():
            for stamp in [None, *stamps]:
                try:
                    answer = buf.lookup_transform(target, source, stamp)
                except tfdb.TfdbError as error:
                    result.append((target, source, stamp, type(error), str(error)))
                else:
                    result.append((target, source, answer.stamp, answer.pose.tobytes()))
    return result


@pytest.mark.parametrize("encoding", oracle.THEIRS)
@given(moving=oracle.good_messages(), static=oracle.good_messages(static=True))
def test_answers_are_those_of_set_transforms(
    encoding: str, moving: list[list[oracle.Row]], static: list[list[oracle.Row]]
) -> None:
    ingested, written = tfdb.Buffer(history=None), tfdb.Buffer(history=None)
    for is_static, messages in ((True, static), (False, moving)):
        for rows in messages:
            data = oracle.encode(rows, encoding)
            commit = ingested.ingest(data, encoding=encoding, static=is_static)
            assert commit == store(rows, written, is_static)
    assert contents(ingested) == contents(written)
    first = 1_700_000_000_000_000_000
    stamps = [first - 1, first, first + 1_100_000_001, first + 9_999_999_999]
    assert answers(ingested, stamps) == answers(written, stamps)


@given(messages=oracle.good_messages(), encoding=st.sampled_from(oracle.THEIRS))
def test_many_at_once_are_the_same_as_one_by_one(
    messages: list[list[oracle.Row]], encoding: str
) -> None:
    one_by_one, at_once = tfdb.Buffer(history=None), tfdb.Buffer(history=None)
    payloads = [oracle.encode(rows, encoding) for rows in messages]
    for data in payloads:
        one_by_one.ingest(data, encoding=encoding)
    result = at_once.ingest_many(iter(payloads), encoding=encoding)
    assert contents(at_once) == contents(one_by_one)
    assert (result.messages, result.refused, result.reasons) == (len(messages), 0, {})
    assert result.transforms == sum(map(len, messages))
    assert result.commits == sum(bool(rows) for rows in messages) == result.commit == at_once.commit


@given(
    pose=oracle.good_poses,
    other=oracle.good_poses,
    encoding=st.sampled_from(oracle.ENCODINGS),
)
def test_a_lookup_gives_the_pose_of_the_bytes(
    pose: tuple[float, ...], other: tuple[float, ...], encoding: str
) -> None:
    transforms = [
        tfdb.TransformStamped("map", "odom", STAMP, pose[:3], pose[3:]),
        tfdb.TransformStamped("odom", "base", STAMP, other[:3], other[3:]),
    ]
    buf = tfdb.Buffer()
    buf.ingest(tfdb.encode_tf_message(transforms, encoding), encoding=encoding)
    direct = buf.lookup_transform("map", "odom", STAMP)
    np.testing.assert_allclose(direct.pose, pose, rtol=0, atol=1e-12)
    whole = buf.lookup_transform("map", "base", STAMP)
    expected = direct.matrix @ buf.lookup_transform("odom", "base", STAMP).matrix
    np.testing.assert_allclose(whole.matrix, expected, rtol=0, atol=1e-12)


def test_one_message_is_one_commit() -> None:
    buf = tfdb.Buffer()
    assert buf.ingest(oracle.encode(ROWS, "cdr")) == 1
    later = [oracle.row("map", "odom", STAMP + 10, POSE)]
    assert buf.ingest(oracle.encode(later, "ros1"), encoding="ros1") == 2
    assert buf.ingest(oracle.encode([], "cdr")) == 2
    assert buf.frames() == ["base", "map", "odom"]


def test_static_and_authority() -> None:
    buf = tfdb.Buffer()
    buf.ingest(oracle.encode(ROWS[:1], "cdr"), static=True, authority="calibration")
    buf.ingest(oracle.encode(ROWS[1:], "cdr"), authority="/ekf")
    fixed, moving = buf.frame_info("odom"), buf.frame_info("base")
    assert (fixed.is_static, fixed.authority) == (True, "calibration")
    assert (moving.is_static, moving.authority) == (False, "/ekf")
    buf.ingest_many([oracle.encode(ROWS[1:], "ros1")], encoding="ros1", authority="replay")
    assert buf.frame_info("base").authority == "replay"
    with pytest.raises(tfdb.errors.StaticConflict):
        buf.ingest(oracle.encode(ROWS[:1], "cdr"))


def test_one_leading_slash_is_dropped() -> None:
    buf = tfdb.Buffer()
    buf.ingest(oracle.encode([oracle.row("/map", "//odom", STAMP, POSE)], "ros1"), encoding="ros1")
    assert buf.frames() == ["/odom", "map"]


@pytest.mark.parametrize(
    "wrap",
    [
        bytes,
        bytearray,
        memoryview,
        lambda data: array("B", data),
        lambda data: np.frombuffer(data, np.uint8),
        lambda data: memoryview(b"head" + data + b"tail")[4:-4],
    ],
)
def test_anything_that_holds_bytes(wrap: Any) -> None:
    buf = tfdb.Buffer()
    data = wrap(oracle.encode(ROWS, "cdr"))
    assert buf.ingest(data) == 1
    assert buf.ingest_many([data], encoding="cdr").commits == 1


@pytest.mark.parametrize("data", ["text", None, 7, [1, 2], memoryview(bytes(400))[::2]])
def test_other_types_than_bytes_raise_type_error(data: Any) -> None:
    buf = tfdb.Buffer()
    with pytest.raises(TypeError):
        buf.ingest(data)
    with pytest.raises(TypeError):
        buf.ingest_many([data], encoding="cdr")
    assert buf.commit == 0


@pytest.mark.parametrize("encoding", ["", "CDR", "json", "cdr\0", "\ud800"])
def test_unknown_encodings(encoding: str) -> None:
    buf = tfdb.Buffer()
    with pytest.raises((tfdb.InvalidArgument, tfdb.errors.InvalidName)):
        buf.ingest(oracle.encode(ROWS, "cdr"), encoding=encoding)
    with pytest.raises((tfdb.InvalidArgument, tfdb.errors.InvalidName)):
        buf.ingest_many([], encoding=encoding)
    assert buf.commit == 0


def replaced(data: bytes, offset: int, new: bytes) -> bytes:
    return data[:offset] + new + data[offset + len(new) :]


CDR = oracle.encode(ROWS, "cdr")


@pytest.mark.parametrize(
    ("data", "offset", "reason"),
    [
        (b"", 0, "encapsulation header"),
        (CDR[:-1], len(CDR) - 56, "truncated"),
        (CDR + bytes(4), len(CDR), "4 bytes follow"),
        (replaced(CDR, 0, b"\0\3"), 0, "00 03"),
        (replaced(CDR, 4, b"\xff\xff\xff\xff"), 4, "cannot fit"),
        (replaced(CDR, 16, struct.pack("<I", 2**31)), 16, "2147483648"),
        (replaced(CDR, 23, b"x"), 20, "NUL"),
    ],
)
def test_corrupt_messages_change_nothing(data: bytes, offset: int, reason: str) -> None:
    buf = tfdb.Buffer()
    buf.ingest(CDR)
    before = contents(buf)
    with pytest.raises(tfdb.errors.CorruptMessage) as caught:
        buf.ingest(data)
    assert caught.value.offset == offset
    assert caught.value.reason is not None
    assert reason in caught.value.reason
    assert reason in str(caught.value)
    assert contents(buf) == before


@pytest.mark.parametrize(
    ("bad", "error"),
    [
        (oracle.row("map", "x" * 1025, STAMP, POSE), tfdb.errors.InvalidName),
        (oracle.row("map", "new\nline", STAMP, POSE), tfdb.errors.InvalidName),
        (oracle.row("/", "child", STAMP, POSE), tfdb.errors.InvalidName),
        (oracle.row("map", "map", STAMP, POSE), tfdb.errors.InvalidTransform),
        (oracle.row("base", "map", STAMP, POSE), tfdb.errors.CycleError),
        (oracle.row("map", "nan", STAMP, (float("nan"), *POSE[1:])), tfdb.errors.InvalidTransform),
        (oracle.row("map", "zero", STAMP, (*POSE[:3], 0, 0, 0, 0)), tfdb.errors.InvalidTransform),
    ],
)
@pytest.mark.parametrize("encoding", ["ros1", "cdr", "cdr_be"])
def test_one_bad_member_leaves_the_others(
    bad: oracle.Row, error: type[tfdb.TfdbError], encoding: str
) -> None:
    expected = tfdb.Buffer()
    expected.ingest(oracle.encode(ROWS, encoding), encoding=encoding)
    data = oracle.encode([*ROWS, bad], encoding)
    one, many = tfdb.Buffer(), tfdb.Buffer()
    with pytest.warns(tfdb.TfdbWarning, match=f"^{error.__name__}: .*; the rest of its message"):
        assert one.ingest(data, encoding=encoding) == 1
    assert one.ingest(data, encoding=encoding) == 2  # each edge and error warns once
    result = many.ingest_many([data], encoding=encoding)
    assert (result.transforms, result.commits, result.refused) == (2, 1, 0)
    assert result.refused_transforms == 1
    (refused,) = result.refused_edges
    assert (refused.edge, refused.error, refused.count) == (bad.child[:1024], error.__name__, 1)
    assert contents(many) == contents(expected)
    many.ingest_many([data], encoding=encoding)
    assert contents(many) == contents(one)
    assert answers(many, [STAMP]) == answers(one, [STAMP])
    alone = oracle.encode([bad], encoding)
    if error is not tfdb.errors.CycleError:  # by itself it closes none
        before = contents(many)
        with pytest.raises(error) as caught:
            many.ingest(alone, encoding=encoding)
        assert caught.value.index == 0
        assert many.ingest_many([alone], encoding=encoding).refused == 1
        assert contents(many) == before


def ros1_message(parent: bytes, child: bytes) -> bytes:
    """One transform, also with names that no Python str can hold."""
    names = b"".join(struct.pack("<I", len(name)) + name for name in (parent, child))
    return struct.pack("<IIII", 1, 0, 1, 2) + names + struct.pack("<7d", *POSE)


@example(name=b"\xed\x9f\xbf\xf4\x8f\xbf\xbf\xc2\x80")  # the last of each range is a character
@example(name=b"\xed\xa0\x80")  # a surrogate
@example(name=b"\xf4\x90\x80\x80")  # beyond U+10FFFF
@example(name=b"\xc0\xaf")  # an overlong slash
@example(name=b"\xe0\x9f\xbf")
@example(name=b"\xf0\x8f\xbf\xbf")
@example(name=b"abc\xe2\x82")  # cut short
@given(
    name=st.lists(
        st.sampled_from([b"a", b"\x80", b"\xbf", b"\xc2", b"\xe0", b"\xed", b"\xf0", b"\xf4"])
        | st.binary(min_size=1, max_size=1)
        | st.characters(codec="utf-8").map(lambda c: c.encode()),
        min_size=1,
        max_size=6,
    ).map(b"".join)
)
def test_names_are_utf8_without_control_characters(name: bytes) -> None:
    buf = tfdb.Buffer()
    data = ros1_message(b"map", b"x" + name)
    try:
        text = name.decode()
    except UnicodeDecodeError:
        text = "\n"
    if any(c < " " or c == "\x7f" for c in text):
        with pytest.raises((tfdb.errors.InvalidName, tfdb.errors.CorruptMessage)):
            buf.ingest(data, encoding="ros1")
        assert buf.frames() == []
    else:
        buf.ingest(data, encoding="ros1")
        assert buf.frames() == sorted(["map", "x" + text], key=str.encode)


def test_refused_messages_are_counted_and_the_others_stored() -> None:
    buf = tfdb.Buffer()
    later = oracle.encode([oracle.row("map", "odom", STAMP + 10, POSE)], "cdr")
    loop = oracle.encode([oracle.row("base", "map", STAMP, POSE)], "cdr")
    empty = oracle.encode([], "cdr")
    result = buf.ingest_many([CDR, CDR[:50], loop, empty, later, b"\1\2"], encoding="cdr")
    assert (result.messages, result.transforms, result.commits) == (6, 3, 2)
    assert (result.refused, result.commit) == (3, 2)
    assert set(result.reasons) == {"CorruptMessage", "CycleError"}
    corrupt = result.reasons["CorruptMessage"]
    assert (corrupt.count, corrupt.index) == (2, 1)
    assert "byte 4" in corrupt.first
    assert (result.reasons["CycleError"].count, result.reasons["CycleError"].index) == (1, 2)
    assert buf.samples("odom")[0].tolist() == [STAMP, STAMP + 10]


def test_more_messages_than_one_round_takes() -> None:
    buf = tfdb.Buffer(history=None)
    payloads = (
        oracle.encode([oracle.row("map", "odom", STAMP + i, POSE)], "cdr") for i in range(2500)
    )
    result = buf.ingest_many(payloads, encoding="cdr")
    assert (result.messages, result.commits, result.refused) == (2500, 2500, 0)
    assert buf.samples("odom")[0].tolist() == [STAMP + i for i in range(2500)]


def test_an_error_of_the_iterable_passes_through() -> None:
    def messages() -> Any:
        yield CDR
        raise OSError("the disk is gone")

    with pytest.raises(OSError, match="the disk is gone"):
        tfdb.Buffer().ingest_many(messages(), encoding="cdr")


def test_ingest_many_amid_a_transaction_raises() -> None:
    buf = tfdb.Buffer()
    message = oracle.encode(ROWS, "ros1")
    with buf.transaction(), pytest.raises(tfdb.errors.TransactionActive):
        buf.ingest_many([message], encoding="ros1")
    assert buf.commit == 0

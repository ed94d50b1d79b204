"""`decode_tf_message` and `encode_tf_message` against rosbags."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader

import tfdb
from tests.wire import oracle

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

LAST_STAMP = 2**61 - 1
HAND_MADE = [
    oracle.row("ab", "größe/λ", 5_000_000_007, (1, -2, 0.5, 0, 0.6, 0, 0.8)),
    oracle.row("", "cde", 0, (5e-324, -0.0, 1e308, 0.5, -0.5, 0.5, -0.5)),
    oracle.row("/abs", "/", oracle.LAST_NANOSECOND, (0.1, 0.2, 0.3, 0.6, 0, 0.8, 0)),
]


def stripped(rows: list[oracle.Row]) -> list[oracle.Row]:
    return [
        oracle.Row(
            oracle.without_slash(r.parent), oracle.without_slash(r.child), r.stamp, r.numbers
        )
        for r in rows
    ]


def transforms_of(rows: list[oracle.Row]) -> list[tfdb.TransformStamped]:
    return [tfdb.TransformStamped(r.parent, r.child, r.stamp, r.pose[:3], r.pose[3:]) for r in rows]


def decoded_or_refused(data: bytes | bytearray, encoding: str) -> Any:
    """The transforms, or None after a refusal that keeps what errors promise."""
    try:
        return tfdb.decode_tf_message(data, encoding)
    except (tfdb.errors.CorruptMessage, tfdb.errors.InvalidName, tfdb.InvalidStamp) as error:
        refusal = error
    if isinstance(refusal, tfdb.errors.InvalidName):
        assert "UTF-8" in str(refusal) or "control character" in str(refusal)
    elif isinstance(refusal, tfdb.InvalidStamp):
        assert refusal.index is not None
        assert refusal.reason == "negative" or "a second or more" in str(refusal)
    else:
        assert refusal.reason
        assert refusal.offset is not None
        assert 0 <= refusal.offset <= len(data)
    return None


@pytest.mark.parametrize("encoding", oracle.THEIRS)
@example(rows=HAND_MADE, seq=7)
@given(rows=oracle.any_messages, seq=st.integers(0, 2**32 - 1))
def test_reads_messages_of_rosbags(encoding: str, rows: list[oracle.Row], seq: int) -> None:
    data = oracle.encode(rows, encoding, seq=seq)
    assert oracle.rows_of(tfdb.decode_tf_message(data, encoding)) == stripped(rows)


@pytest.mark.parametrize("encoding", oracle.THEIRS)
@example(rows=HAND_MADE)
@given(rows=oracle.any_messages)
def test_writes_the_bytes_of_rosbags(encoding: str, rows: list[oracle.Row]) -> None:
    # What starts with a slash gets another one: readers drop the first.
    unslashed = [r for r in rows if not r.parent.startswith("/") and not r.child.startswith("/")]
    data = tfdb.encode_tf_message(transforms_of(unslashed), encoding)
    assert data == oracle.encode(unslashed, encoding)
    assert oracle.decode(data, encoding) == unslashed


@pytest.mark.parametrize("encoding", oracle.ENCODINGS)
@example(rows=HAND_MADE)
@given(rows=oracle.any_messages)
def test_round_trip_is_exact(encoding: str, rows: list[oracle.Row]) -> None:
    data = tfdb.encode_tf_message(transforms_of(rows), encoding)
    assert oracle.rows_of(tfdb.decode_tf_message(data, encoding)) == rows


@given(rows=oracle.any_messages)
def test_cdr_goes_by_the_header(rows: list[oracle.Row]) -> None:
    for encoding in ("cdr_le", "cdr_be", "cdr2_le", "cdr2_be"):
        data = tfdb.encode_tf_message(transforms_of(rows), encoding)
        assert oracle.rows_of(tfdb.decode_tf_message(data, "cdr")) == rows


@given(rows=oracle.any_messages)
def test_the_old_type_of_ros1_has_the_same_bytes(rows: list[oracle.Row]) -> None:
    old = oracle.encode(rows, "ros1", name=oracle.OLD_MESSAGE)
    assert oracle.rows_of(tfdb.decode_tf_message(old, "ros1")) == stripped(rows)


@pytest.mark.parametrize("encoding", oracle.ENCODINGS)
def test_every_truncation_is_refused(encoding: str) -> None:
    data = tfdb.encode_tf_message(transforms_of(HAND_MADE), encoding)
    for size in range(len(data)):
        assert decoded_or_refused(data[:size], encoding) is None


@pytest.mark.parametrize("encoding", oracle.ENCODINGS)
@example(rows=HAND_MADE, damage=[(11, 0xFF)])
@given(
    rows=oracle.any_messages,
    damage=st.lists(st.tuples(st.integers(0, 2**16), st.integers(0, 255)), min_size=1, max_size=4),
)
def test_damaged_bytes_are_refused_or_read_as_a_message(
    encoding: str, rows: list[oracle.Row], damage: list[tuple[int, int]]
) -> None:
    data = bytearray(tfdb.encode_tf_message(transforms_of(rows), encoding))
    for position, value in damage:
        data[position % len(data)] = value
    read = decoded_or_refused(data, encoding)
    if read is None:
        return
    # Seconds of 32 bits reach further than stamps: what is read says so, and cannot be written.
    beyond = [i for i, transform in enumerate(read) if transform.stamp > LAST_STAMP]
    if beyond:
        with pytest.raises(tfdb.InvalidStamp) as caught:
            tfdb.encode_tf_message(read, encoding)
        assert caught.value.index == beyond[0]
        return
    again = tfdb.encode_tf_message(read, encoding)
    assert oracle.rows_of(tfdb.decode_tf_message(again, encoding)) == oracle.rows_of(read)


@given(data=st.binary(max_size=300))
def test_noise_never_crashes(data: bytes) -> None:
    for encoding in oracle.ENCODINGS:
        decoded_or_refused(data, encoding)


def test_ros1_stamps_reach_further_than_those_of_cdr() -> None:
    [transform] = transforms_of([oracle.row("a", "b", LAST_STAMP, HAND_MADE[0].pose)])
    data = tfdb.encode_tf_message([transform], "ros1")
    assert tfdb.decode_tf_message(data, "ros1")[0].stamp == LAST_STAMP
    with pytest.raises(tfdb.InvalidStamp) as caught:
        tfdb.encode_tf_message([transforms_of(HAND_MADE)[0], transform], "cdr")
    assert (caught.value.index, caught.value.stamp) == (1, LAST_STAMP)


def test_a_name_with_a_nul_is_not_written() -> None:
    [transform] = transforms_of([oracle.row("a", "b\0c", 1, HAND_MADE[0].pose)])
    with pytest.raises(tfdb.errors.InvalidName):
        tfdb.encode_tf_message([transform], "cdr")


def raw_messages(files: list[Path]) -> Iterator[tuple[str, bytes, Any]]:
    """Encoding, payload and rosbags' own reading of each message of transforms."""
    with AnyReader(files, default_typestore=oracle.typestore(ros1=False)) as reader:
        ros1 = not reader.is2
        wanted = [c for c in reader.connections if c.msgtype.lower().endswith("tfmessage")]
        assert wanted
        for connection, _, data in reader.messages(connections=wanted):
            encoding = "ros1" if ros1 else "cdr"
            name = oracle.OLD_MESSAGE if connection.msgtype.startswith("tf/") else oracle.MESSAGE
            yield encoding, bytes(data), oracle.decode(bytes(data), encoding, name=name)


def check_recording(files: list[Path], at_least: int) -> None:
    transforms = 0
    for encoding, data, expected in raw_messages(files):
        read = tfdb.decode_tf_message(data, encoding)
        assert oracle.rows_of(read) == stripped(expected)
        again = tfdb.encode_tf_message(read, encoding)
        assert tfdb.decode_tf_message(again, encoding) == read
        transforms += len(read)
    assert transforms >= at_least


@pytest.mark.parametrize("name", ["pr2.bag", "pr2.mcap"])
def test_the_shipped_recording(repository: Path, name: str) -> None:
    check_recording([repository / "examples" / "data" / name], at_least=1000)


@pytest.mark.parametrize(
    ("name", "at_least"),
    [
        ("panda/rosbagFrankaPanda.bag", 900),
        ("panda/ros2", 900),
        ("turtlebot3/rosbag2_turtlebot3_tf", 500),
        ("turtlebot_nav/tf_example.bag", 500),
        ("turtlebot_nav/tf_example", 500),
    ],
)
def test_recordings_of_real_robots(shared_data: Path, name: str, at_least: int) -> None:
    check_recording([shared_data / name], at_least)


@pytest.mark.parametrize("encoding", oracle.ENCODINGS)
def test_columns_are_encoded_as_their_rows(encoding: str) -> None:
    poses = np.array([[1, 2, 3, 0, 0.6, 0, 0.8], [4, -5, 6, 0.8, 0, 0, -0.6]])
    rows = [
        tfdb.TransformStamped("map", child, stamp, tuple(pose[:3]), tuple(pose[3:]))
        for child, stamp, pose in zip(("a", "/b"), (5, 7), poses.tolist(), strict=True)
    ]
    columns = tfdb.Columns("map", ["a", "/b"], np.array([5, 7]), poses)
    expected = tfdb.encode_tf_message(rows, encoding)
    assert tfdb.encode_tf_message(columns, encoding) == expected
    named = tfdb.Columns(["map", "map"], ["a", "/b"], [5, 7], poses)
    assert tfdb.encode_tf_message(named, encoding) == expected
    static = tfdb.encode_tf_message(tfdb.Columns("map", ["a", "/b"], None, poses), encoding)
    assert [one.stamp for one in tfdb.decode_tf_message(static, encoding)] == [0, 0]


@pytest.mark.parametrize("encoding", oracle.ENCODINGS)
def test_columns_of_a_store_come_back_bit_for_bit(encoding: str) -> None:
    """Those of the change feed, and edges at one stamp; static ones at 0 and at given stamps."""
    rng = np.random.default_rng(3)
    buffer = tfdb.Buffer(history=None)
    turns = rng.normal(size=(6, 4))
    poses = np.hstack([rng.normal(size=(6, 3)), turns / np.linalg.norm(turns, axis=1)[:, None]])
    names = [f"frame{i}" for i in range(6)]
    buffer.set_transforms(tfdb.Columns("map", names[:4], [5, 9, 7, LAST_STAMP // 4], poses[:4]))
    buffer.set_transforms(tfdb.Columns("map", names[4:], None, poses[4:]), static=True)
    moving, static = buffer.changes(0)
    at_one_stamp = tfdb.Columns("map", names[4:], [8, 8], buffer.lookup_edges(names[4:]))
    for columns, stamps in (
        (moving.stored, [5, 9, 7, LAST_STAMP // 4]),
        (static.stored_static, [0, 0]),
        (at_one_stamp, [8, 8]),
    ):
        data = tfdb.encode_tf_message(columns, encoding)
        back = tfdb.decode_tf_message(data, encoding)
        assert [(one.parent, one.child) for one in back] == [
            ("map", child) for child in columns.children
        ]
        assert [one.stamp for one in back] == stamps
        found = np.array([(*one.translation, *one.rotation) for one in back])
        np.testing.assert_array_equal(found.view(np.int64), columns.poses.view(np.int64))


def test_columns_that_cannot_be_encoded_name_the_row() -> None:
    poses = np.tile([1.0, 2, 3, 0, 0.6, 0, 0.8], (3, 1))
    with pytest.raises(tfdb.InvalidStamp) as stamp:
        tfdb.encode_tf_message(tfdb.Columns("map", "a", [1, 2, -3], poses))
    assert stamp.value.index == 2
    with pytest.raises(tfdb.errors.InvalidName) as name:
        tfdb.encode_tf_message(tfdb.Columns("map", ["a", "b\ud800", "c"], [1, 2, 3], poses))
    assert name.value.index == 1
    with pytest.raises(tfdb.errors.InvalidArray, match="3 rows"):
        tfdb.encode_tf_message(tfdb.Columns("map", ["a", "b"], [1, 2, 3], poses))

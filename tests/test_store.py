"""Writing, and reading back."""

from __future__ import annotations

import gc
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import tfdb
from oracle import matrix, quaternion
from robot import COUNT, MOVING, SECOND, STATIC, make_robot, stamp_of

TURN = quaternion((1, -2, 0.5), 0.9)
BACK = quaternion((0, 1, 3), -1.4)


def ros1_message(parent: str, child: str, stamp: int) -> object:
    """What rospy would give: secs and nsecs."""
    return SimpleNamespace(
        header=SimpleNamespace(
            frame_id=parent, stamp=SimpleNamespace(secs=stamp // SECOND, nsecs=stamp % SECOND)
        ),
        child_frame_id=child,
        transform=SimpleNamespace(
            translation=SimpleNamespace(x=1.0, y=2.0, z=3.0),
            rotation=SimpleNamespace(x=TURN[0], y=TURN[1], z=TURN[2], w=TURN[3]),
        ),
    )


def ros2_message(parent: str, child: str, stamp: int) -> object:
    """What rclpy would give: sec and nanosec."""
    message = ros1_message(parent, child, stamp)
    message.header.stamp = SimpleNamespace(sec=stamp // SECOND, nanosec=stamp % SECOND)
    return message


# -- commits ---------------------------------------------------------------------------------------


def test_each_write_is_one_commit() -> None:
    buffer = tfdb.Buffer()
    assert buffer.commit == 0
    assert buffer.set_transform("map", "base", 5, (1, 2, 3), TURN) == 1
    assert buffer.set_static_transform("base", "camera", (0, 0, 1), BACK) == 2
    batch = [tfdb.TransformStamped("map", "base", stamp, (1, 2, 3), TURN) for stamp in (6, 7, 8)]
    assert buffer.set_transforms(batch) == 3
    assert buffer.clear() == 4
    assert buffer.remove_frames("camera") == 5
    assert buffer.commit == 5


def test_an_empty_batch_commits_nothing() -> None:
    buffer = tfdb.Buffer()
    buffer.set_transform("map", "base", 5, (1, 2, 3), TURN)
    assert buffer.set_transforms([]) == 1
    empty = tfdb.Columns([], [], np.empty(0, np.int64), np.empty((0, 7)))
    assert buffer.set_transforms(empty) == 1


def test_a_transform_maps_the_child_into_the_parent() -> None:
    buffer = tfdb.Buffer()
    buffer.set_transform("map", "base", 5, (1, 2, 3), quaternion((0, 0, 1), np.pi / 2))
    found = buffer.lookup_transform("map", "base", 5)
    # A point one metre ahead of the base, which looks along the map's y.
    assert found.apply([1.0, 0.0, 0.0]) == pytest.approx([1, 3, 3])
    back = buffer.lookup_transform("base", "map", 5)
    assert back.apply([1.0, 3.0, 3.0]) == pytest.approx([1, 0, 0])


@pytest.mark.parametrize(
    ("translation", "rotation"),
    [
        ((1.0, 2.0, 3.0), TURN),
        ([1, 2, 3], list(TURN)),
        (np.array([1.0, 2.0, 3.0]), np.array(TURN)),
        (np.array([1, 2, 3], np.int32), np.array([*TURN, 9.0])[:4]),
        (np.array([1.0, 0, 2.0, 0, 3.0, 0])[::2], np.array([*TURN])),
        (SimpleNamespace(x=1, y=2, z=3), SimpleNamespace(**dict(zip("xyzw", TURN, strict=True)))),
        (range(1, 4), TURN),
        ((np.float32(1), np.int8(2), 3), TURN),
    ],
)
def test_translations_and_rotations_come_in_many_forms(
    translation: object, rotation: object
) -> None:
    buffer = tfdb.Buffer()
    buffer.set_transform("map", "base", 5, translation, rotation)
    expected = matrix([1, 2, 3, *TURN])
    assert buffer.lookup_transform("map", "base", 5).matrix == pytest.approx(expected, abs=1e-15)
    buffer.set_static_transform("base", "camera", translation, rotation)
    assert buffer.lookup_transform("base", "camera").matrix == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize("message", [ros1_message, ros2_message])
def test_messages_of_both_ros_are_taken(message: object) -> None:
    buffer = tfdb.Buffer()
    stamp = 1_700_000_000_123_456_789
    assert buffer.set_transforms([message("map", "base", stamp)]) == 1
    found = buffer.lookup_transform("map", "base", stamp)
    assert found.stamp == stamp
    assert found.pose == pytest.approx([1, 2, 3, *TURN])


# -- what a lookup returned ------------------------------------------------------------------------


def found_in(stamp: int | None = 15) -> tuple[tfdb.Buffer, tfdb.Transform]:
    """A store, and what a lookup in it returned."""
    source = tfdb.Buffer(history=None)
    for at in (10, 20):
        source.set_transform("map", "odom", at, (at, 2, 3), TURN)
    source.set_static_transform("odom", "base", (4, 5, 6), BACK)
    return source, source.lookup_transform("map", "base", stamp)


def test_a_transform_of_a_lookup_is_stored_under_its_names_and_stamp() -> None:
    _, found = found_in()
    for store in (
        lambda buf: buf.set_transform(found, authority="copy"),
        lambda buf: buf.set_transforms([found], authority="copy"),
        lambda buf: buf.run(lambda tx: tx.set_transform(found, authority="copy")),
        lambda buf: buf.run(lambda tx: tx.set_transforms([found], authority="copy")),
        lambda buf: buf.set_transform("map", "base", found.stamp, found, authority="copy"),
    ):
        buffer = tfdb.Buffer()
        store(buffer)
        info = buffer.frame_info("base")
        assert (info.parent, info.newest, info.authority) == ("map", 15, "copy")
        again = buffer.lookup_transform("map", "base", 15)
        assert again.pose.tolist() == found.pose.tolist()
        assert again.apply([1.0, 2, 3]) == pytest.approx(found.apply([1.0, 2, 3]))


@pytest.mark.parametrize(
    "given",
    [
        tfdb.TransformStamped("map", "base", 15, (1, 2, 3), TURN),
        tfdb.TransformStamped("map", "base", 0, (1, 2, 3), TURN),
        ros1_message("map", "base", 15),
        ros2_message("/map", "/base", 15),
    ],
)
def test_one_stamped_transform_is_stored_as_a_batch_of_one(given: Any) -> None:
    one, many = tfdb.Buffer(), tfdb.Buffer()
    assert one.set_transform(given) == many.set_transforms([given]) == 1
    assert one.tree() == many.tree()
    np.testing.assert_array_equal(one.samples("base")[1], many.samples("base")[1])


def test_the_rules_of_writing_hold_for_a_whole_transform() -> None:
    _, found = found_in()
    buffer = tfdb.Buffer()
    assert buffer.set_transform(found) == 1
    with pytest.raises(tfdb.errors.RepeatedStamp):
        buffer.set_transform(found, only_new=True)
    buffer.set_static_transform("map", "lamp", (1, 2, 3))
    lamp = tfdb.Transform("map", "lamp", (3, 2, 1), TURN, 15)
    with pytest.raises(tfdb.errors.StaticConflict):
        buffer.set_transform(lamp)
    assert buffer.set_transform(lamp, change_kind=True) == 3
    assert not buffer.frame_info("lamp").is_static


def test_a_transform_without_a_stamp_is_refused_as_a_moving_one() -> None:
    source, _ = found_in()
    still = source.lookup_transform("odom", "base")
    assert still.stamp == 0
    buffer = tfdb.Buffer()
    for write in (
        lambda: buffer.set_transform(still),
        lambda: buffer.set_transforms([still]),
        lambda: buffer.run(lambda tx: tx.set_transform(still)),
        lambda: buffer.run(lambda tx: tx.set_transforms([still])),
    ):
        with pytest.raises(tfdb.InvalidStamp, match=r"T\[odom<-base\].*set_transforms"):
            write()
    assert buffer.commit == 0
    assert buffer.set_transforms([still], static=True) == 1
    assert buffer.frame_info("base").is_static
    assert buffer.set_transform("odom", "tool", 7, tfdb.Transform("odom", "tool", still.pose)) == 2


def test_members_without_a_stamp_are_refused_with_their_index() -> None:
    source, found = found_in()
    still = source.lookup_transform("odom", "base")
    buffer = tfdb.Buffer()
    with pytest.raises(tfdb.InvalidStamp) as caught:
        buffer.set_transforms([found, still])
    assert caught.value.index == 1
    refused = buffer.set_transforms([found, still], partial=True)
    assert [(member.index, member.error) for member in refused] == [(1, "InvalidStamp")]
    assert buffer.frames() == ["base", "map"]


def test_a_transform_is_written_as_a_message_with_its_names_and_stamp() -> None:
    source, found = found_in()
    still = source.lookup_transform("odom", "base")
    read = tfdb.decode_tf_message(tfdb.encode_tf_message([found, still]))
    told = [(each.parent, each.child, each.stamp) for each in read]
    assert told == [("map", "base", 15), ("odom", "base", 0)]


@pytest.mark.parametrize(
    "call",
    [
        lambda buf, found: buf.set_transform(found, 15),
        lambda buf, found: buf.set_transform(found, stamp=15),
        lambda buf, found: buf.set_transform(found, authority=5),
        lambda buf, found: buf.set_transform(found, only_new=1),
        lambda buf, found: buf.set_transform("map"),
        lambda buf, found: buf.set_transform(7),
        lambda buf, found: buf.set_transform(),
        lambda buf, found: buf.run(lambda tx: tx.set_transform(found, only_new=True)),
        lambda buf, found: buf.run(lambda tx: tx.set_transform("map")),
    ],
)
def test_a_whole_transform_excludes_other_arguments(call: Any) -> None:
    _, found = found_in()
    buffer = tfdb.Buffer()
    with pytest.raises(TypeError):
        call(buffer, found)
    assert buffer.commit == 0


class GenpyTime:
    """As in ROS 1: `to_nsec` beside the fields."""

    def __init__(self, stamp: int) -> None:
        self.stamp = stamp

    def to_nsec(self) -> int:
        return self.stamp


@pytest.mark.parametrize(
    "stamp",
    [
        1_700_000_000_123_456_789,
        np.int64(1_700_000_000_123_456_789),
        np.uint64(1_700_000_000_123_456_789),
        SimpleNamespace(sec=1_700_000_000, nanosec=123_456_789),
        SimpleNamespace(sec=np.int32(1_700_000_000), nanosec=np.uint32(123_456_789)),
        SimpleNamespace(secs=1_700_000_000, nsecs=123_456_789),
        SimpleNamespace(nanoseconds=1_700_000_000_123_456_789),
        GenpyTime(1_700_000_000_123_456_789),
        np.datetime64(1_700_000_000_123_456_789, "ns"),
    ],
)
def test_stamps_come_in_many_forms_and_lose_nothing(stamp: object) -> None:
    buffer = tfdb.Buffer()
    buffer.set_transform("map", "base", stamp, (1, 2, 3), TURN)
    info = buffer.frame_info("base")
    assert info.newest == 1_700_000_000_123_456_789
    assert buffer.lookup_transform("map", "base", stamp).stamp == 1_700_000_000_123_456_789
    assert buffer.can_transform("map", "base", stamp, tfdb.Exact())


def test_coarse_datetimes_are_exact_stamps() -> None:
    buffer = tfdb.Buffer()
    buffer.set_transform("map", "base", np.datetime64("2023-11-14T22:13:20", "s"), (1, 2, 3), TURN)
    assert buffer.frame_info("base").newest == 1_700_000_000 * SECOND


@pytest.mark.parametrize(
    ("seconds", "nanoseconds"),
    [
        (0, 0),
        (0.1, 100_000_000),
        (12.5, 12_500_000_000),
        ("1700000000.123456789", 1_700_000_000_123_456_789),
        ("0.0000000005", 0),
        ("0.0000000015", 2),
        (1e-9, 1),
        (2305843009, 2_305_843_009_000_000_000),
    ],
)
def test_stamp_converts_seconds(seconds: float | str, nanoseconds: int) -> None:
    assert tfdb.stamp(seconds) == nanoseconds


# -- columns ---------------------------------------------------------------------------------------


def test_columns_equal_single_writes() -> None:
    robot = make_robot()
    buffer = tfdb.Buffer(history=None)
    stamps = np.repeat([stamp_of(i) for i in range(COUNT)], len(MOVING))
    children = list(MOVING) * COUNT
    rows = [robot.buffer.samples(child)[1] for child in MOVING]
    poses = np.stack(rows, axis=1).reshape(-1, 7)
    columns = tfdb.Columns([MOVING[child] for child in children], children, stamps, poses)
    assert len(columns) == COUNT * len(MOVING)
    assert buffer.set_transforms(columns, authority="columns") == 1
    for child, parent in MOVING.items():
        stamps_of, poses_of, parents = buffer.samples(child)
        assert parents == [parent] * COUNT
        np.testing.assert_array_equal(stamps_of, robot.buffer.samples(child)[0])
        np.testing.assert_allclose(poses_of, robot.buffer.samples(child)[1], atol=1e-15)
        assert buffer.frame_info(child).authority == "columns"


def test_columns_take_one_name_for_all_rows_and_parts_of_poses() -> None:
    buffer = tfdb.Buffer(history=None)
    translations = np.arange(30.0).reshape(10, 3)
    columns = tfdb.Columns(
        "map", "base", range(10), translations=translations, rotations=np.tile(TURN, (10, 1))
    )
    buffer.set_transforms(columns)
    assert buffer.lookup_transform("map", "base", 7).pose == pytest.approx([21, 22, 23, *TURN])


def test_columns_without_stamps_are_static() -> None:
    buffer = tfdb.Buffer()
    pose = [1, 2, 3, *TURN]
    columns = tfdb.Columns(["base", "base"], ["left", "right"], None, [pose, pose])
    buffer.set_transforms(columns, static=True)
    assert buffer.frame_info("left").is_static
    assert buffer.lookup_transform("base", "right", 10**18).pose == pytest.approx(pose)


# -- what later commits change ---------------------------------------------------------------------


def test_history_drops_old_samples() -> None:
    buffer = tfdb.Buffer(history=1.0)
    assert buffer.history == 1.0
    for i in range(100):
        buffer.set_transform("map", "base", i * SECOND // 10, (i, 1, 2), TURN)
    stamps, _, _ = buffer.samples("base")
    assert stamps[0] == 89 * SECOND // 10
    assert stamps[-1] == 99 * SECOND // 10
    assert tfdb.Buffer(history=None).history is None


# -- snapshots -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "read",
    [
        lambda reads: reads.lookup_transform("map", "base"),
        lambda reads: reads.lookup_latest_transform("map", "base"),
        lambda reads: reads.can_transform("map", "base"),
        lambda reads: reads.lookup_transforms("map", "base", [stamp_of(1)]),
        lambda reads: reads.frames(),
        lambda reads: reads.tree(),
        lambda reads: reads.explain("map", "base"),
        lambda reads: reads.__enter__(),
    ],
)
def test_a_closed_snapshot_raises(read: object) -> None:
    robot = make_robot()
    snapshot = robot.buffer.snapshot()
    snapshot.close()
    with pytest.raises(tfdb.errors.SnapshotClosed) as caught:
        read(snapshot)
    assert caught.value.commit == robot.buffer.commit


def test_a_snapshot_outlives_the_name_of_its_buffer() -> None:
    snapshot = make_robot().buffer.snapshot()
    gc.collect()
    assert snapshot.lookup_transform("map", "camera").report.edges[0].child == "camera"


# -- looking at the store --------------------------------------------------------------------------


def test_frame_info_fields() -> None:
    info = make_robot().buffer.frame_info("left_arm")
    assert info == tfdb.types.FrameInfo(
        name="left_arm",
        parent="base",
        is_static=False,
        samples=COUNT,
        oldest=stamp_of(0),
        newest=stamp_of(COUNT - 1),
        rate=pytest.approx(10.0),
        authority="joints",
        late=0,
        longest_gap=SECOND // 10,
    )


def test_the_tree_lists_all_frames() -> None:
    buffer = make_robot().buffer
    parents = {info.name: info.parent for info in buffer.tree()}
    assert parents == {"map": None, **MOVING, **STATIC}
    assert list(parents) == buffer.frames() == sorted(parents)
    root = buffer.frame_info("map")
    assert (root.parent, root.samples, root.oldest, root.rate) == (None, 0, None, None)
    static = buffer.frame_info("lidar")
    assert (static.is_static, static.samples, static.newest) == (True, 1, None)
    buffer.clear()
    assert [info.name for info in buffer.tree() if info.cleared] == sorted(MOVING)
    assert static.authority == "urdf"


def test_samples_of_static_edges_and_roots() -> None:
    buffer = make_robot().buffer
    stamps, poses, parents = buffer.samples("lidar")
    assert (stamps.tolist(), poses.shape, parents) == ([0], (1, 7), ["base"])
    stamps, poses, parents = buffer.samples("map")
    assert (stamps.shape, poses.shape, parents) == ((0,), (0, 7), [])


def test_memory_and_counters_add_up() -> None:
    buffer = tfdb.Buffer()
    buffer.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0, 1.001))
    buffer.set_static_transform("base", "camera", (1, 2, 3), TURN)
    memory = buffer.memory()
    assert memory.frames == 3
    assert memory.samples == 2
    assert memory.used_bytes > memory.frame_bytes > 0
    assert buffer.counters().commits == 2
    assert buffer.counters().normalised == 1
    rotation = buffer.lookup_transform("map", "base", 5).rotation
    assert np.linalg.norm(rotation) == pytest.approx(1, abs=1e-15)


def test_the_buffer_prints_its_state() -> None:
    buffer = make_robot(history=60).buffer
    assert repr(buffer).startswith(f"<tfdb.Buffer at commit {buffer.commit}, history 60 s: ")
    snapshot = buffer.snapshot()
    assert repr(snapshot) == f"<tfdb.Snapshot of commit {buffer.commit}>"
    snapshot.close()
    assert repr(snapshot) == f"<tfdb.Snapshot of commit {buffer.commit}, closed>"

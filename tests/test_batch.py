"""Batches of stamps and points equal single lookups."""

from __future__ import annotations

import inspect
import threading
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from robot import COUNT, SECOND, Robot, make_robot, stamp_of
from tfdb.store.explain import from_one_state

if TYPE_CHECKING:
    from collections.abc import Callable

PAIRS = [
    ("map", "camera"),
    ("camera", "lidar"),
    ("lidar", "map"),
    ("base", "lidar"),
    ("map", "odom"),
]
POLICIES = [
    None,
    tfdb.Interpolate(0.2),
    tfdb.Previous(),
    tfdb.Nearest(),
    tfdb.Extrapolate(1.0),
]


@pytest.fixture(scope="module")
def robot() -> Robot:
    return make_robot()


def stamps_in(count: int, seed: int, *, is_sorted: bool) -> np.ndarray:
    """Random stamps over all samples, some of them exactly on one."""
    print(f"seed {seed}")
    random = np.random.default_rng(seed)
    stamps = random.integers(stamp_of(0), stamp_of(COUNT - 1), count, endpoint=True)
    stamps[::7] = [stamp_of(i) for i in random.integers(0, COUNT, len(stamps[::7]))]
    return np.sort(stamps) if is_sorted else stamps


def one_by_one(
    reads: tfdb._core.StoreReader, target: str, source: str, stamps: object, policy: object
) -> object:
    return np.array([reads.lookup_transform(target, source, int(t), policy).pose for t in stamps])


def same_poses(found: np.ndarray, expected: object) -> None:
    """Equal in every bit."""
    np.testing.assert_array_equal(found.view(np.int64), np.asarray(expected).view(np.int64))


# -- lookup_transforms -----------------------------------------------------------------------------


@pytest.mark.parametrize("is_sorted", [True, False])
@pytest.mark.parametrize("policy", POLICIES, ids=str)
@pytest.mark.parametrize(("target", "source"), PAIRS)
def test_rows_equal_single_lookups(
    robot: Robot, target: str, source: str, policy: tfdb.types.Policy | None, is_sorted: bool
) -> None:
    stamps = stamps_in(2000, 11, is_sorted=is_sorted)
    found = robot.buffer.lookup_transforms(target, source, stamps, policy)
    assert found.shape == (2000, 7)
    same_poses(found, one_by_one(robot.buffer, target, source, stamps, policy))


def test_rows_agree_with_numpy(robot: Robot) -> None:
    stamps = stamps_in(300, 12, is_sorted=False)
    matrices = robot.buffer.lookup_transforms("lidar", "camera", stamps, layout="matrix")
    assert matrices.shape == (300, 4, 4)
    for found, stamp in zip(matrices, stamps, strict=True):
        expected = robot.oracle.lookup("lidar", "camera", int(stamp))
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_small_window_of_many_samples(robot: Robot) -> None:
    """The usual scan: all stamps within a few samples of a long history."""
    buffer = tfdb.Buffer(history=None)
    for child, parent in (("odom", "map"), ("base", "odom")):
        _, poses, _ = robot.buffer.samples(child)
        many = np.tile(poses, (200, 1))
        buffer.set_transforms(tfdb.Columns(parent, child, np.arange(len(many)) * 1_000_000, many))
    stamps = np.linspace(4_000_000_000, 4_100_000_000, 5000).astype(np.int64)
    for order in (stamps, stamps[::-1], np.random.default_rng(5).permutation(stamps)):
        found = buffer.lookup_transforms("map", "base", order)
        same_poses(found[::50], one_by_one(buffer, "map", "base", order[::50], None))


@pytest.mark.parametrize(
    "form",
    [
        list,
        tuple,
        lambda stamps: iter(list(stamps)),
        lambda stamps: stamps.astype(np.uint64),
        lambda stamps: stamps.astype("datetime64[ns]"),
        lambda stamps: np.repeat(stamps, 3)[::3],
        lambda stamps: stamps[::-1][::-1],
        memoryview,
        lambda stamps: [np.datetime64(int(t), "ns") for t in stamps],
    ],
)
def test_stamps_come_in_many_forms(robot: Robot, form: object) -> None:
    stamps = stamps_in(50, 13, is_sorted=False)
    expected = robot.buffer.lookup_transforms("map", "camera", stamps)
    found = robot.buffer.lookup_transforms("map", "camera", form(stamps))
    np.testing.assert_array_equal(found, expected)


def test_no_stamps_give_no_rows(robot: Robot) -> None:
    empty = np.empty(0, np.int64)
    assert robot.buffer.lookup_transforms("map", "camera", empty).shape == (0, 7)
    assert robot.buffer.lookup_transforms("map", "camera", [], layout="matrix").shape == (0, 4, 4)
    with pytest.raises(tfdb.UnknownFrame):
        robot.buffer.lookup_transforms("map", "nothing", empty)


def test_out_is_filled_and_returned(robot: Robot) -> None:
    stamps = stamps_in(100, 14, is_sorted=True)
    poses = np.full((100, 7), np.nan)
    assert robot.buffer.lookup_transforms("map", "camera", stamps, out=poses) is poses
    np.testing.assert_array_equal(poses, robot.buffer.lookup_transforms("map", "camera", stamps))
    matrices = np.full((300, 4, 4), np.nan)
    part = matrices[100:200]
    found = robot.buffer.lookup_transforms("map", "camera", stamps, layout="matrix", out=part)
    assert found is part
    assert np.isnan(matrices).sum() == 200 * 16


class Rows(np.ndarray):
    """An array that is not just numpy's."""


@pytest.mark.parametrize(
    "form",
    [
        lambda array: array.view(Rows),
        memoryview,
        lambda array: np.ndarray(array.shape, array.dtype, memoryview(array).cast("B")),
    ],
)
@pytest.mark.parametrize("count", [1, 2, 200])
def test_memory_of_other_objects(robot: Robot, form: Callable[[Any], Any], count: int) -> None:
    stamps = stamps_in(count, 17, is_sorted=False)
    memory = np.full((count, 7), np.nan)
    out = form(memory)
    found = robot.buffer.lookup_transforms("map", "camera", form(stamps), out=out)
    assert found is out
    same_poses(memory, one_by_one(robot.buffer, "map", "camera", stamps, None))


@pytest.mark.parametrize("count", [1, 3, 40])
def test_names_mean_the_frames_of_the_state_that_is_read(count: int) -> None:
    """A name that was looked up before and then means another frame, or none."""
    buffer = tfdb.Buffer()
    cup = (0.0, 0.0, 0.6, 0.8)

    def rows(reads: tfdb._core.StoreReader) -> Any:
        found = reads.lookup_transforms("map", "cup", np.full(count, 5))
        same_poses(found, one_by_one(reads, "map", "cup", [5] * count, None))
        return found[:, :3].tolist()

    buffer.set_transform("map", "cup", 5, (1, 2, 3), cup)
    assert rows(buffer) == [[1, 2, 3]] * count
    with buffer.snapshot() as before:
        buffer.remove_frames("cup")
        for _ in range(2):
            with pytest.raises(tfdb.UnknownFrame) as caught:
                buffer.lookup_transforms("map", "cup", np.full(count, 5))
            assert caught.value.frame == "cup"
        buffer.set_transform("map", "cup", 5, (4, 5, 6), cup)
        for _ in range(2):
            assert rows(buffer) == [[4, 5, 6]] * count
            assert rows(before) == [[1, 2, 3]] * count


def test_arguments_are_those_of_the_signature(robot: Robot) -> None:
    stamps = np.array([stamp_of(1.5)])
    expected = robot.buffer.lookup_transforms("map", "camera", stamps)
    named = {"source": "camera", "target": "map", "policy": None, "stamps": stamps}
    same_poses(robot.buffer.lookup_transforms(**named), expected)
    calls: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = [
        ("missing the argument 'stamps'", ("map", "camera"), {}),
        ("at most 4 positional", ("map", "camera", stamps, None, "pose"), {}),
        ("unexpected keyword argument 'shape'", ("map", "camera", stamps), {"shape": 7}),
        ("multiple values for argument 'target'", ("map", "camera", stamps), {"target": "map"}),
        ("target must be a str", (1, "camera", stamps), {}),
        ("layout must be a str", ("map", "camera", stamps), {"layout": None}),
    ]
    for words, positional, keywords in calls:
        with pytest.raises(TypeError, match=words):
            robot.buffer.lookup_transforms(*positional, **keywords)
    assert str(inspect.signature(tfdb.Buffer.lookup_transforms)) == (
        "(self, /, target, source, stamps, policy=None, *, "
        "layout='pose', out=None, missing='raise')"
    )


def test_missing_rows_raise_or_are_nan(robot: Robot) -> None:
    stamps = stamps_in(100, 15, is_sorted=False)
    stamps[[17, 60]] = [5, stamp_of(COUNT + 3)]
    with pytest.raises(tfdb.Extrapolation) as caught:
        robot.buffer.lookup_transforms("map", "camera", stamps)
    assert caught.value.index == 17
    assert caught.value.stamp == 5
    found = robot.buffer.lookup_transforms("map", "camera", stamps, missing="nan")
    assert np.flatnonzero(np.isnan(found).any(axis=1)).tolist() == [17, 60]
    assert np.isnan(found[17]).all()
    kept = np.delete(stamps, [17, 60])
    expected = robot.buffer.lookup_transforms("map", "camera", kept)
    same_poses(np.delete(found, [17, 60], axis=0), expected)
    gaps = robot.buffer.lookup_transforms(
        "map", "odom", [stamp_of(1.5), stamp_of(2)], tfdb.Interpolate(0.01), missing="nan"
    )
    assert np.isnan(gaps).all(axis=1).tolist() == [True, False]


def test_a_parent_that_changes_within_the_batch() -> None:
    buffer = tfdb.Buffer(history=None)
    robot = make_robot()
    poses = robot.buffer.samples("odom")[1]
    buffer.set_static_transform("map", "left", poses[0][:3], poses[0][3:])
    buffer.set_static_transform("map", "right", poses[9][:3], poses[9][3:])
    for i in range(COUNT):
        parent = "left" if i < COUNT // 2 else "right"
        buffer.set_transform(parent, "cup", stamp_of(i), poses[i][:3], poses[i][3:])
    stamps = stamps_in(500, 16, is_sorted=True)
    found = buffer.lookup_transforms("map", "cup", stamps)
    same_poses(found, one_by_one(buffer, "map", "cup", stamps, None))


def test_a_batch_reads_one_commit() -> None:
    """While a writer turns two edges as a pair, no row of a batch sees half of it."""
    buffer = tfdb.Buffer()
    count = 20_000  # enough for the GIL to be released
    stamps = np.full(count, 5)

    def write(value: float) -> None:
        # Along the path the two cancel out.
        buffer.set_transforms(
            [
                tfdb.TransformStamped("map", "a", 5, (value, 1, 2), (0, 0, 0, 1)),
                tfdb.TransformStamped("a", "b", 5, (-value, 3, 4), (0, 0, 0, 1)),
            ]
        )

    write(0.0)
    done = threading.Event()

    def keep_writing() -> None:
        value = 0.0
        while not done.is_set():
            value += 1.0
            write(value)

    writer = threading.Thread(target=keep_writing)
    writer.start()
    try:
        for _ in range(50):
            found = buffer.lookup_transforms("map", "b", stamps)
            np.testing.assert_array_equal(found[:, :3], np.tile([0.0, 4.0, 6.0], (count, 1)))
    finally:
        done.set()
        writer.join()


# -- transform_points ------------------------------------------------------------------------------


def expected_points(robot: Robot, points: np.ndarray, stamps: np.ndarray) -> np.ndarray:
    moved = [
        robot.buffer.lookup_transform("map", "lidar", int(stamp)).apply(np.float64(point))
        for point, stamp in zip(points, stamps, strict=True)
    ]
    return np.array(moved).reshape(-1, 3)


@pytest.mark.parametrize("is_sorted", [True, False])
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_points_move_each_at_its_own_stamp(robot: Robot, dtype: type, is_sorted: bool) -> None:
    stamps = stamps_in(1000, 21, is_sorted=is_sorted)
    points = np.random.default_rng(22).normal(size=(1000, 3)).astype(dtype)
    expected = expected_points(robot, points, stamps)
    found = robot.buffer.transform_points("map", "lidar", points, stamps)
    assert found.dtype == dtype
    np.testing.assert_array_equal(found, expected.astype(dtype))
    cloud = np.full((1000, 5), -1.0, dtype)
    cloud[:, :3] = points
    strided = robot.buffer.transform_points("map", "lidar", cloud[:, :3], stamps)
    np.testing.assert_array_equal(strided, found)
    out = np.zeros((1000, 4), dtype)
    assert robot.buffer.transform_points("map", "lidar", points, stamps, out=out[:, :3]) is not None
    np.testing.assert_array_equal(out[:, :3], found)
    assert not out[:, 3].any()
    view = cloud[:, :3]
    assert robot.buffer.transform_points("map", "lidar", view, stamps, out=view) is view
    np.testing.assert_array_equal(cloud[:, :3], found)
    assert (cloud[:, 3:] == -1).all()


def test_one_stamp_for_all_points(robot: Robot) -> None:
    points = np.random.default_rng(23).normal(size=(100, 3))
    stamp = stamp_of(7.3)
    found = robot.buffer.transform_points("map", "lidar", points, stamp)
    expected = robot.buffer.lookup_transform("map", "lidar", stamp).apply(points)
    np.testing.assert_array_equal(found, expected)
    many = robot.buffer.transform_points("map", "lidar", points, [stamp] * 100)
    np.testing.assert_array_equal(many, found)
    for one in (np.array(stamp), np.array(stamp, "datetime64[ns]"), np.datetime64(stamp, "ns")):
        np.testing.assert_array_equal(
            robot.buffer.transform_points("map", "lidar", points, one), found
        )


@pytest.mark.parametrize("dtype", [np.int64, np.int32, np.uint8, list])
def test_points_of_integers_become_floats(robot: Robot, dtype: type) -> None:
    stamp = stamp_of(7.3)
    numbers = [[1, 2, 3], [4, 5, 6]]
    points = numbers if dtype is list else np.array(numbers, dtype)
    found = robot.buffer.transform_points("map", "lidar", points, [stamp, stamp])
    expected = robot.buffer.transform_points("map", "lidar", np.array(numbers, float), stamp)
    assert found.dtype == np.float64
    np.testing.assert_array_equal(found, expected)


def test_no_points_need_no_stamp(robot: Robot) -> None:
    none = robot.buffer.transform_points("map", "lidar", np.empty((0, 3), np.float32), [])
    assert (none.shape, none.dtype) == ((0, 3), np.float32)


def test_points_out_of_range_are_named(robot: Robot) -> None:
    stamps = [stamp_of(1), stamp_of(2), stamp_of(COUNT)]
    with pytest.raises(tfdb.Extrapolation) as caught:
        robot.buffer.transform_points("map", "lidar", np.zeros((3, 3)), stamps)
    assert caught.value.index == 2


# -- trajectory ------------------------------------------------------------------------------------


def test_a_trajectory_at_the_stored_stamps(robot: Robot) -> None:
    found = robot.buffer.trajectory("map", "camera")
    np.testing.assert_array_equal(found.stamps, [stamp_of(i) for i in range(COUNT)])
    same_poses(found.poses, one_by_one(robot.buffer, "map", "camera", found.stamps, None))
    assert (found.target, found.source, len(found)) == ("map", "camera", COUNT)
    assert found.duration == pytest.approx(3.9)
    assert found.translations.shape == (COUNT, 3)
    assert found.rotations.shape == (COUNT, 4)
    part = robot.buffer.trajectory("map", "camera", start=stamp_of(3), end=stamp_of(5.5))
    np.testing.assert_array_equal(part.stamps, [stamp_of(i) for i in (3, 4, 5)])


def test_a_trajectory_at_a_rate(robot: Robot) -> None:
    found = robot.buffer.trajectory("map", "camera", rate=30.0)
    assert found.stamps[0] == stamp_of(0)
    assert len(found) == 118
    np.testing.assert_array_equal(np.unique(np.diff(found.stamps)), [33_333_333, 33_333_334])
    same_poses(found.poses, one_by_one(robot.buffer, "map", "camera", found.stamps, None))
    exact = robot.buffer.trajectory("map", "camera", 10.0, stamp_of(2), stamp_of(4))
    np.testing.assert_array_equal(exact.stamps, [stamp_of(i) for i in (2, 3, 4)])
    still = robot.buffer.trajectory("base", "lidar", 2.0, 0, 3 * SECOND)
    assert len(still) == 7
    assert repr(still) == "<tfdb.Trajectory T[base<-lidar], 7 poses from 0 s to 3 s>"


def test_a_trajectory_without_a_stored_stamp_names_the_needed_arguments() -> None:
    buf = tfdb.Buffer()
    buf.set_static_transform("base", "camera", (1, 0, 0))
    buf.set_transform("map", "base", 5, (1, 0, 0))
    for rate in (None, 10.0):
        with pytest.raises(tfdb.InvalidArgument, match=r"no edge .* moves: give rate, start and"):
            buf.trajectory("base", "camera", rate)
    assert len(buf.trajectory("base", "camera", 10.0, 0, 10**9)) == 11
    with pytest.raises(tfdb.InvalidArgument, match=r"no stored stamp from .*: give rate \(--rate"):
        buf.trajectory("map", "camera", None, 6, 7)


def test_a_trajectory_covers_the_common_range_of_all_edges() -> None:
    buffer = tfdb.Buffer(history=None)
    for stamp in (10, 20, 30):
        buffer.set_transform("map", "odom", stamp, (1, 2, 3), (0, 0, 0, 1))
        buffer.set_transform("odom", "base", stamp + 5, (1, 2, 3), (0, 0, 0, 1))
    np.testing.assert_array_equal(buffer.trajectory("map", "base").stamps, [15, 20, 25, 30])
    with buffer.snapshot() as snapshot:
        assert len(snapshot.trajectory("map", "base")) == 4
        assert not snapshot.closed


def test_a_trajectory_begins_again_where_writers_took_its_state(robot: Robot) -> None:
    tries: list[tfdb.Snapshot] = []

    def read(snapshot: tfdb.Snapshot) -> int:
        tries.append(snapshot)
        if len(tries) < 3:
            raise tfdb.errors.SnapshotTooOld("gone")
        return snapshot.commit

    assert from_one_state(robot.buffer, read) == robot.buffer.commit
    assert len(tries) == 3
    tries.clear()
    with robot.buffer.snapshot() as held, pytest.raises(tfdb.errors.SnapshotTooOld):
        from_one_state(held, read)
    assert len(tries) == 1

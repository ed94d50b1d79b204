"""Bad arrays, columns and trajectories raise a typed error and leave the store unchanged."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tfdb
from oracle import quaternion
from refused_calls import refused
from robot import COUNT, Robot, make_robot, stamp_of

TURN = quaternion((1, -2, 0.5), 0.9)
NAN = float("nan")
INF = float("inf")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return make_robot()


# -- arrays ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stamps", "error", "words"),
    [
        (np.array([1.5, 2.5]), tfdb.errors.InvalidArray, "float64"),
        (np.array([True, False]), tfdb.errors.InvalidArray, "bool"),
        (np.array(["a"]), tfdb.errors.InvalidArray, "<U1"),
        (np.zeros((2, 2), np.int64), tfdb.errors.InvalidArray, "(2, 2)"),
        (np.int64(5), tfdb.errors.InvalidArray, "a single one: write [stamp]"),
        (np.zeros(2, "timedelta64[ns]"), tfdb.errors.InvalidArray, "timedelta64"),
        (7, tfdb.errors.InvalidArray, "int"),
        ("7", tfdb.errors.InvalidArray, "str"),
        (None, tfdb.errors.InvalidArray, "NoneType"),
        ({stamp_of(1), stamp_of(2)}, tfdb.errors.InvalidArray, "a set, which has no order"),
        (frozenset([stamp_of(1)]), tfdb.errors.InvalidArray, "a frozenset, which has no order"),
        (np.array([stamp_of(1), -1]), tfdb.InvalidStamp, "negative"),
        (np.array([stamp_of(1), 2**63], np.uint64), tfdb.InvalidStamp, "too large"),
        (np.array([np.datetime64(stamp_of(1), "ns"), np.datetime64("NaT")]), tfdb.InvalidStamp, ""),
        ([stamp_of(1), 2.5], tfdb.InvalidStamp, "float"),
    ],
)
def test_arrays_of_stamps(
    robot: Robot, stamps: Any, error: type[tfdb.TfdbError], words: str
) -> None:
    with refused(robot.buffer, error) as caught:
        robot.buffer.lookup_transforms("map", "odom", stamps)
    assert words in str(caught.value)
    if error is tfdb.InvalidStamp:
        assert caught.value.index == 1
    columns = tfdb.Columns("map", "odom", stamps, np.tile([1, 2, 3, *TURN], (2, 1)))
    with refused(robot.buffer, error):
        robot.buffer.set_transforms(columns)


@pytest.mark.parametrize(
    "out",
    [
        np.zeros((2, 7), np.float32),
        np.zeros((3, 7)),
        np.zeros((2, 4, 4)),
        np.zeros(14),
        np.zeros((7, 2)).T,
        np.zeros((2, 14))[:, ::2],
        np.zeros((2, 7), ">f8"),
        np.frombuffer(bytes(112)).reshape(2, 7),
        [[0.0] * 7] * 2,
    ],
)
def test_out_of_the_wrong_kind(robot: Robot, out: Any) -> None:
    with refused(robot.buffer, tfdb.errors.InvalidArray) as caught:
        robot.buffer.lookup_transforms("map", "odom", [stamp_of(1), stamp_of(2)], out=out)
    assert "float64 (2, 7)" in str(caught.value)
    if isinstance(out, np.ndarray):
        assert str(out.shape) in str(caught.value)


def test_columns_take_stamps_that_come_once(robot: Robot) -> None:
    poses = np.tile([1, 2, 3, *TURN], (2, 1))
    columns = tfdb.Columns("map", "odom", iter([stamp_of(90), -1]), poses)
    for _ in range(2):
        with refused(robot.buffer, tfdb.InvalidStamp) as caught:
            robot.buffer.set_transforms(columns)
        assert caught.value.index == 1
    with refused(robot.buffer, tfdb.errors.InvalidArray) as array:
        robot.buffer.transform_points("map", "odom", np.zeros((2, 3)), {stamp_of(1), stamp_of(2)})
    assert "a set, which has no order" in str(array.value)


def overlapping() -> dict[str, Any]:
    memory = np.zeros((4, 3))
    return {"points": memory[:3], "out": memory[1:]}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"points": np.zeros((3, 2))}, "(3, 2)"),
        ({"points": np.zeros(3)}, "(3,)"),
        ({"points": np.zeros((1, 3, 3))}, "(1, 3, 3)"),
        ({"points": np.zeros((3, 3), bool)}, "bool"),
        ({"points": np.zeros((3, 3), complex)}, "complex128"),
        ({"points": np.zeros((3, 3), ">f8")}, ">f8"),
        ({"points": np.zeros((3, 3)).T}, "strides"),
        ({"points": np.zeros((3, 6))[:, ::2]}, "strides"),
        ({"points": np.zeros((3, 3))[::-1]}, "strides"),
        ({"points": np.lib.stride_tricks.as_strided(np.zeros(9), (3, 3), (8, 8))}, "strides"),
        ({"points": np.broadcast_to(np.zeros(3), (3, 3))}, "strides"),
        ({"points": [["a", "b", "c"]] * 3}, "float64"),
        ({"stamps": np.full(2, stamp_of(1))}, "2 stamps"),
        ({"stamps": np.full((3, 1), stamp_of(1))}, "(3, 1)"),
        ({"out": np.zeros((2, 3))}, "(2, 3)"),
        ({"out": np.zeros((3, 3), np.float32)}, "float64"),
        ({"out": [[0.0] * 3] * 3}, "list"),
        ({"out": np.zeros((3, 3)).T}, "strides"),
        (overlapping(), "overlap"),
    ],
)
def test_points_of_the_wrong_kind(robot: Robot, arguments: dict[str, Any], words: str) -> None:
    call: dict[str, Any] = {"points": np.zeros((3, 3)), "stamps": np.full(3, stamp_of(1))}
    with refused(robot.buffer, tfdb.errors.InvalidArray) as caught:
        robot.buffer.transform_points("map", "odom", **(call | arguments))
    assert words in str(caught.value)


def test_one_bad_stamp_for_all_points(robot: Robot) -> None:
    with refused(robot.buffer, tfdb.InvalidStamp):
        robot.buffer.transform_points("map", "odom", np.zeros((3, 3)), 1.5)


@pytest.mark.parametrize(
    "points", [np.zeros((3, 2)), np.zeros(4), [[1, 2]], "abc", np.zeros((2, 3, 3)), None]
)
def test_apply_of_the_wrong_shape(robot: Robot, points: Any) -> None:
    with refused(robot.buffer, tfdb.errors.InvalidArray):
        robot.buffer.lookup_transform("map", "odom").apply(points)


@pytest.mark.parametrize(
    "arguments",
    [
        {"poses": np.zeros((2, 6))},
        {"poses": np.zeros(14)},
        {"poses": "poses"},
        {"poses": [[1, 2, 3, 0, 0, 0, "w"]] * 2},
        {"poses": None},
        {"poses": None, "translations": np.zeros((2, 3))},
        {"translations": np.zeros((2, 3)), "rotations": np.zeros((2, 4))},
        {"poses": None, "translations": np.zeros((2, 2)), "rotations": np.zeros((2, 4))},
    ],
)
def test_columns_that_are_none(arguments: dict[str, Any]) -> None:
    call: dict[str, Any] = {"poses": np.tile([1, 2, 3, *TURN], (2, 1))} | arguments
    with pytest.raises(tfdb.errors.InvalidArray):
        tfdb.Columns("map", "odom", [1, 2], **call)


@pytest.mark.parametrize(
    ("parents", "children", "stamps", "error"),
    [
        (["map"], ["odom", "odom"], [1, 2], tfdb.errors.InvalidArray),
        ("map", ["odom"] * 3, [1, 2], tfdb.errors.InvalidArray),
        ("map", "odom", [1, 2, 3], tfdb.errors.InvalidArray),
        ("map", "odom", [], tfdb.errors.InvalidArray),
        ("map", "odom", None, tfdb.errors.InvalidArray),
        (["map", ""], "new", [1, 2], tfdb.errors.InvalidName),
        (["map", "\ud800"], "new", [1, 2], tfdb.errors.InvalidName),
    ],
)
def test_columns_that_do_not_fit(
    robot: Robot, parents: Any, children: Any, stamps: Any, error: type[tfdb.TfdbError]
) -> None:
    columns = tfdb.Columns(parents, children, stamps, np.tile([1, 2, 3, *TURN], (2, 1)))
    with refused(robot.buffer, error) as caught:
        robot.buffer.set_transforms(columns)
    if error is tfdb.errors.InvalidName:
        assert caught.value.index == 1


def test_columns_with_one_bad_row(robot: Robot) -> None:
    poses = np.tile([1.0, 2.0, 3.0, *TURN], (5, 1))
    poses[3, 1] = NAN
    stamps = [stamp_of(50 + i) for i in range(5)]
    with refused(robot.buffer, tfdb.errors.InvalidTransform) as caught:
        robot.buffer.set_transforms(tfdb.Columns("map", "odom", stamps, poses))
    assert caught.value.index == 3


@pytest.mark.parametrize("item", [7, None, ("map", "odom", 5), {"parent": "map"}, object()])
def test_batches_of_other_things(robot: Robot, item: object) -> None:
    commit = robot.buffer.commit
    with pytest.raises(TypeError, match="item 0"):
        robot.buffer.set_transforms([item])
    assert robot.buffer.commit == commit


# -- trajectories ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("stamps", "rows"),
    [([], 1), ([1, 3, 2], 3), ([1, 1], 2), ([1, 2], 3), ([1.0, 2.0], 2)],
)
def test_trajectories_with_bad_stamps(stamps: list[int], rows: int) -> None:
    with pytest.raises(tfdb.errors.InvalidArray):
        tfdb.Trajectory("map", "odom", np.array(stamps), np.zeros((rows, 7)))


def test_unsorted_trajectories_name_the_row() -> None:
    with pytest.raises(tfdb.errors.InvalidArray) as caught:
        tfdb.Trajectory("map", "odom", np.array([1, 3, 2]), np.zeros((3, 7)))
    assert (caught.value.index, caught.value.stamp) == (2, 2)


@pytest.mark.parametrize(
    "arguments",
    [
        {"rate": 0},
        {"rate": -1.0},
        {"rate": NAN},
        {"rate": INF},
        {"rate": True},
        {"rate": 1e12},
        {"rate": 1.0, "start": stamp_of(5), "end": stamp_of(4)},
        {"source": "lidar", "target": "base"},
        {"source": "lidar", "target": "base", "rate": 1.0},
        {"start": stamp_of(100)},
    ],
)
def test_trajectories_that_cannot_be(robot: Robot, arguments: dict[str, Any]) -> None:
    call: dict[str, Any] = {"target": "map", "source": "camera"} | arguments
    with refused(robot.buffer, tfdb.InvalidArgument):
        robot.buffer.trajectory(**call)


def test_a_trajectory_beyond_the_data(robot: Robot) -> None:
    with refused(robot.buffer, tfdb.Extrapolation) as caught:
        robot.buffer.trajectory("map", "camera", 1.0, stamp_of(0), stamp_of(COUNT + 10))
    assert caught.value.index == 4

"""Trajectories, judged by scipy, by a store and by single transforms."""

from __future__ import annotations

import copy
import math
import pickle
from decimal import Decimal
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import tfdb
from tfdb.errors import InvalidArray, InvalidTransform
from tfdb.trajectories import write_npz

if TYPE_CHECKING:
    from pathlib import Path

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
TURN = (0.1, -0.5, 0.7, 0.5)
A = tfdb.Transform("world", "map", (3.0, -2.0, 0.5), TURN, 7)
B = tfdb.Transform("base", "camera", (-0.2, 0.4, 1.1), (0.5, 0.5, -0.5, 0.5))


def random_path(count: int = 40, seed: int = 5, frames: tuple[str, str] = ("map", "base")) -> Any:
    """A path whose stamps are uneven, all of it turned and moved."""
    rng = np.random.default_rng(seed)
    stamps = START + np.cumsum(rng.integers(20_000_000, 120_000_000, count))
    turns = Rotation.from_rotvec(rng.normal(size=(count, 3)).cumsum(axis=0) * 0.3 + 0.5).as_quat()
    places = rng.normal(size=(count, 3)).cumsum(axis=0) + 10.0
    return tfdb.Trajectory(*frames, stamps, translations=places, rotations=turns)


def with_holes(path: Any, rows: list[int]) -> Any:
    poses = path.poses.copy()
    poses[rows] = np.nan
    return tfdb.Trajectory(path.target, path.source, path.stamps, poses)


def by_scipy(path: Any, stamps: Any) -> tuple[Any, Rotation]:
    """Linear and slerp."""
    times = (path.stamps - path.stamps[0]) / 1e9
    wanted = (np.asarray(stamps) - path.stamps[0]) / 1e9
    places = [np.interp(wanted, times, path.translations[:, i]) for i in range(3)]
    return np.stack(places, axis=1), Slerp(times, Rotation.from_quat(path.rotations))(wanted)


@pytest.fixture
def path() -> Any:
    return random_path()


# -- how it is made --------------------------------------------------------------------------------


def test_arrays_of_every_kind_make_the_same_trajectory(path: Any) -> None:
    stamps, poses = path.stamps, path.poses
    times = stamps.view("datetime64[ns]")
    for made in (
        tfdb.Trajectory("map", "base", stamps, poses),
        tfdb.Trajectory("map", "base", stamps.tolist(), poses.tolist()),
        tfdb.Trajectory("map", "base", iter(stamps.tolist()), poses),
        tfdb.Trajectory("map", "base", times, poses),
        tfdb.Trajectory("map", "base", list(times), poses),
        tfdb.Trajectory("map", "base", stamps.astype(np.uint64), np.asfortranarray(poses)),
        tfdb.Trajectory(
            "map", "base", stamps, translations=poses[:, :3], rotations=poses[:, 3:].tolist()
        ),
    ):
        assert made == path
    again = tfdb.Trajectory("map", "base", stamps, matrices=path.matrices)
    np.testing.assert_allclose(again.translations, path.translations, rtol=0, atol=0)
    apart = Rotation.from_quat(again.rotations).inv() * Rotation.from_quat(path.rotations)
    assert apart.magnitude().max() < 1e-14

    turns = Rotation.from_quat(path.rotations)
    of_scipy = tfdb.Trajectory(
        "map", "base", stamps, translations=path.translations, rotations=turns
    )
    np.testing.assert_allclose(of_scipy.matrices, path.matrices, atol=1e-15)
    assert len(tfdb.Trajectory("map", "base", [], [])) == 0


def test_poses_between_other_frames_are_refused(path: Any) -> None:
    back = path.inverse()
    for wrong in (back, list(back), [*list(path)[:-1], back[-1]]):
        with pytest.raises(
            tfdb.InvalidArgument, match=r"T\[base<-map\] was given for T\[map<-base\]"
        ):
            tfdb.Trajectory("map", "base", path.stamps, wrong)
        with pytest.raises(tfdb.InvalidArgument, match="was given for"):
            tfdb.Columns("map", "base", path.stamps, wrong)
    for right in (path, list(path), path.poses, (path @ B).poses):
        assert len(tfdb.Columns("map", "base", path.stamps, right)) == len(path)
        made = tfdb.Trajectory("map", "base", path.stamps, right)
        assert (made.poses == np.asarray(right)).all()


def test_where_all_poses_are_missing(path: Any) -> None:
    for frames in (("map", "base"), ("a", "b"), ("a", "a")):
        gone = tfdb.Trajectory(*frames, path.stamps, np.full((len(path), 7), np.nan))
        asked = path.stamps[3:7]
        assert np.isnan(gone.at(asked, missing="nan")).all()
        assert gone.at([], missing="nan").shape == (0, 7)
        assert gone.resample(stamps=asked, missing="nan").valid.tolist() == [False] * 4
        with pytest.raises(tfdb.InvalidStamp):
            gone.at([-5], missing="nan")
        for missing in ("raise", "skip"):
            with pytest.raises(tfdb.Extrapolation, match="has no pose to interpolate"):
                gone.resample(stamps=asked, missing=missing)
        with pytest.raises(tfdb.Extrapolation, match="has no pose to interpolate"):
            gone.at(asked)


@pytest.mark.parametrize("size", [3e-300, 1.0, 3e200])
def test_length_of_any_size(size: float) -> None:
    poses = np.array([[0, 0, 0, 0, 0, 0.6, 0.8], [3, 4, 12, 0, 0, 0, 1], [3, 4, 0, 0, 0, 0, 1.0]])
    poses[:, :3] *= size
    made = tfdb.Trajectory("map", "base", [1, 2, 3], poses)
    assert made.length == pytest.approx(25 * size, rel=1e-15, abs=0.0)


def test_it_keeps_read_only_copies(path: Any) -> None:
    poses = path.poses.copy()
    made = tfdb.Trajectory("map", "base", path.stamps, poses)
    poses[:] = 0.0
    assert made == path
    for array in (path.poses, path.stamps, path.translations, path.rotations):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(AttributeError):
        path.source = "other"
    with pytest.raises(AttributeError):
        path.other = 5


def test_a_quaternion_slightly_off_is_mended_as_the_store_does(path: Any) -> None:
    poses = path.poses.copy()
    poses[3, 3:] *= 1.004
    made = tfdb.Trajectory("map", "base", path.stamps, poses)
    np.testing.assert_allclose(made.poses, path.poses, atol=1e-15)
    assert (made.poses[4] == path.poses[4]).all()


POSE = [1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8]
HOLE = [math.nan] * 7
BAD: list[tuple[dict[str, Any], type[Exception], str]] = [
    ({"stamps": [5, 5]}, InvalidArray, r"stamps\[1\] = 5 follows 5: sort the rows first"),
    ({"stamps": [5, 4]}, InvalidArray, r"stamps\[1\] = 4 follows 5"),
    ({"stamps": [-5, 4]}, tfdb.InvalidStamp, r"stamps\[0\] = -5 is not a stamp: valid are 0 to"),
    ({"stamps": [4, 2**62]}, tfdb.InvalidStamp, r"stamps\[1\] = 4611686018427387904 is not"),
    ({"stamps": [4, 2**70]}, tfdb.InvalidStamp, "is too large"),
    ({"stamps": [0.5, 1.0]}, InvalidArray, r"got float64; tfdb.stamp\(\) converts seconds"),
    ({"stamps": ["a", "b"]}, InvalidArray, "stamps: expected"),
    ({"stamps": [[1], [2]]}, InvalidArray, r"got the shape \(2, 1\)"),
    ({"stamps": [1, [2]]}, InvalidArray, "stamps: expected"),
    ({"stamps": 5}, InvalidArray, "expected an array .* got 5"),
    ({"stamps": None}, InvalidArray, "expected an array .* got None"),
    ({"stamps": [5]}, InvalidArray, "1 stamps, but 2 poses"),
    ({"poses": None}, InvalidArray, "give poses"),
    ({"poses": [POSE, POSE[:6]]}, InvalidArray, "poses: expected"),
    ({"poses": [[1.0] * 6] * 2}, InvalidArray, r"poses: expected an array \(N, 7\)"),
    ({"poses": "abc"}, InvalidArray, "poses: expected"),
    ({"poses": [POSE, [0.0] * 7]}, InvalidTransform, r"poses\[1\] = \(0, 0, 0, 0, 0, 0, 0\)"),
    ({"poses": [POSE, [*POSE[:6], math.nan]]}, InvalidTransform, r"poses\[1\] .* unit"),
    ({"poses": [[math.inf, *POSE[1:]], POSE]}, InvalidTransform, r"poses\[0\] = \(inf, 2"),
    ({"poses": [[1e308] * 7, POSE]}, InvalidTransform, r"poses\[0\]"),
    ({"translations": [[1, 2, 3]] * 2}, InvalidArray, "give poses, or"),
    ({"matrices": np.eye(4)}, InvalidArray, "give matrices, or poses"),
    ({"poses": None, "matrices": np.eye(4)}, InvalidArray, r"\(N, 4, 4\) of float64, got"),
    ({"poses": None, "matrices": [np.eye(3)] * 2}, InvalidArray, r"\(N, 4, 4\)"),
    ({"poses": None, "matrices": ["a", "b"]}, InvalidArray, r"matrices: expected"),
    (
        {"poses": None, "matrices": np.stack([np.eye(4), np.diag([1, 1, -1, 1])])},
        InvalidTransform,
        r"matrices\[1\] is not a rigid transform",
    ),
    (
        {"poses": None, "matrices": np.stack([2 * np.eye(4), np.eye(4)])},
        InvalidTransform,
        r"matrices\[0\] is not a rigid transform",
    ),
    ({"target": ""}, tfdb.errors.InvalidName, "empty"),
    ({"source": "a\0b"}, tfdb.errors.InvalidName, "control"),
    ({"target": 5}, TypeError, "target must be str, the name of a frame, got 5"),
    ({"source": None}, TypeError, "source must be str"),
]  # fmt: skip


@pytest.mark.parametrize(("change", "error", "text"), BAD)
def test_invalid_trajectories_are_refused(change: dict[str, Any], error: type, text: str) -> None:
    good: dict[str, Any] = {"target": "map", "source": "base", "stamps": [4, 5]}
    good["poses"] = [POSE, HOLE]
    assert len(tfdb.Trajectory(**good)) == 2
    with pytest.raises(error, match=text):
        tfdb.Trajectory(**(good | change))


# -- parts of it -----------------------------------------------------------------------------------


def test_one_pose_is_a_transform(path: Any) -> None:
    third = path[3]
    assert isinstance(third, tfdb.Transform)
    assert (third.target, third.source, third.stamp) == ("map", "base", path.stamps[3])
    np.testing.assert_array_equal(third.pose, path.poses[3])
    assert path[-1].stamp == path.stamps[-1]
    assert path[np.int64(3)] == path[np.array(3)] == third
    assert [each.stamp for each in path] == path.stamps.tolist()
    assert list(path)[7] == path[7]
    np.testing.assert_array_equal(path.matrices[3], third.matrix)
    assert third in path


def test_parts_are_trajectories(path: Any) -> None:
    for rows in (
        slice(10, 20),
        slice(None, None, 3),
        slice(-5, None),
        [1, 2, 7],
        np.array([1, -1]),
        [-40, 39],
        (0, 5),
        path.translations[:, 0] > 10.0,
        [],
        slice(5, 5),
    ):
        part = path[rows]
        picked = np.array(rows, int) if isinstance(rows, tuple | list) else rows
        wanted = np.arange(len(path))[picked]
        assert (part.target, part.source, len(part)) == ("map", "base", len(wanted))
        np.testing.assert_array_equal(part.stamps, path.stamps[wanted])
        np.testing.assert_array_equal(part.poses, path.poses[wanted])


@pytest.mark.parametrize(
    ("rows", "error", "text"),
    [
        (40, tfdb.errors.InvalidIndex, "the pose 40 does not exist: valid are -40 to 39"),
        (-41, tfdb.errors.InvalidIndex, "the pose -41 does not exist"),
        (10**30, tfdb.errors.InvalidIndex, "the pose 10"),
        ([1, 40], tfdb.errors.InvalidIndex, "the pose 40 does not exist"),
        ([2, 1], InvalidArray, "stamps must increase"),
        ([1, 1], InvalidArray, "stamps must increase"),
        (slice(None, None, -1), InvalidArray, "stamps must increase"),
        (slice(None, None, 0), InvalidArray, "step"),
        (slice("a", None), InvalidArray, "slice"),
        ([True, False], InvalidArray, "a mask of 2 for 40 poses"),
        (True, InvalidArray, "indexed by rows, a slice or a mask, not by True"),
        (1.5, InvalidArray, "indexed by rows"),
        ("stamps", InvalidArray, "not by 'stamps'"),
        (None, InvalidArray, "not by None"),
        ([[1, 2]], InvalidArray, "indexed by rows"),
        ([[1], 2], InvalidArray, "indexed by rows"),
        ((slice(None), 0), InvalidArray, "indexed by rows"),
    ],
)
def test_rows_that_are_none(path: Any, rows: Any, error: type, text: str) -> None:
    with pytest.raises(error, match=text):
        path[rows]


def test_a_row_out_of_range_is_an_index_error(path: Any) -> None:
    with pytest.raises(IndexError) as caught:
        path[40]
    assert isinstance(caught.value, tfdb.InvalidArgument)
    assert caught.value.index == 40  # type: ignore[attr-defined]


def test_between_takes_both_ends(path: Any) -> None:
    stamps = path.stamps
    assert path.crop() == path
    assert path.crop(stamps[3], stamps[8]) == path[3:9]
    assert path.crop(stamps[3] + 1, stamps[8] - 1) == path[4:8]
    assert path.crop(end=stamps[8].view("M8[ns]")) == path[:9]
    assert len(path.crop(stamps[3] + 1, stamps[3] + 2)) == 0
    with pytest.raises(
        tfdb.InvalidArgument, match=r"end \(0.000000005 s\) is before start \(0.000000006 s\)"
    ):
        path.crop(6, 5)
    with pytest.raises(tfdb.InvalidStamp):
        path.crop(1.5)


# -- between the poses -----------------------------------------------------------------------------


def test_at_equals_scipys_interpolation(path: Any) -> None:
    rng = np.random.default_rng(3)
    stamps = rng.integers(path.stamps[0], path.stamps[-1], 500)
    stamps[17] = stamps[18]
    places, turns = by_scipy(path, stamps)
    found = path.at(stamps)
    np.testing.assert_allclose(found[:, :3], places, atol=1e-9)
    assert (Rotation.from_quat(found[:, 3:]).inv() * turns).magnitude().max() < 1e-9
    one = path.at(int(stamps[4]))
    assert (one.target, one.source, one.stamp) == ("map", "base", stamps[4])
    np.testing.assert_array_equal(one.pose, found[4])
    np.testing.assert_allclose(path.at(path.stamps), path.poses, atol=1e-15)


POLICIES = [
    None,
    tfdb.Interpolate(max_gap=0.09),
    tfdb.Exact(),
    tfdb.Previous(max_age=0.05),
    tfdb.Nearest(tolerance=0.02),
    tfdb.Extrapolate(max=0.2),
]


@pytest.mark.parametrize("policy", POLICIES, ids=repr)
def test_at_equals_a_stores_lookups(path: Any, policy: Any) -> None:
    store = tfdb.Buffer(history=None)
    store.set_transforms(tfdb.Columns("map", "base", path.stamps, path.poses))
    rng = np.random.default_rng(4)
    stamps = rng.integers(path.stamps[0] - SECOND // 4, path.stamps[-1] + SECOND // 4, 300)
    stamps[::7] = rng.choice(path.stamps, len(stamps[::7]))
    wanted = store.lookup_transforms("map", "base", stamps, policy, missing="nan")
    assert np.isnan(wanted).any()
    assert np.isfinite(wanted).any()
    np.testing.assert_array_equal(path.at(stamps, policy, missing="nan"), wanted)
    for stamp, pose in zip(stamps[:40].tolist(), wanted[:40], strict=True):
        if np.isfinite(pose).all():
            found = path.at(stamp, policy)
            np.testing.assert_array_equal(found.pose, pose)
            assert found.report == store.lookup_transform("map", "base", stamp, policy).report
            continue
        with pytest.raises(tfdb.TfdbError) as theirs:
            store.lookup_transform("map", "base", stamp, policy)
        with pytest.raises(type(theirs.value)) as ours:
            path.at(stamp, policy)
        assert str(ours.value) == str(theirs.value)


def test_at_refuses_stamps_without_a_pose(path: Any) -> None:
    with pytest.raises(tfdb.Extrapolation) as caught:
        path.at(path.stamps[0] - 1)
    assert caught.value.reason == "past"
    assert caught.value.oldest == path.stamps[0]
    with pytest.raises(tfdb.Extrapolation) as caught:
        path.at([path.stamps[0], path.stamps[-1] + 1])
    assert (caught.value.index, caught.value.reason) == (1, "future")
    for stamp in (None, 1.5, True, -1, object()):
        with pytest.raises(tfdb.InvalidStamp):
            path.at(stamp)
    for stamps in ("abc", [1.5], np.zeros((2, 2), int)):
        with pytest.raises((InvalidArray, tfdb.InvalidStamp)):
            path.at(stamps)
    with pytest.raises(tfdb.InvalidArgument):
        path.at([path.stamps[0]], missing="skip")


def test_resample_at_a_rate_and_at_stamps(path: Any) -> None:
    even = path.resample(50.0)
    assert (even.target, even.source) == ("map", "base")
    assert even.stamps[0] == path.stamps[0]
    assert set(np.diff(even.stamps)) == {20_000_000}
    assert path.stamps[-1] - even.stamps[-1] < 20_000_000
    np.testing.assert_array_equal(even.poses, path.at(even.stamps))
    other = path.stamps[:-1] + 1_000_000
    again = path.resample(stamps=other)
    np.testing.assert_array_equal(again.stamps, other)
    np.testing.assert_array_equal(again.poses, path.at(other))
    beyond = [0, *other.tolist()]
    assert path.resample(stamps=beyond, missing="skip") == again
    assert not path.resample(stamps=beyond, missing="nan").valid[0]
    strict = path.resample(50.0, policy=tfdb.Interpolate(0.08), missing="skip")
    assert 0 < len(strict) < len(even)
    assert len(path.resample(stamps=[], missing="skip")) == 0
    with pytest.raises(tfdb.Extrapolation):
        path.resample(stamps=beyond)
    with pytest.raises(tfdb.Extrapolation):
        path.resample(stamps=[0, 1], missing="skip")
    for bad in ({}, {"rate": 5.0, "stamps": [1]}, {"rate": 0.0}, {"rate": "fast"}):
        with pytest.raises(tfdb.InvalidArgument):
            path.resample(**bad)
    with pytest.raises(InvalidArray, match="must increase"):
        path.resample(stamps=[5, 5])
    with pytest.raises(tfdb.InvalidArgument, match="missing must be"):
        path.resample(50.0, missing="drop")


def test_a_trajectory_of_a_frame_in_itself() -> None:
    for name in ("map", "moving"):
        path = random_path(5, frames=(name, name))
        middle = path.at(int(path.stamps[1]) + 10)
        assert (middle.target, middle.source) == (name, name)
        np.testing.assert_array_equal(middle.pose, path.at([int(path.stamps[1]) + 10])[0])
        assert path.resample(20.0).source == name


# -- motion ----------------------------------------------------------------------------------------


def circle(radius: float, speed: float, lift: float) -> Any:
    """Round a tilted circle at an angular speed, facing ahead."""
    stamps = START + np.arange(0, 2 * SECOND, SECOND // 500)
    time = (stamps - START) / 1e9
    tilt = Rotation.from_euler("xyz", [0.4, -0.3, 1.0])
    places = np.stack([np.cos(speed * time), np.sin(speed * time), lift * time], 1) * radius
    turns = tilt * Rotation.from_rotvec(np.outer(speed * time, [0, 0, 1]))
    return (
        tfdb.Trajectory(
            "map", "base", stamps, translations=tilt.apply(places), rotations=turns.as_quat()
        ),
        tilt,
        time,
    )


def test_velocities_of_a_helix() -> None:
    radius, speed, lift = 3.0, 0.8, 0.2
    path, tilt, time = circle(radius, speed, lift)
    found = path.velocities(interval=0.02)
    turned = speed * time
    ahead = np.stack([-np.sin(turned) * speed, np.cos(turned) * speed, np.full(len(time), lift)], 1)
    inner = slice(6, -6)
    np.testing.assert_allclose(
        found.linear[inner], tilt.apply(ahead * radius)[inner], atol=1e-4 * radius
    )
    np.testing.assert_allclose(
        found.angular, np.tile(tilt.apply([0, 0, speed]), (len(time), 1)), atol=1e-7
    )
    assert path.length == pytest.approx(radius * math.hypot(speed, lift) * time[-1], rel=1e-5)


@pytest.mark.parametrize("interval", [0.1, 0.0333, 1e-9, 2.0, 1000.0])
def test_velocities_equal_lookup_velocity(path: Any, interval: float) -> None:
    store = tfdb.Buffer(history=None)
    store.set_transforms(tfdb.Columns("map", "base", path.stamps, path.poses))
    found = path.velocities(interval)
    for row, stamp in enumerate(path.stamps.tolist()):
        one = store.lookup_velocity("map", "base", stamp, interval)
        np.testing.assert_allclose(found.linear[row], one.linear, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(found.angular[row], one.angular, rtol=1e-12, atol=1e-12)


def test_velocities_that_there_are_not(path: Any) -> None:
    with pytest.raises(tfdb.Extrapolation, match="has one pose only") as caught:
        path[:1].velocities()
    assert caught.value.reason == "no data"
    for bad in (0, -1.0, math.nan, math.inf, "1", None, True, 1e-12, 1e12):
        with pytest.raises(tfdb.InvalidArgument, match="interval must be a number of seconds"):
            path.velocities(bad)


# -- other frames ----------------------------------------------------------------------------------


def test_inverse_and_products_are_those_of_each_transform(path: Any) -> None:
    back, left, right = path.inverse(), A @ path, path @ B
    assert (back.target, back.source) == ("base", "map")
    assert (left.target, left.source) == ("world", "base")
    assert (right.target, right.source) == ("map", "camera")
    for row, one in enumerate(path):
        np.testing.assert_array_equal(back[row].pose, one.inverse().pose)
        np.testing.assert_array_equal(left[row].pose, (A @ one).pose)
        np.testing.assert_array_equal(right[row].pose, (one @ B).pose)
    assert left.stamps.tolist() == path.stamps.tolist()
    np.testing.assert_allclose(left.matrices, A.matrix @ path.matrices, atol=1e-13)
    np.testing.assert_allclose(right.matrices, path.matrices @ B.matrix, atol=1e-13)
    np.testing.assert_allclose(back.matrices, np.linalg.inv(path.matrices), atol=1e-12)
    np.testing.assert_allclose(((A @ path) @ B).poses, (A @ (path @ B)).poses, atol=1e-13)


def test_products_that_do_not_chain(path: Any) -> None:
    text = r"T\[base<-camera\] @ T\[map<-base\] do not chain: the first maps from 'camera'"
    with pytest.raises(tfdb.InvalidArgument, match=text) as caught:
        B @ path
    assert (caught.value.source, caught.value.target) == ("camera", "map")
    with pytest.raises(tfdb.InvalidArgument, match=r"T\[map<-base\] @ T\[world<-map\] do not"):
        path @ A
    for other in (np.eye(4), [1, 2], path):
        with pytest.raises(TypeError, match="t @ T chains with a Transform, got a"):
            path @ other
    with pytest.raises(TypeError, match="unsupported operand"):
        path @ 5
    with pytest.raises(TypeError, match="unsupported operand"):
        5 @ path
    with pytest.raises(TypeError, match="T @ t chains with a Transform, got a list"):
        [1, 2] @ path


def test_a_result_that_is_not_finite(path: Any) -> None:
    poses = path.poses.copy()
    poses[2, :3] = 1.6e308
    far = tfdb.Trajectory("map", "base", path.stamps, poses)
    for compute in (far.inverse, lambda: A @ far):
        with pytest.raises(InvalidTransform, match=r"pose 2 of .* is not finite") as caught:
            compute()
        assert (caught.value.index, caught.value.reason) == (2, "not finite")


def test_merging(path: Any) -> None:
    even, odd = path[::2], path[1::2]
    assert odd.merge(even) == even.merge(odd) == path
    assert path.merge() == path
    assert path[:10].merge(path[30:], path[10:30]) == path
    other = tfdb.Trajectory("map", "base", path.stamps[3:5], [POSE, HOLE])
    joined = path.merge(other)
    np.testing.assert_array_equal(joined.poses[3], POSE)
    np.testing.assert_array_equal(joined.poses[4], path.poses[4])
    assert path[:0].merge(path, path[:0]) == path
    with pytest.raises(tfdb.InvalidArgument, match="their frames differ"):
        path.merge(path.inverse())
    with pytest.raises(TypeError, match="takes trajectories"):
        path.merge(None)


# -- poses that are missing ------------------------------------------------------------------------


def test_a_missing_pose_is_as_if_it_were_not_there(path: Any) -> None:
    gone = [0, 5, 6, 39]
    holes = with_holes(path, gone)
    found = holes[holes.valid]
    assert np.flatnonzero(~holes.valid).tolist() == gone
    assert len(found) == 36
    stamps = np.arange(found.stamps[0], found.stamps[-1], 7_000_000)
    np.testing.assert_array_equal(holes.at(stamps), found.at(stamps))
    assert holes.resample(20.0) == found.resample(20.0)
    assert holes.simplify(0.5, 0.3) == found.simplify(0.5, 0.3)
    assert holes.length == found.length
    with pytest.raises(tfdb.errors.GapTooLarge):
        holes.at(int(path.stamps[5]), tfdb.Interpolate(max_gap=0.121))
    velocities, wanted = holes.velocities(), found.velocities()
    for name in ("linear", "angular"):
        np.testing.assert_array_equal(getattr(velocities, name)[holes.valid], getattr(wanted, name))
        assert np.isnan(getattr(velocities, name)[gone]).all()
    for changed in (holes.inverse(), A @ holes, holes @ B, holes[1:-1]):
        assert np.isnan(changed.poses[~changed.valid]).all()
        assert (~changed.valid).sum() in (2, 4)
    assert np.isnan(holes.matrices[5]).all()
    assert tfdb.Trajectory("map", "base", path.stamps, matrices=holes.matrices).valid[7]
    with pytest.raises(
        tfdb.errors.NoSampleNear, match=r"pose 5 of T\[map<-base\] .* is missing: t\[t.v"
    ):
        holes[5]
    with pytest.raises(tfdb.errors.NoSampleNear) as caught:
        list(holes)
    assert caught.value.index == 0
    assert pickle.loads(pickle.dumps(holes)) == holes
    assert "nan" in holes._repr_html_()


@pytest.mark.parametrize("count", [0, 1])
def test_none_and_one(path: Any, count: int) -> None:
    few = path[:count]
    assert (len(few), few.duration, few.length) == (count, 0.0, 0.0)
    assert few.matrices.shape == (count, 4, 4)
    assert few == copy.deepcopy(few) == pickle.loads(pickle.dumps(few))
    assert len(few.inverse()) == len(A @ few) == len(few.simplify(0.1, 0.1)) == count
    assert few.crop() == few.merge() == few
    assert len(list(few)) == count
    assert few._repr_html_().count("<tr>") == count + 1
    missing = with_holes(few, list(range(count)))
    for empty in {id(each): each for each in (missing, path[:0])}.values():
        for ask in (
            lambda empty=empty: empty.at(START),
            lambda empty=empty: empty.at([START]),
            lambda empty=empty: empty.resample(5.0),
            lambda empty=empty: empty.velocities(),
        ):
            with pytest.raises(tfdb.Extrapolation, match="has no pose to interpolate") as caught:
                ask()
            assert caught.value.reason == "no data"
        with pytest.raises(tfdb.InvalidArgument, match="has no valid pose"):
            empty.plot()
    if count == 1:
        assert few.at(few.stamps[0]) == few[0]
        assert len(few.resample(5.0)) == 1
        with pytest.raises(tfdb.Extrapolation):
            few.at(few.stamps[0] + 1)
    with pytest.raises(tfdb.errors.InvalidIndex, match="it is empty"):
        path[:0][0]


# -- what Python and others ask --------------------------------------------------------------------


def test_it_pickles_copies_and_prints(path: Any, tmp_path: Path) -> None:
    path.at(path.stamps[0])  # the store that answers does not go with it
    for again in (pickle.loads(pickle.dumps(path)), copy.copy(path), copy.deepcopy(path)):
        assert again == path
        np.testing.assert_array_equal(again.at(path.stamps), path.at(path.stamps))
    text = repr(path)
    assert text.startswith("<tfdb.Trajectory T[map<-base], 40 poses from 17000")
    assert repr(path[:1]).startswith("<tfdb.Trajectory T[map<-base], 1 pose from 17000")
    assert repr(path[:0]) == "<tfdb.Trajectory T[map<-base], no poses>"
    html = random_path(40, frames=("<map>", "a&b"))._repr_html_()
    assert "T[&lt;map&gt;&lt;-a&amp;b]" in html
    assert html.count("<tr>") == 12
    assert random_path(10)._repr_html_().count("<tr>") == 11
    write_npz(tmp_path / "a.npz", path)
    again = tfdb.Trajectory.read(tmp_path / "a.npz", target="map", source="base")
    assert again == path
    assert again.repeated == path.repeated == 0


def test_it_is_drawn(path: Any, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    figure = path.plot(title="a drive")
    figure.savefig(tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 1000


def test_without_matplotlib(path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    import sys

    for name in [name for name in sys.modules if name.startswith(("tfdb.plot", "matplotlib"))]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(tfdb.errors.NotSupported, match=r"plot\(\) needs matplotlib: pip install"):
        path.plot()


def test_scipy_takes_its_rotations(path: Any) -> None:
    turns = Rotation.from_quat(path.rotations)
    np.testing.assert_allclose(turns.as_matrix(), path.matrices[:, :3, :3], atol=1e-14)
    point = np.array([0.5, -1.0, 2.0])
    np.testing.assert_allclose(
        turns.apply(point) + path.translations, [one.apply(point) for one in path], atol=1e-13
    )


def test_samples_of_a_store_stay_bit_identical() -> None:
    store = tfdb.Buffer(history=None)
    for target, source, seed in (("map", "odom", 1), ("odom", "base", 2), ("base", "hand", 3)):
        edge = random_path(60, seed)
        store.set_transforms(tfdb.Columns(target, source, edge.stamps, edge.poses))
    found = store.trajectory("map", "hand")
    wanted = store.lookup_transforms("map", "hand", found.stamps)
    np.testing.assert_array_equal(found.poses, wanted)
    for row in range(0, len(found), 7):
        np.testing.assert_array_equal(found[row].pose, wanted[row])
    assert pickle.loads(pickle.dumps(found)) == found
    np.testing.assert_array_equal(found[5:9].poses, wanted[5:9])


def test_the_pose_at_stamp_0_is_of_that_stamp() -> None:
    path = tfdb.Trajectory("map", "base", [0, 9], [A.pose, A.pose])
    assert repr(path[0]) == repr(path.at(0))
    assert "at 0 s" in repr(path[0])
    assert path[1].report.edges == path.at(9).report.edges


def test_no_stamps_have_no_poses() -> None:
    empty = tfdb.Trajectory("map", "base", [], np.zeros((0, 7)))
    missing = tfdb.Trajectory("map", "base", [5], np.full((1, 7), np.nan))
    for path in (empty, missing, random_path(5, 1)):
        assert path.at([]).shape == (0, 7)
        assert len(path.resample(stamps=[])) == 0
    for path in (empty, missing):
        with pytest.raises(tfdb.Extrapolation, match="no pose"):
            path.at([5])


@pytest.mark.parametrize("rate", [1e308, Decimal("sNaN"), Decimal("NaN")])
def test_rates_that_are_none(rate: Any) -> None:
    path = tfdb.Trajectory("map", "base", [0, 9 * 10**9], [A.pose, A.pose])
    store = tfdb.Buffer(history=None)
    store.set_transforms(tfdb.Columns("map", "base", path.stamps, path.poses))
    assert len(path.resample(1e-320)) == 1
    with pytest.raises(tfdb.InvalidArgument, match="rate"):
        path.resample(rate)
    with pytest.raises(tfdb.InvalidArgument, match="rate"):
        store.trajectory("map", "base", rate)


def test_many_poses() -> None:
    count = 200_000
    rng = np.random.default_rng(8)
    poses = np.tile([1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8], (count, 1))
    poses[:, 0] = rng.normal(size=count).cumsum()
    long = tfdb.Trajectory("map", "base", START + np.arange(count) * 1000, poses)
    assert long.at(START + 1500).pose[0] == pytest.approx(poses[1:3, 0].mean())
    assert long.velocities().linear.shape == (count, 3)
    assert len((A @ long).inverse()) == count
    assert len(long.resample(100.0)) == 20
    assert long.merge(long) == long
    assert long.length == pytest.approx(np.abs(np.diff(poses[:, 0])).sum())
    assert len(long._repr_html_()) < 10_000


# -- angles, seconds, speed, rows, files -----------------------------------------------------------


def test_rpy_is_that_of_scipy_and_of_single_transforms() -> None:
    path = random_path(200, seed=11)
    wanted = Rotation.from_quat(path.rotations).as_euler("xyz")
    np.testing.assert_allclose(path.rpy, wanted, atol=1e-12)
    np.testing.assert_allclose(path.rpy, [pose.rpy for pose in path], atol=1e-15)
    assert path.rpy.shape == (200, 3)
    assert path[:0].rpy.shape == (0, 3)
    holes = with_holes(path, [3, 50])
    assert np.flatnonzero(np.isnan(holes.rpy).any(axis=1)).tolist() == [3, 50]
    np.testing.assert_array_equal(holes.rpy[holes.valid], path.rpy[holes.valid])


def test_rpy_at_a_pitch_of_90_degrees_has_no_roll() -> None:
    turns = Rotation.from_euler("xyz", [[0.4, sign * np.pi / 2, 1.1] for sign in (1, -1)])
    path = tfdb.Trajectory("map", "base", [5, 6], translations=[[1, 2, 3]] * 2, rotations=turns)
    np.testing.assert_allclose(path.rpy, [pose.rpy for pose in path], atol=1e-15)
    np.testing.assert_array_equal(path.rpy[:, 0], [0.0, 0.0])
    again = Rotation.from_euler("xyz", path.rpy)
    np.testing.assert_allclose((again.inv() * turns).magnitude(), 0.0, atol=1e-7)


def test_seconds_count_from_the_first_stamp(path: Any) -> None:
    wanted = [float(Decimal(int(stamp - path.stamps[0])) / 10**9) for stamp in path.stamps]
    np.testing.assert_array_equal(path.seconds, wanted)
    assert path.seconds[-1] == path.duration
    assert path[4:].seconds[0] == 0.0
    assert path[:0].seconds.tolist() == []


def test_speed_is_the_length_of_the_velocity() -> None:
    path = random_path(60, seed=3)
    twists = path.velocities().linear
    np.testing.assert_allclose(path.speed, np.linalg.norm(twists, axis=1), rtol=1e-15)
    # 3 m/s around a circle of 10 m, seen from a frame that is turned and moved
    stamps = START + np.arange(200) * 10_000_000
    angles = 0.3 * (stamps - START) / 1e9
    places = 10 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    turns = Rotation.from_euler("z", angles[:, np.newaxis] + 1.0)
    circle = A @ tfdb.Trajectory("map", "base", stamps, translations=places, rotations=turns)
    np.testing.assert_allclose(circle.speed, 3.0, rtol=1e-3)
    assert np.flatnonzero(np.isnan(with_holes(circle, [7]).speed)).tolist() == [7]
    with pytest.raises(tfdb.Extrapolation, match="one pose only"):
        _ = circle[:1].speed


def test_to_numpy_is_a_table_that_from_table_takes_back(path: Any) -> None:
    holes = with_holes(path, [4])
    for each in (path, holes, path[:0]):
        rows = each.to_numpy()
        assert rows.shape == (len(each),)
        assert rows.dtype.names == ("stamp_ns", "x", "y", "z", "qx", "qy", "qz", "qw")
        assert rows["stamp_ns"].dtype == np.int64
        np.testing.assert_array_equal(rows["stamp_ns"], each.stamps)
        for i, name in enumerate(rows.dtype.names[1:]):
            np.testing.assert_array_equal(rows[name], each.poses[:, i])
        assert tfdb.Trajectory.from_table("map", "base", rows) == each


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *(("a.tum", None), ("a.txt", None), ("a.csv", None), ("a.npz", None)),
        *(("a.parquet", None), ("a.txt", "kitti"), ("a.csv", "euroc")),
    ],
)
def test_a_saved_trajectory_is_read_again(path: Any, tmp_path: Path, name: str, kind: Any) -> None:
    if name.endswith("parquet"):
        pytest.importorskip("polars")
    path.save(tmp_path / name, kind)
    found = tfdb.Trajectory.read(tmp_path / name, target="map", source="base")
    assert np.array_equal(found.stamps, path.stamps)
    np.testing.assert_allclose(found.matrices, path.matrices, atol=1e-15)
    before = (tmp_path / name).read_bytes()
    with pytest.raises(tfdb.errors.TrajectoryError, match="exists already; pass overwrite=True"):
        path[:5].save(str(tmp_path / name), kind)
    assert (tmp_path / name).read_bytes() == before
    path[:5].save(str(tmp_path / name), kind, overwrite=True)
    assert len(tfdb.Trajectory.read(str(tmp_path / name))) == 5


def test_read_warns_at_the_line_that_called_it(tmp_path: Path) -> None:
    (tmp_path / "a.tum").write_text("1 1 2 3 0 0 0.6 0.8\n1 2 2 3 0 0 0.6 0.8\n")
    with pytest.warns(tfdb.TfdbWarning, match="stamp") as caught:
        assert tfdb.Trajectory.read(tmp_path / "a.tum").repeated == 1
    assert caught[0].filename == __file__


def test_a_stored_trajectory_warns_at_the_line_that_called_it(path: Any) -> None:
    with pytest.warns(tfdb.TfdbWarning, match="not kept") as caught:
        tfdb.Buffer(history=1.0).set_trajectory("map", "base", path)
    assert caught[0].filename == __file__
    with pytest.raises(TypeError, match="was called on a Snapshot"):
        tfdb.Buffer.set_trajectory(tfdb.Buffer().snapshot(), "map", "base", path)  # type: ignore[arg-type]

"""`simplify` keeps the path within its tolerance, checked by dense sampling with scipy."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import tfdb

STEP = 10_000_000


def smooth_path(count: int, seed: int, bend: float = 0.001, dwell: bool = False) -> Any:
    """A path that rotates and moves smoothly, at uneven stamps."""
    rng = np.random.default_rng(seed)
    stamps = np.cumsum(rng.integers(STEP // 3, STEP * 2, count))
    speed = rng.normal(size=(count, 3)).cumsum(axis=0) * bend / 10
    spin = rng.normal(size=(count, 3)).cumsum(axis=0) * bend
    if dwell:  # constant half of the time, and the quaternion's sign flips
        speed[count // 4 : count // 2] = spin[count // 4 : count // 2] = 0.0
        spin[count // 8] = 2.0
    turns = [Rotation.from_euler("xyz", [0.4, -1.0, 2.0])]
    for turn in Rotation.from_rotvec(spin[1:]):
        turns.append(turns[-1] * turn)
    quaternions = Rotation.concatenate(turns).as_quat()
    quaternions *= rng.choice([-1.0, 1.0], count)[:, np.newaxis]
    return tfdb.Trajectory(
        "map", "base", stamps, translations=speed.cumsum(axis=0) + 7.0, rotations=quaternions
    )


def interpolated(path: Any, stamps: Any) -> tuple[Any, Rotation]:
    places = [np.interp(stamps, path.stamps, path.translations[:, i]) for i in range(3)]
    turns = Slerp(path.stamps.astype(float), Rotation.from_quat(path.rotations))
    return np.stack(places, axis=1), turns(stamps.astype(float))


def farthest(path: Any, other: Any, parts: int = 12) -> tuple[float, float]:
    """Distance of two paths at many times between all stamps: metres and radians."""
    shares = np.arange(parts) / parts
    stamps = (path.stamps[:-1, None] + np.diff(path.stamps)[:, None] * shares).astype(np.int64)
    stamps = np.append(stamps.ravel(), path.stamps[-1])
    (p, q), (r, s) = interpolated(path, stamps), interpolated(other, stamps)
    return float(np.linalg.norm(p - r, axis=1).max()), float((q.inv() * s).magnitude().max())


def fewest(path: Any, metres: float, radians: float) -> int:
    """The smallest possible number of poses: the shortest chain of valid steps."""
    count = len(path)
    need = [1] + [count + 1] * (count - 1)
    for first in range(count - 1):
        for last in range(first + 1, count):
            if need[first] + 1 < need[last]:
                off = farthest(path[first : last + 1], path[[first, last]], 4)
                if off[0] <= metres and off[1] <= radians:
                    need[last] = need[first] + 1
    return need[-1]


TOLERANCES = [(0.01, 0.01), (0.001, 0.1), (0.2, 0.003), (math.inf, 0.02), (0.02, math.pi)]


@pytest.mark.parametrize(("metres", "radians"), TOLERANCES)
@pytest.mark.parametrize("seed", range(4))
def test_the_path_stays_within_the_tolerance_at_all_times(
    seed: int, metres: float, radians: float
) -> None:
    path = smooth_path(600, seed, dwell=seed % 2 == 1)
    found = path.simplify(metres, radians)
    assert len(found) < len(path) * 0.7
    rows = np.searchsorted(path.stamps, found.stamps)
    assert path[rows] == found
    assert (rows[0], rows[-1]) == (0, len(path) - 1)
    off = farthest(path, found)
    assert off[0] <= metres * (1 + 1e-9)
    assert off[1] <= radians * (1 + 1e-9) + 1e-12
    # No step can be one pose longer.
    for first, last in pairwise(rows[:-1]):
        step = farthest(path[first : last + 2], path[[first, last + 1]])
        assert step[0] > metres * 0.99 or step[1] > radians * 0.98


@pytest.mark.parametrize("coarse", [0.3, 1.0, 2.5])
def test_rotations_of_many_degrees_from_pose_to_pose(coarse: float) -> None:
    """Between two stamps slerps may be farther apart than at both of them."""
    path = smooth_path(400, 11, bend=coarse)
    for radians in (0.05, 0.5, 1.5, 3.0):
        found = path.simplify(math.inf, radians)
        assert farthest(path, found, 60)[1] <= radians + 1e-9


@pytest.mark.parametrize("seed", range(3))
def test_it_is_not_far_from_the_fewest(seed: int) -> None:
    path = smooth_path(60, seed + 20, bend=0.005)
    for metres, radians in ((0.01, 0.02), (0.002, 0.05)):
        best = fewest(path, metres, radians)
        assert best <= len(path.simplify(metres, radians)) <= 1.25 * best


def test_long_paths_are_cut_nowhere_without_need() -> None:
    count = 20_000
    poses = np.tile([1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8], (count, 1))
    poses[:, 0] += np.arange(count)
    straight = tfdb.Trajectory("map", "base", np.arange(count) * STEP, poses)
    assert len(straight.simplify(1e-6, 1e-6)) == 2
    poses[:, 1] = np.abs(np.arange(count) - 7_777)
    bent = tfdb.Trajectory("map", "base", straight.stamps, poses)
    assert bent.simplify(1e-6, 1e-6).stamps.tolist() == [0, 7_777 * STEP, (count - 1) * STEP]
    noise = poses + np.eye(7)[2] * np.random.default_rng(1).normal(size=(count, 1))
    rough = tfdb.Trajectory("map", "base", straight.stamps, noise)
    found = rough.simplify(1.0, 0.1)
    assert len(found) < count * 0.6
    assert farthest(rough, found, 2)[0] <= 1.0 + 1e-9
    assert rough.simplify(0.0, 0.0) == rough


def test_a_turn_all_the_way_round_is_kept() -> None:
    """A rotation of half a turn or more would be interpolated in the other direction."""
    turns = Rotation.from_rotvec(np.outer(np.linspace(0, 2 * np.pi, 101), [0.0, 0.6, 0.8]))
    path = tfdb.Trajectory(
        "map", "base", np.arange(101) * STEP, translations=np.zeros((101, 3)),
        rotations=turns.as_quat(),
    )  # fmt: skip
    found = path.simplify(1.0, 1e-3)
    assert 3 <= len(found) <= 4
    assert farthest(path, found)[1] <= 1e-3


def test_a_turn_may_be_farther_off_between_poses_than_at_them() -> None:
    """Two poses on one side of a rotation: the slerp between them bulges away from it."""
    side, along = 0.05, 0.5  # half angles
    turns = [np.array([0, 0, math.sin(i * along), math.cos(i * along)]) for i in range(4)]
    for i in (1, 2):
        turns[i] = math.cos(side) * turns[i] + math.sin(side) * np.array([1.0, 0, 0, 0])
    path = tfdb.Trajectory(
        "map", "base", np.arange(4) * STEP, translations=np.zeros((4, 3)), rotations=turns
    )
    bulge = math.atan(math.tan(side) / math.cos(along / 2))
    straight = path[[0, 3]]
    assert farthest(path, straight, 2)[1] == pytest.approx(2 * bulge, rel=1e-9)
    assert len(path.simplify(0.0, side + bulge)) == 3
    assert path.simplify(0.0, 2 * bulge * 1.01) == straight


def test_huge_numbers() -> None:
    poses = np.tile([1e308, -1e308, 0, 0, 0, 0.6, 0.8], (5, 1))
    poses[::2, :2] *= -1.0
    path = tfdb.Trajectory("map", "base", np.arange(5) * STEP, poses)
    assert path.simplify(1.0, 1.0) == path


@pytest.mark.parametrize("bad", [-1.0, math.nan, "1", None, True, [0.1]])
def test_tolerances_that_are_none(bad: Any) -> None:
    path = smooth_path(5, 1)
    with pytest.raises(tfdb.InvalidArgument, match="metres must be a number >= 0, got"):
        path.simplify(bad, 0.1)
    with pytest.raises(tfdb.InvalidArgument, match="radians must be a number >= 0, got"):
        path.simplify(0.1, bad)

"""What a person meets first in Python."""

from __future__ import annotations

import numpy as np
import pytest

import tfdb
from oracle import quaternion

TURN = quaternion((1, -2, 0.5), 0.9)
START = tfdb.stamp("1700000000.25")
STEP = 100_000_000


@pytest.fixture
def buffer() -> tfdb.Buffer:
    """An arm that turns on a base that drives, with a second of silence in the middle."""
    made = tfdb.Buffer(history=None)
    made.set_static_transform("arm", "hand", (0.1, -0.2, 0.3), TURN)
    for i in (*range(11), *range(21, 31)):
        made.set_transform("map", "base", START + i * STEP, (0.1 * i, 1, -2), TURN)
        made.set_transform(
            "base", "arm", START + i * STEP, (1, 0.1 * i, 0), quaternion((0, 1, 2), 0.1 * i)
        )
    return made


# -- stamps without an answer ----------------------------------------------------------------------


def test_a_trajectory_may_have_holes(buffer: tfdb.Buffer) -> None:
    strict = tfdb.Interpolate(max_gap=0.1)
    asked = ("map", "hand", 20.0, START, START + 30 * STEP, strict)
    with pytest.raises(tfdb.GapTooLarge) as caught:
        buffer.trajectory(*asked)
    assert caught.value.index == 21
    whole = buffer.trajectory(*asked, missing="nan")
    some = buffer.trajectory(*asked, missing="skip")
    found = np.isfinite(whole.poses).all(axis=1)
    assert (len(whole), found.sum()) == (61, 40)
    assert np.array_equal(some.stamps, whole.stamps[found])
    assert np.array_equal(some.poses, whole.poses[found])
    with pytest.raises(tfdb.GapTooLarge):
        buffer.trajectory(
            "map", "hand", 20.0, START + 11 * STEP, START + 19 * STEP, strict, missing="skip"
        )
    with pytest.raises(tfdb.InvalidArgument, match="'raise', 'nan' or 'skip'"):
        buffer.trajectory("map", "hand", missing="drop")  # type: ignore[arg-type]


def test_a_time_that_is_far_off_costs_nothing(buffer: tfdb.Buffer) -> None:
    with pytest.raises(tfdb.Extrapolation) as caught:
        buffer.trajectory("map", "hand", 1e9, start=5)
    assert caught.value.index == 0
    for missing in ("raise", "nan", "skip"):
        with pytest.raises(tfdb.InvalidArgument, match="at most 100,000,000 poses"):
            buffer.trajectory("map", "hand", 1.0, START, 2**62, missing=missing)  # type: ignore[arg-type]


# -- numbers out of answers ------------------------------------------------------------------------


def test_a_trajectory_is_an_array_of_poses(buffer: tfdb.Buffer) -> None:
    path = buffer.trajectory("map", "hand")
    assert np.array_equal(np.asarray(path), path.poses)
    assert np.asarray(path) is path.poses
    assert np.array_equal(np.array(path), path.poses)
    assert np.array(path) is not path.poses
    assert np.asarray(path, dtype=np.float32).dtype == np.float32


def test_trajectories_compare(buffer: tfdb.Buffer) -> None:
    path = buffer.trajectory("map", "hand")
    assert path == buffer.trajectory("map", "hand")
    assert path != buffer.trajectory("map", "arm")
    assert path != buffer.trajectory("map", "hand", end=START + 5 * STEP)
    assert path != "a path"
    moved = path.poses.copy()
    moved[3, 0] += 1e-12
    assert path != tfdb.Trajectory("map", "hand", path.stamps, moved)
    holes = buffer.trajectory("map", "hand", 20.0, policy=tfdb.Interpolate(0.1), missing="nan")
    again = buffer.trajectory("map", "hand", 20.0, policy=tfdb.Interpolate(0.1), missing="nan")
    assert holes == again
    with pytest.raises(TypeError, match="unhashable"):
        hash(path)


# -- what does not move ----------------------------------------------------------------------------


def test_what_does_not_move_holds_at_all_times(buffer: tfdb.Buffer) -> None:
    still = buffer.lookup_transform("arm", "hand")
    assert repr(still).startswith("T[arm<-hand] at all times: ")
    assert str(still.report).startswith("T[arm<-hand] at all times\n")
    assert still.report.timeless
    made = tfdb.Transform("a", "b", (1, 2, 3), TURN)
    assert repr(made @ tfdb.Transform("b", "c", (3, 2, 1), TURN)).startswith("T[a<-c] at all times")
    simulated = tfdb.Buffer()
    simulated.set_transform("map", "base", 0, (1, 2, 3), TURN)
    first = simulated.lookup_transform("map", "base", 0)
    assert repr(first).startswith("T[map<-base] at 0 s: ")
    assert not first.report.timeless

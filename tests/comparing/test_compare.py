"""Results of `tfdb.compare` beyond evo's numbers, and its errors."""

from __future__ import annotations

import math
import pickle
import re
from decimal import Decimal
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tfdb
from tfdb.comparing.alignment import align
from tfdb.trajectories.writing import write_trajectory

from .motions import S, motion, rotated, times, tracked

ROOT = Path(__file__).resolve().parents[2]
UNIT = (0.0, 0.0, 0.0, 1.0)


def straight(
    count: int = 10, *, step: float = 1.0, rows: Any = None, stamps: Any = None
) -> tfdb.Trajectory:
    poses = np.zeros((count, 7))
    poses[:, 6] = 1
    poses[:, :3] = np.arange(count)[:, None] * step * np.array([1.0, 2.0, -0.5])
    stamps = np.arange(count) * S if stamps is None else stamps
    return tfdb.Trajectory("map", "base", stamps, poses if rows is None else rows)


def test_a_trajectory_against_itself() -> None:
    path = motion(1, times(1, 100, 10))
    found = tfdb.compare(path, path)
    assert len(found) == 100
    assert found.ape_translation.max < 1e-12
    assert found.rpe_rotation.max < 1e-7
    assert found.scale == 1.0
    assert found.offset == 0
    np.testing.assert_allclose(found.alignment.matrix, np.eye(4), atol=1e-12)


def test_alignment_recovers_a_known_motion() -> None:
    path = motion(1, times(1, 100, 10))
    turn = rotated(np.array([[0.3, -0.8, 1.1]]))[0]
    move = tfdb.Transform("odom", "map", (4.0, -3.0, 9.0), turn)
    # By the composition of the core, which the comparison does not use.
    chained = [(move @ tfdb.Transform("map", "base", p[:3], p[3:])).pose for p in path.poses]
    smaller = np.array(chained) * [0.25, 0.25, 0.25, 1, 1, 1, 1]
    moved = tfdb.Trajectory("odom", "imu", path.stamps, smaller)
    found = tfdb.compare(path, moved, align="sim3")
    assert found.scale == pytest.approx(4.0)
    assert (found.alignment.target, found.alignment.source) == ("map", "odom")
    # scale * R * (x / 4) + t = move^-1 x
    np.testing.assert_allclose(found.alignment.matrix, move.inverse().matrix, atol=1e-9)
    np.testing.assert_allclose(found.estimate.poses[:, :3], path.poses[:, :3], atol=1e-9)
    assert (found.estimate.target, found.estimate.source) == ("map", "imu")
    assert found.ape_rotation.max < 1e-9
    only = tfdb.compare(path, moved, align="scale")
    assert only.scale == pytest.approx(4.0)
    np.testing.assert_allclose(only.alignment.matrix, np.eye(4))


def test_yaw_alignment_equals_a_search() -> None:
    path = motion(3, times(3, 80, 10))
    other = tracked(path, 3, noise=0.3)
    found = tfdb.compare(path, other, align="yaw")
    a = path.poses[:, :3] - path.poses[:, :3].mean(axis=0)
    b = other.poses[:, :3] - other.poses[:, :3].mean(axis=0)

    def cost(angle: float) -> float:
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        return float(np.sum((a - b @ turn.T) ** 2))

    best = min(np.linspace(-math.pi, math.pi, 20_001), key=cost)
    np.testing.assert_allclose(found.alignment.rotation[:2], 0, atol=1e-12)
    angle = 2 * math.atan2(found.alignment.rotation[2], found.alignment.rotation[3])
    assert math.remainder(angle - best, 2 * math.pi) == pytest.approx(0, abs=4e-4)
    assert found.ape_translation.sse == pytest.approx(cost(angle))
    assert found.ape_translation.sse <= cost(best)
    assert found.ape_translation.sse > tfdb.compare(path, other).ape_translation.sse


def test_alignments_are_the_best_of_their_kind() -> None:
    """No small change of what was fitted makes the sum of squares less."""
    rng = np.random.default_rng(4)
    path = motion(4, times(4, 60, 10))
    other = tracked(path, 4, noise=0.2, scale=1.7)
    for how in ("se3", "sim3", "yaw"):
        fit = align(path.poses, other.poses, how)  # type: ignore[arg-type]
        least = np.sum((fit.apply(other.poses) - path.poses)[:, :3] ** 2)
        for _ in range(30):
            axis = rng.normal(0, 1e-3, (1, 3)) * ((0, 0, 1) if how == "yaw" else 1)
            x, y, z, w = rotated(axis)[0]
            small = np.array(
                [
                    [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                    [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                    [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
                ]
            )
            scale = fit.scale * (1 + (rng.normal(0, 1e-3) if how == "sim3" else 0))
            points = scale * other.poses[:, :3] @ (small @ fit.rotation).T
            points += fit.translation + rng.normal(0, 1e-3, 3)
            assert np.sum((points - path.poses[:, :3]) ** 2) > least


def test_interpolated_poses_are_those_of_a_store() -> None:
    path = motion(6, times(6, 500, 50))
    other = motion(6, times(7, 80, 9))
    store = tfdb.Buffer(history=None)
    store.set_transforms(tfdb.Columns("map", "base", path.stamps, path.poses))
    for a, b in ((path, other), (other, path)):
        found = tfdb.compare(a, b, align="none")
        assert set(found.reference.stamps) <= set(other.stamps)
        expected = store.lookup_transforms("map", "base", found.reference.stamps)
        side = found.reference if a is path else found.estimate
        np.testing.assert_allclose(side.poses, expected, rtol=0, atol=1e-14)
        assert found.max_diff == 5 * int(np.sort(np.diff(path.stamps))[249]) // 2
        inside = set()
        for before, after in pairwise(path.stamps.tolist()):
            if after - before <= 2 * found.max_diff:
                inside |= {s for s in other.stamps.tolist() if before <= s <= after}
        assert inside == set(found.reference.stamps.tolist())
        assert 0 < np.sum(other.stamps <= path.stamps[-1]) - len(inside) < 20


def test_poses_that_are_not_there() -> None:
    path = motion(6, np.arange(100) / 10.0)
    holed = motion(6, np.arange(1000) / 100.0)
    poses = holed.poses.copy()
    poses[200:300] = np.nan
    poses[500] = np.nan
    holed = straight(rows=poses, stamps=holed.stamps)
    for association, limit in (("interpolate", None), ("nearest", None), ("nearest", 0.001)):
        found = tfdb.compare(
            path,
            holed,
            association=association,  # type: ignore[arg-type]
            max_diff=limit,
        )
        stamps = found.reference.stamps
        if association == "interpolate":
            assert len(found) == 90  # one row alone leaves no gap that is too wide
            assert not ((stamps >= 2 * S) & (stamps < 3 * S)).any()
        elif limit is not None:
            assert len(found) == 89
            assert 5 * S not in stamps
        else:
            assert len(found) == 91  # within 10 ms of the edges of the holes
        assert np.isfinite(found.ape_translation.values).all()
        again = tfdb.compare(
            holed,
            path,
            association=association,  # type: ignore[arg-type]
            max_diff=limit,
        )
        assert np.array_equal(again.reference.stamps, stamps)


def test_seconds() -> None:
    path = motion(2, times(2, 200, 10))
    other = tracked(path, 2)
    found = tfdb.compare(path, other, delta=1.5, delta_unit="s")
    stamps = path.stamps.tolist()
    expected = [0]
    for row, stamp in enumerate(stamps):
        if stamp - stamps[expected[-1]] >= 1_500_000_000:
            expected.append(row)
    assert found.pairs.tolist() == [list(pair) for pair in pairwise(expected)]
    found = tfdb.compare(
        path, other, delta=1.5, delta_unit="s", all_pairs=True, delta_tolerance=0.02
    )
    pairs = []
    for row, stamp in enumerate(stamps[:-1]):
        off = [abs((later - stamp) / S - 1.5) for later in stamps[row + 1 :]]
        if min(off) <= 0.03:
            pairs.append([row, row + 1 + off.index(min(off))])
    assert found.pairs.tolist() == pairs
    assert 50 < len(pairs) < 200
    i, j = found.pairs[3]
    a, b = (
        np.linalg.inv(matrix(p.poses[i])) @ matrix(p.poses[j])
        for p in (found.reference, found.estimate)
    )
    error = np.linalg.inv(a) @ b
    assert found.rpe_translation.values[3] == pytest.approx(np.linalg.norm(error[:3, 3]))
    angle = math.acos((np.trace(error[:3, :3]) - 1) / 2)
    assert found.rpe_rotation.values[3] == pytest.approx(angle, abs=1e-7)


def matrix(pose: np.ndarray) -> np.ndarray:
    return tfdb.Transform("a", "b", pose[:3], pose[3:]).matrix


@pytest.mark.parametrize("noise", [0.0, 0.003, 0.02])
@pytest.mark.parametrize("shift", [0, 123_456_789, -2_345_678_901, 1_700_000_000_000_000_000])
def test_the_offset_is_found(shift: int, noise: float) -> None:
    path = motion(11, times(1, 1500, 50), shift=10 * S)
    other = tracked(motion(11, 4 + times(2, 500, 30), shift=10 * S + shift), 7, noise=noise)
    for a, b, sign in ((path, other, -1), (other, path, 1)):
        found = tfdb.compare(a, b, offset="estimate", align="sim3")
        assert found.offset_estimated
        assert found.offset == pytest.approx(sign * shift, abs=100_000 + noise * 1e8)
        assert len(found) > 450
        assert "estimated" in str(found)
        assert found.ape_translation.rmse < 0.004 + noise * 4


def test_offset_is_estimated_from_rotation_alone() -> None:
    path, other = motion(11, times(1, 900, 50)), motion(11, times(2, 500, 30), shift=3 * S)
    path, other = (
        tfdb.Trajectory(
            "map", "base", each.stamps, np.hstack((np.full((len(each), 3), 2.0), each.rotations))
        )
        for each in (path, other)
    )
    found = tfdb.compare(path, other, offset="estimate", align="none")
    assert found.offset == pytest.approx(-3 * S, abs=0.02 * S)


def test_constant_motion_has_no_offset() -> None:
    with pytest.raises(tfdb.errors.NotComparable, match="has constant speeds") as caught:
        tfdb.compare(straight(100), straight(100), offset="estimate")
    assert caught.value.reason == "even motion"
    with pytest.raises(tfdb.errors.NotComparable, match="has 5 poses, 8 are needed"):
        tfdb.compare(straight(100), straight(5), offset="estimate")
    with pytest.raises(
        tfdb.errors.NotComparable, match=r"correlate by at most 0\.\d\d \(.*\), 0\.5 is needed"
    ):
        tfdb.compare(motion(1, times(1, 900, 30)), motion(5, times(1, 900, 30)), offset="estimate")


def shifted(path: tfdb.Trajectory, by: int) -> tfdb.Trajectory:
    return tfdb.Trajectory(path.target, path.source, path.stamps + by, path.poses)


def placed(count: int, *points: tuple[float, float, float]) -> tfdb.Trajectory:
    """So many poses, one after the other at these points."""
    rows = np.zeros((count, 7))
    rows[:, 6] = 1
    rows[:, :3] = [points[i % len(points)] for i in range(count)]
    return straight(count, rows=rows)


GOOD = motion(1, np.arange(10) * 1.0)
NOT_COMPARABLE = [
    (GOOD, shifted(GOOD, 100 * S), {}, "no time in common", "from 0 s to 9 s.*100 s to 109 s"),
    (
        GOOD,
        shifted(GOOD, S // 2),
        {"max_diff": 0.1},
        "no match",
        r"at most 0.2 s apart \(twice max_diff\)",
    ),
    (
        GOOD,
        shifted(GOOD, S // 2),
        {"max_diff": 0.1, "association": "nearest"},
        "no match",
        "within max_diff, 0.1 s: the nearest two are 0.5 s apart",
    ),
    (GOOD, straight(1), {}, "too few matches", "only 1 of 1 poses match in time.*needs 3"),
    (GOOD, straight(2), {}, "too few matches", "only 2 of 2 poses match.*align='se3' needs 3"),
    (straight(1), straight(1), {"align": "none"}, "too few matches", "align='none' needs 2"),
    (straight(), GOOD, {}, "straight line", "the reference moves on a straight line"),
    (GOOD, straight(), {"align": "sim3"}, "straight line", "the estimate moves on a straight line"),
    (GOOD, straight(), {"align": "se3"}, "straight line", "align='yaw' or 'origin' does not"),
    (straight(step=0), GOOD, {}, "standing still", "reference stands still, all 10 matched poses"),
    (GOOD, placed(10, (1e6, 3.3, 0.1)), {}, "standing still", "the estimate stands still"),
    (GOOD, placed(9, (1, 2, 3), (1, 2, 4)), {"align": "yaw"}, "standing still", "not move horiz"),
    (GOOD, straight(rows=np.full((10, 7), np.nan)), {}, "no pose", "all its rows are NaN"),
    (
        GOOD,
        GOOD,
        {"delta": 1e3, "delta_unit": "m"},
        "no pairs",
        "lie 1000 m apart.*path",
    ),
    (GOOD, GOOD, {"delta": 10}, "no pairs", "10 frames apart.*only 10 poses are matched"),
    (
        GOOD,
        GOOD,
        {"delta": 400, "delta_unit": "deg", "all_pairs": True},
        "no pairs",
        "400 deg",
    ),
    (GOOD, GOOD, {"delta": 60, "delta_unit": "s"}, "no pairs", "path of the matched poses is 9 s"),
]


@pytest.mark.parametrize(("reference", "estimate", "options", "reason", "text"), NOT_COMPARABLE)
def test_not_comparable_names_the_reason(
    reference: Any, estimate: Any, options: dict[str, Any], reason: str, text: str
) -> None:
    with pytest.raises(tfdb.errors.NotComparable, match=text) as caught:
        tfdb.compare(reference, estimate, **options)
    assert caught.value.reason == reason
    assert pickle.loads(pickle.dumps(caught.value)).reason == reason


@pytest.mark.parametrize("how", ["yaw", "origin", "none"])
def test_a_straight_line_is_enough_for_the_rest(how: Any) -> None:
    found = tfdb.compare(straight(), straight(), align=how)
    assert found.ape_translation.max < 1e-12


@pytest.mark.parametrize("count", [2, 30])
def test_a_straight_line_has_a_scale(count: int) -> None:
    ours = straight(count)
    theirs = ours.poses.copy()
    theirs[:, :3] *= 2.5
    found = tfdb.compare(ours, straight(rows=theirs, stamps=ours.stamps), align="scale")
    assert found.scale == pytest.approx(0.4, rel=1e-12)
    assert found.ape_translation.max < 1e-9


@pytest.mark.parametrize("period_ms", [100, 10, 7, 33])
@pytest.mark.parametrize("delta", [1.0, 2.1, 0.9])
def test_seconds_are_exact(period_ms: int, delta: float) -> None:
    """Ten steps of 100 ms are a second, whatever floats make of their sum."""
    path = motion(3, np.arange(600.0))
    stamps = 1_700_000_000 * 10**9 + np.arange(600) * period_ms * 1_000_000
    path = straight(rows=path.poses, stamps=stamps)
    wanted = round(delta * 1000)
    pairs = tfdb.compare(path, path, delta=delta, delta_unit="s").pairs
    rows = -(-wanted // period_ms)
    assert pairs.tolist() == [[i, i + rows] for i in range(0, 600 - rows, rows)]
    every = tfdb.compare(
        path, path, delta=delta, delta_unit="s", all_pairs=True, delta_tolerance=0.01
    ).pairs
    nearest = {
        i: min(range(i + 1, 600), key=lambda j: abs((j - i) * period_ms - wanted))
        for i in range(599)
    }
    assert every.tolist() == [
        [i, j] for i, j in nearest.items() if abs((j - i) * period_ms - wanted) <= 0.01 * wanted
    ]


def test_the_shortest_and_the_longest_time() -> None:
    assert len(tfdb.compare(GOOD, GOOD, delta=1e-15, delta_unit="s").pairs) == len(GOOD) - 1
    for all_pairs in (False, True):
        with pytest.raises(
            tfdb.errors.NotComparable, match="the whole path of the matched poses is 9 s"
        ):
            tfdb.compare(GOOD, GOOD, delta=1e300, delta_unit="s", all_pairs=all_pairs)


def test_empty_trajectories_and_wrong_frames_are_refused() -> None:
    with pytest.raises(tfdb.errors.NotComparable, match=r"the reference holds no pose$"):
        tfdb.compare(GOOD[:0], GOOD)
    for frames in (5, "ab", ("map",), ("map", 3)):
        with pytest.raises(
            tfdb.InvalidArgument, match=r"frames must be the names \(target, source"
        ):
            tfdb.compare(GOOD, GOOD, frames=frames)


def test_standing_still_is_enough_where_nothing_is_fitted() -> None:
    still = straight(step=0)
    for how in ("origin", "none"):
        assert tfdb.compare(still, still, align=how).ape_translation.max == 0


BAD_OPTIONS: list[tuple[dict[str, Any], str]] = [
    (
        {"association": "evo"},
        "must be 'interpolate', 'nearest' or 'rows', got 'evo'",
    ),
    ({"association": ["nearest"]}, "association must be 'interpolate'"),
    ({"align": "SE3"}, "align must be 'se3', 'sim3', 'scale', 'yaw', 'origin' or 'none'"),
    ({"align": None}, "align must be 'se3'"),
    ({"delta_unit": "metres"}, "delta_unit must be 'frames', 'm', 's', 'deg' or 'rad'"),
    ({"pairs_from": 1}, "pairs_from must be 'estimate'"),
    ({"max_diff": -0.1}, "max_diff must be a number of seconds from 0 to 2305843009, got -0.1"),
    ({"max_diff": math.nan}, "max_diff must be a number of seconds"),
    ({"max_diff": "1"}, "max_diff must be a number of seconds"),
    ({"offset": "guess"}, "offset must be 'estimate' or a number of seconds, got 'guess'"),
    ({"offset": 1e300}, "offset must be a number"),
    ({"offset": True}, "offset must be a number"),
    ({"offset": np.array([1.0, 2.0])}, "offset must be a number"),
    ({"delta": 0}, "delta must be a number above 0, got 0"),
    ({"delta": math.inf}, "delta must be a number above 0"),
    ({"delta": [1]}, "delta must be a number above 0"),
    ({"delta": 10**400}, "delta must be a number above 0"),
    ({"delta": 1.5}, "delta must be a whole number of frames, got 1.5"),
    ({"delta_tolerance": -1}, "delta_tolerance must be a number of at least 0, got -1"),
    ({"align_poses": 2}, "align_poses must be None or a whole number >= 3, got 2"),
    ({"align_poses": 5.5}, "align_poses must be"),
]


@pytest.mark.parametrize(("options", "text"), BAD_OPTIONS)
def test_bad_options(options: dict[str, Any], text: str) -> None:
    with pytest.raises(tfdb.InvalidArgument, match=text):
        tfdb.compare(GOOD, GOOD, **options)


def test_bad_poses() -> None:
    poses = straight().poses.copy()
    poses[7, 0] = 1e200
    bad = straight(rows=poses)
    with pytest.raises(
        tfdb.errors.InvalidTransform, match=r"pose 7 of the reference: .* 1e\+200 m, at most"
    ):
        tfdb.compare(bad, GOOD)
    with pytest.raises(tfdb.InvalidStamp):
        tfdb.compare(shifted(GOOD, -2 * S), shifted(straight(300), -2 * S))


@pytest.mark.parametrize("value", [None, 5, [1, 2], np.zeros((3, 7)), b"a.tum", object()])
def test_other_types_are_refused(value: Any) -> None:
    with pytest.raises(tfdb.InvalidArgument, match="the reference must be a Trajectory, a Buffer"):
        tfdb.compare(value, GOOD)
    with pytest.raises(tfdb.InvalidArgument, match="the estimate must be a Trajectory"):
        tfdb.compare(GOOD, value)


@pytest.mark.parametrize("kind", ["tum", "csv", "npz", "euroc", "kitti"])
def test_files(tmp_path: Path, kind: str) -> None:
    path = motion(1, times(1, 60, 10))
    other = tracked(path, 1)
    write_trajectory(tmp_path / "a", path, kind)
    write_trajectory(tmp_path / "b", other, kind)
    found = tfdb.compare(tmp_path / "a", str(tmp_path / "b"))
    expected = tfdb.compare(path, other)
    np.testing.assert_allclose(
        found.ape_translation.values, expected.ape_translation.values, atol=1e-12
    )


def test_recordings_and_stores(tmp_path: Path) -> None:
    bag, mcap = (ROOT / "examples" / "data" / f"pr2.{kind}" for kind in ("bag", "mcap"))
    buf = tfdb.load(mcap)
    frozen = tmp_path / "pr2.tfdb"
    buf.freeze(frozen)
    truth, odometry = buf.trajectory("map", "base_link"), buf.trajectory("odom", "base_link")
    expected = tfdb.compare(truth, odometry)
    assert expected.ape_translation.rmse > 1e-4
    for one, other in ((bag, mcap), (mcap, buf), (frozen, buf.snapshot()), (truth, bag)):
        found = tfdb.compare(
            one, other, frames=("map", "base_link"), estimate_frames=("odom", "base_link")
        )
        assert np.array_equal(found.ape_translation.values, expected.ape_translation.values)
    same = tfdb.compare(bag, mcap, frames=("odom", "base_link"))
    assert same.ape_translation.max < 1e-12
    with pytest.raises(tfdb.InvalidArgument, match=r"pass frames=\(target, source\), such as \('m"):
        tfdb.compare(bag, truth)
    with pytest.raises(tfdb.InvalidArgument, match=r"pass estimate_frames=\(target, source\)"):
        tfdb.compare(truth, buf)
    with pytest.raises(tfdb.InvalidArgument, match=r"frames must be the names \(target, source\)"):
        tfdb.compare(bag, truth, frames="map")  # type: ignore[arg-type]
    with pytest.raises(tfdb.UnknownFrame):
        tfdb.compare(bag, truth, frames=("map", "base_lonk"))
    with pytest.raises(FileNotFoundError):
        tfdb.compare(tmp_path / "none", truth)


@pytest.mark.parametrize("option", ["max_diff", "offset", "delta", "delta_tolerance"])
def test_nan_options_are_refused(option: str) -> None:
    poses = np.tile([0, 0, 0, 0, 0, 0, 1.0], (4, 1))
    path = tfdb.Trajectory("map", "base", np.arange(4) * 10**9, poses)
    wrong: Any = {option: Decimal("NaN")}
    with pytest.raises(tfdb.InvalidArgument, match=f"{option} must be"):
        tfdb.compare(path, path, **wrong)


@pytest.mark.parametrize("seed", range(4))
def test_a_trajectory_has_no_offset_from_itself(seed: int) -> None:
    path = motion(seed, times(seed, 300, 20.0))
    found = tfdb.compare(path, path, offset="estimate")
    assert found.offset == 0
    assert len(found.estimate) == len(path)


def test_poses_that_are_decades_apart() -> None:
    poses = [[0, 0, 0, 0, 0, 0, 1], [1, 0, 0, 0, 0, 0, 1]]
    path = tfdb.Trajectory("map", "base", [0, 2**61 - 1], poses)
    assert tfdb.compare(path, path, align="none").ape_translation.rmse == 0


def test_arguments_stay_unchanged() -> None:
    path, other = motion(1, times(1, 60, 10)), tracked(motion(1, times(1, 60, 10)), 1)
    before = path.poses.copy(), other.poses.copy()
    found = tfdb.compare(path, other, align="sim3")
    with pytest.raises(ValueError, match="read-only"):
        found.reference.poses[:] = 0
    assert np.array_equal(path.poses, before[0])
    assert np.array_equal(other.poses, before[1])


def test_the_printed_table(capsys: pytest.CaptureFixture[str]) -> None:
    path = motion(1, times(1, 60, 10))
    other = tracked(path, 1, scale=1.5)
    found = tfdb.compare(path, other, align="sim3", delta=0.5, delta_unit="m", all_pairs=True)
    shown = str(found)
    assert max(map(len, shown.splitlines())) <= 60
    lines = {line.split()[0]: line.split()[1:] for line in shown.splitlines() if line}
    for name in ("rmse", "mean", "median", "std", "min", "max", "sse"):
        cells = [float(cell) for cell in lines[name]]
        radians = [errors.in_degrees()[name] for errors in (found.ape_rotation, found.rpe_rotation)]
        expected = [
            found.ape_translation.statistics[name],
            radians[0],
            found.rpe_translation.statistics[name],
            radians[1],
        ]
        assert cells == pytest.approx(expected, rel=1e-3)
    assert found.ape_rotation.in_degrees()["max"] == math.degrees(found.ape_rotation.max)
    assert "Sim(3), Umeyama" in shown
    assert "per 0.5 m" in shown
    assert repr(found).startswith("<tfdb.Comparison of 60 poses: APE ")
    assert repr(found.ape_rotation).startswith("<tfdb.comparing.Errors APE rotation: 60 from ")
    html = found._repr_html_()
    assert html.count("<tr>") == html.count("</tr>") == 13
    assert lines["rmse"][0] in html
    assert capsys.readouterr().out == ""


def test_it_comes_when_it_is_used() -> None:
    import subprocess
    import sys

    code = (
        "import sys, tfdb; print('tfdb.comparing' in sys.modules); tfdb.compare; "
        "import tfdb.comparing; print(callable(tfdb.compare), 'matplotlib' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False", "True", "False"]


PAGE = (ROOT / "docs" / "howto" / "compare_trajectories.md").read_text("utf-8")


def test_the_page_shows_the_printed_table(monkeypatch: pytest.MonkeyPatch) -> None:
    from click.testing import CliRunner

    from tfdb.cli.app import cli

    ((command, shown),) = re.findall(r"```\n\$ tfdb ([^\n]*)\n(.*?)```", PAGE, re.DOTALL)
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("COLUMNS", "80")
    printed = CliRunner().invoke(cli, command.split()).output
    assert printed.splitlines() == shown.splitlines()


def row_files(tmp_path: Path, count: int = 60) -> tuple[tfdb.Trajectory, Path, Path]:
    path = motion(3, np.arange(count) / 20)
    other = tracked(path, 5)
    for name, each in (("truth", path), ("slam", other)):
        tfdb.trajectories.writing.write_trajectory(tmp_path / f"{name}.txt", each, "kitti")
    return other, tmp_path / "truth.txt", tmp_path / "slam.txt"


def test_row_by_row(tmp_path: Path) -> None:
    other, truth, slam = row_files(tmp_path)
    timed = tfdb.compare(truth, slam)
    assert timed.association == "interpolate"
    (tmp_path / "slam_times.txt").unlink()
    mixed = tfdb.compare(truth, slam)
    assert (mixed.association, mixed.has_stamps, mixed.max_diff) == ("rows", True, 0)
    (tmp_path / "truth_times.txt").unlink()
    found = tfdb.compare(truth, slam)
    assert (found.association, found.has_stamps) == ("rows", False)
    for errors in (mixed.ape_translation, found.ape_translation):
        np.testing.assert_allclose(errors.values, timed.ape_translation.values, atol=1e-9)
    by_name = tfdb.compare(truth, other, association="rows")
    np.testing.assert_allclose(by_name.rpe_rotation.values, timed.rpe_rotation.values, atol=1e-9)
    labels = [each.get_xlabel() for each in found.plot().axes]
    assert "row" in labels


def test_row_by_row_needs_as_many(tmp_path: Path) -> None:
    other, truth, slam = row_files(tmp_path)
    for each in ("truth", "slam"):
        (tmp_path / f"{each}_times.txt").unlink()
    with pytest.raises(
        tfdb.errors.NotComparable, match="60 poses and the estimate 59: association='rows' needs"
    ):
        tfdb.compare(truth, other[:-1], association="rows")
    for options in ({"offset": 1.0}, {"offset": "estimate"}, {"max_diff": 0.1}):
        with pytest.raises(tfdb.InvalidArgument, match="association='rows' ignores stamps"):
            tfdb.compare(truth, slam, **options)  # type: ignore[arg-type]
    with pytest.raises(tfdb.InvalidArgument, match="needs stamps, which KITTI poses lack"):
        tfdb.compare(truth, slam, delta_unit="s")
    with pytest.raises(
        tfdb.errors.TrajectoryError, match=r"association='rows' .--association rows."
    ):
        tfdb.compare(truth, slam, association="nearest")
    with pytest.raises(tfdb.errors.TrajectoryError, match="have no stamps"):
        tfdb.compare(truth, other)
    lines = slam.read_text().splitlines()
    scaled = [" ".join(str(1.2 * float(value)) for value in line.split()) for line in lines]
    slam.write_text("\n".join(scaled))
    with pytest.raises(tfdb.errors.TrajectoryError, match=r"slam.txt:1: .* not a rotation matrix"):
        tfdb.compare(truth, slam)


def test_poses_that_are_missing_match_no_row() -> None:
    path = motion(3, np.arange(60) / 20)
    poses = path.poses.copy()
    poses[[3, 9]] = np.nan
    holes = tfdb.Trajectory("map", "base", path.stamps, poses)
    found = tfdb.compare(holes, path, association="rows")
    assert len(found) == 58
    assert found.ape_translation.max < 1e-12


ORDERS = [("estimate", (3, 0, 1, 2), "w x y z"), ("reference", (3, 0, 1, 2), "w x y z")]


@pytest.mark.parametrize("aligned", ["se3", "none"])
@pytest.mark.parametrize(("role", "places", "said"), ORDERS)
def test_another_order_of_the_quaternions_is_suspected(
    role: str, places: tuple[int, ...], said: str, aligned: Any
) -> None:
    path = motion(3, np.arange(80) / 20)
    other = tracked(path, 5, noise=0.01) if aligned == "se3" else path
    given = {"reference": path, "estimate": other}
    poses = given[role].poses.copy()
    poses[:, 3:] = poses[:, [3 + place for place in places]]
    given[role] = tfdb.Trajectory("map", "base", path.stamps, poses)
    match = f"quaternions of the {role} may be in the order {said}, .*`timestamp x y z qw qx qy qz`"
    with pytest.warns(tfdb.TfdbWarning, match=match):
        tfdb.compare(given["reference"], given["estimate"], align=aligned)


def test_no_order_is_suspected_without_a_reason(recwarn: pytest.WarningsRecorder) -> None:
    path = motion(3, np.arange(80) / 20)
    turned = path @ tfdb.Transform("base", "camera", (0, 0, 0), (0.5, -0.5, 0.5, -0.5))
    tfdb.compare(path, tfdb.Trajectory("map", "base", turned.stamps, turned.poses))
    poses = path.poses.copy()
    poses[:, :3] += np.random.default_rng(1).normal(0, 3, (80, 3))
    poses[:, 3:] = poses[:, [6, 3, 4, 5]]
    tfdb.compare(path, tfdb.Trajectory("map", "base", path.stamps, poses), align="none")
    assert not recwarn.list


def test_files_are_salvaged(tmp_path: Path) -> None:
    path = motion(3, 1_700_000_000 + np.arange(80) / 20)
    truth, slam = tmp_path / "truth.tum", tmp_path / "slam.tum"
    tfdb.trajectories.writing.write_trajectory(truth, path)
    lines = [
        f"{stamp}.000 {' '.join(map(repr, pose))}"
        for stamp, pose in zip(path.stamps.tolist(), path.poses.tolist(), strict=True)
    ]
    slam.write_text("\n".join([*lines[:9], lines[10], lines[9], "cut", *lines[11:]]))
    with pytest.raises(tfdb.errors.TrajectoryError, match="--salvage"):
        tfdb.compare(truth, slam)
    with pytest.warns(tfdb.TfdbWarning) as warned:
        found = tfdb.compare(truth, slam, salvage=True)
    assert any("81 rows, 1 out of order, sorted, 1 skipped" in str(w.message) for w in warned)
    assert any("taken as nanoseconds, by their size" in str(w.message) for w in warned)
    assert found.ape_translation.max < 1e-12
    with pytest.raises(tfdb.errors.TrajectoryError, match="not a whole number of nanoseconds"):
        tfdb.compare(truth, slam, stamp_unit="ns")

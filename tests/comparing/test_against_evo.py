"""The same numbers as evo: association, alignment, errors, pairs, statistics."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb

from .motions import S, for_evo, motion, times, tracked

metrics = pytest.importorskip("evo.core.metrics")
sync = pytest.importorskip("evo.core.sync")
units = pytest.importorskip("evo.core.units")

if TYPE_CHECKING:
    from pathlib import Path

CLOSE = 1e-9
UNITS = {
    "frames": units.Unit.frames,
    "m": units.Unit.meters,
    "deg": units.Unit.degrees,
    "rad": units.Unit.radians,
}
STATISTICS = {kind.value for kind in metrics.StatisticsType}


@dataclass
class Evo:
    """What evo says, step by step as its programs do it."""

    reference: Any
    estimate: Any

    def associate(self, max_diff: float, offset: float = 0.0, **method: Any) -> None:
        self.reference, self.estimate = sync.associate_trajectories(
            self.reference, self.estimate, max_diff=max_diff, offset_2=offset, **method
        )

    def align(self, how: str, count: int = -1) -> float:
        if how == "none":
            return 1.0
        if how == "origin":
            self.estimate.align_origin(self.reference)
            return 1.0
        scaled, only = how == "sim3", how == "scale"
        return self.estimate.align(self.reference, scaled, only, count)[2]

    def metric(self, kind: Any, relation: str, **options: Any) -> Any:
        made = kind(metrics.PoseRelation[relation], **options)
        made.process_data((self.reference, self.estimate))
        return made


def check(found: tfdb.comparing.Errors, evo: Any) -> None:
    """The errors one by one, and their statistics."""
    np.testing.assert_allclose(found.values, evo.error, rtol=0, atol=CLOSE)
    expected = evo.get_all_statistics()
    assert set(expected) == set(found.statistics) == STATISTICS
    for name, value in found.statistics.items():
        assert value == pytest.approx(expected[name], rel=1e-9, abs=CLOSE)


def check_all(
    found: tfdb.Comparison, evo: Evo, *, from_reference: bool = False, tolerance: float = 0.1
) -> None:
    """Every number of a comparison."""
    assert len(found) == evo.reference.num_poses
    np.testing.assert_allclose(found.estimate.poses[:, :3], evo.estimate.positions_xyz, atol=CLOSE)
    np.testing.assert_allclose(found.reference.poses[:, :3], evo.reference.positions_xyz, atol=0)
    for relation, ours in (
        ("translation_part", found.ape_translation),
        ("rotation_angle_rad", found.ape_rotation),
    ):
        check(ours, evo.metric(metrics.APE, relation))
    if found.delta_unit == "s":
        return
    options = {
        "delta": found.delta if found.delta_unit != "frames" else int(found.delta),
        "delta_unit": UNITS[found.delta_unit],
        "all_pairs": found.all_pairs,
        "rel_delta_tol": tolerance,
        "pairs_from_reference": from_reference,
    }
    for relation, ours in (
        ("translation_part", found.rpe_translation),
        ("rotation_angle_rad", found.rpe_rotation),
    ):
        check(ours, evo.metric(metrics.RPE, relation, **options))
    degrees = evo.metric(metrics.RPE, "rotation_angle_deg", **options).get_all_statistics()
    for name, value in found.rpe_rotation.in_degrees().items():
        assert value == pytest.approx(degrees[name], rel=1e-9, abs=1e-7)


@pytest.mark.parametrize("how", ["se3", "sim3", "scale", "origin", "none"])
@pytest.mark.parametrize("seed", range(3))
def test_alignments_at_one_rate(seed: int, how: str) -> None:
    path = motion(seed, times(seed, 400, 20))
    other = tracked(path, seed + 50, scale=1.0 + seed / 2)
    evo = Evo(for_evo(path), for_evo(other))
    evo.associate(0.01)
    scale = evo.align(how)
    found = tfdb.compare(path, other, association="nearest", align=how)
    assert len(found) == 400
    assert found.scale == pytest.approx(scale, rel=1e-12)
    check_all(found, evo)


@pytest.mark.parametrize("seed", range(6))
def test_other_rates_offsets_and_gaps(seed: int) -> None:
    rates = [(30, 11), (11, 30), (20, 20)][seed % 3]
    counts = [int(25 * rate) + 7 * seed for rate in rates]
    shift = (seed - 2) * 1_234_567_890
    path = motion(seed, times(seed, counts[0], rates[0]))
    other = tracked(motion(seed, times(seed + 9, counts[1], rates[1]), shift=10 * S), seed)
    limit = 0.004 * (1 + seed)
    offset = -10.0 + shift / S
    evo = Evo(for_evo(path), for_evo(other))
    evo.associate(limit, offset)
    evo.align("se3")
    found = tfdb.compare(path, other, association="nearest", max_diff=limit, offset=offset)
    assert 20 < len(found) < min(counts)
    assert found.offset == round(offset * S)
    check_all(found, evo)


def test_one_pose_may_match_twice() -> None:
    slow = motion(1, np.arange(0, 60, 0.5))
    burst = tracked(motion(1, 10 + np.arange(100) * 0.01), 3)
    evo = Evo(for_evo(slow), for_evo(burst))
    evo.associate(0.3)
    evo.align("none")
    found = tfdb.compare(slow, burst, association="nearest", max_diff=0.3, align="none")
    assert len(found) == 100 > len(np.unique(found.reference.poses, axis=0))
    check_all(found, evo)


def test_the_limit_itself_is_near_enough_and_the_first_of_two_is_taken() -> None:
    path = motion(2, np.arange(40) * 1.0)
    for begin in (0.5, 0.25):
        other = motion(2, np.arange(39) + begin)
        evo = Evo(for_evo(path), for_evo(other))
        evo.associate(begin)
        found = tfdb.compare(path, other, association="nearest", max_diff=begin, align="none")
        assert len(found) == 39
        check_all(found, evo)


def test_interpolated() -> None:
    """Inside paths without gaps; at gaps and ends evo repeats or stretches, tfdb omits poses."""
    method = pytest.importorskip("evo.core.sync_method").SyncMethod.interpolation
    path = motion(5, times(5, 900, 50, holes=0.0))
    for other in (
        tracked(motion(5, times(6, 200, 13, holes=0.0)[20:150]), 5),
        tracked(motion(5, times(6, 3000, 170, holes=0.0)[100:2500]), 5),
    ):
        inner, outer = (path, other) if len(path) < len(other) else (other, path)
        inside = (inner.stamps > outer.stamps[0]) & (inner.stamps < outer.stamps[-1])
        inner = tfdb.Trajectory("map", "base", inner.stamps[inside], inner.poses[inside])
        a, b = (inner, outer) if len(path) < len(other) else (outer, inner)
        evo = Evo(for_evo(a), for_evo(b))
        evo.associate(0.02, sync_method=method)
        evo.align("se3")
        found = tfdb.compare(a, b, max_diff=0.02)
        assert len(found) > 100
        np.testing.assert_allclose(
            found.reference.poses[:, :3], evo.reference.positions_xyz, rtol=0, atol=CLOSE
        )
        # Equal up to rounding.
        placed = np.hstack((evo.reference.positions_xyz, found.reference.rotations))
        again = tfdb.Trajectory("map", "base", found.reference.stamps, placed)
        check_all(dataclasses.replace(found, reference=again), evo)


PAIRS = [
    ("frames", 1, 0.1),
    ("frames", 7, 0.1),
    ("m", 0.5, 0.1),
    ("m", 3.0, 0.02),
    ("deg", 20.0, 0.1),
    ("rad", 1.1, 0.01),
]


@pytest.mark.parametrize("from_reference", [False, True])
@pytest.mark.parametrize("every", [False, True])
@pytest.mark.parametrize(("unit", "delta", "tolerance"), PAIRS)
def test_pairs(
    *, unit: Any, delta: float, tolerance: float, every: bool, from_reference: bool
) -> None:
    path = motion(8, times(8, 150, 15))
    other = tracked(path, 8, scale=1.3)
    evo = Evo(for_evo(path), for_evo(other))
    evo.align("sim3")
    found = tfdb.compare(
        path,
        other,
        association="nearest",
        align="sim3",
        delta=delta,
        delta_unit=unit,
        all_pairs=every,
        delta_tolerance=tolerance,
        pairs_from="reference" if from_reference else "estimate",
    )
    expected = metrics.id_pairs_from_delta(
        (evo.reference if from_reference else evo.estimate).poses_se3,
        delta if unit != "frames" else int(delta),
        UNITS[unit],
        tolerance,
        every,
    )
    assert found.pairs.tolist() == [list(pair) for pair in expected]
    assert len(expected) > 3
    assert np.array_equal(found.rpe_rotation.stamps, found.reference.stamps[found.pairs[:, 1]])
    check_all(found, evo, from_reference=from_reference, tolerance=tolerance)


def test_standing_still_amid_the_way() -> None:
    path = motion(4, np.arange(300) * 0.01)
    poses = path.poses[np.arange(300) // 20 * 20]
    halting = tfdb.Trajectory("map", "base", path.stamps, poses)
    for every in (False, True):
        found = tfdb.compare(
            path, halting, association="nearest", delta=0.4, delta_unit="m", all_pairs=every
        )
        evo = Evo(for_evo(path), for_evo(halting))
        evo.align("se3")
        check_all(found, evo)


def test_alignment_by_the_first_poses() -> None:
    path = motion(3, times(3, 200, 10))
    other = tracked(path, 3)
    evo = Evo(for_evo(path), for_evo(other))
    evo.align("se3", 40)
    found = tfdb.compare(path, other, association="nearest", align_poses=40)
    check_all(found, evo)
    assert found.ape_translation.rmse > tfdb.compare(path, other).ape_translation.rmse


@pytest.mark.filterwarnings("ignore:.*with a repeated stamp:tfdb.TfdbWarning")
@pytest.mark.parametrize("how", ["se3", "sim3"])
@pytest.mark.parametrize("name", ["fr2_desk_groundtruth.txt", "KITTI_00_gt.txt"])
def test_real_trajectories(shared_data: Path, name: str, how: str) -> None:
    whole = tfdb.Trajectory.read(shared_data / "trajectories" / name)
    path = tfdb.Trajectory("world", "body", whole.stamps[::2], whole.poses[::2])
    # Every sixth is in both; evo's stamps are floats, which half way between two decide anyhow.
    stamps = whole.stamps[1::3]
    other = tracked(tfdb.Trajectory("world", "body", stamps, whole.poses[1::3]), 1, scale=2.0)
    evo = Evo(for_evo(path), for_evo(other))
    evo.associate(0.001)
    evo.align(how)
    found = tfdb.compare(
        path, other, association="nearest", max_diff=0.001, align=how, delta=2.0, delta_unit="m"
    )
    assert len(found) > 700
    options = {"delta": 2.0, "delta_unit": UNITS["m"]}
    for ours, kind, relation, more in (
        (found.ape_translation, metrics.APE, "translation_part", {}),
        (found.ape_rotation, metrics.APE, "rotation_angle_rad", {}),
        (found.rpe_translation, metrics.RPE, "translation_part", options),
        (found.rpe_rotation, metrics.RPE, "rotation_angle_rad", options),
    ):
        expected = evo.metric(kind, relation, **more).get_all_statistics()
        for statistic, value in ours.statistics.items():
            assert value == pytest.approx(expected[statistic], rel=1e-8, abs=1e-8)


def test_real_recordings(shared_data: Path) -> None:
    folder = shared_data / "turtlebot_nav"
    frames = ("odom", "base_footprint")
    path = tfdb.load(folder / "tf_example.bag").trajectory(*frames)
    again = tfdb.compare(path, folder / "tf_example", estimate_frames=frames, align="none")
    assert len(again) == len(path)
    assert again.ape_translation.max < 1e-12
    other = tracked(again.estimate, 1)
    evo = Evo(for_evo(path), for_evo(other))
    evo.associate(0.01)
    evo.align("se3")
    found = tfdb.compare(path, other, association="nearest", max_diff=0.01)
    assert len(found) == evo.reference.num_poses > 100
    for ours, kind, relation in (
        (found.ape_translation, metrics.APE, "translation_part"),
        (found.ape_rotation, metrics.APE, "rotation_angle_rad"),
        (found.rpe_translation, metrics.RPE, "translation_part"),
        (found.rpe_rotation, metrics.RPE, "rotation_angle_rad"),
    ):
        expected = evo.metric(kind, relation).get_all_statistics()
        for statistic, value in ours.statistics.items():
            assert value == pytest.approx(expected[statistic], rel=1e-7, abs=1e-7)


def kitti(path: Path, trajectory: tfdb.Trajectory) -> Path:
    """The poses alone, with the digits that KITTI has."""
    np.savetxt(path, trajectory.matrices[:, :3].reshape(-1, 12), fmt="%.9e")
    return path


@pytest.mark.parametrize("how", ["se3", "sim3", "origin", "none"])
def test_kitti_poses_row_by_row(tmp_path: Path, how: str) -> None:
    interface = pytest.importorskip("evo.tools.file_interface")
    path = motion(4, times(4, 150, 20))
    ours = kitti(tmp_path / "truth.txt", path)
    theirs = kitti(tmp_path / "slam.txt", tracked(path, 7, scale=1.5))
    evo = Evo(*(interface.read_kitti_poses_file(str(each)) for each in (ours, theirs)))
    scale = evo.align(how)
    found = tfdb.compare(ours, theirs, align=how)
    assert (len(found), found.association, found.has_stamps) == (150, "rows", False)
    assert "150 poses, row by row" in str(found)
    assert found.scale == pytest.approx(scale, rel=1e-9)
    # The files have ten digits; evo computes with matrices, tfdb with quaternions.
    for relation, errors in (
        ("translation_part", found.ape_translation),
        ("rotation_angle_rad", found.ape_rotation),
    ):
        expected = evo.metric(metrics.APE, relation)
        np.testing.assert_allclose(errors.values, expected.error, rtol=0, atol=1e-7)
    options = {"delta": 5, "delta_unit": UNITS["frames"]}
    over = tfdb.compare(ours, theirs, align=how, delta=5)
    for relation, errors in (
        ("translation_part", over.rpe_translation),
        ("rotation_angle_rad", over.rpe_rotation),
    ):
        expected = evo.metric(metrics.RPE, relation, **options)
        np.testing.assert_allclose(errors.values, expected.error, rtol=0, atol=1e-7)

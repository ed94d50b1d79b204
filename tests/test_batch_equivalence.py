"""Rows, points, trajectories, snapshots and transactions give one result."""

from __future__ import annotations

import os
import subprocess
import sys
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

import tfdb

POLICIES = [
    tfdb.Interpolate(),
    tfdb.Exact(),
    tfdb.Previous(),
    tfdb.Nearest(),
    tfdb.Extrapolate(1.0),
    tfdb.Extrapolate(1e-6),
]


def yaw(degrees: float) -> tuple[float, float, float, float]:
    half = np.radians(degrees) / 2
    return (0.0, 0.0, float(np.sin(half)), float(np.cos(half)))


def single(
    reads: tfdb._core.StoreReader, target: str, source: str, stamp: int, policy: tfdb.types.Policy
) -> tfdb.Transform | None:
    can = reads.can_transform(target, source, stamp, policy)
    try:
        found = reads.lookup_transform(target, source, stamp, policy)
    except (
        tfdb.Extrapolation,
        tfdb.errors.NoSampleNear,
        tfdb.Disconnected,
        tfdb.errors.InvalidTransform,
    ):
        assert not can
        return None
    assert can
    return found


def same_bits(found: npt.ArrayLike, expected: npt.ArrayLike) -> None:
    """Equal bit for bit, except that all NaNs are equal."""
    a, b = np.asarray(found, float), np.asarray(expected, float)
    assert a.shape == b.shape
    either = np.isnan(a) & np.isnan(b)
    np.testing.assert_array_equal(a.view(np.int64)[~either], b.view(np.int64)[~either])


def ask_rows(
    reads: tfdb._core.StoreReader | tfdb.Transaction,
    path: tuple[str, str],
    stamps: list[int],
    policy: tfdb.types.Policy,
    found: list[tfdb.Transform | None],
) -> None:
    """Rows and lookups of `reads` equal the single lookups."""
    poses = np.array([np.full(7, np.nan) if t is None else t.pose for t in found])
    matrices = np.array([np.full((4, 4), np.nan) if t is None else t.matrix for t in found])
    if all(t is None for t in found):
        return  # may be an error: frames in two trees
    same_bits(reads.lookup_transforms(*path, stamps, policy, missing="nan"), poses)
    same_bits(
        reads.lookup_transforms(*path, stamps, policy, missing="nan", layout="matrix"), matrices
    )
    if all(t is not None for t in found):
        same_bits(reads.lookup_transforms(*path, stamps, policy), poses)
    for stamp, transform in zip(stamps, found, strict=True):
        if transform is not None:
            again = reads.lookup_transform(*path, stamp, policy)
            same_bits(again.pose, transform.pose)


def ask_points(
    reads: tfdb._core.StoreReader,
    path: tuple[str, str],
    stamps: list[int],
    policy: tfdb.types.Policy,
    found: list[tfdb.Transform],
) -> None:
    points = np.linspace(-7.0, 9.0, 3 * len(stamps)).reshape(-1, 3)
    moved = [t.apply(p) for t, p in zip(found, points, strict=True)]
    same_bits(reads.transform_points(*path, points, stamps, policy), moved)
    for transform, stamp in zip(found, stamps, strict=True):
        at_once = reads.transform_points(*path, points, stamp, policy)
        same_bits(at_once, transform.apply(points))


def ask_every_way(buffer: tfdb.Buffer, target: str, source: str, stamps: list[int]) -> None:
    """All kinds of reads return the results of the single lookups."""
    path = (target, source)
    for policy in POLICIES:
        found = [single(buffer, target, source, stamp, policy) for stamp in stamps]
        answers = [t for t in found if t is not None]
        with buffer.snapshot() as snapshot:
            for reads in (buffer, snapshot):
                ask_rows(reads, path, stamps, policy, found)
                if len(answers) == len(stamps):
                    ask_points(reads, path, stamps, policy, answers)
        with buffer.transaction() as transaction:
            ask_rows(transaction, path, stamps, policy, found)
            transaction.abort()


def test_from_a_quaternion_to_its_opposite() -> None:
    buffer = tfdb.Buffer()
    for stamp, rotation in [(100, (0, 0, 0.6, 0.8)), (200, (0, 0, 0, 1)), (300, (0, 0, 0, -1))]:
        buffer.set_transform("map", "base", stamp, (stamp, 0, 0), rotation)
    rows = buffer.lookup_transforms("map", "base", [150, 300])
    np.testing.assert_array_equal(rows[1], [300, 0, 0, 0, 0, 0, -1])
    ask_every_way(buffer, "map", "base", [150, 300])
    ask_every_way(buffer, "base", "map", [100, 150, 200, 201, 299, 300, 301])
    for rate in (None, 2e7):
        trajectory = buffer.trajectory("map", "base", rate=rate)
        assert np.isfinite(trajectory.poses).all()
        same_bits(
            trajectory.poses,
            [buffer.lookup_transform("map", "base", int(t)).pose for t in trajectory.stamps],
        )


@pytest.mark.parametrize("first", [40.0, 0.0, 10.0, 90.0, -139.9])
def test_at_half_a_turn(first: float) -> None:
    buffer = tfdb.Buffer(history=None)
    for i in range(6):
        buffer.set_transform("map", "base", 100 * i, (i, 0, 0), yaw(first + 180.0 * i))
    stamps = [0, 50, 100, 150, 175, 200, 250, 333, 450, 500, 550]
    ask_every_way(buffer, "map", "base", stamps)
    ask_every_way(buffer, "base", "map", stamps[::-1])


def test_exact_rows_are_the_stored_samples() -> None:
    buffer = tfdb.Buffer(history=None)
    random = np.random.default_rng(5)
    print("seed 5")
    for i in range(200):
        q = random.normal(size=4)
        buffer.set_transform("map", "base", 7 * i, random.normal(size=3), q / np.linalg.norm(q))
    stamps, poses, _ = buffer.samples("base")
    for policy in POLICIES:
        same_bits(buffer.lookup_transforms("map", "base", stamps, policy), poses)


def test_random_paths_with_the_kernels_of_every_processor() -> None:
    """The kernels for older processors give the same bits as those of this one."""
    program = """
import sys, numpy as np, tfdb
random = np.random.default_rng(6)
buffer = tfdb.Buffer(history=None)
for child, parent in (("a", "map"), ("b", "a"), ("c", "b"), ("d", "map")):
    for i in range(300):
        q = random.normal(size=4) if i % 9 else np.array([0.0, 0.0, 0.0, 1.0])
        buffer.set_transform(parent, child, 10 * i, random.normal(size=3), q / np.linalg.norm(q))
for pair in (("map", "c"), ("d", "c"), ("c", "a")):
    stamps = random.integers(0, 2991, 2000)
    for order in (stamps, np.sort(stamps)):
        for layout in ("pose", "matrix"):
            rows = buffer.lookup_transforms(*pair, order, layout=layout)
            sys.stdout.buffer.write(rows.tobytes())
"""
    said = [
        subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "TFDB_KERNELS": kernels},
            stdout=subprocess.PIPE,
            check=True,
        ).stdout
        for kernels in ("", "v3", "portable")
    ]
    assert len(said[0]) == 3 * 2 * 2000 * (7 + 16) * 8
    assert said[0] == said[1] == said[2]


def refuses_the_sum(reads: tfdb._core.StoreReader | tfdb.Transaction) -> None:
    assert not reads.can_transform("map", "b", 10)
    assert reads.can_transform("map", "a", 10)
    with pytest.raises(tfdb.errors.InvalidTransform, match=r"T\[map<-b\]") as caught:
        reads.lookup_transform("map", "b", 10)
    assert caught.value.stamp == 10
    assert caught.value.target == "map"
    assert caught.value.source == "b"
    assert caught.value.reason == "not finite"
    with pytest.raises(tfdb.errors.InvalidTransform) as caught:
        reads.lookup_transforms("map", "b", [20, 10])
    assert caught.value.index == 1
    rows = reads.lookup_transforms("map", "b", [20, 10], missing="nan")
    assert np.isnan(rows).tolist() == [[False] * 7, [True] * 7]


def test_infinite_results_are_refused() -> None:
    buffer = tfdb.Buffer()
    buffer.set_transform("map", "a", 10, (1e308, 0, 0), yaw(0))
    buffer.set_transform("a", "b", 10, (1e308, 0, 0), yaw(0))
    buffer.set_transform("a", "b", 20, (5, 0, 0), yaw(0))
    buffer.set_transform("map", "a", 20, (5, 0, 0), yaw(0))
    with buffer.snapshot() as snapshot:
        refuses_the_sum(buffer)
        refuses_the_sum(snapshot)
    with buffer.transaction() as transaction:
        refuses_the_sum(transaction)
        transaction.abort()
    with pytest.raises(tfdb.errors.InvalidTransform):
        buffer.lookup_transform_full("map", 10, "b", 10, "a")
    with pytest.raises(tfdb.errors.InvalidTransform):
        buffer.transform_points("map", "b", np.ones((2, 3)), 10)
    ask_every_way(buffer, "b", "map", [10, 11, 15, 20])
    buffer.set_transform("a", "b", 30, (1e308, 0, 0), yaw(0))
    buffer.set_transform("map", "a", 30, (1e308, 0, 0), yaw(0))
    with pytest.raises(tfdb.errors.InvalidTransform):
        buffer.lookup_latest_transform("map", "b")
    with pytest.raises(tfdb.errors.InvalidTransform):
        buffer.lookup_transform("map", "b")


def test_an_output_over_the_stamps_is_refused() -> None:
    buffer = tfdb.Buffer()
    for stamp in range(0, 101, 10):
        buffer.set_transform("map", "base", stamp, (stamp, 0, 0), yaw(stamp))
    memory = np.zeros(100)
    stamps = memory[50:60].view(np.int64)
    stamps[:] = range(10)
    for first in (0, 29):
        out = memory[first : first + 70].reshape(10, 7)
        with pytest.raises(tfdb.InvalidArgument, match="overlaps the stamps"):
            buffer.lookup_transforms("map", "base", stamps, out=out)
        with buffer.transaction() as transaction:
            with pytest.raises(tfdb.InvalidArgument, match="overlaps the stamps"):
                transaction.lookup_transforms("map", "base", stamps, out=out)
            transaction.abort()
    points = np.ones((10, 3))
    with pytest.raises(tfdb.InvalidArgument, match="overlaps the stamps"):
        buffer.transform_points("map", "base", points, stamps, out=memory[40:70].reshape(10, 3))
    assert stamps.tolist() == list(range(10))
    rows = np.zeros((10, 7))
    same_bits(
        buffer.lookup_transforms("map", "base", stamps, out=rows),
        [buffer.lookup_transform("map", "base", int(t)).pose for t in stamps],
    )


@pytest.mark.parametrize(
    "form",
    [
        lambda memory: memory[40:80:2].view(np.int64),
        lambda memory: memory[70:50:-1].view(np.int64),
        lambda memory: memory[40:60].view("datetime64[ns]"),
        lambda memory: memory[40:60].view("M8[ns]")[::-1],
        lambda memory: memory[40:50].view(np.uint32),
        lambda memory: memory[40:60].view(np.uint64),
    ],
)
def test_an_output_over_stamps_of_another_form_is_refused(form: Any) -> None:
    buffer = tfdb.Buffer()
    for stamp in range(0, 101, 10):
        buffer.set_transform("map", "base", stamp, (stamp, 0, 0), yaw(stamp))
    memory = np.zeros(200)
    stamps = form(memory)
    stamps[:] = np.arange(20).astype(stamps.dtype)
    before = memory.tobytes()
    over = memory[30:170].reshape(20, 7)
    with pytest.raises(tfdb.InvalidArgument, match="overlaps the stamps"):
        buffer.lookup_transforms("map", "base", stamps, out=over)
    with buffer.transaction() as transaction:
        with pytest.raises(tfdb.InvalidArgument, match="overlaps the stamps"):
            transaction.lookup_transforms("map", "base", stamps, out=over)
        transaction.abort()
    points, out = np.ones((20, 3)), memory[45:105].reshape(20, 3)
    with pytest.raises(tfdb.InvalidArgument, match="overlaps the stamps"):
        buffer.transform_points("map", "base", points, stamps, out=out)
    assert memory.tobytes() == before
    apart = memory[: len(memory)].copy()[30:170].reshape(20, 7)
    same_bits(
        buffer.lookup_transforms("map", "base", stamps, out=apart),
        [buffer.lookup_transform("map", "base", t).pose for t in range(20)],
    )


def test_a_cloud_with_stamps_between_its_points_is_moved_in_place() -> None:
    buffer = tfdb.Buffer()
    for stamp in range(0, 101, 10):
        buffer.set_transform("map", "base", stamp, (stamp, 0, 0), yaw(stamp))
    cloud = np.zeros((20, 4))
    cloud[:, :3] = np.random.default_rng(3).normal(size=(20, 3))
    stamps = cloud.view(np.int64)[:, 3]
    stamps[:] = np.arange(20) * 5
    points = cloud[:, :3]
    expected = buffer.transform_points("map", "base", points.copy(), stamps.copy())
    assert buffer.transform_points("map", "base", points, stamps, out=points) is points
    same_bits(points, expected)
    assert stamps.tolist() == list(range(0, 100, 5))

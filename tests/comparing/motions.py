"""Smooth random motions, estimates of them by a tracker, and the same for evo."""

from __future__ import annotations

from typing import Any

import numpy as np

import tfdb

S = 1_000_000_000


def rotated(axes: np.ndarray) -> np.ndarray:
    """Quaternions (N, 4) of rotation vectors (N, 3)."""
    half = np.linalg.norm(axes, axis=1, keepdims=True) / 2
    return np.hstack((axes / 2 * np.sinc(half / np.pi), np.cos(half)))


def product(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Quaternions of the rotations a after b: Hamilton's formula with vectors."""
    v, w = a[:, :3], a[:, 3:]
    x, y = b[:, :3], b[:, 3:]
    return np.hstack((w * x + y * v + np.cross(v, x), w * y - np.sum(v * x, axis=1, keepdims=True)))


def motion(seed: int, seconds: np.ndarray, *, shift: int = 0) -> tfdb.Trajectory:
    """One and the same smooth motion for a seed, at any times; `shift` is added to the stamps."""
    rng = np.random.default_rng(seed)
    rates, phases = rng.uniform(0.05, 0.5, (2, 6, 3)) * [[[1]], [[13]]]
    waves = np.sin(2 * np.pi * seconds[:, None, None] * rates + phases).sum(axis=2)
    positions = waves[:, :3] * (2.0, 1.5, 0.4) + (3.0, -5.0, 1.0)
    poses = np.hstack((positions, rotated(waves[:, 3:] * (0.2, 0.3, 0.8))))
    stamps = np.rint(seconds * S).astype(np.int64) + shift
    return tfdb.Trajectory("map", "base", stamps, poses)


def tracked(
    path: tfdb.Trajectory, seed: int, *, noise: float = 0.02, scale: float = 1.0
) -> tfdb.Trajectory:
    """The same in another frame, with noise, drift and another scale."""
    rng = np.random.default_rng(seed)
    count = len(path)
    turn = rotated(rng.normal(0, 1, (1, 3)))
    poses = path.poses.copy()
    drift = np.cumsum(rng.normal(0, noise / 20, (count, 3)), axis=0)
    poses[:, :3] += rng.normal(0, noise, (count, 3)) + drift
    poses[:, 3:] = product(poses[:, 3:], rotated(rng.normal(0, noise, (count, 3))))
    spun = np.repeat(turn, count, axis=0)
    pure = np.hstack((poses[:, :3], np.zeros((count, 1))))
    back = spun * (-1, -1, -1, 1)
    poses[:, :3] = product(product(spun, pure), back)[:, :3] / scale + rng.normal(0, 5, 3)
    poses[:, 3:] = product(spun, poses[:, 3:])
    return tfdb.Trajectory("odom", "base", path.stamps.copy(), poses)


def times(
    seed: int, count: int, rate: float, *, jitter: float = 0.2, holes: float = 0.7
) -> np.ndarray:
    """Seconds at about a rate, with jitter and two holes of so many seconds."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(1 - jitter, 1 + jitter, count) / rate
    steps[[count // 3, count // 2]] += holes
    return np.rint(np.cumsum(steps) * S) / S


def for_evo(path: tfdb.Trajectory) -> Any:
    """The same as evo's type."""
    from evo.core.trajectory import PoseTrajectory3D

    wxyz = path.poses[:, [6, 3, 4, 5]]
    return PoseTrajectory3D(path.poses[:, :3].copy(), wxyz, path.stamps / S)

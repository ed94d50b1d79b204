"""Poses computed with numpy only: matrices, and slerp by its definition."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

Vector = npt.NDArray[np.float64]


def quaternion(axis: tuple[float, float, float], angle: float) -> tuple[float, ...]:
    """Quaternion x y z w of a rotation by `angle` radians about an axis of any length."""
    unit = np.asarray(axis, float) / np.linalg.norm(axis)
    return (*map(float, unit * np.sin(angle / 2)), float(np.cos(angle / 2)))


def matrix(pose: npt.ArrayLike) -> Vector:
    """Homogeneous matrix of x y z qx qy qz qw, by the Rodrigues formula."""
    values = np.asarray(pose, float)
    vector, w = values[3:6], values[6]
    cross = np.array(
        [
            [0.0, -vector[2], vector[1]],
            [vector[2], 0.0, -vector[0]],
            [-vector[1], vector[0], 0.0],
        ]
    )
    result = np.eye(4)
    result[:3, :3] += 2 * w * cross + 2 * cross @ cross
    result[:3, 3] = values[:3]
    return result


def interpolate(first: npt.ArrayLike, second: npt.ArrayLike, u: float) -> Vector:
    """Linear translation, and slerp along the shorter arc."""
    a, b = np.asarray(first, float), np.asarray(second, float)
    p, q = a[3:], b[3:]
    if p @ q < 0:
        q = -q
    angle = np.arccos(np.clip(p @ q, -1.0, 1.0))
    if angle < 1e-9:
        rotation = (1 - u) * p + u * q
    else:
        rotation = (np.sin((1 - u) * angle) * p + np.sin(u * angle) * q) / np.sin(angle)
    return np.concatenate([(1 - u) * a[:3] + u * b[:3], rotation / np.linalg.norm(rotation)])


def wobble(seed: int, time: float) -> Vector:
    """A pose that rotates and moves smoothly; each seed gives another motion."""
    phase = 0.7 * seed
    axis = (np.sin(phase + 0.3), np.cos(2 * phase), np.sin(3 * phase) + 1.5)
    rotation = quaternion(axis, 0.4 + 0.3 * seed + 0.8 * np.sin(time + phase))
    position = (np.sin(time * 1.3 + phase), 2.0 + seed - time, 0.5 * np.cos(time + 2 * phase))
    return np.array([*position, *rotation])


class Store:
    """Edges and their samples in plain lists; lookups multiply matrices."""

    def __init__(self) -> None:
        self.parents: dict[str, str] = {}
        self.samples: dict[str, list[tuple[int, Vector]]] = {}
        self.static: dict[str, Vector] = {}

    def add(self, parent: str, child: str, stamp: int, pose: npt.ArrayLike) -> None:
        """Store one moving sample."""
        self.parents[child] = parent
        self.samples.setdefault(child, []).append((stamp, np.asarray(pose, float)))
        self.samples[child].sort(key=lambda sample: sample[0])

    def add_static(self, parent: str, child: str, pose: npt.ArrayLike) -> None:
        """Store a static edge."""
        self.parents[child] = parent
        self.static[child] = np.asarray(pose, float)

    def edge(self, child: str, stamp: int) -> Vector:
        """T[parent<-child] at a stamp within the data, as a pose."""
        if child in self.static:
            return self.static[child]
        samples = self.samples[child]
        for (start, first), (end, second) in pairwise(samples):
            if start <= stamp <= end:
                return interpolate(first, second, (stamp - start) / (end - start))
        assert samples[0][0] == stamp, "the oracle does not extrapolate"
        return samples[0][1]

    def to_root(self, frame: str, stamp: int) -> Vector:
        """T[root<-frame] as a matrix."""
        result = np.eye(4)
        while frame in self.parents:
            result = matrix(self.edge(frame, stamp)) @ result
            frame = self.parents[frame]
        return result

    def lookup(self, target: str, source: str, stamp: int) -> Vector:
        """T[target<-source] as a matrix."""
        result: Vector = np.linalg.inv(self.to_root(target, stamp)) @ self.to_root(source, stamp)
        return result

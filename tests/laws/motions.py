"""Random motions for the laws, far from the identity, and their comparison."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt
from hypothesis import strategies as st

import tfdb

if TYPE_CHECKING:
    from collections.abc import Iterable

Array: TypeAlias = npt.NDArray[np.float64]
Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]
Pose: TypeAlias = tuple[Vector, Quaternion]

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND

coordinates = st.floats(-100.0, 100.0, allow_nan=False)
vectors = st.tuples(coordinates, coordinates, coordinates)


def about(axis: Iterable[float], angle: float) -> Quaternion:
    """The unit quaternion of a turn by `angle` about an axis of any length."""
    x, y, z = axis
    scale = math.sin(angle / 2) / math.hypot(x, y, z)
    return (x * scale, y * scale, z * scale, math.cos(angle / 2))


axes = vectors.filter(lambda v: math.hypot(*v) > 1e-3)
quaternions = st.builds(about, axes, st.floats(0.1, 6.0))
translations = vectors.filter(lambda v: math.hypot(*v) > 0.1)
poses = st.tuples(translations, quaternions)
"""Turned by at least 0.1 rad and moved by at least 0.1 m."""

stamps = st.integers(0, 2**61 - 1 - 2**40)
spans = st.integers(2, 3600 * SECOND)
points = st.lists(vectors, min_size=1, max_size=20).map(lambda p: np.array(p, dtype=np.float64))


def multiply(p: Quaternion, q: Quaternion) -> Quaternion:
    """The turn q first, then p."""
    (a, b, c, d), (x, y, z, w) = p, q
    return (
        d * x + a * w + b * z - c * y,
        d * y + b * w + c * x - a * z,
        d * z + c * w + a * y - b * x,
        d * w - a * x - b * y - c * z,
    )


def as_transform(target: str, source: str, pose: Pose, stamp: int = 0) -> tfdb.Transform:
    """T[target<-source]."""
    return tfdb.Transform(target, source, pose[0], pose[1], stamp)


def matrix_of(pose: Pose) -> Array:
    """Homogeneous matrix by the definition: columns are the turned axes."""
    (tx, ty, tz), (x, y, z, w) = pose
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w), tx],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w), ty],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y), tz],
            [0, 0, 0, 1],
        ]
    )


def angle_between(a: Any, b: Any) -> float:
    """Angle in radians from one rotation to another, the shorter way, given as x y z w."""
    p, q = np.asarray(a, float), np.asarray(b, float)
    if p @ q < 0:
        q = -q
    return float(4 * np.arctan2(np.linalg.norm(p - q), np.linalg.norm(p + q)))


def same_matrix(found: npt.ArrayLike, expected: npt.ArrayLike, tolerance: float = 1e-12) -> None:
    """Equal, relative to the greatest number in it."""
    a, b = np.asarray(found, float), np.asarray(expected, float)
    scale = max(1.0, float(np.abs(b).max()))
    np.testing.assert_allclose(a / scale, b / scale, rtol=0, atol=tolerance)


def chain(edges: Iterable[Pose], stamp: int = START, *, moving: bool = True) -> tfdb.Buffer:
    """Frames f0 <- f1 <- f2 ..., each edge with one sample."""
    buffer = tfdb.Buffer(history=None)
    for i, (translation, rotation) in enumerate(edges):
        if moving:
            buffer.set_transform(f"f{i}", f"f{i + 1}", stamp, translation, rotation)
        else:
            buffer.set_static_transform(f"f{i}", f"f{i + 1}", translation, rotation)
    return buffer


def between(first: Pose, second: Pose, start: int, span: int) -> tfdb.Buffer:
    """One edge map <- base with two samples."""
    buffer = tfdb.Buffer(history=None)
    buffer.set_transform("map", "base", start, *first)
    buffer.set_transform("map", "base", start + span, *second)
    return buffer

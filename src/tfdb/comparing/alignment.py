"""The transform that aligns one set of positions with another.

S. Umeyama, "Least-squares estimation of transformation parameters between two point patterns",
IEEE Transactions on Pattern Analysis and Machine Intelligence 13(4), 1991. With yaw
alone: Z. Zhang, D. Scaramuzza, "A tutorial on quantitative trajectory evaluation for
visual(-inertial) odometry", IROS 2018, section IV.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from tfdb._core import poses_of_matrices
from tfdb.data.errors import NotComparable
from tfdb.data.poses import multiply, rotation_matrices

if TYPE_CHECKING:
    from .poses import Array

Align: TypeAlias = Literal["se3", "sim3", "scale", "yaw", "origin", "none"]

MODES: dict[Align, str] = {
    "se3": "SE(3), Umeyama",
    "sim3": "Sim(3), Umeyama",
    "scale": "scale only, Umeyama",
    "yaw": "translation and yaw",
    "origin": "first poses",
    "none": "not at all",
}
"""The fitted transforms, and their names for users."""

NEEDED: dict[Align, int] = {"se3": 3, "sim3": 3, "scale": 2, "yaw": 2, "origin": 2, "none": 2}
"""Smallest number of matched poses; relative errors always need two."""

_EPSILON = float(np.finfo(np.float64).eps)


@dataclass(frozen=True)
class Similarity:
    """x -> scale * rotation * x + translation."""

    rotation: Array
    translation: Array
    scale: float

    @property
    def quaternion(self) -> Array:
        """The rotation (4,) as x y z w."""
        turn = np.eye(4)
        turn[:3, :3] = self.rotation
        return poses_of_matrices(turn[np.newaxis])[0, 3:]

    def apply(self, poses: Array) -> Array:
        """Transform poses: positions are also scaled, orientations only rotated."""
        positions = self.scale * poses[:, :3] @ self.rotation.T + self.translation
        turn = np.broadcast_to(self.quaternion, (len(poses), 4))
        return np.hstack((positions, multiply(turn, poses[:, 3:])))


def align(reference: Array, estimate: Array, how: Align) -> Similarity:
    """Fit the estimate's poses (N, 7) to those of the reference.

    Raises NotComparable if the poses do not determine the transform: too few, in one place, or on a
    straight line.
    """
    if how == "none":
        return Similarity(np.eye(3), np.zeros(3), 1.0)
    if how == "origin":
        turns = rotation_matrices(np.stack((reference[0, 3:], estimate[0, 3:])))
        turn = turns[0] @ turns[1].T
        return Similarity(turn, reference[0, :3] - turn @ estimate[0, :3], 1.0)
    target, source = reference[:, :3], estimate[:, :3]
    if how == "yaw":
        return _yaw(target, source)
    _refuse_degenerate(target, source, how)
    fitted = _umeyama(target, source, scaled=how != "se3")
    return Similarity(np.eye(3), np.zeros(3), fitted.scale) if how == "scale" else fitted


def _umeyama(target: Array, source: Array, *, scaled: bool) -> Similarity:
    """Equations 34 to 43 of Umeyama's paper."""
    middle, other = target.mean(axis=0), source.mean(axis=0)
    covariance = (target - middle).T @ (source - other) / len(source)
    u, d, vt = np.linalg.svd(covariance)
    signs = np.ones(3)
    if np.linalg.det(u) * np.linalg.det(vt) < 0:
        signs[2] = -1.0
    rotation = u @ np.diag(signs) @ vt
    scale = 1.0
    if scaled:
        scale = float(d @ signs / np.mean(np.sum((source - other) ** 2, axis=1)))
    return Similarity(rotation, middle - scale * rotation @ other, scale)


def _yaw(target: Array, source: Array) -> Similarity:
    """Fit a rotation about z, from the sums of the horizontal dot and cross products."""
    middle, other = target.mean(axis=0), source.mean(axis=0)
    a, b = target - middle, source - other
    for name, points in (("reference", target), ("estimate", source)):
        if np.abs(points[:, :2] - points[:, :2].mean(axis=0)).max() <= _rounding(points):
            raise NotComparable(
                f"the {name} does not move horizontally, so the yaw is undetermined; "
                "align='origin' or 'none' needs no motion",
                reason="standing still",
            )
    turned = np.sum(b[:, 0] * a[:, 1] - b[:, 1] * a[:, 0])
    along = np.sum(b[:, 0] * a[:, 0] + b[:, 1] * a[:, 1])
    angle = np.arctan2(turned, along)
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return Similarity(rotation, middle - rotation @ other, 1.0)


def _rounding(points: Array) -> float:
    """Rounding error of float64 in metres, at the size of these numbers."""
    return 16.0 * _EPSILON * max(float(np.abs(points).max()), 1e-300)


def _refuse_degenerate(target: Array, source: Array, how: Align) -> None:
    """Refuse positions that do not determine the rotation or the scale."""
    for name, points in (("reference", target), ("estimate", source)):
        # Root mean squares along the principal axes.
        extents = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        extents = extents / np.sqrt(len(points))
        if extents[0] <= _rounding(points):
            raise NotComparable(
                f"the {name} stands still, all {len(points)} matched poses in one place: "
                f"align={how!r} needs motion; align='origin' or 'none' does not",
                reason="standing still",
            )
        # A scale needs only lengths.
        if how != "scale" and extents[1] <= max(1e-9 * extents[0], _rounding(points)):
            raise NotComparable(
                f"the {name} moves on a straight line (within {extents[1]:.2g} m over "
                f"{len(points)} matched poses), so the rotation about it is undetermined: "
                f"align={how!r} needs positions that lie on no straight line; align='yaw' or "
                "'origin' does not",
                reason="straight line",
            )

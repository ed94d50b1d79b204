"""The pose that a path's samples give, in 80-bit arithmetic: the judge where tf2 is not exact.

tf2 takes the angle between two samples from acos, which is 0 below 1.5e-8 rad: such a pair it does
not interpolate, and is off by up to that angle. Slow motions of real robots meet this.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Mapping

    import tfdb

Real = np.longdouble
BLIND = 3e-8  # rad; what tf2's acos may miss


def multiply(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The quaternion product, x y z w."""
    vector = a[3] * b[:3] + b[3] * a[:3] + np.cross(a[:3], b[:3])
    return np.append(vector, a[3] * b[3] - a[:3] @ b[:3])


def conjugate(q: np.ndarray) -> np.ndarray:
    return np.append(-q[:3], q[3])


def rotate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    return multiply(multiply(q, np.append(v, Real(0))), conjugate(q))[:3]


def compose(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.concatenate([a[:3] + rotate(a[3:], b[:3]), multiply(a[3:], b[3:])])


def inverse(a: np.ndarray) -> np.ndarray:
    back = conjugate(a[3:])
    return np.concatenate([-rotate(back, a[:3]), back])


def angle_between(a: np.ndarray, b: np.ndarray) -> Real:
    """Half the rotation from a to b: exact for small angles too. a and b are in one hemisphere."""
    return Real(2) * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b))


def interpolate(a: np.ndarray, b: np.ndarray, share: Real) -> np.ndarray:
    """Linear and slerp, the shortest way."""
    q, r = a[3:], b[3:] if a[3:] @ b[3:] >= 0 else -b[3:]
    angle = angle_between(q, r)
    rotation = q
    if angle > 0:
        mixed = np.sin((1 - share) * angle) * q + np.sin(share * angle) * r
        rotation = mixed / np.sin(angle)
    return np.concatenate([a[:3] + share * (b[:3] - a[:3]), rotation])


def evaluate(
    transform: tfdb.Transform,
    static: Mapping[str, np.ndarray],
    moving: Mapping[tuple[str, int], np.ndarray],
) -> tuple[np.ndarray, bool]:
    """Compute the pose of a looked-up transform from the samples in its report.

    Also returns whether an edge rotated by so little that tf2 does not see it.
    """
    up = down = np.array([0, 0, 0, 0, 0, 0, 1], Real)
    blind = False
    for edge in transform.report.edges:
        if edge.before is None or edge.after is None:
            pose = static[edge.child].astype(Real)
        else:
            first, second = (moving[edge.child, s].astype(Real) for s in (edge.before, edge.after))
            share = Real(transform.stamp - edge.before) / Real(max(1, edge.gap))
            pose = interpolate(first, second, share) if edge.used == "interpolated" else first
            dot = abs(first[3:] @ second[3:])
            blind |= edge.used == "interpolated" and bool(1 - dot < BLIND**2)
        if edge.inverted:
            down = compose(pose, down)
        else:
            up = compose(pose, up)
    return compose(inverse(down), up).astype(float), blind

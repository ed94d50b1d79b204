"""Rigid transforms as seven plain numbers, x y z qx qy qz qw: enough for the naive model."""

from __future__ import annotations

import math
import random
from typing import TypeAlias

Vector: TypeAlias = tuple[float, ...]
Pose: TypeAlias = tuple[float, ...]

IDENTITY: Pose = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)


def random_pose(seed: int) -> Pose:
    """A pose that is never the identity, and for every seed another one."""
    numbers = random.Random(seed)
    quaternion = [numbers.gauss(0.0, 1.0) for _ in range(4)]
    length = math.hypot(*quaternion)
    return (*(numbers.uniform(-5.0, 5.0) for _ in range(3)), *(q / length for q in quaternion))


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _dot(a: Vector, b: Vector) -> float:
    return math.fsum(x * y for x, y in zip(a, b, strict=True))


def _multiply(p: Vector, q: Vector) -> Vector:
    """The quaternion product: the rotation q first, then p."""
    turn = _cross(p, q)
    return (
        *(p[3] * q[i] + q[3] * p[i] + turn[i] for i in range(3)),
        p[3] * q[3] - _dot(p[:3], q[:3]),
    )


def _rotate(q: Vector, v: Vector) -> Vector:
    conjugate = (-q[0], -q[1], -q[2], q[3])
    return _multiply(_multiply(q, (*v, 0.0)), conjugate)[:3]


def apply(pose: Pose, point: Vector) -> Vector:
    """The point of the source frame, in the target frame."""
    turned = _rotate(pose[3:], point)
    return tuple(p + t for p, t in zip(pose[:3], turned, strict=True))


def compose(a: Pose, b: Pose) -> Pose:
    """T[x<-z] from T[x<-y] and T[y<-z]."""
    return (*apply(a, b[:3]), *_multiply(a[3:], b[3:]))


def inverse(pose: Pose) -> Pose:
    """T[y<-x] from T[x<-y]."""
    back = (-pose[3], -pose[4], -pose[5], pose[6])
    return (*(-t for t in _rotate(back, pose[:3])), *back)


def interpolate(a: Pose, b: Pose, u: float) -> Pose:
    """Linear translation, slerp the shorter way; outside 0 <= u <= 1 it goes on alike."""
    p, q = a[3:], b[3:]
    if _dot(p, q) < 0.0:
        q = tuple(-x for x in q)
    angle = 2.0 * math.atan2(math.dist(p, q), math.hypot(*map(sum, zip(p, q, strict=True))))
    sine = math.sin(angle)
    of_p, of_q = math.sin((1.0 - u) * angle) / sine, math.sin(u * angle) / sine
    moved = (x + u * (y - x) for x, y in zip(a[:3], b[:3], strict=True))
    return (*moved, *(of_p * x + of_q * y for x, y in zip(p, q, strict=True)))

"""Arrays of poses, rows x y z qx qy qz qw: `core/tfdb/geometry/pose.hpp` for many poses.

The operations have the same order as there, so the results are equal bit for bit. One pose (7,) may
be combined with many (N, 7).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, TypeAlias

from .errors import InvalidTransform

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Array: TypeAlias = npt.NDArray[np.float64]

__all__: list[str] = []

MAX_NORM_ERROR = 0.01
"""Allowed error of a quaternion's squared length: the rule of tf2 and of the store."""
ROUNDING = 1e-12
"""Rounding error of the length of a product of unit quaternions: such a result stays unchanged."""
TOO_FAR = 1e100
"""Metres: greater lengths are not compared or drawn, because their squares exceed float64."""


def doubles(values: Any) -> Array:
    """Convert an array of real numbers to float64, C-contiguous; masked values become NaN.

    The extension calls it. Raises TypeError or ValueError for anything else, such as text, times
    and complex numbers, of which numpy would take the real part.
    """
    import numpy as np

    array = np.asarray(values)
    if array.dtype.kind not in "biufO":
        raise TypeError(f"{array.dtype} is not a type of real numbers")
    if array.dtype.kind == "O":  # of libraries that have a null of their own
        try:
            array = np.asarray(values, np.float64)
        except OverflowError as error:
            raise ValueError(str(error)) from error
    made = np.ascontiguousarray(array, np.float64)
    return np.where(values.mask, np.nan, made) if np.ma.is_masked(values) else made


def found(poses: Array) -> npt.NDArray[np.bool_]:
    """Return for each row whether all its numbers are finite."""
    import numpy as np

    return np.asarray(np.isfinite(poses).all(axis=1))


def missing(poses: Array) -> npt.NDArray[np.bool_]:
    """Return for each row whether it is NaN as a whole, which means a missing pose."""
    import numpy as np

    return np.asarray(np.isnan(poses).all(axis=1))


def checked(rows: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Copy poses (N, 7); each must be a rigid transform or missing."""
    import numpy as np

    made = np.array(rows, order="C")
    with np.errstate(over="ignore", invalid="ignore"):
        off = np.abs((made[:, 3:] ** 2).sum(axis=1) - 1.0)
    fine = found(made) & (off <= MAX_NORM_ERROR)
    wrong = np.flatnonzero(~fine & ~missing(made))
    if len(wrong):
        index = int(wrong[0])
        numbers = ", ".join(f"{number:g}" for number in made[index])
        raise InvalidTransform(
            f"poses[{index}] = ({numbers}) is not a rigid transform: numbers must be finite, "
            "with a unit quaternion (x, y, z, w); in a missing pose all are NaN",
            index=index,
            reason="no rigid transform",
        )
    return normalised(made)


def normalised(poses: Array) -> Array:
    """Normalise quaternions; those of unit length up to rounding stay unchanged, bit for bit."""
    import numpy as np

    norms = np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    off = np.abs(norms - 1.0) > ROUNDING
    if off.any():
        poses = poses.copy()
        poses[:, 3:] /= np.where(off, norms, 1.0)
    return poses


def multiply(a: Array, b: Array) -> Array:
    """Multiply quaternions: rotate by b, then by a."""
    import numpy as np

    ax, ay, az, aw = (a[..., i] for i in range(4))
    bx, by, bz, bw = (b[..., i] for i in range(4))
    return np.stack(
        [
            (aw * bx + ax * bw) + (ay * bz - az * by),
            (aw * by + ay * bw) + (az * bx - ax * bz),
            (aw * bz + az * bw) + (ax * by - ay * bx),
            (aw * bw - ax * bx) - (ay * by + az * bz),
        ],
        axis=-1,
    )


def conjugate(q: Array) -> Array:
    """Return the inverse rotation of unit quaternions."""
    import numpy as np

    back: Array = q * np.array([-1.0, -1.0, -1.0, 1.0])
    return back


def rotate(q: Array, v: Array) -> Array:
    """Rotate points by quaternions."""
    import numpy as np

    qx, qy, qz, qw = (q[..., i] for i in range(4))
    vx, vy, vz = (v[..., i] for i in range(3))
    cx = 2.0 * (qy * vz - qz * vy)
    cy = 2.0 * (qz * vx - qx * vz)
    cz = 2.0 * (qx * vy - qy * vx)
    return np.stack(
        [
            (vx + qw * cx) + (qy * cz - qz * cy),
            (vy + qw * cy) + (qz * cx - qx * cz),
            (vz + qw * cz) + (qx * cy - qy * cx),
        ],
        axis=-1,
    )


def compose(a: Array, b: Array) -> Array:
    """T[c<-a] from T[c<-b] and T[b<-a]."""
    import numpy as np

    moved = a[..., :3] + rotate(a[..., 3:], b[..., :3])
    return np.concatenate([moved, multiply(a[..., 3:], b[..., 3:])], axis=-1)


def inverse(poses: Array) -> Array:
    """T[a<-b] from T[b<-a]."""
    import numpy as np

    back = conjugate(poses[..., 3:])
    return np.concatenate([-rotate(back, poses[..., :3]), back], axis=-1)


def rotation_matrices(q: Array, out: Array | None = None) -> Array:
    """Matrices (N, 3, 3) of unit quaternions (N, 4)."""
    import numpy as np

    made = np.empty((len(q), 3, 3)) if out is None else out
    x, y, z, w = q.T
    x2, y2, z2 = x + x, y + y, z + z
    rows = (
        (1.0 - (y * y2 + z * z2), x * y2 - w * z2, x * z2 + w * y2),
        (x * y2 + w * z2, 1.0 - (x * x2 + z * z2), y * z2 - w * x2),
        (x * z2 - w * y2, y * z2 + w * x2, 1.0 - (x * x2 + y * y2)),
    )
    for i, row in enumerate(rows):
        for j, column in enumerate(row):
            made[:, i, j] = column
    return made


def matrices(poses: Array) -> Array:
    """Homogeneous matrices (N, 4, 4); those of missing poses are NaN."""
    import numpy as np

    made = np.zeros((len(poses), 4, 4))
    rotation_matrices(poses[:, 3:], out=made[:, :3, :3])
    made[:, :3, 3] = poses[:, :3]
    made[:, 3, 3] = 1.0
    made[np.isnan(poses[:, 3])] = np.nan
    return made


def rpy(q: Array) -> Array:
    """Roll, pitch, yaw (N, 3) of unit quaternions (N, 4): `rpy_of_quaternion` of the core."""
    import numpy as np

    m = rotation_matrices(q)
    across = np.hypot(m[:, 0, 0], m[:, 1, 0])
    locked = across < 1e-9  # roll and yaw share one axis: roll is 0
    roll = np.arctan2(m[:, 2, 1], m[:, 2, 2])
    yaw = np.arctan2(m[:, 1, 0], m[:, 0, 0])
    alone = np.arctan2(0.0 - m[:, 0, 1], m[:, 1, 1])
    angles = (
        np.where(locked, 0.0, roll),
        np.arctan2(0.0 - m[:, 2, 0], across),
        np.where(locked, alone, yaw),
    )
    return np.stack(angles, axis=-1)


def rotation_vectors(first: Array, last: Array) -> Array:
    """Return axis times angle of the rotation from one to the other, in the axes of both."""
    import numpy as np

    turn = multiply(last, conjugate(first))
    turn = np.where(turn[:, 3:] < 0.0, -turn, turn)
    sine = np.sqrt((turn[:, :3] ** 2).sum(axis=1))
    # Near zero angle / sin(angle / 2) tends to 2.
    small = sine < 1e-12
    scale = np.where(small, 2.0, 2.0 * np.arctan2(sine, turn[:, 3]) / np.where(small, 1.0, sine))
    vectors: Array = turn[:, :3] * scale[:, np.newaxis]
    return vectors

"""`tf.transformations`: C. Gohlke's `transformations`, with quaternions as x, y, z, w.

tf's module is an old copy of that package, whose quaternions are w, x, y, z. This module reorders
the quaternions of arguments and results; all other functions are those of the package. If the
package is missing, the import raises ImportError: `pip install 'tfdb[tf1]'`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

try:
    from transformations import transformations as wxyz
except ImportError as _error:
    text = "tf.transformations needs the package transformations: pip install 'tfdb[tf1]'"
    raise ImportError(text) from _error

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable
    from typing import Any

    import numpy.typing as npt

    Array = npt.NDArray[np.float64]
    Function = Callable[..., Any]

    class _Arcball:  # the package is not typed
        constrain: bool

        def __init__(self, initial: npt.ArrayLike | None = None) -> None: ...
        def place(self, center: npt.ArrayLike, radius: float) -> None: ...
        def setaxes(self, *axes: npt.ArrayLike) -> None: ...
        def down(self, point: npt.ArrayLike) -> None: ...
        def drag(self, point: npt.ArrayLike) -> None: ...
        def next(self, acceleration: float = 0.0) -> None: ...
        def matrix(self) -> Array: ...

else:
    _Arcball = wxyz.Arcball

identity_matrix: Function = wxyz.identity_matrix
translation_matrix: Function = wxyz.translation_matrix
translation_from_matrix: Function = wxyz.translation_from_matrix
reflection_matrix: Function = wxyz.reflection_matrix
reflection_from_matrix: Function = wxyz.reflection_from_matrix
rotation_matrix: Function = wxyz.rotation_matrix
rotation_from_matrix: Function = wxyz.rotation_from_matrix
scale_from_matrix: Function = wxyz.scale_from_matrix
projection_matrix: Function = wxyz.projection_matrix
clip_matrix: Function = wxyz.clip_matrix
shear_matrix: Function = wxyz.shear_matrix
shear_from_matrix: Function = wxyz.shear_from_matrix
decompose_matrix: Function = wxyz.decompose_matrix
compose_matrix: Function = wxyz.compose_matrix
orthogonalization_matrix: Function = wxyz.orthogonalization_matrix
superimposition_matrix: Function = wxyz.superimposition_matrix
euler_matrix: Function = wxyz.euler_matrix
euler_from_matrix: Function = wxyz.euler_from_matrix
random_rotation_matrix: Function = wxyz.random_rotation_matrix
# The package's compiled function ignores which of the two points is in front.
arcball_constrain_to_axis: Function = getattr(
    wxyz, "arcball_constrain_to_axis_py", wxyz.arcball_constrain_to_axis
)
arcball_map_to_sphere: Function = wxyz.arcball_map_to_sphere
vector_norm: Function = wxyz.vector_norm
unit_vector: Function = wxyz.unit_vector
random_vector: Function = wxyz.random_vector
inverse_matrix: Function = wxyz.inverse_matrix
concatenate_matrices: Function = wxyz.concatenate_matrices
is_same_transform: Function = wxyz.is_same_transform


def _wxyz(quaternion: npt.ArrayLike) -> Array:
    """Reorder x, y, z, w to w, x, y, z."""
    return np.roll(np.asarray(quaternion, dtype=np.float64), 1)


def _xyzw(quaternion: npt.ArrayLike) -> Array:
    """Reorder w, x, y, z to x, y, z, w."""
    return np.roll(np.asarray(quaternion, dtype=np.float64), -1)


def scale_matrix(
    factor: float, origin: npt.ArrayLike | None = None, direction: npt.ArrayLike | None = None
) -> Array:
    """Return the matrix (4, 4) that scales by a factor about an origin, in one direction or all."""
    if direction is not None:
        # The package's compiled function assumes unit length.
        direction = wxyz.unit_vector(np.asarray(direction, dtype=np.float64)[:3])
    found: Array = wxyz.scale_matrix(factor, origin, direction)
    return found


def projection_from_matrix(matrix: npt.ArrayLike, pseudo: bool = False) -> Any:
    """Return the point, normal, direction and perspective of a projection matrix."""
    return wxyz.projection_from_matrix(matrix, pseudo=pseudo)


def euler_from_quaternion(
    quaternion: npt.ArrayLike, axes: Any = "sxyz"
) -> tuple[float, float, float]:
    """Return the Euler angles, radians, of a quaternion x, y, z, w."""
    x, y, z = wxyz.euler_from_quaternion(_wxyz(quaternion), axes)
    return x, y, z


def quaternion_from_euler(ai: float, aj: float, ak: float, axes: Any = "sxyz") -> Array:
    """Return the quaternion x, y, z, w of Euler angles, radians."""
    return _xyzw(wxyz.quaternion_from_euler(ai, aj, ak, axes))


def quaternion_about_axis(angle: float, axis: npt.ArrayLike) -> Array:
    """Return the quaternion x, y, z, w of a rotation about an axis."""
    return _xyzw(wxyz.quaternion_about_axis(angle, axis))


def quaternion_matrix(quaternion: npt.ArrayLike) -> Array:
    """Return the homogeneous matrix (4, 4) of a quaternion x, y, z, w of any length."""
    found: Array = wxyz.quaternion_matrix(_wxyz(quaternion))
    return found


def quaternion_from_matrix(matrix: npt.ArrayLike) -> Array:
    """Return the quaternion x, y, z, w of a rotation matrix (4, 4), with a positive w."""
    return _xyzw(wxyz.quaternion_from_matrix(matrix))


def quaternion_multiply(quaternion1: npt.ArrayLike, quaternion0: npt.ArrayLike) -> Array:
    """Return the product of two quaternions x, y, z, w: first 0, then 1."""
    return _xyzw(wxyz.quaternion_multiply(_wxyz(quaternion1), _wxyz(quaternion0)))


def quaternion_conjugate(quaternion: npt.ArrayLike) -> Array:
    """Return the conjugate of a quaternion x, y, z, w."""
    return _xyzw(wxyz.quaternion_conjugate(_wxyz(quaternion)))


def quaternion_inverse(quaternion: npt.ArrayLike) -> Array:
    """Return the inverse of a quaternion x, y, z, w."""
    return _xyzw(wxyz.quaternion_inverse(_wxyz(quaternion)))


def quaternion_slerp(
    quat0: npt.ArrayLike,
    quat1: npt.ArrayLike,
    fraction: float,
    spin: int = 0,
    shortestpath: bool = True,
) -> Array:
    """Return the quaternion x, y, z, w at a fraction between two others (slerp)."""
    found = wxyz.quaternion_slerp(_wxyz(quat0), _wxyz(quat1), fraction, spin, shortestpath)
    return _xyzw(found)


def random_quaternion(rand: npt.ArrayLike | None = None) -> Array:
    """Return a random unit quaternion x, y, z, w; `rand` may give three numbers from 0 to 1."""
    return _xyzw(wxyz.random_quaternion(rand))


def arcball_nearest_axis(point: npt.ArrayLike, axes: Iterable[npt.ArrayLike]) -> npt.ArrayLike:
    """Return the unit vector with the great circle closest to a point."""
    return max(axes, key=lambda axis: np.dot(arcball_constrain_to_axis(point, axis), point))


class Arcball(_Arcball):
    """Virtual trackball; `initial` is a matrix (4, 4) or a quaternion x, y, z, w.

    With rotations constrained to axes, it behaves as the package's, which differs from tf's.
    """

    def __init__(self, initial: npt.ArrayLike | None = None) -> None:
        given = None if initial is None else np.asarray(initial, dtype=np.float64)
        super().__init__(_wxyz(given) if given is not None and given.shape == (4,) else given)

    def setconstrain(self, constrain: bool) -> None:
        """Set whether it rotates only about the chosen axes."""
        self.constrain = constrain

    def getconstrain(self) -> bool:
        """Whether it rotates only about the chosen axes."""
        return bool(self.constrain)

"""The covariance of a pose in another frame, and of another point of the same body."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tfdb.data.lazy_names import belong_to

from .exceptions import InvalidArgumentException
from .transform_argument import rigid

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    import numpy.typing as npt

__all__ = ["transform_covariance"]


def transform_covariance(
    cov_in: npt.ArrayLike, transform: Any, *, lever_arm: Sequence[float] | None = None
) -> npt.NDArray[np.float64]:
    """Express the covariance of a pose, as geometry_msgs means it, on the axes of another frame.

    geometry_msgs/PoseWithCovariance: "the parameters are: (x, y, z, rotation about X axis, rotation
    about Y axis, rotation about Z axis)", the rotations about fixed axes. So the pose is
    p = p0 + d, Q = exp([a]x) Q0 with the error e = (d, a) of covariance C on the reference frame's
    axes, and x, y, z are the place of the pose's own origin. In a target frame with
    T[target<-source] = (R, t)

        p' = R p + t           so d' = R d
        Q' = R exp([a]x) Q0 = exp([R a]x) R Q0    so a' = R a

    and C' = diag(R, R) C diag(R, R)^T, exactly: t moves the mean alone, without a lever arm
    (ROS 2's tf2_geometry_msgs does the same). The pose of another point of the same body needs a
    lever arm. The error of a point at the offset r is d + a x r, so

        C' = diag(R, R) J C J^T diag(R, R)^T,    J = [[I, -[r]x], [0, I]]

    to first order in a. Sources: A. Leon-Garcia, Probability, Statistics, and Random Processes for
    Electrical Engineering, 3rd ed., 2008, p. 320 (covariance under a linear map); T. D. Barfoot,
    State Estimation for Robotics, 2017, ch. 7 (perturbed rotations).

    Parameters
    ----------
    cov_in
        36 numbers, or (6, 6): x, y, z in metres, then rotations in radians.
    transform
        T[target<-source]: a TransformStamped, a Transform, or a `tfdb.Transform`.
    lever_arm
        r, on the axes of the source frame, metres. None: the covariance stays that of the same
        pose. From the pose of a lidar to that of its robot, r is where the robot's origin is seen
        from the lidar, on the source's axes. From an error twist about the source's origin to one
        about the target's (C' = Ad C Ad^T), r is the target's origin in the source.

    Returns
    -------
    numpy.ndarray
        float64, new, of the shape of `cov_in`.

    Raises InvalidArgumentException unless there are 36 numbers and a valid transform.
    """
    import numpy as np

    try:
        given = np.asarray(cov_in, dtype=np.float64)
        arm = np.zeros(3) if lever_arm is None else np.asarray(lever_arm, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentException(f"a covariance has 36 numbers: {error}") from error
    if given.size != 36 or arm.shape != (3,):
        text = f"a covariance has 36 numbers and a lever arm 3, got {given.shape} and {arm.shape}"
        raise InvalidArgumentException(text)
    rotation = rigid(transform).matrix[:3, :3]
    x, y, z = arm
    crossed = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    nothing = np.zeros((3, 3))
    turned = np.block([[rotation, -rotation @ crossed], [nothing, rotation]])
    found: npt.NDArray[np.float64] = turned @ given.reshape(6, 6) @ turned.T
    return found.reshape(given.shape)


belong_to(__name__, globals(), __all__)

"""Transformed covariances equal those of transformed samples."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from tf2 import conversions
from tfdb import tf2
from tfdb.tf2 import covariance, msgs

if TYPE_CHECKING:
    from collections.abc import Callable

SEED = 4
SAMPLES = 200_000
SMALL = 1e-3
"""Radians, and metres, of the errors: small enough for rotations to add up."""


def turned_by(vectors: np.ndarray) -> np.ndarray:
    """Rotation matrices (N, 3, 3) of rotation vectors (N, 3), by Rodrigues' formula."""
    angle = np.linalg.norm(vectors, axis=1)[:, None, None]
    x, y, z = (vectors / angle[:, :, 0]).T
    zero = np.zeros_like(x)
    cross = np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
    return np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross


def vectors_of(rotations: np.ndarray) -> np.ndarray:
    """Rotation vectors (N, 3) of small rotations (N, 3, 3)."""
    parts = rotations - rotations.transpose(0, 2, 1)
    return np.stack([parts[:, 2, 1], parts[:, 0, 2], parts[:, 1, 0]], axis=1) / 2


class Samples:
    """A pose in a source frame, its covariance, samples of it, and T[target<-source]."""

    def __init__(self) -> None:
        random = np.random.default_rng(SEED)
        every = conversions.Geometry(msgs, msgs.Time(1), random)
        self.transform = every.transform()
        inside = self.transform.transform
        self.by = conversions.matrix(inside.translation, inside.rotation)
        pose = msgs.Pose()
        every.pose(pose)
        self.pose = conversions.of_pose(pose)
        root = random.normal(size=(6, 6)) * SMALL
        self.covariance = root @ root.T
        self.errors = random.normal(size=(SAMPLES, 6)) @ root.T
        self.point = random.normal(size=3) * 5
        """Of the body, beside the pose's origin, on the source's axes."""

    def of_parameters(self) -> np.ndarray:
        """Poses (N, 4, 4) with errors as geometry_msgs means them: of x, y, z, about fixed axes."""
        made = np.tile(np.eye(4), (SAMPLES, 1, 1))
        made[:, :3, :3] = turned_by(self.errors[:, 3:]) @ self.pose[:3, :3]
        made[:, :3, 3] = self.pose[:3, 3] + self.errors[:, :3]
        return made

    def of_twists(self) -> np.ndarray:
        """Poses whose errors are motions about the source's origin: exp(twist) pose."""
        made = np.tile(np.eye(4), (SAMPLES, 1, 1))
        made[:, :3, :3] = turned_by(self.errors[:, 3:])
        made[:, :3, 3] = self.errors[:, :3]
        return made @ self.pose

    def origin(self) -> np.ndarray:
        """The target's origin in the source."""
        found: np.ndarray = np.linalg.inv(self.by)[:3, 3]
        return found


def spread(poses: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Covariance of sampled poses by their parameters."""
    turns = vectors_of(poses[:, :3, :3] @ mean[:3, :3].T)
    found: np.ndarray = np.cov(np.hstack([poses[:, :3, 3] - mean[:3, 3], turns]).T)
    return found


def twist_spread(poses: np.ndarray, mean: np.ndarray) -> np.ndarray:
    """Covariance of sampled poses by the motion that leads to them from their mean."""
    motions = poses @ np.linalg.inv(mean)
    turns = vectors_of(motions[:, :3, :3])
    found: np.ndarray = np.cov(np.hstack([motions[:, :3, 3], turns]).T)
    return found


def close(found: np.ndarray, expected: np.ndarray) -> bool:
    """Within what so many samples leave open; the sizes of the entries differ much."""
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    return bool((np.abs(found - expected) / scale).max() < 5 / np.sqrt(SAMPLES))


def test_of_the_same_pose() -> None:
    """The convention of geometry_msgs: no lever arm, however far away the frames are."""
    each = Samples()
    measured = spread(each.by @ each.of_parameters(), each.by @ each.pose)
    found = covariance.transform_covariance(each.covariance, each.transform)
    assert close(measured, found)
    for arm in (each.origin(), -each.pose[:3, 3]):
        wrong = covariance.transform_covariance(each.covariance, each.transform, lever_arm=arm)
        assert not close(measured, wrong)


def test_of_another_point_of_the_body() -> None:
    each = Samples()
    beside = np.eye(4)
    beside[:3, 3] = each.pose[:3, :3].T @ each.point
    measured = spread(each.by @ each.of_parameters() @ beside, each.by @ each.pose @ beside)
    found = covariance.transform_covariance(each.covariance, each.transform, lever_arm=each.point)
    assert close(measured, found)
    without = covariance.transform_covariance(each.covariance, each.transform)
    assert not close(measured, without)


def test_of_a_twist_about_the_origin() -> None:
    """Then the frames' distance is the lever arm: Ad C Ad^T."""
    each = Samples()
    measured = twist_spread(each.by @ each.of_twists(), each.by @ each.pose)
    found = covariance.transform_covariance(
        each.covariance, each.transform, lever_arm=each.origin()
    )
    assert close(measured, found)
    rotation, (x, y, z) = each.by[:3, :3], each.by[:3, 3]
    crossed = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    adjoint = np.block([[rotation, crossed @ rotation], [np.zeros((3, 3)), rotation]])
    assert np.allclose(found, adjoint @ each.covariance @ adjoint.T, rtol=1e-12, atol=0)


@pytest.mark.parametrize("make", [tuple, list, np.array, lambda flat: np.array(flat).reshape(6, 6)])
def test_shapes(make: Callable[[list[float]], object]) -> None:
    each = Samples()
    given = make(each.covariance.ravel().tolist())
    found = covariance.transform_covariance(given, each.transform)
    assert found.shape == np.shape(given)
    assert found.dtype == np.float64


@pytest.mark.parametrize("bad", [[0.0] * 35, np.zeros((6, 7)), "text", [object()] * 36])
def test_invalid_covariances_are_refused(bad: object) -> None:
    transform = Samples().transform
    with pytest.raises(tf2.InvalidArgumentException, match="36 numbers"):
        covariance.transform_covariance(bad, transform)
    with pytest.raises(tf2.InvalidArgumentException, match="lever arm"):
        covariance.transform_covariance([0.0] * 36, transform, lever_arm=(1, 2))

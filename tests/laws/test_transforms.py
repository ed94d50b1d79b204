"""Transforms form a group, and it acts on points."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tfdb

from .motions import (
    Array,
    Pose,
    angle_between,
    as_transform,
    matrix_of,
    points,
    poses,
    same_matrix,
    stamps,
)


@given(poses)
def test_the_matrix_is_that_of_the_pose(pose: Pose) -> None:
    made = as_transform("a", "b", pose)
    same_matrix(made.matrix, matrix_of(pose))
    rotation = made.matrix[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_array_equal(made.pose, np.concatenate([made.translation, made.rotation]))


@given(poses, poses)
def test_a_product_is_the_product_of_matrices(first: Pose, second: Pose) -> None:
    product = as_transform("a", "b", first) @ as_transform("b", "c", second)
    assert (product.target, product.source) == ("a", "c")
    same_matrix(product.matrix, matrix_of(first) @ matrix_of(second))


@given(poses, poses, poses)
def test_products_are_associative(first: Pose, second: Pose, third: Pose) -> None:
    a, b, c = (
        as_transform("a", "b", first),
        as_transform("b", "c", second),
        as_transform("c", "d", third),
    )
    same_matrix(((a @ b) @ c).matrix, (a @ (b @ c)).matrix)


@given(poses)
def test_the_inverse_undoes_on_either_side(pose: Pose) -> None:
    made = as_transform("a", "b", pose)
    back = made.inverse()
    assert (back.target, back.source) == ("b", "a")
    for unity in (made @ back, back @ made):
        np.testing.assert_allclose(unity.matrix, np.eye(4), atol=1e-12)
    assert back.inverse().pose == pytest.approx(made.pose, abs=1e-12)


@given(poses, poses)
def test_the_inverse_of_a_product_is_the_product_of_inverses(first: Pose, second: Pose) -> None:
    a, b = as_transform("a", "b", first), as_transform("b", "c", second)
    same_matrix((a @ b).inverse().matrix, (b.inverse() @ a.inverse()).matrix)


@given(poses, poses, points)
def test_to_apply_a_product_is_to_apply_both(first: Pose, second: Pose, cloud: Array) -> None:
    a, b = as_transform("a", "b", first), as_transform("b", "c", second)
    same_matrix((a @ b).apply(cloud), a.apply(b.apply(cloud)))
    same_matrix(a.inverse().apply(a.apply(cloud)), cloud)
    homogeneous = np.column_stack([cloud, np.ones(len(cloud))])
    same_matrix(a.apply(cloud), (homogeneous @ matrix_of(first).T)[:, :3])


@given(poses, points)
def test_points_may_come_one_by_one_or_in_float32(pose: Pose, cloud: Array) -> None:
    made = as_transform("a", "b", pose)
    for point, moved in zip(cloud, made.apply(cloud), strict=True):
        same_matrix(made.apply(point), moved, 1e-15)
    single = made.apply(cloud.astype(np.float32))
    assert single.dtype == np.float32
    same_matrix(single, made.apply(cloud), 1e-6)


@given(poses, points)
def test_distances_and_handedness_are_kept(pose: Pose, cloud: Array) -> None:
    moved = as_transform("a", "b", pose).apply(cloud)
    before = np.linalg.norm(cloud[:, None] - cloud[None], axis=2)
    after = np.linalg.norm(moved[:, None] - moved[None], axis=2)
    np.testing.assert_allclose(after, before, atol=1e-10)


@given(poses, poses, stamps, stamps)
def test_a_product_has_the_older_stamp(first: Pose, second: Pose, one: int, other: int) -> None:
    a, b = as_transform("a", "b", first, one), as_transform("b", "c", second, other)
    assert (a @ b).stamp == (min(one, other) if one and other else max(one, other))
    assert a.inverse().stamp == one
    with pytest.raises(tfdb.InvalidArgument):
        _ = b @ a


@given(poses, stamps)
def test_transforms_survive_pickling(pose: Pose, stamp: int) -> None:
    made = as_transform("a", "b", pose, stamp)
    again = pickle.loads(pickle.dumps(made))
    assert again == made
    assert again.pose.tobytes() == made.pose.tobytes()


@given(poses, st.floats(-0.0049, 0.0049))
def test_a_quaternion_slightly_off_is_normalised(pose: Pose, off: float) -> None:
    translation, rotation = pose
    scaled = tuple(q * (1 + off) for q in rotation)
    buffer = tfdb.Buffer()
    buffer.set_transform("a", "b", 1, translation, scaled)
    found = buffer.lookup_transform("a", "b", 1)
    assert np.linalg.norm(found.rotation) == pytest.approx(1.0, abs=1e-15)
    assert angle_between(found.rotation, rotation) < 1e-14

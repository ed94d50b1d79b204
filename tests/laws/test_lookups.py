"""Laws of lookups: paths compose and invert in both directions, at any epoch."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import tfdb

from .motions import (
    SECOND,
    START,
    Array,
    Pose,
    as_transform,
    between,
    chain,
    matrix_of,
    points,
    poses,
    same_matrix,
    spans,
)

chains = st.lists(poses, min_size=2, max_size=8)
shares = st.floats(0.0, 1.0)


@st.composite
def trees(draw: st.DrawFn) -> tuple[tfdb.Buffer, int]:
    """A random tree of 2 to 9 frames n0, n1, ..., static and moving; and how many frames it has."""
    buffer = tfdb.Buffer(history=None)
    count = draw(st.integers(2, 9))
    for child in range(1, count):
        parent, name = f"n{draw(st.integers(0, child - 1))}", f"n{child}"
        if draw(st.booleans()):
            buffer.set_static_transform(parent, name, *draw(poses))
        else:
            buffer.set_transform(parent, name, START, *draw(poses))
            buffer.set_transform(parent, name, START + SECOND, *draw(poses))
    return buffer, count


def stamp_of(share: float) -> int:
    return START + round(share * SECOND)


@given(chains, st.booleans(), st.data())
def test_a_chain_is_the_product_of_its_edges(
    edges: list[Pose], moving: bool, data: st.DataObject
) -> None:
    buffer = chain(edges, moving=moving)
    low = data.draw(st.integers(0, len(edges) - 1))
    high = data.draw(st.integers(low + 1, len(edges)))
    expected = np.eye(4)
    for pose in edges[low:high]:
        expected = expected @ matrix_of(pose)
    same_matrix(buffer.lookup_transform(f"f{low}", f"f{high}", START).matrix, expected)
    back = np.linalg.inv(expected)
    same_matrix(buffer.lookup_transform(f"f{high}", f"f{low}", START).matrix, back, 1e-11)


@given(trees(), shares, st.data())
def test_any_frame_in_between_gives_the_same(
    tree: tuple[tfdb.Buffer, int], share: float, data: st.DataObject
) -> None:
    """T[a<-b] T[b<-c] = T[a<-c], wherever the three are in the tree."""
    buffer, count = tree
    a, b, c = (f"n{data.draw(st.integers(0, count - 1))}" for _ in range(3))
    stamp = stamp_of(share)
    whole = buffer.lookup_transform(a, c, stamp)
    parts = buffer.lookup_transform(a, b, stamp) @ buffer.lookup_transform(b, c, stamp)
    same_matrix(parts.matrix, whole.matrix, 1e-11)


@given(trees(), shares, st.data())
def test_to_look_back_is_to_invert(
    tree: tuple[tfdb.Buffer, int], share: float, data: st.DataObject
) -> None:
    buffer, count = tree
    a, b = (f"n{data.draw(st.integers(0, count - 1))}" for _ in range(2))
    stamp = stamp_of(share)
    there, back = buffer.lookup_transform(a, b, stamp), buffer.lookup_transform(b, a, stamp)
    same_matrix(there.inverse().matrix, back.matrix, 1e-11)
    np.testing.assert_allclose(buffer.lookup_transform(a, a, stamp).matrix, np.eye(4), atol=0)


@given(trees(), shares, points, st.data())
def test_points_take_the_same_way(
    tree: tuple[tfdb.Buffer, int], share: float, cloud: Array, data: st.DataObject
) -> None:
    buffer, count = tree
    a, b = (f"n{data.draw(st.integers(0, count - 1))}" for _ in range(2))
    stamp = stamp_of(share)
    moved = buffer.transform_points(a, b, cloud, stamp)
    same_matrix(moved, buffer.lookup_transform(a, b, stamp).apply(cloud))
    same_matrix(buffer.transform_points(b, a, moved, stamp), cloud, 1e-10)


@given(chains, st.permutations(range(8)))
def test_the_order_of_writing_does_not_matter(edges: list[Pose], order: list[int]) -> None:
    expected = chain(edges).lookup_transform("f0", f"f{len(edges)}", START)
    buffer = tfdb.Buffer(history=None)
    for i in (i for i in order if i < len(edges)):
        buffer.set_transform(f"f{i}", f"f{i + 1}", START, *edges[i])
    found = buffer.lookup_transform("f0", f"f{len(edges)}", START)
    assert found.pose.tobytes() == expected.pose.tobytes()


@given(st.lists(poses, min_size=3, max_size=6), shares, st.integers(0, 2**60))
def test_the_epoch_does_not_matter(samples: list[Pose], share: float, epoch: int) -> None:
    """Stamps are exact: the same motion 36 years later gives the same bits."""

    def look(start: int) -> tfdb.Transform:
        buffer = tfdb.Buffer(history=None)
        for i, pose in enumerate(samples):
            buffer.set_transform("map", "base", start + i * 1_000_003, *pose)
        time = start + round(share * (len(samples) - 1) * 1_000_003)
        return buffer.lookup_transform("map", "base", time)

    assert look(epoch).pose.tobytes() == look(0).pose.tobytes()


@given(poses, poses, poses, poses, spans)
def test_full_lookups_go_through_the_fixed_frame(
    first: Pose, second: Pose, third: Pose, fourth: Pose, span: int
) -> None:
    """T[a at t1 <- b at t2] = T[a<-map](t1) T[map<-b](t2)."""
    buffer = tfdb.Buffer(history=None)
    for child, (early, late) in (("a", (first, second)), ("b", (third, fourth))):
        buffer.set_transform("map", child, START, *early)
        buffer.set_transform("map", child, START + span, *late)
    found = buffer.lookup_transform_full("a", START, "b", START + span, "map")
    expected = np.linalg.inv(matrix_of(first)) @ matrix_of(fourth)
    same_matrix(found.matrix, expected, 1e-11)
    same = buffer.lookup_transform_full("a", START, "b", START, "map")
    same_matrix(same.matrix, buffer.lookup_transform("a", "b", START).matrix)


@given(st.lists(poses, min_size=2, max_size=6), spans)
def test_a_chain_in_one_go_is_each_edge_interpolated(samples: list[Pose], span: int) -> None:
    """Interpolating every edge by itself is what the whole path is made of."""
    buffer = tfdb.Buffer(history=None)
    time = START + span // 3
    expected = as_transform("f0", "f0", ((0, 0, 0), (0, 0, 0, 1)))
    for i, (early, late) in enumerate(pairwise(samples)):
        buffer.set_transform(f"f{i}", f"f{i + 1}", START, *early)
        buffer.set_transform(f"f{i}", f"f{i + 1}", START + span, *late)
        edge = between(early, late, START, span).lookup_transform("map", "base", time)
        expected @= tfdb.Transform(f"f{i}", f"f{i + 1}", edge.translation, edge.rotation)
    found = buffer.lookup_transform("f0", f"f{len(samples) - 1}", time)
    same_matrix(found.matrix, expected.matrix, 1e-11)

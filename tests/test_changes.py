"""The change feed: effects of each commit, in order, and copies that follow it."""

from __future__ import annotations

import random

import numpy as np
import pytest

import tfdb

SEEDS = range(6)
NAMES = [f"frame{i}" for i in range(7)]


def pose(number: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Return a translation and a rotation that only this number has, far from the identity."""
    half = 0.2 + 0.01 * (number % 90)
    return (number, 0.5 - 2 * number, 0.25 * number), (
        0.6 * np.sin(half),
        0.0,
        0.8 * np.sin(half),
        np.cos(half),
    )


def follow(replica: tfdb.Buffer, changes: tfdb.types.Changes) -> None:
    """Apply a record to a copy."""
    if changes.cleared and not len(changes.stored) and not len(changes.stored_static):
        replica.clear()
    replica.set_transforms(changes.stored, change_kind=True)
    replica.set_transforms(changes.stored_static, static=True, change_kind=True)
    replica.remove_frames([*changes.removed, *changes.passing])


def assert_same(left: tfdb.Buffer, right: tfdb.Buffer) -> None:
    """Every frame, sample and newest parent is the same, bit for bit."""
    assert left.frames() == right.frames()
    for name in left.frames():
        for a, b in zip(left.samples(name), right.samples(name), strict=True):
            assert np.array_equal(np.asarray(a), np.asarray(b)), name
        assert left.parent_of(name) == right.parent_of(name)


class Writer:
    """Random writes, removals, clears and transactions."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.clock = 100
        self.number = 0
        self.refused = 0

    def act(self, buf: tfdb.Buffer) -> None:
        """Do one thing; what is refused leaves no trace."""
        self.clock += self.random.randrange(5)
        chance = self.random.randrange(20)
        try:
            if chance == 0:
                buf.clear()
            elif chance < 4:
                buf.remove_frames(self.random.choice(NAMES), recursive=chance == 1)
            elif chance < 6:
                buf.set_transforms(self.batch(), static=True, change_kind=True)
            elif chance < 9:
                buf.run(self.transact)
            else:
                buf.set_transforms(self.batch(), change_kind=chance < 12)
        except tfdb.TfdbError:
            self.refused += 1

    def transact(self, tx: tfdb.Transaction) -> None:
        """Write moving and static edges, or a removal, in one commit."""
        tx.set_transforms(self.batch())
        if self.random.randrange(2):
            tx.set_transforms(self.batch(), static=True)
        else:
            tx.remove_frames(self.random.choice(NAMES))

    def batch(self) -> list[tfdb.TransformStamped]:
        """Make a few transforms of different frames, some of them late."""
        members = []
        for child in self.random.sample(NAMES, 1 + self.random.randrange(4)):
            self.number += 1
            late = self.random.randrange(30) if self.random.randrange(4) == 0 else 0
            members.append(
                tfdb.TransformStamped(
                    self.random.choice(NAMES),
                    child,
                    max(0, self.clock - late),
                    *pose(self.number),
                )
            )
        return members


def test_changes_list_the_effects_of_a_commit() -> None:
    buf = tfdb.Buffer()
    assert buf.changes(0) == []
    with buf.snapshot():  # or what is cleared and removed might be gone
        buf.set_transform("map", "base", 10, *pose(1))
        buf.set_static_transform("base", "camera", *pose(2))
        buf.set_transform("odom", "base", 20, *pose(3))
        buf.clear()
        buf.remove_frames("camera")
        first, second, third, fourth, fifth = buf.changes(since=0)
    assert first.commit == 1
    assert first.made == ("map", "base")
    assert first.stored.parents == ["map"]
    assert first.stored.children == ["base"]
    assert first.authorities == ("",)
    assert second.made == ("camera",)
    assert second.stored_static.stamps is None
    assert np.allclose(second.stored_static.poses[0], np.concatenate(pose(2)))
    assert (third.made, third.moved) == (("odom",), ("base",))
    assert (fourth.cleared, fourth.moved) == (("base",), ("base",))
    assert fifth.removed == ("camera",)
    assert [one.commit for one in buf.changes(1, limit=2)] == [2, 3]
    assert repr(fifth) == "<tfdb.types.Changes of commit 5: 1 removed>"


def test_stamps_and_poses_are_those_stored() -> None:
    buf = tfdb.Buffer()
    batch = [tfdb.TransformStamped("map", "base", 10 * i, *pose(i)) for i in (3, 1, 2)]
    buf.set_transforms(batch)
    (changes,) = buf.changes(0)
    stamps, poses, parents = buf.samples("base")
    assert isinstance(changes.stored.stamps, np.ndarray)
    assert np.array_equal(changes.stored.stamps, stamps)
    assert np.array_equal(changes.stored.poses, poses)
    assert changes.stored.parents == parents
    assert changes.gone == {}


def test_missing_samples_are_counted() -> None:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", 10, *pose(1))
    buf.remove_frames("base")
    first, second = buf.changes(0)
    assert first.gone == {"base": 1}
    assert len(first.stored) == 0
    assert second.removed == ("base",)


@pytest.mark.parametrize("concurrency", ["snapshot", "giant"])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_copy_that_follows_is_the_same(seed: int, concurrency: tfdb.types.Concurrency) -> None:
    writer = Writer(seed)
    history = 60e-9 if seed % 2 else None
    buf = tfdb.Buffer(history=history, concurrency=concurrency)
    copy = tfdb.Buffer(history=history)
    since = 0
    for _ in range(50):
        with buf.snapshot():
            for _ in range(writer.random.randrange(8)):
                writer.act(buf)
            for changes in buf.changes(since):
                since += 1
                assert changes.commit == since
                assert changes.gone == {}
                follow(copy, changes)
        assert since == buf.commit
        assert_same(buf, copy)
    assert since > 30
    assert writer.refused > 5


def test_a_late_follower_gets_feed_lapped_and_continues() -> None:
    buf = tfdb.Buffer()
    for stamp in range(17_000):
        buf.set_transform("map", "base", stamp, *pose(1))
    with pytest.raises(tfdb.errors.FeedLapped) as lapped:
        buf.changes(3)
    assert lapped.value.since == 3
    assert lapped.value.newest == 17_000
    assert lapped.value.oldest is not None
    assert len(buf.changes(lapped.value.oldest, limit=2)) == 2
    assert lapped.value.commit is not None
    assert lapped.value.commit == 17_000 - (17_000 - lapped.value.oldest) // 2
    assert f"go on from {lapped.value.commit} without the commits before" in str(lapped.value)
    assert len(buf.changes(lapped.value.commit)) == 17_000 - lapped.value.commit
    with buf.snapshot() as snap:
        assert buf.changes(snap.commit) == []


@pytest.mark.parametrize("since", [-1, 2, "1", None, 1.0, True])
def test_a_commit_that_is_none_is_refused(since: object) -> None:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", 10, *pose(1))
    with pytest.raises((tfdb.InvalidArgument, TypeError)):
        buf.changes(since)  # type: ignore[arg-type]
    with pytest.raises(tfdb.InvalidArgument):
        buf.changes(0, limit=0)


@pytest.mark.parametrize(
    "engine", ["fine", "2pl-no-wait", "2pl-wait-die", "2pl-wound-wait", "silo"]
)
def test_engines_without_a_feed_raise_not_supported(engine: tfdb.types.Concurrency) -> None:
    buf = tfdb.Buffer(concurrency=engine)
    with pytest.raises(tfdb.errors.NotSupported, match=engine):
        buf.changes(0)


def test_not_amid_a_transaction() -> None:
    buf = tfdb.Buffer()
    with buf.transaction() as tx:
        tx.set_transform("map", "base", 10, *pose(1))
        with pytest.raises(tfdb.errors.TransactionActive):
            buf.changes(0)


def test_changes_name_the_writer_of_each_row() -> None:
    buf = tfdb.Buffer()
    with buf.transaction() as tx:
        for stamp in (10, 20):
            tx.set_transform("map", "base", stamp, *pose(stamp), authority="odometry")
        tx.set_static_transform("base", "camera", *pose(2), authority="urdf")
    buf.set_transform("map", "base", 30, *pose(3), authority="filter")
    first, second = buf.changes(0)
    assert first.authorities == ("odometry", "odometry", "urdf")
    assert second.authorities == ("filter",)


def test_changes_of_chosen_frames() -> None:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", 10, *pose(1))
    buf.set_static_transform("base", "camera", *pose(2))
    buf.set_transform("map", "base", 20, *pose(3))
    buf.remove_frames("camera")
    assert [one.commit for one in buf.changes(0, frames="camera")] == [2, 4]
    (only,) = buf.changes(0, 1, frames=["base", "nothing"])
    assert only.made == ("base",)
    assert buf.changes(0, frames=[]) == []
    with pytest.raises(TypeError, match="a frame's name or a sequence of them, got int"):
        buf.changes(0, frames=7)  # type: ignore[arg-type]

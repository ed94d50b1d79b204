"""Partly refused batches: the refused members, the stored ones, bulk writes."""

from __future__ import annotations

import copy
import pickle
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import tfdb
from oracle import quaternion
from refused_calls import refused

TURN = quaternion((1, -2, 0.5), 0.9)
BACK = quaternion((0, 1, 3), -1.4)
NAN = float("nan")


@pytest.fixture
def buffer() -> tfdb.Buffer:
    made = tfdb.Buffer(history=1e-6)
    made.set_transform("map", "base", 5000, (1, 2, 3), TURN)
    made.set_static_transform("base", "camera", (0, 0.5, 1), BACK)
    return made


def one(child: str, stamp: Any = 6000, parent: str = "map", x: Any = 1.0) -> Any:
    return tfdb.TransformStamped(parent, child, stamp, (x, 2, 3), TURN)


# Good and bad members in turns, unsorted, one frame twice; what is wrong with the bad ones.
MIXED: list[tuple[Any, str | None]] = [
    (one("base", 7000), None),
    (one("nan", x=NAN), "InvalidTransform"),
    (one("base", 6000), None),
    (one("camera", 6000, "base"), "StaticConflict"),
    (one("text", x="1"), "InvalidArray"),
    (one("new"), None),
    (one("base", 5), "TooOld"),
    (one("stamp", 1.5), "InvalidStamp"),
    (one("stamp", -1), "InvalidStamp"),
    (one("no\nname"), "InvalidName"),
    (one("\ud800"), "InvalidName"),
    (one("self", parent="self"), "InvalidTransform"),
    (one("below", parent="new"), None),
    (one("map", parent="below"), "CycleError"),
    (tfdb.TransformStamped("map", "short", 6000, (1, 2)), "InvalidArray"),
]
BATCH = [member for member, _ in MIXED]
WRONG = [(i, error) for i, (_, error) in enumerate(MIXED) if error is not None]


def named(records: Any) -> list[tuple[int, str]]:
    return [(record.index, record.error) for record in records]


def test_the_good_ones_are_stored_and_the_others_named(buffer: tfdb.Buffer) -> None:
    records = buffer.set_transforms(BATCH, authority="tracker", partial=True)
    assert named(records) == WRONG
    assert buffer.commit == 3
    assert buffer.frames() == ["base", "below", "camera", "map", "new"]
    assert buffer.samples("base")[0].tolist() == [6000, 7000]
    assert buffer.frame_info("below").parent == "new"
    assert buffer.frame_info("map").parent is None
    assert buffer.frame_info("new").authority == "tracker"


def test_each_refused_member_has_a_reason(buffer: tfdb.Buffer) -> None:
    for record, index in zip(buffer.set_transforms(BATCH, partial=True), dict(WRONG), strict=True):
        alone = copy.deepcopy(BATCH[index])
        error = getattr(tfdb.errors, record.error)
        with pytest.raises(error) as caught:
            buffer.set_transforms([alone])
        assert caught.value.index == 0
        if record.error != "TooOld":  # which names the stamps that were valid then
            assert str(caught.value).startswith(record.message)
        assert record.reason


def test_all_or_nothing_names_all_of_them(buffer: tfdb.Buffer) -> None:
    with refused(buffer, tfdb.errors.InvalidTransform) as caught:
        buffer.set_transforms(BATCH, authority="tracker")
    assert caught.value.index == 1
    # Cycles are searched only without the members that were refused before.
    assert named(caught.value.refused) in (WRONG, [w for w in WRONG if w[1] != "CycleError"])
    again = pickle.loads(pickle.dumps(caught.value))
    assert again.refused == caught.value.refused


def test_a_single_refused_member_is_named(buffer: tfdb.Buffer) -> None:
    with refused(buffer, tfdb.errors.StaticConflict) as caught:
        buffer.set_transform("base", "camera", 6000, (1, 2, 3), TURN)
    assert named(caught.value.refused) == [(0, "StaticConflict")]
    with refused(buffer, tfdb.InvalidStamp) as caught:
        buffer.set_transforms([one("base"), one("base", 2.5)])
    assert caught.value.index == 1
    assert named(caught.value.refused) == [(1, "InvalidStamp")]


def test_all_good(buffer: tfdb.Buffer) -> None:
    assert buffer.set_transforms([one("base"), one("new")], partial=True) == []
    assert buffer.commit == 3
    assert buffer.set_transforms([], partial=True) == []
    assert buffer.commit == 3


def test_columns(buffer: tfdb.Buffer) -> None:
    poses = np.tile([1.0, 2, 3, *TURN], (6, 1))
    poses[2, 6] = NAN
    children = ["base", "base", "base", "bad\tname", "\ud800", "other"]
    stamps = np.array([6000, -7, 6002, 6003, 6004, 6005])
    columns = tfdb.Columns("map", children, stamps, poses)
    wrong = [
        (1, "InvalidStamp"),
        (2, "InvalidTransform"),
        (3, "InvalidName"),
        (4, "InvalidName"),
    ]
    with refused(buffer, tfdb.InvalidStamp) as caught:
        buffer.set_transforms(columns)
    assert caught.value.index == 1
    assert named(caught.value.refused) == wrong
    assert named(buffer.set_transforms(columns, partial=True)) == wrong
    assert buffer.samples("base")[0].tolist() == [5000, 6000]
    assert buffer.frame_exists("other")


def test_columns_that_are_wrong_as_a_whole(buffer: tfdb.Buffer) -> None:
    columns = tfdb.Columns("map", "base", [1, 2, 3], np.tile([1.0, 2, 3, *TURN], (2, 1)))
    with refused(buffer, tfdb.errors.InvalidArray) as caught:
        buffer.set_transforms(columns, partial=True)
    assert caught.value.refused is None


@pytest.mark.parametrize("item", [7, None, SimpleNamespace(child="x")])
def test_other_types_are_refused(buffer: tfdb.Buffer, item: Any) -> None:
    commit = buffer.commit
    with pytest.raises((TypeError, AttributeError)):
        buffer.set_transforms([one("base"), item], partial=True)
    assert buffer.commit == commit


# -- removal in bulk -------------------------------------------------------------------------------


@pytest.fixture
def tree() -> tfdb.Buffer:
    return tree_of_arms()


def tree_of_arms() -> tfdb.Buffer:
    """Ten arms with three fingers each."""
    buffer = tfdb.Buffer(history=None)
    batch = [one(f"arm{i}", 5) for i in range(10)]
    batch += [one(f"finger{i}{j}", 5, f"arm{i}", j) for i in range(10) for j in range(3)]
    buffer.set_transforms(batch)
    return buffer


def test_many_go_in_one_commit(tree: tfdb.Buffer) -> None:
    with tree.snapshot() as before:
        names = ["finger01", "arm0", "finger02", "finger00", "finger11"]
        assert tree.remove_frames(iter(names)) == 2
        assert tree.commit == 2
        assert not any(tree.frame_exists(name) for name in names)
        assert all(before.frame_exists(name) for name in names)
    assert len(tree.frames()) == 41 - 5
    assert tree.lookup_transform("map", "finger10").commit == 2


def test_one_name_is_removed_as_a_list_of_one_is(tree: tfdb.Buffer) -> None:
    assert tree.remove_frames("finger00") == 2
    with pytest.raises(tfdb.errors.FrameInUse) as caught:
        tree.remove_frames("arm1")
    assert (caught.value.index, caught.value.frame) == (0, "arm1")
    assert named(caught.value.refused) == [(0, "FrameInUse")]
    assert tree.remove_frames("arm1", recursive=True) == 3
    assert len(tree.frames()) == 41 - 5


@pytest.mark.parametrize("recursive", [False, True])
@pytest.mark.parametrize(
    "names",
    [
        "finger00",
        "arm0",
        "nobody",
        [],
        ["finger01", "arm0", "finger02", "finger00", "finger01"],
        ["finger00", "arm1", "nobody", "arm2", "finger01"],
        ("arm3", "nothing", "map"),
    ],
)
def test_transactions_remove_the_same_frames_as_buffers(names: Any, recursive: bool) -> None:
    plain, through = tree_of_arms(), tree_of_arms()

    def removed(remove: Any) -> Any:
        try:
            remove(names, recursive=recursive)
        except tfdb.TfdbError as error:
            return type(error), str(error), error.index, named(error.refused)
        return None

    expected = removed(plain.remove_frames)
    with through.transaction() as tx:
        assert removed(tx.remove_frames) == expected
        assert not tx.closed
    assert through.frames() == plain.frames()


def test_all_that_cannot_go_are_named(tree: tfdb.Buffer) -> None:
    names = ["finger00", "arm1", "nobody", "arm2", "finger01"]
    with refused(tree, tfdb.errors.FrameInUse) as caught:
        tree.remove_frames(names)
    assert caught.value.index == 1
    assert caught.value.frame == "arm1"
    assert named(caught.value.refused) == [
        (1, "FrameInUse"),
        (2, "UnknownFrame"),
        (3, "FrameInUse"),
    ]


@pytest.mark.parametrize("names", [7, None, [7], [None], ["arm0", 7]])
def test_names_that_are_none(tree: tfdb.Buffer, names: Any) -> None:
    with pytest.raises(TypeError):
        tree.remove_frames(names)
    assert tree.commit == 1

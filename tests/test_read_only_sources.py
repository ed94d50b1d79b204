"""Frames that `apply` brings are read-only for writers of the copy: each way to write is tried."""

from __future__ import annotations

import multiprocessing
import os
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from tests.recorder.reading import state_of
from tests.test_changes import pose
from tfdb import errors
from tfdb.net.messages import in_epoch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

S = 1_000_000_000


def new_robot() -> tfdb.Buffer:
    """odom, a root, moves base, which has a fixed camera."""
    robot = tfdb.Buffer()
    for stamp in (1, 2):
        robot.set_transform("odom", "base", stamp * S, *pose(stamp), authority="ekf")
    robot.set_static_transform("base", "camera", *pose(3))
    return robot


@pytest.fixture
def robot() -> tfdb.Buffer:
    return new_robot()


@pytest.fixture
def fleet(robot: tfdb.Buffer) -> tfdb.Buffer:
    """A copy of the robot, with a frame of its own."""
    fleet = tfdb.Buffer()
    fleet.set_transform("map", "own", S, *pose(1))
    fleet.apply(robot.commits_bytes(0), source="r1", prefix="r1/")
    return fleet


def ros1(*members: tuple[str, str, int]) -> bytes:
    made = [tfdb.TransformStamped(a, b, stamp, *pose(2)) for a, b, stamp in members]
    return tfdb.encode_tf_message(made, encoding="ros1")


def in_transaction(write: Callable[[tfdb.Transaction], object]) -> Callable[[tfdb.Buffer], object]:
    def do(buf: tfdb.Buffer) -> None:
        with buf.transaction() as tx:
            write(tx)

    return do


BASE, CAMERA = "r1/base", "r1/camera"
NEXT = tfdb.TransformStamped("r1/odom", BASE, 3 * S, *pose(4))
OWN = tfdb.TransformStamped("map", "own", 3 * S, *pose(4))
COLUMNS = tfdb.Columns(["r1/odom"], [BASE], [3 * S], [(0, 0, 0, 0, 0, 0, 1)])

WRITES: dict[str, Callable[[tfdb.Buffer], object]] = {
    "a sample": lambda buf: buf.set_transform("r1/odom", BASE, 3 * S, *pose(4)),
    "a late sample": lambda buf: buf.set_transform("r1/odom", BASE, S + 1, *pose(4)),
    "the same stamp": lambda buf: buf.set_transform("r1/odom", BASE, 2 * S, *pose(4)),
    "another parent": lambda buf: buf.set_transform("map", BASE, 3 * S, *pose(4)),
    "a static edge": lambda buf: buf.set_static_transform("r1/base", CAMERA, *pose(4)),
    "another kind": lambda buf: buf.set_transforms([NEXT], static=True, change_kind=True),
    "only new ones": lambda buf: buf.set_transforms([NEXT], only_new=True),
    "a batch": lambda buf: buf.set_transforms([OWN, NEXT]),
    "columns": lambda buf: buf.set_transforms(COLUMNS),
    "a removal": lambda buf: buf.remove_frames(CAMERA),
    "the removal of a root": lambda buf: buf.remove_frames("r1/odom", recursive=True),
    "a sample in a transaction": in_transaction(
        lambda tx: tx.set_transform("r1/odom", BASE, 3 * S, *pose(4))
    ),
    "a removal in a transaction": in_transaction(lambda tx: tx.remove_frames(CAMERA)),
    "a clear in a transaction": in_transaction(lambda tx: tx.clear()),
}


@pytest.mark.parametrize("write", WRITES.values(), ids=WRITES)
def test_a_write_is_refused_and_changes_nothing(
    fleet: tfdb.Buffer, write: Callable[[tfdb.Buffer], object]
) -> None:
    before, commit = state_of(fleet), fleet.commit
    with pytest.raises(errors.ReadOnly, match="is read-only here: it comes from source 'r1'") as e:
        write(fleet)
    assert (e.value.frame in (BASE, CAMERA, "r1/odom"), e.value.source) == (True, "r1")
    assert (state_of(fleet), fleet.commit) == (before, commit)


def test_the_error_names_the_edge_the_stamp_and_the_way_out(fleet: tfdb.Buffer) -> None:
    with pytest.raises(errors.ReadOnly) as caught:
        fleet.set_transforms([OWN, NEXT], authority="me")
    error = caught.value
    assert str(error) == (
        "T['r1/odom'<-'r1/base'] at 3.000000000 s from 'me' was refused: frame 'r1/base' is "
        "read-only here: it comes from source 'r1'. forget_source('r1') makes it writable"
    )
    assert (error.edge, error.parent, error.stamp) == (BASE, "r1/odom", 3 * S)
    assert (error.authority, error.index) == ("me", 1)
    assert [(each.index, each.error) for each in error.refused] == [(1, "ReadOnly")]


def test_ingest_stores_all_other_transforms_of_a_message(fleet: tfdb.Buffer) -> None:
    result = fleet.ingest_many(
        [ros1(("map", "own", 4 * S), ("r1/odom", BASE, 4 * S)), ros1(("map", "own", 5 * S))],
        encoding="ros1",
    )
    assert (result.messages, result.transforms, result.refused_transforms) == (2, 2, 1)
    assert result.reasons["ReadOnly"].count == 1
    assert fleet.samples("own")[0].tolist() == [S, 4 * S, 5 * S]
    assert fleet.samples(BASE)[0].tolist() == [S, 2 * S]


def test_a_root_may_hang_under_a_local_frame_and_not_be_removed(fleet: tfdb.Buffer) -> None:
    fleet.set_static_transform("map", "r1/odom", *pose(5))
    fleet.set_static_transform("map", "r1/odom", *pose(6))  # it is the writer's own edge
    assert fleet.lookup_transform("map", CAMERA, S).stamp == S
    with pytest.raises(errors.ReadOnly, match="frame 'r1/odom' is read-only"):
        fleet.remove_frames("r1/odom", recursive=True)
    fleet.set_static_transform(CAMERA, "sticker", *pose(7))
    fleet.remove_frames("sticker")
    with pytest.raises(errors.ReadOnly):  # what hangs below a local frame goes with it
        fleet.remove_frames("map", recursive=True)


def test_the_source_goes_on_beside_local_writers(robot: tfdb.Buffer, fleet: tfdb.Buffer) -> None:
    fleet.set_transform("map", "own", 2 * S, *pose(1))
    before = robot.commit
    robot.set_transform("odom", "base", 3 * S, *pose(9))
    robot.set_static_transform("base", "lidar", *pose(9))
    fleet.apply(robot.commits_bytes(before), source="r1", prefix="r1/")
    assert fleet.samples(BASE)[0].tolist() == [S, 2 * S, 3 * S]
    assert "r1/lidar" in fleet.frames()


def test_clear_keeps_the_samples_of_a_source(fleet: tfdb.Buffer) -> None:
    fleet.clear()
    assert fleet.samples("own")[0].size == 0
    assert fleet.samples(BASE)[0].tolist() == [S, 2 * S]


def test_an_edge_that_its_source_has_cleared_may_be_written(
    robot: tfdb.Buffer, fleet: tfdb.Buffer
) -> None:
    before = robot.commit
    robot.clear()
    fleet.apply(robot.commits_bytes(before), source="r1", prefix="r1/")
    fleet.set_transform("map", BASE, 9 * S, *pose(1))
    assert fleet.parent_of(BASE) == "map"
    before = robot.commit
    robot.set_transform("odom", "base", 3 * S, *pose(9))
    with pytest.warns(errors.TfdbWarning, match=r"frame 'r1/base' has the parent that source"):
        fleet.apply(robot.commits_bytes(before), source="r1", prefix="r1/")
    assert fleet.samples(BASE)[0].tolist() == [3 * S]
    with pytest.raises(errors.ReadOnly):
        fleet.set_transform("map", BASE, 9 * S, *pose(1))


def test_a_forgotten_source_leaves_its_frames_to_local_writers(
    robot: tfdb.Buffer, fleet: tfdb.Buffer
) -> None:
    fleet.forget_source("r1")
    fleet.set_transform("r1/odom", BASE, 3 * S, *pose(4))
    fleet.remove_frames(CAMERA)
    with robot.snapshot() as snap:
        state = snap.state_bytes()
    with pytest.warns(errors.TfdbWarning, match="frame 'r1/base' has the parent"):
        fleet.apply(state, source="r1", prefix="r1/")
    assert fleet.samples(BASE)[0].tolist() == [S, 2 * S]
    assert CAMERA in fleet.frames()
    with pytest.raises(errors.ReadOnly):
        fleet.set_transform("r1/odom", BASE, 3 * S, *pose(4))


def test_a_removed_frame_that_is_still_a_parent_is_named() -> None:
    """No store sends that: these are commits of two stores with one epoch."""
    one, other, copy = tfdb.Buffer(), tfdb.Buffer(), tfdb.Buffer()
    one.set_transform("q", "x", 10, *pose(1))
    other.set_transform("p", "q", 10, *pose(1))
    other.remove_frames("q")
    copy.apply(one.commits_bytes(0))
    with pytest.raises(
        errors.FrameInUse, match=r"'q' is the parent of 'x': source '' removes it: store another"
    ) as caught:
        copy.apply(in_epoch(other.commits_bytes(1), one.epoch))
    assert "recursive" not in str(caught.value)
    assert copy.parent_of("x") == "q"


@pytest.fixture
def store_name() -> Iterator[str]:
    name = f"test-read-only-{os.getpid()}"
    yield name
    tfdb.Buffer.unlink(name)


def _write_in_child(name: str, results: Any) -> None:
    buf = tfdb.Buffer.open(name)
    try:
        buf.set_transform("r1/odom", BASE, 3 * S, *pose(4))
    except errors.ReadOnly as error:
        results.put(str(error))
    buf.set_transform("map", "own", 3 * S, *pose(4))


def test_writers_of_other_processes_are_refused_too(robot: tfdb.Buffer, store_name: str) -> None:
    fleet = tfdb.Buffer.open(store_name)
    fleet.apply(robot.commits_bytes(0), source="r1", prefix="r1/")
    context = multiprocessing.get_context("spawn")
    results = context.Queue()
    child = context.Process(target=_write_in_child, args=(store_name, results))
    child.start()
    assert "comes from source 'r1'" in results.get(timeout=60)
    child.join()
    assert child.exitcode == 0
    assert fleet.samples("own")[0].tolist() == [3 * S]

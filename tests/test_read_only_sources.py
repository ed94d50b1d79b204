"""Frames that `apply` brings are read-only for writers of the copy: each way to write is tried."""

from __future__ import annotations

import contextlib
import multiprocessing
import random
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tests.recorder.reading import state_of
from tests.test_changes import NAMES, Writer, pose
from tfdb import errors
from tfdb.net.messages import in_epoch

if TYPE_CHECKING:
    from collections.abc import Callable

pytestmark = pytest.mark.usefixtures("by_both_appliers")

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
    "the removal of a parent": lambda buf: buf.remove_frames(BASE),
    "the removal of a parent in a transaction": in_transaction(lambda tx: tx.remove_frames(BASE)),
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
        "T[r1/odom<-r1/base] at 3.000000000 s from 'me' was refused: frame 'r1/base' is "
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


def test_a_root_may_hang_under_a_local_frame(fleet: tfdb.Buffer) -> None:
    fleet.set_static_transform("map", "r1/odom", *pose(5))
    fleet.set_static_transform("map", "r1/odom", *pose(6))  # it is the writer's own edge
    assert fleet.lookup_transform("map", CAMERA, S).stamp == S


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
    with pytest.warns(errors.TfdbWarning, match="frame 'r1/base' lost the parent"):
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
    with pytest.warns(errors.TfdbWarning, match="frame 'r1/base' lost the parent"):
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


def _write_in_child(name: str, results: Any) -> None:
    buf = tfdb.Buffer.open(name)
    try:
        buf.set_transform("r1/odom", BASE, 3 * S, *pose(4))
    except errors.ReadOnly as error:
        results.put(str(error))
    buf.set_transform("map", "own", 3 * S, *pose(4))


def test_writers_of_other_processes_are_refused_too(robot: tfdb.Buffer, name: str) -> None:
    fleet = tfdb.Buffer.open(name)
    fleet.apply(robot.commits_bytes(0), source="r1", prefix="r1/")
    context = multiprocessing.get_context("spawn")
    results = context.Queue()
    child = context.Process(target=_write_in_child, args=(name, results))
    child.start()
    assert "comes from source 'r1'" in results.get(timeout=60)
    child.join()
    assert child.exitcode == 0
    assert fleet.samples("own")[0].tolist() == [3 * S]


@pytest.mark.parametrize("is_static", [True, False])
def test_removing_a_root_of_a_source_removes_its_local_parent_only(
    fleet: tfdb.Buffer, is_static: bool
) -> None:
    before = fleet.frames()
    hook = tfdb.TransformStamped("map", "r1/odom", S, *pose(5))
    fleet.set_transforms([hook], static=is_static)
    fleet.set_static_transform(CAMERA, "sticker", *pose(7))
    fleet.remove_frames("r1/odom", recursive=True)
    assert fleet.frames() == [*before, "sticker"]
    assert fleet.parent_of("r1/odom") is None
    assert fleet.lookup_transform("r1/odom", "sticker", S).stamp == S
    with pytest.raises(errors.ReadOnly, match="frame 'r1/odom' is read-only"):
        fleet.remove_frames("r1/odom", recursive=True)
    fleet.set_transforms([hook], static=not is_static)
    assert fleet.lookup_transform("map", CAMERA, S).stamp == S


def test_a_root_of_a_source_stays_if_its_local_parent_is_removed(fleet: tfdb.Buffer) -> None:
    fleet.set_static_transform("map", "r1/odom", *pose(5))
    with pytest.raises(errors.FrameInUse, match=r"'map' is the parent of 'own', 'r1/odom'"):
        fleet.remove_frames("map")
    with pytest.raises(errors.FrameInUse, match=r"'map' is the parent of 'r1/odom'"):
        fleet.remove_frames(["map", "own"])
    whole = state_of(fleet)
    fleet.remove_frames(["map", "r1/odom", "own"])
    assert fleet.frames() == [BASE, CAMERA, "r1/odom"]
    assert fleet.parent_of("r1/odom") is None
    fleet.set_transform("map", "own", S, *pose(1))
    fleet.set_static_transform("map", "r1/odom", *pose(5))
    assert len(state_of(fleet)) == len(whole)
    fleet.remove_frames("map", recursive=True)
    assert fleet.frames() == [BASE, CAMERA, "r1/odom"]


def test_a_removal_beside_a_root_that_stays_checks_other_children(fleet: tfdb.Buffer) -> None:
    fleet.set_static_transform("map", "r1/odom", *pose(5))
    fleet.set_static_transform("r1/odom", "sticker", *pose(7))
    fleet.set_static_transform("sticker", "dot", *pose(7))
    with pytest.raises(errors.FrameInUse, match="'sticker' is the parent of 'dot'"):
        fleet.remove_frames(["r1/odom", "sticker"])
    assert fleet.parent_of("r1/odom") == "map"
    fleet.remove_frames(["r1/odom", "sticker", "dot"])
    assert fleet.frames() == ["map", "own", BASE, CAMERA, "r1/odom"]


def test_a_transaction_does_not_remove_the_local_parent_of_a_root(fleet: tfdb.Buffer) -> None:
    fleet.set_static_transform("map", "r1/odom", *pose(5))
    with pytest.raises(errors.ReadOnly), fleet.transaction() as tx:
        tx.remove_frames("r1/odom", recursive=True)
    assert fleet.parent_of("r1/odom") == "map"


def test_a_mirror_of_the_copy_loses_the_local_parent_too(fleet: tfdb.Buffer) -> None:
    copy = tfdb.Buffer()
    fleet.set_static_transform("map", "r1/odom", *pose(5))
    copy.apply(fleet.commits_bytes(0), source="fleet")
    before = fleet.commit
    fleet.remove_frames("r1/odom")
    copy.apply(fleet.commits_bytes(before), source="fleet")
    assert copy.parent_of("r1/odom") is None
    assert copy.frames() == fleet.frames()


def test_a_commit_that_closes_a_cycle_replaces_the_local_edge(robot: tfdb.Buffer) -> None:
    robot.set_static_transform("spare", "lidar", *pose(4))
    fleet = tfdb.Buffer()
    fleet.apply(robot.commits_bytes(0), source="r1", prefix="r1/")
    fleet.set_static_transform("r1/lidar", "table", *pose(5))
    fleet.set_static_transform("table", "chair", *pose(5))
    fleet.set_static_transform("chair", "r1/odom", *pose(6))
    before = robot.commit
    robot.set_static_transform("camera", "spare", *pose(7))
    with pytest.warns(
        errors.TfdbWarning,
        match="frame 'r1/odom' lost the parent that was stored here: source 'r1' stores another "
        "parent, or made the frame an ancestor of that one",
    ):
        fleet.apply(robot.commits_bytes(before), source="r1", prefix="r1/")
    assert fleet.parent_of("r1/odom") is None
    assert fleet.lookup_transform("r1/odom", "chair", 2 * S).stamp == 2 * S


def test_a_lost_parent_is_warned_of_if_a_later_commit_is_refused(robot: tfdb.Buffer) -> None:
    fleet = tfdb.Buffer(max_frames=5)
    fleet.apply(robot.commits_bytes(0), source="r1", prefix="r1/")
    fleet.set_transform("map", "r1/odom", S, *pose(1))
    before = robot.commit
    robot.set_transform("earth", "odom", S, *pose(2))
    robot.set_transform("base", "lidar", S, *pose(2))
    data = robot.commits_bytes(before)
    with (
        pytest.warns(tfdb.TfdbWarning, match="frame 'r1/odom' lost the parent"),
        pytest.raises(errors.CapacityExceeded),
    ):
        fleet.apply(data, source="r1", prefix="r1/")
    assert fleet.frame_info("r1/odom").parent == "r1/earth"
    assert fleet.positions()[0].commit == before + 1


class Locals:
    """Random writes of a store that has a source's frames."""

    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.names = ["map", "own", "table", *(f"r1/{name}" for name in NAMES)]

    def act(self, buf: tfdb.Buffer) -> None:
        parent, child = self.random.sample(self.names, 2)
        with contextlib.suppress(tfdb.TfdbError):
            if self.random.random() < 0.25:
                buf.remove_frames([parent, child], recursive=self.random.random() < 0.5)
            elif self.random.random() < 0.5:
                buf.set_static_transform(parent, child, *pose(self.random.randrange(99)))
            else:
                stamp = 100 + self.random.randrange(60)
                buf.set_transform(parent, child, stamp, *pose(self.random.randrange(99)))


def check_has_all_of(source: tfdb.Buffer, copy: tfdb.Buffer) -> None:
    """The copy has exactly the samples of each frame of the source that has a parent."""
    for frame in source.frames():
        if source.parent_of(frame) is None:
            continue
        assert copy.parent_of(f"r1/{frame}") == f"r1/{source.parent_of(frame)}"
        stamps, poses, parents = source.samples(frame)
        own = copy.samples(f"r1/{frame}")
        assert np.array_equal(own[0], stamps)
        assert np.array_equal(own[1], poses)
        # A removed frame has no name any more; the copy keeps one that has a local child.
        assert all(b == f"r1/{a}" for a, b in zip(parents, own[2], strict=True) if a)


@pytest.mark.filterwarnings("ignore::tfdb.errors.TfdbWarning")
@pytest.mark.parametrize("seed", range(40))
def test_no_local_write_keeps_commits_of_the_source_out(seed: int) -> None:
    robot, fleet = tfdb.Buffer(history=None), tfdb.Buffer(history=None)
    writer, local = Writer(seed), Locals(seed)
    for _ in range(250):
        before = robot.commit
        with robot.snapshot():  # no sample is gone before it was read
            writer.act(robot)
            data = robot.commits_bytes(before)
        if local.random.random() < 0.05:
            with robot.snapshot() as snap:
                data = snap.state_bytes()
        try:
            if data:
                fleet.apply(data, source="r1", prefix="r1/")
        except errors.CycleError:  # its samples name a frame that stayed for a local child
            with robot.snapshot() as snap:
                fleet.apply(snap.state_bytes(), source="r1", prefix="r1/")
        check_has_all_of(robot, fleet)
        local.act(fleet)
        check_has_all_of(robot, fleet)


def test_a_source_does_not_take_a_frame_of_another_one(robot: tfdb.Buffer) -> None:
    """The name of the frame decides, not which source was first."""
    other, fleet = tfdb.Buffer(), tfdb.Buffer()
    other.set_static_transform("map", "r1/base", *pose(8))
    options: dict[str, Any] = {"source": "r2", "prefix": "r2/", "shared": ["map", BASE]}
    fleet.apply(other.commits_bytes(0), **options)
    assert fleet.parent_of(BASE) == "map"
    with pytest.warns(errors.TfdbWarning, match="frame 'r1/base' lost the parent"):
        fleet.apply(robot.commits_bytes(0), source="r1", prefix="r1/")
    whole, before = state_of(fleet), other.commit
    other.set_static_transform("map", "r1/base", *pose(9))
    with pytest.raises(tfdb.InvalidArgument) as caught:
        fleet.apply(other.commits_bytes(before), **options)
    assert str(caught.value) == (
        "frame 'r1/base' comes from source 'r1': it must not be a shared frame (shared=) of "
        "source 'r2'"
    )
    assert state_of(fleet) == whole


def test_a_frame_that_stays_for_a_local_child_is_left_to_local_writers(
    robot: tfdb.Buffer, fleet: tfdb.Buffer
) -> None:
    def follow(change: Callable[[], object]) -> None:
        before = robot.commit
        change()
        fleet.apply(robot.commits_bytes(before), source="r1", prefix="r1/")

    fleet.set_static_transform(CAMERA, "sticker", *pose(7))
    follow(lambda: robot.remove_frames("camera"))
    assert CAMERA in fleet.frames()
    follow(lambda: robot.set_static_transform("base", "camera", *pose(8)))
    with pytest.raises(errors.ReadOnly):
        fleet.remove_frames(CAMERA, recursive=True)
    follow(lambda: robot.remove_frames("camera"))
    fleet.set_static_transform("map", CAMERA, *pose(7))
    fleet.remove_frames("sticker")
    fleet.remove_frames(CAMERA)
    assert CAMERA not in fleet.frames()
    follow(lambda: robot.set_static_transform("base", "camera", *pose(8)))
    assert fleet.parent_of(CAMERA) == BASE


@pytest.mark.parametrize("by_state", [False, True])
def test_a_shared_frame_keeps_the_samples_of_another_source(by_state: bool) -> None:
    """The source that created the frame removes it; the other source has stored its edge."""
    robots = {"r1": tfdb.Buffer(), "r2": tfdb.Buffer()}
    fleet = tfdb.Buffer()

    def follow(name: str, by_state: bool = False) -> None:
        positions = [each.commit for each in fleet.positions() if each.source == name]
        data = robots[name].commits_bytes(*positions or [0])
        if by_state:
            with robots[name].snapshot() as snap:
                data = snap.state_bytes()
        fleet.apply(data, source=name, prefix=f"{name}/", shared=["map"])

    robots["r1"].set_static_transform("map", "base", *pose(1))
    follow("r1")
    robots["r2"].set_transform("site", "map", S, *pose(2))
    follow("r2")
    robots["r1"].remove_frames("map", recursive=True)
    follow("r1", by_state)
    assert fleet.parent_of("map") == "r2/site"
    assert (fleet.samples("map")[1] == robots["r2"].samples("map")[1]).all()
    with pytest.raises(errors.ReadOnly, match="it comes from source 'r2'"):
        fleet.remove_frames("map")
    robots["r1"].set_static_transform("map", "base", *pose(3))
    follow("r1")
    assert fleet.lookup_transform("r2/site", "r1/base", S).stamp == S
    robots["r1"].remove_frames("map", recursive=True)
    follow("r1")
    robots["r2"].remove_frames("map")
    follow("r2")
    assert fleet.frames() == ["r2/site"]


def test_a_shared_frame_stays_while_another_source_names_it_as_an_earlier_parent() -> None:
    one, other, fleet = tfdb.Buffer(), tfdb.Buffer(), tfdb.Buffer()
    one.set_static_transform("map", "base", *pose(1))
    fleet.apply(one.commits_bytes(0), source="r1", prefix="r1/", shared=["map"])
    other.set_transform("map", "base", S, *pose(2))
    other.set_transform("odom", "base", 2 * S, *pose(3))
    fleet.apply(other.commits_bytes(0), source="r2", prefix="r2/", shared=["map"])
    one.remove_frames("map", recursive=True)
    fleet.apply(one.commits_bytes(1), source="r1", prefix="r1/", shared=["map"])
    assert fleet.samples("r2/base")[2] == ["map", "r2/odom"]


def test_a_state_keeps_the_earlier_parents_of_local_frames(
    robot: tfdb.Buffer, fleet: tfdb.Buffer
) -> None:
    fleet.set_transform("r1/odom", "box", S, *pose(5))
    fleet.set_transform(CAMERA, "box", 2 * S, *pose(6))
    before = fleet.lookup_transform("r1/odom", "box", S)
    fleet.set_static_transform("map", "r1/odom", *pose(7))
    fleet.remove_frames("r1/odom")
    robot.set_static_transform("base", "lidar", *pose(8))
    with robot.snapshot() as snap:
        fleet.apply(snap.state_bytes(), source="r1", prefix="r1/")
    assert fleet.samples("box")[2] == ["r1/odom", CAMERA]
    assert (fleet.lookup_transform("r1/odom", "box", S).matrix == before.matrix).all()
    with pytest.raises(errors.ReadOnly):
        fleet.remove_frames("r1/odom", recursive=True)


def test_each_loss_of_a_local_parent_is_warned_of(robot: tfdb.Buffer, fleet: tfdb.Buffer) -> None:
    def follow(change: Callable[[], object]) -> None:
        before = robot.commit
        change()
        fleet.apply(robot.commits_bytes(before), source="r1", prefix="r1/")

    with pytest.warns(errors.TfdbWarning, match="CycleError"):  # of the same frame
        fleet.ingest(ros1(("r1/camera", "r1/odom", S), ("map", "own", 5 * S)), encoding="ros1")
    for _ in range(2):
        fleet.set_static_transform("map", "r1/odom", *pose(5))
        with pytest.warns(errors.TfdbWarning, match="frame 'r1/odom' lost the parent"):
            follow(lambda: robot.set_static_transform("earth", "odom", *pose(6)))
        follow(lambda: robot.remove_frames("odom", recursive=True))
        follow(lambda: robot.set_static_transform("odom", "camera", *pose(6)))

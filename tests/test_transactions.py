"""Transactions: their reads, writes and conflicts."""

from __future__ import annotations

import gc
import inspect
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from another_thread import in_another_thread
from chain import BACK, TURN, chain, contents
from oracle import matrix
from robot import make_robot, stamp_of

if TYPE_CHECKING:
    from collections.abc import Callable

# -- what is seen and what is left -----------------------------------------------------------------


def test_writes_appear_at_the_end_all_at_once() -> None:
    buffer = chain()
    with buffer.transaction() as tx:
        assert not tx.closed
        assert tx.commit is None
        tx.set_transform("map", "base", 40, (40, 1, 2), TURN)
        tx.set_static_transform("map", "door", (7, 8, 9), BACK)
        assert buffer.commit == 4
        assert not in_another_thread(lambda: buffer.frame_exists("door"))
        assert not in_another_thread(lambda: buffer.can_transform("map", "base", 40))
    assert tx.closed
    assert tx.commit == buffer.commit == 5
    assert buffer.lookup_transform("map", "base", 40).translation[0] == 40
    assert buffer.lookup_transform("map", "door").pose == pytest.approx([7, 8, 9, *BACK])


@pytest.mark.parametrize("frames", [("map", "tip"), ("tip", "map")], ids="->".join)
def test_it_reads_its_own_writes(frames: tuple[str, str]) -> None:
    """A path through old edges, a new sample of an old edge, and new frames."""
    buffer = chain()
    poses = [(40, 1, 2, *TURN), (0, 0.5, 1, *BACK), (0.1, 0.2, 0.3, *TURN), (0, 0, 0.4, *BACK)]
    expected = np.eye(4)
    for pose in poses:
        expected = expected @ matrix(pose)
    if frames[0] == "tip":
        expected = np.linalg.inv(expected)
    with buffer.transaction() as tx:
        tx.set_transform("map", "base", 40, poses[0][:3], poses[0][3:])
        tx.set_transform("camera", "hand", 40, poses[2][:3], poses[2][3:])
        tx.set_static_transform("hand", "tip", poses[3][:3], poses[3][3:])
        found = tx.lookup_transform(*frames, 40)
        assert found.matrix == pytest.approx(expected, abs=1e-12)
        rows = tx.lookup_transforms(*frames, [40, 40], layout="matrix")
        assert rows == pytest.approx(np.stack([expected] * 2), abs=1e-12)
        latest = tx.lookup_latest_transform(*frames)
        assert latest.matrix == pytest.approx(expected, abs=1e-12)
        assert tx.can_transform(*frames, 40)
        assert not tx.can_transform(*frames, 41)
        assert tx.latest_common_time(*frames) == 40
        assert tx.frame_exists("tip")
    again = buffer.lookup_transform(*frames, 40)
    assert again.matrix == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit, GeneratorExit])
def test_an_exception_leaves_nothing_behind(error: type[BaseException]) -> None:
    buffer = chain()
    before = contents(buffer)
    frames = buffer.memory().frames

    def work() -> None:
        with buffer.transaction() as tx:
            tx.set_transform("map", "base", 40, (40, 1, 2), TURN)
            tx.set_transform("base", "new", 40, (40, 1, 2), TURN)
            tx.remove_frames("camera")
            raise error

    with pytest.raises(error):
        work()
    assert contents(buffer) == before
    assert buffer.memory().frames == frames
    assert buffer.counters().aborts == 1
    assert buffer.counters().conflicts == 0
    with buffer.transaction() as tx:
        assert not tx.frame_exists("new")


def test_abort_leaves_nothing_behind_and_the_block_goes_on() -> None:
    buffer = chain()
    before = contents(buffer)
    with buffer.transaction() as tx:
        tx.set_transform("map", "base", 40, (40, 1, 2), TURN)
        tx.abort()
        assert tx.closed
        tx.abort()
        buffer.lookup_transform("map", "base")  # the thread is free again
    assert tx.commit is None
    assert contents(buffer) == before


def test_one_that_writes_nothing_commits_nothing() -> None:
    buffer = chain()
    with buffer.transaction() as tx:
        tx.lookup_transform("map", "base")
        tx.set_transforms([])
    assert tx.commit == buffer.commit == 4


def test_it_prints_how_far_it_has_come() -> None:
    buffer = chain()
    tx = buffer.transaction()
    assert repr(tx) == "<tfdb.Transaction, not begun>"
    with tx:
        assert repr(tx) == "<tfdb.Transaction, open>"
        tx.set_transform("map", "base", 40, (40, 1, 2), TURN)
    assert repr(tx) == "<tfdb.Transaction, committed at 5>"
    with buffer.transaction() as tx:
        tx.abort()
    assert repr(tx) == "<tfdb.Transaction, aborted>"


# -- answers ---------------------------------------------------------------------------------------


def test_reports_stay_right_after_the_end() -> None:
    """Also for frames that only the transaction made, and that no store has had."""
    buffer = chain()
    with buffer.transaction() as tx:
        tx.set_static_transform("camera", "marker", (1, 0, 0), TURN)
        tx.set_transform("map", "odom", 20, (0, 0, 1), BACK)
        found = tx.lookup_transform("odom", "marker", 20)
        tx.abort()
    edges = [(edge.child, edge.parent, edge.used, edge.inverted) for edge in found.report.edges]
    assert edges == [
        ("marker", "camera", "static", False),
        ("camera", "base", "static", False),
        ("base", "map", "exact", False),
        ("odom", "map", "exact", True),
    ]
    assert str(found.report).count("T[") == 5


def test_answers_equal_those_of_the_store() -> None:
    buffer = make_robot().buffer
    stamps = np.array([stamp_of(i + 0.3) for i in range(30)])
    with buffer.snapshot() as robot, buffer.transaction() as tx:
        for target, source in (("map", "camera"), ("lidar", "right_arm"), ("camera", "odom")):
            for stamp in (None, stamp_of(3.5), stamp_of(7)):
                mine = tx.lookup_transform(target, source, stamp)
                theirs = robot.lookup_transform(target, source, stamp)
                assert mine.pose == pytest.approx(theirs.pose, abs=1e-12)
                assert (mine.stamp, mine.commit) == (theirs.stamp, theirs.commit)
                assert mine.report == theirs.report
            rows = robot.lookup_transforms(target, source, stamps)
            assert tx.lookup_transforms(target, source, stamps) == pytest.approx(rows, abs=1e-12)
            latest = tx.lookup_latest_transform(target, source)
            assert latest == robot.lookup_latest_transform(target, source)
            common = tx.latest_common_time(target, source)
            assert common == robot.latest_common_time(target, source)
        previous = tx.lookup_transform("map", "base", stamp_of(3.5), tfdb.Previous())
        assert previous == robot.lookup_transform("map", "base", stamp_of(3.5), tfdb.Previous())


def test_rows_go_where_they_are_asked_to() -> None:
    buffer = chain()
    out = np.empty((3, 7))
    with buffer.transaction() as tx:
        given = tx.lookup_transforms("map", "base", [10, 15, 99], out=out, missing="nan")
        assert given is out
        with pytest.raises(tfdb.Extrapolation) as caught:
            tx.lookup_transforms("map", "base", [10, 15, 99])
        assert caught.value.index == 2
    assert out[:2, 0] == pytest.approx([10, 15])
    assert np.isnan(out[2]).all()


def test_the_age_of_the_data_is_asked_of_the_buffers_clock() -> None:
    buffer = tfdb.Buffer(clock=lambda: 2_000_000_030)
    buffer.set_transform("map", "base", 30, (1, 2, 3), TURN)
    with buffer.transaction() as tx:
        assert tx.lookup_latest_transform("map", "base", 2.0).stamp == 30
        with pytest.raises(tfdb.errors.Stale):
            tx.lookup_latest_transform("map", "base", 1.9)
        tx.lookup_latest_transform("map", "base", 1.9, now=1_900_000_030)


# -- writes ----------------------------------------------------------------------------------------


def test_batches_and_columns_are_taken() -> None:
    buffer = chain()
    poses = np.tile([1.0, 2, 3, *TURN], (5, 1))
    with buffer.transaction() as tx:
        tx.set_transforms(tfdb.Columns("map", "base", range(40, 45), poses), authority="slam")
        batch = [tfdb.TransformStamped("base", name, 0, (1, 2, 3), BACK) for name in "ab"]
        tx.set_transforms(batch, static=True, authority="urdf")
    assert buffer.commit == 5
    assert buffer.frame_info("base").newest == 44
    assert buffer.frame_info("base").authority == "slam"
    assert buffer.frame_info("a").authority == "urdf"
    assert buffer.frame_info("b").is_static


def test_a_refused_batch_leaves_it_open_and_as_it_was() -> None:
    buffer = chain()
    good = tfdb.TransformStamped("map", "base", 40, (1, 2, 3), TURN)
    bad = [
        tfdb.TransformStamped("map", "base", 41, (1, 2, float("nan")), TURN),
        tfdb.TransformStamped("map", "base", 42, (1, 2), TURN),
        tfdb.TransformStamped("base", "camera", 43, (1, 2, 3), TURN),
    ]
    with buffer.transaction() as tx:
        with pytest.raises(tfdb.errors.InvalidTransform) as caught:
            tx.set_transforms([good, *bad], authority="ekf")
        assert caught.value.index == 1
        assert not tx.closed
        assert not tx.can_transform("map", "base", 40)
        tx.set_transform("map", "base", 50, (5, 0, 0), TURN)
    assert buffer.frame_info("base").newest == 50
    assert [(r.index, r.error) for r in caught.value.refused or ()] == [
        (1, "InvalidTransform"),
        (2, "InvalidArray"),
        (3, "StaticConflict"),
    ]


def table() -> tfdb.Buffer:
    """A cup on a table, and an arm."""
    buffer = tfdb.Buffer(history=None)
    buffer.set_static_transform("map", "table", (1, 2, 0.7), TURN)
    buffer.set_transform("map", "gripper", 5, (1, 2, 1), BACK)
    buffer.set_transform("map", "gripper", 50, (3, 2, 1), TURN)
    buffer.set_transform("table", "cup", 5, (0.1, 0.2, 0), BACK)
    return buffer


def test_a_new_parent_leaves_a_frame_where_it_is() -> None:
    buffer = table()
    before = buffer.lookup_transform("map", "cup", 5)
    with buffer.transaction() as tx:
        tx.reparent("cup", "gripper", 5)
        held = tx.lookup_transform("map", "cup", 5)
        assert held.matrix == pytest.approx(before.matrix, abs=1e-12)
        assert [edge.parent for edge in held.report.edges] == ["gripper", "map"]
    assert buffer.frame_info("cup").parent == "gripper"
    after = buffer.lookup_transform("map", "cup", 5)
    assert after.matrix == pytest.approx(before.matrix, abs=1e-12)


def test_a_new_parent_at_a_given_pose_from_a_stamp_on() -> None:
    buffer = table()
    with buffer.transaction() as tx:
        tx.reparent("cup", "gripper", 40, (0, 0, 0.1), TURN, authority="arm")
        assert tx.lookup_transform("gripper", "cup", 40).pose == pytest.approx([0, 0, 0.1, *TURN])
    assert [info.parent for info in buffer.tree(39) if info.name == "cup"] == ["table"]
    assert buffer.samples("cup")[2] == ["table", "gripper"]
    assert buffer.frame_info("cup").authority == "arm"
    back = buffer.lookup_transform("cup", "gripper", 40)
    assert back.matrix == pytest.approx(np.linalg.inv(matrix([0, 0, 0.1, *TURN])), abs=1e-12)


def test_a_new_parent_of_a_static_frame() -> None:
    buffer = chain()
    buffer.set_static_transform("base", "arm", (0, 1, 0), TURN)
    before = buffer.lookup_transform("arm", "camera")
    with buffer.transaction() as tx:
        tx.reparent("camera", "arm")
    assert buffer.frame_info("camera").parent == "arm"
    after = buffer.lookup_transform("arm", "camera")
    assert after.matrix == pytest.approx(before.matrix, abs=1e-12)
    with buffer.transaction() as tx:
        tx.reparent("camera", "base", translation=(1, 2, 3))
    assert buffer.lookup_transform("base", "camera").pose == pytest.approx([1, 2, 3, 0, 0, 0, 1])


@pytest.mark.parametrize(
    "call",
    [
        lambda writes: writes.reparent("cup", "gripper", 5),
        lambda writes: writes.reparent("cup", "gripper", 40, (0, 0, 0.1), TURN, authority="arm"),
        lambda writes: writes.reparent("cup", "gripper", 40, (0, 0, 0.1), rpy=(0, 0, 1)),
        lambda writes: writes.reparent("cup", "gripper", 40, rotation=TURN),
        lambda writes: writes.reparent("cup", "nowhere", 5),
        lambda writes: writes.reparent("map", "cup", 5),
        lambda writes: writes.reparent("cup", "gripper"),
        lambda writes: writes.reparent("cup", 7),
    ],
)
def test_a_buffer_reparents_as_a_transaction_does(call: Callable[[Any], Any]) -> None:
    def done(buffer: tfdb.Buffer, write: Callable[[], Any]) -> Any:
        try:
            return write(), buffer.tree(), buffer.samples("cup")[2]
        except (tfdb.TfdbError, TypeError) as error:
            return type(error), str(error), buffer.commit

    plain, through = table(), table()

    def attempt() -> int | None:
        with through.transaction() as tx:
            assert call(tx) is None
        return tx.commit

    assert done(plain, lambda: call(plain)) == done(through, attempt)


def test_reparent_keeps_the_place_of_the_newest_commit() -> None:
    buffer = table()
    before = buffer.lookup_transform("map", "cup", 5)
    assert buffer.reparent("cup", "gripper", 5) == buffer.commit
    after = buffer.lookup_transform("map", "cup", 5)
    assert after.matrix == pytest.approx(before.matrix, abs=1e-12)
    assert after.report.edges[0].parent == "gripper"
    with buffer.transaction(), pytest.raises(tfdb.errors.TransactionActive):
        buffer.reparent("cup", "table", 5)


# -- threads and lives -----------------------------------------------------------------------------


def test_stores_do_not_mind_each_others_transactions() -> None:
    one, two = chain(), chain()
    with one.transaction() as a, two.transaction() as b:
        pose = a.lookup_transform("map", "base", 20)
        b.set_transform("map", "copy", 20, pose.translation, pose.rotation)
        a.set_transform("map", "base", 40, (4, 4, 4), TURN)
    assert one.commit == two.commit == 5


def test_each_thread_may_have_one() -> None:
    buffer = chain()

    def write() -> int | None:
        with buffer.transaction() as tx:
            tx.set_transform("map", "b", 40, (4, 4, 4), TURN)
        return tx.commit

    with buffer.transaction() as tx:
        tx.set_transform("map", "a", 40, (4, 4, 4), TURN)
        assert in_another_thread(write) == 5
    assert tx.commit == 6


@pytest.mark.parametrize("free", [gc.collect, lambda: in_another_thread(gc.collect)])
def test_an_unreferenced_transaction_is_aborted(free: Callable[[], object]) -> None:
    buffer = chain()
    before = contents(buffer)
    tx: Any = buffer.transaction()
    tx.__enter__()
    tx.set_transform("map", "base", 40, (4, 4, 4), TURN)
    ring = [tx]
    ring.append(ring)  # so that only the garbage collector frees it
    del tx, ring
    free()
    assert contents(buffer) == before
    with buffer.transaction() as again:
        again.set_transform("map", "base", 40, (4, 4, 4), TURN)
    assert buffer.commit == 5


def test_one_that_another_thread_lets_go_of() -> None:
    buffer = chain()
    held: list[Any] = [buffer.transaction()]
    held[0].__enter__()
    held[0].set_transform("map", "base", 40, (4, 4, 4), TURN)
    in_another_thread(held.clear)
    assert buffer.counters().aborts == 1
    with buffer.transaction() as tx:
        tx.set_transform("map", "base", 41, (4, 4, 4), TURN)
    assert buffer.frame_info("base").newest == 41


def test_a_transaction_of_an_ended_thread() -> None:
    buffer = chain()
    held: list[Any] = []

    def begin() -> None:
        tx = buffer.transaction()
        tx.__enter__()
        tx.set_transform("map", "base", 40, (4, 4, 4), TURN)
        held.append(tx)

    in_another_thread(begin)
    held.clear()
    assert buffer.counters().aborts == 1
    assert buffer.commit == 4


def test_a_generator_that_is_dropped_aborts() -> None:
    buffer = chain()

    def steps() -> Any:
        with buffer.transaction() as tx:
            tx.set_transform("map", "base", 40, (4, 4, 4), TURN)
            yield tx

    generator = steps()
    next(generator)
    generator.close()
    assert buffer.commit == 4
    assert buffer.set_transform("map", "base", 41, (4, 4, 4), TURN) == 5


def test_a_transaction_keeps_its_buffer() -> None:
    with chain().transaction() as tx:
        gc.collect()
        found = tx.lookup_transform("map", "camera")
    assert found.report.edges[0].child == "camera"


def test_buffers_clock_and_transaction_are_collected() -> None:
    class Clock:
        tx: Any = None

        def __call__(self) -> int:
            return 7

    clock = Clock()
    buffer = tfdb.Buffer(clock=clock)
    clock.tx = buffer.transaction()
    gone = []
    import weakref

    weakref.finalize(clock, gone.append, True)
    del clock, buffer
    gc.collect()
    assert gone == [True]


@pytest.mark.parametrize(
    "name",
    ["set_transform", "set_static_transform", "set_transforms", "remove_frames", "reparent"],
)
def test_a_write_documents_the_arguments_of_buffer_that_it_lacks(name: str) -> None:
    of_buffer, of_transaction = getattr(tfdb.Buffer, name), getattr(tfdb.Transaction, name)
    has = inspect.signature(of_transaction).parameters
    for missing in inspect.signature(of_buffer).parameters.keys() - has.keys():
        assert f"`{missing}`" in of_transaction.__doc__

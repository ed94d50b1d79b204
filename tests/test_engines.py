"""The same store under each concurrency control: one set of answers, each engine's own manners."""

from __future__ import annotations

import subprocess
import sys
import typing

import numpy as np
import pytest

import tfdb
import tfdb.types
from elsewhere import Call, elsewhere
from oracle import interpolate, matrix, quaternion
from refusal import refused

ENGINES: tuple[str, ...] = typing.get_args(tfdb.types.Concurrency)
ISOLATING = [engine for engine in ENGINES if engine != "fine"]
LOCKING = [engine for engine in ENGINES if engine != "snapshot"]

TURN = quaternion((1, -2, 0.5), 0.9)
BACK = quaternion((0, 1, 3), -1.4)
A = (1.0, 2.0, 3.0, *TURN)
B = (-1.0, 0.5, 2.5, *BACK)
CAMERA = (0.2, -0.1, 1.1, *quaternion((0, 0, 1), 0.6))


@pytest.fixture(params=ENGINES)
def buffer(request: pytest.FixtureRequest) -> tfdb.Buffer:
    """T[map<-base] at 100 and 200, and a static camera on the base."""
    made = tfdb.Buffer(history=None, concurrency=request.param)
    made.set_transform("map", "base", 100, A[:3], A[3:])
    made.set_transform("map", "base", 200, B[:3], B[3:])
    made.set_static_transform("base", "camera", CAMERA[:3], CAMERA[3:], authority="urdf")
    return made


def expected(stamp: float) -> np.ndarray:
    """T[map<-camera]."""
    return matrix(interpolate(A, B, (stamp - 100) / 100)) @ matrix(CAMERA)


def test_the_engines_are_those_of_the_types() -> None:
    for engine in ENGINES:
        assert tfdb.Buffer(concurrency=engine).concurrency == engine
    assert tfdb.Buffer().concurrency == "snapshot"
    assert "silo" in repr(tfdb.Buffer(concurrency="silo"))


# -- one set of answers ----------------------------------------------------------------------------


@pytest.mark.parametrize("stamp", [100, 130, 200])
def test_lookups_both_ways(buffer: tfdb.Buffer, stamp: int) -> None:
    there = buffer.lookup_transform("map", "camera", stamp)
    assert there.matrix == pytest.approx(expected(stamp), abs=1e-12)
    assert there.commit == 3
    back = buffer.lookup_transform("camera", "map", stamp)
    assert back.matrix == pytest.approx(np.linalg.inv(expected(stamp)), abs=1e-12)
    assert [edge.child for edge in back.report.edges] == ["camera", "base"]
    assert buffer.can_transform("map", "camera", stamp)
    assert buffer.lookup_latest_transform("map", "camera").stamp == 200
    assert buffer.latest_common_time("camera", "map") == 200


def test_batches_of_reads(buffer: tfdb.Buffer) -> None:
    stamps = np.array([200, 100, 150, 100])
    rows = buffer.lookup_transforms("map", "camera", stamps, layout="matrix")
    assert rows == pytest.approx(np.stack([expected(stamp) for stamp in stamps]), abs=1e-12)
    points = np.array([[1.0, 2, 3], [0, 0, 0], [-1, 4, 0.5], [2, 2, 2]])
    moved = buffer.transform_points("map", "camera", points, stamps)
    homogeneous = np.concatenate([points, np.ones((4, 1))], axis=1)
    wanted = np.stack([expected(s) @ p for s, p in zip(stamps, homogeneous, strict=True)])
    assert moved == pytest.approx(wanted[:, :3], abs=1e-12)
    many = np.full(20_000, 150)
    assert buffer.lookup_transforms("map", "camera", many)[-1] == pytest.approx(
        buffer.lookup_transform("map", "camera", 150).pose, abs=1e-12
    )


def test_all_other_reads(buffer: tfdb.Buffer) -> None:
    assert buffer.frames() == ["base", "camera", "map"]
    assert buffer.frame_exists("camera")
    assert not buffer.frame_exists("cup")
    assert buffer.frame_info("camera").authority == "urdf"
    assert {info.name: info.parent for info in buffer.tree()}["camera"] == "base"
    assert buffer.samples("base")[0].tolist() == [100, 200]
    assert buffer.trajectory("map", "base").stamps.tolist() == [100, 200]
    assert buffer.explain("map", "cup").error is not None
    assert buffer.can_transform_full("map", 200, "map", 100, "map")
    full = buffer.lookup_transform_full("base", 200, "base", 100, "map")
    assert full.matrix == pytest.approx(np.linalg.inv(matrix(B)) @ matrix(A), abs=1e-12)
    twist = buffer.lookup_velocity("base", "map", 150, 100e-9)
    assert twist.linear == pytest.approx((np.array(B[:3]) - A[:3]) / 100e-9)
    assert buffer.memory().frames == 3
    assert buffer.counters().commits == buffer.commit == 3


def test_lookups_that_have_no_answer(buffer: tfdb.Buffer) -> None:
    with pytest.raises(tfdb.Extrapolation) as late:
        buffer.lookup_transform("map", "camera", 201)
    assert (late.value.edge, late.value.newest, late.value.reason) == ("base", 200, "future")
    with pytest.raises(tfdb.UnknownFrame) as unknown:
        buffer.lookup_transform("cup", "camera")
    assert unknown.value.frame == "cup"
    buffer.set_static_transform("other", "thing", (1, 2, 3), TURN)
    with pytest.raises(tfdb.Disconnected) as apart:
        buffer.lookup_transform("thing", "camera")
    assert set(apart.value.frames or ()) == {"map", "other"}
    with pytest.raises(tfdb.GapTooLarge):
        buffer.lookup_transform("map", "base", 150, tfdb.Interpolate(1e-9))
    assert not buffer.can_transform("map", "camera", 99)


def test_batches_of_writes(buffer: tfdb.Buffer) -> None:
    """Unsorted, with one frame twice, new ones among them, and one parent after its child."""
    batch = [
        tfdb.TransformStamped("hand", "tip", 300, (0, 0, 1), TURN),
        tfdb.TransformStamped("map", "base", 400, A[:3], A[3:]),
        tfdb.TransformStamped("camera", "hand", 300, (0, 1, 0), BACK),
        tfdb.TransformStamped("map", "base", 300, (7, 7, 7), TURN),
        tfdb.TransformStamped("map", "base", 300, B[:3], B[3:]),
    ]
    assert buffer.set_transforms(batch, authority="joints") == 4
    found = buffer.lookup_transform("map", "tip", 300)
    wanted = matrix(B) @ matrix(CAMERA) @ matrix([0, 1, 0, *BACK]) @ matrix([0, 0, 1, *TURN])
    assert found.matrix == pytest.approx(wanted, abs=1e-12)
    assert buffer.samples("base")[0].tolist() == [100, 200, 300, 400]
    with refused(buffer, tfdb.InvalidTransform) as caught:
        buffer.set_transforms(
            [batch[1], tfdb.TransformStamped("map", "base", 500, (float("nan"), 0, 0), TURN)]
        )
    assert caught.value.index == 1


def test_plain_writes_of_what_there_is(buffer: tfdb.Buffer) -> None:
    """What engines do beside each other: existing edges, newest stamps."""
    for stamp in range(300, 400):
        buffer.set_transform("map", "base", stamp, (stamp, 2, 3), TURN, authority="odometry")
    buffer.set_static_transform("base", "camera", (5, 5, 5), BACK)
    assert buffer.lookup_transform("base", "map", 350).inverse().translation[0] == pytest.approx(
        350
    )
    assert buffer.lookup_transform("base", "camera").translation.tolist() == [5, 5, 5]
    assert buffer.frame_info("base").authority == "odometry"
    assert buffer.counters().commits == buffer.commit == 104


def test_late_samples_and_new_parents(buffer: tfdb.Buffer) -> None:
    buffer.set_transform("map", "base", 150, (9, 9, 9), TURN)
    assert buffer.lookup_transform("map", "base", 150).translation.tolist() == [9, 9, 9]
    buffer.set_transform("map", "lift", 0, (0, 0, 5), BACK)
    buffer.set_transform("lift", "base", 300, (0, 1, 0), TURN)
    assert buffer.samples("base")[2] == ["map", "map", "map", "lift"]
    assert buffer.frame_info("base").parent == "lift"
    with refused(buffer, tfdb.CycleError):
        buffer.set_transform("camera", "lift", 400, (1, 2, 3), TURN)


def test_removal(buffer: tfdb.Buffer) -> None:
    buffer.set_transforms(
        [tfdb.TransformStamped("camera", f"lens_{i}", 0, (i, 2, 3), TURN) for i in range(5)]
    )
    with refused(buffer, tfdb.FrameInUse) as caught:
        buffer.remove_frame("camera")
    assert len(caught.value.frames or ()) == 5
    commit = buffer.commit
    assert buffer.remove_frames([f"lens_{i}" for i in (3, 1, 4)]) == commit + 1
    assert buffer.remove_frame("camera", recursive=True) == commit + 2
    assert buffer.frames() == ["base", "map"]
    assert not buffer.can_transform("base", "camera")
    buffer.set_transform("map", "camera", 10, (4, 4, 4), TURN)
    assert buffer.lookup_transform("map", "camera").translation.tolist() == [4, 4, 4]
    buffer.clear()
    assert buffer.samples("base")[0].tolist() == []


def test_messages_come_in(buffer: tfdb.Buffer) -> None:
    data = tfdb.encode_tf_message([tfdb.TransformStamped("map", "base", 300, A[:3], A[3:])])
    buffer.ingest(data)
    assert buffer.ingest_many([data] * 3, encoding="cdr").commits == 3
    assert buffer.frame_info("base").newest == 300


def test_a_snapshot_stays_what_it_was(buffer: tfdb.Buffer) -> None:
    with buffer.snapshot() as snapshot:
        before = snapshot.lookup_transform("map", "camera", 130)
        buffer.set_transform("map", "base", 120, (9, 9, 9), TURN)
        for stamp in range(300, 400):
            buffer.set_transform("map", "base", stamp, (9, 9, 9), TURN)
        buffer.set_static_transform("base", "camera", (5, 5, 5), BACK)
        buffer.remove_frame("camera")
        assert snapshot.lookup_transform("map", "camera", 130) == before
        assert snapshot.lookup_transform("map", "camera").stamp == 200
        assert snapshot.lookup_transforms("map", "camera", [130])[0] == pytest.approx(before.pose)
        assert snapshot.frames() == ["base", "camera", "map"]
        assert snapshot.frame_info("base").samples == 2
    assert not buffer.frame_exists("camera")


# -- transactions ----------------------------------------------------------------------------------


def test_a_transaction_is_committed(buffer: tfdb.Buffer) -> None:
    with buffer.transaction() as tx:
        found = tx.lookup_transform("camera", "map", 130)
        assert found.matrix == pytest.approx(np.linalg.inv(expected(130)), abs=1e-12)
        assert tx.lookup_transforms("map", "camera", [130], layout="matrix")[0] == pytest.approx(
            expected(130), abs=1e-12
        )
        tx.set_transform("map", "base", 300, A[:3], A[3:])
        assert tx.lookup_latest_transform("map", "base").stamp == 300
        assert not tx.can_transform("map", "camera", 301)
    assert tx.commit_number == buffer.commit == 4
    assert buffer.lookup_transform("map", "base", 300).pose == pytest.approx(A)


def test_a_transaction_with_new_frames_and_removals(buffer: tfdb.Buffer) -> None:
    with buffer.transaction() as tx:
        tx.set_transform("camera", "cup", 150, (0, 0, 1), TURN)
        found = tx.lookup_transform("map", "cup", 150)
        assert found.matrix == pytest.approx(expected(150) @ matrix([0, 0, 1, *TURN]), abs=1e-12)
        tx.reparent("cup", "base", 150)
        tx.remove_frame("camera")
        assert not tx.frame_exists("camera")
    assert buffer.frames() == ["base", "cup", "map"]
    assert buffer.frame_info("cup").parent == "base"
    again = buffer.lookup_transform("map", "cup", 150)
    assert again.matrix == pytest.approx(found.matrix, abs=1e-12)


def test_a_transaction_is_aborted(buffer: tfdb.Buffer) -> None:
    def fail() -> None:
        with buffer.transaction() as tx:
            tx.lookup_transform("map", "camera", 130)
            tx.set_transform("map", "base", 300, A[:3], A[3:])
            tx.set_transform("base", "new", 300, A[:3], A[3:])
            raise LookupError

    with refused_by(buffer):
        fail()
    assert buffer.counters().aborts == 1
    assert buffer.run(lambda tx: tx.frame_exists("new")) is False


def refused_by(buffer: tfdb.Buffer) -> typing.Any:
    """The store is as it was, and works."""
    return refused(buffer, LookupError)  # type: ignore[arg-type]


def test_a_commit_that_would_close_a_cycle(buffer: tfdb.Buffer) -> None:
    def close() -> None:
        with buffer.transaction() as tx:
            tx.set_transform("map", "lift", 100, (1, 2, 3), TURN)
            tx.set_transform("camera", "map", 150, (1, 2, 3), TURN)

    with refused(buffer, tfdb.CycleError) as caught:
        close()
    assert {"map", "camera"} <= set(caught.value.frames or ())


def test_run_counts_to_the_same_sum_in_every_engine(buffer: tfdb.Buffer) -> None:
    """Three threads add one fifty times each: nothing is lost where transactions are isolated."""
    buffer.set_static_transform("map", "counter", (0, 1, 2), TURN)

    def add(tx: tfdb.Transaction) -> None:
        x = tx.lookup_transform("map", "counter").translation[0]
        tx.set_static_transform("map", "counter", (x + 1, 1, 2), TURN)

    def many() -> None:
        for _ in range(50):
            buffer.run(add)

    calls = [Call(many) for _ in range(3)]
    for call in calls:
        call.result()
    total = buffer.lookup_transform("counter", "map").inverse().translation[0]
    if buffer.concurrency in ISOLATING:
        assert total == pytest.approx(150)
    else:
        assert 50 <= total <= 150.001


@pytest.mark.parametrize("engine", LOCKING)
def test_the_thread_of_a_transaction_reads_through_it(engine: str) -> None:
    """The store would wait for itself."""
    buffer = tfdb.Buffer(concurrency=engine)
    buffer.set_transform("map", "base", 100, A[:3], A[3:])
    reads = [
        lambda: buffer.lookup_transform("map", "base"),
        lambda: buffer.can_transform("map", "base"),
        lambda: buffer.lookup_latest_transform("map", "base"),
        lambda: buffer.lookup_transforms("map", "base", [100]),
        buffer.frames,
        buffer.snapshot,
        buffer.tree,
    ]
    with buffer.transaction() as tx:
        for read in reads:
            with pytest.raises(tfdb.TransactionActive):
                read()
        assert tx.can_transform("map", "base")
    for read in reads:
        read()


# -- waiting without the GIL -----------------------------------------------------------------------

WAITING = """
import sys, threading
import tfdb

engine, kind = sys.argv[1:]
buffer = tfdb.Buffer(history=None, concurrency=engine)
buffer.set_transform("map", "base", 1, (1, 2, 3), (0, 0, 0, 1))
buffer.set_static_transform("base", "camera", (1, 2, 3))
begun = threading.Event()

def other():
    begun.set()
    if kind == "lookup":
        buffer.lookup_transform("map", "camera")
        buffer.can_transform("camera", "map")
        buffer.lookup_latest_transform("map", "camera")
    elif kind == "batch":
        buffer.lookup_transforms("map", "camera", [1])
        buffer.transform_points("map", "camera", [[1.0, 2, 3]], 1)
        buffer.tree(), buffer.frames(), buffer.samples("base"), buffer.frame_info("base")
        buffer.latest_common_time("map", "camera"), buffer.trajectory("map", "camera")
        buffer.memory(), buffer.counters(), buffer.frame_exists("base"), buffer.commit
        buffer.lookup_velocity("base", "map") if False else None
    elif kind == "write":
        buffer.set_transform("map", "base", 3, (1, 2, 3), (0, 0, 0, 1))
        buffer.set_transform("map", "new", 3, (1, 2, 3), (0, 0, 0, 1))
        buffer.set_transforms([tfdb.TransformStamped("map", "base", 4, (1, 2, 3))], partial=True)
        buffer.remove_frame("new")
    elif kind == "snapshot":
        with buffer.snapshot() as snapshot:
            snapshot.lookup_transform("map", "camera"), snapshot.tree()
    else:
        buffer.run(lambda tx: tx.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0, 1)))

threads = [threading.Thread(target=other) for _ in range(3)]
held = buffer._attempt(0, True, 0) if kind.endswith("alone") else buffer.transaction()
kind = kind.removesuffix("-alone")
with held as tx:
    tx.lookup_transform("map", "camera")
    tx.set_transform("map", "base", 2, (1, 2, 3), (0, 0, 0, 1))
    for thread in threads:
        thread.start()
    begun.wait()
    for i in range(200_000):  # many chances for the others to take the GIL and to keep it
        pass
    tx.set_static_transform("base", "camera", (4, 5, 6))
for thread in threads:
    thread.join()
print(buffer.lookup_transform("base", "camera").translation.tolist())
"""


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    "kind",
    [
        *("lookup", "batch", "write", "snapshot", "transaction"),
        *("lookup-alone", "batch-alone", "write-alone", "snapshot-alone", "transaction-alone"),
    ],
)
def test_who_waits_for_a_transaction_lets_it_go_on(engine: str, kind: str) -> None:
    """Else its thread, which needs the GIL to end it, would wait for those that wait for it."""
    done = subprocess.run(
        [sys.executable, "-c", WAITING, engine, kind],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    if engine == "fine" or "Conflict" not in done.stderr:
        assert done.returncode == 0, done.stderr
        assert done.stdout.strip() == "[4.0, 5.0, 6.0]"


@pytest.mark.parametrize("engine", ENGINES)
def test_nothing_is_torn_between_threads(engine: str) -> None:
    """A pair of edges written as one batch cancels out in whatever a reader sees."""
    buffer = tfdb.Buffer(history=None, concurrency=engine)

    def pair(value: float) -> list[tfdb.TransformStamped]:
        return [
            tfdb.TransformStamped("a", "b", 0, (value, 1, 2), (0, 0, 1, 0)),
            tfdb.TransformStamped("b", "c", 0, (value, 3, 4), TURN),
        ]

    buffer.set_transforms(pair(0), static=True)

    def write() -> None:
        for i in range(1, 1500):
            buffer.set_transforms(pair(i), static=True)

    calls = [Call(write), Call(write)]
    seen = [buffer.lookup_transform("a", "c").translation for _ in range(1500)]
    back = [buffer.lookup_transform("c", "a").inverse().translation for _ in range(500)]
    for call in calls:
        call.result()
    if engine in ISOLATING:
        assert np.array(seen) == pytest.approx(np.tile([0, -2, 6], (1500, 1)), abs=1e-9)
        assert np.array(back) == pytest.approx(np.tile([0, -2, 6], (500, 1)), abs=1e-9)
    assert elsewhere(lambda: buffer.commit) > 1500

"""The same store under each concurrency control: equal results, and each engine's properties."""

from __future__ import annotations

import itertools
import subprocess
import sys
import typing

import numpy as np
import pytest

import tfdb
import tfdb.types
from oracle import matrix, quaternion

ENGINES: tuple[str, ...] = typing.get_args(tfdb.types.Concurrency)

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


def test_the_engines_are_those_of_the_types() -> None:
    for engine in ENGINES:
        assert tfdb.Buffer(concurrency=engine).concurrency == engine
    assert tfdb.Buffer().concurrency == "snapshot"
    assert "silo" in repr(tfdb.Buffer(concurrency="silo"))


# -- one set of answers ----------------------------------------------------------------------------


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
    twist = buffer.lookup_velocity("map", "base", 150, 100e-9)
    assert twist.linear == pytest.approx((np.array(B[:3]) - A[:3]) / 100e-9)
    assert buffer.memory().frames == 3
    assert buffer.counters().commits == buffer.commit == 3


def test_messages_come_in(buffer: tfdb.Buffer) -> None:
    data = tfdb.encode_tf_message([tfdb.TransformStamped("map", "base", 300, A[:3], A[3:])])
    buffer.ingest(data)
    assert buffer.ingest_many([data] * 3, encoding="cdr").commits == 3
    assert buffer.frame_info("base").newest == 300


# -- one commit ------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ENGINES)
def test_a_stamp_that_comes_twice_in_a_commit_is_one_sample(engine: str) -> None:
    """Stored alike, late alike, directly and in a transaction; the last one wins."""
    direct = tfdb.Buffer(history=None, concurrency=engine)
    other = tfdb.Buffer(history=None, concurrency=engine)
    rng = np.random.default_rng(5)
    late = 0
    seen: set[int] = set()
    for number in range(60):
        first = int(rng.integers(0, 200))
        stamps = [first + int(step) for step in rng.integers(0, 12, rng.integers(1, 40))]
        if number % 3 == 0:
            stamps.sort()
        batch = [
            tfdb.TransformStamped(
                f"m{stamp % 3}", "base", stamp, (number, i, 1), (0, 0.6 * 1.001, 0, 0.8)
            )
            for i, stamp in enumerate(stamps)
        ]
        direct.set_transforms(batch, authority="me")
        with other.transaction() as tx:
            tx.set_transforms(batch, authority="me")
            inside = tx.frame_info("base")
        late += sum(stamp < max(seen) for stamp in set(stamps)) if seen else 0
        seen |= set(stamps)
        info = direct.frame_info("base")
        assert info == other.frame_info("base") == inside, number
        assert (info.late, info.samples) == (late, len(seen)), number
        for have, want in zip(direct.samples("base"), other.samples("base"), strict=True):
            assert np.array_equal(have, want)
        last = {stamp: i for i, stamp in enumerate(stamps)}
        kept = dict(zip(*direct.samples("base")[:2], strict=True))
        assert all(tuple(kept[stamp][:2]) == (number, i) for stamp, i in last.items())
    assert direct.counters().normalised == other.counters().normalised > 0
    assert late > 300


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("is_new", [True, False])
def test_the_last_write_gives_an_edge_its_authority(engine: str, is_new: bool) -> None:
    """Also where an earlier write of the transaction has a newer stamp."""
    direct = tfdb.Buffer(history=None, concurrency=engine)
    other = tfdb.Buffer(history=None, concurrency=engine)
    for buffer in (direct, other):
        if not is_new:
            buffer.set_transform("map", "base", 15, A[:3], A[3:], authority="before")
        buffer.set_static_transform("base", "lidar", B[:3], B[3:], authority="before")
    with other.transaction() as tx:
        for writes in (direct, tx):
            writes.set_transform("map", "base", 20, A[:3], A[3:], authority="newest")
            writes.set_transform("map", "base", 10, B[:3], B[3:], authority="last")
            writes.set_static_transform("base", "lidar", A[:3], A[3:], authority="first")
            writes.set_static_transform("base", "lidar", B[:3], B[3:], authority="second")
        inside = [frame.authority for frame in tx.tree()]
        assert tx.frame_info("base").authority == "last"
    assert [frame.authority for frame in other.tree()] == inside
    assert [frame.authority for frame in direct.tree()] == inside == ["last", "second", ""]


# -- waiting without the GIL -----------------------------------------------------------------------

WAITING = """
import sys, threading
import tfdb

engine, *kinds = sys.argv[1:]

def go_on(buffer, kind):
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
    elif kind == "write":
        buffer.set_transform("map", "base", 3, (1, 2, 3), (0, 0, 0, 1))
        own = threading.current_thread().name
        buffer.set_transform("map", own, 3, (1, 2, 3), (0, 0, 0, 1))
        buffer.set_transforms([tfdb.TransformStamped("map", "base", 4, (1, 2, 3))], partial=True)
        buffer.remove_frames([own])
    elif kind == "snapshot":
        with buffer.snapshot() as snapshot:
            snapshot.lookup_transform("map", "camera"), snapshot.tree()
    else:
        buffer.run(lambda tx: tx.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0, 1)))

def meet(kind, alone):
    buffer = tfdb.Buffer(history=None, concurrency=engine)
    buffer.set_transform("map", "base", 1, (1, 2, 3), (0, 0, 0, 1))
    buffer.set_static_transform("base", "camera", (1, 2, 3))
    begun = threading.Event()

    def other():
        begun.set()
        go_on(buffer, kind)

    threads = [threading.Thread(target=other) for _ in range(3)]
    won = True
    try:
        with buffer._attempt(0, True, 0) if alone else buffer.transaction() as tx:
            tx.lookup_transform("map", "camera")
            tx.set_transform("map", "base", 2, (1, 2, 3), (0, 0, 0, 1))
            for thread in threads:
                thread.start()
            begun.wait()
            for i in range(200_000):  # many chances for the others to take the GIL and to keep it
                pass
            tx.set_static_transform("base", "camera", (4, 5, 6))
    except tfdb.Conflict:
        won = False
    for thread in threads:
        thread.join()
    found = buffer.lookup_transform("base", "camera").translation.tolist()
    print(kind, alone, won, found, flush=True)

for kind in kinds:
    meet(kind, False)
    meet(kind, True)
"""


@pytest.mark.parametrize("engine", ENGINES)
def test_waiting_for_a_transaction_does_not_block_it(engine: str) -> None:
    """Else its thread, which needs the GIL to end it, would wait for those that wait for it."""
    kinds = ("lookup", "batch", "write", "snapshot", "transaction")
    done = subprocess.run(
        [sys.executable, "-c", WAITING, engine, *kinds],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    for kind, alone in itertools.product(kinds, (False, True)):
        ends = [f"{kind} {alone} True [4.0, 5.0, 6.0]"]
        others_write = kind in {"write", "transaction"}
        cannot_lose = alone or engine in {"giant", "fine"}
        if not cannot_lose and (others_write or engine != "snapshot"):
            ends.append(f"{kind} {alone} False [1.0, 2.0, 3.0]")  # it lost to one of the others
        assert lines.pop(0) in ends
    assert not lines

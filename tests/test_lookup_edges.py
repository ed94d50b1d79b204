"""The edges of many frames at one stamp: the single lookups, bit for bit."""

from __future__ import annotations

import threading
import typing
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
import tfdb.types
from oracle import quaternion
from test_batch_equivalence import same_bits

if TYPE_CHECKING:
    from collections.abc import Iterator

ENGINES: tuple[str, ...] = typing.get_args(tfdb.types.Concurrency)
SECOND = 1_000_000_000


def pose(rng: np.random.Generator) -> tuple[list[float], list[float]]:
    turn = quaternion(rng.normal(size=3), float(rng.uniform(0.1, 3)))
    return rng.normal(size=3).tolist(), list(turn)


def forest(concurrency: Any = "snapshot") -> tfdb.Buffer:
    """Moving, static, re-parented, sparse and cleared edges, a removed parent."""
    rng = np.random.default_rng(24)
    buffer = tfdb.Buffer(history=None, concurrency=concurrency)
    buffer.set_transform("map", "gone", 50, *pose(rng))
    buffer.clear()
    for i in range(40):
        child, parent = f"frame{i}", "map" if i % 3 == 0 else f"frame{i - 1}"
        if i % 5 == 4:
            buffer.set_static_transform(parent, child, *pose(rng))
            continue
        for stamp in range(100, 1000, 50 + 10 * i):
            buffer.set_transform(parent, child, stamp, *pose(rng))
        if i % 6 == 3:
            buffer.set_transform("other", child, 700, *pose(rng))
    buffer.set_transform("passing", "orphan", 300, *pose(rng))
    buffer.set_transform("map", "orphan", 400, *pose(rng))
    buffer.remove_frames("passing")
    return buffer


def single(
    reads: tfdb._core.StoreReader | tfdb.Transaction, frame: str, stamp: int | None, policy: Any
) -> list[float]:
    try:
        parent = reads.parent_of(frame, stamp)
        if parent is None:
            return [np.nan] * 7
        return reads.lookup_transform(parent, frame, stamp, policy).pose.tolist()
    except tfdb.TfdbError:
        return [np.nan] * 7


def all_reads(buffer: tfdb.Buffer) -> Iterator[tfdb._core.StoreReader | tfdb.Transaction]:
    yield buffer
    with buffer.snapshot() as snapshot:
        yield snapshot
    with buffer.transaction() as tx:
        yield tx


# -- answers ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    "policy", [None, tfdb.Previous(), tfdb.Exact(), tfdb.Extrapolate(1.0), tfdb.Interpolate(90e-9)]
)
def test_rows_are_the_single_lookups(engine: str, policy: tfdb.types.Policy | None) -> None:
    buffer = forest(engine)
    frames = (*buffer.frames(), "unknown")
    found = 0
    for reads in all_reads(buffer):
        for stamp in (None, 0, 100, 333, 700, 701, 990, 5000):
            rows = reads.lookup_edges(frames, stamp, policy)
            assert rows.shape == (len(frames), 7)
            assert rows.dtype == np.float64
            same_bits(rows, [single(reads, frame, stamp, policy) for frame in frames])
            found += int(np.isfinite(rows).all(axis=1).sum())
            floats = reads.lookup_edges(list(frames), stamp, policy, dtype=np.float32)
            assert floats.dtype == np.float32
            np.testing.assert_array_equal(floats, rows.astype(np.float32))
    assert found > 3 * 8 * 8  # the static edges at least


def test_a_transaction_sees_its_own_edges() -> None:
    buffer = forest()
    with buffer.transaction() as tx:
        tx.set_transform("map", "frame0", 5000, (5, 6, 7))
        tx.set_transform("frame0", "new", 5000, (8, 9, 10))
        tx.remove_frames("frame39")
        rows = tx.lookup_edges(["frame0", "new", "frame39"])
        assert rows[:2, :3].tolist() == [[5, 6, 7], [8, 9, 10]]
        assert np.isnan(rows[2]).all()
        tx.abort()
    assert np.isnan(buffer.lookup_edges(["new"])).all()


def test_the_same_names_follow_frames_that_go_and_come_back() -> None:
    """Handles of a call must not outlive its state."""
    buffer = tfdb.Buffer()
    names = tuple(f"frame{i}" for i in range(50))
    for name in names:
        buffer.set_transform("map", name, SECOND, (1, 0, 0))
    before = buffer.snapshot()
    for _ in range(2):
        assert (buffer.lookup_edges(names)[:, 0] == 1).all()
    buffer.remove_frames(names[::2])
    assert np.isnan(buffer.lookup_edges(names)[::2]).all()
    assert (buffer.lookup_edges(names)[1::2, 0] == 1).all()
    buffer.set_transform("map", "someone", SECOND, (9, 0, 0))  # perhaps in a slot of theirs
    for name in reversed(names[::2]):
        buffer.set_transform("map", name, SECOND, (2, 0, 0))
    assert (buffer.lookup_edges(names)[::2, 0] == 2).all()
    assert (before.lookup_edges(names)[:, 0] == 1).all()
    other = tfdb.Buffer()
    other.set_transform("map", "frame7", SECOND, (3, 0, 0))
    assert np.isfinite(other.lookup_edges(names)).all(axis=1).nonzero()[0].tolist() == [7]


def test_all_rows_are_of_one_state() -> None:
    buffer = tfdb.Buffer(history=1.0)
    names = [f"frame{i}" for i in range(2000)]
    poses = np.zeros((len(names), 7))
    poses[:, 6] = 1

    def store(number: int) -> None:
        poses[:, 0] = number
        stamps = np.full(len(names), number * 20_000_000)
        buffer.set_transforms(tfdb.Columns("map", names, stamps, poses))

    store(1)
    done = threading.Event()

    def write() -> None:
        number = 2
        while not done.is_set():
            store(number)
            number += 1

    writer = threading.Thread(target=write)
    writer.start()
    try:
        seen = {tuple(np.unique(buffer.lookup_edges(names)[:, 0])) for _ in range(200)}
    finally:
        done.set()
        writer.join()
    assert {len(numbers) for numbers in seen} == {1}


def test_no_frames_give_no_rows() -> None:
    for reads in all_reads(forest()):
        assert reads.lookup_edges([]).shape == (0, 7)
        assert reads.lookup_edges((name for name in ()), 5, missing="raise").shape == (0, 7)


# -- out -------------------------------------------------------------------------------------------


def test_out_decides_the_dtype() -> None:
    buffer = forest()
    frames = buffer.frames()
    expected = buffer.lookup_edges(frames, 333)
    for reads in all_reads(buffer):
        for dtype in (np.float64, np.float32):
            out = np.zeros((len(frames), 7), dtype)
            assert reads.lookup_edges(frames, 333, out=out) is out
            np.testing.assert_array_equal(out, expected.astype(dtype))
            assert reads.lookup_edges(frames, 333, out=out, dtype=dtype) is out
    assert buffer.lookup_edges(frames, dtype="float32").dtype == np.float32
    assert buffer.lookup_edges(frames, dtype=float).dtype == np.float64


@pytest.mark.parametrize(
    "out",
    [
        np.zeros((1, 7)),
        np.zeros((2, 6)),
        np.zeros(14),
        np.zeros((2, 7), np.int64),
        np.zeros((7, 2)).T,
        np.zeros((2, 7), ">f8"),
        [[0.0] * 7] * 2,
        b"text",
    ],
)
def test_an_out_that_does_not_fit_is_refused(out: Any) -> None:
    with pytest.raises(tfdb.errors.InvalidArray, match=r"out: expected a writable.*\(2, 7\)"):
        forest().lookup_edges(["frame0", "frame1"], out=out)


def test_out_and_dtype_must_agree() -> None:
    out = np.zeros((1, 7), np.float32)
    with pytest.raises(tfdb.errors.InvalidArray, match=r"array of float64 \(1, 7\), got float32"):
        forest().lookup_edges(["frame0"], out=out, dtype=np.float64)
    out.flags.writeable = False
    with pytest.raises(tfdb.errors.InvalidArray):
        forest().lookup_edges(["frame0"], out=out)


# -- errors ----------------------------------------------------------------------------------------


def test_the_first_frame_without_an_edge_is_named() -> None:
    for reads in all_reads(forest()):
        check_errors(reads)


def check_errors(reads: tfdb._core.StoreReader | tfdb.Transaction) -> None:
    with pytest.raises(tfdb.UnknownFrame, match="frame 'frame_0' does not exist") as unknown:
        reads.lookup_edges(["frame0", "frame_0", "map"], 333, missing="raise")
    assert (unknown.value.index, unknown.value.frame) == (1, "frame_0")
    assert "did you mean 'frame0'" in str(unknown.value)
    with pytest.raises(tfdb.Disconnected, match=r"'map' has no parent at 0\.000000333 s") as root:
        reads.lookup_edges(["frame0", "frame4", "map"], 333, missing="raise")
    assert (root.value.index, root.value.frames, root.value.stamp) == (2, ("map",), 333)
    with pytest.raises(tfdb.Disconnected, match="frame 'gone' has no parent: it is a root"):
        reads.lookup_edges(["gone"], missing="raise")
    with pytest.raises(tfdb.Extrapolation) as future:
        reads.lookup_edges(["frame4", "frame1"], 5000, missing="raise")
    with pytest.raises(tfdb.Extrapolation) as one:
        reads.lookup_transform("frame0", "frame1", 5000)
    assert str(future.value) == str(one.value)
    assert (future.value.index, future.value.edge, future.value.parent) == (1, "frame1", "frame0")
    gap = tfdb.Interpolate(max_gap=1e-9)
    with pytest.raises(tfdb.errors.GapTooLarge) as large:
        reads.lookup_edges(["frame4", "frame1"], 333, gap, missing="raise")
    assert large.value.index == 1


def test_a_pose_that_is_not_finite_is_missing() -> None:
    buffer = tfdb.Buffer(history=None)
    buffer.set_transform("map", "far", 100, (1e308, 0, 0))
    buffer.set_transform("map", "far", 200, (-1e308, 0, 0))
    policy = tfdb.Extrapolate(1.0)
    assert np.isnan(buffer.lookup_edges(["far"], 900, policy)).all()
    with pytest.raises(tfdb.errors.InvalidTransform, match=r"T\[map<-far\].*not finite") as error:
        buffer.lookup_edges(["far"], 900, policy, missing="raise")
    assert error.value.index == 0


@pytest.mark.parametrize(
    ("arguments", "keywords", "kind", "text"),
    [
        (("map",), {}, TypeError, "got a single str"),
        ((5,), {}, TypeError, "frames must be a sequence of frames' names"),
        ((["map", 5],), {}, TypeError, "frames"),
        ((["map", "\ud800"],), {}, tfdb.errors.InvalidName, "UTF-8"),
        ((["map"], -1), {}, tfdb.errors.InvalidStamp, "negative"),
        ((["map"], 1.5), {}, tfdb.errors.InvalidStamp, "float"),
        ((["map"], 1, "exact"), {}, TypeError, "olicy"),
        ((["map"],), {"missing": "skip"}, tfdb.errors.InvalidArgument, "missing"),
        (
            (["map"],),
            {"dtype": np.int64},
            tfdb.errors.InvalidArgument,
            "dtype must be numpy.float64",
        ),
        ((["map"],), {"dtype": "flat32"}, tfdb.errors.InvalidArgument, "got 'flat32'"),
        ((), {}, TypeError, "missing the argument 'frames'"),
    ],
)
def test_wrong_arguments(arguments: Any, keywords: Any, kind: type[Exception], text: str) -> None:
    buffer = forest()
    for reads in all_reads(buffer):
        with pytest.raises(kind, match=text):
            reads.lookup_edges(*arguments, **keywords)

"""The first steps of a user in Python."""

from __future__ import annotations

from datetime import UTC, date, datetime, timedelta, timezone
from decimal import Decimal
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import polars as pl
import pytest

import tfdb
from oracle import quaternion
from tfdb.recordings import RecordingWriter, write_recording

if TYPE_CHECKING:
    from pathlib import Path

TURN = quaternion((1, -2, 0.5), 0.9)
START = tfdb.stamp("1700000000.25")
STEP = 100_000_000


@pytest.fixture
def buffer() -> tfdb.Buffer:
    """An arm that turns on a base that drives, with a second of silence in the middle."""
    made = tfdb.Buffer(history=None)
    made.set_static_transform("arm", "hand", (0.1, -0.2, 0.3), TURN)
    for i in (*range(11), *range(21, 31)):
        made.set_transform("map", "base", START + i * STEP, (0.1 * i, 1, -2), TURN)
        made.set_transform(
            "base", "arm", START + i * STEP, (1, 0.1 * i, 0), quaternion((0, 1, 2), 0.1 * i)
        )
    return made


# -- stamps without an answer ----------------------------------------------------------------------


def test_a_trajectory_may_have_gaps(buffer: tfdb.Buffer) -> None:
    strict = tfdb.Interpolate(max_gap=0.1)
    asked = ("map", "hand", 20.0, START, START + 30 * STEP, strict)
    with pytest.raises(tfdb.errors.GapTooLarge) as caught:
        buffer.trajectory(*asked)
    assert caught.value.index == 21
    whole = buffer.trajectory(*asked, missing="nan")
    some = buffer.trajectory(*asked, missing="skip")
    found = np.isfinite(whole.poses).all(axis=1)
    assert (len(whole), found.sum()) == (61, 40)
    assert np.array_equal(some.stamps, whole.stamps[found])
    assert np.array_equal(some.poses, whole.poses[found])
    with pytest.raises(tfdb.errors.GapTooLarge):
        buffer.trajectory(
            "map", "hand", 20.0, START + 11 * STEP, START + 19 * STEP, strict, missing="skip"
        )
    with pytest.raises(tfdb.InvalidArgument, match="'raise', 'nan' or 'skip'"):
        buffer.trajectory("map", "hand", missing="drop")  # type: ignore[arg-type]


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("place", ["new", "other", "in place"])
def test_points_may_have_no_answer(buffer: tfdb.Buffer, dtype: Any, place: str) -> None:
    """Every other point's stamp lies in the second of silence, which a limit does not bridge."""
    strict = tfdb.Interpolate(max_gap=0.1)
    rng = np.random.default_rng(3)
    points = rng.uniform(-5, 5, (40, 4)).astype(dtype)[:, :3]
    stamps = START + np.where(np.arange(40) % 2 == 0, 5 * STEP, 15 * STEP) + np.arange(40) * 1000
    with pytest.raises(tfdb.errors.GapTooLarge) as caught:
        buffer.transform_points("map", "hand", points, stamps, strict)
    assert caught.value.index == 1
    wanted = buffer.transform_points("map", "hand", points[::2], stamps[::2], strict)
    out = {"new": None, "other": np.empty((40, 3), dtype), "in place": points}[place]
    moved = buffer.transform_points("map", "hand", points, stamps, strict, out=out, missing="nan")
    assert moved.dtype == dtype
    assert out is None or moved is out
    assert np.array_equal(moved[::2], wanted)
    assert np.isnan(moved[1::2]).all()


def test_points_of_one_stamp_may_have_no_answer(buffer: tfdb.Buffer) -> None:
    points = np.array([[1.0, 2, 3], [4, 5, 6]])
    for reads in (buffer, buffer.snapshot()):
        found = reads.transform_points("map", "hand", points, START + 7, missing="nan")
        assert np.array_equal(found, reads.transform_points("map", "hand", points, START + 7))
        assert np.isnan(reads.transform_points("map", "hand", points, 5, missing="nan")).all()
        none = reads.transform_points("map", "hand", points[:0], [], missing="nan")
        assert none.shape == (0, 3)
        with pytest.raises(tfdb.UnknownFrame):
            reads.transform_points("map", "nowhere", points, 5, missing="nan")
        with pytest.raises(tfdb.InvalidArgument, match="'raise' or 'nan'"):
            reads.transform_points("map", "hand", points, 5, missing="skip")  # type: ignore[arg-type]


def test_a_time_that_is_far_off_costs_nothing(buffer: tfdb.Buffer) -> None:
    with pytest.raises(tfdb.Extrapolation) as caught:
        buffer.trajectory("map", "hand", 1e9, start=5)
    assert caught.value.index == 0
    for missing in ("raise", "nan", "skip"):
        with pytest.raises(tfdb.InvalidArgument, match="more than 100,000,000 poses"):
            buffer.trajectory("map", "hand", 1.0, START, 2**61 - 1, missing=missing)  # type: ignore[arg-type]


def test_frames_that_nothing_joins_are_nan_like_any_other_gap(buffer: tfdb.Buffer) -> None:
    buffer.set_transform("moon", "rock", START, (1, 2, 3), (0, 0, 0, 1))
    points, stamps = np.ones((2, 3)), [START + 7, START + 8]

    def check(reads: tfdb._core.StoreReader | tfdb.Transaction) -> None:
        rows = reads.lookup_transforms("moon", "hand", stamps, missing="nan")
        assert np.isnan(rows).all()
        with pytest.raises(tfdb.Disconnected) as caught:
            reads.lookup_transforms("moon", "hand", stamps)
        assert (caught.value.index, caught.value.stamp) == (0, stamps[0])
        with pytest.raises(tfdb.UnknownFrame):
            reads.lookup_transforms("moon", "nowhere", stamps, missing="nan")

    with buffer.transaction() as tx:
        check(tx)
    with buffer.snapshot() as snapshot:
        for store in (buffer, snapshot):
            check(store)
            for when in (stamps, stamps[0]):
                moved = store.transform_points("moon", "hand", points, when, missing="nan")
                assert np.isnan(moved).all()
            path = store.trajectory("moon", "hand", 1e9, *stamps, missing="nan")
            assert np.isnan(path.poses).all()
            assert path.stamps.tolist() == stamps
            with pytest.raises(tfdb.Disconnected):
                store.trajectory("moon", "hand", 1e9, *stamps, missing="skip")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("rate", [1e-300, 5e-324, 1e-9, 0.9])
def test_a_rate_so_low_that_only_the_first_pose_is_left(buffer: tfdb.Buffer, rate: float) -> None:
    path = buffer.trajectory("map", "hand", rate, START, START + 10 * STEP)
    assert path.stamps.tolist() == [START]
    assert np.array_equal(path.poses[0], buffer.lookup_transform("map", "hand", START).pose)
    with pytest.raises(tfdb.Extrapolation) as caught:
        buffer.trajectory("map", "hand", rate, START - 1, START + 10)
    assert (caught.value.index, caught.value.stamp) == (0, START - 1)


# -- numbers out of answers ------------------------------------------------------------------------


def test_a_trajectory_is_an_array_of_poses(buffer: tfdb.Buffer) -> None:
    path = buffer.trajectory("map", "hand")
    assert np.array_equal(np.asarray(path), path.poses)
    assert np.asarray(path) is path.poses
    assert np.array_equal(np.array(path), path.poses)
    assert np.array(path) is not path.poses
    assert np.asarray(path, dtype=np.float32).dtype == np.float32


def test_trajectories_compare(buffer: tfdb.Buffer) -> None:
    path = buffer.trajectory("map", "hand")
    assert path == buffer.trajectory("map", "hand")
    assert path != buffer.trajectory("map", "arm")
    assert path != buffer.trajectory("map", "hand", end=START + 5 * STEP)
    assert path != "a path"
    moved = path.poses.copy()
    moved[3, 0] += 1e-12
    assert path != tfdb.Trajectory("map", "hand", path.stamps, moved)
    holes = buffer.trajectory("map", "hand", 20.0, policy=tfdb.Interpolate(0.1), missing="nan")
    again = buffer.trajectory("map", "hand", 20.0, policy=tfdb.Interpolate(0.1), missing="nan")
    assert holes == again
    with pytest.raises(TypeError, match="unhashable"):
        hash(path)


# -- what does not move ----------------------------------------------------------------------------


def test_static_transforms_hold_at_all_times(buffer: tfdb.Buffer) -> None:
    still = buffer.lookup_transform("arm", "hand")
    assert repr(still).startswith("T[arm<-hand] at all times: ")
    assert str(still.report).startswith("T[arm<-hand] at all times\n")
    assert still.report.timeless
    made = tfdb.Transform("a", "b", (1, 2, 3), TURN)
    assert repr(made @ tfdb.Transform("b", "c", (3, 2, 1), TURN)).startswith("T[a<-c] at all times")
    simulated = tfdb.Buffer()
    simulated.set_transform("map", "base", 0, (1, 2, 3), TURN)
    first = simulated.lookup_transform("map", "base", 0)
    assert repr(first).startswith("T[map<-base] at 0 s: ")
    assert not first.report.timeless


# -- stamps ----------------------------------------------------------------------------------------

NS = 1_700_000_000_123_456_789
MICRO = NS // 1000 * 1000  # as fine as a datetime is
TIME = datetime(2023, 11, 14, 22, 13, 20, 123456, UTC)
THERE = TIME.astimezone(timezone(timedelta(hours=-7, minutes=-30)))
PANDAS = pd.Timestamp(NS, tz="Asia/Tokyo")


def clock() -> tfdb.Buffer:
    """A frame whose x tells the time: nanoseconds since MICRO."""
    made = tfdb.Buffer(history=None)
    for offset in (0, 789, 10**9):
        made.set_transform("map", "hand", MICRO + offset, (offset, 0, 0), TURN)
    return made


@pytest.mark.parametrize(
    ("time", "ns"),
    [
        (TIME, MICRO),
        (THERE, MICRO),
        (PANDAS, NS),
        (PANDAS.tz_convert("UTC").tz_localize(None), NS),
        (PANDAS.as_unit("us"), MICRO),
        (np.datetime64(NS, "ns"), NS),
        (SimpleNamespace(sec=NS // 10**9, nanosec=NS % 10**9), NS),
    ],
    ids=lambda value: type(value).__name__,
)
def test_times_of_all_kinds_are_stamps(time: Any, ns: int) -> None:
    buffer = clock()
    assert buffer.lookup_transform("map", "hand", time).stamp == ns
    assert buffer.lookup_transform("map", "hand", time, tfdb.Exact()).translation[0] == ns - MICRO
    assert buffer.lookup_transforms("map", "hand", [time], tfdb.Exact())[0, 0] == ns - MICRO
    assert tfdb.stamp(time) == ns
    buffer.set_transform("map", "other", time, (1, 2, 3), TURN)
    assert buffer.latest_common_time("map", "other") == ns


@pytest.mark.parametrize("time", [datetime(2023, 11, 14, 22, 13), datetime.max, datetime.min])
def test_a_time_without_a_zone_is_refused_with_the_reason(time: datetime) -> None:
    for call in (
        lambda: clock().lookup_transform("map", "hand", time),
        lambda: clock().lookup_transforms("map", "hand", [time]),
        lambda: tfdb.stamp(time),
        lambda: tfdb.stamp("2023-11-14T22:13:20"),
    ):
        with pytest.raises(tfdb.InvalidStamp, match="no time zone"):
            call()


@pytest.mark.parametrize(
    "time",
    [
        datetime(1969, 12, 31, 23, tzinfo=UTC),
        datetime(2263, 1, 1, tzinfo=UTC),
        date(2023, 11, 14),
        timedelta(seconds=5),
        pd.NaT,
        pd.Timestamp("2500-01-01", tz="UTC"),
        pd.Timedelta(5, "ns"),
        pd.NA,
    ],
    ids=repr,
)
def test_invalid_times_are_refused(time: Any) -> None:
    with pytest.raises(tfdb.InvalidStamp):
        clock().lookup_transform("map", "hand", time)
    with pytest.raises(tfdb.InvalidStamp) as caught:
        clock().lookup_transforms("map", "hand", [NS, time])
    assert caught.value.index == 1
    with pytest.raises(tfdb.InvalidStamp):
        tfdb.stamp(time)


@pytest.mark.parametrize(
    ("text", "ns"),
    [
        ("2023-11-14T22:13:20.123456789Z", NS),
        ("2023-11-14 15:43:20.123456789-06:30", NS),
        ("2023-11-14T22:13:20,1234567894+00:00", NS),
        ("2023-11-14T22:13:20.1234567885Z", NS - 1),  # half to even, as of seconds
        ("2023-11-14T22:13:20Z", NS // 10**9 * 10**9),
        ("1970-01-01T00:00Z", 0),
        ("1970-01-01t00:00:01z", 10**9),
        (" 1700000000.123456789 ", NS),
    ],
)
def test_dates_as_text(text: str, ns: int) -> None:
    assert tfdb.stamp(text) == ns


def test_texts_as_stamps_are_refused() -> None:
    with pytest.raises(tfdb.InvalidStamp, match=r"tfdb\.stamp\(\) converts seconds and text"):
        clock().lookup_transform("map", "hand", "2023-11-14T22:13:20Z")  # type: ignore[arg-type]


COLUMNS = {
    "int64": np.array,
    "uint64": lambda ns: np.array(ns, dtype=np.uint64),
    "datetime64[ns]": lambda ns: np.array(ns).view("datetime64[ns]"),
    "objects": lambda ns: np.array([pd.Timestamp(n, tz="UTC") for n in ns], dtype=object),
    "pandas int": pd.Series,
    "pandas Int64": lambda ns: pd.Series(ns, dtype="Int64"),
    "pandas times": lambda ns: pd.Series(pd.to_datetime(ns)),
    "pandas times of a zone": lambda ns: pd.Series(pd.to_datetime(ns, utc=True)).dt.tz_convert(
        "Asia/Tokyo"
    ),
    "pandas index": lambda ns: pd.DatetimeIndex(pd.to_datetime(ns, utc=True)),
    "pandas column by other labels": lambda ns: pd.Series(ns, index=range(7, 7 + len(ns))),
    "polars int": pl.Series,
    "polars times": lambda ns: pl.Series(np.array(ns).view("datetime64[ns]")),
    "polars times of a zone": lambda ns: pl.Series(
        np.array(ns).view("datetime64[ns]")
    ).dt.replace_time_zone("UTC").dt.convert_time_zone("Asia/Tokyo"),
    "generator": lambda ns: (n for n in ns),
}  # fmt: skip


@pytest.mark.parametrize("column", COLUMNS)
def test_columns_of_tables_are_stamps(column: str) -> None:
    make: Any = COLUMNS[column]
    buffer = clock()
    wanted = [MICRO + 10**9, NS, MICRO]
    rows = buffer.lookup_transforms("map", "hand", make(wanted), tfdb.Exact())
    assert rows[:, 0].tolist() == [10**9, 789, 0]
    points = buffer.transform_points("map", "hand", np.zeros((3, 3)), make(wanted), tfdb.Exact())
    assert points[:, 0].tolist() == [10**9, 789, 0]
    buffer.set_transforms(tfdb.Columns("map", "other", make(wanted), rows))
    assert buffer.samples("other")[0].tolist() == sorted(wanted)
    assert buffer.lookup_transforms("map", "hand", make([])).shape == (0, 7)


@pytest.mark.parametrize(
    ("column", "error", "words"),
    [
        (np.array([5, 6.5]), tfdb.errors.InvalidArray, "tfdb.stamp() converts seconds"),
        (pd.Series([5, 6.5]), tfdb.errors.InvalidArray, "tfdb.stamp() converts seconds"),
        (pl.Series([5, None]), tfdb.errors.InvalidArray, "tfdb.stamp() converts seconds"),
        (pd.Series(["5", "6"], dtype=object), tfdb.InvalidStamp, "tfdb.stamp() converts seconds"),
        (np.array(["5", "6"]), tfdb.errors.InvalidArray, "tfdb.stamp() converts seconds"),
        (np.array([[5, 6]]), tfdb.errors.InvalidArray, "the shape (1, 2)"),
        (np.array(5), tfdb.errors.InvalidArray, "a single one"),
        (np.int64(5), tfdb.errors.InvalidArray, "a single one"),
        (pd.DataFrame({"t": [5, 6]}), tfdb.errors.InvalidArray, "the shape (2, 1)"),
        (pd.Series([NS, None], dtype="Int64"), tfdb.InvalidStamp, "NA"),
        (np.array([NS, -5]), tfdb.InvalidStamp, "negative"),
        (np.array([5, 2**63 + 5], dtype=np.uint64), tfdb.InvalidStamp, "too large"),
        (np.array(["2023-01-01", "NaT"], dtype="M8[s]"), tfdb.InvalidStamp, "NaT"),
        (np.array(["2023-01-01", "2500-01-01"], dtype="M8[s]"), tfdb.InvalidStamp, "2500"),
        (
            pd.Series(pd.to_datetime(["2023-01-01T00:00Z", "2500-01-01T00:00Z"]).as_unit("s")),
            tfdb.InvalidStamp,
            "2500",
        ),
    ],
    ids=str,
)
def test_columns_that_are_no_stamps(column: Any, error: type[tfdb.TfdbError], words: str) -> None:
    with pytest.raises(error) as caught:
        clock().lookup_transforms("map", "hand", column)
    said = str(caught.value)
    assert words in said
    assert "expected int64" not in said
    if error is tfdb.InvalidStamp and "converts seconds" not in words:
        assert caught.value.index == 1


def test_seconds_in_arrays_become_stamps() -> None:
    seconds = ["0.1", "1700000000.123456789", "7"]
    wanted = [tfdb.stamp(text) for text in seconds]
    for many in (
        seconds,
        tuple(map(Decimal, seconds)),
        np.array(seconds),
        pd.Series(seconds),
        pl.Series(seconds),
    ):
        made = tfdb.stamp(many)
        assert (made.dtype, made.tolist()) == (np.int64, wanted)
    rng = np.random.default_rng(7)
    for floats in (rng.uniform(0, 2e9, 200), rng.uniform(0, 1, 50).astype(np.float32)):
        assert tfdb.stamp(floats).tolist() == [tfdb.stamp(value) for value in floats]
        assert tfdb.stamp(pd.Series(floats)).tolist() == tfdb.stamp(floats).tolist()
    grid = np.arange(6).reshape(2, 3)
    assert np.array_equal(tfdb.stamp(grid), grid * 10**9)
    assert tfdb.stamp(np.array([PANDAS.to_datetime64()])).tolist() == [NS]
    assert tfdb.stamp(pd.Series([PANDAS])).tolist() == [NS]
    assert tfdb.stamp([]).shape == (0,)
    for bad in ([1, -1], np.array([1, np.nan]), ["1", "soon"], [1, True], [1, [2]]):
        with pytest.raises(tfdb.InvalidStamp) as caught:
            tfdb.stamp(bad)
        assert caught.value.index == 1


# -- transforms as numbers -------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["translation", "rotation", "pose", "matrix"])
def test_a_write_to_a_copy_is_not_lost_in_silence(buffer: tfdb.Buffer, name: str) -> None:
    for found in (
        buffer.lookup_transform("map", "hand", START),
        tfdb.Transform("a", "b", (1, 2, 3), TURN),
    ):
        array = getattr(found, name)
        with pytest.raises(ValueError, match="read-only"):
            array[..., 0] = 5
        mine = array.copy()
        mine[..., 0] = 5
        assert not np.array_equal(mine, getattr(found, name))
    assert found.apply([1.0, 2.0, 3.0]).flags.writeable


def test_a_transform_is_an_array(buffer: tfdb.Buffer) -> None:
    found = buffer.lookup_transform("map", "hand", START + 7)
    rows = buffer.lookup_transforms("map", "hand", [START + 7, START + 8])
    assert np.array_equal(np.asarray(found), found.pose)
    assert np.asarray(found) == pytest.approx(rows[0], abs=1e-12)
    later = buffer.lookup_transform("map", "hand", START + 8)
    assert np.stack([found, later]) == pytest.approx(rows, abs=1e-12)
    assert np.asarray(found, dtype=np.float32).dtype == np.float32
    assert np.array(found).flags.writeable
    assert np.allclose(found, found.inverse().inverse())


def test_equal_transforms_have_one_hash(buffer: tfdb.Buffer) -> None:
    found = [buffer.lookup_transform("map", "hand", START + i % 3) for i in range(6)]
    assert len(set(found)) == 3
    assert hash(found[0]) == hash(found[3])
    zero = tfdb.Transform("a", "b", (0.0, 1, 2))
    assert zero == tfdb.Transform("a", "b", (-0.0, 1, 2))
    assert hash(zero) == hash(tfdb.Transform("a", "b", (-0.0, 1, 2)))
    assert len({zero, zero.inverse(), tfdb.Transform("a", "b", (0, 1, 2), stamp=5)}) == 3


@pytest.mark.parametrize(
    "points", [np.eye(4), np.zeros((5, 3)), np.float64(2), [1, 2, 3], (1, 2, 3), pd.Series([1, 2])]
)
def test_points_are_mapped_by_apply(points: Any) -> None:
    made = tfdb.Transform("a", "b", (1, 2, 3), TURN)
    with pytest.raises(TypeError, match=r"T\.apply\(points\) maps points"):
        made @ points
    if not isinstance(points, pd.Series):  # pandas looks at the shapes first
        with pytest.raises(TypeError, match=r"T\.apply\(points\) maps points"):
            points @ made
    with pytest.raises(TypeError, match="unsupported operand"):
        made @ "b"


def test_transforms_multiply() -> None:
    class Friend:
        def __rmatmul__(self, other: object) -> str:
            return "mine"

    assert tfdb.Transform("a", "b", (1, 2, 3), TURN) @ Friend() == "mine"


# -- stamps that are hardly meant ------------------------------------------------------------------


def test_seconds_in_place_of_nanoseconds_are_named_in_the_error(buffer: tfdb.Buffer) -> None:
    looks = f"{START // 10**9} looks like seconds"
    for call in (
        lambda: buffer.lookup_transform("map", "hand", START // 10**9),
        lambda: buffer.lookup_transforms("map", "hand", [START // 10**9]),
        lambda: buffer.trajectory("map", "hand", 10.0, START // 10**9),
    ):
        with pytest.raises(tfdb.Extrapolation) as caught:
            call()
        assert looks in str(caught.value)
    assert looks in str(buffer.explain("map", "hand", START // 10**9))
    short = tfdb.Buffer(history=10)
    short.set_transform("map", "base", START, (1, 2, 3), TURN)
    with pytest.raises(tfdb.errors.TooOld, match=looks) as old:
        short.set_transform("map", "base", START // 10**9, (1, 2, 3), TURN)
    assert old.value.edge == "base"
    with pytest.raises(tfdb.Extrapolation) as caught:
        buffer.lookup_transform("map", "hand", START - 5)
    assert "looks like" not in str(caught.value)


@pytest.mark.parametrize(
    "policy", [tfdb.Exact(), tfdb.Nearest(tolerance_ns=5), tfdb.Previous(max_age_ns=5)]
)
def test_seconds_are_named_for_every_policy(buffer: tfdb.Buffer, policy: tfdb.types.Policy) -> None:
    with pytest.raises(tfdb.TfdbError, match=f"{START // 10**9} looks like seconds"):
        buffer.lookup_transform("map", "hand", START // 10**9, policy)


def test_seconds_that_were_stored_are_named_in_the_error() -> None:
    live = tfdb.Buffer()
    for i in range(100):
        live.set_transform("map", "base", START // 10**9 + i, (1, 2, 3), TURN)
    looks = "those of this edge look like seconds"
    for stamp in (START, START + 10**9, START + 3_600 * 10**9):
        for policy in (
            None,
            tfdb.Exact(),
            tfdb.Nearest(tolerance_ns=5),
            tfdb.Previous(max_age_ns=5),
        ):
            with pytest.raises(tfdb.TfdbError, match=looks):
                live.lookup_transform("map", "base", stamp, policy)
    live.set_transform("map", "hand", START, (1, 2, 3), TURN)
    live.set_transform("other", "map", START // 10**9, (1, 2, 3), TURN)
    with pytest.raises(tfdb.Extrapolation, match=f"{START // 10**9 + 99} looks like seconds"):
        live.lookup_transform("base", "hand")  # at the latest common time
    for stamp in (START // 10**9 + 200, START // 10, START + 10**17):
        with pytest.raises(tfdb.Extrapolation) as caught:
            live.lookup_transform("map", "base", stamp)
        assert "seconds" not in str(caught.value)


def test_seconds_are_named_where_they_take_the_trees_apart() -> None:
    live = tfdb.Buffer(history=None)
    for stamp in (START, START + 10**9):
        live.set_transform("map", "base", stamp, (1, 2, 3), TURN)
    live.set_transform("elsewhere", "hand", START, (1, 2, 3), TURN)
    with pytest.raises(tfdb.Disconnected, match=f"{START // 10**9} looks like seconds"):
        live.lookup_transform("base", "hand", START // 10**9)


@pytest.mark.parametrize("span", [(0, 0), (0, 100), (5, 50), (0, 10**9), (0, 10**10)])
def test_small_stamps_are_not_taken_for_seconds(span: tuple[int, int]) -> None:
    buf = tfdb.Buffer(history=None)
    for stamp in span:
        buf.set_transform("map", "base", stamp, (1, 2, 3), TURN)
    with pytest.raises(tfdb.Extrapolation) as caught:
        buf.lookup_transform("map", "base", span[1] + 60)
    assert "seconds" not in str(caught.value)
    if span[1] >= 10**9:
        with pytest.raises(tfdb.Extrapolation) as caught:
            buf.lookup_transform("map", "base", 2 * span[1])
        assert "seconds" not in str(caught.value)


def test_time_0_is_not_the_latest(buffer: tfdb.Buffer) -> None:
    with pytest.raises(tfdb.Extrapolation, match="for the latest, pass no time"):
        buffer.lookup_transform("map", "hand", 0)


# -- recordings that do not fit --------------------------------------------------------------------


def simulated(offset: int = 0) -> tfdb.Buffer:
    made = tfdb.Buffer(history=None)
    for i in range(5):
        made.set_transform("map", "base", offset + i * STEP, (i, 1, 2), TURN)
        made.set_transform("base", "arm", offset + i * STEP, (0, i, 2), TURN)
    return made


def recorded(folder: Path, buffer: tfdb.Buffer, name: str) -> Path:
    write_recording(folder / name, buffer)
    return folder / name


def test_two_clocks_in_one_store_are_noticed(buffer: tfdb.Buffer, tmp_path: Path) -> None:
    real = recorded(tmp_path, buffer, "real.mcap")
    sim = recorded(tmp_path, simulated(STEP), "sim.mcap")
    store = tfdb.Buffer(history=None)
    store.load(real)
    with pytest.warns(tfdb.TfdbWarning, match="stamps of 2 clocks") as caught:
        store.load(sim)
    said = str(caught.pop().message)
    assert said.startswith(f"{sim}: ")
    assert "arm, base has stamps of both" in said
    with pytest.warns(tfdb.TfdbWarning, match="stamps of 2 clocks"):
        tfdb.load([real, sim])
    text = str(store.explain("map", "arm", START + 15 * STEP, tfdb.Interpolate(max_gap=0.2)))
    assert "stamps of 2 clocks" in text
    tfdb.load(real)  # one clock: no warning


def test_the_ranges_of_two_clocks_are_those_of_the_samples(tmp_path: Path) -> None:
    store = tfdb.Buffer(history=None)
    later = 1_700_000_000
    for frame, seconds in (("a", [*range(10), *range(later, later + 20)]), ("b", [later + 5])):
        for second in seconds:
            store.set_transform("map", frame, second * 10**9, (second, 2, 3), (0, 0.6, 0, 0.8))
    path = recorded(tmp_path, store, "both.mcap")
    with pytest.warns(tfdb.TfdbWarning, match="stamps of 2 clocks") as caught:
        tfdb.load(path)
    said = str(caught.pop().message)
    assert f"a from 0 s to 9 s; a, b from {later} s to {later + 19} s" in said


def test_seconds_among_nanoseconds_are_noticed(buffer: tfdb.Buffer, tmp_path: Path) -> None:
    """The edge is named that was written in seconds by somebody."""
    for i in range(5):
        buffer.set_transform("map", "car", START // 10**9 + i, (i, 2, 3), TURN)
    buffer.set_transform("map", "base", START // 10**9, (1, 2, 3), TURN)
    file = recorded(tmp_path, buffer, "mixed.mcap")
    cached = partial(tfdb.load, cache=True)
    for load in (tfdb.load, cached, cached, tfdb.Buffer(history=None).load):
        with pytest.warns(tfdb.TfdbWarning, match="look like seconds") as caught:
            load(file)
        assert caught[0].filename == __file__
    said = str(caught.pop().message)
    assert "base, car from 1.7 s to" in said
    assert "base has stamps of both" in said


def test_the_same_file_twice_is_noticed(buffer: tfdb.Buffer, tmp_path: Path) -> None:
    file = recorded(tmp_path, buffer, "drive.mcap")
    store = tfdb.Buffer(history=None)
    store.load(file)
    with pytest.warns(tfdb.TfdbWarning, match="loaded twice") as caught:
        store.load(file)
    assert caught.pop().filename == __file__
    (tmp_path / "link.mcap").symlink_to(file)
    for twice in ([file, file], [str(file), tmp_path / "link.mcap"]):
        with pytest.raises(tfdb.InvalidArgument, match="given twice"):
            tfdb.load(twice)
    other = simulated(START + 40 * STEP)
    store.load(recorded(tmp_path, other, "next.mcap"))  # new samples: no warning


def test_a_path_may_be_text(buffer: tfdb.Buffer, tmp_path: Path) -> None:
    data = tfdb.encode_tf_message([tfdb.TransformStamped("map", "base", START, (1, 2, 3), TURN)])
    with RecordingWriter(str(tmp_path / "drive.mcap")) as writer:
        writer.write(data, START, topic="/tf")
    assert tfdb.load(str(tmp_path / "drive.mcap")).frames() == ["base", "map"]


def test_unknown_frame_names_the_nearest() -> None:
    """In every way of reading, escaped, and of the state that was read."""
    buffer = tfdb.Buffer()
    buffer.set_transform("map", "base_link", START, (1, 2, 3), (0, 0.6, 0, 0.8))
    state = buffer.snapshot()
    buffer.set_static_transform("map", "bose_link", (1, 2, 3))
    hint = r"; did you mean 'base_link' or 'bose_link'\?$"
    for read in (
        lambda name: buffer.lookup_transform("map", name),
        lambda name: buffer.lookup_transform(name, "map", START),
        lambda name: buffer.lookup_transforms("map", name, [START]),
        buffer.frame_info,
        buffer.samples,
        buffer.parent_of,
    ):
        with pytest.raises(tfdb.UnknownFrame, match=hint) as caught:
            read("bse_link")
        assert caught.value.frame == "bse_link"
    with pytest.raises(tfdb.UnknownFrame, match=r"; did you mean 'base_link'\?$"):
        state.frame_info("bse_link")
    with pytest.raises(tfdb.UnknownFrame, match=r"commit \d+$"):
        buffer.frame_info("zzzzzz")

"""Trajectories as tables of pandas, polars and Arrow, and back."""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import polars as pl
import pytest

import tfdb

if TYPE_CHECKING:
    from pathlib import Path

COLUMNS = ["stamp_ns", "x", "y", "z", "qx", "qy", "qz", "qw"]
STAMPS = np.array([5, 10, 1_700_000_000_123_456_789])
POSES = [[1.0, 2.0, 3.0, 0.0, 0.0, 0.6, 0.8], [math.nan] * 7, [0.1, 0.2, 0.3, 0.5, -0.5, 0.5, 0.5]]
PATH = tfdb.Trajectory("map", "base", STAMPS, POSES)


def test_pandas() -> None:
    table = PATH.to_pandas()
    assert isinstance(table, pd.DataFrame)
    assert list(table.columns) == COLUMNS
    assert table["stamp_ns"].dtype == np.int64
    np.testing.assert_array_equal(table["stamp_ns"], STAMPS)
    np.testing.assert_array_equal(table[COLUMNS[1:]].to_numpy(), POSES)
    table["x"] += 1.0  # the table is a copy
    assert PATH.poses[0, 0] == 1.0
    assert len(PATH[:0].to_pandas()) == 0


def test_polars() -> None:
    table = PATH.to_polars()
    assert isinstance(table, pl.DataFrame)
    assert table.columns == COLUMNS
    assert table.schema["stamp_ns"] == pl.Int64
    np.testing.assert_array_equal(table["stamp_ns"], STAMPS)
    np.testing.assert_array_equal(table[:, 1:].to_numpy(), POSES)
    assert table.null_count().sum_horizontal()[0] == 0


def test_arrow_takes_it() -> None:
    """polars reads any table that speaks the Arrow C stream interface."""
    again = pl.DataFrame(PATH)
    assert again.equals(PATH.to_polars())
    pyarrow = pytest.importorskip("pyarrow")
    assert pyarrow.table(PATH).column_names == COLUMNS


def test_the_constructor_of_pandas_reads_the_poses_alone() -> None:
    plain = pd.DataFrame(PATH)
    assert list(plain.columns) == list(range(7))
    np.testing.assert_array_equal(plain.to_numpy(), POSES)
    assert list(PATH.to_pandas().columns) == COLUMNS
    if hasattr(pd.DataFrame, "from_arrow"):
        assert pd.DataFrame.from_arrow(PATH).equals(PATH.to_pandas())


def test_arrow_keeps_the_stamps() -> None:
    assert pl.DataFrame(PATH)["stamp_ns"].to_list() == STAMPS.tolist()
    assert pd.DataFrame(PATH.poses).shape == np.asarray(PATH).shape == (len(PATH), 7)


@pytest.mark.parametrize(
    "table",
    [
        PATH.to_pandas(),
        PATH.to_polars(),
        PATH.to_pandas().assign(other="x")[[*COLUMNS[::-1], "other"]],
        PATH.to_pandas().set_index(np.array([7, 8, 9])),
        PATH.to_pandas().assign(stamp_ns=pd.to_datetime(STAMPS)),
        {name: PATH.to_pandas()[name].tolist() for name in COLUMNS},
        PATH.to_pandas().to_records(),
    ],
    ids=["pandas", "polars", "other columns", "other labels", "times", "dict", "records"],
)
def test_tables_come_back(table: Any) -> None:
    assert tfdb.Trajectory.from_table("map", "base", table) == PATH


GOOD = {name: [1, 2] for name in COLUMNS}
GOOD |= {"qx": [0, 0], "qy": [0, 0], "qz": [0, 0], "qw": [1, 1]}


@pytest.mark.parametrize(
    ("table", "error", "text"),
    [
        (GOOD | {"stamp_ns": [2, 1]}, tfdb.errors.InvalidArray, "stamps must increase"),
        (GOOD | {"stamp_ns": [0.5, 1]}, tfdb.errors.InvalidArray, "stamps: expected"),
        (GOOD | {"x": [1]}, tfdb.errors.InvalidArray, "all of one length"),
        (GOOD | {"x": ["a", "b"]}, tfdb.errors.InvalidArray, "expected float64"),
        (GOOD | {"qw": [1, 9]}, tfdb.errors.InvalidTransform, r"poses\[1\]"),
        (
            {},
            tfdb.errors.InvalidArray,
            "no column 'stamp_ns' in a dict; a trajectory has stamp_ns, x,",
        ),
        (
            PATH.to_pandas().drop(columns="qy"),
            tfdb.errors.InvalidArray,
            "no column 'qy' in a DataFrame",
        ),
        (PATH.to_polars().drop("qy"), tfdb.errors.InvalidArray, "no column 'qy' in a DataFrame"),
        (np.zeros((2, 8)), tfdb.errors.InvalidArray, "no column 'stamp_ns' in a ndarray"),
        (None, tfdb.errors.InvalidArray, "no column 'stamp_ns' in a NoneType"),
        (5, tfdb.errors.InvalidArray, "in a int"),
    ],
)
def test_tables_of_something_else(table: Any, error: type, text: str) -> None:
    assert len(tfdb.Trajectory.from_table("map", "base", GOOD)) == 2
    with pytest.raises(error, match=text):
        tfdb.Trajectory.from_table("map", "base", table)


def test_parquet(tmp_path: Path) -> None:
    file = tmp_path / "path.parquet"
    PATH.save(file)
    assert tfdb.Trajectory.read(file) == PATH
    assert pl.read_parquet(file).equals(PATH.to_polars())
    renamed = tfdb.Trajectory.read(str(file), target="world")
    assert (renamed.target, renamed.source) == ("world", "base")
    with pytest.raises(tfdb.errors.TrajectoryError, match="exists already; pass overwrite=True"):
        PATH[:1].save(file)
    assert tfdb.Trajectory.read(file) == PATH
    PATH[:0].save(file, overwrite=True)
    assert len(pl.read_parquet(file)) == 0
    with pytest.raises(tfdb.errors.TrajectoryError, match="no pose in it"):
        tfdb.Trajectory.read(file)
    with pytest.raises(tfdb.InvalidArgument, match="the path is empty"):
        PATH.save("", "parquet")
    with pytest.raises(FileNotFoundError):
        PATH.save(tmp_path / "nowhere" / "path.parquet")
    with pytest.raises(FileNotFoundError):
        tfdb.Trajectory.read(tmp_path / "nothing.parquet")


def test_parquet_of_something_else(tmp_path: Path) -> None:
    file = tmp_path / "path.parquet"
    PATH.to_polars().write_parquet(file)
    nameless = tfdb.Trajectory.read(file)
    assert (nameless.target, nameless.source) == ("world", "body")
    assert tfdb.Trajectory.read(file, target="map", source="base") == PATH
    PATH.to_polars().drop("x").write_parquet(file)
    with pytest.raises(tfdb.errors.TrajectoryError, match="no column 'x'"):
        tfdb.Trajectory.read(file, target="map", source="base")
    PATH.to_polars().reverse().write_parquet(file)
    with pytest.raises(tfdb.errors.TrajectoryError, match="must increase"):
        tfdb.Trajectory.read(file, target="map", source="base")
    PATH.save(file, overwrite=True)
    whole = file.read_bytes()
    for cut in (4, 10, len(whole) // 2, len(whole) - 1):
        file.write_bytes(whole[:cut])
        with pytest.raises(
            tfdb.errors.TrajectoryError, match="no Parquet file, or damaged"
        ) as caught:
            tfdb.Trajectory.read(file)
        assert caught.value.path == str(file)


def test_without_the_libraries(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    there = tmp_path / "there.parquet"
    PATH.save(there)
    monkeypatch.setitem(sys.modules, "pandas", None)
    monkeypatch.setitem(sys.modules, "polars", None)
    for ask, name in (
        (PATH.to_pandas, "to_pandas needs pandas"),
        (PATH.to_polars, "to_polars needs polars"),
        (PATH.__arrow_c_stream__, "Arrow needs polars"),
        (lambda: PATH.save(tmp_path / "a.parquet"), "a Parquet file needs polars"),
        (lambda: tfdb.Trajectory.read(there), "a Parquet file needs polars"),
    ):
        with pytest.raises(
            tfdb.errors.NotSupported, match=rf"{name}: pip install 'tfdb\[tables\]'"
        ):
            ask()

"""The facts of all frames as columns: those of `tree`."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
import tfdb.types

if TYPE_CHECKING:
    from tfdb.types import FrameInfo, TreeColumns

SECOND = 1_000_000_000
DTYPES = {
    "is_static": np.bool_,
    "samples": np.int64,
    "oldest": np.int64,
    "newest": np.int64,
    "rate": np.float64,
    "late": np.int64,
    "longest_gap": np.int64,
    "cleared": np.bool_,
}


def busy_store() -> tfdb.Buffer:
    """Moving, static, cleared and re-parented frames of several authorities, late samples."""
    buffer = tfdb.Buffer(history=None)
    buffer.set_transform("map", "gone", SECOND, (1, 0, 0), authority="früher")
    buffer.clear()
    for i in range(30):
        parent = f"frame{i // 2 - 1}" if i > 3 else "map"
        if i % 4 == 3:
            buffer.set_static_transform(parent, f"frame{i}", (i, 0, 0), authority="urdf")
            continue
        for k in (1, 2, 5, 4, 7)[: i % 5 + 1]:
            who = f"node{i % 3}" if i % 2 else ""
            buffer.set_transform(parent, f"frame{i}", k * SECOND + i, (i, k, 0), authority=who)
    buffer.set_transform("other", "frame6", 9 * SECOND, (0, 0, 1))
    buffer.set_transform("été", "frame8", 6 * SECOND, (0, 0, 1))
    return buffer


def check_same(columns: TreeColumns, infos: list[FrameInfo]) -> None:
    assert len(columns) == len(infos)
    for name, dtype in DTYPES.items():
        column = getattr(columns, name)
        assert (column.dtype, column.shape) == (dtype, (len(infos),))
    for i, info in enumerate(infos):
        found: dict[str, Any] = {name: getattr(columns, name)[i].item() for name in DTYPES}
        for name in ("oldest", "newest"):
            found[name] = None if found[name] == -1 else found[name]
        found["rate"] = None if np.isnan(found["rate"]) else found["rate"]
        row = {"name": columns.names[i], "parent": columns.parents[i], **found}
        row["authority"] = columns.authorities[i]
        assert row == dataclasses.asdict(info)


@pytest.mark.parametrize("stamp", [None, 0, 3 * SECOND, 6 * SECOND, 20 * SECOND])
def test_columns_are_the_facts_of_the_tree(stamp: int | None) -> None:
    buffer = busy_store()
    check_same(buffer.tree_columns(stamp), buffer.tree(stamp))
    with buffer.snapshot() as snapshot:
        buffer.set_transform("map", "later", SECOND, (1, 0, 0))
        check_same(snapshot.tree_columns(stamp), snapshot.tree(stamp))
    with buffer.transaction() as tx:
        tx.set_transform("frame0", "own", 2 * SECOND, (1, 0, 0), authority="tx")
        tx.set_transform("map", "frame0", 2, (1, 0, 0))
        check_same(tx.tree_columns(stamp), tx.tree(stamp))
        tx.clear()
        check_same(tx.tree_columns(stamp), tx.tree(stamp))
    check_same(buffer.tree_columns(stamp), buffer.tree(stamp))
    assert buffer.tree_columns().cleared.any()


def test_an_empty_store_has_no_rows() -> None:
    columns = tfdb.Buffer().tree_columns()
    check_same(columns, [])
    assert columns.names == columns.parents == columns.authorities == ()
    assert repr(columns) == "<tfdb.types.TreeColumns of 0 frames>"


def test_columns_are_a_plain_value() -> None:
    columns = busy_store().tree_columns()
    with pytest.raises(dataclasses.FrozenInstanceError):
        columns.names = ()  # type: ignore[misc]
    assert type(columns) is tfdb.types.TreeColumns
    moving = ~columns.is_static & (columns.samples > 1)
    assert np.isfinite(columns.rate[moving]).all()
    assert np.isnan(columns.rate[~moving]).all()


def test_wrong_arguments() -> None:
    buffer = busy_store()
    with pytest.raises(tfdb.errors.InvalidStamp):
        buffer.tree_columns(-5)
    with pytest.raises(TypeError, match="at most 1 positional argument"):
        buffer.tree_columns(None, 5)  # type: ignore[call-arg]
    snapshot = buffer.snapshot()
    snapshot.close()
    with pytest.raises(tfdb.errors.SnapshotClosed):
        snapshot.tree_columns()

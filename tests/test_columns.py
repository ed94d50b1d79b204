"""Columns of one edge, in any memory layout, store the same as objects."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable

ROWS = 3000
STAMPS = 5_000_000 + 1_000 * np.arange(ROWS)


def poses() -> np.ndarray:
    angle = 0.4 + 1e-3 * np.arange(ROWS)
    rows = np.zeros((ROWS, 7))
    rows[:, 0] = np.arange(ROWS)
    rows[:, 1], rows[:, 2] = -3.0, 0.25
    rows[:, 3], rows[:, 5], rows[:, 6] = 0.6 * np.sin(angle), 0.8 * np.sin(angle), np.cos(angle)
    return rows


def unaligned(array: np.ndarray) -> np.ndarray:
    raw = np.frombuffer(b"x" + array.tobytes(), np.uint8)[1:]
    return raw.view(array.dtype).reshape(array.shape)


def read_only(array: np.ndarray) -> np.ndarray:
    array = array.copy()
    array.flags.writeable = False
    return array


LAYOUTS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "as it is": lambda array: array,
    "by columns": np.asfortranarray,
    "every other row": lambda array: np.repeat(array, 2, axis=0)[::2],
    "backwards in memory": lambda array: array[::-1].copy()[::-1],
    "unaligned": unaligned,
    "read-only": read_only,
}


def one_by_one(stamps: np.ndarray, rows: np.ndarray) -> list[tfdb.TransformStamped]:
    return [
        tfdb.TransformStamped("map", "base", int(stamp), row[:3], row[3:])
        for stamp, row in zip(stamps, rows, strict=True)
    ]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_columns_store_the_same_as_objects(layout: str) -> None:
    rows, single = tfdb.Buffer(history=None), tfdb.Buffer(history=None)
    columns = tfdb.Columns("map", "base", LAYOUTS[layout](STAMPS), LAYOUTS[layout](poses()))
    assert rows.set_transforms(columns, authority="slam") == 1
    single.set_transforms(one_by_one(STAMPS, poses()), authority="slam")
    assert rows.tree() == single.tree()
    for have, want in zip(rows.samples("base"), single.samples("base"), strict=True):
        assert np.array_equal(have, want)


@pytest.mark.parametrize("partial", [False, True])
def test_columns_are_refused_as_objects_are(partial: bool) -> None:
    stamps, rows = STAMPS.copy(), poses()
    stamps[2000] = stamps[1990]
    rows[[100, 2500], [1, 6]] = np.nan, 9.0
    said = []
    for batch in (tfdb.Columns("map", "base", stamps, rows), one_by_one(stamps, rows)):
        buffer = tfdb.Buffer(history=None)
        try:
            refused = buffer.set_transforms(batch, partial=partial)
        except tfdb.errors.InvalidTransform as error:
            refused = [str(error), error.index, error.refused]
        said.append((refused, buffer.commit, buffer.tree()))
        if partial:
            assert len(buffer.samples("base")[0]) == ROWS - 3
    assert said[0] == said[1]
    assert said[0][1] == int(partial)


@pytest.mark.parametrize("dtype", [np.int64, np.uint64, object])
def test_stamps_out_of_range_are_named_by_their_row(dtype: type) -> None:
    for stamp in (-1, 2**61):
        if dtype is np.uint64 and stamp < 0:
            continue
        stamps = STAMPS.astype(dtype)
        stamps[7] = stamp
        buffer = tfdb.Buffer()
        with pytest.raises(tfdb.InvalidStamp) as caught:
            buffer.set_transforms(tfdb.Columns("map", "base", stamps, poses()))
        assert caught.value.index == 7
        assert caught.value.value == stamp
        with pytest.raises(tfdb.InvalidStamp) as alone:
            buffer.set_transform("map", "base", stamp, (1, 2, 3), (0, 0, 0.6, 0.8))
        assert str(caught.value) == str(alone.value)
        assert buffer.commit == 0

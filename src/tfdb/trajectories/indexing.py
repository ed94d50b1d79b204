"""Rows of a trajectory: arguments of `trajectory[rows]`."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np

from tfdb.data.errors import InvalidArray, InvalidIndex
from tfdb.data.stamps import shown

__all__: list[str] = []


def checked_rows(rows: Any, count: int) -> Any:
    """Return the row as an int, or a slice, a mask or an array of rows, of `count` poses.

    Raises InvalidIndex for a row outside, InvalidArray for any other object.
    """
    if isinstance(rows, slice):
        try:
            rows.indices(count)
        except (TypeError, ValueError) as error:
            raise InvalidArray(f"{shown(rows)}: {error}", reason=str(error)) from None
        return rows
    if not isinstance(rows, np.ndarray | bool | list | tuple):
        try:
            return _row(operator.index(rows), count)
        except TypeError:
            pass  # refused below, if it is not an array
    try:
        picked = np.asarray(rows)
    except (TypeError, ValueError):
        picked = np.empty((1, 1))
    if picked.shape == (0,):
        picked = picked.astype(np.int64)
    if picked.ndim == 0 and picked.dtype.kind in "iu":
        return _row(int(picked), count)
    if picked.ndim != 1 or picked.dtype.kind not in "iub" or np.ma.is_masked(rows):
        reason = f"a trajectory is indexed by rows, a slice or a mask, not by {shown(rows)}"
        raise InvalidArray(reason, reason=reason)
    if picked.dtype.kind == "b":
        if len(picked) != count:
            reason = f"a mask of {len(picked)} for {count} poses"
            raise InvalidArray(reason, reason=reason)
        return picked
    outside = np.flatnonzero((picked < -count) | (picked >= count))
    if len(outside):
        raise _no_row(int(picked[outside[0]]), count)
    return picked


def _row(row: int, count: int) -> int:
    if not -count <= row < count:
        raise _no_row(row, count)
    return row


def _no_row(row: int, count: int) -> InvalidIndex:
    valid = f"valid are {-count} to {count - 1}" if count else "it is empty"
    return InvalidIndex(f"the pose {shown(row)} does not exist: {valid}", index=row)

"""Velocities along a trajectory."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tfdb.data.errors import Extrapolation
from tfdb.data.poses import rotation_vectors
from tfdb.data.stamps import format_seconds

if TYPE_CHECKING:
    import numpy.typing as npt

    from tfdb._core import Buffer

    Array = npt.NDArray[np.float64]

__all__: list[str] = []


def velocities_of(
    store: Buffer,
    names: tuple[str, str, str],
    all_stamps: npt.NDArray[np.int64],
    valid: npt.NDArray[np.bool_],
    length: int,
) -> tuple[Array, Array]:
    """Return linear and angular velocities (N, 3), for `Trajectory.velocities`.

    `names`: target, source, and the source's name in `store`; `length`: nanoseconds.
    """
    target, source, child = names
    stamps = all_stamps[valid]
    first, last = stamps[0], stamps[-1]
    if len(stamps) == 1:
        raise Extrapolation(
            f"T[{target}<-{source}] has one pose only, at "
            f"{format_seconds(int(first))}: that is not a motion",
            edge=source,
            parent=target,
            stamp=int(first),
            oldest=int(first),
            newest=int(first),
            reason="no data",
        )
    low, high = np.maximum(stamps - length, first), np.minimum(stamps + length, last)
    begin = np.maximum(low, stamps - length // 2)
    end = np.minimum(high, begin + length)
    begin = np.maximum(low, end - length)
    before = store.lookup_transforms(target, child, begin)
    after = store.lookup_transforms(target, child, end)
    seconds = ((end - begin) / 1e9)[:, np.newaxis]
    linear, angular = np.full((2, len(all_stamps), 3), np.nan)
    with np.errstate(over="ignore", invalid="ignore"):
        linear[valid] = (after[:, :3] - before[:, :3]) / seconds
    angular[valid] = rotation_vectors(before[:, 3:], after[:, 3:]) / seconds
    return linear, angular

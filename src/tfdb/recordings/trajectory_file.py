"""Trajectory files as recordings: one moving edge, each pose a message on /tf."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb import _core
from tfdb.data.errors import TrajectoryError
from tfdb.data.types import TransformStamped

from .containers import Container, Source, Topic

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

    from tfdb.data.decimal_time import Unit

    from .containers import Payload

_TOPIC = "/tf"


def open_trajectory(
    path: Path, *, salvage: bool = False, stamp_unit: Unit | None = None
) -> Container:
    """Open a TUM, KITTI, EuRoC, CSV, NPZ or Parquet file, as `Trajectory.read` reads it.

    If the file names no frames, its poses are those of `body` in `world`. Raises `TrajectoryError`.
    """
    from tfdb.trajectories.reading import read_with_rows  # noqa: PLC0415 - needs numpy
    from tfdb.trajectories.trajectory import Trajectory  # noqa: PLC0415 - as above

    trajectory, rows = read_with_rows(Trajectory, path, salvage=salvage, stamp_unit=stamp_unit)
    there = trajectory.valid
    count = int(there.sum())
    if not count:
        raise TrajectoryError(path, None, "no pose in it: all its rows are NaN")

    def payloads(ids: Collection[int], _since: int) -> Iterator[Payload]:
        poses, stamps = trajectory.poses[there].tolist(), trajectory.stamps[there].tolist()
        names = trajectory.target, trajectory.source
        for stamp, pose in zip(stamps, poses, strict=True) if ids else ():
            transform = TransformStamped(*names, stamp, pose[:3], pose[3:])
            yield stamp, 0, _core.encode_tf_message([transform], "ros1")

    container = Container(
        path,
        [Topic(_TOPIC, "tf2_msgs/msg/TFMessage", count)],
        {0: Source(_TOPIC, "ros1", "", count)},
        int(trajectory.stamps[there][0]),
        payloads,
        _nothing,
        rows.losses,
    )
    container.rows = rows
    return container


def _nothing() -> None:
    """Do nothing: the file was closed after reading."""

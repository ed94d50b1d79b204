"""Trajectory files as recordings: one moving edge, each pose a message on /tf."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb import _core
from tfdb.errors import TrajectoryError
from tfdb.types import TransformStamped

from .containers import Container, Source, Topic

if TYPE_CHECKING:
    from collections.abc import Collection, Iterator
    from pathlib import Path

    from .containers import Payload

_TOPIC = "/tf"


def open_trajectory(path: Path, *, salvage: bool = False) -> Container:
    """Open a TUM, KITTI, EuRoC, CSV, NPZ or Parquet file.

    Its poses are those of `body` in `world` where the file names no frames. There is nothing to
    salvage. Raises `TrajectoryError`.
    """
    del salvage
    from .trajectories import read_trajectory  # noqa: PLC0415 - needs numpy

    trajectory = read_trajectory(path)
    there = trajectory.found
    count = int(there.sum())
    if not count:
        raise TrajectoryError(path, None, "no pose in it: all its rows are NaN")

    def payloads(ids: Collection[int]) -> Iterator[Payload]:
        poses, stamps = trajectory.poses[there].tolist(), trajectory.stamps[there].tolist()
        names = trajectory.target, trajectory.source
        for stamp, pose in zip(stamps, poses, strict=True) if ids else ():
            transform = TransformStamped(*names, stamp, pose[:3], pose[3:])
            yield stamp, 0, _core.encode_tf_message([transform], "ros1")

    return Container(
        path,
        [Topic(_TOPIC, "tf2_msgs/msg/TFMessage", count)],
        {0: Source(_TOPIC, "ros1", _TOPIC, count)},
        int(trajectory.stamps[there][0]),
        payloads,
        _nothing,
    )


def _nothing() -> None:
    """The file was closed when it was read."""

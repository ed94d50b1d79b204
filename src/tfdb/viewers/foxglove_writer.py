"""Transforms and trajectories for Foxglove, as an MCAP file; needs the package foxglove-sdk."""

from __future__ import annotations

from typing import TYPE_CHECKING

import foxglove
import numpy as np
from foxglove.channels import FrameTransformsChannel, PosesInFrameChannel
from foxglove.messages import (
    FrameTransform,
    FrameTransforms,
    Pose,
    PosesInFrame,
    Quaternion,
    Timestamp,
    Vector3,
)

from tfdb.data.new_file import new_file

if TYPE_CHECKING:
    import os

    import numpy.typing as npt

    from .drawing import Scene


def write(scene: Scene, path: str | os.PathLike[str], *, topic: str, overwrite: bool) -> None:
    """Implements `tfdb.to_foxglove`."""
    context = foxglove.Context()
    with (
        new_file(path, overwrite=overwrite) as made,
        foxglove.open_mcap(made, context=context),
    ):
        moving = FrameTransformsChannel(topic, context=context)
        still = FrameTransformsChannel(f"{topic}_static", context=context)
        first = scene.first
        fixed = [
            frame_transform(first, edge.parents[0], edge.child, edge.poses[0])
            for edge in scene.edges
            if edge.stamps is None
        ]
        if fixed:
            still.log(FrameTransforms(transforms=fixed), log_time=first)
        _log_moving(scene, moving)
        for each in scene.paths:
            good = np.isfinite(each.poses).all(axis=1)
            poses = [_pose(row) for row in each.poses[good]]
            message = PosesInFrame(timestamp=_time(first), frame_id=each.target, poses=poses)
            channel = PosesInFrameChannel(f"/{each.source.lstrip('/')}/path", context=context)
            channel.log(message, log_time=first)


def _log_moving(scene: Scene, channel: FrameTransformsChannel) -> None:
    """Log a message for each stamp, all edges that have it in one."""
    edges = [edge for edge in scene.edges if edge.stamps is not None]
    if not edges:
        return
    stamps = np.concatenate([edge.stamps for edge in edges if edge.stamps is not None])
    which = np.repeat(np.arange(len(edges)), [len(edge.poses) for edge in edges])
    rows = np.concatenate([np.arange(len(edge.poses)) for edge in edges])
    order = np.argsort(stamps, kind="stable")
    cuts = np.flatnonzero(np.diff(stamps[order])) + 1
    for part in np.split(order, cuts):
        stamp = int(stamps[part[0]])
        transforms = [
            frame_transform(stamp, edge.parents[row], edge.child, edge.poses[row])
            for edge, row in ((edges[which[at]], int(rows[at])) for at in part.tolist())
        ]
        channel.log(FrameTransforms(transforms=transforms), log_time=stamp)


def _time(stamp: int) -> Timestamp:
    return Timestamp(*divmod(stamp, 1_000_000_000))


def frame_transform(
    stamp: int, parent: str, child: str, pose: npt.NDArray[np.float64]
) -> FrameTransform:
    """Return T[parent<-child] at a stamp as Foxglove's message."""
    x, y, z, qx, qy, qz, qw = pose.tolist()
    return FrameTransform(
        timestamp=_time(stamp),
        parent_frame_id=parent,
        child_frame_id=child,
        translation=Vector3(x=x, y=y, z=z),
        rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
    )


def _pose(row: npt.NDArray[np.float64]) -> Pose:
    x, y, z, qx, qy, qz, qw = row.tolist()
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=Quaternion(x=qx, y=qy, z=qz, w=qw))

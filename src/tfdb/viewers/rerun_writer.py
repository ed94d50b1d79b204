"""Transforms and trajectories for Rerun's viewer; needs the package rerun-sdk."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import rerun as rr

from tfdb.data.errors import InvalidArgument
from tfdb.data.new_file import new_file

if TYPE_CHECKING:
    import os

    from .drawing import Edge, Scene

TIMELINE = "stamp"
"""The timeline: nanoseconds since 1970, like the stamps."""

_FARTHEST = float(np.finfo(np.float32).max)


def write(
    scene: Scene,
    path: str | os.PathLike[str] | None,
    recording: Any,
    *,
    root: str,
    axes: float,
    overwrite: bool,
) -> None:
    """Implements `tfdb.to_rerun`."""
    for edge in scene.edges:
        _refuse_far(edge)
    if path is None:
        into = recording if recording is not None else rr.get_data_recording()
        if not isinstance(into, rr.RecordingStream):
            raise InvalidArgument(
                "Rerun has no active recording: pass a path or recording=, or call rerun.init() "
                "first",
                value=recording,
            )
        _log(scene, into, root, axes)
        return
    if recording is not None:
        raise InvalidArgument("give path or recording, not both", value=recording)
    with new_file(path, overwrite=overwrite) as made:
        into = rr.RecordingStream("tfdb")
        into.save(made)
        _log(scene, into, root, axes)
        into.flush()
        into.disconnect()


def _refuse_far(edge: Edge) -> None:
    """Refuse poses that are infinite in single precision."""
    far = float(np.abs(edge.poses[:, :3]).max())
    if far > _FARTHEST:
        raise InvalidArgument(
            f"frame {edge.child!r} is {far:.3g} m from its parent: Rerun stores single precision, "
            f"at most {_FARTHEST:.3g} m",
            value=far,
        )


def _log(scene: Scene, into: rr.RecordingStream, root: str, axes: float) -> None:
    for edge in scene.edges:
        _log_edge(edge, into, rr.new_entity_path([root, edge.child]), axes)
    for path in scene.paths:
        entity = rr.new_entity_path([root, f"{path.source} in {path.target}"])
        good = np.isfinite(path.poses).all(axis=1)
        into.log(
            entity,
            rr.CoordinateFrame(path.target),
            rr.LineStrips3D([path.poses[good, :3]]),
            static=True,
        )


def _log_edge(edge: Edge, into: rr.RecordingStream, entity: str, axes: float) -> None:
    look: list[Any] = [rr.CoordinateFrame(edge.child)]
    if axes > 0:
        look.append(rr.TransformAxes3D(axes))
    into.log(entity, *look, static=True)
    if edge.stamps is None:
        into.log(
            entity,
            rr.Transform3D(
                translation=edge.poses[0, :3],
                quaternion=rr.Quaternion(xyzw=edge.poses[0, 3:]),
                parent_frame=edge.parents[0],
                child_frame=edge.child,
            ),
            static=True,
        )
        return
    into.send_columns(
        entity,
        indexes=[rr.TimeColumn(TIMELINE, timestamp=edge.stamps.astype("datetime64[ns]"))],
        columns=rr.Transform3D.columns(
            translation=edge.poses[:, :3],
            quaternion=edge.poses[:, 3:],
            parent_frame=edge.parents,
            child_frame=[edge.child] * len(edge.stamps),
        ),
    )

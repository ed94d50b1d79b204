"""Writes stores and trajectories for the viewers Rerun and Foxglove."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tfdb.data.errors import InvalidArgument, NotSupported

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from tfdb._core import Buffer, Snapshot
    from tfdb.trajectories.trajectory import Trajectory

__all__ = ["to_foxglove", "to_rerun"]


def to_rerun(
    what: Buffer | Snapshot | Trajectory | Sequence[Trajectory],
    path: str | os.PathLike[str] | None = None,
    *,
    recording: Any = None,
    entity: str = "tf",
    axes: float = 0.1,
    overwrite: bool = False,
) -> int:
    """Write transforms for Rerun's viewer, to an ``.rrd`` file or into a recording of Rerun.

    Each edge T[parent<-child] becomes a `Transform3D` between two named frames, at
    `ENTITY/CHILD`. Moving edges are on the timeline `stamp`, with all their samples. A trajectory
    T[target<-source] becomes an edge, and a line in the target frame. Rerun stores poses in single
    precision. Needs rerun-sdk: ``pip install 'tfdb[rerun]'``.

    Parameters
    ----------
    what
        A store, a snapshot, or one or several trajectories.
    path
        The file; ``rerun FILE`` opens it. None: write into `recording`.
    recording
        A `rerun.RecordingStream`. None: the one that `rerun.init()` made.
    entity
        The entity path of all logged entities.
    axes
        Length of the drawn axes of each frame, in metres; 0: no axes.
    overwrite
        Replace the file if it exists.

    Returns
    -------
    int
        Number of written transforms.

    Raises
    ------
    NotSupported
        rerun-sdk is not installed; the message says how.
    InvalidArgument
        `what` has another type, or a trajectory has no pose; the file exists; neither or both of
        path and recording; a pose beyond the range of single precision.
    """
    if not _is_name(entity):
        raise InvalidArgument(f"entity must be an entity path, got {entity!r}", value=entity)
    if not _is_length(axes):
        raise InvalidArgument(
            f"axes must be a length in metres of at least 0, got {axes!r}", value=axes
        )
    from .drawing import collect  # noqa: PLC0415 - imports numpy

    scene = collect(what)
    try:
        from . import rerun_writer  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise _missing("to_rerun", "rerun-sdk", "rerun", error) from error
    rerun_writer.write(
        scene, path, recording, root=entity.strip("/"), axes=axes, overwrite=overwrite
    )
    return scene.transforms


def to_foxglove(
    what: Buffer | Snapshot | Trajectory | Sequence[Trajectory],
    path: str | os.PathLike[str],
    *,
    topic: str = "/tf",
    overwrite: bool = False,
) -> int:
    """Write transforms as an MCAP file for Foxglove: messages of `foxglove.FrameTransforms`.

    The edges T[parent<-child] of one stamp make one message on `topic`, logged at that stamp.
    Static edges make one message on `topic` + `_static` at the first stamp. A trajectory
    T[target<-source] becomes an edge, and a `foxglove.PosesInFrame` on `/SOURCE/path`. Needs
    foxglove-sdk: ``pip install 'tfdb[foxglove]'``.

    Parameters
    ----------
    what
        A store, a snapshot, or one or several trajectories.
    path
        The file; usually it ends in ``.mcap``.
    topic
        Topic of the moving transforms.
    overwrite
        Replace the file if it exists.

    Returns
    -------
    int
        Number of written transforms.

    Raises
    ------
    NotSupported
        foxglove-sdk is not installed; the message says how.
    InvalidArgument
        `what` has another type, or a trajectory has no pose; the file exists; `topic` is empty.
    """
    if not _is_name(topic):
        raise InvalidArgument(f"topic must be a topic name, got {topic!r}", value=topic)
    from .drawing import collect  # noqa: PLC0415 - imports numpy

    scene = collect(what)
    try:
        from . import foxglove_writer  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise _missing("to_foxglove", "foxglove-sdk", "foxglove", error) from error
    foxglove_writer.write(scene, path, topic=topic, overwrite=overwrite)
    return scene.transforms


def _is_name(value: object) -> bool:
    return isinstance(value, str) and bool(value.strip("/"))


def _is_length(value: object) -> bool:
    real = isinstance(value, int | float) and not isinstance(value, bool)
    return real and 0 <= value < float("inf")  # type: ignore[operator]


def _missing(name: str, package: str, extra: str, error: ImportError) -> NotSupported:
    return NotSupported(
        f"tfdb.{name} needs {package}: pip install 'tfdb[{extra}]' ({error})", reason=package
    )

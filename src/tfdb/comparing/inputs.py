"""Arguments of a comparison: a trajectory, a trajectory file, or a store or recording of one."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from tfdb._core import Buffer, Snapshot
from tfdb._core import open as open_frozen
from tfdb.data.errors import InvalidArgument, InvalidTransform, NotComparable, RecordingError
from tfdb.data.path_checks import check_path
from tfdb.data.poses import TOO_FAR, found
from tfdb.recordings.containers import kind_of
from tfdb.recordings.load import load
from tfdb.store.frozen import is_frozen
from tfdb.store.summary import longest_moving_chain
from tfdb.trajectories.reading import kitti_times, read_with_rows
from tfdb.trajectories.reading_report import warn_of_rows
from tfdb.trajectories.trajectory import Trajectory

if TYPE_CHECKING:
    from pathlib import Path

    from tfdb.data.decimal_time import Unit

TrajectoryLike: TypeAlias = Trajectory | Buffer | Snapshot | str | os.PathLike[str]
"""Inputs of `compare`."""

Frames: TypeAlias = tuple[str, str]
"""Target and source."""


@dataclass(frozen=True)
class Reading:
    """Options for reading trajectory files; `by_row`: KITTI poses need no stamps."""

    salvage: bool = False
    stamp_unit: Unit | None = None
    by_row: bool = False


def to_trajectory(
    given: Any, frames: Frames | None, role: str, parameter: str, reading: Reading
) -> Trajectory:
    """Make a trajectory from an argument.

    Errors name the argument by `role` and its frames by `parameter`. Raises the errors of loading
    and lookups, InvalidArgument, InvalidTransform and NotComparable.
    """
    names: Any = () if frames is None else frames
    fine = frames is None or (isinstance(names, list | tuple) and len(names) == 2)
    if not fine or not all(isinstance(name, str) for name in names):
        message = f"{parameter} must be the names (target, source), got {frames!r}"
        raise InvalidArgument(message, value=frames)
    if isinstance(given, Trajectory):
        return checked(given, role)
    if isinstance(given, Buffer | Snapshot):
        return looked_up(given, frames, role, parameter)
    if not isinstance(given, str | os.PathLike):
        raise InvalidArgument(
            f"the {role} must be a Trajectory, a Buffer, a Snapshot or a path, "
            f"got {type(given).__name__}",
            value=given,
        )
    path = check_path(given)
    if is_frozen(path):
        return looked_up(open_frozen(path), frames, role, parameter)
    if is_recording(path):
        return looked_up(load(path, salvage=reading.salvage), frames, role, parameter)
    trajectory, rows = read_with_rows(
        Trajectory,
        path,
        salvage=reading.salvage,
        stamp_unit=reading.stamp_unit,
        by_row=reading.by_row,
    )
    warn_of_rows(rows, 3)
    return checked(trajectory, role)


def pairs_by_row(reference: Any, estimate: Any, delta_unit: object) -> bool:
    """Return whether both are KITTI files, and at least one of them has no stamps.

    Then a `delta_unit` of seconds raises InvalidArgument.
    """
    timed = [_kitti_times(given) for given in (reference, estimate)]
    if None in timed or all(timed):
        return False
    if delta_unit == "s":
        raise InvalidArgument("delta_unit='s' needs stamps, which KITTI poses lack", value="s")
    return True


def _kitti_times(given: Any) -> bool | None:
    """Return whether a file of KITTI poses has a file of times; None for other inputs."""
    if not isinstance(given, str | os.PathLike):
        return None
    path = check_path(given)
    if not path.is_file() or is_frozen(path) or is_recording(path):
        return None
    return kitti_times(path)


def is_recording(path: Path) -> bool:
    """Return whether a file is a recording; `Trajectory.read` reads all other files."""
    with suppress(RecordingError):
        return kind_of(path) != "trajectory"
    return False


def looked_up(
    reads: Buffer | Snapshot, frames: Frames | None, role: str, parameter: str
) -> Trajectory:
    """Look up T[target<-source] at each stored stamp of the path that has a pose."""
    if frames is None:
        chain = longest_moving_chain(reads.tree())
        hint = f", such as {chain!r}" if chain else ""
        raise InvalidArgument(
            f"the {role} has many frames: pass {parameter}=(target, source){hint}"
        )
    return checked(reads.trajectory(frames[0], frames[1], missing="skip"), role)


def checked(trajectory: Trajectory, role: str) -> Trajectory:
    """Return the trajectory; raise an error if it cannot be compared."""
    good = found(trajectory.poses)
    if not good.any():
        rows = ": all its rows are NaN" if len(good) else ""
        raise NotComparable(f"the {role} holds no pose{rows}", reason="no pose")
    far = np.abs(trajectory.poses[good, :3]).max(axis=1)
    if far.max() >= TOO_FAR:
        row = int(np.flatnonzero(good)[np.argmax(far)])
        reason = (
            f"its distance from the origin is {far.max():.3g} m, at most {TOO_FAR:g} m is possible"
        )
        raise InvalidTransform(f"pose {row} of the {role}: {reason}", index=row, reason=reason)
    return trajectory

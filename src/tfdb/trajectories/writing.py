"""Trajectories to files: TUM, KITTI, EuRoC, CSV and NPZ.

Numbers have enough digits to read back the same float64; stamps are exact decimals. TUM, KITTI and
EuRoC files omit missing poses, the other formats keep them as NaN. A file appears under its name
when it is complete (`tfdb.data.new_file`), and replaces another only with `overwrite=True`.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Protocol

import numpy as np

from tfdb.data.argument_checks import not_one_of, refuse_without
from tfdb.data.decimal_time import ns_to_seconds
from tfdb.data.errors import TrajectoryError
from tfdb.data.new_file import new_file, refuse_existing
from tfdb.data.path_checks import check_path
from tfdb.data.poses import matrices, missing

from . import tables
from .tables import COLUMNS

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from tfdb.data.types import TrajectoryLike

    from .file_formats import Format
    from .reading import PathLike
    from .rows import Poses, Stamps

_EUROC_HEADING = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
)


def _refuse_others(trajectory: object) -> None:
    what = "a trajectory, with stamps and poses"
    refuse_without(trajectory, "trajectory", what, "stamps", "poses")
    for each in (trajectory.stamps, trajectory.poses):  # type: ignore[attr-defined]
        refuse_without(each, "trajectory", f"{what} that are arrays", "tolist", "shape")


def _present_poses(trajectory: TrajectoryLike) -> tuple[Stamps, Poses]:
    """Return the stamps and poses that are not missing."""
    _refuse_others(trajectory)
    there = ~missing(trajectory.poses)
    return trajectory.stamps[there], trajectory.poses[there]


def write_tum(path: PathLike, trajectory: TrajectoryLike, *, overwrite: bool = False) -> None:
    """Write `seconds x y z qx qy qz qw` lines, seconds with nine decimals."""
    stamps, poses = _present_poses(trajectory)
    _write_lines(
        path,
        "# timestamp tx ty tz qx qy qz qw",
        (
            f"{ns_to_seconds(stamp)} {' '.join(map(repr, pose))}"
            for stamp, pose in zip(stamps.tolist(), poses.tolist(), strict=True)
        ),
        overwrite=overwrite,
    )


def write_euroc(path: PathLike, trajectory: TrajectoryLike, *, overwrite: bool = False) -> None:
    """Write `nanoseconds,x,y,z,qw,qx,qy,qz` lines under EuRoC's header."""
    stamps, poses = _present_poses(trajectory)
    rows = _comma_rows(stamps.tolist(), poses[:, (0, 1, 2, 6, 3, 4, 5)].tolist())
    _write_lines(path, _EUROC_HEADING, rows, overwrite=overwrite)


def write_csv(path: PathLike, trajectory: TrajectoryLike, *, overwrite: bool = False) -> None:
    """Write `stamp_ns,x,y,z,qx,qy,qz,qw` lines with that header; stamps in nanoseconds."""
    _refuse_others(trajectory)
    rows = _comma_rows(trajectory.stamps.tolist(), trajectory.poses.tolist())
    _write_lines(path, ",".join(COLUMNS), rows, overwrite=overwrite)


def write_kitti(
    path: PathLike,
    trajectory: TrajectoryLike,
    *,
    times: PathLike | None = None,
    overwrite: bool = False,
) -> None:
    """Write the rows of 3x4 matrices to `path` and the stamps in seconds to `times`.

    `times` is by default `NAME_times.txt` beside `path`, where `Trajectory.read` looks for it.
    """
    stamps, poses = _present_poses(trajectory)
    rows = matrices(poses)[:, :3].reshape(-1, 12).tolist()
    where = check_path(path, _refusal)
    beside = where.with_name(f"{where.stem}_times.txt")
    if times is not None:
        beside = check_path(times, _refusal)
    if os.path.realpath(beside) == os.path.realpath(where):
        raise _refusal(where, "the stamps need a file of their own")
    with new_file(where, overwrite=overwrite, refusal=_refusal) as made:
        made.write_text("".join(" ".join(map(repr, row)) + "\n" for row in rows))
        seconds = map(ns_to_seconds, stamps.tolist())
        _write_lines(beside, None, seconds, overwrite=overwrite)


def write_npz(path: PathLike, trajectory: TrajectoryLike, *, overwrite: bool = False) -> None:
    """Write a compressed NPZ with the arrays `stamps` (N,) int64 and `poses` (N, 7) float64."""
    _refuse_others(trajectory)
    with (
        new_file(path, overwrite=overwrite, refusal=_refusal) as made,
        made.open("wb") as file,
    ):
        np.savez_compressed(file, stamps=trajectory.stamps, poses=trajectory.poses)


def write_parquet(path: PathLike, trajectory: TrajectoryLike, *, overwrite: bool = False) -> None:
    """Write a Parquet file with the names of its frames.

    Raises NotSupported if polars is not installed.
    """
    _refuse_others(trajectory)
    where = check_path(path, _refusal)
    refuse_existing(where, overwrite=overwrite, refusal=_refusal)
    named = getattr(trajectory, "target", "world"), getattr(trajectory, "source", "body")
    tables.write_parquet(where, named, trajectory.stamps, trajectory.poses, overwrite=overwrite)


class _Writer(Protocol):
    """One of the functions above."""

    def __call__(
        self, path: PathLike, trajectory: TrajectoryLike, *, overwrite: bool = False
    ) -> None: ...


_WRITERS: dict[str, _Writer] = {
    "tum": write_tum,
    "euroc": write_euroc,
    "csv": write_csv,
    "npz": write_npz,
    "parquet": write_parquet,
    "kitti": write_kitti,
}


def write_trajectory(
    path: PathLike,
    trajectory: TrajectoryLike,
    format: Format | None = None,  # noqa: A002 - as in Trajectory.read
    *,
    overwrite: bool = False,
) -> None:
    """Write a trajectory; None: the format of the file extension.

    `.tum` and `.txt` are TUM; `.csv`, `.npz` and `.parquet` name their formats. `"euroc"` and
    `"kitti"` must be given. Raises `TrajectoryError` for an unknown format, or for an existing file
    without `overwrite`; `OSError` if the file cannot be written. An existing file stays unchanged.
    """
    suffix = check_path(path, _refusal).suffix.lower()
    name: object = format
    if name is None:
        name = {".txt": "tum"}.get(suffix, suffix.removeprefix("."))
    writer = _WRITERS.get(name) if isinstance(name, str) else None
    if writer is None:
        raise TrajectoryError(path, None, not_one_of("format", name, _WRITERS))
    writer(path, trajectory, overwrite=overwrite)


def _comma_rows(stamps: list[int], poses: list[list[float]]) -> Iterable[str]:
    return (
        f"{stamp},{','.join(map(repr, pose))}" for stamp, pose in zip(stamps, poses, strict=True)
    )


def _write_lines(
    path: PathLike, heading: str | None, lines: Iterable[str], *, overwrite: bool
) -> None:
    with (
        new_file(path, overwrite=overwrite, refusal=_refusal) as made,
        made.open("w", encoding="utf-8", newline="\n") as file,
    ):
        if heading is not None:
            file.write(heading + "\n")
        file.writelines(line + "\n" for line in lines)


def _refusal(path: Path, reason: str) -> TrajectoryError:
    return TrajectoryError(path, None, reason)

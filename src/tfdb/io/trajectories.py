"""Trajectories: TUM, KITTI and EuRoC files, and the CSV and NPZ that tfdb writes itself.

A trajectory is the motion of one frame in another: stamps and poses `T[parent<-child]`. The files
do not say which frames; :func:`into_buffer` does.
"""

from __future__ import annotations

import io
import math
import re
import stat
import zipfile
import zlib
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, Protocol, TypeAlias

import numpy as np
import numpy.typing as npt

from tfdb._core import poses_of_matrices
from tfdb.errors import InvalidArray, InvalidStamp, InvalidTransform, TrajectoryError
from tfdb.given_objects import refuse_without
from tfdb.given_path import errors_name, given_path
from tfdb.poses import MAX_NORM_ERROR, missing
from tfdb.stamps import shown
from tfdb.tables import COLUMNS, read_parquet
from tfdb.trajectory import Trajectory
from tfdb.types import Columns

from .decimal_time import integer_ns, seconds_to_ns
from .loading import missing_samples, warn_of_forgotten
from .raw_file import MAX_CHUNK

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from tfdb import Buffer

    PathLike: TypeAlias = str | os.PathLike[str]

Stamps: TypeAlias = npt.NDArray[np.int64]
Poses: TypeAlias = npt.NDArray[np.float64]
Format: TypeAlias = Literal["tum", "kitti", "euroc", "csv", "npz", "parquet"]

_NAMES = ("world", "body")
"""The frames of files that name none."""
FORMATS: tuple[Format, ...] = ("tum", "kitti", "euroc", "csv", "npz", "parquet")


class TrajectoryLike(Protocol):
    """Whatever has stamps and poses, such as the result of `Buffer.trajectory`."""

    @property
    def stamps(self) -> Stamps:
        """Nanoseconds, int64, shape (N,)."""

    @property
    def poses(self) -> Poses:
        """Rows `[x y z qx qy qz qw]`, float64, shape (N, 7)."""


def read_trajectory(
    path: PathLike,
    format: Format | None = None,  # noqa: A002 - numpy and pandas call it so, too
    *,
    times: PathLike | None = None,
    target: str | None = None,
    source: str | None = None,
) -> Trajectory:
    """Read a trajectory file.

    Parameters
    ----------
    path
        The file. Quaternions that are slightly off unit length are normalised. A line that repeats
        the stamp of the one before replaces it, as the newer sample does in a store; `repeated` of
        the result counts such lines.
    format
        `"tum"` (`seconds x y z qx qy qz qw`), `"kitti"` (the 12 numbers of a 3x4 matrix, stamps in
        a file of their own), `"euroc"` (`nanoseconds,x,y,z,qw,qx,qy,qz,...`), `"csv"` (columns
        `stamp_ns,x,y,z,qx,qy,qz,qw`, in any order and among others where a heading names them),
        `"npz"` or `"parquet"` (as written by :func:`tfdb.io.write_npz` and
        `Trajectory.to_parquet`); None looks at the beginning of the file. In the last three a pose
        may be missing: all its numbers are NaN, or in a CSV empty.
    times
        KITTI only: the file with one stamp in seconds per pose. By default `NAME_times.txt` or
        `times.txt` beside the poses.
    target, source
        Names for the frames: the poses are `T[target<-source]`. None: those that a Parquet file
        says, else `world` and `body`.

    Raises
    ------
    TrajectoryError
        A line that is not what the format wants, a heading that has the quaternion in another
        order, a rotation that is none, stamps that run backwards, no pose at all. Fields: path,
        line, reason.
    NotSupported
        Parquet, where polars is not installed.
    OSError
        The file cannot be opened.
    """
    given: object = format
    if given is not None and not (isinstance(given, str) and given in FORMATS):
        raise TrajectoryError(
            path, None, f"unknown format {shown(format)}; one of {', '.join(FORMATS)}"
        )
    path = given_path(path, _refusal)
    raw = _read(path)
    if format == "parquet" or (format is None and raw.startswith(b"PAR1")):
        if times is not None:
            reason = "a file of times belongs to KITTI poses, not to parquet"
            raise TrajectoryError(path, None, reason)
        return _read_parquet(path, raw, target, source)
    target, source = target or _NAMES[0], source or _NAMES[1]
    if format == "npz" or (format is None and raw.startswith(b"PK\x03\x04")):
        if times is not None:
            raise TrajectoryError(path, None, "a file of times belongs to KITTI poses, not to npz")
        return _read_npz(path, raw, target, source)
    lines = _Lines(path, raw, target, source)
    kind = _guess(lines) if format is None else format
    if kind == "kitti":
        beside = _find_times(path) if times is None else given_path(times, _refusal)
        return _read_kitti(lines, beside)
    if times is not None:
        raise lines.error(None, f"a file of times belongs to KITTI poses, not to {kind}")
    return _read_rows(lines, _row_of(lines, kind))


def into_buffer(
    buffer: Buffer, parent: str, child: str, trajectory: TrajectoryLike, *, authority: str = ""
) -> int:
    """Store a trajectory as the edge from `parent` to `child`, in one commit.

    The poses are `T[parent<-child]`; rows that are NaN as a whole hold none and are left out.
    Returns the number of the commit. Raises what `Buffer.set_transforms` raises; then nothing was
    stored. A buffer with a limited history (10 s
    by default) drops what is older: a TfdbWarning counts the poses. Store whole trajectories in
    `Buffer(history=None)`.
    """
    refuse_without(buffer, "buffer", "a Buffer", "set_transforms", "history")
    refuse_without(trajectory, "trajectory", "one with stamps and poses", "stamps", "poses")
    stamps = trajectory.stamps
    columns = Columns(parent, child, stamps, trajectory.poses)
    there = ~missing(columns.poses)
    if len(stamps) == len(columns) and not there.all():
        stamps = np.asarray(stamps)[there]
        columns = Columns(parent, child, stamps, columns.poses[there])
    commit = buffer.set_transforms(columns, authority=authority)
    if buffer.history is not None:
        forgotten = missing_samples(buffer, child, stamps)
        if forgotten:
            warn_of_forgotten(buffer, forgotten, 3)
    return commit


def _read(path: Path) -> bytes:
    """The bytes of a file or pipe; a device may have no end."""
    with errors_name(path):
        if stat.S_ISCHR(path.stat().st_mode):
            raise TrajectoryError(path, None, "no regular file")
        return path.read_bytes()


def _refusal(path: Path, reason: str) -> TrajectoryError:
    return TrajectoryError(path, None, reason)


class _Lines:
    """The lines of a text file that carry data, with their numbers."""

    def __init__(self, path: Path, raw: bytes, target: str = "", source: str = "") -> None:
        self.path = path
        self._frames = target, source
        if b"\0" in raw[:4096]:
            what = "a binary file, neither NPZ nor Parquet, and no trajectory in text"
            raise TrajectoryError(path, None, what)
        try:
            self._all = raw.decode("utf-8-sig").split("\n")
        except UnicodeDecodeError as error:
            line = raw.count(b"\n", 0, error.start) + 1
            raise TrajectoryError(path, line, "not UTF-8 text") from None

    def __iter__(self) -> Iterator[tuple[int, str]]:
        for number, line in enumerate(self._all, start=1):
            stripped = line.strip()
            if stripped and not stripped.startswith("#"):
                yield number, stripped

    def headings(self) -> Iterator[tuple[int, str]]:
        """The lines before the first that begins with a number: comments, names of columns."""
        for number, line in enumerate(self._all, start=1):
            if _NUMBER_FIRST.match(line):
                return
            yield number, line.strip().lstrip("#").strip()

    def trajectory(self, stamps: list[int], poses: Poses, repeated: int = 0) -> Trajectory:
        """The result of reading them."""
        return Trajectory(*self._frames, np.array(stamps, dtype=np.int64), poses, repeated=repeated)

    def error(self, line: int | None, reason: str) -> TrajectoryError:
        """An error about one of the lines."""
        return TrajectoryError(self.path, line, reason)


@dataclass(frozen=True)
class _Row:
    """How one line of a format is read: how many columns, and where each of `COLUMNS` stands."""

    layout: str
    separator: str | None
    columns: tuple[int, ...]
    stamp: Callable[[str], int]
    order: tuple[int, ...] = tuple(range(8))
    holes: bool = False


_ROWS: dict[str, _Row] = {
    "tum": _Row("seconds x y z qx qy qz qw", None, (8,), seconds_to_ns),
    # 8 columns with poses alone, 17 with velocity and biases as the dataset ships them.
    "euroc": _Row(
        "nanoseconds,x,y,z,qw,qx,qy,qz", ",", (8, 17), integer_ns, order=(0, 1, 2, 3, 5, 6, 7, 4)
    ),
    "csv": _Row(",".join(COLUMNS), ",", (8,), integer_ns, holes=True),
}
_NUMBER_FIRST = re.compile(r"[\s,;\"']*[-+.]?\d")
_QUATERNION = re.compile(r"\bq(?:\w*_)?([wxyz])\b", re.IGNORECASE)
"""The names that a heading has for the parts of a quaternion: `qx`, `q_x`, `q_RS_x []`."""


def _columns_named(lines: _Lines) -> tuple[str, ...]:
    """The names of columns in the heading of a CSV file; none where there is no such heading."""
    for _number, heading in lines.headings():
        names = tuple(name.strip().strip("\"'") for name in heading.split(","))
        if COLUMNS[0] in names:
            return names
    return ()


def _row_of(lines: _Lines, kind: str) -> _Row:
    """How the lines of a file are read; raises where its heading says something else."""
    row = _ROWS[kind]
    names = _columns_named(lines) if kind == "csv" else ()
    if names:
        if any(names.count(name) != 1 for name in COLUMNS):
            wanted = ", ".join(COLUMNS)
            raise lines.error(None, f"its heading must name each of {wanted} once")
        order = tuple(names.index(name) for name in COLUMNS)
        return replace(row, layout=",".join(names), columns=(len(names),), order=order)
    found = sorted((place, part) for part, place in zip("xyzw", row.order[4:], strict=True))
    expected = "".join(part for _, part in found)
    for number, heading in lines.headings():
        said = "".join(_QUATERNION.findall(heading)).lower()
        if sorted(said) == sorted(expected) and said != expected:
            raise lines.error(
                number,
                f"this heading has the quaternion in the order {' '.join(said)}, but {kind} has "
                f"{' '.join(expected)}; a CSV file may have any: {','.join(COLUMNS)}",
            )
    return row


def _guess(lines: _Lines) -> Format:
    """The format by the heading, or the first line with data."""
    number, first = next(iter(lines), (None, ""))
    if number is None:
        raise lines.error(None, "no pose in it")
    if "," in first and _columns_named(lines):
        return "csv"
    columns = len(first.split(",")) if "," in first else len(first.split())
    if "," in first and columns in _ROWS["euroc"].columns:
        return "euroc"
    if "," not in first and columns == 8:
        return "tum"
    if "," not in first and columns == 12:
        return "kitti"
    raise lines.error(
        number,
        f"{columns} columns are neither TUM (8, by spaces), KITTI (12) nor EuRoC (8 or 17, commas)",
    )


def _read_rows(lines: _Lines, row: _Row) -> Trajectory:
    stamps: list[int] = []
    poses: list[list[float]] = []
    repeated = 0
    for at, (number, line) in enumerate(lines):
        if at == 0 and row.separator and not _NUMBER_FIRST.match(line):
            continue  # names of columns
        fields = line.split(row.separator)
        if len(fields) not in row.columns:
            raise lines.error(number, f"{len(fields)} columns instead of `{row.layout}`")
        fields = [fields[place] for place in row.order]
        try:
            stamp = row.stamp(fields[0].strip())
            missing = row.holes and all(each.strip().lower() in _NOTHING for each in fields[1:])
            pose = [math.nan] * 7 if missing else _floats(fields[1:])
        except ValueError as error:
            raise lines.error(number, str(error)) from None
        norm_squared = sum(value * value for value in pose[3:])
        if abs(norm_squared - 1.0) > MAX_NORM_ERROR:
            raise lines.error(
                number, f"the quaternion is not of unit length: {math.sqrt(norm_squared):.6g}"
            )
        if stamps and stamp <= stamps[-1]:
            if stamp < stamps[-1]:
                raise lines.error(number, _backwards(stamp, stamps[-1]))
            poses[-1] = pose
            repeated += 1
            continue
        stamps.append(stamp)
        poses.append(pose)
    return _with_a_pose(
        lines.path, lines.trajectory(stamps, np.array(poses).reshape(-1, 7), repeated)
    )


_NOTHING = ("", "nan")
"""What a CSV file has for a number of a pose that is missing."""


def _with_a_pose(path: Path, made: Trajectory) -> Trajectory:
    if not len(made):
        raise TrajectoryError(path, None, "no pose in it")
    return made


def _read_npz(path: Path, raw: bytes, target: str, source: str) -> Trajectory:
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            size = sum(each.file_size for each in archive.infolist())
        if size > MAX_CHUNK:
            raise TrajectoryError(path, None, f"its arrays take {size} bytes, above {MAX_CHUNK}")
        with np.load(io.BytesIO(raw), allow_pickle=False) as arrays:
            absent = {"stamps", "poses"} - set(arrays.files)
            if absent:
                reason = f"an NPZ without the array {' and '.join(map(repr, sorted(absent)))}"
                raise TrajectoryError(path, None, reason)
            stamps, poses = arrays["stamps"], arrays["poses"]
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, NotImplementedError) as error:
        raise TrajectoryError(path, None, f"damaged or cut short: {error}") from error
    try:
        made = Trajectory(target, source, stamps, poses)
    except (InvalidArray, InvalidTransform, InvalidStamp) as error:
        raise TrajectoryError(path, None, str(error)) from None
    return _with_a_pose(path, made)


def _read_parquet(path: Path, raw: bytes, target: str | None, source: str | None) -> Trajectory:
    target, source, table = read_parquet(path, target, source, _NAMES, raw)
    try:
        made = Trajectory.from_table(target, source, table)
    except (InvalidArray, InvalidTransform, InvalidStamp) as error:
        raise TrajectoryError(path, None, str(error)) from None
    return _with_a_pose(path, made)


def _floats(fields: list[str]) -> list[float]:
    """Finite numbers; ``ValueError`` with a reason."""
    values = []
    for field in fields:
        try:
            value = float(field)
        except ValueError:
            raise ValueError(f"{field.strip()[:40]!r} is not a number") from None
        if not math.isfinite(value) or "_" in field or not field.isascii():
            raise ValueError(f"{field.strip()[:40]!r} is not a finite number")
        values.append(value)
    return values


def _backwards(stamp: int, previous: int) -> str:
    return f"stamp {stamp} ns does not lie after {previous} ns; sort the file by its stamps first"


def _find_times(path: Path) -> Path:
    candidates = (path.with_name(f"{path.stem}_times.txt"), path.with_name("times.txt"))
    for candidate in candidates:
        if candidate.is_file():
            return candidate
    names = " nor ".join(candidate.name for candidate in candidates)
    raise TrajectoryError(
        path, None, f"KITTI poses carry no stamps: neither {names} is beside it, pass times=..."
    )


def _read_kitti(lines: _Lines, times: Path) -> Trajectory:
    numbers: list[int] = []
    rows: list[list[float]] = []
    for number, line in lines:
        fields = line.split()
        if len(fields) != 12:
            raise lines.error(number, f"{len(fields)} columns instead of the 12 of a 3x4 matrix")
        try:
            rows.append(_floats(fields))
        except ValueError as error:
            raise lines.error(number, str(error)) from None
        numbers.append(number)
    if not rows:
        raise lines.error(None, "no pose in it")
    stamps = _read_times(times)
    if len(stamps) != len(rows):
        raise lines.error(None, f"{len(rows)} poses, but {len(stamps)} stamps in {times}")
    matrices = np.tile(np.eye(4), (len(rows), 1, 1))
    matrices[:, :3] = np.array(rows, dtype=np.float64).reshape(-1, 3, 4)
    try:
        return lines.trajectory(stamps, poses_of_matrices(matrices))
    except InvalidTransform as error:
        reason = f"the left 3x3 part is not a rotation matrix: {error.reason}"
        raise lines.error(numbers[error.index or 0], reason) from None


def _read_times(path: Path) -> list[int]:
    lines = _Lines(path, _read(path))
    stamps: list[int] = []
    for number, line in lines:
        try:
            stamp = seconds_to_ns(line)
        except ValueError as error:
            raise lines.error(number, str(error)) from None
        if stamps and stamp <= stamps[-1]:
            raise lines.error(number, _backwards(stamp, stamps[-1]))
        stamps.append(stamp)
    return stamps

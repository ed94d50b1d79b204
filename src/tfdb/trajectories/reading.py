"""Reads trajectories: TUM, KITTI, EuRoC and CSV files, and tfdb's own NPZ and Parquet files.

A trajectory is the motion of one frame in another: stamps and poses `T[target<-source]`. Most files
do not name the frames; `Trajectory.read(path, target=, source=)` does.
"""

from __future__ import annotations

import io
import stat
import zipfile
import zlib
from collections.abc import Sized
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np

from tfdb._core import poses_of_matrices
from tfdb.data.argument_checks import check_flag, not_one_of
from tfdb.data.decimal_time import NS_PER_SECOND, UNITS, Unit, units_to_ns
from tfdb.data.errors import InvalidArray, InvalidStamp, InvalidTransform, TrajectoryError
from tfdb.data.path_checks import check_path, errors_name
from tfdb.data.poses import doubles
from tfdb.data.stamps import format_seconds

from .columns import layout_of
from .file_formats import FORMATS, Format
from .lines import SALVAGE, Lines, zeros
from .reading_report import TrajectoryRows
from .rows import finish_rows, floats, repair_rows, rows_of_text
from .tables import columns_of, read_parquet

if TYPE_CHECKING:
    import os
    from collections.abc import Callable
    from pathlib import Path

    from .rows import Poses, Stamps

    PathLike: TypeAlias = str | os.PathLike[str]

Made = TypeVar("Made", bound=Sized)
"""`Trajectory`, or a class derived from it."""

_NAMES = ("world", "body")
"""The frame names for files without names."""


MAX_BYTES = 256 * 2**20
"""Largest size in bytes of the arrays of an NPZ file."""


def read_with_rows(
    make: Callable[..., Made],
    path: PathLike,
    format: Format | None = None,  # noqa: A002 - as above
    *,
    times: PathLike | None = None,
    target: str | None = None,
    source: str | None = None,
    salvage: bool = False,
    stamp_unit: Unit | None = None,
    by_row: bool = False,
) -> tuple[Made, TrajectoryRows]:
    """Read a trajectory file as `Trajectory.read`, and count its rows instead of a warning.

    `make`: the class of the result, `Trajectory` or one derived from it.
    `by_row`: KITTI poses without a file of times get their row numbers as stamps in seconds.
    """
    given: object = format
    if given is not None and not (isinstance(given, str) and given in FORMATS):
        raise TrajectoryError(path, None, not_one_of("format", format, FORMATS))
    salvage, unit = check_flag("salvage", salvage), checked_unit(path, stamp_unit)
    path = check_path(path, _refusal)
    raw = _read(path)
    kind: str | None = format
    if kind is None:
        kind = next((name for magic, name in _MAGICS if raw.startswith(magic)), None)
    if kind in ("npz", "parquet"):
        for value, what in ((times, "a file of times belongs to KITTI poses"), (unit, _NO_UNIT)):
            if value is not None:
                raise TrajectoryError(path, None, f"{what}, not to {kind}")
        names = (target, source)
        return (_read_npz if kind == "npz" else _read_table)(
            make, path, raw, names, salvage=salvage
        )
    frames = target or _NAMES[0], source or _NAMES[1]
    lines = Lines(path, raw, salvage=salvage)
    layout = None if kind == "kitti" else layout_of(lines, kind)
    if layout is None:
        beside = _find_times(path) if times is None else check_path(times, _refusal)
        if beside is None and not by_row:
            raise _no_times(path)
        stamps, poses, report = _read_kitti(lines, beside, unit, salvage=salvage)
    elif times is not None:
        raise lines.error(None, f"a file of times belongs to KITTI poses, not to {layout.text}")
    else:
        stamps, poses, report = rows_of_text(lines, layout, unit, salvage=salvage)
    return make(*frames, stamps, poses, repeated=report.repeated), report


_MAGICS = ((b"PAR1", "parquet"), (b"PK\x03\x04", "npz"))
_NO_UNIT = "a unit belongs to stamps in text"


def checked_unit(path: object, unit: Any) -> Unit | None:
    """Return the unit of stamps; raises TrajectoryError for an unknown unit."""
    if unit is None or (isinstance(unit, str) and unit in UNITS):
        return unit
    raise TrajectoryError(path, None, not_one_of("stamp_unit", unit, UNITS))


def kitti_times(path: Path) -> bool | None:
    """Return whether a file of KITTI poses has a file of times beside it; None for other files."""
    raw = _read(path)
    if any(raw.startswith(magic) for magic, _ in _MAGICS):
        return None
    try:
        is_kitti = layout_of(Lines(path, raw, salvage=True), None) is None
    except TrajectoryError:
        return None  # reading the file raises this error again
    return _find_times(path) is not None if is_kitti else None


def _read(path: Path) -> bytes:
    """Read a file or pipe; devices are refused, because they may be endless."""
    with errors_name(path):
        if stat.S_ISCHR(path.stat().st_mode):
            raise TrajectoryError(path, None, "not a regular file")
        return path.read_bytes()


def _refusal(path: Path, reason: str) -> TrajectoryError:
    return TrajectoryError(path, None, reason)


def _read_npz(
    make: Callable[..., Made],
    path: Path,
    raw: bytes,
    names: tuple[str | None, str | None],
    *,
    salvage: bool,
) -> tuple[Made, TrajectoryRows]:
    try:
        with zipfile.ZipFile(io.BytesIO(raw)) as archive:
            size = sum(each.file_size for each in archive.infolist())
        if size > MAX_BYTES:
            raise TrajectoryError(path, None, f"its arrays take {size} bytes, above {MAX_BYTES}")
        with np.load(io.BytesIO(raw), allow_pickle=False) as arrays:
            absent = {"stamps", "poses"} - set(arrays.files)
            if absent:
                reason = f"an NPZ without the array {' and '.join(map(repr, sorted(absent)))}"
                raise TrajectoryError(path, None, reason)
            stamps, poses = arrays["stamps"], arrays["poses"]
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, NotImplementedError) as error:
        raise TrajectoryError(path, None, f"damaged or cut short: {error}") from error
    frames = names[0] or _NAMES[0], names[1] or _NAMES[1]
    return _of_arrays(make, path, frames, stamps, poses, salvage=salvage)


def _read_table(
    make: Callable[..., Made],
    path: Path,
    raw: bytes,
    names: tuple[str | None, str | None],
    *,
    salvage: bool,
) -> tuple[Made, TrajectoryRows]:
    target, source, table = read_parquet(path, *names, _NAMES, raw)
    try:
        stamps, poses = columns_of(table)
    except InvalidArray as error:
        raise TrajectoryError(path, None, str(error)) from None
    return _of_arrays(make, path, (target, source), stamps, poses, salvage=salvage)


def _of_arrays(
    make: Callable[..., Made],
    path: Path,
    frames: tuple[str, str],
    stamps: Any,
    poses: Any,
    *,
    salvage: bool,
) -> tuple[Made, TrajectoryRows]:
    """Make a trajectory from the arrays of a file."""
    report = TrajectoryRows(str(path))
    try:
        if salvage:
            stamps, poses = _arrays(stamps, poses)
            stamps, poses, report = repair_rows(stamps, poses, path)
        made = make(*frames, stamps, poses, repeated=report.repeated)
    except (InvalidArray, InvalidTransform, InvalidStamp) as error:
        hint = "" if salvage else f"; {SALVAGE} reads the other rows"
        raise TrajectoryError(path, None, f"{error}{hint}") from None
    if not len(made):
        raise TrajectoryError(path, None, "no pose in it")
    if not salvage:
        report.rows = report.poses = len(made)
    return made, report


def _arrays(stamps: Any, poses: Any) -> tuple[Stamps, Poses]:
    """Convert arrays for `salvage`; raises InvalidArray for other types and shapes."""
    when = np.asarray(stamps)
    try:
        rows = doubles(poses)
    except (TypeError, ValueError) as error:
        raise InvalidArray(f"poses: {error}", reason=str(error)) from None
    if when.dtype.kind not in "iu" or rows.shape != (len(when), 7):
        reason = f"expected integer nanoseconds (N,) and poses (N, 7), got {when.dtype} "
        reason += f"{when.shape} and {rows.shape}"
        raise InvalidArray(reason, reason=reason)
    return when.astype(np.int64), rows


def _find_times(path: Path) -> Path | None:
    return next((each for each in _times_beside(path) if each.is_file()), None)


def _times_beside(path: Path) -> tuple[Path, Path]:
    return path.with_name(f"{path.stem}_times.txt"), path.with_name("times.txt")


def _no_times(path: Path) -> TrajectoryError:
    names = " nor ".join(each.name for each in _times_beside(path))
    return TrajectoryError(
        path,
        None,
        f"KITTI poses have no stamps, and neither {names} is beside them: give times=..., or "
        "compare without stamps by association='rows' (--association rows)",
    )


def _read_kitti(
    lines: Lines, times: Path | None, unit: Unit | None, *, salvage: bool
) -> tuple[Stamps, Poses, TrajectoryRows]:
    """Read the poses and their stamps, row by row; an invalid row also drops its stamp."""
    report = TrajectoryRows(str(lines.path), rows=len(lines.rows))
    if not lines.rows:
        raise lines.error(None, "no pose in it")
    count = len(lines.rows)
    when: list[int | None] = [row * NS_PER_SECOND for row in range(count)]
    if times is not None:
        when = _read_times(times, unit, report, salvage=salvage)
    for number, line in () if salvage else lines.rows:
        broken = zeros(line)
        if broken is not None:
            raise lines.skippable(number, broken)
    if len(when) != count and not salvage:
        raise lines.error(None, f"{count} poses, but {len(when)} stamps in {times}")
    kept: list[int] = []
    rows: list[list[float]] = []
    for row, (number, line) in enumerate(lines.rows):
        reason = _kitti_reason(line)
        if reason is None and (row >= len(when) or when[row] is None):
            reason = f"no stamp in row {row + 1} of {times}"
        if reason is None:
            kept.append(row)
            rows.append(floats(line.split()))
        elif salvage:
            report.skip(number, len(line) + 1, reason)
        else:
            raise lines.skippable(number, reason)
    poses = _kitti_poses(rows, lines, kept, report, salvage=salvage)
    stamps = np.array([when[row] for row in kept], dtype=np.int64)
    numbers = [lines.rows[row][0] for row in kept]
    return (*finish_rows(stamps, poses, report, numbers, salvage=salvage), report)


def _kitti_reason(line: str) -> str | None:
    """Describe why a line is not a 3x4 matrix."""
    broken = zeros(line)
    if broken is not None:
        return broken
    fields = line.split()
    if len(fields) != 12:
        return f"{len(fields)} columns instead of the 12 of a 3x4 matrix"
    try:
        floats(fields)
    except ValueError as error:
        return str(error)
    return None


def _kitti_poses(
    rows: list[list[float]],
    lines: Lines,
    kept: list[int],
    report: TrajectoryRows,
    *,
    salvage: bool,
) -> Poses:
    """Convert 3x4 matrices to poses; with `salvage`, invalid rotations are removed from `kept`."""
    matrices = np.tile(np.eye(4), (len(rows), 1, 1))
    matrices[:, :3] = np.array(rows, dtype=np.float64).reshape(-1, 3, 4)
    try:
        return poses_of_matrices(matrices)
    except InvalidTransform as error:
        if not salvage:
            reason = f"the left 3x3 part is not a rotation matrix: {error.reason}"
            raise lines.skippable(lines.rows[kept[error.index or 0]][0], reason) from None
    poses: list[Poses] = []
    fine: list[int] = []
    for row, matrix in zip(kept, matrices, strict=True):
        try:
            poses.append(poses_of_matrices(matrix[np.newaxis])[0])
            fine.append(row)
        except InvalidTransform as error:
            number, line = lines.rows[row]
            reason = f"the left 3x3 part is not a rotation matrix: {error.reason}"
            report.skip(number, len(line) + 1, reason)
    kept[:] = fine
    return np.array(poses, dtype=np.float64).reshape(-1, 7)


def _read_times(
    path: Path, unit: Unit | None, report: TrajectoryRows, *, salvage: bool
) -> list[int | None]:
    """Read the stamps of a file of times; with `salvage`, an invalid row is None."""
    lines = Lines(path, _read(path), salvage=salvage)
    rows = [*([] if lines.heading is None else [lines.heading]), *lines.rows]
    stamps: list[int | None] = []
    last = -1
    for number, line in rows:
        reason, stamp = zeros(line), 0
        if reason is None:
            try:
                stamp = units_to_ns(line, unit or "s")
                reason = (
                    f"stamp {format_seconds(stamp)} follows {format_seconds(last)}"
                    if stamp <= last
                    else None
                )
            except ValueError as error:
                reason = str(error)
        if reason is None:
            stamps.append(stamp)
            last = stamp
        elif salvage:
            stamps.append(None)
        else:
            raise lines.skippable(number, reason)
    if len(stamps) > report.rows:
        report.notes.append(f"{len(stamps):,} stamps in {path}, but {report.rows:,} poses")
    return stamps

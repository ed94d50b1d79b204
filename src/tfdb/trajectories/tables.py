"""Trajectories as tables: pandas, polars, Arrow, Parquet. `pip install 'tfdb[tables]'`."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

from tfdb.data.errors import InvalidArray, NotSupported, TrajectoryError
from tfdb.data.new_file import new_file
from tfdb.data.poses import doubles

if TYPE_CHECKING:
    import os

    import numpy as np
    import numpy.typing as npt
    import pandas as pd
    import polars as pl

    Stamps = npt.NDArray[np.int64]
    Poses = npt.NDArray[np.float64]

__all__: list[str] = []

COLUMNS = ("stamp_ns", "x", "y", "z", "qx", "qy", "qz", "qw")
"""Nanoseconds, metres, unit quaternion; a missing pose is NaN in all but the stamp."""
_NAMES = ("tfdb.target", "tfdb.source")


def as_pandas(stamps: Stamps, poses: Poses) -> pd.DataFrame:
    """Make a DataFrame of pandas."""
    try:
        import pandas as pd  # noqa: PLC0415 - most programs do without
    except ImportError as error:
        raise _missing("to_pandas", "pandas") from error
    table: pd.DataFrame = pd.DataFrame(_columns(stamps, poses))
    return table


def as_polars(stamps: Stamps, poses: Poses, who: str = "to_polars") -> pl.DataFrame:
    """Make a DataFrame of polars."""
    table: pl.DataFrame = _polars(who).DataFrame(_columns(stamps, poses))
    return table


def as_records(stamps: Stamps, poses: Poses) -> npt.NDArray[np.void]:
    """Make a structured array of numpy."""
    import numpy as np

    types = [(name, np.int64 if name == COLUMNS[0] else np.float64) for name in COLUMNS]
    made: npt.NDArray[np.void] = np.empty(len(stamps), types)
    for name, column in _columns(stamps, poses).items():
        made[name] = column
    return made


def write_parquet(
    path: str | os.PathLike[str],
    frames: tuple[str, str],
    stamps: Stamps,
    poses: Poses,
    *,
    overwrite: bool = False,
) -> None:
    """Write a Parquet file; the names of target and source go into its metadata."""
    table = as_polars(stamps, poses, "a Parquet file")
    names = dict(zip(_NAMES, frames, strict=True))
    with new_file(path, overwrite=overwrite) as made:
        table.write_parquet(made, metadata=names)


def read_parquet(
    path: str | os.PathLike[str],
    target: str | None,
    source: str | None,
    otherwise: tuple[str, str],
    raw: bytes,
) -> tuple[str, str, Any]:
    """Read a Parquet file: target and source, from its metadata if not given, and the table.

    `otherwise`: their names if neither has them; `raw`: the content of the file.
    """
    pl = _polars("a Parquet file")
    try:
        names = pl.read_parquet_metadata(io.BytesIO(raw))
        table = pl.read_parquet(raw)
    except (pl.exceptions.PolarsError, ValueError) as error:
        raise trajectory_error(path, f"no Parquet file, or damaged: {error}") from error
    names = {**dict(zip(_NAMES, otherwise, strict=True)), **names}
    target = names[_NAMES[0]] if target is None else target
    source = names[_NAMES[1]] if source is None else source
    return target, source, table


def _columns(stamps: Stamps, poses: Poses) -> dict[str, Any]:
    return dict(zip(COLUMNS, (stamps, *poses.T), strict=True))


def trajectory_error(path: object, reason: str) -> TrajectoryError:
    """Make the error of a file."""
    return TrajectoryError(path, None, reason)


def columns_of(table: Any) -> tuple[Any, Any]:
    """Return stamps and poses (N, 7) of an object that returns columns by name."""
    import numpy as np

    taken: list[Any] = []
    for name in COLUMNS:
        try:
            taken.append(table[name])
        except Exception as error:  # each library raises other errors
            wanted = ", ".join(COLUMNS)
            reason = f"no column {name!r} in a {type(table).__name__}; a trajectory has {wanted}"
            raise InvalidArray(reason, reason=reason) from error
    try:
        poses = np.stack([doubles(column) for column in taken[1:]], axis=1)
    except (TypeError, ValueError) as error:
        reason = f"columns {', '.join(COLUMNS[1:])}: expected float64, all of one length ({error})"
        raise InvalidArray(reason, reason=reason) from error
    return taken[0], poses


def _polars(who: str) -> Any:
    try:
        import polars as pl  # noqa: PLC0415 - most programs do without
    except ImportError as error:
        raise _missing(who, "polars") from error
    return pl


def _missing(who: str, package: str) -> NotSupported:
    return NotSupported(f"{who} needs {package}: pip install 'tfdb[tables]'")

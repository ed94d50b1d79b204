"""Poses over time, and the files that hold them: TUM, KITTI, EuRoC, CSV, NPZ, Parquet."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.lazy_names import on_demand as _offer

if TYPE_CHECKING:
    from .reading_report import TrajectoryRows
    from .writing import (
        write_csv,
        write_euroc,
        write_kitti,
        write_npz,
        write_parquet,
        write_tum,
    )

__all__ = [
    "TrajectoryRows",
    "write_csv",
    "write_euroc",
    "write_kitti",
    "write_npz",
    "write_parquet",
    "write_tum",
]

if not TYPE_CHECKING:  # with `__getattr__`, type checkers would accept any name
    __getattr__, __dir__ = _offer(
        __name__,
        {
            "reading_report": ("TrajectoryRows",),
            "writing": (
                "write_csv",
                "write_euroc",
                "write_kitti",
                "write_npz",
                "write_parquet",
                "write_tum",
            ),
        },
    )

"""Names of the formats of trajectory files."""

from __future__ import annotations

from typing import Literal, TypeAlias

__all__: list[str] = []

Format: TypeAlias = Literal["tum", "kitti", "euroc", "csv", "npz", "parquet"]
FORMATS: tuple[Format, ...] = ("tum", "kitti", "euroc", "csv", "npz", "parquet")

"""Recordings in files that are compressed with zstd, as by rosbag2."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from tfdb.data.errors import RecordingError
from tfdb.data.loss import Loss
from tfdb.data.new_file import temporary_folder

from .bag_reader import open_bag
from .containers import Container, kind_of, typed_errors
from .db3_reader import open_db3
from .mcap_reader import open_mcap
from .raw_file import unpack_file

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from .containers import Kind

_INNER: dict[Kind, Callable[..., Container]] = {
    "bag": open_bag,
    "db3": open_db3,
    "mcap": open_mcap,
}


def _opener(file: Path) -> Callable[..., Container]:
    kind = kind_of(file)
    if kind not in _INNER:
        raise RecordingError(file, "compressed with zstd, but not a recording")
    return _INNER[kind]


def open_packed(path: Path, *, salvage: bool = False) -> Container:
    """Unpack a file and open the recording in it; raises `RecordingError`.

    The unpacked file is already deleted; its data last as long as the container.
    """
    with temporary_folder() as folder:
        file = folder / path.stem
        with typed_errors(path):
            lost = unpack_file(path, file, salvage=salvage)
        try:
            made = _opener(file)(file, salvage=salvage)
        except RecordingError as error:
            raise RecordingError(path, str(error.reason)) from error
    made.path = path
    losses = [replace(loss, path=str(path)) for loss in made.losses]
    made.losses = (*losses, Loss(str(path), lost, 0, 0)) if lost else tuple(losses)
    return made

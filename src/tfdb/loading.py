"""Recordings into a store."""

from __future__ import annotations

import os
import warnings
from typing import TYPE_CHECKING, TypeAlias

from .errors import InvalidArgument, RecordingError, TfdbWarning
from .given_path import given_paths
from .summary import clocks, describe_clocks

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence
    from pathlib import Path

    from ._core import Buffer
    from .io import LoadReport
    from .types import FrameInfo

    Paths: TypeAlias = str | os.PathLike[str] | Sequence[str | os.PathLike[str]]
    Topics: TypeAlias = str | Iterable[str] | Mapping[str, str]
    Progress: TypeAlias = Callable[[int, int], None]

__all__ = ["load"]


def load_into(
    self: Buffer,
    path: Paths,
    *,
    topics: Topics | None,
    progress: Progress | None,
    salvage: bool,
) -> LoadReport:
    """Do what `Buffer.load` says."""
    from .io import load_recordings  # noqa: PLC0415 - recordings need optional packages

    paths = _each_once(path)
    before = self.tree()
    report = load_recordings(self, paths, topics=topics, progress=progress, salvage=salvage)
    _warn(report.files, before, self.tree())
    return report


def _each_once(given: Paths) -> list[Path]:
    """List the paths; refuse one that comes twice."""
    paths = given_paths(given, RecordingError)
    seen: set[str] = set()
    for path in paths:
        real = os.path.realpath(path)
        if real in seen:
            raise InvalidArgument(f"{path} is given twice", path=str(path))
        seen.add(real)
    return paths


def _warn(files: Sequence[str], before: Sequence[FrameInfo], after: Sequence[FrameInfo]) -> None:
    """Warn of what is hardly meant: the same data again, another clock than that of the rest."""
    if any(i.samples for i in before if not i.is_static) and _extent(before) == _extent(after):
        message = f"{', '.join(files)}: every sample was in the store before; loaded twice?"
        warnings.warn(message, TfdbWarning, stacklevel=4)
    several = describe_clocks(clocks(after))
    if several and len(clocks(before)) < len(clocks(after)):
        warnings.warn(f"{', '.join(files)}: {several}", TfdbWarning, stacklevel=4)


def _extent(infos: Sequence[FrameInfo]) -> set[tuple[object, ...]]:
    """What changes wherever a sample is added."""
    return {(i.name, i.parent, i.samples, i.oldest, i.newest) for i in infos}


def load(
    path: Paths,
    *,
    topics: Topics | None = None,
    progress: Progress | None = None,
    salvage: bool = False,
) -> Buffer:
    """Load recordings into a new buffer that keeps everything; arguments as in `Buffer.load`."""
    from ._core import Buffer  # noqa: PLC0415 - the extension imports this module

    buffer = Buffer(history=None)
    load_into(buffer, path, topics=topics, progress=progress, salvage=salvage)
    return buffer

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
    topics: Topics | None = None,
    progress: Progress | None = None,
    salvage: bool = False,
) -> LoadReport:
    """Load the transforms of recordings: `.bag`, `.db3`, `.mcap`, folders of ROS 2 bags.

    The files are read whole before the first commit. Then each message is one commit, in the order
    of its reception; one that is refused is counted and skipped. A buffer with a limited history
    (10 s by default) forgets the beginning of a long recording: the report counts the samples, and
    a TfdbWarning says so. `Buffer(history=None)` and `tfdb.load` keep everything.

    Parameters
    ----------
    path
        One recording or several; they are read in the order of their start.
    topics
        Which topics to read; None: all that hold transforms. A mapping renames them, as in
        `{"/robot1/tf": "tf", "/robot1/tf_static": "tf_static"}`; a new name ends in `tf` or
        `tf_static`. Transforms are static when the last part of the topic's name is `tf_static`.
    progress
        Called with (done, total); each message counts once when read and once when stored.
    salvage
        Read damaged, cut and unindexed files as far as they go, and bag folders without the files
        that are missing; the report says what was lost.

    Returns
    -------
    LoadReport
        What was read, stored, refused, forgotten and lost.

    Raises
    ------
    RecordingError
        A file is no recording, damaged or cut short; a topic is missing or holds no transforms.
        Nothing was stored.
    InvalidArgument
        No path, an empty one, a file that is given twice, or topics that are no names.
    OSError
        A file cannot be opened.

    Warns
    -----
    TfdbWarning
        All of it was in the store before; or its stamps and those of the rest are more than a year
        apart, as those of a simulated and of a real clock; or samples were forgotten.
    """
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
        warnings.warn(message, TfdbWarning, stacklevel=3)
    several = describe_clocks(clocks(after))
    if several and len(clocks(before)) < len(clocks(after)):
        warnings.warn(f"{', '.join(files)}: {several}", TfdbWarning, stacklevel=3)


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

"""Recordings into a store."""

from __future__ import annotations

import os
import warnings
from typing import TYPE_CHECKING

from tfdb.data.argument_checks import given_flag
from tfdb.data.errors import InvalidArgument, RecordingError, TfdbWarning
from tfdb.data.path_checks import given_paths
from tfdb.store.summary import clocks, describe_clocks

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence
    from pathlib import Path
    from typing import Literal, Unpack

    from tfdb._core import Buffer
    from tfdb.data.stamps import StampLike
    from tfdb.data.types import FrameInfo, Paths, PoseTopics, Progress, Topics
    from tfdb.robots.robot_model import RobotModel

    from .choice import LoadOptions
    from .loading import LoadReport


__all__ = ["load"]


def load_into(
    self: Buffer,
    path: Paths,
    *,
    topics: Topics | None,
    progress: Progress | None,
    salvage: bool,
    **options: Unpack[LoadOptions],
) -> LoadReport:
    """Do what `Buffer.load` says."""
    from .loading import load_recordings  # noqa: PLC0415 - many programs read none

    paths = _each_once(path)
    before = self.tree()
    clocks_before = len(clocks(before, self))
    report = load_recordings(
        self, paths, topics=topics, progress=progress, salvage=salvage, **options
    )
    _warn(report.files, before, clocks_before, self, 4)
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


def _warn(
    files: Sequence[str],
    before: Sequence[FrameInfo],
    clocks_before: int,
    store: Buffer,
    depth: int,
) -> None:
    """Warn of what is hardly meant: the same data again, another clock than that of the rest.

    `depth` frames up is who asked for it.
    """
    after = store.tree()
    if any(i.samples for i in before if not i.is_static) and _extent(before) == _extent(after):
        message = f"{', '.join(files)}: every sample was in the store before; loaded twice?"
        warnings.warn(message, TfdbWarning, stacklevel=depth)
    found = clocks(after, store)
    several = describe_clocks(found)
    if several and clocks_before < len(found):
        warnings.warn(f"{', '.join(files)}: {several}", TfdbWarning, stacklevel=depth)


def _extent(infos: Sequence[FrameInfo]) -> set[tuple[object, ...]]:
    """What changes wherever a sample is added."""
    return {(i.name, i.parent, i.samples, i.oldest, i.newest) for i in infos}


def load(
    path: Paths,
    *,
    topics: Topics | None = None,
    progress: Progress | None = None,
    salvage: bool = False,
    start: StampLike | str | None = None,
    end: StampLike | str | None = None,
    frames: str | Iterable[str] | None = None,
    exclude: str | Iterable[str] = (),
    keep: float | None = None,
    rename: Mapping[str, str] | None = None,
    prefix: str = "",
    pose_topics: PoseTopics | None = None,
    urdf: str | os.PathLike[str] | RobotModel | None = None,
    joint_topic: str | None = None,
    by_namespace: bool = False,
    mix: bool = False,
    stamp_unit: Literal["s", "ms", "us", "ns"] | None = None,
    cache: bool = False,
) -> Buffer:
    """Load recordings into a new buffer that keeps everything.

    Parameters
    ----------
    path, topics, progress, salvage, start, end, frames, exclude, keep, rename, prefix,
    pose_topics, urdf, joint_topic, by_namespace, mix, stamp_unit
        As in `Buffer.load`.
    cache
        Keep the loaded data as a frozen store, and open it the next time: it takes as long as to
        read the file once. It lies beside the recording, as `drive.mcap.tfdb`, or in
        `$XDG_CACHE_HOME/tfdb` (`~/.cache/tfdb`) where that folder cannot be written. It is used as
        long as the recording has the same size and time, or the same content; it is made anew where
        it is stale, damaged, or of another version of tfdb. What is loaded with other options,
        and what from several files, is kept apart.

    Returns
    -------
    Buffer
        With `cache` a frozen one, to which nothing can be written (but see below).

    Raises
    ------
    StoreExists
        With `cache`, where a file has that name that is not what this keeps: it is never replaced.

    And as `Buffer.load`.

    Warns
    -----
    TfdbWarning
        As `Buffer.load`; with `cache` also where no folder is writable. Then nothing is kept,
        and the buffer is not frozen.
    """
    from tfdb._core import Buffer  # noqa: PLC0415 - the extension imports this module

    options: LoadOptions = {
        "start": start,
        "end": end,
        "frames": frames,
        "exclude": exclude,
        "keep": keep,
        "rename": rename,
        "prefix": prefix,
        "pose_topics": pose_topics,
        "urdf": urdf,
        "joint_topic": joint_topic,
        "by_namespace": by_namespace,
        "mix": mix,
        "stamp_unit": stamp_unit,
    }
    paths = _each_once(path)
    cache, salvage = given_flag("cache", cache), given_flag("salvage", salvage)
    if not cache or not paths:
        buffer = Buffer(history=None)
        load_into(buffer, paths, topics=topics, progress=progress, salvage=salvage, **options)
        return buffer
    from .cache import Cache  # noqa: PLC0415 - most programs need none
    from .choice import Choice  # noqa: PLC0415

    choice = Choice(**options)
    cached = Cache(paths, topics, choice.key, salvage=salvage)
    found = cached.open()
    if found is not None:
        _warn([str(each) for each in paths], (), 0, found, 3)
        return found
    buffer = Buffer(history=None)
    load_into(buffer, paths, topics=cached.topics, progress=progress, salvage=salvage, **options)
    return cached.keep(buffer)

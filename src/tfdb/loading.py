"""Recordings into a store."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from ._core import Buffer
    from .io import LoadReport

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
) -> LoadReport:
    """Load the transforms of recordings: `.bag`, `.db3`, `.mcap`, folders of ROS 2 bags.

    The files are read whole before the first commit. Then each message is one commit, in the order
    of its reception; one that is refused is counted and skipped. A buffer with a limited history
    forgets the beginning of a long recording: `tfdb.load` keeps everything.

    Parameters
    ----------
    path
        One recording or several; they are read in the order of their start.
    topics
        Which topics to read; None: all that hold transforms. A mapping renames them, as in
        `{"/robot1/tf": "tf", "/robot1/tf_static": "tf_static"}`. Transforms are static when the
        last part of the topic's (new) name is `tf_static`.
    progress
        Called with (done, total); each message counts once when read and once when stored.

    Returns
    -------
    LoadReport
        What was read, stored and refused.

    Raises
    ------
    RecordingError
        A file is no recording, damaged or cut short; a topic is missing or holds no transforms.
        Nothing was stored.
    """
    from .io import load_recordings  # noqa: PLC0415 - recordings need optional packages

    return load_recordings(self, path, topics=topics, progress=progress)


def load(path: Paths, *, topics: Topics | None = None, progress: Progress | None = None) -> Buffer:
    """Load recordings into a new buffer that keeps everything; arguments as in `Buffer.load`."""
    from ._core import Buffer  # noqa: PLC0415 - the extension imports this module

    buffer = Buffer(history=None)
    load_into(buffer, path, topics=topics, progress=progress)
    return buffer

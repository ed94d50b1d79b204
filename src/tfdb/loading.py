"""Recordings into a store."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import os
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from ._core import Buffer
    from .io import LoadReport

__all__ = ["load"]


def load_into(
    self: Buffer,
    path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    topics: Iterable[str] | Mapping[str, bool] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> LoadReport:
    """Load the transforms of one or more recordings (`.bag`, `.db3`, `.mcap`).

    Parameters
    ----------
    path
        A file, a folder of a ROS 2 bag, or several of them in order.
    topics
        Topics to read; with a mapping, whether each is static. None: /tf and /tf_static.
    progress
        Called now and then with the bytes read and the bytes in all.

    Returns
    -------
    LoadReport
        What was read, stored and refused.

    Raises
    ------
    RecordingError
        A file that cannot be read. What was stored before it stays.
    """
    from .io import load_recordings  # noqa: PLC0415 - recordings need optional packages

    return load_recordings(self, path, topics=topics, progress=progress)


def load(
    path: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
    *,
    topics: Iterable[str] | Mapping[str, bool] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Buffer:
    """Load recordings into a new buffer that keeps everything; arguments as in `Buffer.load`."""
    from ._core import Buffer  # noqa: PLC0415 - the extension imports this module

    buffer = Buffer(history=None)
    load_into(buffer, path, topics=topics, progress=progress)
    return buffer

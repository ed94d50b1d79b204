"""Writes recordings of a store, or of any stream of transforms."""

from __future__ import annotations

import operator
from itertools import groupby, pairwise
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from tfdb import _core
from tfdb.data.argument_checks import refuse_without
from tfdb.data.errors import InvalidStamp, RecordingError
from tfdb.data.types import TransformStamped
from tfdb.store.summary import static_edges

from .recording_writer import RecordingWriter

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    import numpy.typing as npt

    from tfdb._core import Buffer, Snapshot, StoreReader

    from .recording import PathLike

    Batch: TypeAlias = tuple[int, str, list[TransformStamped]]
    Progress: TypeAlias = Callable[[int, int], None]

_TOPIC = "/tf"
_STATIC_TOPIC = "/tf_static"
_PROGRESS_EVERY = 1024
# Receive time without moving edges: bags cannot hold time 0.
_NO_STAMP = 1


def write_recording(
    path: PathLike,
    store: Buffer | Snapshot,
    *,
    compress: bool = False,
    overwrite: bool = False,
    progress: Progress | None = None,
) -> int:
    """Write all transforms of one snapshot of a store to a `.bag`, `.mcap` or `.db3` file.

    Static transforms come first, in one message on `/tf_static`. Then all samples of one stamp make
    one message on `/tf`, in the order of stamps. In bags each authority has its own messages and
    becomes a publishing node. The receive time of a message is its stamp. The file appears under
    its name when it is complete.

    Parameters
    ----------
    path
        A name that ends in `.bag` (ROS 1), `.mcap` or `.db3` (ROS 2).
    store
        The store to write.
    compress
        zstd for MCAP, bz2 for bags.
    overwrite
        Replace an existing file.
    progress
        Called with (samples written, samples in all).

    Returns
    -------
    int
        Messages written.

    Raises
    ------
    RecordingError
        An unknown extension, an existing file, nothing to write, or a missing library.
    InvalidStamp
        A stamp beyond the range of the file's encoding.
    OSError
        The file cannot be written.
    """
    if isinstance(store, _core.Buffer):
        with store.snapshot() as snapshot:
            return write_recording(
                path, snapshot, compress=compress, overwrite=overwrite, progress=progress
            )
    fixed = _static_transforms(store)
    moving = _Samples(store)
    if not fixed and not len(moving):
        raise RecordingError(path, "the store holds no transform to write")
    messages = samples = 0
    with RecordingWriter(path, compress=compress, overwrite=overwrite) as writer:
        for authority, batch in fixed.items():
            data = _core.encode_tf_message(batch, writer.encoding)
            writer.write(data, moving.start, topic=_STATIC_TOPIC, static=True, authority=authority)
            messages += 1
        for stamp, authority, batch in moving.batches(by_authority=writer.encoding == "ros1"):
            data = _core.encode_tf_message(batch, writer.encoding)
            writer.write(data, stamp, topic=_TOPIC, authority=authority)
            messages += 1
            samples += len(batch)
            if progress is not None and messages % _PROGRESS_EVERY == 0:
                progress(samples, len(moving))
    if progress is not None:
        progress(samples, len(moving))
    return messages


def write_transforms(
    path: PathLike,
    transforms: Iterable[TransformStamped],
    static: Iterable[TransformStamped] = (),
    *,
    compress: bool = False,
    overwrite: bool = False,
) -> int:
    """Write a stream of transforms to a `.bag`, `.mcap` or `.db3` file; returns the messages.

    `static` goes to `/tf_static` in one message. `transforms` goes to `/tf`: consecutive ones with
    the same stamp make one message, with that receive time. Stamps are integer nanoseconds. Other
    parameters and errors as in `write_recording`.
    """
    for name, given in (("transforms", transforms), ("static", static)):
        refuse_without(given, name, "an iterable of TransformStamped", "__iter__")
    fixed = list(static)
    messages = 0
    with RecordingWriter(path, compress=compress, overwrite=overwrite) as writer:

        def write(batch: list[TransformStamped], stamp: int, topic: str) -> None:
            data = _core.encode_tf_message(batch, writer.encoding)
            writer.write(data, stamp, topic=topic, static=topic == _STATIC_TOPIC)

        for stamp, batch in groupby(transforms, key=_integer_stamp):
            if fixed and not messages:
                write(fixed, stamp, _STATIC_TOPIC)
                messages += 1
            write(list(batch), stamp, _TOPIC)
            messages += 1
        if fixed and not messages:
            write(fixed, _NO_STAMP, _STATIC_TOPIC)
            messages += 1
        if not messages:
            raise RecordingError(path, "no transform to write")
    return messages


def _integer_stamp(transform: TransformStamped) -> int:
    refuse_without(transform, "each of transforms", "a TransformStamped", "stamp")
    try:
        return operator.index(transform.stamp)  # type: ignore[arg-type]
    except TypeError:
        message = f"a stream's stamps are integer nanoseconds, got {transform.stamp!r}"
        raise InvalidStamp(message, value=transform.stamp) from None


def _static_transforms(store: StoreReader) -> dict[str, list[TransformStamped]]:
    """Return the static edges by authority."""
    found: dict[str, list[TransformStamped]] = {}
    refuse_without(store, "store", "a Buffer or Snapshot", "tree", "samples")
    for info, parent, pose in static_edges(store):
        transform = TransformStamped(parent, info.name, 0, pose[:3], pose[3:])
        found.setdefault(info.authority, []).append(transform)
    return found


class _Samples:
    """All moving samples of a store as columns."""

    def __init__(self, store: StoreReader) -> None:
        infos = [info for info in store.tree() if info.oldest is not None]
        columns = [store.samples(info.name) for info in infos]
        self._children = [info.name for info in infos]
        self._parents = [parents for _, _, parents in columns]
        self._authorities = [info.authority for info in infos]
        self._stamps = np.concatenate(
            [np.empty(0, np.int64), *(stamps for stamps, _, _ in columns)]
        )
        self._poses = np.concatenate([np.empty((0, 7)), *(poses for _, poses, _ in columns)])
        counts = [len(stamps) for stamps, _, _ in columns]
        self._edges = np.repeat(np.arange(len(infos)), counts)
        self._rows = np.concatenate([np.empty(0, np.int64), *map(np.arange, counts)])
        self.start = int(self._stamps.min()) if len(self) else _NO_STAMP

    def __len__(self) -> int:
        return len(self._stamps)

    def batches(self, *, by_authority: bool) -> Iterator[Batch]:
        """Yield stamp, authority and transforms of each message, sorted by stamp."""
        names = sorted(set(self._authorities)) if by_authority else [""]
        writer_of_edge = [names.index(who) if by_authority else 0 for who in self._authorities]
        writers = np.array(writer_of_edge, dtype=np.int64)[self._edges]
        order = np.lexsort((self._edges, writers, self._stamps))
        stamps, writers = self._stamps[order], writers[order]
        new = (np.diff(stamps) != 0) | (np.diff(writers) != 0)
        bounds = [0, *(np.flatnonzero(new) + 1).tolist(), len(order)]
        for first, last in pairwise(bounds):
            if first < last:
                stamp = int(stamps[first])
                batch = self._transforms(stamp, order[first:last])
                yield stamp, names[int(writers[first])], batch

    def _transforms(self, stamp: int, rows: npt.NDArray[np.int64]) -> list[TransformStamped]:
        edges, places = self._edges[rows].tolist(), self._rows[rows].tolist()
        return [
            TransformStamped(
                self._parents[edge][place], self._children[edge], stamp, pose[:3], pose[3:]
            )
            for edge, place, pose in zip(edges, places, self._poses[rows].tolist(), strict=True)
        ]

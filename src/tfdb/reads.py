"""Reads of buffers, snapshots and transactions that are written in Python.

The methods import their implementations when they are called, so `import tfdb` is fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from tfdb import _core

if TYPE_CHECKING:
    import os
    from typing import Literal

    from tfdb._core import Policy, StoreReader
    from tfdb.data.stamps import StampLike
    from tfdb.store.explain import Explanation
    from tfdb.trajectories.trajectory import Trajectory

__all__ = ["Freezable", "SharedReads", "Snapshot", "Transaction"]


class SharedReads:
    """Reads of buffers, snapshots and transactions."""

    __slots__ = ()

    def explain(
        self,
        target: str,
        source: str,
        stamp: StampLike | None = None,
        policy: Policy | None = None,
    ) -> Explanation:
        """Explain why `lookup_transform` with these arguments has an answer or fails.

        It describes each edge of the path: the samples that are used, or why none is valid and
        which stamps would be. All reads are from one snapshot.

        Parameters
        ----------
        target, source
            Frame names.
        stamp
            Stamp in nanoseconds; None: the latest common time.
        policy
            As in `lookup_transform`.

        Returns
        -------
        Explanation
            Its str() is the text.

        Raises
        ------
        InvalidStamp, SnapshotTooOld, SnapshotClosed
        """
        from tfdb.store.explain import explain_lookup

        return explain_lookup(_reads(self), target, source, stamp, policy)

    def trajectory(
        self,
        target: str,
        source: str,
        rate: float | None = None,
        start: StampLike | str | None = None,
        end: StampLike | str | None = None,
        policy: Policy | None = None,
        *,
        missing: Literal["raise", "nan", "skip"] = "raise",
    ) -> Trajectory:
        """Sample T[target<-source] over time, all from one snapshot.

        Parameters
        ----------
        target, source
            Frame names.
        rate
            Poses per second from `start` on. None: at the stored stamps of the path.
        start, end
            First and last stamp, nanoseconds. None: where every moving edge has data. Or text, as
            in `tfdb.recordings.Selection`: `"+1.5"` is 1.5 s after the store's first moving stamp,
            `"-2"` 2 s before its last.
        policy
            How stamps between samples are answered. None: Interpolate().
        missing
            What happens at a stamp without a pose. `raise`: its error is raised, with its `index`.
            `nan`: its pose is NaN. `skip`: it is left out; if no pose is left, the first error is
            raised. Frames without a path always raise, unless rate, start and end are all given.

        Returns
        -------
        Trajectory
            With stamps (N,) and poses (N, 7).

        Raises
        ------
        InvalidArgument
            The rate is not positive, `end` is before `start`, or `missing` is another word. Without
            a rate: no stored stamp from `start` to `end`. Without `start` and `end`: no edge of the
            path moves.
        Extrapolation, and the other errors of `lookup_transforms`
            With `index`, the position of the stamp.
        """
        from tfdb.store.sampling import sample
        from tfdb.trajectories.trajectory import Trajectory

        made = sample(_reads(self), target, source, rate, start, end, policy, missing)
        return Trajectory._made(target, source, *made)

    def children(self, name: str, stamp: StampLike | None = None) -> list[str]:
        """List the direct children of a frame, sorted.

        Parameters
        ----------
        name
            The frame.
        stamp
            Nanoseconds: the children at that stamp, by `parent_of`. None: the newest tree.

        Raises
        ------
        UnknownFrame, InvalidStamp, SnapshotTooOld, SnapshotClosed
        """
        from tfdb.store.forest import children as find

        return find(_reads(self), name, stamp)

    def descendants(self, name: str, stamp: StampLike | None = None) -> list[str]:
        """List all frames below a frame, depth first, siblings sorted.

        Parameters
        ----------
        name, stamp
            As in `children`.

        Raises
        ------
        The errors of `children`.
        """
        from tfdb.store.forest import descendants as find

        return find(_reads(self), name, stamp)

    def path(self, target: str, source: str, stamp: StampLike | None = None) -> list[str]:
        """List the frames on the path from one to another.

        Parameters
        ----------
        target, source
            The first and the last frame of the list. If both are one frame, the list has only it.
        stamp
            As in `children`. The edges of the path need no data at that stamp.

        Raises
        ------
        UnknownFrame, Disconnected (naming both roots), InvalidStamp, SnapshotTooOld, SnapshotClosed
        """
        from tfdb.store.forest import path as find

        return find(_reads(self), target, source, stamp)

    def __len__(self) -> int:
        """Count the frames."""
        return len(_reads(self).frames())

    def __contains__(self, name: object) -> bool:
        """Return whether a frame has that name."""
        from tfdb.data.errors import InvalidName

        try:
            return _reads(self).frame_exists(name) if isinstance(name, str) else False
        except InvalidName:  # no frame can have it
            return False

    def __bool__(self) -> Literal[True]:
        """Return True, even without frames, so that `if buffer:` tests for None."""
        _reads(self)
        return True

    def _repr_html_(self) -> str:
        """Write a table of the frames, for notebooks."""
        from tfdb.data.notebooks import of_store

        return of_store(_reads(self))


class Freezable(SharedReads):
    """Reads of buffers and snapshots."""

    __slots__ = ()

    def freeze(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write one committed state into a file, which `tfdb.open` opens in constant time.

        Reads of the frozen store return exactly what this state returns; its `commit` is the same.
        The file appears under its name when it is complete and synced to the disk. Keep the
        recording: other versions of tfdb and other kinds of machines cannot read the file. It has
        neither the feed of changes nor the positions of sources (`Buffer.positions`), so `apply`
        cannot continue with it.

        Parameters
        ----------
        path
            The file, such as `drive.tfdb`.
        overwrite
            Replace an existing file; processes that have it open keep the old one.

        Raises
        ------
        InvalidArgument
            The file exists and `overwrite` is off, or the path is a folder.
        CapacityExceeded
            The disk is full; no partial file is left.
        SnapshotTooOld, SnapshotClosed
        OSError
            The file cannot be written.
        """
        from tfdb.store.frozen import freeze_into

        freeze_into(_reads(self), path, overwrite=overwrite)


class Snapshot(Freezable, _core.NativeSnapshot):
    """One committed state.

    `Buffer.snapshot()` makes it. All its reads see exactly that commit, whatever is written later.
    Use it as a context manager, or close() it: an open snapshot keeps old samples in memory. Reads
    raise SnapshotClosed after close(), and SnapshotTooOld if the writers needed the memory.
    """

    __slots__ = ()


class Transaction(SharedReads, _core.NativeTransaction):
    """Read, decide and write in isolation from all other writers.

    `Buffer.transaction()` makes it, and a `with` statement begins it. Reads see one state of the
    store and the transaction's own writes. The end of the block commits: all writes become visible
    at once. After an exception or `abort()` nothing is stored.

    Any call, and the end of the block, may raise Conflict: another commit changed data that was
    read (a sample, a parent, a new or removed frame), so a result could differ. Then nothing was
    stored, and the transaction has ended. Run it again, or use `Buffer.run`, which repeats it. With
    `Buffer(concurrency='fine')` nothing is checked.

    Only the thread that began it may use it (WrongThread). A transaction that is open when its
    thread ends is aborted. While it is open, its thread must not read from the Buffer itself, write
    to it, or begin another transaction in it (TransactionActive): such reads are not checked at the
    commit. With the engine `snapshot`, earlier snapshots may be read. After the end every call
    raises TransactionClosed.
    """

    __slots__ = ()


def _reads(self: object) -> StoreReader:
    """Refuse objects other than buffers, snapshots and transactions."""
    if not isinstance(self, _core.StoreReader | _core.NativeTransaction):
        raise TypeError(f"a method of StoreReader was called on a {type(self).__name__}")
    return cast("StoreReader", self)

"""All errors of tfdb, one class per cause, all derived from `TfdbError`.

The message describes the cause; programs use the fields listed at `TfdbError`. An error leaves the
store unchanged.
"""

# ruff: noqa: N818  (the names say what happened; the suffix would only lengthen them)

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .lazy_names import belong_to

if TYPE_CHECKING:
    from .refused_transforms import Refused

__all__ = [
    "BufferClosed",
    "CapacityExceeded",
    "Conflict",
    "CorruptMessage",
    "CorruptStore",
    "CycleError",
    "Disconnected",
    "ExpectationError",
    "Extrapolation",
    "FeedLapped",
    "Fenced",
    "Forked",
    "FrameInUse",
    "GapTooLarge",
    "Gone",
    "InvalidArgument",
    "InvalidArray",
    "InvalidIndex",
    "InvalidName",
    "InvalidStamp",
    "InvalidTransform",
    "LockTimeout",
    "MasterRefused",
    "MixedSources",
    "ModelError",
    "NoMaster",
    "NoSampleNear",
    "NoSuchStore",
    "NodeClosed",
    "NotComparable",
    "NotSupported",
    "OutOfOrder",
    "ReadOnly",
    "RecordingError",
    "RepeatedStamp",
    "RuleCycle",
    "SnapshotClosed",
    "SnapshotTooOld",
    "Stale",
    "StaticConflict",
    "StoreExists",
    "StreamClosed",
    "TfdbError",
    "TfdbWarning",
    "TooOld",
    "TrajectoryError",
    "TransactionActive",
    "TransactionClosed",
    "UnknownFrame",
    "WaitTimeout",
    "WatchClosed",
    "WrongThread",
]


CAUGHT = (
    "Conflict",
    "Disconnected",
    "Extrapolation",
    "InvalidArgument",
    "InvalidStamp",
    "TfdbError",
    "TfdbWarning",
    "UnknownFrame",
    "WaitTimeout",
)
"""The errors that programs catch most: they are also attributes of `tfdb`."""


class TfdbError(Exception):
    """Root of all errors of tfdb.

    Every error has all fields below; a field that does not apply is None. Times are integer
    nanoseconds.

    Parameters
    ----------
    message
        The cause and the valid values.
    **fields
        Any of the fields below.
    """

    target: str | None = None
    """Target of the lookup."""
    source: str | None = None
    """Source of the lookup."""
    edge: str | None = None
    """Child frame of the edge that failed."""
    parent: str | None = None
    """Parent of that edge at the stamp."""
    frame: str | None = None
    """The frame that the error concerns."""
    authority: str | None = None
    """Last writer of the edge."""
    frames: tuple[str, ...] | None = None
    """Children that still use a frame, frames of a cycle, two roots, or frames of mixed sources."""
    reason: str | None = None
    """`past`, `future` or `no data`; or the fault of the input."""
    stamp: int | None = None
    """The requested or refused stamp."""
    oldest: int | None = None
    """The oldest valid stamp; of FeedLapped, the oldest commit."""
    newest: int | None = None
    """The newest valid stamp; of FeedLapped, the newest commit."""
    before: int | None = None
    """The stored stamp before the requested one."""
    after: int | None = None
    """The stored stamp after the requested one."""
    limit: int | None = None
    """The exceeded limit: max_gap, max_age, lifespan, tolerance, max or history."""
    expectation: str | None = None
    """The expectation whose lifespan is over, as `parent -> child`."""
    index: int | None = None
    """Position in the batch or in the array."""
    offset: int | None = None
    """Position in the bytes of a message."""
    commit: int | None = None
    """Number of the snapshot that was read; of FeedLapped, the commit to continue from."""
    since: int | None = None
    """The requested first commit of changes."""
    refused: tuple[Refused, ...] | None = None
    """Every refused member of a batch, in order; the error concerns the first."""
    attempts: int | None = None
    """Number of attempts of a transaction."""
    value: Any = None
    """The refused argument."""
    path: str | None = None
    """The file."""
    line: int | None = None
    """The line of the file, counted from 1."""
    groups: dict[str, tuple[str, ...]] | None = None
    """The topics of each group that disagrees with another, by the namespace of the group."""
    uri: str | None = None
    """URI of the master of a ROS graph."""

    def __init__(self, message: str = "", **fields: Any) -> None:
        super().__init__(message)
        for name, value in fields.items():
            if name not in TfdbError.__annotations__:
                raise TypeError(f"{type(self).__name__} has no field {name!r}")
            setattr(self, name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore, (type(self), str(self), self.__dict__)


def _restore(cls: type[TfdbError], message: str, fields: dict[str, Any]) -> TfdbError:
    """Unpickle an error of any class, although their constructors differ."""
    error = cls.__new__(cls)
    TfdbError.__init__(error, message, **fields)
    return error


class TfdbWarning(UserWarning):
    """Legal but probably unintended input; the message names the remedy.

    `warnings.simplefilter("error", tfdb.TfdbWarning)` makes errors of them.
    """

    def __init__(self, message: str = "") -> None:
        super().__init__(message)


class UnknownFrame(TfdbError, LookupError):
    """The snapshot has no frame of that name. Fields: frame, target, source, commit."""


class Disconnected(TfdbError):
    """Both frames exist, but no path joins them. Fields: target, source, frames (the roots).

    If an edge towards a root has samples, but none at the stamp, the error also has the fields
    edge, parent (`(removed)` if that frame was removed), stamp, oldest, newest and reason (`past`,
    `future`).
    """


class Extrapolation(TfdbError):
    """An edge has no data at the stamp, and the policy does not extrapolate.

    Fields: reason (`past`, `future`, `no data`), edge, parent, stamp, oldest, newest.
    """


class GapTooLarge(TfdbError):
    """The gap between the samples around the stamp exceeds `max_gap`.

    Fields: edge, parent, stamp, before, after, limit.
    """


class Stale(TfdbError):
    """The newest sample that may be used is older than `max_age` or an enforced lifespan.

    Fields: edge, parent, stamp, limit. Of a lifespan also `expectation` and `newest`; `stamp` is
    then the time of the store's clock.
    """


class NoSampleNear(TfdbError):
    """No stored sample at the stamp, or none within the tolerance. Fields: edge, stamp, limit."""


class InvalidTransform(TfdbError, ValueError):
    """The numbers are not a rigid transform, or a frame is its own parent.

    Fields: edge, parent, reason, index. Also a lookup or computation whose result is not finite,
    for example the sum of translations near 1e308 m. Fields: target, source, stamp, index, reason
    (`not finite`).
    """


class TooOld(TfdbError):
    """The sample is older than the retained history.

    Fields: edge, parent, stamp, oldest, newest, limit (the history), index.
    """


class StaticConflict(TfdbError):
    """A moving sample for a static edge, or the reverse. Fields: edge, parent, index."""


class RepeatedStamp(TfdbError):
    """With `only_new`: the edge already has a sample at that stamp. Fields: edge, stamp, index."""


class CycleError(TfdbError):
    """The batch would close a cycle at some time. Fields: frames (of the cycle), stamp, index."""


class FrameInUse(TfdbError):
    """The frame to remove still has children. Fields: frame, frames (the children)."""


class InvalidStamp(TfdbError, ValueError):
    """Not a stamp: negative, a bool, a float, or of an unknown type. Fields: value, index."""


class InvalidName(TfdbError, ValueError):
    """Not a frame name: empty, longer than 1024 bytes, not UTF-8, or with a control character.

    Control characters are U+0000 to U+001F and U+007F. Also an invalid name of a ROS graph.

    Fields: value, index.
    """


class InvalidArray(TfdbError, ValueError):
    """An array of the wrong shape, dtype or stride; the message names both. Fields: reason."""


class InvalidArgument(TfdbError, ValueError):
    """An option outside its valid range."""


class InvalidIndex(InvalidArgument, IndexError):
    """The trajectory has fewer poses than that. Field: index."""


class CorruptMessage(TfdbError):
    """Bytes that cannot be decoded. Fields: offset, reason."""


class SnapshotTooOld(TfdbError):
    """Writers had to overwrite data of the snapshot. Fields: commit."""


class SnapshotClosed(TfdbError):
    """The snapshot was closed before it was read. Fields: commit."""


class StreamClosed(TfdbError):
    """The stream was closed, or belongs to another process."""


class WatchClosed(TfdbError):
    """The watch was closed before or during the call."""


class RuleCycle(TfdbError):
    """A chain of rules is longer than `max_depth`; its last rule was not run. Field: commit."""


class CapacityExceeded(TfdbError):
    """Out of frames, or over the memory limit. Fields: reason."""


class Conflict(TfdbError):
    """Another commit changed data that the transaction read: nothing was stored, run it again.

    `Buffer.run` retries by itself. Fields: reason, edge or frame, stamp, commit; attempts if
    `Buffer.run` gave up.
    """


class TransactionClosed(TfdbError):
    """The transaction has not begun, or has ended.

    Fields: reason (`not begun`, `committed`, `aborted`, `lost`, `refused`).
    """


class TransactionActive(TfdbError):
    """The thread has a transaction open in the store: work through it, or end it first."""


class WrongThread(TfdbError):
    """A transaction was used by another thread than the one that began it."""


class Forked(TfdbError):
    """The fork happened while a thread of the parent process held a lock of the store.

    That thread does not exist in this process, so its locks are never released. The default engine
    can still read the store; every engine can make a new `Buffer`. See "Forks" in
    docs/concurrency.md.
    """


class FeedLapped(TfdbError):
    """The feed no longer has these changes: take a snapshot and follow from its commit.

    A follower that may miss commits continues from `commit`, the middle of the feed: the oldest
    commits are overwritten first. The feed of a frozen store is empty.

    Fields: since, oldest, newest (the valid range of `since`), commit.
    """


class Gone(TfdbError):
    """Samples of a commit are no longer kept: take a snapshot's state and continue from its commit.

    They were evicted, replaced, cleared or removed. A held snapshot of the position prevents it.
    Fields: edge (the child), commit.
    """


class OutOfOrder(TfdbError):
    """Commits of another store do not follow the position: apply the missing commits, or a state.

    They come later, are of a later epoch, or contain other frames than the applied commits.

    Fields: since (the commit before them), commit (the position).
    """


class Fenced(TfdbError):
    """Commits of another store are of an epoch that has ended: a later one has been applied.

    If the clock of the source was set back, call `Buffer.forget_source`, then apply a state.

    Fields: since (the commit before them), commit (the position).
    """


class NotComparable(TfdbError):
    """Two trajectories that cannot be compared; the message names what is missing.

    No common time, too few matched poses, an undetermined alignment or offset, or no pair for a
    relative error. Fields: reason, limit (max_diff).
    """


class NotSupported(TfdbError):
    """The engine or the machine does not support the call; the message names what does."""


class NoSuchStore(TfdbError):
    """The store or file does not exist, or it was removed. Fields: path, reason."""


class StoreExists(TfdbError):
    """A store of that name exists already. Fields: path, reason."""


class CorruptStore(TfdbError):
    """A file that is not a store, is of another version or kind of machine, or is cut or damaged.

    Fields: path, reason.
    """


class ReadOnly(TfdbError):
    """The store is frozen, was opened for reading only, or its permissions forbid writing.

    Or a frame comes from another store, by `apply` or a mirror: only this source may write it.
    Fields: path; or frame and source (its name here), and for a sample edge (the frame), parent,
    stamp, authority, index, refused.
    """


class LockTimeout(TfdbError):
    """Another process holds the store's writer lock and does not continue.

    It may be stopped, for example by SIGSTOP. Writers do not wait for dead processes, and reads
    continue. Fields: path, pid, limit (the waited time).
    """


class BufferClosed(TfdbError):
    """The buffer was closed, before the call or while it waited. Field: commit (the newest)."""


class WaitTimeout(TfdbError, TimeoutError):
    """The wait reached its timeout. Fields: commit (the newest one), limit."""


class NoMaster(TfdbError, ConnectionError):
    """The master of ROS 1 does not answer. Fields: uri, reason."""


class MasterRefused(TfdbError):
    """The master of ROS 1 refuses a request of a node. Fields: uri, reason."""


class NodeClosed(TfdbError):
    """The live node was closed, by its program or by the graph. Fields: reason, value."""


class FileError(TfdbError):
    """An error about a file. Fields: path, reason."""

    def __init__(self, path: object, reason: str, **fields: Any) -> None:
        place = f"{path}:{fields['line']}" if fields.get("line") is not None else f"{path}"
        super().__init__(f"{place}: {reason}", path=str(path), reason=reason, **fields)


class RecordingError(FileError):
    """A recording cannot be read or written: `RecordingError(path, reason)`."""


class MixedSources(RecordingError):
    """Several groups of topics, or several files, state different transforms of one edge.

    Two robots in one recording, or `/tf` beside `/tf_old`, are such groups.

    Fields: path, reason, groups (a group's name to its topics; of files, the path of each to its
    topics), frames (the children of these edges).
    """


class ModelError(FileError):
    """A robot model that is not valid: `ModelError(path, reason, line=None)`."""


class ExpectationError(FileError):
    """A file of expectations that is not valid: `ExpectationError(path, reason, line=None)`."""


class TrajectoryError(FileError):
    """A trajectory file that is not valid: `TrajectoryError(path, line, reason)`.

    Fields: path, line (None where the file as a whole is wrong), reason.
    """

    def __init__(self, path: object, line: int | None, reason: str) -> None:
        super().__init__(path, reason, line=line)


belong_to("tfdb.errors", globals(), __all__)
belong_to("tfdb", globals(), CAUGHT)

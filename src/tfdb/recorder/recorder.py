"""The recorder: one thread follows the commits of a store, another writes them."""

from __future__ import annotations

import atexit
import math
import os
import threading
import time
import warnings
from collections import deque
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING, NamedTuple

from tfdb._core import duration_to_nanoseconds, messages_of_commits
from tfdb.data.argument_checks import check_count, check_flag, refuse_without, unknown_ending
from tfdb.data.closable import Closable
from tfdb.data.counting import counted
from tfdb.data.errors import (
    FeedLapped,
    Forked,
    Gone,
    NoSuchStore,
    RecordingError,
    SnapshotTooOld,
    TfdbWarning,
    WatchClosed,
)
from tfdb.data.path_checks import check_path
from tfdb.data.sample_heads import numbers_of
from tfdb.data.suggestions import first_few

from .channels import missing
from .chosen_names import ChosenNames

if TYPE_CHECKING:
    import pathlib
    from collections.abc import Iterable, Mapping

    from tfdb._core import Buffer, Snapshot

    from .channels import Messages
    from .mcap_file import McapFile

_READ = 1 << 20
"""Bytes of commits that are read at once."""
_REST = 0.002
"""Seconds between two reads of a busy store, and so the accuracy of the messages' times."""
_LOOK = 1.0
"""Seconds between two reads of an idle store, and so the longest hold of a snapshot."""


class _Item(NamedTuple):
    """Commits that were read together, or a state."""

    time: int
    last: int
    """The last commit that it covers."""
    messages: list[Messages]
    size: int
    is_state: bool = False
    lost: int = 0
    """Number of commits before a state that were lost."""


class Recorder(Closable):
    """Records the commits of a buffer into an MCAP file, until it is closed.

    Use it in a `with` block, or call `close`. Each commit becomes one TFMessage on `/tf`, or one on
    each of `/tf` and `/tf_static`; the messages' `sequence` is the lower 32 bits of its number.
    Commits that TFMessages cannot express completely are also on `/tfdb/commits`. The file begins
    with the newest state; all commits after the constructor are recorded. `recorded_commits` reads
    all commits; every reader of MCAP reads `/tf` and `/tf_static`.

    The file has the extension `.part` until it is complete. If the process is killed or the disk is
    full, `salvage=True` (`--salvage`) reads the flushed part.

    Parameters
    ----------
    buffer
        The store, which may be shared.
    path
        A name that ends in `.mcap`. No file of this name, or of the name with `.part`, may exist.
    frames
        Record only the edges from these frames to their parents.
    exclude
        Leave out the edges from these frames to their parents; * and ? work as in a shell. The
        frames may still be parents of other frames.
    rename
        New names of frames.
    flush
        Seconds until commits are written to the file; they then survive a kill of the process.
    sync
        Also sync the file to the disk, so that they survive a power cut.
    split_size, split_time
        Start a new file beyond this many bytes or seconds. The files are then called `NAME_0.mcap`,
        `NAME_1.mcap` and so on, and each begins with the newest state.
    queue
        Largest number of bytes that wait for a slow disk. Commits beyond it are lost: `lost` counts
        them, the file records their position, and a TfdbWarning follows at the end.

    Raises
    ------
    RecordingError
        The extension is not `.mcap`, or the file exists.
    NotSupported
        PyPI's mcap is not installed, or the buffer's engine keeps no feed.
    InvalidArgument, TypeError
        A parameter is invalid.
    OSError
        The file cannot be written.
    """

    def __init__(
        self,
        buffer: Buffer,
        path: str | os.PathLike[str],
        *,
        frames: str | Iterable[str] | None = None,
        exclude: str | Iterable[str] = (),
        rename: Mapping[str, str] | None = None,
        flush: float = 0.5,
        sync: bool = False,
        split_size: int | None = None,
        split_time: float | None = None,
        queue: int = 256_000_000,
    ) -> None:
        refuse_without(buffer, "buffer", "a Buffer", "commits_bytes", "snapshot")
        self._path = check_path(path, RecordingError)
        if self._path.suffix != ".mcap":
            raise RecordingError(self._path, unknown_ending(str(self._path), (".mcap",)))
        self._folder = self._path.absolute().parent
        self._buffer = buffer
        self._names = ChosenNames(frames, exclude, rename)
        self._flush = duration_to_nanoseconds(flush, "flush") / 1e9
        self._sync = check_flag("sync", sync)
        self._split_size = None if split_size is None else check_count("split_size", split_size)
        self._split_time = (
            None if split_time is None else duration_to_nanoseconds(split_time, "split_time")
        )
        self._limit = check_count("queue", queue)
        self._process = os.getpid()
        self._files: list[pathlib.Path] = []
        self._sizes: list[int] = []
        self._commits = self._lost = 0
        self._error: BaseException | None = None
        self._ending, self._ended = threading.Event(), threading.Event()
        self._wants_state = threading.Event()
        self._changed = threading.Condition()
        # Under `_changed`: None ends the items.
        self._items: deque[_Item | None] = deque()
        self._queued = 0
        self._flushed = self._awaited = self._last = -1
        self._splits = False  # with the next state
        self._time, self._read_at = 0, time.monotonic_ns()  # of the last item
        self._begin()

    def _begin(self) -> None:
        self._threads = [
            threading.Thread(target=run, name=f"tfdb recorder: {name}", daemon=True)
            for name, run in (("reads", self._read), ("writes", self._write))
        ]
        with ExitStack() as undo:
            self._watch = self._buffer.watch((), every=True)
            undo.callback(self._watch.close)
            self._held = self._buffer.snapshot()
            undo.callback(self._held.close)
            self._watch.next(self._held.commit, 0)  # the first call registers the watch
            self._position = self._since = self._held.commit
            self._put(self._state(0))
            self._file = self._open()
            undo.callback(self._file.remove)
            undo.callback(self._end_threads)
            for thread in self._threads:
                thread.start()
            undo.pop_all()
        atexit.register(self.close)

    # -- what users see ----------------------------------------------------------------------------

    @property
    def files(self) -> tuple[pathlib.Path, ...]:
        """The files that are complete, under their names."""
        return tuple(self._files)

    @property
    def commits(self) -> int:
        """Number of recorded commits."""
        return self._commits

    @property
    def lost(self) -> int:
        """Number of commits that were not recorded, because the disk was too slow."""
        return self._lost

    @property
    def size(self) -> int:
        """Size of the flushed part of all files, in bytes."""
        last = 0 if self._file.path in self._files else self._file.size
        return sum(self._sizes) + last

    @property
    def ended(self) -> bool:
        """Whether the recording has ended: by `close`, or by an error, which `close` raises."""
        return self._ended.is_set()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until the recording has ended (`ended`); False at the timeout.

        Raises Forked in a child of `fork`.
        """
        self._check_process()
        left = None if timeout is None else duration_to_nanoseconds(timeout, "timeout") / 1e9
        return self._ended.wait(left)

    def flush(self) -> int:
        """Wait until all earlier commits are flushed. Returns the last of them.

        Raises the error that ended the recording, RecordingError after its end, and Forked in a
        child of `fork`.
        """
        self._check_process()
        newest = self._buffer.commit
        with self._changed:
            self._awaited = max(self._awaited, newest)
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._flushed >= newest or self._ended.is_set())
        if self._flushed < newest:
            raise self._error or RecordingError(self._path, "the recording has ended")
        return self._flushed

    def close(self) -> None:
        """Record all earlier commits, and end the file.

        A recorder that is still open when the program ends is closed then. Close it before its
        buffer: commits that it has not read by then are not recorded.

        Raises the error that ended the recording: OSError of the disk, RecordingError if the file
        was removed, or an error of the buffer. A file that exists has all commits that were read
        before the error.
        """
        if os.getpid() != self._process:
            return  # a child of `fork` records nothing
        is_first = not self._ending.is_set()
        self._end_threads()
        self._held.close()
        atexit.unregister(self.close)
        if self._error is not None:
            error, self._error = self._error, None
            raise error
        if is_first:
            self._warn()

    def _end_threads(self) -> None:
        self._ending.set()
        self._watch.close()
        for thread in self._threads:
            if thread.is_alive():
                thread.join()

    def _check_process(self) -> None:
        if os.getpid() != self._process:
            raise Forked("the recorder belongs to the parent of this process: make another here")

    def _warn(self) -> None:
        if self._lost:
            text = f"{counted(self._lost, 'commit')} were lost: they came faster than the recorder"
            text += (
                " could read them, or than the disk could write them; a larger queue= holds more"
            )
            warnings.warn(text, TfdbWarning, stacklevel=4)
        if unseen := self._names.unseen():
            text = f"the options name {first_few(unseen)}, but no recorded commit has such a frame"
            warnings.warn(text, TfdbWarning, stacklevel=4)

    # -- the thread that reads ---------------------------------------------------------------------

    def _read(self) -> None:
        try:
            ending = False
            while not ending and not self._ended.is_set():
                ending = self._ending.is_set() or self._error is not None  # the last round
                self._read_to(self._buffer.snapshot())
                if self._wants_state.is_set() and not ending:
                    with suppress(SnapshotTooOld):  # then with a later one
                        self._put(self._state(0))
                        self._wants_state.clear()
                if not ending:
                    self._wait()
        except Exception as error:  # `close` raises it
            self._fail(error)
        finally:
            self._put(None)

    def _wait(self) -> None:
        """Wait for a commit, or for `close`."""
        self._ending.wait(_REST)
        try:
            self._watch.next(self._position, _LOOK, limit=1)
        except (FeedLapped, WatchClosed):
            return  # the next read continues from there
        except NoSuchStore as error:  # what was committed before can still be read
            self._fail(error)

    def _read_to(self, taken: Snapshot) -> None:
        """Queue the commits up to a snapshot, and hold it in place of the previous one."""
        try:
            while self._position < taken.commit and not self._ended.is_set():
                data = self._buffer.commits_bytes(
                    self._position, max_commits=taken.commit - self._position, max_bytes=_READ
                )
                item = self._item(data)
                if self._queued and self._queued + item.size > self._limit:
                    taken.close()
                    self._lose()
                    return
                self._put(item)
                self._position = item.last
                if item.messages:
                    self._since = item.messages[-1][0]
        except (FeedLapped, Gone):
            taken.close()
            self._lose()
            return
        self._held.close()
        self._held = taken

    def _lose(self) -> None:
        """Continue from the newest state, once the queue has room."""
        with self._changed:
            self._changed.wait_for(lambda: 2 * self._queued <= self._limit or self._ended.is_set())
        self._held.close()
        self._held = self._buffer.snapshot()
        newest = self._held.commit
        state = self._state(newest - self._position)
        self._lost += state.lost
        self._position = self._since = newest
        self._put(state)

    def _state(self, lost: int) -> _Item:
        """Make the state of the held snapshot."""
        item = self._item(self._held.state_bytes(newest=1))
        return item._replace(is_state=True, lost=lost)

    def _item(self, data: bytes) -> _Item:
        choose = None if self._names.is_all else self._names
        messages = messages_of_commits(data, self._since, choose)
        size = sum(len(each) for found in messages for each in found[1:] if each is not None)
        return _Item(self._now(), numbers_of(data)[1], messages, size)

    def _now(self) -> int:
        """Return the system time. If its clock was set back, continue from the last time.

        Readers sort messages by time, so the times of later commits must not be smaller.
        """
        before, self._read_at = self._read_at, time.monotonic_ns()
        self._time = max(time.time_ns(), self._time + self._read_at - before)
        return self._time

    def _fail(self, error: BaseException) -> None:
        """Keep the first error."""
        with self._changed:
            self._error = self._error or error

    # -- the queue ---------------------------------------------------------------------------------

    def _put(self, item: _Item | None) -> None:
        with self._changed:
            self._items.append(item)
            self._queued += 0 if item is None else item.size
            self._changed.notify_all()

    def _take(self, until: float) -> tuple[bool, _Item | None]:
        """Return whether an item came, and the item."""
        left = None if until == math.inf else max(until - time.monotonic(), 0)
        with self._changed:
            self._changed.wait_for(lambda: self._items or self._is_awaited(), left)
            if not self._items:
                return False, None
            item = self._items.popleft()
            self._queued -= 0 if item is None else item.size
            self._changed.notify_all()
        return True, item

    # -- the thread that writes --------------------------------------------------------------------

    def _write(self) -> None:
        try:
            self._write_all()
        except Exception as error:  # `close` raises it
            self._fail(error)
            self._file.abandon()
        finally:
            self._ended.set()
            with self._changed:
                self._items.clear()
                self._queued = 0
                self._changed.notify_all()

    def _write_all(self) -> None:
        due = math.inf
        while True:
            came, item = self._take(due)
            if item is not None:
                self._record(item)
                self._last = item.last
                if self._file.pending and due == math.inf:
                    due = time.monotonic() + self._flush
            elif came:
                break
            if self._file.pending and (time.monotonic() >= due or self._is_awaited()):
                self._file.flush()
            if not self._file.pending:
                due = math.inf
                with self._changed:
                    self._flushed = self._last
                    self._changed.notify_all()
        self._end_file()
        self._flushed = self._last

    def _is_awaited(self) -> bool:
        """Return whether `flush` waits for the disk."""
        return self._flushed < self._awaited <= self._last

    def _record(self, item: _Item) -> None:
        if item.is_state and self._splits:
            self._end_file()
            self._splits, self._file = False, self._open()
        if item.lost:
            self._file.write_lost(item.lost, item.last, item.time)
        for each in item.messages:
            self._file.write(item.time, each, is_state=item.is_state)
        if item.is_state:
            self._file.flush()
        else:
            self._commits += len(item.messages)
        is_asked_for = item.is_state and not item.lost  # it begins a file
        if not is_asked_for and not self._splits and self._is_full(item.time):
            self._splits = True
            self._wants_state.set()

    def _is_full(self, now: int) -> bool:
        begun = self._file.begun
        return (self._split_size is not None and self._file.size >= self._split_size) or (
            self._split_time is not None and begun is not None and now - begun >= self._split_time
        )

    def _open(self) -> McapFile:
        """Open the next file."""
        try:
            from .mcap_file import McapFile  # noqa: PLC0415 - mcap is an extra
        except ImportError as error:
            raise missing("Recorder", error) from error
        path = self._path
        if self._split_size is not None or self._split_time is not None:
            path = path.with_name(f"{path.stem}_{len(self._files)}{path.suffix}")
        return McapFile(path, self._folder, sync=self._sync)

    def _end_file(self) -> None:
        self._file.close()
        self._files.append(self._file.path)
        self._sizes.append(self._file.size)

"""The common part of streams of samples and of results: a position in the feed, and its end."""

from __future__ import annotations

import os
import threading
import time
import warnings
from contextlib import suppress
from operator import index
from typing import TYPE_CHECKING, Any, Literal, TypeAlias
from weakref import WeakSet

from tfdb._core import duration_to_nanoseconds
from tfdb.data.argument_checks import check_flag, check_word, not_one_of
from tfdb.data.errors import (
    FeedLapped,
    InvalidArgument,
    NotSupported,
    StreamClosed,
    TfdbWarning,
    WatchClosed,
)
from tfdb.data.stamps import shown

from .reader import Item, Reader

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb._core import Buffer, Snapshot, Watch

__all__: list[str] = []

Lapped: TypeAlias = Literal["raise", "skip"]
_RENEWED = 1.0  # seconds: longest hold of a snapshot, which keeps old samples in memory


class Cursor(Reader[Item]):
    """A reader's position among the commits of a buffer.

    One thread reads at a time, and others wait for it. Any thread, or a signal handler, may close
    it.
    """

    _takes_every_commit = False

    def __init__(
        self,
        buffer: Buffer,
        watch: Callable[[], Watch],
        start: Snapshot,
        since: object,
        *,
        hold: bool,
        lapped: Lapped,
        poll: float,
    ) -> None:
        self._buffer = buffer
        self._position = start.commit if since is None else commit_of(since, start.commit)
        self._held = start if check_flag("hold", hold) else None
        self._skips = check_word("lapped", lapped, ("raise", "skip")) == "skip"
        self._poll = duration_to_nanoseconds(poll, "poll") / 1e9
        self._gone = 0
        self._missed = 0
        self._lock = threading.Lock()
        self._ended = False
        self._closing = threading.Event()  # wakes waiting threads
        self._ends: set[Callable[[], None]] = set()  # for asynchronous waits
        try:
            self._watch: Watch | None = watch()
            with suppress(FeedLapped):  # the first read raises it
                self._watch.next(self._position, 0, limit=1)  # the first call registers the watch
        except NotSupported as error:
            self._watch = None
            text = f"the stream polls every {self._poll:g} s: it cannot wait for commits: {error}"
            warnings.warn(text, TfdbWarning, stacklevel=4)
        _open.add(self)

    @property
    def commit(self) -> int:
        """The last commit that was read completely; `follow(since=...)` continues from it."""
        return self._position

    @property
    def missed(self) -> int:
        """Number of commits that left the feed before the stream read them."""
        return self._missed

    @property
    def gone(self) -> int:
        """Number of samples, or states of a pair, that the store evicted before they were read."""
        return self._gone

    @property
    def closed(self) -> bool:
        """Whether `close` was called. A child of `fork` finds its streams closed."""
        return self._ended

    def close(self) -> None:
        """Release the stream's snapshot, and end its reads in all threads."""
        self._end()
        if self._watch is not None:
            self._watch.close()
        for end in tuple(self._ends):
            end()
        # A signal handler may have interrupted the read that holds the lock. That read closes it.
        if self._lock.acquire(blocking=False):
            try:
                self._close_held()
            finally:
                self._lock.release()

    def _close_held(self) -> None:
        if self._held is not None:
            self._held.close()

    def _end(self) -> None:
        self._ended = True
        self._closing.set()

    async def __anext__(self) -> Item:
        try:
            while (item := self.read_next()) is None:
                await self._wait_async()
        except StreamClosed:
            raise StopAsyncIteration from None
        return item

    def _check_open(self) -> None:
        if self._ended:
            self._close_held()
            raise StreamClosed("the stream is closed: make another by Buffer.follow()")

    def _wait(self, until: float | None) -> bool:
        """Wait for commits after the position, for a limited time. False: the time is over.

        Raises StreamClosed.
        """
        left = None if until is None else until - time.monotonic()
        if left is not None and left <= 0:
            return False
        try:
            self._wait_for_commit(_RENEWED if left is None else min(left, _RENEWED))
        except FeedLapped as error:
            self._skip(error)
        self._check_open()
        return True

    def _wait_for_commit(self, left: float | None) -> bool:
        """Wait `left` seconds for a commit that may concern the stream, and move to before it."""
        if self._watch is None:
            _ = self._buffer.commit
            self._closing.wait(self._poll if left is None else min(self._poll, left))
            return not self._ended
        try:
            touched = self._watch.next(self._position, left, limit=1)
        except WatchClosed:
            return False
        if touched:
            self._position = touched[0].commit - 1
        return bool(touched)

    async def _wait_async(self) -> None:
        """Wait until a commit follows the position, or the stream is closed."""
        import asyncio  # noqa: PLC0415 - it takes as long as all of tfdb

        if self._watch is None:
            await asyncio.sleep(self._poll)
            return
        loop = asyncio.get_running_loop()
        wait = loop.create_task(self._buffer.wait_for_commit_async(self._position))

        def end() -> None:
            with suppress(RuntimeError):  # a closed loop has no waiting coroutine
                loop.call_soon_threadsafe(wait.cancel)

        self._ends.add(end)
        try:
            if not self._ended:
                await wait
        except asyncio.CancelledError:
            task = asyncio.current_task()
            if not self._ended or task is None or task.cancelling():
                raise
        finally:
            wait.cancel()
            self._ends.discard(end)

    def _more(self, read: Callable[[], bool], *, quietly: bool = False) -> bool:
        """Call `read`, which moves the position, until it finds something. False: it found nothing.

        It reads under a snapshot of the position, if the stream holds one.
        """
        while (newest := self._buffer._last_to_follow) > self._position:
            taken = None if self._held is None else self._buffer.snapshot()
            try:
                if not (
                    self._takes_every_commit or self._watch is None or self._wait_for_commit(0)
                ):
                    self._position = max(newest, self._position)
                elif read():
                    return True
            except FeedLapped as error:
                self._skip(error, quietly=quietly)
            finally:
                self._hold(taken)
        return False

    def _skip(self, error: FeedLapped, *, quietly: bool = False) -> None:
        """Skip commits that left the feed. Raises the error unless `quietly`."""
        next_one = self._position if error.commit is None else error.commit
        self._missed += next_one - self._position
        self._position = next_one
        if not (quietly or self._skips):
            raise error

    def _hold(self, taken: Snapshot | None) -> None:
        """Keep a snapshot that was taken before a read, if the position has reached its commit."""
        if taken is None or self._held is None:
            return
        if taken.commit > self._position:
            taken.close()
        else:
            self._held.close()
            self._held = taken
        if self._ended:
            self._held.close()


_open: WeakSet[Cursor[Any]] = WeakSet()


def _close_in_child() -> None:
    for cursor in list(_open):
        # The threads that hold the locks do not exist in this process.
        cursor._lock, cursor._closing = threading.Lock(), threading.Event()
        cursor._end()


os.register_at_fork(after_in_child=_close_in_child)


def commit_of(since: object, newest: int) -> int:
    """Check the number of the commit from which a stream continues."""
    if isinstance(since, str):
        more = f"a commit number from 0 to {newest}"
        raise InvalidArgument(not_one_of("since", since, ("held",), more), value=since)
    try:
        number = -1 if isinstance(since, bool) else index(since)  # type: ignore[arg-type]
    except TypeError:
        number = -1
    if not 0 <= number <= newest:
        raise InvalidArgument(
            f"since must be a commit number from 0 to {newest} (the newest commit), None or "
            f"'held', got {shown(since)}",
            value=since,
        )
    return number


def separation_of(min_separation: float | None) -> int | None:
    """Return `min_separation` in nanoseconds; None: no sample is skipped."""
    if min_separation is None:
        return None
    return duration_to_nanoseconds(min_separation, "min_separation")

"""Waits that block no thread: the buffer's thread, or the writer, reports their end."""

from __future__ import annotations

import logging
import os
import threading
import time
from collections import defaultdict
from contextlib import suppress
from typing import TYPE_CHECKING, TypeAlias, TypeVar

from tfdb._core import duration_to_nanoseconds
from tfdb.data.errors import (
    Disconnected,
    Extrapolation,
    GapTooLarge,
    InvalidTransform,
    NoSampleNear,
    Stale,
    TfdbError,
    UnknownFrame,
    WaitTimeout,
)

if TYPE_CHECKING:
    import asyncio
    from collections.abc import Callable, Iterable, Mapping
    from contextlib import AbstractContextManager

    from tfdb._core import Buffer, Policy, Transform
    from tfdb.data.stamps import StampLike

__all__: list[str] = []

# Errors that a later commit may resolve.
NO_ANSWER_YET = (
    UnknownFrame,
    Disconnected,
    Extrapolation,
    GapTooLarge,
    Stale,
    NoSampleNear,
    InvalidTransform,
)
LINGERS = 1.0  # seconds until the idle thread ends
# Ends of a wait, as `_ended_waits` returns them.
CAME, TIMED_OUT, STOPPED = 0, 1, 4

CANCELLED = (None, None)

LOGGER = logging.getLogger("tfdb")

Loop: TypeAlias = "asyncio.AbstractEventLoop"
End: TypeAlias = int | MemoryError
"""The end of a wait: an argument of `Buffer._check_wait`, or an exception."""
Tell: TypeAlias = "Callable[[End], None]"


Result = TypeVar("Result")


def _report_all(ended: Iterable[tuple[Tell, End]]) -> None:
    """Report each end. Ctrl-C or an exit in the main thread is raised after all reports."""
    stopped: BaseException | None = None
    for tell, how in ended:
        try:
            tell(how)
        except BaseException as error:  # report the other ends first
            if isinstance(error, Exception) or not _in_main_thread():
                LOGGER.exception("what waited for a transform raised")
            else:
                stopped = error
    if stopped is not None:
        raise stopped


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


class _Teller:
    """Waits in one thread for all waits of a buffer."""

    def __init__(self, buffer: Buffer) -> None:
        self.buffer = buffer
        self.waits: dict[int, tuple[Loop | None, Tell]] = {}
        # Held by the thread that takes ended waits. A writer holds it during its commit, and takes
        # the waits that the commit ended. Callbacks run without the lock.
        self.taking: AbstractContextManager[bool] = threading.RLock()
        buffer._set_waits_begun(begun=True)
        threading.Thread(target=self.run, name="tfdb waits", daemon=True).start()

    def run(self) -> None:
        while True:
            ended: Mapping[int, End]
            try:
                self.buffer._await_ended_waits(LINGERS)
                with self.taking:
                    ended = self.buffer._ended_waits(0)
            except MemoryError as error:
                ended = dict.fromkeys(list(self.waits), error)
                for number in ended:
                    self.buffer._cancel_wait(number)
            with _lock:
                if not ended and not self.waits:
                    self.buffer._set_waits_begun(begun=False)
                    del _tellers[id(self.buffer)]
                    return
            self.tell(ended)

    def tell(self, ended: Mapping[int, End]) -> None:
        """Report the ends of waits, each in its event loop, or in this thread without one."""
        told: defaultdict[Loop | None, list[tuple[Tell, End]]] = defaultdict(list)
        for number, how in ended.items():
            with _lock:
                loop, tell = self.waits.pop(number, CANCELLED)
            if tell is not None:
                told[loop].append((tell, how))
        for loop, members in told.items():
            if loop is not None:
                with suppress(RuntimeError):  # a closed loop has no waiting coroutine
                    loop.call_soon_threadsafe(_report_all, members)
        _report_all(told[None])


def write(buffer: Buffer, store: Callable[[], Result]) -> Result:
    """Call `store`, which writes to a buffer; then report, in this thread, the waits it ended.

    Returns the result of `store`. If `store` raises, ended waits are reported as well.
    """
    teller = _tellers.get(id(buffer))
    if teller is None:
        return store()
    ended: Mapping[int, End] = {}
    try:
        with teller.taking:
            try:
                return store()
            finally:
                with suppress(MemoryError):  # the waiting thread takes them
                    ended = buffer._ended_waits(0)
    finally:
        teller.tell(ended)


class Wait:
    """A started wait, which ends once: reported or cancelled. Any thread may cancel it."""

    def __init__(self, teller: _Teller, number: int) -> None:
        self._teller = teller
        self._number = number

    def cancel(self) -> None:
        """End the wait without a report; does nothing if it has ended."""
        with _lock:
            if self._teller.waits.pop(self._number, None) is not None:
                self._teller.buffer._cancel_wait(self._number)


def begin(
    buffer: Buffer, ask: Callable[[], int], tell: Tell, loop: Loop | None = None
) -> Wait | None:
    """Begin a wait. Its end is reported once, in `loop` or in the thread of the buffer's waits.

    `ask` is one of the store's `_begin_wait` functions. Returns None, without a report, if the
    answer exists already.
    """
    with _lock:
        number = ask()
        if number == 0:
            return None
        teller = _tellers.get(id(buffer))
        if teller is None:
            teller = _tellers[id(buffer)] = _Teller(buffer)
        teller.waits[number] = (loop, tell)
    return Wait(teller, number)


# The garbage collector may close a waiting coroutine in a thread that holds the lock.
_lock = threading.RLock()
_tellers: dict[int, _Teller] = {}  # by the id of the buffer; its value keeps the buffer alive


def _forget_parent() -> None:
    global _lock  # noqa: PLW0603 - the threads that had it are not in this process
    _lock = threading.RLock()
    _tellers.clear()


os.register_at_fork(after_in_child=_forget_parent)


async def _ended(buffer: Buffer, ask: Callable[[], int], until: float | None) -> int:
    """Return the end of a wait that `ask` starts; its duration is by the loop's clock."""
    import asyncio  # noqa: PLC0415 - it takes as long as all of tfdb

    loop = asyncio.get_running_loop()
    future: asyncio.Future[int] = loop.create_future()

    def tell(how: End) -> None:
        if future.done():
            return
        if isinstance(how, MemoryError):
            future.set_exception(how)
        else:
            future.set_result(how)

    wait = begin(buffer, ask, tell, loop)
    if wait is None:
        return CAME
    timer = loop.call_at(until, tell, TIMED_OUT) if until is not None else None
    try:
        return await future
    finally:
        if timer is not None:
            timer.cancel()
        wait.cancel()


def check(buffer: Buffer, how: End) -> int:
    """Return the newest commit, or raise the error that ended a wait."""
    if isinstance(how, MemoryError):
        raise how
    return buffer._check_wait(how)


def _limit(timeout: float | None) -> int | None:
    return None if timeout is None else duration_to_nanoseconds(timeout, "timeout")


def _until(limit: int | None) -> float | None:
    import asyncio  # noqa: PLC0415 - it takes as long as all of tfdb

    return None if limit is None else asyncio.get_running_loop().time() + limit / 1e9


def how_long(waited: int, *, stopped: bool) -> str:
    """Describe how long a wait took, and whether its node was shut down."""
    return f"waited {waited / 1e9:.3f} s" + (", then its node was shut down" if stopped else "")


def late(error: TfdbError, waited: int, stopped: bool) -> TfdbError:
    """Add the duration of the wait to the error of a lookup."""
    error.args = (f"{error}; {how_long(waited, stopped=stopped)}",)
    return error


def no_commit(after: int, limit: int | None, waited: int, stopped: bool) -> WaitTimeout:
    """Make the error of a wait for a commit that reached its timeout."""
    text = (
        f"no commit followed commit {after}; {how_long(waited, stopped=stopped)}: check that a "
        "process writes to the store, or wait longer"
    )
    return WaitTimeout(text, commit=after, limit=limit)


async def transform(
    buffer: Buffer,
    target: str,
    source: str,
    stamp: StampLike | None,
    timeout: float | None,
    policy: Policy | None,
) -> Transform:
    """Implements `Buffer.wait_for_transform_async`."""
    limit = _limit(timeout)
    until = _until(limit)
    began = time.monotonic_ns()
    how = CAME
    while True:
        try:
            return buffer.lookup_transform(target, source, stamp, policy)
        except NO_ANSWER_YET as error:
            if limit == 0:
                raise
            if how != CAME:
                raise late(error, time.monotonic_ns() - began, how == STOPPED) from None
        how = await _ended(buffer, lambda: buffer._begin_wait(target, source, stamp, policy), until)
        buffer._check_wait(how)


async def commit(
    buffer: Buffer,
    after: int,
    timeout: float | None,
) -> int:
    """Implements `Buffer.wait_for_commit_async`."""
    limit = _limit(timeout)
    began = time.monotonic_ns()
    how = await _ended(buffer, lambda: buffer._begin_wait_for_commit(after), _until(limit))
    newest = buffer._check_wait(how)
    if how != CAME:
        raise no_commit(after, limit, time.monotonic_ns() - began, how == STOPPED)
    return newest

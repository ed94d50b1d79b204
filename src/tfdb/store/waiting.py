"""Waits without a blocked thread: the buffer's thread or the writer reports how each ended."""

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

# What a commit may put right.
NO_ANSWER_YET = (
    UnknownFrame,
    Disconnected,
    Extrapolation,
    GapTooLarge,
    Stale,
    NoSampleNear,
    InvalidTransform,
)
LINGERS = 1.0  # seconds that the thread stays for the next wait
# How a wait ended, as `_ended_waits` says it.
CAME, TIMED_OUT, STOPPED = 0, 1, 4

CANCELLED = (None, None)

LOGGER = logging.getLogger("tfdb")

Loop: TypeAlias = "asyncio.AbstractEventLoop"
End: TypeAlias = int | MemoryError
"""End of a wait: an argument of `Buffer._check_wait`, or an exception."""
Tell: TypeAlias = "Callable[[End], None]"


Result = TypeVar("Result")


def _report_all(ended: Iterable[tuple[Tell, End]]) -> None:
    """Report each end. Ctrl-C or an exit in the main thread is raised after all reports."""
    stopped: BaseException | None = None
    for tell, how in ended:
        try:
            tell(how)
        except BaseException as error:  # the others are told all the same
            if isinstance(error, Exception) or not _in_main_thread():
                LOGGER.exception("what waited for a transform raised")
            else:
                stopped = error
    if stopped is not None:
        raise stopped


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


class _Teller:
    """Waits in a thread of its own for all that is begun on one buffer."""

    def __init__(self, buffer: Buffer) -> None:
        self.buffer = buffer
        self.waits: dict[int, tuple[Loop | None, Tell]] = {}
        # Held by the thread that takes ended waits. A writer holds it over its commit and takes
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
        """Report the ends of waits, each in its loop or in this thread."""
        told: defaultdict[Loop | None, list[tuple[Tell, End]]] = defaultdict(list)
        for number, how in ended.items():
            with _lock:
                loop, tell = self.waits.pop(number, CANCELLED)
            if tell is not None:
                told[loop].append((tell, how))
        for loop, members in told.items():
            if loop is not None:
                with suppress(RuntimeError):  # a closed loop has no waiter any more
                    loop.call_soon_threadsafe(_report_all, members)
        _report_all(told[None])


def write(buffer: Buffer, store: Callable[[], Result]) -> Result:
    """Call `store`, which writes to a buffer; then tell, in this thread, the waits that it ended.

    Returns what `store` returns. Where it raises, ended waits are told as well.
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
                with suppress(MemoryError):  # the teller takes them
                    ended = buffer._ended_waits(0)
    finally:
        teller.tell(ended)


class Wait:
    """A started wait, which ends once: reported or cancelled. Any thread may cancel it."""

    def __init__(self, teller: _Teller, number: int) -> None:
        self._teller = teller
        self._number = number

    def cancel(self) -> None:
        """End it untold; nothing happens if it has ended."""
        with _lock:
            if self._teller.waits.pop(self._number, None) is not None:
                self._teller.buffer._cancel_wait(self._number)


def begin(
    buffer: Buffer, ask: Callable[[], int], tell: Tell, loop: Loop | None = None
) -> Wait | None:
    """Begin a wait, whose end is told once, in `loop` or in the thread of the buffer's waits.

    `ask` is one of the store's `_begin_wait` functions. None: its answer is there; nothing is told.
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


# Collected garbage may be a coroutine that waits, and is then closed by a thread that has the lock.
_lock = threading.RLock()
_tellers: dict[int, _Teller] = {}  # by the identity of the buffer, which its teller keeps alive


def _forget_parent() -> None:
    global _lock  # noqa: PLW0603 - the threads that had it are not in this process
    _lock = threading.RLock()
    _tellers.clear()


os.register_at_fork(after_in_child=_forget_parent)


async def _ended(buffer: Buffer, ask: Callable[[], int], until: float | None) -> int:
    """Return the end of a wait that `ask` starts, by the loop's clock."""
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
    """Raise the error of a wait, or return the newest commit."""
    if isinstance(how, MemoryError):
        raise how
    return buffer._check_wait(how)


def _limit(timeout: float | None) -> int | None:
    return None if timeout is None else duration_to_nanoseconds(timeout, "timeout")


def _until(limit: int | None) -> float | None:
    import asyncio  # noqa: PLC0415 - it takes as long as all of tfdb

    return None if limit is None else asyncio.get_running_loop().time() + limit / 1e9


def how_long(waited: int, *, stopped: bool) -> str:
    """Word the length of a wait in nanoseconds, and an end by its node."""
    return f"waited {waited / 1e9:.3f} s" + (", then its node was shut down" if stopped else "")


def late(error: TfdbError, waited: int, stopped: bool) -> TfdbError:
    """Add to the error of a lookup how long it was waited for."""
    error.args = (f"{error}; {how_long(waited, stopped=stopped)}",)
    return error


def no_commit(after: int, limit: int | None, waited: int, stopped: bool) -> WaitTimeout:
    """Make the error of a wait for a commit that did not come."""
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

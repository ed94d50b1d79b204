"""Waits in coroutines: one thread waits for all of a buffer's, and tells their event loops."""

from __future__ import annotations

import asyncio
import os
import threading
from collections import defaultdict
from contextlib import suppress
from typing import TYPE_CHECKING

from ._core import duration_to_nanoseconds
from .errors import (
    Disconnected,
    Extrapolation,
    GapTooLarge,
    InvalidTransform,
    NoSampleNear,
    Stale,
    UnknownFrame,
    WaitTimeout,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from ._core import Buffer, Policy, Transform
    from .stamps import StampLike

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
TIMED_OUT = 1  # how a wait ended, as `_ended_waits` says it; 0: its answer came

Loop = asyncio.AbstractEventLoop
Future = asyncio.Future[int]


def _tell(ended: Iterable[tuple[Future, int | MemoryError]]) -> None:
    for future, how in ended:
        if future.done():
            continue
        if isinstance(how, MemoryError):
            future.set_exception(how)
        else:
            future.set_result(how)


class _Teller:
    """Waits in a thread of its own for the coroutines that wait on one buffer."""

    def __init__(self, buffer: Buffer) -> None:
        self.buffer = buffer
        self.futures: dict[int, tuple[Loop, Future]] = {}
        threading.Thread(target=self.run, name="tfdb waits", daemon=True).start()

    def run(self) -> None:
        while True:
            try:
                ended: list[tuple[int, int | MemoryError]] = [*self.buffer._ended_waits(LINGERS)]
            except MemoryError as error:
                ended = [(number, error) for number in [*self.futures]]
            told: defaultdict[Loop, list[tuple[Future, int | MemoryError]]] = defaultdict(list)
            with _lock:
                if not ended and not self.futures:
                    del _tellers[id(self.buffer)]
                    return
                for number, how in ended:
                    if waiting := self.futures.pop(number, None):
                        loop, future = waiting
                        told[loop].append((future, how))
                    if isinstance(how, MemoryError):
                        self.buffer._cancel_wait(number)
            for loop, members in told.items():
                with suppress(RuntimeError):  # a loop that was closed: nobody waits there any more
                    loop.call_soon_threadsafe(_tell, members)


# Collected garbage may be a coroutine that waits, and is then closed by a thread that has the lock.
_lock = threading.RLock()
_tellers: dict[int, _Teller] = {}  # by the identity of the buffer, which its teller keeps alive


def _forget_parent() -> None:
    global _lock  # noqa: PLW0603 - the threads that had it are not in this process
    _lock = threading.RLock()
    _tellers.clear()


os.register_at_fork(after_in_child=_forget_parent)


async def _ended(buffer: Buffer, begin: Callable[[], int], until: float | None) -> int:
    """Say how a wait ended that `begin` begins, by the loop's clock."""
    loop = asyncio.get_running_loop()
    future: Future = loop.create_future()
    with _lock:
        number = begin()
        if number == 0:
            return 0
        teller = _tellers.get(id(buffer))
        if teller is None:
            teller = _tellers[id(buffer)] = _Teller(buffer)
        teller.futures[number] = (loop, future)
    alarm = loop.call_at(until, _tell, [(future, TIMED_OUT)]) if until is not None else None
    try:
        return await future
    finally:
        if alarm is not None:
            alarm.cancel()
        with _lock:
            if teller.futures.pop(number, None) is not None:
                buffer._cancel_wait(number)


def _limit(timeout: float | None) -> int | None:
    return None if timeout is None else duration_to_nanoseconds(timeout, "timeout")


def _until(limit: int | None) -> float | None:
    return None if limit is None else asyncio.get_running_loop().time() + limit / 1e9


async def transform(
    buffer: Buffer,
    target: str,
    source: str,
    time: StampLike | None,
    timeout: float | None,
    policy: Policy | None,
) -> Transform:
    """Do what `Buffer.wait_for_transform_async` says."""
    limit = _limit(timeout)
    until = _until(limit)
    how = 0
    while True:
        try:
            return buffer.lookup_transform(target, source, time, policy)
        except NO_ANSWER_YET:
            if how == TIMED_OUT or limit == 0:
                raise
        how = await _ended(buffer, lambda: buffer._begin_wait(target, source, time, policy), until)
        buffer._check_wait(how)


async def commit(
    buffer: Buffer,
    after: int,
    timeout: float | None,
) -> int:
    """Do what `Buffer.wait_for_commit_async` says."""
    limit = _limit(timeout)
    how = await _ended(buffer, lambda: buffer._begin_wait_for_commit(after), _until(limit))
    newest = buffer._check_wait(how)
    if limit is not None and how == TIMED_OUT:
        text = f"no commit came after commit {after} within {timeout} s"
        raise WaitTimeout(text, commit=after, limit=limit)
    return newest

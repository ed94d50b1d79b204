"""Retries of transactions until they commit."""

from __future__ import annotations

import inspect
import math
import operator
import random
import time
from collections.abc import AsyncGenerator, Generator
from typing import TYPE_CHECKING, Any, TypeVar, cast

from tfdb._core import duration_to_nanoseconds
from tfdb.data.errors import Conflict, InvalidArgument, TransactionClosed

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb._core import Buffer, Transaction

__all__: list[str] = []

Result = TypeVar("Result")
"""Result of the function of `Buffer.run`."""

LOST_BEFORE_ALONE = 8
"""Number of attempts that may conflict; the next one runs alone and cannot."""

SHORTEST_WAIT = 100e-6
"""Longest wait after the first conflict, in seconds; it doubles with each conflict."""

LONGEST_WAIT = 10e-3
"""Longest wait between two attempts, in seconds."""


def run_until_won(
    self: Buffer,
    fn: Callable[[Transaction], Result],
    *,
    retries: int,
    timeout: float | None,
    priority: int,
) -> Result:
    """Implements `Buffer.run`."""
    if not callable(fn):
        raise TypeError(f"fn must be callable with a transaction, got {type(fn).__name__}")
    most = _count(retries) + 1
    end = _deadline(timeout)
    age = 0
    attempt = 1
    while True:
        transaction = self._attempt(priority, attempt > LOST_BEFORE_ALONE, age)
        try:
            with transaction:
                result = _result_of(fn, transaction)
        except Conflict as error:
            if not transaction._lost:
                raise  # a transaction of another store
            wait = random.uniform(0, min(SHORTEST_WAIT * 2 ** (attempt - 1), LONGEST_WAIT))  # noqa: S311
            if attempt >= most or time.monotonic() + wait >= end:
                _raise_last_conflict(error, attempt)
                raise
        else:
            return result
        age = transaction._age
        attempt += 1
        time.sleep(wait)


def _result_of(fn: Callable[[Transaction], Result], transaction: Transaction) -> Result:
    """Call `fn`. A conflict that `fn` caught is raised again."""
    try:
        result = fn(transaction)
    except TransactionClosed:
        if transaction._lost:
            transaction.__exit__(None, None, None)
        raise
    _check_done(result)
    return result


def commit_of(self: Buffer, write: Callable[[Transaction], None]) -> int:
    """Run `write` as one commit, and return its number."""

    def attempt(transaction: Transaction) -> Transaction:
        write(transaction)
        return transaction

    won = run_until_won(self, attempt, retries=LOST_BEFORE_ALONE, timeout=None, priority=0)
    return cast("int", won.commit)


def _check_done(result: object) -> None:
    """Refuse coroutines and generators: the transaction would end before they run."""
    if inspect.iscoroutine(result):
        result.close()
    elif not inspect.isawaitable(result) and not isinstance(result, Generator | AsyncGenerator):
        return
    raise TypeError(
        f"fn returned a {type(result).__name__}, so it has not done its work yet: give run() a "
        "plain function, neither `async def` nor a generator, and await before or after it"
    )


def _raise_last_conflict(error: Conflict, attempts: int) -> None:
    error.attempts = attempts
    tried = "once" if attempts == 1 else f"{attempts} times"
    error.args = (f"{error} (tried {tried}; more retries or a longer timeout may help)",)


def _count(retries: Any) -> int:
    try:
        count = -1 if isinstance(retries, bool) else operator.index(retries)
    except TypeError:
        count = -1
    if count < 0:
        raise InvalidArgument(f"retries must be an integer >= 0, got {retries!r}", value=retries)
    return count


def _deadline(timeout: Any) -> float:
    if timeout is None:
        return math.inf
    return time.monotonic() + duration_to_nanoseconds(timeout, "timeout") / 1e9

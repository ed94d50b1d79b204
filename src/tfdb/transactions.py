"""Transactions that are tried again until they win."""

from __future__ import annotations

import inspect
import math
import operator
import random
import time
from collections.abc import AsyncGenerator, Generator
from typing import TYPE_CHECKING, Any, TypeVar

from .errors import Conflict, InvalidArgument

if TYPE_CHECKING:
    from collections.abc import Callable

    from ._core import Buffer, Transaction

__all__: list[str] = []

Result = TypeVar("Result")
"""What the function of `Buffer.run` returns."""

LOST_BEFORE_ALONE = 8
"""So many attempts may lose; the next one runs alone, and then nobody can come first."""

SHORTEST_WAIT = 100e-6
"""Seconds: the most that is waited after the first lost attempt; twice as much after each next."""

LONGEST_WAIT = 10e-3
"""Seconds: more than this is never waited between two attempts."""


def run(
    self: Buffer,
    fn: Callable[[Transaction], Result],
    *,
    retries: int = LOST_BEFORE_ALONE,
    timeout: float | None = None,
    priority: int = 0,
) -> Result:
    """Run `fn(tx)` in a transaction, again and again until its commit wins.

    `fn` may be called several times: what it does beside `tx` must bear that. An attempt that lost
    (Conflict) left nothing behind. Before the next one a random time passes, up to 0.1 ms after the
    first, twice as long after each next, never more than 10 ms. An attempt keeps the seniority of
    the first. After eight lost attempts the ninth runs alone: writers wait for it, so it cannot
    lose. `fn` is hence called nine times at most, however busy the store is, and always wins unless
    `retries` or `timeout` set a closer limit.

    Parameters
    ----------
    fn
        Called with an open `Transaction`; it need not commit. Any exception of its own ends the
        transaction without a trace and is raised at once. It reads and writes through the
        transaction only (TransactionActive), and is done when it returns: not `async def`, no
        generator.
    retries
        How many attempts may follow the first; 8, the default, are always enough.
    timeout
        Seconds after which no further attempt begins; None: no limit. The first one always does.
    priority
        From 0 to 7, as in `transaction`.

    Returns
    -------
    object
        What `fn` returned in the attempt that was committed.

    Raises
    ------
    Conflict
        The last one, with `attempts`, when retries or time were used up.
    InvalidArgument
        A number that is out of its range.
    TransactionActive
        This thread has a transaction open in the store already; also where `fn` reads from the
        Buffer itself, or writes to it.
    TypeError
        `fn` cannot be called, or returned before it did its work. Nothing was stored.
    CycleError, CapacityExceeded
        At the commit. Nothing was stored.
    """
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
                result = fn(transaction)
                _check_done(result)
        except Conflict as error:
            if not transaction._lost:
                raise  # of another store
            wait = random.uniform(0, min(SHORTEST_WAIT * 2 ** (attempt - 1), LONGEST_WAIT))  # noqa: S311
            if attempt >= most or time.monotonic() + wait >= end:
                _give_up(error, attempt)
                raise
        else:
            return result
        age = transaction._age
        attempt += 1
        time.sleep(wait)


def _check_done(result: object) -> None:
    """Refuse a function that has not run yet: its transaction would end before it begins."""
    if inspect.iscoroutine(result):
        result.close()
    elif not inspect.isawaitable(result) and not isinstance(result, Generator | AsyncGenerator):
        return
    raise TypeError(
        f"fn returned a {type(result).__name__}, so it has not done its work yet: give run() a "
        "plain function, neither `async def` nor a generator, and await before or after it"
    )


def _give_up(error: Conflict, attempts: int) -> None:
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
    try:
        seconds = -1.0 if isinstance(timeout, bool | str) else float(timeout)
    except (TypeError, ValueError):
        seconds = -1.0
    if not seconds >= 0.0:
        message = f"timeout must be a number of seconds >= 0, or None, got {timeout!r}"
        raise InvalidArgument(message, value=timeout)
    return time.monotonic() + seconds

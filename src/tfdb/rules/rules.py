"""The class Rules: the rules of a buffer, and their common settings."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import TYPE_CHECKING
from weakref import WeakSet

from tfdb._core import duration_to_nanoseconds
from tfdb.data.argument_checks import check_callable, check_count
from tfdb.data.errors import InvalidArgument
from tfdb.data.lazy_names import belong_to

from .dispatcher import Dispatcher

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tfdb._core import Buffer

    from .event import Event
    from .rule import Rule
    from .stats import RuleStats

__all__ = ["Rules"]


class Rules:
    """The installed rules of a buffer, in the order of installation: `Buffer.rules`.

    A child of `fork` has these settings, but no rules.
    """

    def __init__(self, buffer: Buffer) -> None:
        self._buffer = buffer
        self._dispatcher = Dispatcher(buffer)
        _all.add(self)

    def __iter__(self) -> Iterator[Rule]:
        return iter(tuple(self._dispatcher.rules))

    def __len__(self) -> int:
        return len(self._dispatcher.rules)

    def __repr__(self) -> str:
        return f"<tfdb.rules.Rules: {len(self)} installed>"

    @property
    def threads(self) -> int:
        """Largest number of actions that run at once."""
        return self._dispatcher.pool.threads

    @threads.setter
    def threads(self, threads: int) -> None:
        self._dispatcher.pool.resize(check_count("threads", threads))

    @property
    def on_error(self) -> Callable[[Rule, Event | None, BaseException], object] | None:
        """Function that is called with each exception of a condition or an action.

        Its arguments are the rule, the event (None if the condition raised) and the exception. The
        logger `tfdb.rules` also logs the exception.
        """
        return self._dispatcher.on_error

    @on_error.setter
    def on_error(
        self, function: Callable[[Rule, Event | None, BaseException], object] | None
    ) -> None:
        if function is not None:
            check_callable("on_error", function)
        self._dispatcher.on_error = function

    @property
    def stats_log_interval(self) -> float | None:
        """Seconds between two entries with the counts in the log `tfdb.rules`; None: no entries."""
        return self._dispatcher.log_interval

    @stats_log_interval.setter
    def stats_log_interval(self, seconds: float | None) -> None:
        if seconds is not None:
            seconds = duration_to_nanoseconds(seconds, "stats_log_interval") / 1e9
            if seconds == 0:
                text = "stats_log_interval must be positive or None, got 0"
                raise InvalidArgument(text, value=seconds)
        self._dispatcher.log_interval = seconds
        self._dispatcher.wake()

    @property
    def stats(self) -> RuleStats:
        """The counts of all rules, including removed ones."""
        return replace(self._dispatcher.total)

    def drain(self, timeout: float | None = None) -> bool:
        """Wait until all commits so far are evaluated, and no action waits or runs.

        Parameters
        ----------
        timeout
            Seconds; None: for ever.

        Returns
        -------
        bool
            False: the timeout has passed.

        Raises
        ------
        InvalidArgument
            The timeout is negative, or a rule's function calls this and would wait for itself.
        BufferClosed
        """
        if timeout is not None:
            timeout = duration_to_nanoseconds(timeout, "timeout") / 1e9
        return self._dispatcher.drain(timeout)

    def _add(self, rule: Rule) -> Rule:
        self._dispatcher.add(rule)
        return rule


_all: WeakSet[Rules] = WeakSet()


def _forget_parent() -> None:
    for rules in list(_all):
        rules._dispatcher = rules._dispatcher.in_child()


os.register_at_fork(after_in_child=_forget_parent)

belong_to("tfdb.rules", globals(), __all__)

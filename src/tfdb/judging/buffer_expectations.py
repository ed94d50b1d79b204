"""The class BufferExpectations: the expectations of a buffer; the arguments of `Buffer.expect`."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any
from weakref import WeakSet

from tfdb._core import duration_to_nanoseconds
from tfdb.data.argument_checks import check_callable, check_flag
from tfdb.data.errors import InvalidArgument
from tfdb.data.lazy_names import belong_to
from tfdb.data.stamps import shown

from .expectations import Expectation, Expectations, lifespans
from .installed import Installed
from .watcher import Watcher

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from tfdb._core import Buffer

    from .event_stream import EventStream
    from .events import Event

__all__ = ["BufferExpectations"]


class BufferExpectations:
    """The expectations of a buffer, in the order of installation: `Buffer.expectations`."""

    def __init__(self, buffer: Buffer) -> None:
        self._buffer = buffer
        self._watcher = Watcher(buffer)
        _all.add(self)

    def __iter__(self) -> Iterator[Installed]:
        return iter(tuple(self._watcher.installed))

    def __len__(self) -> int:
        return len(self._watcher.installed)

    def __repr__(self) -> str:
        return f"<tfdb.judging.BufferExpectations: {len(self)} installed>"

    @property
    def active(self) -> list[Event]:
        """The events that have begun and not ended, the worst first."""
        return self._watcher.active()

    @property
    def missed(self) -> int:
        """Number of commits that were not checked, because they came faster than they were read."""
        return self._watcher.missed

    @property
    def on_event(self) -> Callable[[Event], object] | None:
        """Function that is called with each event, in the thread that checks the expectations.

        The logger `tfdb.expectations` logs its exceptions, which have no other effect.
        """
        return self._watcher.on_event

    @on_event.setter
    def on_event(self, function: Callable[[Event], object] | None) -> None:
        if function is not None:
            check_callable("on_event", function)
        self._watcher.on_event = function

    def drain(self, timeout: float | None = None) -> bool:
        """Wait until all commits so far are checked and their events delivered.

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
            The timeout is negative, or `on_event` calls this and would wait for itself.
        BufferClosed, NoSuchStore
        """
        if timeout is not None:
            timeout = duration_to_nanoseconds(timeout, "timeout") / 1e9
        return self._watcher.drain(timeout)

    def _add(self, expectations: Expectations, *, enforce: bool) -> Installed:
        enforce = check_flag("enforce", enforce)
        if enforce:
            _check_enforceable(self._buffer, expectations)
        installed = Installed(expectations, enforce=enforce)
        self._watcher.add(installed)
        return installed

    def _events(self, max_pending: int) -> EventStream:
        return self._watcher.events(max_pending)


def expectations_of(given: str | Expectations, child: str | None, limits: Any) -> Expectations:
    """Return the expectations in the arguments of `Buffer.expect`."""
    if isinstance(given, Expectations):
        if child is not None or limits:
            named = "child" if child is not None else next(iter(limits))
            raise InvalidArgument(
                f"{named} cannot be combined with an Expectations object; pass one of the two"
            )
        return given
    if child is None:
        raise InvalidArgument(
            f"child is missing: pass parent and child, or an Expectations object; got "
            f"{shown(given)}",
            value=given,
        )
    return Expectations([Expectation(given, child, **limits)])


def _check_enforceable(buffer: Buffer, expectations: Expectations) -> None:
    if not lifespans([(expectations, True)]):
        raise InvalidArgument("enforce=True needs an expectation with lifespan")
    if expectations.clock != "stamps":
        raise InvalidArgument(
            "enforce=True needs the clock 'stamps': a store does not record arrival times"
        )
    if buffer._clock is not None:
        raise InvalidArgument(
            "enforce=True uses the store's clock, but this buffer was made with clock=; make it "
            "without"
        )


_all: WeakSet[BufferExpectations] = WeakSet()


def _forget_parent() -> None:
    for each in list(_all):
        each._watcher.abandon()
        each._watcher = Watcher(each._buffer)


os.register_at_fork(after_in_child=_forget_parent)

belong_to("tfdb.judging", globals(), __all__)

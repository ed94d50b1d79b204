"""The thread that evaluates a buffer's expectations."""

from __future__ import annotations

import logging
import math
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING
from weakref import WeakSet

from tfdb.data.errors import (
    BufferClosed,
    FeedLapped,
    InvalidArgument,
    NoSuchStore,
    TfdbError,
    WatchClosed,
)
from tfdb.store.given_clock import given_clock

from .event_stream import LOGGER, EventStream
from .expectations import joined, lifespans
from .judge import Judge
from .live import LiveJudge

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb._core import Buffer, Watch

    from .events import Event
    from .installed import Installed

__all__: list[str] = []

_LEVELS = {
    "ok": logging.INFO,
    "warning": logging.WARNING,
    "error": logging.ERROR,
    "stale": logging.ERROR,
}


class _Source:
    """A buffer that is followed. `wake` ends a wait, from any thread."""

    def __init__(self, buffer: Buffer) -> None:
        self.store = buffer
        given = given_clock(buffer)
        self.clock = buffer.clock if given is None else None
        self.now = given or buffer.clock.now
        self.commit = 0
        self._watch = self._new_watch()
        self._woken = threading.Event()

    def _new_watch(self) -> Watch:
        watch = self.store.watch(every=True)
        with suppress(FeedLapped):
            watch.next(self.store.commit, 0, limit=1)  # the first call registers the watch
        return watch

    def close(self) -> None:
        self._watch.close()

    def wake(self) -> None:
        self._woken.set()
        old = self._watch
        with suppress(TfdbError):  # if this thread must not make one, the other thread does
            self._watch = self._new_watch()
        old.close()

    def wait(self, until: float) -> bool:
        left = None if math.isinf(until) else max(until - time.monotonic(), 0)
        watch = self._watch
        if not self._woken.is_set():
            try:
                watch.next(self.commit, left, limit=1)
            except FeedLapped:
                pass  # the next read counts the lost commits
            except WatchClosed:
                if self._watch is watch:
                    self._watch = self._new_watch()
        self._woken.clear()
        newest = self.store.commit
        found, self.commit = newest > self.commit, newest
        return found

    def sleep(self, until: float) -> None:
        self._woken.wait(max(until - time.monotonic(), 0))


class Watcher:
    """Evaluates all installed expectations of one buffer.

    The lock guards the installed expectations and the judge. Neither callbacks nor clocks of users
    run under it.
    """

    def __init__(self, buffer: Buffer) -> None:
        self._buffer = buffer
        self._lock = threading.Condition()
        self.installed: list[Installed] = []
        self.on_event: Callable[[Event], object] | None = None
        self._streams: WeakSet[EventStream] = WeakSet()
        self._live: LiveJudge | None = None
        self._source: _Source | None = None
        self._pending: list[Event] = []  # to be reported first
        self._thread: threading.Thread | None = None
        self._error: BaseException | None = None  # that ended the evaluation
        self._asked = 0
        self._answered = 0

    def add(self, installed: Installed) -> None:
        """Add expectations from now on."""
        source = _Source(self._buffer)  # raises for a buffer that cannot be followed
        now = source.now()
        with self._lock:
            if self._live is not None:
                source.close()
                self._change(self._live, [*self.installed, installed], now)
            else:
                self._source = source
                self._live = LiveJudge(source, Judge(installed.expectations, now), now=now)
                self._pending, self._error = self._live.begun, None
            self.installed.append(installed)
            installed._remove = self.remove
            self._enforce()
            if self._thread is None:
                self._thread = threading.Thread(
                    target=self._run, name="tfdb expectations", daemon=True
                )
                self._thread.start()
            self._wake()

    def remove(self, installed: Installed) -> None:
        """Evaluate the remaining expectations."""
        with self._lock:
            if installed.removed:
                return
            self.installed.remove(installed)
            installed._remove = None
            self._enforce()
            if self._live is not None and self.installed:
                self._change(self._live, self.installed, self._live.looked)
            else:
                self._live = None
            self._wake()

    def events(self, max_pending: int) -> EventStream:
        """Return a stream of later events."""
        stream = EventStream(self._buffer, max_pending)
        _ = self._buffer.commit  # it raises BufferClosed
        with self._lock:
            self._streams.add(stream)
        return stream

    @property
    def missed(self) -> int:
        """Number of missed commits."""
        with self._lock:
            return 0 if self._live is None else self._live.missed

    def active(self) -> list[Event]:
        """Return the events that have begun and not ended."""
        with self._lock:
            if self._live is None:
                return []
            return sorted(self._live.judge.active.values(), key=lambda event: event.rank)

    def drain(self, timeout: float | None) -> bool:
        """Wait until all commits so far, and the time until now, are evaluated and reported."""
        if threading.current_thread() is self._thread:
            raise InvalidArgument("drain() cannot be called in on_event: it would wait for itself")
        until = None if timeout is None else time.monotonic() + timeout
        _ = self._buffer.commit
        with self._lock:
            self._asked += 1
            asked = self._asked
            self._wake()
            while self._thread is not None and self._answered < asked:
                left = None if until is None else until - time.monotonic()
                if not self._lock.wait(left):
                    return False
            if self._error is not None:
                raise self._error.with_traceback(None)
        _ = self._buffer.commit
        return True

    def abandon(self) -> None:
        """Forget all in a child of fork, whose threads are gone."""
        if self.installed:  # so the buffer has a store
            for installed in self.installed:
                installed._remove = None
            self.installed = []
            self._enforce()
        for stream in list(self._streams):
            stream._abandon()

    def _enforce(self) -> None:
        parts = [(each.expectations, each.enforce) for each in self.installed]
        enforced = any(each.enforce for each in self.installed)
        self._buffer._enforce(lifespans(parts) if enforced else [])

    def _change(self, live: LiveJudge, installed: list[Installed], now: int) -> None:
        live.change(joined([each.expectations for each in installed]), now)

    def _wake(self) -> None:
        if self._source is not None:
            self._source.wake()

    def _run(self) -> None:
        try:
            while self._step():
                pass
        except (BufferClosed, NoSuchStore) as error:
            self._end(error)
        except BaseException as error:
            LOGGER.exception("the expectations of a buffer have ended")
            self._end(error)

    def _step(self) -> bool:
        """Evaluate the next commits, or due silences. False: no expectation remains."""
        with self._lock:
            live, source, asked = self._live, self._source, self._asked
            if live is None or source is None:
                self._thread = self._source = None
                self._lock.notify_all()
                return False
            newest, missed = self._buffer.commit, live.missed
        stretches = live.read(0.0 if asked > self._answered else math.inf)
        look = live.look()
        with self._lock:
            if self._live is not live:
                return True
            events, self._pending = self._pending + live.take(stretches, look), []
        if live.missed > missed:
            text = "%d commits were skipped: they came faster than they were read"
            LOGGER.warning(text, live.missed - missed)
        for event in events:
            self._tell(event)
        if source.commit >= newest:
            with self._lock:
                self._answered = asked
                self._lock.notify_all()
        return True

    def _tell(self, event: Event) -> None:
        LOGGER.log(_LEVELS[event.severity], "%s", event)
        with self._lock:
            streams = list(self._streams)
        for stream in streams:
            stream._put(event)
        if (tell := self.on_event) is not None:
            try:
                tell(event)
            except BaseException:  # the main thread handles an exit or Ctrl-C
                LOGGER.exception("on_event raised")

    def _end(self, error: BaseException) -> None:
        with self._lock:
            for installed in self.installed:
                installed._remove = None
            self.installed = []
            self._enforce()
            self._live = self._source = self._thread = None
            self._error = error
            streams = list(self._streams)
            self._lock.notify_all()
        for stream in streams:
            stream._end(error)

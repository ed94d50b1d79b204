"""The class AnswerStream: the results of one lookup, one for each commit that changes it."""

from __future__ import annotations

from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING

from tfdb.data.argument_checks import check_count
from tfdb.data.errors import SnapshotTooOld
from tfdb.data.lazy_names import belong_to
from tfdb.store.waiting import NO_ANSWER_YET

from .cursor import Cursor, separation_of
from .reader import deadline

if TYPE_CHECKING:
    from tfdb._core import Buffer, Snapshot, Transform

    from .cursor import Lapped

__all__ = ["AnswerStream"]

_COMMITS = 256  # largest number of commits whose states are read at once


class AnswerStream(Cursor["Transform"]):
    """The results T[target<-source] of one lookup, one for each commit that changes the result.

    `Buffer.follow(pair=...)` creates it. A result is that of `lookup_transform` without a stamp, in
    the state of the commit. A new pose or a new stamp is a new result. Iterate over the stream, or
    call the `read_` methods. It is a context manager; any thread may call `close()`, which ends all
    reads.
    """

    def __init__(
        self,
        buffer: Buffer,
        pair: tuple[str, str],
        held: bool,
        *,
        hold: bool,
        min_separation: float | None,
        lapped: Lapped,
        poll: float,
    ) -> None:
        self._pair = pair
        self._separation = separation_of(min_separation)
        self._answers: deque[Transform] = deque()
        self._last: Transform | None = None
        self._delivered: int | None = None  # stamp of the last result
        start = buffer.snapshot()
        try:
            super().__init__(
                buffer, lambda: buffer.watch(pairs=[pair]), start, None,
                hold=hold, lapped=lapped, poll=poll,
            )  # fmt: skip
            self._answer(start)
            if not held:
                self._answers.clear()
                self._delivered = None
        except BaseException:
            start.close()
            raise
        if not hold:
            start.close()

    def read_next(self, n: int = 1, timeout: float | None = 0) -> Transform | None:
        """Read the result `n` places after the last one read.

        Parameters
        ----------
        n
            A number of results, not of seconds.
        timeout
            Seconds to wait for it; 0: do not wait; None: for ever.

        Returns
        -------
        Transform or None
            None: it does not exist yet. The stream does not move.

        Raises
        ------
        FeedLapped
            Commits left the feed before they were read. `missed` counts them, and the next read
            continues after them. Not with `lapped="skip"`.
        InvalidArgument, StreamClosed, BufferClosed, NoSuchStore, TransactionActive
        """
        n = check_count("n", n)
        until = deadline(timeout)
        with self._lock:
            self._check_open()
            while len(self._answers) < n:
                if not self._more(self._read_answers) and not self._wait(until):
                    return None
            for _ in range(n - 1):
                self._answers.popleft()
            return self._answers.popleft()

    def read_new(self, timeout: float | None = 0) -> Transform | None:
        """Read the newest result, if it is newer than the last one read. Skip those between.

        Parameters
        ----------
        timeout
            As in `read_next`.

        Returns
        -------
        Transform or None
            None: it has not changed since.

        Raises
        ------
        InvalidArgument, StreamClosed, BufferClosed, NoSuchStore, TransactionActive
        """
        until = deadline(timeout)
        with self._lock:
            self._check_open()
            while True:
                while self._more(self._read_answers, quietly=True):
                    pass
                if self._answers:
                    newest = self._answers.pop()
                    self._answers.clear()
                    return newest
                if not self._wait(until):
                    return None

    def _read_answers(self) -> bool:
        before = len(self._answers)
        held, newest = self._held, self._buffer.commit
        if held is None or self._watch is None:
            # The states before the newest one are not kept.
            with self._buffer.snapshot() as state:
                self._answer(state)
                self._position = state.commit
            return len(self._answers) > before
        touched = self._watch.next(self._position, 0, limit=_COMMITS)
        for record in touched:
            try:
                with held.at(record.commit) as state:
                    self._answer(state)
            except SnapshotTooOld:
                self._gone += 1
        last = touched[-1].commit if touched else 0
        self._position = last if len(touched) == _COMMITS else max(newest, last)
        return len(self._answers) > before

    def _answer(self, state: Snapshot) -> None:
        """Store the result of a state, if it differs from the last one."""
        found = None
        with suppress(*NO_ANSWER_YET):
            found = state.lookup_transform(*self._pair)
        if found is None or found == self._last:
            self._last = found
            return
        self._last = found
        earliest = 0 if self._delivered is None else self._delivered + (self._separation or 0)
        if self._separation is not None and found.stamp < earliest:
            return
        self._delivered = found.stamp
        self._answers.append(found)


belong_to("tfdb.streams", globals(), __all__)

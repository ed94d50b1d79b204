"""The class Stream: the samples that commits store, each once and in order."""

from __future__ import annotations

import time
from collections import deque
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from tfdb._core import StreamRows, duration_to_nanoseconds, to_nanoseconds
from tfdb.data.argument_checks import check_count
from tfdb.data.errors import FeedLapped, Gone, InvalidArgument, StreamClosed
from tfdb.data.lazy_names import belong_to
from tfdb.data.policies import Previous
from tfdb.data.types import Changes, Sample

from .cursor import Cursor, separation_of
from .reader import deadline
from .rows import NONE, joined, of_bytes, of_changes

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tfdb._core import Buffer, Snapshot
    from tfdb.data.stamps import StampLike
    from tfdb.data.types import Batch

    from .cursor import Lapped
    from .rows import Rows

__all__ = ["Stream"]

_COMMITS = 4096  # largest number that is read at once
_BYTES = 1 << 20
_RECORDS = 64
_GATHERS = 0.001  # seconds: also the pause of waits between two checks
_QUICK = 8  # consecutive reads without a wait for more commits


class Stream(StreamRows, Cursor["Sample"]):
    """A cursor over the samples that commits store: each once, in the order of commits.

    `Buffer.follow()` creates it. Iterate over it, over `batches()` or over `changes()`, or call the
    `read_` methods. The samples of a commit are sorted by edge and stamp, the moving ones first.
    `Stream` is a context manager. Any thread may ask for `commit`, and may call `close()`, which
    ends all reads. One thread reads at a time, and others wait for it. If commits are frequent,
    iteration reads those of a millisecond together.
    """

    def __init__(
        self,
        buffer: Buffer,
        frames: Sequence[str] | None,
        since: object,
        held: bool,
        *,
        hold: bool,
        min_separation: float | None,
        lapped: Lapped,
        poll: float,
    ) -> None:
        self._frames = frames
        self._takes_every_commit = frames is None
        self._separation = separation_of(min_separation)
        self._delivered: dict[str, int] = {}  # the stamp that was read last, by child
        self._rows = NONE
        self._read_at = 0.0  # time at which they were read
        self._quick = 0  # consecutive reads with short pauses
        self._held_commit = 0  # number of rows from before the stream
        self._floor = 0  # `read_back` reads later commits only
        self._records: deque[Changes] = deque()
        self._left = 0  # how often unread rows were left to be read as records
        start = buffer.snapshot()
        try:
            super().__init__(
                buffer, lambda: buffer.watch(frames or (), every=frames is None), start, since,
                hold=hold, lapped=lapped, poll=poll,
            )  # fmt: skip
            if held:
                self._held_commit, rows = of_bytes(start.state_bytes(frames=frames))
                self._floor = self._held_commit
                self._append(rows)
        except BaseException:
            start.close()
            raise
        if not hold:
            start.close()

    @property
    def commit(self) -> int:
        """The last commit that was read completely; `follow(since=...)` continues from it."""
        while True:
            # Another thread may be reading: it stores what it read, then its new position.
            left, position = self._left, self._position
            if (unread := self._commit_of_next()) is not None:
                return unread - 1
            with suppress(IndexError):
                return self._records[0].commit - 1
            if left == self._left:
                return position

    def read_next(self, n: int = 1, timeout: float | None = 0) -> Sample | None:
        """Read the sample `n` places after the last one read.

        Parameters
        ----------
        n
            A number of samples, not of seconds.
        timeout
            Seconds to wait for it; 0: do not wait; None: for ever.

        Returns
        -------
        Sample or None
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
            while self._unread < n:
                if until is None:
                    self._gather()
                if not self._more_rows() and not self._wait(until):
                    return None
            return self._move(n)

    def read_new(self, timeout: float | None = 0) -> Sample | None:
        """Read the newest sample, if it is newer than the last one read. Skip those between.

        Parameters
        ----------
        timeout
            As in `read_next`.

        Returns
        -------
        Sample or None
            None: the store has no newer sample.

        Raises
        ------
        InvalidArgument, StreamClosed, BufferClosed, NoSuchStore, TransactionActive
        """
        until = deadline(timeout)
        with self._lock:
            self._check_open()
            while not self._drain():
                if not self._wait(until):
                    return None
            return self._move(self._unread)

    def read_last(self, timeout: float | None = 0) -> Sample | None:
        """Read the newest sample, even if it was read before. Skip those between.

        If no sample was stored since the stream began, the call reads as `read_at`, and the stream
        does not move.

        Parameters
        ----------
        timeout
            As in `read_next`.

        Returns
        -------
        Sample or None
            None: the store has no sample.

        Raises
        ------
        InvalidArgument, StreamClosed, BufferClosed, NoSuchStore, TransactionActive
        """
        until = deadline(timeout)
        with self._lock:
            self._check_open()
            while True:
                if self._drain():
                    return self._move(self._unread)
                if self._next:
                    return self._sample(self._next - 1)
                if (found := self._of_state(None)) is not None or not self._wait(until):
                    return found

    def read_back(self, n: int = 1) -> Sample | None:
        """Read the sample `n` places before the last one read.

        It can go back over the commits that the store still lists, but not to samples from before
        the start of a stream with `since="held"`.

        Parameters
        ----------
        n
            A number of samples, not of seconds.

        Returns
        -------
        Sample or None
            None: the feed no longer has the sample. The stream does not move.

        Raises
        ------
        InvalidArgument
            Also with `min_separation`, because skipped samples would count.
        StreamClosed, BufferClosed, NoSuchStore, TransactionActive
        """
        n = check_count("n", n)
        if self._separation is not None:
            raise InvalidArgument(
                "read_back() is not valid with min_separation: it counts all samples"
            )
        with self._lock:
            self._check_open()
            back = n + self._has_read
            while self._next < back:
                if not self._earlier():
                    return None
            if self._held_commit and self._rows.commits[self._next - back] == self._held_commit:
                return None
            self._next -= back
            return self._move(1)

    def read_at(self, stamp: StampLike) -> Sample | None:
        """Read the newest sample at or before a stamp. The stream does not move.

        Parameters
        ----------
        stamp
            Nanoseconds.

        Returns
        -------
        Sample or None
            The newest one among the stream's moving frames, in the newest state; its `commit` is
            that of the state. None: the store has no such sample.

        Raises
        ------
        InvalidStamp, StreamClosed, BufferClosed, TransactionActive
        """
        wanted = to_nanoseconds(stamp)
        with self._lock:
            self._check_open()
            return self._of_state(wanted)

    def batches(self, max_rows: int = 4096, max_wait: float = 0.1) -> Iterator[Batch]:
        """Iterate over batches of samples, as columns.

        A batch waits for its first sample, and then for more. After FeedLapped the same iterator
        continues. It ends when the stream is closed.

        Parameters
        ----------
        max_rows
            Largest number of samples in a batch. A commit may be divided into several batches.
        max_wait
            Seconds that a batch waits after its first sample.

        Raises
        ------
        InvalidArgument, and what `read_next` raises
        """
        most = check_count("max_rows", max_rows)
        longest = duration_to_nanoseconds(max_wait, "max_wait") / 1e9
        return iter(lambda: self._batch(most, longest), None)

    def changes(self) -> Iterator[Changes]:
        """Iterate over whole commits, as `Buffer.changes` returns them.

        After FeedLapped the same iterator continues. It ends when the stream is closed. If a commit
        was read in part, its rest is skipped. The first record of a stream with `since="held"` has
        all samples of the state, and its frames are `made`. `min_separation` does not apply.

        Raises
        ------
        What `read_next` raises
        """
        return iter(self._change, None)

    @property
    def _unread(self) -> int:
        return len(self._rows) - self._next

    def _move(self, n: int) -> Sample:
        self._next += n
        self._has_read = True
        return self._sample(self._next - 1)

    def _next_slowly(self) -> Sample:
        """Implements `__next__` if all rows are read, or another thread reads."""
        return Cursor.__next__(self)

    def _keep(self, rows: Rows, row: int) -> None:
        """Replace the unread rows, and set the next one."""
        self._set_rows(*rows.columns(), row)
        self._rows = rows

    def _append(self, rows: Rows) -> None:
        """Append rows to the unread ones, and drop the read ones."""
        if self._separation is not None:
            rows = self._separated(rows, self._separation)
        if not len(rows):
            return
        if self._unread:
            rows = joined([self._rows.part(self._next, len(self._rows)), rows])
        self._keep(rows, 0)
        now = time.monotonic()
        self._quick = self._quick + 1 if now < self._read_at + 2 * _GATHERS else 0
        self._read_at = now

    def _gather(self) -> None:
        """Wait during a continuous series of commits, to read them together."""
        if self._quick >= _QUICK and (left := self._read_at + _GATHERS - time.monotonic()) > 0:
            time.sleep(left)

    def _separated(self, rows: Rows, separation: int) -> Rows:
        kept = rows.statics.copy()
        last = self._delivered
        for row, (child, stamp) in enumerate(zip(rows.children, rows.stamps.tolist(), strict=True)):
            if not kept[row] and stamp >= last.get(child, -separation) + separation:
                last[child] = stamp
                kept[row] = True
        return rows if kept.all() else rows.chosen(kept)

    def _more_rows(self, *, quietly: bool = False) -> bool:
        """Append rows to the unread ones: those of unread records first. False: there are none."""
        if self._records:
            before = self._unread
            self._append(of_changes(self._records))
            self._records.clear()
            if self._unread > before:
                return True
        return self._more(self._read_rows, quietly=quietly)

    def _read_rows(self) -> bool:
        """Append the rows of the next commits to the unread ones. False: the frames have none."""
        before = self._unread
        try:
            data = self._buffer.commits_bytes(
                self._position, max_commits=_COMMITS, max_bytes=_BYTES, frames=self._frames
            )
            position, rows = of_bytes(data)
        except Gone:
            records, position = self._next_records()
            rows = of_changes(records)
        self._append(rows)
        self._position = position
        return self._unread > before

    def _next_records(self) -> tuple[list[Changes], int]:
        """Read the next records, and the position after them."""
        newest = self._buffer.commit
        records = self._buffer.changes(self._position, _RECORDS, frames=self._frames)
        last = records[-1].commit if records else 0
        self._gone += sum(sum(record.gone.values()) for record in records)
        return records, last if len(records) == _RECORDS else max(newest, last)

    def _read_records(self) -> bool:
        records, position = self._next_records()
        self._records.extend(records)
        self._position = position
        return bool(records)

    def _drain(self) -> bool:
        """Read up to the newest commit. False: all rows were read."""
        while self._more_rows(quietly=True):
            self._next = len(self._rows) - 1
        return self._unread > 0

    def _earlier(self) -> bool:
        """Insert earlier rows. False: the feed no longer has them."""
        last = int(self._rows.commits[0]) if len(self._rows) else self.commit
        known = int((self._rows.commits == last).sum())
        while last > self._floor:
            since = max(last - _RECORDS, self._floor)
            try:
                records = self._buffer.changes(since, last - since)
            except FeedLapped as error:
                self._floor = max(error.oldest or 0, self._floor)
                continue
            rows = of_changes(records)
            if self._frames is not None:
                rows = rows.chosen(np.isin(rows.children, self._frames))
            if len(rows) > known:
                rows = rows.part(0, len(rows) - known)
                self._keep(joined([rows, self._rows]), self._next + len(rows))
                return True
            last, known = since, 0
        return False

    def _of_state(self, stamp: int | None) -> Sample | None:
        """Find the newest sample of the newest state, at or before a stamp if one is given."""
        with self._buffer.snapshot() as state:
            names = state.frames() if self._frames is None else self._frames
            found = [_sample_of(state, name, stamp) for name in names]
        return max(
            (sample for sample in found if sample is not None),
            key=lambda sample: -1 if sample.stamp is None else sample.stamp,
            default=None,
        )

    def _batch(self, max_rows: int, max_wait: float) -> Batch | None:
        try:
            with self._lock:
                self._check_open()
                while not self._unread:
                    if not self._more_rows() and not self._wait(None):
                        return None
                until = time.monotonic() + max_wait
                while self._unread < max_rows and (left := until - time.monotonic()) > 0:
                    if self._closing.wait(left):
                        break
                    while self._unread < max_rows and self._more_rows():
                        pass
                last = min(self._next + max_rows, len(self._rows))
                rows = self._rows.part(self._next, last)
                self._next = last
                self._has_read = True
                return rows.batch()
        except StreamClosed:
            return None

    def _change(self) -> Changes | None:
        try:
            with self._lock:
                self._check_open()
                if self._unread and (held := self._leave_rows()) is not None:
                    return held
                while not self._records:
                    if not self._more(self._read_records) and not self._wait(None):
                        return None
                return self._records.popleft()
        except StreamClosed:
            return None

    def _leave_rows(self) -> Changes | None:
        """Drop all that is unread, to read it as records; make a record of a held state."""
        rows = self._rows.part(self._next, len(self._rows))
        commit = int(rows.commits[0])
        is_cut = self._next > 0 and self._rows.commits[self._next - 1] == commit
        self._position = commit if is_cut or commit == self._held_commit else commit - 1
        self._left += 1
        self._records.clear()
        self._keep(NONE, 0)
        if is_cut or commit != self._held_commit:
            return None
        batch = rows.batch()
        frames = tuple(sorted({*rows.parents, *rows.children}))
        return Changes(commit, *batch[:2], batch.authorities, frames, (), (), (), (), {})


def _sample_of(state: Snapshot, name: str, stamp: int | None) -> Sample | None:
    """Find an edge's newest sample, at or before a stamp if one is given."""
    info = state.frame_info(name) if state.frame_exists(name) else None
    if info is None or info.parent is None:
        return None
    if info.newest is None or info.oldest is None:
        at = None
    elif stamp is not None and stamp < info.oldest:
        return None
    else:
        at = info.newest if stamp is None else min(stamp, info.newest)
    parent = state.parent_of(name, at)
    if parent is None:
        return None
    transform = state._lookup_edge(parent, name, at, Previous())
    if (used := transform.report.edges[0].before) is not None:
        transform = state._lookup_edge(parent, name, used, None)
    return Sample(transform, used, state.commit, info.authority)


belong_to("tfdb.streams", globals(), __all__)

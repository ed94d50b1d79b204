"""The home's protocol: it sends commits in order, and answers. It does not use the network."""

from __future__ import annotations

import os
import time
from contextlib import suppress
from typing import TYPE_CHECKING, NamedTuple

from tfdb.data.errors import FeedLapped, Gone, InvalidArgument
from tfdb.data.sample_heads import numbers_of
from tfdb.data.types import Epoch, Position

from .messages import LIMIT, MOST_NUMBER, NONE, PIECE, Head, head_bytes, in_epoch, state_messages

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from tfdb._core import Buffer

    from .messages import Question

GROUP = 64
"""Largest number of commits in a message; an answer may have more."""
UNLIMITED = 1 << 30
"""A number of commits or bytes that no message reaches."""


def epoch_for(buffer: Buffer, source: str, seen: Iterable[Epoch]) -> Epoch:
    """Return the epoch of a new home, later than all of `seen` except for its own.

    The epoch is the store's own, so that mirrors continue after a restart, if three conditions
    hold: the store survives its process, it was never a mirror of this namespace, and no later home
    exists. Otherwise the epoch is new.
    """
    own = buffer.epoch
    known = [each.epoch for each in buffer.positions() if each.source == source]
    latest = max([*seen, *known], default=NONE)
    outlives = buffer.shared is not None or buffer.frozen is not None
    return own if outlives and not known and own >= latest else epoch_after(latest)


def epoch_after(latest: Epoch) -> Epoch:
    """Return a new epoch, later than `latest`. Raises InvalidArgument if none is later."""
    number = max(time.time_ns(), latest.number + 1)
    if number >= MOST_NUMBER:
        text = f"epoch {latest.number} of a token or a position is the last one, so no home can "
        text += "follow it. Close the home that announces it, or use another name"
        raise InvalidArgument(text, value=latest.number)
    return Epoch(number, os.urandom(16))


class Origin(NamedTuple):
    """Where the commits of a home begin."""

    previous: Epoch = NONE
    """The epoch that it continues."""
    fork: int = 0
    """The commit of that epoch."""
    begin: int = 0
    """Its own commit with exactly that state. 0: it had more data, or continues none."""


_NOWHERE = Origin()


def take_over(buffer: Buffer, source: str, epoch: Epoch) -> Origin:
    """Turn a store into a home's: if it was a mirror's, local writers may write from now on.

    Raises the errors of a write.
    """
    while True:
        found = (each for each in buffer.positions() if each.source == source)
        position = next(found, None)
        if position is None:
            return Origin()
        done = buffer._hand_over(source, "release", epoch, from_=position)
        if done is not None:  # otherwise another process has applied commits meanwhile
            commit, is_whole, last = done
            return Origin(position.epoch, last, commit if is_whole else 0)


def step_back(buffer: Buffer, source: str, homes: Callable[[], Iterable[Epoch]]) -> None:
    """Turn the store of a promoted home back into a mirror's, unless `homes` has its epoch.

    Raises the errors of a write, even if it changes nothing.
    """
    nowhere = Position(source, NONE, 0, "")
    found = [each for each in buffer.positions() if each.source == source]
    running = homes() if found else ()
    for each in found or [nowhere]:
        if each.epoch not in running:
            buffer._hand_over(source, "adopt", each.epoch, from_=each)


class Sender:
    """The home's half of the protocol.

    Threads: `answer` and `head` any, the rest one.
    """

    def __init__(self, buffer: Buffer, epoch: Epoch, origin: Origin = _NOWHERE) -> None:
        self.epoch: Epoch = epoch
        self.lapped: int = 0
        """Number of commits that mirrors get as a state, because the feed had overrun the
        sender.
        """
        self._buffer = buffer
        self._origin = origin
        self._is_own = epoch == buffer.epoch
        # All samples after the position are readable, because `_held` is not later than the
        # position.
        self._held = buffer.snapshot()
        self._target = self._held
        self.commit: int = self._held.commit
        """The last sent commit; at first the last commit before the start."""

    def next(self) -> bytes | None:
        """Return the next message of the log. None: all was sent."""
        if self.commit == self._target.commit:
            if self._held is not self._target:
                self._held.close()
                self._held = self._target
            taken = self._buffer.snapshot()
            if taken.commit == self.commit:
                taken.close()
                return None
            self._target = taken
        try:
            most = min(GROUP, self._target.commit - self.commit)
            data = self._buffer.commits_bytes(self.commit, max_commits=most, max_bytes=LIMIT)
        except (FeedLapped, Gone):
            before = self.commit
            self.close()
            self._held = self._target = self._buffer.snapshot()
            self.commit = self._held.commit
            self.lapped += self.commit - before
            return self.head()
        self.commit = numbers_of(data)[1]
        return self._sample(data)

    def head(self) -> bytes:
        """Return the message by which mirrors detect missing commits."""
        return head_bytes(Head(self.epoch, self.commit, *self._origin))

    def answer(self, question: Question) -> list[bytes]:
        """Return the messages that a mirror needs: commits if they suffice, otherwise a state."""
        since = self._since(question)
        if since is not None:
            with suppress(FeedLapped, Gone, InvalidArgument):
                return [self.head(), *self._commits_after(since)]
        with self._buffer.snapshot() as snap:
            state = self._sample(snap.state_bytes())
        return [self.head(), *state_messages(self.epoch, snap.commit, state)]

    def _commits_after(self, since: int) -> list[bytes]:
        """Return messages of at most about `LIMIT` bytes. Raises FeedLapped, Gone."""
        found: list[bytes] = []
        size = 0
        while size < LIMIT:
            data = self._buffer.commits_bytes(since, max_commits=UNLIMITED, max_bytes=PIECE)
            if not data:
                break
            since = numbers_of(data)[1]
            size += len(data)
            found.append(self._sample(data))
        return found

    def _since(self, question: Question) -> int | None:
        """Return the commit of this home that equals the mirror's position. None: none does."""
        if question.of == self.epoch:
            return question.since
        is_at_fork = (question.of, question.since) == self._origin[:2]
        return self._origin.begin or None if is_at_fork else None

    def close(self) -> None:
        """Close the snapshot that is held for the mirrors."""
        self._held.close()
        self._target.close()

    def _sample(self, data: bytes) -> bytes:
        return data if self._is_own else in_epoch(data, self.epoch)

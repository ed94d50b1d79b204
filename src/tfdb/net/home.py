"""A store that is published: one thread sends its commits."""

from __future__ import annotations

import math
import threading
import time
import weakref
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, NamedTuple

from tfdb._core import duration_to_nanoseconds
from tfdb.data.argument_checks import check_flag, refuse_without
from tfdb.data.closable import Closable
from tfdb.data.errors import (
    CorruptMessage,
    FeedLapped,
    Gone,
    InvalidArgument,
    NotSupported,
    StoreExists,
    TfdbError,
    WatchClosed,
)
from tfdb.data.new_file import new_file, refuse_existing, refuse_unwritable
from tfdb.data.path_checks import check_path

from .events import EventLog, NetEvents
from .link import Token, check_network_name
from .messages import Head, Told, in_epoch, message_of, status_bytes
from .sending import UNLIMITED, Sender, epoch_for
from .sending import take_over as take_over_store

if TYPE_CHECKING:
    import os
    from collections.abc import Iterator
    from pathlib import Path
    from typing import Literal

    from tfdb._core import Buffer, Watch
    from tfdb.data.types import Epoch

    from .link import Declared, Link
    from .messages import Question
    from .sending import Origin
    from .session import Session

_HEADS = 0.5
"""Seconds between two heads."""
_UNSEEN = 2.0
"""Seconds within which a home must receive its own token."""
_LOOK = 0.01
"""Seconds between two checks, if this process may not wait for commits."""
_TAKEN = "exists already; give keep_lost (--keep-lost) the name of a new file"
_LAST_WORD = 2.0
"""Seconds that a stopping home waits for the head of the later home."""


class HomeStats(NamedTuple):
    """Counts of a home."""

    commits: int
    """Sent commits."""
    messages: int
    """Sent messages with commits, without heads."""
    bytes: int
    """Bytes of these messages."""
    answers: int
    """Answered requests of mirrors."""
    failed_answers: int
    """Requests that could not be answered; the mirrors repeat them."""
    lapped: int
    """Commits that mirrors get as a state, because the home could not send them in time."""


class Home(Closable):
    """The home of a namespace: it sends the commits of its store to mirrors. `publish` creates it.

    Use it in a `with` block, or call `close`.
    """

    def __init__(
        self,
        buffer: Buffer,
        name: str,
        link: Link,
        epoch: Epoch,
        *,
        max_delay: float = 0.0,
        origin: Origin | None = None,
        keep_lost: Path | None = None,
        owned: Link | None = None,
    ) -> None:
        self._buffer, self._name, self._link, self._owned = buffer, name, link, owned
        self._delay = max_delay
        self._log = EventLog(name)
        self._sender = Sender(buffer, epoch, *([] if origin is None else [origin]))
        self._keep_lost = keep_lost
        self._state: Literal["publishing", "fenced", "ended", "closed"] = "publishing"
        self._error: BaseException | None = None
        self._commits = self._messages = self._bytes = self._answers = self._failed = 0
        self._closing = threading.Event()
        self._lock = threading.Lock()
        self._later: Epoch | None = None
        self._is_seen = False
        self._watch: Watch | None = None
        with suppress(NotSupported):  # then the thread polls
            self._watch = buffer.watch((), every=True)
        self._declared: list[Declared] = []
        self._send, publisher = link.send(name)
        try:
            self._declared.append(publisher)
            self._declared.append(link.serve(name, self._answer))
            self._declared.append(link.watch(name, self._on_token))
            self._declared.append(link.report(name, "home", self._report))
            self._declared.append(link.announce(name, Token("home", epoch)))
        except BaseException:
            self._leave()
            raise
        self._thread = threading.Thread(target=self._run, name=f"tfdb home {name}", daemon=True)
        self._thread.start()
        _HOMES.add(self)

    @property
    def name(self) -> str:
        """The namespace."""
        return self._name

    @property
    def epoch(self) -> Epoch:
        """The epoch of its commits."""
        return self._sender.epoch

    @property
    def commit(self) -> int:
        """The last sent commit; at first the last commit before the start."""
        return self._sender.commit

    @property
    def state(self) -> Literal["publishing", "fenced", "ended", "closed"]:
        """`publishing`; `fenced`: a later home exists; `ended`: by an error; `closed`.

        `fenced` and `ended` stay after `close`.
        """
        return self._state

    @property
    def error(self) -> BaseException | None:
        """The error that ended it."""
        return self._error

    @property
    def stats(self) -> HomeStats:
        """Its counts."""
        return HomeStats(
            self._commits,
            self._messages,
            self._bytes,
            self._answers,
            self._failed,
            self._sender.lapped,
        )

    def events(self) -> NetEvents:
        """Return a stream of its events, from the oldest of the last 1,000."""
        return NetEvents(self._log)

    def close(self) -> None:
        """Send all earlier commits, and stop. A second call does nothing."""
        self._closing.set()
        if self._watch is not None:
            self._watch.close()
        if self._thread is not threading.current_thread():
            self._thread.join()
        if self._state == "publishing":
            self._state = "closed"
        self._log.close()
        if self._owned is not None:
            self._owned.close()

    # -- its thread --------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            self._publish()
            if self._later is not None:
                self._step_down(self._later)
        except Exception as error:  # `error` reports it
            self._error, self._state = error, "ended"
            self._log.add("ended", f"{type(error).__name__}: {error}")
        finally:
            self._leave()
            if self._state != "publishing":
                self._log.close()

    def _publish(self) -> None:
        due, unseen_at = 0.0, time.monotonic() + _UNSEEN
        while self._later is None:
            ending = self._closing.is_set()
            sent = self._send_all()
            if sent or time.monotonic() >= due:
                if time.monotonic() >= due:
                    self._send(self._sender.head())
                    self._link.renew()
                    due = time.monotonic() + _HEADS
                    if not self._is_seen and due > unseen_at:
                        unseen_at = math.inf
                        text = "others do not see this home: check that access control lets this "
                        self._log.add("unseen", f"{text}certificate write {self._name!r}")
                if sent and self._delay:
                    self._closing.wait(self._delay)
            if ending:
                return
            self._wait(due)

    def _send_all(self) -> int:
        sent, last = 0, self._buffer.commit  # a faster writer must not delay heads and the end
        while self._later is None and self._sender.commit < last:
            before, lapped = self._sender.commit, self._sender.lapped
            message = self._sender.next()
            if message is None:
                break
            if self._sender.lapped > lapped:
                count = self._sender.lapped - lapped
                self._log.add(
                    "lapped", f"{count} commits came faster than the home could send them"
                )
            else:
                self._commits += self._sender.commit - before
                self._messages += 1
                self._bytes += len(message)
            self._send(message)
            sent += 1
        return sent

    def _wait(self, until: float) -> None:
        """Wait for a commit."""
        left = max(until - time.monotonic(), 0.0)
        if self._watch is None:
            self._closing.wait(min(left, _LOOK))
            return
        with suppress(FeedLapped, WatchClosed):  # the next message continues from there
            self._watch.next(self._sender.commit, left, limit=1)

    def _step_down(self, later: Epoch) -> None:
        """Find the commits that the later home lacks, and make the store read-only.

        This needs a message of the later home, because only a process that may publish can send
        one.
        """
        self._leave()  # before the state is visible, because a home may start then
        self._state = "fenced"
        heard = self._wait_for_later_head(later)
        if heard:
            later = heard[-1].epoch
        forks = [each.fork for each in heard if each.previous == self.epoch]
        fork = forks[-1] if forks else None
        has_ended, text = False, "No message of the later home arrived: the store stays writable"
        if heard:
            has_ended, text = self._end_writes()
        commit = self._buffer.commit
        found = [each for each in self._buffer.positions() if each.source == self._name]
        if has_ended and found and found[0].epoch == self.epoch:
            commit = found[0].commit  # otherwise it is that of the promotion
        elif found and found[0].epoch > self.epoch:  # this store has no lost commits
            fork = commit
        if fork is not None and fork < commit:
            text = f"only this store has the commits after {fork}. {self._keep(fork)}{text}"
        elif fork is None and not heard:
            text = f"{self._keep(None)}{text}"
        text = f"this home stopped at commit {commit}. {text}"
        text = f"a later home exists or existed (epoch {later.number}): {text}"
        before = None if fork is None else (self.epoch, fork)
        self._log.add("fenced", text, before, (self.epoch, commit))

    def _wait_for_later_head(self, later: Epoch) -> list[Head]:
        """Wait for a head of the later home, or of the latest one if there are several.

        Returns all received heads, sorted by epoch; none after 2 s.
        """
        heard: list[Head] = []
        came = threading.Event()

        def take(data: bytes) -> None:
            with suppress(CorruptMessage):
                message = message_of(data)
                if isinstance(message, Head) and message.epoch >= later:
                    heard.append(message)
                    came.set()

        hearing = self._link.hear(self._name, take)
        until = time.monotonic() + _LAST_WORD
        while came.wait(max(until - time.monotonic(), 0.0)):
            came.clear()
            tokens = self._link.tokens(self._name)
            homes = [token.epoch for _, token in tokens if token.role == "home"]
            if any(each.epoch >= max(homes, default=later) for each in heard):
                break
        hearing.undeclare()
        return sorted(heard)

    def _end_writes(self) -> tuple[bool, str]:
        """Make the store read-only, as a mirror's; return whether it is, and a text about it."""
        try:
            if self._buffer._hand_over(self._name, "adopt", self.epoch) is None:
                return False, "The later home publishes the same store, which stays writable"
        except TfdbError as error:  # such as a frozen store, or a store with other sources
            return False, f"The store stays unchanged: {error}"
        return True, "Its frames are read-only"

    def _keep(self, fork: int | None) -> str:
        """Write the lost commits to the chosen file; return a text about it.

        None: it is not known which they are.
        """
        if self._keep_lost is None:
            return ""
        try:
            data, what = b"", "the whole state"
            if fork is not None:
                try:
                    data = self._buffer.commits_bytes(
                        fork, max_commits=UNLIMITED, max_bytes=UNLIMITED
                    )
                    what = "them"
                except (FeedLapped, Gone):
                    what += ", because not all of them are kept any more"
            if not data:
                with self._buffer.snapshot() as snap:
                    data = snap.state_bytes()
            with new_file(self._keep_lost) as path:
                path.write_bytes(in_epoch(data, self.epoch))
        except (OSError, TfdbError) as error:
            return f"{self._keep_lost} could not be written: {error}. "
        return f"{self._keep_lost} has {what}. "

    def _leave(self) -> None:
        for each in reversed(self._declared):
            each.undeclare()
        self._declared.clear()
        self._sender.close()
        if self._watch is not None:
            self._watch.close()

    # -- threads of the link -----------------------------------------------------------------------

    def _on_token(self, token: Token, alive: bool) -> None:
        if alive and token.role == "home":
            self._is_seen = self._is_seen or token.epoch == self.epoch
            self._meet(token.epoch)

    def _meet(self, epoch: Epoch) -> None:
        """Stop if an epoch is later."""
        if epoch > self.epoch and self._later is None:
            self._later = epoch
            if self._watch is not None:
                self._watch.close()

    def _report(self) -> bytes:
        newest = max(self.commit, self._buffer.commit)
        told = Told(self.epoch, "home", self._state, "", self.commit, newest, 0, self.stats)
        return status_bytes(told)

    def _answer(self, question: Question) -> list[bytes]:
        self._meet(question.epoch)
        if self._state != "publishing" or self._later is not None:
            return []
        try:
            messages = self._sender.answer(question)
        except TfdbError:  # such as SnapshotTooOld; the mirror repeats the request
            with self._lock:
                self._failed += 1
            return []
        with self._lock:
            self._answers += 1
        return messages


_HOMES: weakref.WeakSet[Home] = weakref.WeakSet()


def publishes(buffer: Buffer, name: str) -> bool:
    """Return whether this process publishes a store under a name."""
    return any(
        each._buffer is buffer and each.name == name and each.state == "publishing"
        for each in list(_HOMES)
    )


def publish(
    buffer: Buffer,
    name: str,
    *,
    session: Session | None = None,
    max_delay: float = 0.002,
    take_over: bool = False,
    keep_lost: str | os.PathLike[str] | None = None,
) -> Home:
    """Publish the commits of a store, so that mirrors on other machines can apply them.

    ```python
    with tfdb.net.publish(buf, "robot1"):
        ...
    ```

    Parameters
    ----------
    buffer
        The store: private, shared or frozen.
    name
        The namespace: letters, digits, `_`, `-`, `.` and `/`. It can have only one home at a time.
    session
        The connection. None: one to the router at tcp/127.0.0.1:7447, closed with the home.
    max_delay
        Longest time in seconds that a commit waits, to be sent in one message with later ones. 0:
        no wait. A commit after a pause does not wait.
    take_over
        Publish even if the namespace has a home, which then stops.
    keep_lost
        Name of a new file, or None. If a mirror of this home is promoted and this home then stops,
        the commits that the later home lacks are written to the file, as bytes for `apply`. If the
        feed or the history no longer has all of them, or if no message of the later home arrives,
        the state of the store is written.

    Returns
    -------
    Home
        A context manager.

    Raises
    ------
    StoreExists
        The namespace has a home, and `take_over` is off.
    InvalidName
        The name is not valid for a namespace.
    InvalidArgument, TypeError
        An invalid argument, such as an existing file for `keep_lost`; this process already
        publishes the store under that name; or the last possible epoch was announced.
    NotSupported
        The package eclipse-zenoh is not installed, or the buffer's engine has no feed.
    ConnectionError
        No router answers.
    OSError
        The file of `keep_lost` cannot be written.
    """
    refuse_without(buffer, "buffer", "a Buffer", "commits_bytes", "snapshot")
    name = check_network_name(name)
    delay = duration_to_nanoseconds(max_delay, "max_delay") / 1e9
    take_over = check_flag("take_over", take_over)
    lost = check_lost_file(keep_lost)
    buffer.commits_bytes(buffer.commit)  # refuses an engine without a feed
    if publishes(buffer, name):
        text = f"this process publishes this store as {name!r} already: close that home first"
        raise InvalidArgument(text, value=name)
    with link_of(session) as (link, owned):
        seen = _seen(link, name, take_over=take_over)
        epoch = epoch_for(buffer, name, seen)
        return Home(
            buffer,
            name,
            link,
            epoch,
            max_delay=delay,
            origin=take_over_store(buffer, name, epoch),
            keep_lost=lost,
            owned=owned,
        )


def check_lost_file(keep_lost: str | os.PathLike[str] | None) -> Path | None:
    """Return the path if the file can be created. Raises InvalidArgument or OSError."""
    if keep_lost is None:
        return None
    lost = check_path(keep_lost).absolute()
    refuse_existing(lost, hint=_TAKEN)
    refuse_unwritable(lost)
    return lost


def _seen(link: Link, name: str, *, take_over: bool) -> list[Epoch]:
    """Return the epochs of homes and mirrors. Refuses a namespace that has a home."""
    tokens = [token for _, token in link.tokens(name)]
    homes = [each.epoch for each in tokens if each.role == "home"]
    if homes and not take_over:
        text = f"{name!r} has a home, of epoch {max(homes).number}: close it, or pass "
        text += "take_over=True (--take-over)"
        raise StoreExists(text, path=name, reason="it has a home")
    return [each.epoch for each in tokens]


@contextmanager
def link_of(session: Session | None) -> Iterator[tuple[Link, Link | None]]:
    """Return the link of a session, or of a new one, which the caller must close.

    An error in the block closes a new session.
    """
    from .session import Session  # noqa: PLC0415 - Zenoh is an extra

    if session is None:
        made = Session().link
        try:
            yield made, made
        except BaseException:
            made.close()
            raise
        return
    if not isinstance(session, Session):
        raise TypeError(f"session must be a tfdb.net.Session, got {type(session).__name__}")
    yield session.link, None

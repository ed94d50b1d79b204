"""A copy of another process's or machine's store, which follows its commits."""

from __future__ import annotations

import os
import threading
import time
from collections import deque
from collections.abc import Iterable
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

from tfdb._core import Buffer, duration_to_nanoseconds
from tfdb.data.argument_checks import check_count, check_flag, check_name, refuse_without
from tfdb.data.closable import Closable
from tfdb.data.errors import InvalidArgument, InvalidName, WaitTimeout
from tfdb.data.stamps import shown

from .events import EventLog, NetEvents
from .home import Home, check_lost_file, link_of, publishes
from .link import Token, check_network_name
from .messages import NONE, Told, status_bytes
from .receiving import Receiver
from .sending import epoch_after, step_back, take_over

if TYPE_CHECKING:
    from typing import Literal

    from tfdb.data.types import Epoch, Position

    from .link import Declared, Link, Request
    from .session import Session

_MOST_WAITING = 1024
"""Largest number of messages that wait while a state is applied. Older ones are requested again."""
_SOON = 0.01
"""If the next step is due within this many seconds, the thread is woken at once."""


class MirrorStats(NamedTuple):
    """Counts of a mirror."""

    commits: int
    """Commits that were applied one by one."""
    states: int
    """Whole states that were applied."""
    requests: int
    """Requests to the home, for commits or a state."""
    lag: int
    """Number of the home's known commits that the mirror lacks."""
    refused: int
    """Messages that were damaged or could not be stored."""
    outdated: int
    """Messages of earlier homes, which were ignored."""
    bytes: int
    """Bytes of all messages."""
    gaps: int
    """Number of times that it missed commits."""


class Mirror(Closable):
    """A copy of a namespace's home. `mirror` makes it.

    Use it in a `with` block, or call `close`. The store can be read at any time: each of its
    states is one that a home had.
    """

    def __init__(
        self,
        buffer: Buffer,
        name: str,
        link: Link,
        *,
        prefix: str = "",
        shared: Iterable[str] = (),
        max_lag: int | None = None,
        owned: Link | None = None,
    ) -> None:
        self._buffer, self._name, self._link, self._owned = buffer, name, link, owned
        names = list(shared)
        self._is_whole = not prefix and not names
        self._log = EventLog(name)
        self._receiver = Receiver(buffer, name, prefix, names, self._log, max_lag=max_lag)
        self._applier = self._receiver.applier
        self._error: BaseException | None = None
        self._was_live = False
        self._is_closing, self._wake = False, threading.Event()
        self._changed = threading.Condition()
        # Threads of the link append. The thread with the lock feeds the receiver. If it is locked,
        # the mirror's thread does so next.
        self._lock = threading.Lock()
        self._inbox: deque[bytes] = deque(maxlen=_MOST_WAITING)
        self._request: Request | None = None
        self._answers: deque[bytes | None] = deque()
        """Messages of the answer to the request; None is its end."""
        self._tokens: deque[tuple[Token, bool]] = deque()
        self._owner = os.urandom(8).hex()
        self._token: Declared | None = None
        self._announced: Epoch = NONE
        self._declared: list[Declared] = []
        try:
            self._declared.append(link.hear(name, self._on_message))
            self._declared.append(link.watch(name, self._on_token))
            self._declared.append(link.report(name, "mirror", self._report))
        except BaseException:
            self._leave()
            raise
        self._thread = threading.Thread(target=self._run, name=f"tfdb mirror {name}", daemon=True)
        self._thread.start()

    @property
    def name(self) -> str:
        """The namespace."""
        return self._name

    @property
    def position(self) -> Position | None:
        """Last applied commit of the home. None: none yet."""
        return self._applier.position

    @property
    def state(self) -> Literal["absent", "catching up", "live", "stale", "ended", "closed"]:
        """State of the mirror.

        `absent`: no home found yet. `catching up`: commits are missing and requested, or the home's
        last commit is not known yet. `live`: all commits that the home has sent are applied.
        `stale`: the home is unreachable. `ended`: by an error, also after `close`. `closed`: by
        `close` or `promote`.
        """
        if self._error is not None:
            return "ended"
        return "closed" if self._is_closing else self._receiver.state  # type: ignore[return-value]

    @property
    def silence(self) -> float | None:
        """Seconds since the last message of the home, if the state is `stale`."""
        since = self._receiver.since
        return None if since is None else time.monotonic() - since

    @property
    def error(self) -> BaseException | None:
        """The error that ended it."""
        return self._error

    @property
    def stats(self) -> MirrorStats:
        """Its counts."""
        each = self._refreshed()
        position = each.position
        is_known = position is not None and position.epoch == each.known
        lag = each.newest - (position.commit if position is not None and is_known else 0)
        return MirrorStats(
            each.commits,
            each.states,
            each.requests,
            max(lag, 0),
            each.refused,
            each.outdated,
            each.bytes,
            each.gaps,
        )

    def events(self) -> NetEvents:
        """Return a stream of its events, from the oldest of the last 1,000."""
        return NetEvents(self._log)

    def wait_until_live(self, timeout: float | None = None) -> None:
        """Wait until the state is `live`.

        Parameters
        ----------
        timeout
            Seconds, at most; None: for ever.

        Raises
        ------
        WaitTimeout
            It was not `live` at the end of the timeout.
        InvalidArgument
            It is closed, or the timeout is not valid.
        The property `error`
            It ended the mirror.
        """
        left = None if timeout is None else duration_to_nanoseconds(timeout, "timeout") / 1e9
        ends = ("live", "ended", "closed")
        with self._changed:
            self._changed.wait_for(lambda: self.state in ends, left)
        state = self.state
        if state == "live":
            return
        if self._error is not None:
            raise self._error
        if state == "closed":
            raise InvalidArgument(f"the mirror of {self._name!r} is closed")
        text = f"the mirror of {self._name!r} is {state}, not live, after {timeout} s"
        if state == "absent":
            text += ": check the home's name, and that both use the same router"
        raise WaitTimeout(text)

    def promote(
        self,
        *,
        force: bool = False,
        max_delay: float = 0.002,
        keep_lost: str | os.PathLike[str] | None = None,
    ) -> Home:
        """Make this store the home of the namespace, in a new epoch. The mirror is closed.

        The old home stops once a message of the new home reaches it. In a partitioned network,
        both run until the partition ends. Commits of the old home that this mirror lacks stay in
        the old store only. The old home's event `fenced` names them.

        Parameters
        ----------
        force
            Promote the mirror even if it was never live. Its data may then be incomplete.
        max_delay, keep_lost
            As in `publish`.

        Returns
        -------
        Home

        Raises
        ------
        InvalidArgument
            It was never live; it has a prefix or shared frames; its store has other sources; it or
            its session is closed; or the file of `keep_lost` exists.
        OSError
            The file of `keep_lost` cannot be written.
        """
        force = check_flag("force", force)
        delay = duration_to_nanoseconds(max_delay, "max_delay") / 1e9
        lost = check_lost_file(keep_lost)
        self._check_promotion(force=force)
        tokens = self._link.tokens(self._name)
        self._stop()
        known = [token.epoch for _, token in tokens]
        epoch = epoch_after(max([*known, self._receiver.known]))
        origin = take_over(self._buffer, self._name, epoch)
        home = Home(
            self._buffer,
            self._name,
            self._link,
            epoch,
            max_delay=delay,
            origin=origin,
            keep_lost=lost,
            owned=self._owned,
        )
        self._owned = None  # the home closes it
        return home

    def _check_promotion(self, *, force: bool) -> None:
        text = f"the mirror of {self._name!r} cannot be promoted: "
        if self._is_closing or self._error is not None:
            raise InvalidArgument(f"{text}it is {self.state}")
        if self._link.closed:
            raise InvalidArgument(f"{text}its session is closed")
        if not self._is_whole:
            raise InvalidArgument(f"{text}its frame names differ from the home's")
        if others := [
            each.source for each in self._buffer.positions() if each.source != self._name
        ]:
            raise InvalidArgument(f"{text}its store also has frames of source {others[0]!r}")
        if not self._was_live and not force:
            text += (
                "it was never live, so its data may be incomplete; force=True promotes it anyway"
            )
            raise InvalidArgument(text)

    def close(self) -> None:
        """Stop. The store keeps its data, and a later mirror continues from its position."""
        self._stop()
        if self._owned is not None:
            self._owned.close()
            self._owned = None

    def _stop(self) -> None:
        self._is_closing = True
        self._wake.set()
        if self._thread is not threading.current_thread():
            self._thread.join()
        self._log.close()
        with self._changed:
            self._changed.notify_all()

    # -- threads of the link -----------------------------------------------------------------------

    def _on_message(self, data: bytes) -> None:
        try:
            is_applied = self._applier.take(data)
        except Exception as error:  # a warning that raises; `error` has it
            self._fail(error)
            return
        if is_applied:
            if self._receiver.state != "live":
                self._wake.set()
            return
        self._inbox.append(data)
        if not self._lock.acquire(blocking=False):
            self._wake.set()
            return
        try:
            self._feed()
        finally:
            self._lock.release()

    def _on_token(self, token: Token, alive: bool) -> None:
        self._tokens.append((token, alive))
        self._wake.set()

    def _take_answer(self, message: bytes | None) -> None:
        self._answers.append(message)
        self._wake.set()

    def _report(self) -> bytes:
        each = self._refreshed()
        position = each.position
        commit = 0 if position is None else position.commit
        since = each.lacking_since
        behind = 0 if since is None else max(int(1e9 * (time.monotonic() - since)), 0)
        told = Told(
            each.known, "mirror", self.state, self._owner, commit, each.newest, behind, self.stats
        )
        return status_bytes(told)

    def _refreshed(self) -> Receiver:
        """Return the receiver, with current counts unless another thread is using it."""
        if self._lock.acquire(blocking=False):
            try:
                self._receiver.refresh()
            finally:
                self._lock.release()
        return self._receiver

    # -- under the lock ----------------------------------------------------------------------------

    def _feed(self) -> None:
        """Pass the inbox to the receiver. An error ends the mirror."""
        receiver = self._receiver
        before = receiver.state
        try:
            while self._inbox and self._is_open():
                receiver.take(self._inbox.popleft(), time.monotonic())
        except Exception as error:  # `error` has it
            self._fail(error)
        self._applier.follow(receiver.front() if self._is_open() else None)
        if not self._is_open():
            self._inbox.clear()
        elif receiver.state != before or (
            receiver.state != "live" and receiver.due(time.monotonic()) < _SOON
        ):
            self._wake.set()

    def _is_open(self) -> bool:
        return self._error is None and not self._is_closing

    def _fail(self, error: BaseException) -> None:
        self._error = error
        self._log.add("ended", f"{type(error).__name__}: {error}")
        self._wake.set()

    # -- its thread --------------------------------------------------------------------------------

    def _run(self) -> None:
        left = 0.0
        try:
            while self._is_open():
                self._wake.wait(left)
                self._wake.clear()
                if self._is_open():
                    left = self._step()
        except Exception as error:  # `error` has it
            self._fail(error)
        finally:
            self._leave()
            self._log.close()
            with self._changed:
                self._changed.notify_all()

    def _step(self) -> float:
        """Process the inbox and send due requests; return the seconds until the next step."""
        receiver = self._receiver
        if self._request is not None:
            self._request.check()
        with self._lock:
            while self._tokens:
                token, alive = self._tokens.popleft()
                told = receiver.find_home if alive else receiver.lose_home
                told(token.epoch, time.monotonic())
            while self._answers:
                message = self._answers.popleft()
                if message is None:
                    self._request = None
                    receiver.answered(time.monotonic())
                else:
                    receiver.take_reply(message, time.monotonic())
            self._feed()
            receiver.tick(time.monotonic())
            question = receiver.question(time.monotonic())
            left = receiver.due(time.monotonic())
            state, known = receiver.state, receiver.known
        if state == "live":
            self._was_live = True
        with self._changed:
            self._changed.notify_all()
        if known != self._announced:
            self._announce(known)
        if question is not None:
            self._request = self._link.ask(self._name, question, self._take_answer)
        return left

    def _announce(self, known: Epoch) -> None:
        """Publish the latest known epoch, so that a new home begins a later one."""
        before, self._announced = self._token, known
        self._token = self._link.announce(self._name, Token("mirror", known, self._owner))
        if before is not None:
            before.undeclare()

    def _leave(self) -> None:
        self._applier.follow(None)
        if self._request is not None:
            self._request.end()
        for each in self._declared:
            each.undeclare()
        self._declared.clear()
        if self._token is not None:
            self._token.undeclare()
            self._token = None


def _epochs_of_homes(link: Link, name: str) -> list[Epoch]:
    return [token.epoch for _, token in link.tokens(name) if token.role == "home"]


def _check_part(what: str, value: Any, behind: str = "") -> str:
    """Return the text, which must be a frame name with `behind` at its end. Raises InvalidName."""
    text = check_name(what, value)
    with suppress(UnicodeEncodeError):
        text.encode()
        if Buffer._may_be_frame(text + behind):
            return text
    said = f"{what}: {shown(text)} is not valid in a frame name, which has 1 to 1024 bytes of "
    raise InvalidName(f"{said}UTF-8 and no control characters", value=value)


def mirror(
    name: str,
    *,
    into: Buffer,
    prefix: str = "",
    shared: str | Iterable[str] = (),
    max_lag: int | None = None,
    session: Session | None = None,
) -> Mirror:
    """Follow a home's commits into a store of this process.

    ```python
    fleet = tfdb.Buffer()
    with tfdb.net.mirror("robot1", into=fleet, prefix="robot1/", shared=("map",)) as mirror:
        mirror.wait_until_live(10.0)
    ```

    Parameters
    ----------
    name
        The namespace of the home.
    into
        The store. It may have several mirrors with different prefixes, and frames of its own.
    prefix, shared
        As in `Buffer.apply`: text before the name of each frame, and frames without it.
    max_lag
        If more commits than this are missing, the mirror takes a state instead: it is live sooner,
        but skips the samples between. None: it takes all commits that the home still has.
    session
        The connection. None: one to the router at tcp/127.0.0.1:7447, closed with the mirror.

    Returns
    -------
    Mirror
        A context manager.

    Raises
    ------
    InvalidName
        The namespace is invalid, or frames with the prefix, or the frames in `shared`, would have
        invalid names.
    InvalidArgument, TypeError
        An argument is invalid. For example, the store already mirrors the namespace under another
        prefix.
    NotSupported
        PyPI's eclipse-zenoh is not installed, or the store's engine cannot apply commits.
    ConnectionError
        No router answers.
    ReadOnly, LockTimeout, BufferClosed, TransactionActive
        The store cannot be written.
    """
    refuse_without(into, "into", "a Buffer", "apply", "positions")
    name = check_network_name(name)
    prefix = _check_part("prefix", prefix, behind="x")
    max_lag = None if max_lag is None else check_count("max_lag", max_lag)
    if not isinstance(shared, Iterable):
        raise TypeError(f"shared must be a frame name or several, got {type(shared).__name__}")
    names = [
        _check_part("shared", each) for each in ([shared] if isinstance(shared, str) else shared)
    ]
    if publishes(into, name):
        text = f"into is the store that this process publishes as {name!r}: use another store"
        raise InvalidArgument(text)
    with link_of(session) as (link, owned):
        # Only a store that was a mirror of the namespace before costs this request.
        step_back(into, name, lambda: _epochs_of_homes(link, name))
        return Mirror(into, name, link, prefix=prefix, shared=names, max_lag=max_lag, owned=owned)

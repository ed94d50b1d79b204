"""The mirror's protocol: it applies commits and sends requests. It does not use the network."""

from __future__ import annotations

import math
import random
from collections import deque
from typing import TYPE_CHECKING

from tfdb.data.errors import (
    BufferClosed,
    CorruptMessage,
    Fenced,
    InvalidArgument,
    NoSuchStore,
    NotSupported,
    OutOfOrder,
    ReadOnly,
    TfdbError,
)

from .messages import NONE, Commits, Head, Part, Question, State, commits_front, message_of

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tfdb._core import Applier, Buffer
    from tfdb.data.types import Epoch, Position

    from .events import EventLog, Kind
    from .messages import Message

SILENCE = 2.0
"""Seconds without a message after which a home counts as gone: four intervals of heads."""
_PAUSES = 0.05, 2.0
_MOST_WAITING = 8 << 20
"""Largest size in bytes of the commits that wait for missing earlier ones."""
_ENDS = BufferClosed, InvalidArgument, NoSuchStore, NotSupported, ReadOnly
"""Errors of the store or the prefix. They end the mirror, because no later message fixes them."""


class Receiver:
    """The mirror's half of the protocol. Threads: one at a time.

    The store has the position, so a mirror continues after its process was killed.
    Times are seconds of a monotonic clock.
    """

    def __init__(
        self,
        buffer: Buffer,
        source: str,
        prefix: str,
        shared: Iterable[str],
        log: EventLog,
        draw: random.Random | None = None,
        *,
        max_lag: int | None = None,
    ) -> None:
        self._buffer, self._log = buffer, log
        self._max_lag = math.inf if max_lag is None else max_lag
        self._source, self._prefix = source, prefix
        self.applier: Applier = buffer._applier(source, prefix, list(shared))
        """Applies the commits. Threads of the link pass it those that `front` describes."""
        self._draw = draw or random.Random()  # noqa: S311 - a jitter
        self.position: Position | None = self._stored()
        self.known: Epoch = NONE if self.position is None else self.position.epoch
        """The latest received epoch. Messages of earlier epochs are ignored."""
        self.state: Kind = "absent"
        self._missed_at = math.inf
        self._absence_is_logged = False
        self.since: float | None = None
        """If the state is `stale`: the time of the home's last message."""
        self.lacking_since: float | None = None
        """Time since which commits may be missing. None: it is live, or has not found a home."""
        self.gaps: int = 0
        """Number of times that commits after its position were missing."""
        self.commits: int = 0
        self.bytes: int = 0
        self.states: int = 0
        self.requests: int = 0
        self.refused: int = 0
        self.outdated: int = 0
        self.newest: int = 0
        """The largest received commit number of the epoch `known`."""
        self._head: Head | None = None
        self._head_of_answer: Head | None = None
        self._heard = -math.inf
        self._is_gone = False
        self._is_unheard = False
        """Whether no message has come since the home was found, so its last commit is unknown."""
        self._lacks = False
        """Whether it was catching up at the last `tick`, with commits known to be missing."""
        self._waiting: deque[Commits] = deque()
        self._waiting_bytes = 0
        self._parts: dict[int, bytes] = {}
        self._parts_of: tuple[Epoch, int, int] | None = None
        self._asked: tuple[object, ...] | None = None
        self._newest_asked = 0
        """The value of `newest` at the last request."""
        self._ask_at, self._pause = -math.inf, 0.0
        self._wants_state = False
        self._is_outdated = False
        """Whether only an earlier home sends. The next request informs it of the later epoch."""
        self._last_refusal = ""

    # -- input ----------------------------------------------------------------------------

    def take_reply(self, data: bytes, now: float) -> None:
        """Process a message of an answer. Raises errors that end the mirror."""
        before = self._head
        self.take(data, now)
        if self._head is not before and self._head is not None:
            self._head_of_answer = self._head

    def take(self, data: bytes, now: float) -> None:
        """Process a message of the log or of an answer. Raises errors that end the mirror."""
        self.refresh()
        try:
            message = message_of(data)
        except CorruptMessage as error:
            self._refuse(error)
            return
        if message.epoch < self.known:
            self.outdated += 1
            self._is_outdated = self.state in ("absent", "stale")
            return
        self._follow(message.epoch)
        self.bytes += len(data)
        self._heard, self._is_gone, self._is_unheard = now, False, False
        self._take(message)
        self.tick(now)

    def front(self) -> bytes | None:
        """Return the first bytes of commits that the applier may take directly. None: none."""
        position = self.position
        if position is None or position.epoch != self.known or self._wants_state or self._waiting:
            return None
        return commits_front(position.epoch)

    def refresh(self) -> None:
        """Update the position and the counts after commits that the applier took directly."""
        taken = self.applier.taken()
        if taken is None:
            return
        size, at = taken
        before, self.position = self.position, self._stored()
        self.bytes += size
        self._heard, self._is_gone, self._is_unheard = max(self._heard, at), False, False
        if before is not None and self.position is not None and self.position.epoch == before.epoch:
            self.commits += self.position.commit - before.commit
            self._note(self.position.commit)

    def answered(self, now: float) -> None:
        """Note that the answer to the request is complete, possibly empty."""
        head, self._head_of_answer = self._head_of_answer, None
        # The request followed `newest`: if the home has less, another program sent that.
        if head is not None and head.commit < self.newest == self._newest_asked:
            self.newest = head.commit
        self._pause = 0.0 if self._asked != self._place() else self._longer()
        self._ask_at = now + self._pause
        self._asked = None
        self._is_outdated = False
        self._parts.clear()
        self.tick(now)

    def find_home(self, epoch: Epoch, now: float) -> None:
        """Note that a home exists."""
        if epoch >= self.known:
            self._follow(epoch)
            self._heard, self._is_gone = now, False
            self._is_unheard = self._is_unheard or self.state in ("absent", "stale")
            self.tick(now)

    def lose_home(self, epoch: Epoch, now: float) -> None:
        """Note that a home has ended."""
        if epoch == self.known:
            self._is_gone, self._is_unheard = True, False
            self.tick(now)

    def tick(self, now: float) -> None:
        """Update the state."""
        self.refresh()
        state: Kind
        if self._heard == -math.inf:
            state = "absent"
        elif self._is_gone or now - self._heard > SILENCE:
            state = "stale"
        else:
            state = "catching up" if self._is_unheard or self._is_behind() else "live"
        lacks = state == "catching up" and self._is_behind()
        self.gaps += lacks and not self._lacks and self.position is not None
        self._lacks = lacks
        if state == "absent" and not self._absence_is_logged:
            self._missed_at = min(self._missed_at, now + SILENCE)
            if now >= self._missed_at:
                self._absence_is_logged = True
                self._log.add(state, self._sentence(state))
        if state != self.state:
            self.state = state
            self.since = self._heard if state == "stale" else None
            if state == "live":
                self.lacking_since = None
            elif self.lacking_since is None:
                self.lacking_since = self._heard if state == "stale" else now
            self._log.add(state, self._sentence(state))

    # -- what it wants -----------------------------------------------------------------------------

    def question(self, now: float) -> Question | None:
        """Return the due request; `answered` must be called later. None: no request is due."""
        if self._asked is not None or now < self._ask_at or not self._must_ask():
            return None
        self.requests += 1
        self._asked, self._newest_asked = self._place(), self.newest
        position = self.position
        if position is None or self._wants_state:
            return Question(self.known, None)
        if position.epoch == self.known and self.newest - position.commit > self._max_lag:
            return Question(self.known, None)
        return Question(self.known, position.commit, position.epoch)

    def due(self, now: float) -> float:
        """Return the seconds until the next call of `tick` or `question`."""
        at = self._heard + SILENCE if self.state in ("catching up", "live") else now + SILENCE
        if self._asked is None and self._must_ask():
            at = min(at, self._ask_at)
        return min(max(at - now, 0.0) + 0.001, SILENCE)

    # -- the parts ---------------------------------------------------------------------------------

    def _take(self, message: Message) -> None:
        match message:
            case Head():
                self._head = message
                self._note(message.commit)
                self._pass_fork(message)
            case Commits():
                self._note(message.last)
                self._take_commits(message)
            case State():
                self._note(message.commit)
                self._take_state(message)
            case Part():
                self._note(message.commit)
                self._take_part(message)

    def _follow(self, epoch: Epoch) -> None:
        """Continue in a later epoch. Raises InvalidArgument if the store would follow itself."""
        if epoch > self.known:
            if epoch == self._buffer.epoch:
                text = f"the home of {self._source!r} publishes this same store: "
                raise InvalidArgument(f"{text}mirror it into another store")
            self.known, self.newest = epoch, 0
            self._head = self._head_of_answer = None
            self._waiting.clear()
            self._waiting_bytes = 0
            self._parts.clear()
            self._ask_at, self._pause = -math.inf, 0.0

    def _pass_fork(self, head: Head) -> None:
        """Continue in a later epoch without a state, if its home began exactly at the position."""
        position = self.position
        if position is None or not head.begin or self._wants_state:
            return
        if (position.epoch, position.commit) != (head.previous, head.fork):
            return
        source = self._source
        try:
            self._buffer._hand_over(source, "follow", head.epoch, head.begin, position)
        except _ENDS:
            raise
        except TfdbError as error:  # request a state instead
            self._refuse(error)
            self._wants_state = True
        self._reload_position()
        self._apply_waiting()

    def _note(self, commit: int) -> None:
        self.newest = max(self.newest, commit)

    def _take_commits(self, message: Commits) -> None:
        position = self.position
        if position is None or message.epoch != position.epoch or message.since > position.commit:
            self._keep(message)
        elif message.last > position.commit:
            self._apply(message)
            self._apply_waiting()

    def _keep(self, message: Commits) -> None:
        """Keep commits until the missing earlier ones arrive."""
        self._waiting.append(message)
        self._waiting_bytes += len(message.data)
        while self._waiting_bytes > _MOST_WAITING:
            self._waiting_bytes -= len(self._waiting.popleft().data)

    def _apply_waiting(self) -> None:
        waiting = sorted(self._waiting, key=lambda each: each.since)
        self._waiting.clear()
        for message in waiting:
            position = self.position
            if position is None or message.since > position.commit:
                self._waiting.append(message)
            elif message.last > position.commit:
                self._apply(message)
        self._waiting_bytes = sum(len(each.data) for each in self._waiting)

    def _take_part(self, part: Part) -> None:
        place = part.epoch, part.commit, part.parts
        if self._asked is None:
            return
        if self._parts_of is None or not self._parts or place > self._parts_of:
            self._parts, self._parts_of = {}, place
        if place != self._parts_of:
            return
        self._parts[part.place] = part.data
        if len(self._parts) < part.parts:
            return
        data = b"".join(self._parts[each] for each in range(part.parts))
        self._parts = {}
        try:
            message = message_of(data)
        except CorruptMessage as error:
            self._refuse(error)
            return
        if isinstance(message, State) and message[:2] == place[:2]:
            self._take_state(message)
        else:
            self._refuse(CorruptMessage("the parts of a state are not a state together"))

    def _take_state(self, message: State) -> None:
        before, head = self.position, self._head
        if before is not None and (message.epoch, message.commit) <= (before.epoch, before.commit):
            return
        if not self._apply(message):
            return
        self.states += 1
        self._apply_waiting()
        if before is None or before.epoch == message.epoch:
            return
        goes_on = head is not None and head.previous == before.epoch and before.commit <= head.fork
        if not goes_on:
            text = f"from commit {before.commit} to {message.commit} of a later home"
            after = message.epoch, message.commit
            self._log.add("rewound", text, (before.epoch, before.commit), after)

    def _apply(self, message: Commits | State) -> bool:
        before = self.position
        try:
            self.position = self.applier.apply(message.data)
        except _ENDS:
            raise
        except (OutOfOrder, Fenced):  # another process applies to the same store
            self._reload_position()
            return False
        except TfdbError as error:
            self._reload_position()  # some of these commits may be applied
            self._refuse(error)
            self._wants_state = True
            return False
        if isinstance(message, Commits):
            self.commits += self.position.commit - (before.commit if before is not None else 0)
        self._wants_state, self._last_refusal = False, ""
        return True

    def _refuse(self, error: TfdbError) -> None:
        """Count messages that cannot be stored; log each cause once."""
        self.refused += 1
        if str(error) != self._last_refusal:
            self._last_refusal = str(error)
            self._log.add("refused", f"{type(error).__name__}: {error}")

    def _reload_position(self) -> None:
        self.position = self._stored()
        if self.position is not None:
            self._follow(self.position.epoch)

    def _stored(self) -> Position | None:
        found = self.applier.position
        if found is not None and found.prefix != self._prefix:
            text = f"the store has {self._source!r} with prefix {found.prefix!r} already, "
            raise InvalidArgument(f"{text}not {self._prefix!r}: use this prefix, or another store")
        return found

    def _is_behind(self) -> bool:
        position = self.position
        if position is None or position.epoch < self.known:
            return self.known > NONE
        return position.commit < self.newest

    def _must_ask(self) -> bool:
        return self._is_outdated or self._is_unheard or self._is_behind()

    def _place(self) -> tuple[object, ...]:
        """Return the progress. An answer that changes it was useful."""
        return self.known, self.position

    def _longer(self) -> float:
        least, most = _PAUSES
        longer = min(max(self._pause * 2, least), most)
        return longer * self._draw.uniform(0.75, 1.0)

    def _sentence(self, state: Kind) -> str:
        commit = 0 if self.position is None else self.position.commit
        applied = f"the last applied commit is {commit}" if commit else "no commit is applied"
        is_known = self.newest and not self._is_unheard
        sent = f"has commit {self.newest}" if is_known else "has sent no message yet"
        return {
            "absent": "no home was found: check its name, that both reach one router, and that "
            f"access control lets this certificate read {self._source!r}",
            "catching up": f"{applied}; the home {sent}",
            "live": f"commit {commit}",
            "stale": f"the home is gone; {applied}",
        }[state]

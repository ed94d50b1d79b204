"""The loop of live evaluation: a follower, a judge, and the next check of the time."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from tfdb.data.decimal_time import NS_PER_SECOND as NS

from .follower import Follower, held_rows, judge_state, numbered
from .judge import JUMP

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfdb._core import Clock
    from tfdb.streams.rows import Stretch

    from .events import Event
    from .expectations import Expectations
    from .follower import Followed
    from .judge import Judge
    from .rates import Rates

LOOK = 0.1
"""Seconds between two looks at a clock that does not run as this machine's does."""
_DOUBT = NS // 2
"""A sample meets what was due up to so long before the look that found it: less than a jump."""
_LONGEST = 1.0
"""Seconds between two looks at this machine's clock while anything is waited for: it may be set."""
_EARLY = 0.002
"""Seconds before something is due at which a resting follower looks for the sample."""
_PAST = 1e-4


class _Passing:
    """Reads a store's clock, and detects when it was set ahead. Threads: one."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._began = time.monotonic_ns()
        self._shown, self._speed = clock.now(), self._speed_now()

    def look(self) -> tuple[int, int]:
        """Return the clock's time, and how far it is ahead of the time that can have passed."""
        began, now = time.monotonic_ns(), self._clock.now()
        passed, speed = time.monotonic_ns() - self._began, self._speed_now()
        ahead = now - self._shown - round(passed * max(speed, self._speed))
        self._began, self._shown, self._speed = began, now, speed
        return now, ahead if ahead > JUMP else 0

    def _speed_now(self) -> float:
        return 0.0 if self._clock.paused else self._clock.speed


class LiveJudge:
    """Evaluates the commits of a live store as they arrive.

    A sample arrives when its commit is read. A deadline that passes between two reads is met by a
    sample of the second read. If that read is half a second late, arrival times are estimated from
    the stamps and the shortest delay of the edge. Threads: one at a time; `read` may wait beside
    the others.

    Parameters
    ----------
    live
        The store and the clock of its stamps.
    judge
        Its start is now.
    rates
        Counts the samples as well.
    judges
        Whether to evaluate expectations. False: samples are only counted.
    now
        Time on the clock. None: it is read.
    """

    def __init__(
        self,
        live: Followed,
        judge: Judge,
        *,
        rates: Rates | None = None,
        judges: bool = True,
        now: int | None = None,
    ) -> None:
        self.judge = judge
        self._live, self._rates, self._judges = live, rates, judges
        self._passing = None if live.clock is None else _Passing(live.clock)
        self.looked: int = live.now() if now is None else now
        """What the clock showed when it was asked last."""
        self._missed = 0
        with live.store.snapshot() as state:
            live.commit = state.commit
            self._follower = Follower(live)
            held = held_rows(judge, state, self.looked)
        if rates is not None:
            rates.add(held.at(held.static))
        self.begun: list[Event] = judge.feed_held(held) if judges else []
        """The events of what the store had already."""
        self._due = self._next_due()

    @property
    def missed(self) -> int:
        """Number of missed commits."""
        return self._follower.missed

    def read(self, until: float = math.inf) -> list[Stretch]:
        """Wait for commits until a monotonic time, or until something is due; return them."""
        due = self._due
        if due is None:
            return self._follower.read(until)
        now, clock = time.monotonic(), self._live.clock
        if clock is None or clock.paused:
            return self._follower.read(min(until, now + LOOK))
        left = max(due - clock.now(), 0) / NS / clock.speed
        longest = _LONGEST if clock.is_system else LOOK
        return self._follower.read(
            min(until, now + min(left + _PAST, longest)), now + left - _EARLY
        )

    def take(
        self, stretches: Sequence[Stretch], look: tuple[int, int] | None = None
    ) -> list[Event]:
        """Evaluate read commits, and the time until now or until a given reading of the clock."""
        now, ahead = look or self.look()
        since, self.looked = self.looked, now
        due = now if self._due is None else self._due
        is_late = since <= due < now - _DOUBT
        doubt = now - due if not ahead and max(since, now - _DOUBT) <= due < now else 0
        events: list[Event] = []
        for each in stretches:
            self.judge.forget(each.cleared)  # the stamps of such a frame may restart
            fed = numbered(self.judge, each.arrived, now)
            if is_late or ahead:
                fed.arrivals[:] = self.judge.earliest_arrivals(fed, since, now)
                since = int(fed.arrivals.max(initial=since))
            if self._rates is not None:
                self._rates.forget(each.cleared)
                self._rates.add(fed)
            if not self._judges:
                continue
            if doubt:
                fed.arrivals.fill(due)  # a sample may have been first
            feed = self.judge.feed_held if each.cleared else self.judge.feed
            if ahead and since > now - ahead:
                later = fed.arrivals > now - ahead
                events += feed(fed.at(~later))
                events += self.judge.set_ahead(now, ahead)
                since, ahead = now, 0
                fed = fed.at(later)
                fed.arrivals.fill(now)
            events += feed(fed, doubt or min(now - since, _DOUBT) * is_late)
        if not self._judges:
            return events
        if ahead:
            events += self.judge.set_ahead(now, ahead)
        if self.missed > self._missed:
            self._missed = self.missed
            events += judge_state(self.judge, self._live.store, now)
        events += self.judge.advance(now)
        self._due = self._next_due()
        return events

    def look(self) -> tuple[int, int]:
        """Return the clock's time, and how far it was set ahead since the last call."""
        return (self._live.now(), 0) if self._passing is None else self._passing.look()

    def change(self, expectations: Expectations, now: int) -> None:
        """Replace the expectations from now on."""
        self.judge.change(expectations, now)
        self._due = self._next_due()

    def _next_due(self) -> int | None:
        return self.judge.next_due() if self._judges else None

"""The loop of all that is judged live: a follower, a judge, and the next look at the time."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING

from tfdb.data.decimal_time import NS_PER_SECOND as NS

from .follower import Follower, held_rows, judge_state, numbered

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfdb.streams.rows import Stretch

    from .events import Event
    from .expectations import Expectations
    from .follower import Followed
    from .judge import Judge
    from .rates import Rates

LOOK = 0.1
"""Seconds between two looks at a clock that does not run as this machine's does."""
_DOUBT = NS // 2
"""How late a look may be for a sample to meet what was due before it: less than a jump."""
_LONGEST = 1.0
"""Seconds between two looks at this machine's clock while anything is waited for: it may be set."""
_EARLY = 0.002
"""Seconds before something is due at which a resting follower looks for the sample."""
_PAST = 1e-4


class LiveJudge:
    """Judges what is committed to a live store, as it comes.

    A sample arrives when its commit is read. What is due between two looks is met by a sample that
    the second one finds, unless that look is half a second late. Threads: one at a time; `read` may
    wait beside the others.

    Parameters
    ----------
    live
        The store and the clock of its stamps.
    judge
        Its start is now.
    rates
        Counts the samples as well.
    judges
        Whether anything is expected: else samples are counted only.
    """

    def __init__(
        self, live: Followed, judge: Judge, *, rates: Rates | None = None, judges: bool = True
    ) -> None:
        self.judge = judge
        self._live, self._rates, self._judges = live, rates, judges
        self._looked = live.now()
        self._missed = 0
        with live.store.snapshot() as state:
            live.commit = state.commit
            self._follower = Follower(live)
            held = held_rows(judge, state, self._looked)
        if rates is not None:
            rates.add(held.at(held.static))
        self.begun: list[Event] = judge.feed_held(held) if judges else []
        """The events of what the store had already."""
        self._due = self._next_due()

    @property
    def missed(self) -> int:
        """How many commits went by unseen."""
        return self._follower.missed

    def read(self, until: float = math.inf) -> list[Stretch]:
        """Wait for commits until a monotonic time, or until something is due; return them."""
        due = self._due
        if due is None:
            return self._follower.read(until)
        now = time.monotonic()
        if self._live.now is not time.time_ns:
            return self._follower.read(min(until, now + LOOK))
        left = max(due - time.time_ns(), 0) / NS
        return self._follower.read(
            min(until, now + min(left + _PAST, _LONGEST)), now + left - _EARLY
        )

    def take(self, stretches: Sequence[Stretch]) -> list[Event]:
        """Judge commits that were read, and the time until now."""
        now, due = self._live.now(), self._due
        # Of what was due since the last look and a sample, the sample may have been first.
        in_doubt = due is not None and max(self._looked, now - _DOUBT) <= due < now
        arrival = due if due is not None and in_doubt else now
        self._looked = now
        events: list[Event] = []
        for cleared, rows in stretches:
            self.judge.forget(cleared)  # the stamps of such a frame may begin anew
            fed = numbered(self.judge, rows, now)
            if self._rates is not None:
                self._rates.forget(cleared)
                self._rates.add(fed)
            if self._judges:
                fed.arrivals.fill(arrival)
                events += self.judge.feed(fed, now - arrival)
        if not self._judges:
            return events
        if self.missed > self._missed:
            self._missed = self.missed
            events += judge_state(self.judge, self._live.store, now)
        events += self.judge.advance(now)
        self._due = self._next_due()
        return events

    def change(self, expectations: Expectations) -> None:
        """Judge by other expectations from now on."""
        self.judge.change(expectations, self._live.now())
        self._due = self._next_due()

    def _next_due(self) -> int | None:
        return self.judge.next_due() if self._judges else None

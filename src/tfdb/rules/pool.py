"""Threads that run the actions of rules, one at a time for each rule and each series."""

from __future__ import annotations

import heapq
import logging
import threading
import time
from collections import defaultdict, deque
from itertools import count
from typing import TYPE_CHECKING

from tfdb.data.errors import Conflict

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb._core import Buffer, Transaction

    from .event import Event
    from .rule import Rule
    from .stats import RuleStats

__all__: list[str] = []

LOGGER = logging.getLogger("tfdb.rules")


class _Lane:
    """A queue of events of a rule, or a series of rules, whose actions run one at a time."""

    def __init__(self) -> None:
        self.events: deque[Event] = deque()
        self.is_busy = False


class Pool:
    """Runs actions in daemon threads."""

    def __init__(self, buffer: Buffer, total: RuleStats, report: Report) -> None:
        self._buffer = buffer
        self._total = total
        self._report = report
        self.lock: threading.Condition = threading.Condition()
        # Events whose action is committing; `_chains` lacks these commits.
        self._committing: set[Event] = set()
        self._chains: dict[int, tuple[str, ...]] = {}  # the rules that led to each commit
        self._lanes: dict[object, _Lane] = {}
        self._waiting: defaultdict[Rule, dict[Event, _Lane]] = defaultdict(dict)
        self._ready: list[tuple[float, int, _Lane]] = []
        self._order = count()
        self._wanted = 4
        self._threads = 0
        self._running = 0
        self._rests = False
        self._local = threading.local()

    @property
    def threads(self) -> int:
        """Number of actions that run at once."""
        return self._wanted

    def resize(self, threads: int) -> None:
        """Set the number of actions that run at once."""
        with self.lock:
            self._wanted = threads
            for _ in self._ready:
                self._start_another()
            self.lock.notify_all()

    def begin(self) -> None:
        """Start the first thread. If no other one can start, it runs all actions."""
        with self.lock:
            self._rests = False
            if self._threads == 0:
                self._start_thread()

    def is_its_thread(self) -> bool:
        """Whether the calling thread runs actions of this pool."""
        return hasattr(self._local, "works")

    def count(self, rule: Rule, **figures: int) -> None:
        """Add to the counts of a rule and of all rules."""
        with self.lock:
            for stats in (rule.stats, self._total):
                for name, by in figures.items():
                    setattr(stats, name, getattr(stats, name) + by)

    def schedule(self, event: Event) -> None:
        """Append an event to its lane."""
        rule = event.rule
        with self.lock:
            if rule.removed:
                event.snapshot.close()
                return
            self.count(rule, scheduled=1, pending=1)
            now = time.monotonic()
            event._due = (
                now + rule._debounce if rule._debounce else max(now, rule._began + rule._interval)
            )
            waiting = self._waiting[rule]
            lane = self._lane_of(rule)
            if rule._merges and waiting:
                before = next(reversed(waiting))
                event.merged = before.merged + 1
                lane = self._discard(before)
                self.count(rule, merged=1)
            elif len(waiting) >= rule._max_pending:
                self.count(rule, dropped=1)
                if not rule._keeps_newest:
                    self.count(rule, pending=-1)
                    event.snapshot.close()
                    return
                lane = self._discard(next(iter(waiting)))
            # This event takes the place of a discarded one: each lane in `_ready` has an event.
            waiting[event] = lane
            lane.events.append(event)
            if not lane.is_busy:
                lane.is_busy = True
                self._make_ready(lane, event._due)

    def forget(self, rule: Rule) -> None:
        """Discard a rule's events that have not begun. The lock is held."""
        for event in tuple(self._waiting[rule]):
            self._discard(event)
            self.count(rule, dropped=1)
        del self._waiting[rule]
        self._lanes.pop(rule, None)
        ready, self._ready = self._ready, []
        for _, _, lane in ready:
            self._ready_next(lane)

    def chain_of(self, commit: int) -> tuple[str, ...]:
        """Return the rules that led to a commit, once it is known whether an action made it."""
        with self.lock:
            others = set(self._committing)
            self.lock.wait_for(
                lambda: commit in self._chains or others.isdisjoint(self._committing)
            )
            return self._chains.get(commit, ())

    def forget_chains(self, until: int) -> None:
        """Forget the rules that led to commits, once these are evaluated."""
        with self.lock:
            for commit in [commit for commit in self._chains if commit <= until]:
                del self._chains[commit]

    def drain(self, timeout: float | None) -> bool:
        """Wait until no event waits or runs. False: the timeout has passed."""
        with self.lock:
            return self.lock.wait_for(lambda: not self._ready and self._running == 0, timeout)

    def rest(self) -> None:
        """Let the threads end, because no rule is installed."""
        with self.lock:
            self._rests = True
            self.lock.notify_all()

    def _lane_of(self, rule: Rule) -> _Lane:
        if rule._overlap:
            return _Lane()
        key: object = rule if rule._serial is None else rule._serial
        return self._lanes.setdefault(key, _Lane())

    def _make_ready(self, lane: _Lane, due: float) -> None:
        heapq.heappush(self._ready, (due, next(self._order), lane))
        self._start_another()
        self.lock.notify_all()  # `drain` waits on the same condition

    def _start_another(self) -> None:
        """Start another thread if all others are busy."""
        if self._threads - self._running < len(self._ready) and self._threads < self._wanted:
            try:
                self._start_thread()
            except RuntimeError:
                LOGGER.exception("another thread for actions cannot start")

    def _start_thread(self) -> None:
        threading.Thread(target=self._work, name="tfdb rules", daemon=True).start()
        self._threads += 1

    def _discard(self, event: Event) -> _Lane:
        """Discard a waiting event. Return its lane."""
        lane = self._waiting[event.rule].pop(event)
        lane.events.remove(event)
        self.count(event.rule, pending=-1)
        event.snapshot.close()
        return lane

    def _work(self) -> None:
        self._local.works = True
        while (taken := self._take()) is not None:
            lane, event = taken
            try:
                self._run(event)
            finally:
                event.snapshot.close()
                with self.lock:
                    self._running -= 1
                    self._ready_next(lane)
                    self.lock.notify_all()

    def _take(self) -> tuple[_Lane, Event] | None:
        """Wait for an event that is due. None: this thread ends."""
        with self.lock:
            while True:
                if self._rests or self._threads > self._wanted:
                    self._threads -= 1
                    return None
                left = self._ready[0][0] - time.monotonic() if self._ready else None
                if left is None or left > 0:
                    self.lock.wait(left)
                    continue
                _, _, lane = heapq.heappop(self._ready)
                event = lane.events[0]
                now = time.monotonic()
                if event._due > now:
                    self._ready_next(lane)
                    continue
                lane.events.popleft()
                rule = event.rule
                del self._waiting[rule][event]
                rule._began = now
                self._running += 1
                latency = (time.monotonic_ns() - event.scheduled) / 1e9
                for stats in (rule.stats, self._total):
                    stats.began(latency)
                return lane, event

    def _ready_next(self, lane: _Lane) -> None:
        """Make the next event of a lane ready."""
        if lane.events:
            self._make_ready(lane, lane.events[0]._due)
        else:
            lane.is_busy = False
            self.lock.notify_all()

    def _run(self, event: Event) -> None:
        rule = event.rule
        began = time.monotonic()
        try:
            if rule._wants_transaction:
                self._run_in_transaction(event)
            else:
                self.count(rule, invoked=1)
                rule._action(event)
        except BaseException as error:  # the main thread handles an exit or Ctrl-C
            self._report(rule, event, error)
        seconds = time.monotonic() - began
        with self.lock:
            for stats in (rule.stats, self._total):
                stats.ended_after(seconds)

    def _run_in_transaction(self, event: Event) -> None:
        rule = event.rule
        is_retry = False

        def attempt(transaction: Transaction) -> Transaction:
            nonlocal is_retry
            self._note(event)
            self.count(rule, invoked=1, retried=is_retry)
            is_retry = True
            rule._action(event, transaction)
            with self.lock:
                self._committing.add(event)
            return transaction

        try:
            won = self._buffer.run(attempt, retries=rule._retries)
            self._note(event, won.commit if won._has_written else None)
        except Conflict:
            self.count(rule, abandoned=1)
            raise
        finally:
            self._note(event)

    def _note(self, event: Event, commit: int | None = None) -> None:
        """Note that an action of the event made this commit, or cannot commit any more."""
        with self.lock:
            if commit is not None:
                self._chains[commit] = (*event.chain, event.rule.name)
            if event in self._committing:
                self._committing.remove(event)
                self.lock.notify_all()


if TYPE_CHECKING:
    from typing import TypeAlias

    Report: TypeAlias = Callable[[Rule, Event | None, BaseException], None]

"""The thread that evaluates the rules of a buffer on each commit that touches them."""

from __future__ import annotations

import importlib
import logging
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING

from tfdb.data.errors import (
    BufferClosed,
    FeedLapped,
    InvalidArgument,
    NoSuchStore,
    RuleCycle,
    SnapshotTooOld,
    WatchClosed,
)
from tfdb.store.waiting import NO_ANSWER_YET

from .event import Event
from .pool import Pool
from .rule import EVERY
from .stats import RuleStats

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb._core import Buffer, Snapshot, Transform, Watch
    from tfdb.data.types import Changes, Touched

    from .rule import Rule, Subject

__all__: list[str] = []

LOGGER = logging.getLogger("tfdb.rules")
_COMMITS = 256  # evaluated before rules can be added or removed
_RENEWED = 1.0  # seconds: longest hold of a snapshot, which keeps old samples in memory


class Dispatcher:
    """Evaluates the rules of one buffer in commit order.

    The lock guards the installed rules. Conditions and actions run without it. Threads run, and
    keep a reference to the buffer, only while rules are installed.
    """

    def __init__(self, buffer: Buffer) -> None:
        self._buffer = buffer
        self.total: RuleStats = RuleStats()
        self.on_error: Callable[[Rule, Event | None, BaseException], object] | None = None
        self.log_interval: float | None = None
        self.pool: Pool = Pool(buffer, self.total, self.report)
        self._lock = threading.Condition()
        self.rules: list[Rule] = []
        self._joining: list[tuple[Rule, Snapshot]] = []
        self._installed = 0
        self._is_stale = True  # `_watch` is outdated
        self._may_sleep = False  # the thread may sleep in `_watch`
        self._watch: Watch | None = None
        self._by_subject: dict[Subject, list[Rule]] = {}
        self._held: Snapshot | None = None  # a snapshot of `_position` or earlier
        self._position = 0  # the commit up to which the rules were evaluated
        self._thread: threading.Thread | None = None
        self._logged = time.monotonic()
        self.ended: bool = False

    def add(self, rule: Rule) -> None:
        """Install a rule, which is evaluated on later commits."""
        frames, pairs, every = _watched([rule])
        if frames or every:
            # An import in a daemon thread could block the end of the program.
            importlib.import_module("numpy")
        # This raises for frames that the buffer cannot watch.
        self._buffer.watch(frames, pairs, every=every).close()
        for pair in pairs:
            with suppress(*NO_ANSWER_YET):
                self._buffer.lookup_transform(*pair, rule._at, rule._policy)
        with self._lock:
            if self.ended:
                raise BufferClosed("the rules of this buffer have ended: it was closed")
            if self._thread is None:  # without rules, it ends again
                thread = threading.Thread(target=self._run, name="tfdb rules", daemon=True)
                thread.start()
                self._thread = thread
            self.pool.begin()
            start = self._buffer.snapshot()
            self._installed += 1
            rule._order = self._installed
            rule._remove = self.remove
            rule._seen = start.commit
            self.rules.append(rule)
            self._joining.append((rule, start))
            self._change()

    def remove(self, rule: Rule) -> None:
        """End a rule: none of its actions begins afterwards."""
        with self._lock:
            if rule.removed:
                return
            self.rules.remove(rule)
            self._change()
            with self.pool.lock:
                rule._remove = None
                self.pool.forget(rule)

    def drain(self, timeout: float | None) -> bool:
        """Wait until all commits so far are evaluated, and no action waits or runs."""
        if threading.current_thread() is self._thread or self.pool.is_its_thread():
            raise InvalidArgument(
                "drain() cannot be called in a rule's function: it would wait for itself"
            )
        until = None if timeout is None else time.monotonic() + timeout
        while not self._is_idle():
            with self._lock:
                newest = self._buffer.commit
                if self._position < newest:  # commits that touch no rule do not wake the thread
                    self._is_stale = True
                    if self._may_sleep:  # else drains in a loop would close each new watch
                        self._change()
                while self._is_behind(newest):
                    if not self._lock.wait(_left(until)):
                        return False
            if not self.pool.drain(_left(until)):
                return False
        return True

    def _is_idle(self) -> bool:
        with self._lock:
            return not self._is_behind(self._buffer.commit) and self.pool.drain(0)

    def _is_behind(self, commit: int) -> bool:
        """Whether a new rule, or a commit up to this one, is not evaluated. The lock is held."""
        return self._thread is not None and (bool(self._joining) or self._position < commit)

    def report(self, rule: Rule, event: Event | None, error: BaseException) -> None:
        """Log and count an exception of a condition (no event) or an action."""
        self.pool.count(rule, exceptions=1)
        what = "condition" if event is None else "action"
        LOGGER.error("the %s of rule %r raised", what, rule.name, exc_info=error)
        if (on_error := self.on_error) is not None:
            try:
                on_error(rule, event, error)
            except BaseException:  # logged, like an exception of an action
                LOGGER.exception("on_error raised")

    def wake(self) -> None:
        """Wake the thread to apply new settings."""
        with self._lock:
            self._change()

    def in_child(self) -> Dispatcher:
        """Remove all rules in a child of fork, which has no other threads. Keep the settings."""
        for rule in self.rules:
            rule._remove = None
        child = Dispatcher(self._buffer)
        child.on_error = self.on_error
        child.log_interval = self.log_interval
        child.pool.resize(self.pool.threads)
        return child

    def _change(self) -> None:
        self._is_stale = True
        if self._watch is not None:
            self._watch.close()

    def _run(self) -> None:
        try:
            while self._step():
                pass
        except (BufferClosed, NoSuchStore):
            self._end()
        except BaseException:
            LOGGER.exception("the rules of a buffer have ended")
            self._end()

    def _end(self) -> None:
        with self._lock:
            self.ended = True
            self._change()
            with self.pool.lock:
                for rule in self.rules:
                    rule._remove = None
                    self.pool.forget(rule)
            self.rules = []
            self._stop()

    def _stop(self) -> None:
        for _, start in self._joining:
            start.close()
        self._joining = []
        if self._held is not None:
            self._held.close()
        self._held = self._watch = self._thread = None
        self._by_subject = {}
        self.pool.rest()
        self._lock.notify_all()

    def _step(self) -> bool:
        """Evaluate the next commits. False: all rules were removed."""
        watch = self._renewed()
        if watch is None or self._held is None:
            return False
        taken = self._buffer.snapshot()
        try:
            touched = watch.next(self._position, self._patience(), limit=_COMMITS)
            for record in touched:
                with self._held.at(record.commit) as state:
                    self._evaluate(record, state)
                self._position = record.commit
        except (FeedLapped, SnapshotTooOld):
            taken.close()  # it may be older than what was evaluated
            newest = self._buffer.snapshot()
            try:
                self._evaluate_newest(newest)
            except SnapshotTooOld:  # the next step tries again
                newest.close()
            return True
        except WatchClosed:
            taken.close()
            return True
        last = touched[-1].commit if touched else 0
        position = max(taken.commit, last)
        if len(touched) == _COMMITS:
            position = last
            self._is_stale = True  # the next step does not sleep: a drain may wait for it
        self._move(position, taken)
        return True

    def _move(self, position: int, taken: Snapshot) -> None:
        """Continue after a commit. `taken`: a snapshot to hold, unless it is newer."""
        with self._lock:
            self._position = position
            if taken.commit > position:
                taken.close()
            elif self._held is not None:
                self._held.close()
                self._held = taken
            self._lock.notify_all()
        self.pool.forget_chains(position)

    def _patience(self) -> float:
        """Log the counts when due. Return the seconds that the thread may sleep."""
        if not self._may_sleep:
            return 0.0
        if self.log_interval is None:
            return _RENEWED
        left = self._logged + self.log_interval - time.monotonic()
        if left > 0:
            return min(left, _RENEWED)
        self._logged = time.monotonic()
        for rule in tuple(self.rules):
            LOGGER.info("rule %r: %s", rule.name, rule.stats)
        LOGGER.info("all rules: %s", self.total)
        return min(self.log_interval, _RENEWED)

    def _renewed(self) -> Watch | None:
        """Add and remove rules. Return the watch of all rules; None without rules."""
        with self._lock:
            if not self.rules:
                self._stop()
                return None
            # A new watch first returns what is present: a drain may wait for it.
            self._may_sleep = not self._is_stale
            if self._may_sleep:
                return self._watch
            joining = tuple(self._joining)
            frames, pairs, every = _watched(self.rules)
            self._watch = self._buffer.watch(frames, pairs, every=every)
            self._is_stale = False
            self._by_subject = {}
            for rule in self.rules:
                for subject in rule.on:
                    self._by_subject.setdefault(subject, []).append(rule)
            self._rewind(joining)
            watch = self._watch
        for rule, start in joining:
            # A condition with a lost state counts as not True.
            with start, suppress(SnapshotTooOld):
                for subject in rule.on:
                    if isinstance(subject, tuple):
                        self._judge(rule, subject, start, (), None, first=True)
        with self._lock:
            del self._joining[: len(joining)]
        return watch

    def _rewind(self, joining: tuple[tuple[Rule, Snapshot], ...]) -> None:
        """Go back to the state at which the first of these rules was installed."""
        for _, start in joining[:1]:
            if self._held is None:
                self._position = start.commit
            if self._position >= start.commit:
                for rule in self.rules:
                    rule._seen = max(rule._seen, self._position)
                for rule, its in joining:
                    rule._seen = its.commit
                if self._held is not None:
                    self._held.close()
                self._held = start.at(start.commit)
                self._position = start.commit

    def _evaluate(self, record: Touched, state: Snapshot) -> None:
        chain = self.pool.chain_of(record.commit)
        due = [
            (rule._order, rule, subject)
            for subject in (*record.what, EVERY)
            for rule in self._by_subject.get(subject, ())
            if record.commit > rule._seen
        ]
        changes: dict[str, Changes | None] = {}
        for _, rule, subject in sorted(due, key=lambda each: each[0]):
            if isinstance(subject, tuple):
                self._judge(rule, subject, state, chain, None)
                continue
            if subject not in changes:
                changes[subject] = self._changes_of(record.commit, subject)
            if (its := changes[subject]) is not None:
                self._judge(rule, subject, state, chain, its)

    def _changes_of(self, commit: int, frame: str) -> Changes | None:
        """Return a commit's changes of a frame, or of all frames; None: it changed none."""
        frames = None if frame == EVERY else (frame,)
        found = self._buffer.changes(commit - 1, 1, frames=frames)
        return found[0] if found and found[0].commit == commit else None

    def _evaluate_newest(self, newest: Snapshot) -> None:
        """Evaluate all rules on the newest state, because earlier ones are lost.

        A condition on frames cannot be evaluated, because it needs the commits. A rule on frames
        without a condition fires.
        """
        unseen = newest.commit - self._position - 1
        rules = tuple(self.rules)
        for rule in rules:
            for subject in rule.on:
                if newest.commit > rule._seen and (isinstance(subject, tuple) or not rule._when):
                    self._judge(rule, subject, newest, (), None, unseen=unseen)
        with self.pool.lock:
            for stats in (*(rule.stats for rule in rules), *[self.total] * len(rules)):
                stats.unseen += unseen
        self._move(newest.commit, newest)

    def _judge(
        self,
        rule: Rule,
        subject: Subject,
        state: Snapshot,
        chain: tuple[str, ...],
        changes: Changes | None,
        *,
        unseen: int = 0,
        first: bool = False,
    ) -> None:
        """Evaluate one rule on the state of a commit, and schedule its action if it fires."""
        answer: Transform | None = None
        if isinstance(subject, tuple):
            with suppress(*NO_ANSWER_YET):
                answer = state.lookup_transform(*subject, rule._at, rule._policy)
        value = answer if isinstance(subject, tuple) else changes
        missing = isinstance(subject, tuple) and answer is None
        try:
            truth = not missing and (rule._when is None or bool(rule._when(value)))
        except BaseException as error:  # the main thread handles an exit or Ctrl-C
            self.report(rule, None, error)
            return
        was, before = rule._truths.get(subject, False), rule._answers.get(subject)
        rule._truths[subject], rule._answers[subject] = truth, answer
        fires = {
            "rises": truth and not was,
            "falls": was and not truth,
            "changes": truth and answer != before,
            "always": truth,
        }[rule.fires]
        if not (rule._initial and truth if first else fires):
            return
        event = Event(
            rule, subject, state.commit, answer, before, changes, state.at(state.commit),
            time.monotonic_ns(), chain, unseen=unseen,
        )  # fmt: skip
        if event.depth <= rule._max_depth:
            self.pool.schedule(event)
            return
        event.snapshot.close()
        self.pool.count(rule, dropped=1)
        text = f"rule {rule.name!r} is not run: more than {rule._max_depth} rules led to it: "
        self.report(rule, event, RuleCycle(text + " -> ".join(chain), commit=state.commit))


def _watched(rules: list[Rule]) -> tuple[list[str], list[tuple[str, str]], bool]:
    """Return the frames and pairs of these rules, and whether one needs every commit."""
    subjects = list(dict.fromkeys(subject for rule in rules for subject in rule.on))
    frames = [subject for subject in subjects if isinstance(subject, str)]
    pairs = [subject for subject in subjects if isinstance(subject, tuple)]
    return [name for name in frames if name != EVERY], pairs, EVERY in frames


def _left(until: float | None) -> float | None:
    return None if until is None else max(0.0, until - time.monotonic())

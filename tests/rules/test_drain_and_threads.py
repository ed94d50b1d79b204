"""Drains, the threads of rules, and the memory of their events."""

from __future__ import annotations

import gc
import os
import threading
from typing import Any

import pytest

import tfdb
from tests.rules.conftest import put
from tfdb.rules import Event, RuleStats, dispatcher


def test_drain_waits_for_the_first_evaluation_of_a_rule() -> None:
    buf = tfdb.Buffer()
    put(buf, 1.0)
    buf.add_rule(print, ("map", "camera"))
    assert buf.rules.drain(60)
    go = threading.Event()
    fired: list[int] = []
    buf.add_rule(lambda e: fired.append(e.commit), ("map", "base"), lambda _: go.wait(60),
                 initial=True)  # fmt: skip
    assert not buf.rules.drain(0)
    go.set()
    assert buf.rules.drain(60)
    assert fired == [1]


def test_drain_wakes_the_thread_for_a_commit_that_touches_no_rule(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(dispatcher, "_RENEWED", 1e6)
    buf = tfdb.Buffer()
    buf.add_rule(print, ("map", "base"))
    put(buf, 1.0, child="camera")
    assert buf.rules.drain(60)
    put(buf, 2.0, child="camera")
    while not buf.rules.drain(0):
        buf.wait_for_commit(0)


def test_drain_does_not_wait_after_a_full_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """The commits that one step may evaluate, and then one that touches no rule."""
    monkeypatch.setattr(dispatcher, "_RENEWED", 1e6)
    buf = tfdb.Buffer()
    begun, drains = threading.Event(), threading.Event()

    def block(_: object) -> bool:
        begun.set()
        return drains.wait(60)

    rule = buf.add_rule(lambda _: None, ("map", "base"), block, fires="always")
    put(buf, 1.0)
    assert begun.wait(60)
    for place in range(dispatcher._COMMITS):
        put(buf, float(place))
    put(buf, 1.0, child="camera")
    left = dispatcher._left

    def wait(until: float | None) -> float | None:
        drains.set()
        return left(until)

    monkeypatch.setattr(dispatcher, "_left", wait)
    assert buf.rules.drain(60)
    assert rule.stats.scheduled == dispatcher._COMMITS + 1


@pytest.mark.parametrize("overlap", [False, True])
@pytest.mark.parametrize("limit", [{"max_pending": 10}, {"max_rate": 1e3}, {"debounce": 1e-3}])
def test_discarded_events_use_no_memory(limit: Any, overlap: bool) -> None:
    buf = tfdb.Buffer()
    buf.rules.threads = 2
    go = threading.Event()
    ran: list[int] = []

    def run(event: Event) -> None:
        ran.append(event.commit)
        go.wait()

    rule = buf.add_rule(run, "base", overlap=overlap, **limit)
    for place in range(300):
        put(buf, float(place))
    last = buf.commit
    while rule.stats.scheduled < last:
        buf.wait_for_commit(0)
    held = sum(type(each) is Event and each.rule is rule for each in gc.get_objects())
    assert held <= 2 + 10 + 1  # in actions, waiting, in the thread that evaluates
    go.set()
    assert buf.rules.drain(60)
    assert last in ran
    stats = rule.stats
    assert (stats.pending, stats.invoked) == (0, len(ran))
    assert stats.invoked + stats.merged + stats.dropped == stats.scheduled == last


def test_a_series_keeps_its_order_if_a_rule_joins_while_the_thread_begins_to_read(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    buf = tfdb.Buffer()
    order: list[tuple[int, str]] = []
    reads, go = threading.Event(), threading.Event()
    patience = dispatcher.Dispatcher._patience

    def wait(self: dispatcher.Dispatcher) -> float:
        reads.set()
        assert go.wait(60)
        return patience(self)

    monkeypatch.setattr(dispatcher.Dispatcher, "_patience", wait)
    for name in ("one", "two"):
        buf.add_rule(lambda e: order.append((e.commit, e.rule.name)), "base", name=name, serial="s")
        assert reads.wait(60)
    put(buf, 1.0)
    put(buf, 2.0)
    go.set()
    assert buf.rules.drain(60)
    assert order == [(1, "one"), (1, "two"), (2, "one"), (2, "two")]


def refuse_threads(monkeypatch: pytest.MonkeyPatch, *refused: int) -> None:
    """Let these starts of threads of rules fail, counted from 0."""
    start = threading.Thread.start
    starts: list[threading.Thread] = []

    def begin(thread: threading.Thread) -> None:
        if thread.name == "tfdb rules":
            starts.append(thread)
            if len(starts) - 1 in refused:
                raise RuntimeError("no more threads")
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", begin)


@pytest.mark.parametrize("refused", [0, 1])
def test_add_rule_raises_if_a_thread_cannot_start_and_the_next_rule_runs(
    refused: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    buf = tfdb.Buffer()
    fired: list[int] = []

    def note(event: Event) -> None:
        fired.append(event.commit)

    refuse_threads(monkeypatch, refused)
    with pytest.raises(RuntimeError, match="no more threads"):
        buf.add_rule(note, "base")
    assert len(buf.rules) == 0
    put(buf, 1.0)
    assert buf.rules.drain(60)
    buf.add_rule(note, "base")
    put(buf, 2.0)
    assert buf.rules.drain(60)
    assert fired == [2]


def test_actions_run_in_one_thread_if_no_other_can_start(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    buf = tfdb.Buffer()
    begun, go = threading.Event(), threading.Event()
    ran: list[int] = []

    def run(event: Event) -> None:
        begun.set()
        assert go.wait(60)
        ran.append(event.commit)

    rule = buf.add_rule(run, "base", overlap=True)
    put(buf, 1.0)
    assert begun.wait(60)
    refuse_threads(monkeypatch, *range(10))
    put(buf, 2.0)
    while rule.stats.scheduled < 2:
        buf.wait_for_commit(0)
    go.set()
    assert buf.rules.drain(60)
    assert ran == [1, 2]
    assert not rule.removed
    assert "another thread for actions cannot start" in caplog.text


def test_the_mean_latency_is_that_of_all_begun_actions() -> None:
    stats = RuleStats()
    stats.began(1.0)
    stats.began(3.0)  # the first action still runs
    assert (stats.latency_mean, stats.latency_max) == (2.0, 3.0)


def test_a_child_of_fork_keeps_the_settings_of_rules() -> None:
    buf = tfdb.Buffer()
    buf.rules.threads = 2
    buf.rules.stats_log_interval = 1e6
    buf.rules.on_error = print
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        rules = buf.rules
        kept = rules.threads, rules.stats_log_interval, rules.on_error is print
        os.write(writing, repr(kept).encode())
        os._exit(0)
    os.waitpid(child, 0)
    assert os.read(reading, 100) == b"(2, 1000000.0, True)"
    os.close(reading)
    os.close(writing)

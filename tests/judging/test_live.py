"""Expectations of a live buffer: events at the right stamp, their ends, and what stops nothing."""

from __future__ import annotations

import asyncio
import dataclasses
import logging
import os
import subprocess
import sys
import threading
import time
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tfdb.cli.graph import Live
from tfdb.errors import BufferClosed, InvalidArgument, NoSuchStore, NotSupported, StreamClosed
from tfdb.judging import AuthorityExpectation, Event, Expectation, Limits
from tfdb.judging.judge import Judge
from tfdb.judging.live import LiveJudge
from tfdb.judging.proposing import judge_recording, recorded_arrivals, span_of

from .naive_judge import S
from .test_judge import START, random_expectations, random_rows, rows_of, told

if TYPE_CHECKING:
    from collections.abc import Iterator

BAG = Path(__file__).parents[2] / "examples/data/pr2.bag"


class Robot:
    """A buffer with a simulated clock. Each step is judged before the next one."""

    def __init__(self, **options: Any) -> None:
        self.now = START
        self.buf = tfdb.Buffer(clock=lambda: self.now, **options)

    def wait(self, until: float) -> None:
        self.now = START + round(until * S)
        assert self.buf.expectations.drain(60)

    def put(self, at: float, x: float = 0.0, authority: str = "ekf", child: str = "base") -> None:
        self.wait(at)
        self.buf.set_transform("odom", child, self.now, (x, 0, 0), authority=authority)
        assert self.buf.expectations.drain(60)


@pytest.fixture
def robot() -> Iterator[Robot]:
    made = Robot()
    yield made
    made.buf.close()


def seen(stream: tfdb.judging.EventStream) -> list[tuple[str, str, float]]:
    """The unread events: kind, severity, and seconds after START."""
    events = list(iter(stream.read_next, None))
    return [(e.kind, e.severity, round((e.time - START) / S, 9)) for e in events]


def facts(event: Event) -> tuple[Any, ...]:
    """All of an event but what differs between stores and recordings: the order of edges."""
    known = dataclasses.asdict(event)
    del known["commit"], known["authority"]
    return tuple(known.values())


def test_each_event_has_its_stamp_and_its_end(robot: Robot) -> None:
    limits: Limits = {"deadline": 0.5, "lifespan": "800 ms", "max_step": 1, "max_turn": 1.0}
    with robot.buf.events() as stream:
        robot.buf.expect("odom", "base", authority=["ekf", "wheels"], liveliness=2, **limits)
        robot.wait(1.2)
        robot.put(1.25)
        robot.put(1.3, x=3)
        robot.put(1.4, x=3, authority="intruder")
        robot.put(1.5, x=3, authority="wheels")
        robot.wait(2.6)
        robot.put(4.0, x=3)
        assert seen(stream) == [
            ("missing", "error", 1.0),
            ("missing", "ok", 1.25),
            ("step", "error", 1.3),
            ("foreign-authority", "error", 1.4),
            ("failover", "warning", 1.5),
            ("deadline", "warning", 2.0),
            ("lifespan", "stale", 2.3),
            ("step", "ok", 2.3),
            ("foreign-authority", "ok", 2.4),
            ("failover", "ok", 2.5),
            ("liveliness", "error", 3.3),
            ("liveliness", "error", 3.5),
            ("lifespan", "ok", 4.0),
            ("liveliness", "ok", 4.0),
            ("deadline", "ok", 4.0),
        ]
        assert [event.kind for event in robot.buf.expectations.active] == ["liveliness"]


def played(expected: tfdb.Expectations, beyond: int) -> list[Event]:
    """The events before a time, as the recording is played into a buffer."""
    found: list[Event] = []
    now, _ = span_of(recorded_arrivals([BAG]))
    buf = tfdb.Buffer(history=None, clock=lambda: now)
    buf.expectations.on_event = found.append
    buf.expect(expected)
    with tfdb.recordings.Recording(BAG) as recording:
        for source, received, data in recording.messages():
            if received > beyond:
                break
            now = max(now, received)
            buf.expectations.drain()
            static = source.topic == "/tf_static"
            writer = source.authority
            buf.ingest(data, encoding=source.encoding, static=static, authority=writer)
            buf.expectations.drain()
    buf.close()
    return found


def test_a_recording_that_is_played_gives_the_same_events() -> None:
    limits: Limits = {"deadline": 0.03, "lifespan": 0.03, "max_step": 0.01, "max_turn": 0.01}
    expected = tfdb.Expectations(default=Expectation(**limits))  # type: ignore[arg-type]
    arrivals = recorded_arrivals([BAG])
    beyond = span_of(arrivals)[0] + 3 * S
    wanted = [event for event in judge_recording(arrivals, expected) if event.time < beyond]
    found = [event for event in played(expected, beyond) if event.time < beyond]
    assert len(wanted) > 50
    assert sorted(map(facts, found)) == sorted(map(facts, wanted))


def test_proposals_of_a_good_recording_are_met_when_it_is_played() -> None:
    beyond = span_of(recorded_arrivals([BAG]))[0] + 3 * S
    assert played(tfdb.judging.propose(BAG), beyond) == []


def test_a_store_that_goes_on_after_a_pause_has_no_jump(robot: Robot) -> None:
    robot.put(0)
    robot.now += 60 * S
    robot.buf.expect("odom", "base", max_step=1)
    stream = robot.buf.events()
    robot.put(60.1)
    robot.put(60.2)
    assert seen(stream) == []


def test_by_the_system_clock_a_deadline_is_missed_without_a_commit() -> None:
    with tfdb.Buffer() as buf, buf.events() as stream:
        buf.set_transform("odom", "base", time.time_ns(), (1, 2, 3))
        buf.expect("odom", "*", deadline=0.05)
        event = stream.read_next(timeout=60)
        assert event is not None
        assert (event.kind, event.begins, event.value) == ("deadline", True, 0.05)
        buf.set_transform("odom", "base", time.time_ns(), (1, 2, 3))
        event = stream.read_next(timeout=60)
        assert event is not None
        assert (event.kind, event.begins, event.commit) == ("deadline", False, 2)


def test_all_that_is_installed_is_judged_and_removed_alone(robot: Robot) -> None:
    buf, stream = robot.buf, robot.buf.events()
    robot.put(0)
    first = buf.expect("odom", "base", deadline=0.5)
    robot.wait(0.7)
    second = buf.expect("odom", "arm", deadline=0.3)
    third = buf.expect("*", "base", max_step=1, lifespan=2)
    robot.put(1.0, child="arm")
    robot.put(1.1, child="arm")
    second.remove()
    second.remove()
    robot.put(1.6, x=5)
    robot.put(1.7, x=9)
    third.remove()
    robot.put(1.8, x=5)
    robot.wait(9)
    assert seen(stream) == [
        ("deadline", "warning", 0.5),
        ("deadline", "ok", 1.6),
        ("step", "error", 1.6),
        ("deadline", "warning", 2.3),
    ]
    assert (first.removed, second.removed, list(buf.expectations)) == (False, True, [first])
    (event,) = buf.expectations.active
    assert event.count == 2


def test_contradictions_are_refused(robot: Robot) -> None:
    buf = robot.buf
    kept = buf.expect("odom", "base", deadline=1)
    buf.expect(tfdb.Expectations((), [AuthorityExpectation("ekf", 1.0)], Expectation(deadline=3)))
    refused: list[tuple[Any, str]] = [
        (tfdb.Expectations([Expectation("odom", "base")]), "odom -> base has two expectations"),
        (tfdb.Expectations([Expectation("map", "base")]), "a frame has one parent"),
        (tfdb.Expectations(default=Expectation(max_step=1)), "have a default"),
        (tfdb.Expectations((), [AuthorityExpectation("ekf", 2.0)]), "ekf has two expectations"),
        (tfdb.Expectations(clock="arrival"), "clock is 'stamps' of some"),
    ]
    for given, text in refused:
        with pytest.raises(InvalidArgument, match=text):
            buf.expect(given)
    with pytest.raises(InvalidArgument, match="it must be positive"):
        buf.expect("odom", "arm", deadline=0)
    with pytest.raises(InvalidArgument, match="needs an authority; name one"):
        buf.expect("odom", "arm", liveliness=1)
    with pytest.raises(InvalidArgument, match="child is missing: pass parent and child"):
        buf.expect("odom")  # type: ignore[call-overload]
    with pytest.raises(InvalidArgument, match="deadline cannot be combined with an Exp"):
        buf.expect(tfdb.Expectations(), deadline=1)  # type: ignore[call-overload]
    with pytest.raises(TypeError, match="dedline"):
        buf.expect("odom", "arm", dedline=1)  # type: ignore[call-overload]
    assert len(buf.expectations) == 2
    kept.remove()
    with buf.expect("odom", "base", deadline=2) as again:
        assert list(buf.expectations)[1] is again


def test_a_callback_that_raises_stops_nothing(
    robot: Robot, caplog: pytest.LogCaptureFixture
) -> None:
    told: list[str] = []

    def fail(event: Event) -> None:
        told.append(event.kind)
        raise SystemExit("not this thread")

    robot.buf.expectations.on_event = fail
    robot.buf.expect("odom", "base", deadline=2, severity={"missing": "stale"})
    with caplog.at_level(logging.INFO, "tfdb.expectations"):
        robot.put(3)
        robot.wait(6)
    assert told == ["missing", "missing", "deadline"]
    lines = [r for r in caplog.records if r.exc_info is None]
    assert [r.levelname for r in lines] == ["ERROR", "INFO", "WARNING"]
    assert "stale: odom -> base: missing 2 s (limit 2 s)" in lines[0].getMessage()
    assert caplog.text.count("SystemExit: not this thread") == 3
    with pytest.raises(TypeError, match="on_event must be callable"):
        robot.buf.expectations.on_event = 3  # type: ignore[assignment]


def test_a_callback_may_expect_and_remove_but_not_drain(robot: Robot) -> None:
    buf, errors = robot.buf, list[str]()
    first = buf.expect("odom", "base", deadline=1)

    def change(event: Event) -> None:
        if event.kind == "missing":
            first.remove()
            buf.expect("odom", "arm", deadline=5)
            try:
                buf.expectations.drain()
            except InvalidArgument as error:
                errors.append(str(error))

    buf.expectations.on_event = change
    robot.wait(1.5)
    robot.wait(2)
    assert errors == ["drain() cannot be called in on_event: it would wait for itself"]
    assert [repr(each) for each in buf.expectations] == ["<tfdb.judging.Installed: odom -> arm>"]


def test_a_reader_that_does_not_read_loses_the_oldest(
    robot: Robot, caplog: pytest.LogCaptureFixture
) -> None:
    slow, all_of_them = robot.buf.events(max_pending=3), robot.buf.events()
    robot.buf.expect("odom", "base", max_step=1)
    for second in range(0, 20, 2):
        robot.put(second, x=second)
    wanted = seen(all_of_them)
    assert len(wanted) == 17
    assert seen(slow) == wanted[-3:]
    assert slow.missed == 14
    assert caplog.text.count("a stream of events is not read: beyond 3") == 1
    with pytest.raises(InvalidArgument, match="max_pending must be an integer of at least 1"):
        robot.buf.events(max_pending=0)


def test_commits_that_are_missed_are_counted_and_the_rest_is_judged(robot: Robot) -> None:
    buf, stream = robot.buf, robot.buf.events()
    begun, over = threading.Event(), threading.Event()

    def block(_: Event) -> None:
        begun.set()
        over.wait()

    buf.expectations.on_event = block
    buf.expect("odom", "base", max_step=1, max_turn=1)
    robot.put(0)
    robot.now += S
    buf.set_transform("odom", "base", robot.now, (5, 0, 0))
    begun.wait()
    for i in range(20_000):
        buf.set_transform("odom", "base", robot.now + i, (i, 0, 0))
    over.set()
    robot.put(9, x=19_999)
    robot.put(10, x=0)
    assert buf.expectations.missed == 20_000
    assert seen(stream) == [
        ("step", "error", 1.0),
        ("step", "ok", 2.0),
        ("step", "error", 10.0),
    ]


def test_a_read_without_events_ends_after_its_timeout() -> None:
    with tfdb.Buffer() as buf, buf.events() as stream:
        buf.expect("odom", "base", max_step=1)
        begin = time.monotonic()
        assert stream.read_next(timeout=0.05) is None
        assert time.monotonic() - begin >= 0.05
        assert stream.read_next() is None


def test_events_are_of_the_package_that_users_import() -> None:
    code = """
import tfdb
buf = tfdb.Buffer()
buf.expect("odom", "base", max_step=1)
with buf.events() as stream:
    for stamp, x in ((1_000_000_000, 0.0), (1_100_000_000, 5.0)):
        buf.set_transform("odom", "base", stamp, (x, 0, 0))
    print(type(stream.read_next(timeout=60)).__module__)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "tfdb.judging\n"


def test_streams_end_with_their_buffer(name: str) -> None:
    buf = tfdb.Buffer()
    idle, stream = buf.events(), buf.events()
    buf.expect("odom", "base", max_step=1)
    closer = threading.Timer(0, buf.close)
    closer.start()
    with pytest.raises(BufferClosed):
        stream.read_next(timeout=None)
    with pytest.raises(BufferClosed):
        idle.read_next(timeout=None)
    with pytest.raises(BufferClosed):
        buf.events()
    with pytest.raises(BufferClosed):
        buf.expect("odom", "base", max_step=1)
    with pytest.raises(BufferClosed):
        buf.expectations.drain()
    stream.close()
    with pytest.raises(StreamClosed):
        stream.read_next()
    assert list(stream) == []

    shared = tfdb.Buffer.open(name)
    stream, installed = shared.events(), shared.expect("odom", "base", deadline=1e6)
    tfdb.Buffer.unlink(name)
    with pytest.raises(NoSuchStore):
        stream.read_next(timeout=None)
    assert installed.removed
    with pytest.raises(NoSuchStore):
        shared.expectations.drain()


def test_a_stream_of_a_buffer_without_expectations_ends() -> None:
    buf = tfdb.Buffer()
    stream = buf.events()
    threading.Timer(0, buf.close).start()
    with pytest.raises(BufferClosed):
        next(stream)


def test_events_can_be_read_after_the_end(robot: Robot) -> None:
    stream = robot.buf.events()
    robot.buf.expect("odom", "base", deadline=2)
    robot.wait(3)
    robot.buf.close()
    assert next(stream).kind == "missing"
    with pytest.raises(BufferClosed):
        next(stream)


def test_an_asynchronous_reader_is_woken(robot: Robot) -> None:
    async def read() -> list[str]:
        kinds: list[str] = []
        async with asyncio.timeout(60):
            stream = robot.buf.events()
            writer = asyncio.get_running_loop().run_in_executor(None, robot.put, 1.5)
            async for event in stream:
                kinds.append(event.kind)
                if len(kinds) == 2:
                    stream.close()
            await writer
        return kinds

    robot.buf.expect("odom", "base", deadline=0.5)
    assert asyncio.run(read()) == ["missing", "missing"]


def test_a_child_of_fork_has_none(robot: Robot) -> None:
    stream = robot.buf.events()
    installed = robot.buf.expect("odom", "base", deadline=2)
    pid = os.fork()
    if pid == 0:
        ok = stream.closed and installed.removed and len(robot.buf.expectations) == 0
        os._exit(0 if ok else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0
    robot.wait(3)
    assert [kind for kind, _, _ in seen(stream)] == ["missing"]


def test_a_thousand_come_and_go_under_load() -> None:
    with tfdb.Buffer() as buf:
        over = threading.Event()

        def write() -> None:
            for number in count():
                if over.wait(0.0005):
                    return
                buf.set_transform("odom", "base", time.time_ns(), (number % 2, 0, 0))

        writer = threading.Thread(target=write)
        writer.start()
        events = list[Event]()
        buf.expectations.on_event = events.append
        try:
            for number in range(1000):
                with buf.expect("odom", "base", max_step=0.5 + number % 2):
                    pass
            with buf.events() as stream, buf.expect("odom", "base", max_step=0.5):
                assert stream.read_next(timeout=60) is not None
        finally:
            over.set()
            writer.join()
        assert buf.expectations.drain(60)
        # A thread that gets no processor for a second sees the stamps catch up: a jump.
        assert {event.kind for event in events} <= {"step", "time-jump"}
        assert len(buf.expectations) == 0
        threads = [each for each in threading.enumerate() if each.name == "tfdb expectations"]
        for each in threads:
            each.join(60)
            assert not each.is_alive()


def test_a_clock_that_raises_ends_the_judgement_not_the_buffer(
    caplog: pytest.LogCaptureFixture,
) -> None:
    broken = False

    def clock() -> int:
        if broken:
            raise ValueError("no time")
        return START

    with tfdb.Buffer(clock=clock) as buf, buf.events() as stream:
        buf.expect("odom", "base", deadline=1)
        broken = True
        with pytest.raises(ValueError, match="no time"):
            stream.read_next(timeout=60)
        assert "the expectations of a buffer have ended" in caplog.text
        with pytest.raises(ValueError, match="no time"):
            buf.expectations.drain(60)
        broken = False
        with buf.expect("odom", "base", deadline=1):
            assert buf.expectations.drain(60)


def test_a_clock_that_waits_for_another_thread_blocks_no_call_of_that_thread() -> None:
    """No lock is held while the clock of a user is asked."""
    asked, go_on = threading.Event(), threading.Event()
    went_on: list[bool] = []

    def clock() -> int:
        if threading.current_thread().name == "tfdb expectations":
            asked.set()
            went_on.append(go_on.wait(60))
        return START

    buf = tfdb.Buffer(clock=clock)
    with buf.expect("odom", "base", deadline=0.5) as installed:
        assert asked.wait(60)
        with buf.events(), buf.expect("odom", "arm"):
            assert buf.expectations.active == []
        go_on.set()
        assert buf.expectations.drain(60)
    assert installed.removed
    assert all(went_on)


def test_an_engine_without_a_feed_is_refused() -> None:
    with pytest.raises(NotSupported):
        tfdb.Buffer(concurrency="silo").expect("odom", "base", deadline=1)


def test_a_sample_between_two_looks_meets_a_deadline_in_doubt() -> None:
    now, store = START, tfdb.Buffer()
    store.set_transform("odom", "base", now, (0, 0, 0))
    expected = tfdb.Expectations([Expectation("odom", "base", deadline=0.05)])
    judge = LiveJudge(Live(store, lambda: now), Judge(expected, now))

    def look(later: float, *, is_stored: bool = True) -> list[bool]:
        nonlocal now
        now += round(later * S)
        if is_stored:
            store.set_transform("odom", "base", now, (0, 0, 0))
        return [event.begins for event in judge.take(judge.read(0.0))]

    assert look(0.06) == []
    assert look(0.045, is_stored=False) == []  # the sample may have come just now
    assert look(0.045) == []
    assert look(0.6) == [True, False]  # more than 0.5 s after the deadline
    assert look(0.051, is_stored=False) == [True]


class Noted:
    """A store in which nothing comes; it notes until when each wait would last."""

    def __init__(self, *, is_system: bool) -> None:
        self.store, self.commit, self.shown = tfdb.Buffer(), 0, START
        self.clock: Any = SimpleNamespace(
            is_system=is_system, paused=False, speed=1.0, now=lambda: self.shown
        )
        self.now = self.clock.now
        self.waits: list[float] = []

    def wait(self, until: float) -> bool:
        self.waits.append(until)
        return False

    def sleep(self, until: float) -> None:
        raise AssertionError(f"nothing came, so there is no rest until {until}")


@pytest.mark.parametrize(
    ("is_system", "left", "waited"),
    [(True, 0.4, 0.4001), (True, -3.0, 0.0001), (True, 30.0, 1.0), (False, 0.4, 0.1)],
)
def test_a_judge_waits_until_something_is_due(
    monkeypatch: pytest.MonkeyPatch, is_system: bool, left: float, waited: float
) -> None:
    """But no longer than a second, as the clock may be set; and 0.1 s by another clock."""
    now = SimpleNamespace(monotonic=lambda: 100.0, monotonic_ns=lambda: 100 * S)
    monkeypatch.setattr("tfdb.judging.live.time", now)
    live = Noted(is_system=is_system)
    expected = tfdb.Expectations([Expectation("odom", "base", deadline=60)])
    judge = LiveJudge(live, Judge(expected, START))
    live.shown = START + 60 * S - round(left * S)
    assert judge.read() == judge.read(100.00005) == []
    assert live.waits == [pytest.approx(100 + waited), 100.00005]


def test_a_look_that_is_late_goes_by_the_stamps() -> None:
    """The thread had no processor for three seconds: only one edge was silent meanwhile."""
    now, store = START, tfdb.Buffer()
    edges = [Expectation("odom", each, deadline=0.5, lifespan=0.7) for each in ("base", "arm")]
    for each in edges:
        store.set_transform("odom", each.child, now - S // 10, (0, 0, 0))
    judge = LiveJudge(Live(store, lambda: now), Judge(tfdb.Expectations(edges), now))
    for tick in range(1, 31):
        stamp = START + tick * S // 10
        store.set_transform("odom", "base", stamp - S // 10, (0, 0, 0))
        if not 8 <= tick < 20:
            store.set_transform("odom", "arm", stamp - S // 10, (0, 0, 0))
    now = stamp
    events = judge.take(judge.read(0.0))
    assert [(e.kind, e.child, (e.time - START) / S) for e in events] == [
        ("deadline", "arm", 1.2),
        ("lifespan", "arm", 1.3),
        ("lifespan", "arm", 1.9),
        ("deadline", "arm", 1.9),
    ]
    now += S // 2
    assert judge.take([]) == []
    now += S
    assert {event.child for event in judge.take([])} == {"base", "arm"}


class Played:
    """A buffer whose own clock is paused, and set by steps. Each is judged before the next one."""

    def __init__(self) -> None:
        self.buf = tfdb.Buffer()
        self.buf.clock.pause()
        self.buf.clock.seek(START)
        self.put()
        self.stream = self.buf.events()
        self.buf.expect(tfdb.Expectations(default=Expectation(deadline=0.5, lifespan=0.7)))

    def put(self) -> None:
        now = self.buf.clock.now()
        for child in ("base", "arm", "mast"):
            self.buf.set_transform("odom", child, now, (0, 0, 0))

    def show(self, at: float) -> list[tuple[str, str, float]]:
        self.buf.clock.seek(START + round(at * S))
        assert self.buf.expectations.drain(60)
        return seen(self.stream)


def test_a_paused_clock_lets_nothing_grow_old() -> None:
    played = Played()
    assert not played.buf.clock.sleep(1, timeout=0.8)
    assert played.show(0.5) == []
    assert played.show(0.6) == [("deadline", "warning", 0.5)] * 3
    assert played.show(0.71) == [("lifespan", "stale", 0.7)] * 3


@pytest.mark.parametrize("to", [90.0, -90.0])
def test_a_clock_that_is_set_is_one_jump(to: float) -> None:
    played = Played()
    assert played.show(0.4) == []
    assert played.show(to) == [("time-jump", "error", to)]
    assert played.show(to + 0.1) == []
    played.buf.clear()
    played.put()
    assert played.show(to + 0.1) == []
    assert played.show(to + 0.5) == []
    assert played.show(to + 0.7) == [("deadline", "warning", to + 0.6)] * 3


def test_samples_from_before_a_jump_ahead_are_judged_as_of_then() -> None:
    """The jump is found before the last samples are read."""
    events = list[Event]()
    blocked, over = threading.Event(), threading.Event()

    def block(event: Event) -> None:
        events.append(event)
        blocked.set()
        over.wait()

    with tfdb.Buffer() as buf:
        buf.clock.seek(START)
        buf.expectations.on_event = block
        buf.expect("odom", "base", max_step=1, deadline=20, lifespan=20)
        for x in (0, 5, 5.5):
            buf.set_transform("odom", "base", buf.clock.now(), (x, 0, 0))
            if x == 5:
                assert blocked.wait(60)
        buf.clock.sleep(0.5)  # longer than the slowest read: by its stamp, the last sample is older
        buf.clock.seek(START + 90 * S)
        over.set()
        assert buf.expectations.drain(60)
        assert [event.kind for event in events] == ["step", "time-jump"]


def test_samples_from_behind_a_jump_ahead_arrive_now() -> None:
    """However old their stamps are: time does not go back for them."""
    now, store = START, tfdb.Buffer()
    for child in ("base", "arm"):
        store.set_transform("odom", child, now, (0, 0, 0))
    expected = tfdb.Expectations(default=Expectation(deadline=10))
    judge = LiveJudge(Live(store, lambda: now), Judge(expected, now))
    now += 90 * S
    store.set_transform("odom", "base", now - 5 * S, (0, 0, 0))
    (jump,) = judge.take(judge.read(0.0), (now, 90 * S))
    assert (jump.kind, jump.time, jump.value) == ("time-jump", now, 90.0)
    now += 11 * S
    missed = [event for event in judge.take([]) if event.kind == "deadline"]
    assert {each.child: each.time - now for each in missed} == {"base": -S, "arm": -S}


def test_a_history_that_replaces_another_did_not_arrive() -> None:
    """A copy that begins anew, as at each jump of a player, has only newest samples."""
    source, copy = tfdb.Buffer(history=None), tfdb.Buffer(history=None)
    for tick in range(50):
        source.set_transform("odom", "base", START + tick * S // 10, (9 * (tick % 2), 0, 0))
    source.set_transform("odom", "slow", START, (1, 2, 3))
    source.set_static_transform("base", "camera", (1, 2, 3))
    copy.apply(source.commits_bytes(0))
    copy.clock.pause()
    copy.clock.seek(START + 5 * S)
    stream = copy.events()
    copy.expect("odom", "base", max_step=1, lifespan=1, max_late=1)
    source.set_transform("odom", "base", START + 5 * S, (0, 0, 0))
    for _ in range(2):
        with source.snapshot() as state:
            copy.apply(state.state_bytes())
        assert copy.expectations.drain(60)
    source.set_transform("odom", "slow", START + 5 * S, (1, 2, 3))
    copy.apply(source.commits_bytes(source.commit - 1))
    assert copy.expectations.drain(60)
    assert seen(stream) == []
    copy.close()


def test_a_late_expectation_waits_from_then_on() -> None:
    now, store = START, tfdb.Buffer()
    store.set_transform("odom", "base", now, (0, 0, 0))
    judge = LiveJudge(Live(store, lambda: now), Judge(tfdb.Expectations(), now))
    now += 9 * S
    store.set_transform("odom", "base", now, (0, 0, 0))  # it is not read before the change
    edges = [Expectation("odom", "base", deadline=0.5), Expectation("odom", "arm")]
    judge.change(tfdb.Expectations(edges), now)
    assert judge.take(judge.read(0.0)) == []
    now += S + 1
    assert [event.kind for event in judge.take([])] == ["deadline", "missing"]
    assert [event.time - START for event in judge.judge.active.values()] == [9 * S + S // 2, 10 * S]


@pytest.mark.parametrize("seed", range(20))
def test_an_expectation_that_stays_goes_on_when_others_change(seed: int) -> None:
    print(f"seed {seed}")
    rng = np.random.default_rng(seed)
    expected, rows = random_expectations(rng), random_rows(rng, 400)
    extra = [*expected.edges, Expectation("nowhere", "new", deadline=1, severity={"missing": "ok"})]
    more = dataclasses.replace(expected, edges=extra)
    end = rows[-1].arrival + 5 * S
    judge, other = Judge(expected, START), Judge(expected, START)
    wanted = judge.feed(rows_of(judge, rows)) + judge.advance(end)
    found: list[Event] = []
    for at in range(0, len(rows), 50):
        found += other.feed(rows_of(other, rows[at : at + 50]))
        last = rows[min(at + 49, len(rows) - 1)].arrival
        other.change(more if at % 100 else expected, last)
    found += other.advance(end)
    assert told(other, [e for e in found if e.child != "new"]) == told(judge, wanted)


@pytest.mark.parametrize("seed", range(20))
def test_a_look_at_each_time_that_is_due_finds_every_event(seed: int) -> None:
    print(f"seed {seed}")
    rng = np.random.default_rng(seed)
    judge, rows = Judge(random_expectations(rng), START), random_rows(rng, 100)
    for each in rows:
        while (due := judge.next_due()) is not None and due < each.arrival:
            assert judge.advance(due) == []
            events = judge.advance(due + 1)
            assert events
            assert {event.time for event in events} == {due}
        judge.feed(rows_of(judge, [each]))


def test_a_deadline_is_missed_by_a_clock_that_runs_fast() -> None:
    buf = tfdb.Buffer()
    buf.clock.seek(1000 * S)
    buf.clock.speed = 10.0
    with buf.events() as events, buf.expect("odom", "base", deadline=0.2):
        for _ in range(50):
            buf.set_transform("odom", "base", buf.clock.now(), (0, 0, 0), (0, 0, 0, 1))
            buf.clock.sleep(0.4)
        buf.expectations.drain()
        kinds = [each.kind for each in iter(events.read_next, None) if not each.begins]
    assert "deadline" in kinds

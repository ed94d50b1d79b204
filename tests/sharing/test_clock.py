"""A store has one clock for all processes that have it open."""

from __future__ import annotations

import signal
import time
from typing import TYPE_CHECKING

import pytest

import tfdb
from tests.another_thread import Call
from tfdb import errors

from .all_reads import TURN
from .child import Child

if TYPE_CHECKING:
    from pathlib import Path

SECOND = 10**9
THEN = 1_000 * SECOND


def set_to(buf: tfdb.Buffer, stamp: int) -> tfdb.Clock:
    """Let the clock stand still at a time."""
    clock = buf.clock
    clock.pause()
    clock.seek(stamp)
    return clock


def test_the_clock_shows_the_systems_time_until_it_is_set() -> None:
    clock = tfdb.Buffer().clock
    before = time.time_ns()
    assert before <= clock.now() <= time.time_ns()
    assert clock.is_system
    assert not clock.paused
    assert clock.speed == 1.0
    assert repr(clock) == "<tfdb.Clock of the system>"
    clock.pause()
    assert not clock.is_system
    assert before <= clock.now() == clock.now()
    clock.follow_system()
    assert clock.is_system


def test_all_processes_see_one_clock(name: str) -> None:
    here, there = tfdb.Buffer.open(name), tfdb.Buffer.open(name, mode="r")
    clock = set_to(here, THEN)
    assert there.clock.now() == THEN
    assert repr(there.clock) == f"<tfdb.Clock, paused at {THEN}>"
    clock.speed = 3.0
    assert there.clock.speed == 3.0
    with pytest.raises(errors.ReadOnly):
        there.clock.seek(5)
    with Child("sleep_until", name, THEN + SECOND) as sleeper:
        assert sleeper.says() == "sleeps"
        sleeper.wait_until_asleep()
        clock.seek(THEN + SECOND)
        assert sleeper.says() == f"woke {THEN + SECOND}"


def test_a_sleep_follows_the_speed() -> None:
    """An hour of the clock passes at once."""
    clock = set_to(tfdb.Buffer(), THEN)
    sleep = Call(lambda: clock.sleep(3600.0))
    clock.speed = 1e9
    clock.resume()
    assert sleep.result() is True
    assert clock.now() >= THEN + 3600 * SECOND


def test_the_timeout_of_a_sleep_is_of_real_time() -> None:
    clock = set_to(tfdb.Buffer(), THEN)
    assert clock.sleep_until(THEN) is True
    assert clock.sleep_until(THEN + 1, timeout=0) is False
    assert clock.sleep(5.0, timeout=0.01) is False


def test_closing_ends_sleeps() -> None:
    buf = tfdb.Buffer()
    clock = set_to(buf, THEN)
    sleep = Call(lambda: clock.sleep_until(THEN + 1))
    buf.close()
    with pytest.raises(errors.BufferClosed):
        sleep.result()
    with pytest.raises(errors.BufferClosed):
        clock.now()


def test_the_removal_of_the_store_ends_sleeps(name: str) -> None:
    clock = set_to(tfdb.Buffer.open(name), THEN)
    with Child("sleep_until", name, THEN + 1) as sleeper:
        assert sleeper.says() == "sleeps"
        sleeper.wait_until_asleep()
        tfdb.Buffer.unlink(name)
        assert sleeper.end() == 1
    assert clock.now() == THEN


def test_a_signal_ends_a_sleep(name: str) -> None:
    set_to(tfdb.Buffer.open(name), THEN)
    with Child("sleep_until", name, THEN + 1) as sleeper:
        assert sleeper.says() == "sleeps"
        sleeper.wait_until_asleep()
        sleeper.send(signal.SIGINT)
        assert sleeper.end() != 0


def test_a_death_while_the_clock_is_set_leaves_a_whole_setting(name: str) -> None:
    buf = tfdb.Buffer.open(name)
    set_to(buf, THEN)
    before = {THEN}
    for _ in range(10):
        with Child("set_clock", name) as setter:
            assert setter.says() == "sets"
            for _ in range(200):
                shown = buf.clock.now()
                assert len(set(str(shown))) == 1 or shown in before
            setter.send(signal.SIGKILL)
            setter.end()
        set_to(buf, THEN)
        assert buf.clock.now() == THEN


def test_the_age_of_lookups_goes_by_the_clock() -> None:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", THEN, (1, 2, 3), TURN)
    with pytest.raises(errors.Stale):
        buf.lookup_latest_transform("map", "base", max_age=1.0)
    set_to(buf, THEN + SECOND // 2)
    assert buf.lookup_latest_transform("map", "base", max_age=1.0).stamp == THEN
    buf.clock.seek(THEN + 2 * SECOND)
    with buf.snapshot() as state, pytest.raises(errors.Stale):
        state.lookup_latest_transform("map", "base", max_age=1.0)
    given = tfdb.Buffer(clock=lambda: THEN)
    given.set_transform("map", "base", THEN, (1, 2, 3), TURN)
    assert given.lookup_latest_transform("map", "base", max_age=1.0).stamp == THEN


@pytest.mark.parametrize("bad", [-1, 2**61, 2**70])
def test_a_clock_shows_stamps_only(bad: int) -> None:
    clock = set_to(tfdb.Buffer(), THEN)
    with pytest.raises(errors.InvalidStamp):
        clock.seek(bad)
    with pytest.raises(errors.InvalidStamp):
        clock.sleep_until(bad)
    assert clock.now() == THEN


@pytest.mark.parametrize("bad", [0.0, -1.0, float("inf"), float("nan")])
def test_a_clock_runs_forward(bad: float) -> None:
    clock = set_to(tfdb.Buffer(), THEN)
    with pytest.raises(errors.InvalidArgument, match="speed of a clock"):
        clock.speed = bad
    assert clock.speed == 1.0


def test_a_frozen_store_has_the_systems_clock(tmp_path: Path) -> None:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", THEN, (1, 2, 3), TURN)
    set_to(buf, THEN)
    buf.freeze(tmp_path / "a.tfdb")
    frozen = tfdb.open(tmp_path / "a.tfdb")
    assert frozen.clock.is_system
    with pytest.raises(errors.ReadOnly):
        frozen.clock.pause()


def test_a_clock_is_not_made_by_hand() -> None:
    with pytest.raises(TypeError, match=r"Buffer\.clock makes clocks"):
        tfdb.Clock()  # type: ignore[call-arg]

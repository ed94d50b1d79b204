"""tf2's Buffer: its waits in threads, coroutines and callbacks, by each clock; named stores."""

from __future__ import annotations

import asyncio
import concurrent.futures
import math
import os
import random
import struct
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import pytest

import tfdb
from tf2.loopback import LoopbackNode
from tf2.ours import message, plain
from tfdb import tf2
from tfdb.tf2 import msgs
from tfdb.tf2.received_messages import BufferWriter
from tfdb.tf2.transformable_requests import NEVER

if TYPE_CHECKING:
    from collections.abc import Iterator

SECOND = 1_000_000_000
POSE = [1.0, 2.0, 3.0, 0.0, 0.6, 0.0, 0.8]
FOREVER = 60.0
"""Seconds that nothing here takes: a wait that is never woken ends by it, and fails."""


def seconds(count: float) -> msgs.Time:
    return msgs.Time.from_nanoseconds(round(count * SECOND))


def store(buffer: tf2.BufferCore, stamp: float, parent: str = "map", child: str = "base") -> None:
    buffer.set_transform(message(parent, child, round(stamp * SECOND), POSE), "test")


@pytest.fixture
def buffer() -> Iterator[tf2.Buffer]:
    with tf2.Buffer(flavor="ros2") as made:
        store(made, 1)
        yield made


@pytest.fixture
def thread() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as made:
        yield made


# Waits in threads

WAYS: dict[str, Callable[[tf2.Buffer, Any], Any]] = {
    "lookup": lambda b, t: b.lookup_transform("map", "base", seconds(2), t),
    "lookup_full": lambda b, t: b.lookup_transform_full(
        "map", seconds(1), "base", seconds(2), "map", timeout=t
    ),
    "wait": lambda b, t: b.wait_for_transform("map", "base", seconds(2), t),
    "can": lambda b, t: b.can_transform("map", "base", seconds(2), t),
    "can_full": lambda b, t: b.can_transform_full(
        "map", seconds(2), "base", seconds(2), "map", t, return_debug_tuple=True
    ),
}
TIMEOUTS: dict[str, Any] = {
    "ours": msgs.Duration(60),
    "float": 60.0,
    "integer": 60,
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("timeout", TIMEOUTS)
def test_a_wait_is_ended_by_the_transform(
    buffer: tf2.Buffer, thread: ThreadPoolExecutor, way: str, timeout: str
) -> None:
    waits = thread.submit(WAYS[way], buffer, TIMEOUTS[timeout])
    store(buffer, 2)
    found = waits.result(FOREVER)
    if way.startswith("can"):
        assert found in (1, (1, ""))
    else:
        assert plain(found)[3] == pytest.approx(POSE)


@pytest.mark.parametrize("way", WAYS)
def test_a_timeout_raises_the_error_of_a_lookup(buffer: tf2.Buffer, way: str) -> None:
    if way == "can":
        assert WAYS[way](buffer, 0.001) == 0
    elif way == "can_full":
        possible, why = WAYS[way](buffer, 0.001)
        assert not possible
        assert "but only time 1.000000 is in the buffer" in why
    elif way == "wait":
        with pytest.raises(tf2.TimeoutException, match="Timed out waiting for transform") as ended:
            WAYS[way](buffer, 0.001)
        assert isinstance(ended.value.__cause__, tf2.ExtrapolationException)
        assert (ended.value.target, ended.value.source) == ("map", "base")
        assert ended.value.stamp == 2 * SECOND
    else:
        with pytest.raises(tf2.ExtrapolationException, match="but only time 1"):
            WAYS[way](buffer, 0.001)


def test_frames_that_come_later_end_a_wait(buffer: tf2.Buffer, thread: ThreadPoolExecutor) -> None:
    waits = thread.submit(buffer.lookup_transform, "odom", "tool", seconds(1), FOREVER)
    store(buffer, 1, "odom", "map")
    store(buffer, 1, "arm", "tool")
    store(buffer, 1, "base", "arm")
    assert waits.result(FOREVER).child_frame_id == "tool"


@pytest.mark.parametrize("name", ["a\0b", "x" * 1025])
def test_a_name_that_no_frame_can_have_is_not_waited_for(buffer: tf2.Buffer, name: str) -> None:
    asked = ("map", name, seconds(2))
    full = ("map", seconds(1), "base", seconds(1), name, FOREVER)
    for wait in (
        lambda: buffer.lookup_transform(*asked, FOREVER),
        lambda: buffer.lookup_transform_full(*full),
    ):
        with pytest.raises(tf2.LookupException, match="does not exist"):
            wait()
    assert not buffer.can_transform(*asked, FOREVER)
    assert not buffer.can_transform_full(*full)
    for ask in (
        lambda: buffer.wait_for_transform(*asked),
        lambda: buffer.wait_for_transform_async(*asked).result(0),
        lambda: asyncio.run(buffer.lookup_transform_async(*asked)),
        lambda: buffer.add_transformable_request(print, *asked),
    ):
        with pytest.raises(tf2.InvalidArgumentException, match="can never succeed"):
            ask()


def test_a_timeout_names_the_missing_data_and_the_waited_time(buffer: tf2.Buffer) -> None:
    cases = (
        (("map", "base", seconds(3)), "base to map at 3.000000000 s", "extrapolation"),
        (("map", "bsae", seconds(0)), "bsae to map at any common time", "bsae"),
    )
    for asked, named, missing in cases:
        for wait in (
            lambda asked=asked: buffer.wait_for_transform(*asked, 0.01),
            lambda asked=asked: buffer.wait_for_transform_async(*asked, 0.01).result(FOREVER),
            lambda asked=asked: asyncio.run(buffer.lookup_transform_async(*asked, 0.01)),
        ):
            with pytest.raises(tf2.TimeoutException) as caught:
                wait()
            text = str(caught.value)
            assert text.startswith(f"Timed out waiting for transform from {named}; waited ")
            assert missing in text
            assert text.endswith("; check that its publishers run, or wait longer")
            error = caught.value
            assert (error.target, error.source) == asked[:2]
            assert (error.stamp, error.limit) == (asked[2].nanoseconds, SECOND // 100)


def test_the_end_of_its_node_ends_the_waits_of_a_buffer(thread: ThreadPoolExecutor) -> None:
    node = LoopbackNode()
    buffer = tf2.Buffer(flavor="ros2", clock=node)
    waits = thread.submit(buffer.buffer.wait_for_transform, "map", "base")
    future = buffer.wait_for_transform_async("map", "base", seconds(0))
    node.close()
    with pytest.raises(tfdb.UnknownFrame, match="then its node was shut down"):
        waits.result(FOREVER)
    with pytest.raises(tf2.LookupException):
        future.result(FOREVER)
    assert not buffer.can_transform("map", "base", seconds(0), FOREVER)
    listening = LoopbackNode()  # a node that fills the buffer lets it wait again
    tf2.TransformListener(buffer, listening)
    waits = thread.submit(buffer.lookup_transform, "map", "base", seconds(0), FOREVER)
    store(buffer, 1)
    assert waits.result(FOREVER).child_frame_id == "base"


@pytest.mark.parametrize("name", ["", "/base"])
def test_a_name_that_is_never_right_is_not_waited_for(buffer: tf2.Buffer, name: str) -> None:
    with pytest.raises(tf2.InvalidArgumentException):
        buffer.lookup_transform("map", name, seconds(2), FOREVER)


def test_can_transform_does_not_wait_for_an_empty_name(buffer: tf2.Buffer) -> None:
    possible, why = buffer.can_transform("map", "", seconds(2), FOREVER, return_debug_tuple=True)
    assert not possible
    assert "cannot be empty" in why


def test_a_stamp_that_no_transform_has_is_not_waited_for(buffer: tf2.Buffer) -> None:
    with pytest.raises(tf2.ExtrapolationException):
        buffer.lookup_transform("map", "base", -SECOND, FOREVER)
    assert not buffer.can_transform("map", "base", 2**62, FOREVER)


def test_invalid_timeouts_are_refused(buffer: tf2.Buffer) -> None:
    with pytest.raises(TypeError, match="timeout must have sec and nanosec"):
        buffer.lookup_transform("map", "base", seconds(2), "soon")  # type: ignore[arg-type]
    with pytest.raises(tfdb.InvalidArgument):
        buffer.lookup_transform("map", "base", seconds(2), math.nan)


def test_close_ends_a_wait(buffer: tf2.Buffer, thread: ThreadPoolExecutor) -> None:
    for way in WAYS.values():
        with tf2.Buffer(flavor="ros2") as closing:
            store(closing, 1)
            began = threading.Event()

            def wait(way: Any = way, closing: Any = closing, began: Any = began) -> Any:
                began.set()
                return way(closing, FOREVER)

            waits = thread.submit(wait)
            began.wait()
            closing.close()
            with pytest.raises(tfdb.errors.BufferClosed):
                waits.result(FOREVER)


# A clock that is named


def simulated(now: float) -> tuple[LoopbackNode, tf2.Buffer]:
    clock = LoopbackNode()
    clock.set_time(round(now * SECOND))
    buffer = tf2.Buffer(flavor="ros1", clock=clock)
    store(buffer, 1)
    return clock, buffer


def until_it_waits(clock: LoopbackNode) -> None:
    """Until somebody has an eye on the clock."""
    while len(clock.watches) < 2:  # one is for the node's end
        os.sched_yield()


def test_a_wait_ends_by_the_clock_that_is_named(thread: ThreadPoolExecutor) -> None:
    clock, buffer = simulated(100)
    waits = thread.submit(buffer.lookup_transform, "map", "base", seconds(2), 5.0)
    until_it_waits(clock)
    clock.set_time(104 * SECOND)
    assert not waits.done()
    clock.set_time(98 * SECOND)  # a jump back of less than 3 s
    assert not waits.done()
    clock.set_time(105 * SECOND)
    with pytest.raises(tf2.ExtrapolationException):
        waits.result(FOREVER)
    assert len(clock.watches) == 1


@pytest.mark.parametrize("end", ["bag begins anew", "node ends"])
def test_a_wait_ends_when_the_clock_does(thread: ThreadPoolExecutor, end: str) -> None:
    clock, buffer = simulated(100)
    waits = thread.submit(buffer.can_transform, "map", "base", seconds(2), 5.0)
    until_it_waits(clock)
    if end == "node ends":
        clock.close()
    else:
        clock.set_time(97 * SECOND - 1)
    assert waits.result(FOREVER) == 0
    assert len(clock.watches) == 1


def test_the_transform_ends_a_wait_while_the_clock_stands(thread: ThreadPoolExecutor) -> None:
    clock, buffer = simulated(100)
    waits = thread.submit(buffer.lookup_transform, "map", "base", seconds(2), 5.0)
    until_it_waits(clock)
    store(buffer, 2)
    assert plain(waits.result(FOREVER))[2] == 2 * SECOND
    assert len(clock.watches) == 1


def test_close_ends_a_wait_while_the_clock_stands(thread: ThreadPoolExecutor) -> None:
    clock, buffer = simulated(100)
    waits = thread.submit(buffer.lookup_transform, "map", "base", seconds(2), 5.0)
    until_it_waits(clock)
    buffer.close()
    with pytest.raises(tfdb.errors.BufferClosed):
        waits.result(FOREVER)


def test_a_wait_of_ros_2_ends_by_the_wall_clock() -> None:
    """As upstream: also where simulated time stands still."""
    clock = LoopbackNode()
    clock.set_time(100 * SECOND)
    buffer = tf2.Buffer(flavor="ros2", clock=clock)
    store(buffer, 1)
    with pytest.raises(tf2.ExtrapolationException):
        buffer.lookup_transform("map", "base", seconds(2), 0.001)
    asked = ("map", seconds(1), "base", seconds(2), "map", 0.001)
    with pytest.raises(tf2.ExtrapolationException):
        buffer.lookup_transform_full(*asked)
    assert not buffer.can_transform("map", "base", seconds(2), 0.001)
    assert not buffer.can_transform_full(*asked)
    with pytest.raises(tf2.TimeoutException):
        buffer.wait_for_transform("map", "base", seconds(2), 0.001)
    assert len(clock.watches) == 1


def test_a_future_ends_by_the_clock_that_is_named() -> None:
    clock, buffer = simulated(100)
    future = buffer.wait_for_transform_async("map", "base", seconds(2), 5.0)
    clock.set_time(105 * SECOND)
    with pytest.raises(tf2.TimeoutException):
        future.result(FOREVER)


# Futures and coroutines


def test_coroutines_are_woken(buffer: tf2.Buffer) -> None:
    async def main() -> Any:
        simple = asyncio.create_task(
            buffer.lookup_transform_async("map", "base", seconds(2), FOREVER)
        )
        full = asyncio.create_task(
            buffer.lookup_transform_full_async("map", seconds(1), "base", seconds(2), "map")
        )
        await asyncio.sleep(0)
        store(buffer, 2)
        return await asyncio.gather(simple, full)

    for found in asyncio.run(main()):
        assert plain(found)[3] == pytest.approx(POSE)


def test_a_coroutine_times_out(buffer: tf2.Buffer) -> None:
    with pytest.raises(tf2.TimeoutException) as ended:
        asyncio.run(buffer.lookup_transform_async("map", "base", seconds(2), 0.001))
    assert ended.value.limit == SECOND // 1000


def test_a_cancelled_coroutine_leaves_nothing(buffer: tf2.Buffer) -> None:
    async def main() -> None:
        task = asyncio.create_task(buffer.lookup_transform_async("map", "base", seconds(2)))
        await asyncio.sleep(0)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(main())
    # The reporting thread ends after the last wait; its table is empty before.
    tellers = tfdb.store.waiting._tellers.values()
    assert all(not teller.waits for teller in tellers if teller.buffer is buffer.buffer)


def test_a_future_of_threads(buffer: tf2.Buffer) -> None:
    future = buffer.wait_for_transform_async("map", "base", seconds(2))
    assert isinstance(future, concurrent.futures.Future)
    told = threading.Event()
    future.add_done_callback(lambda _: told.set())
    for look in (future.result, future.exception):
        with pytest.raises(concurrent.futures.InvalidStateError, match="is not available yet"):
            look()
        with pytest.raises(TimeoutError):
            look(0)
    store(buffer, 2)
    assert told.is_set()
    assert plain(future.result())[2:] == [2 * SECOND, pytest.approx(POSE)]
    assert future.exception() is None
    at_once = buffer.wait_for_transform_async("map", "base", seconds(2))
    assert plain(at_once.result())[3] == pytest.approx(POSE)
    full = buffer.wait_for_transform_full_async("map", seconds(1), "base", seconds(2), "map")
    assert plain(full.result()) == ["map", "base", SECOND, pytest.approx(POSE)]


Write = Callable[[tf2.Buffer, int], object]


def store_bytes(buffer: tf2.Buffer, stamp: int) -> None:
    """As a listener does with a message."""
    node = LoopbackNode()
    data = tfdb.encode_tf_message([message("map", "base", stamp, POSE)], node.encoding)
    BufferWriter(buffer, node, static=False).store(data, "test")


WRITES: dict[str, Write] = {
    "set_transform": lambda b, stamp: b.set_transform(message("map", "base", stamp, POSE), "me"),
    "set_transform_static": lambda b, stamp: b.set_transform_static(
        message("map", f"fixed{stamp}", 0, POSE), "me"
    ),
    "bytes": store_bytes,
}


@pytest.mark.parametrize("way", WRITES)
def test_the_thread_that_stores_a_transform_settles_its_futures(
    buffer: tf2.Buffer, way: str
) -> None:
    """Though a thread of the buffer's waits for the same: done whenever the write returns."""
    for stamp in range(2 * SECOND, 2 * SECOND + 300):
        child, time = ("base", stamp) if way != "set_transform_static" else (f"fixed{stamp}", 0)
        future = buffer.wait_for_transform_async("map", child, time)
        settled: list[int] = []
        future.add_done_callback(lambda _, settled=settled: settled.append(threading.get_ident()))
        WRITES[way](buffer, stamp)
        assert future.done()
        assert settled == [threading.get_ident()]
        assert plain(future.result())[1] == child


class Cleared(tf2.Buffer):
    """Another thread clears it before the next lookup."""

    clears = 0

    def lookup_transform_core(self, *asked: Any) -> Any:
        self.lose()
        return super().lookup_transform_core(*asked)

    def lookup_transform_full_core(self, *asked: Any) -> Any:
        self.lose()
        return super().lookup_transform_full_core(*asked)

    def lose(self) -> None:
        if self.clears:
            self.clears -= 1
            self.clear()


FUTURES: dict[str, Callable[[tf2.Buffer, Any], Any]] = {
    "wait": lambda b, t: b.wait_for_transform_async("map", "base", seconds(2), t),
    "wait_full": lambda b, t: b.wait_for_transform_full_async(
        "map", seconds(2), "base", seconds(2), "map", t
    ),
}


@pytest.mark.parametrize("timeout", [None, FOREVER])
@pytest.mark.parametrize("way", FUTURES)
def test_a_future_waits_again_if_its_transform_is_cleared(way: str, timeout: float | None) -> None:
    with Cleared(flavor="ros2") as buffer:
        store(buffer, 2)
        buffer.clears = 1
        future = FUTURES[way](buffer, timeout)
        assert not future.done()
        buffer.clears = 1
        store(buffer, 2)
        assert not future.done()
        store(buffer, 2)
        assert plain(future.result())[3] == pytest.approx(POSE)
        tellers = tfdb.store.waiting._tellers.values()
        assert all(not teller.waits for teller in tellers if teller.buffer is buffer.buffer)


def test_a_future_times_out_after_its_transform_was_cleared() -> None:
    with Cleared(flavor="ros2") as buffer:
        future = buffer.wait_for_transform_async("map", "base", seconds(2), 0.05)
        buffer.clears = 1
        store(buffer, 2)
        with pytest.raises(tf2.TimeoutException):
            future.result(FOREVER)


def test_a_lookup_of_the_program_s_own_that_always_fails_ends_its_future() -> None:
    class Own(tf2.Buffer):
        def lookup_transform_core(self, *_: Any) -> Any:
            raise tf2.LookupException("no")

    with Own(flavor="ros2") as buffer:
        future = buffer.wait_for_transform_async("map", "base", seconds(2))
        store(buffer, 2)
        with pytest.raises(tf2.LookupException, match="no"):
            future.result()


def test_a_coroutine_without_a_loop_is_done_after_the_transform(buffer: tf2.Buffer) -> None:
    """As upstream's tests run them."""
    for coroutine in (
        buffer.lookup_transform_async("map", "base", seconds(2)),
        buffer.lookup_transform_full_async("map", seconds(1), "base", seconds(3), "map"),
    ):
        coroutine.send(None)
        store(buffer, 2 if coroutine.cr_code.co_name == "lookup_transform_async" else 3)
        with pytest.raises(StopIteration) as ended:
            coroutine.send(None)
        assert plain(ended.value.value)[3] == pytest.approx(POSE)


def test_a_coroutine_that_is_closed_leaves_nothing(buffer: tf2.Buffer) -> None:
    coroutine = buffer.lookup_transform_async("map", "base", seconds(2))
    coroutine.send(None)
    coroutine.close()
    tellers = tfdb.store.waiting._tellers.values()
    assert all(not teller.waits for teller in tellers if teller.buffer is buffer.buffer)


def test_no_lock_is_held_while_futures_are_settled(
    buffer: tf2.Buffer, thread: ThreadPoolExecutor
) -> None:
    """A callback waits for another thread, which begins a wait and ends another."""

    def other() -> bool:
        second = buffer.wait_for_transform_async("map", "base", seconds(3))
        store(buffer, 3)
        return bool(second.done())

    results: list[bool] = []
    first = buffer.wait_for_transform_async("map", "base", seconds(2))
    first.add_done_callback(lambda _: results.append(thread.submit(other).result(FOREVER)))
    store(buffer, 2)
    assert results == [True]


def test_a_callback_of_a_future_may_store_a_transform(buffer: tf2.Buffer) -> None:
    first, second = (
        buffer.wait_for_transform_async("map", "base", seconds(stamp)) for stamp in (2, 3)
    )
    first.add_done_callback(lambda _: store(buffer, 3))
    store(buffer, 2)
    assert second.done()


def test_ctrl_c_in_a_callback_is_raised_once_all_are_settled(buffer: tf2.Buffer) -> None:
    def interrupt(_: Any) -> None:
        raise KeyboardInterrupt

    futures = [buffer.wait_for_transform_async("map", "base", seconds(2)) for _ in range(3)]
    futures[0].add_done_callback(interrupt)
    with pytest.raises(KeyboardInterrupt):
        store(buffer, 2)
    assert all(future.done() for future in futures)


def test_an_error_of_a_lookup_of_the_program_s_own_ends_its_future() -> None:
    class Own(tf2.Buffer):
        def lookup_transform_core(self, *_: Any) -> Any:
            raise ValueError("no")

    with Own(flavor="ros2") as buffer:
        future = buffer.wait_for_transform_async("map", "base", seconds(2))
        store(buffer, 2)
        with pytest.raises(ValueError, match="no"):
            future.result()


def test_a_future_that_is_cancelled_or_closed(buffer: tf2.Buffer) -> None:
    cancelled = buffer.wait_for_transform_async("map", "base", seconds(2))
    assert cancelled.cancel()
    closed = buffer.wait_for_transform_async("map", "base", seconds(2))
    buffer.close()
    with pytest.raises(tfdb.errors.BufferClosed):
        closed.result(FOREVER)
    assert cancelled.cancelled()


def test_a_future_for_an_impossible_transform_is_refused(buffer: tf2.Buffer) -> None:
    for asked in (("map", "base", -1), ("map", "", seconds(1)), ("/map", "base", seconds(1))):
        with pytest.raises(tf2.InvalidArgumentException, match="can never succeed"):
            buffer.wait_for_transform_async(*asked).result(0)


def test_ten_thousand_futures_and_one_transform(buffer: tf2.Buffer) -> None:
    futures = [buffer.wait_for_transform_async("map", "base", seconds(2)) for _ in range(10_000)]
    store(buffer, 5, "odom", "wheel")
    assert not any(future.done() for future in futures)
    store(buffer, 2)
    assert all(future.done() for future in futures)
    assert all(plain(future.result())[2] == 2 * SECOND for future in futures)


@pytest.mark.parametrize("seed", range(3))
def test_every_wait_ends_once(seed: int) -> None:
    """Begun, ended by a transform, cancelled, timed out and closed: each ends exactly once."""
    rng = random.Random(seed)
    ends: Counter[str] = Counter()
    lock = threading.Lock()

    def count(future: Any) -> None:
        with lock:
            if future.cancelled():
                ends["cancelled"] += 1
            else:
                ends[type(future.exception()).__name__] += 1

    cycles = 0
    while cycles < 3_400:
        buffer = tf2.Buffer(flavor="ros2")
        store(buffer, 1)
        futures: list[Any] = []
        for _ in range(200):
            stamp = rng.randrange(2, 6)
            limit = rng.choice([None, None, None, 0.001])
            futures.append(buffer.wait_for_transform_async("map", "base", seconds(stamp), limit))
            futures[-1].add_done_callback(count)
            if rng.random() < 0.3:
                rng.choice(futures).cancel()
            if rng.random() < 0.02:
                store(buffer, stamp)
        cycles += len(futures)
        buffer.close()
        concurrent.futures.wait(futures, FOREVER)
        assert all(future.done() for future in futures)
    with lock:
        assert sum(ends.values()) == cycles
        assert {"cancelled", "NoneType", "BufferClosed", "TimeoutException"} <= set(ends)


# Requests and callbacks


def calls() -> tuple[list[tuple[Any, ...]], threading.Event, Callable[..., None]]:
    made: list[tuple[Any, ...]] = []
    called = threading.Event()

    def callback(*arguments: Any) -> None:
        made.append(arguments)
        called.set()

    return made, called, callback


def test_a_request_is_called_once(buffer: tf2.Buffer) -> None:
    made, called, callback = calls()
    assert buffer.add_transformable_request(callback, "map", "base", seconds(1)) == 0
    handle = buffer.add_transformable_request(callback, "map", "base", seconds(2))
    assert handle not in (0, NEVER)
    store(buffer, 2)
    assert called.wait(FOREVER)
    store(buffer, 3)
    available = tf2.TransformableResult.TransformAvailable
    assert made == [(handle, "map", "base", seconds(2), available)]


def test_a_request_ends_if_its_time_leaves_the_cache(buffer: tf2.Buffer) -> None:
    made, called, callback = calls()
    store(buffer, 5)
    store(buffer, 6, "base", "arm")
    handle = buffer.add_transformable_request(callback, "map", "arm", seconds(4))
    store(buffer, 20, "base", "arm")
    store(buffer, 20)
    assert called.wait(FOREVER)
    failure = tf2.TransformableResult.TransformFailure
    assert made == [(handle, "map", "arm", seconds(4), failure)]
    assert buffer.add_transformable_request(callback, "map", "arm", seconds(4)) == NEVER


def test_a_cancelled_request_is_not_called(buffer: tf2.Buffer) -> None:
    made, _, callback = calls()
    others, called, other = calls()
    buffer.cancel_transformable_request(
        buffer.add_transformable_request(callback, "map", "base", seconds(2))
    )
    buffer.add_transformable_request(other, "map", "base", seconds(2))
    store(buffer, 2)
    assert called.wait(FOREVER)
    assert not made
    assert len(others) == 1


@pytest.mark.parametrize("timeout", [-1, -0.5, float("nan"), float("inf"), 2**70])
def test_timeouts_are_checked_without_a_wait(buffer: tf2.Buffer, timeout: float) -> None:
    store(buffer, 1)
    for call in (buffer.lookup_transform, buffer.can_transform):
        with pytest.raises(tfdb.InvalidArgument, match="timeout must be a number of seconds"):
            call("map", "base", seconds(1), timeout)
        assert call("map", "base", seconds(1), 3)


def test_frames_are_named_as_their_arguments(buffer: tf2.Buffer) -> None:
    now = seconds(1)
    given = ["map", now, "base", now, "map"]
    for place, role in ((0, "target_frame"), (2, "source_frame"), (4, "fixed_frame")):
        wrong: list[Any] = [*given[:place], 3, *given[place + 1 :]]
        for full in (
            buffer.lookup_transform_full,
            buffer.can_transform_full,
            buffer.wait_for_transform_full_async,
            buffer._chain,
        ):
            with pytest.raises(TypeError, match=f"^{role} must be a str, got int$"):
                full(*wrong)
        simple = [*wrong[:3:2], now]
        for call in (
            buffer.lookup_transform,
            buffer.can_transform_core,
            buffer.wait_for_transform,
            buffer.wait_for_transform_async,
            lambda *asked: buffer.add_transformable_request(print, *asked),
            lambda *asked: buffer.get_latest_common_time(*asked[:2]),
        ):
            if place < 4:
                with pytest.raises(TypeError, match=f"^{role} must be a str, got int$"):
                    call(*simple)
    with pytest.raises(TypeError, match=r"^observation_frame must be a str, got int$"):
        buffer.lookupVelocityCore("map", 3, now, 0.1)  # type: ignore[arg-type]


def test_a_handle_is_an_integer(buffer: tf2.Buffer) -> None:
    buffer.cancel_transformable_request(NEVER)
    with pytest.raises(TypeError, match=r"^request_handle must be a handle, an integer, got 'x'"):
        buffer.cancel_transformable_request("x")  # type: ignore[arg-type]


def test_a_callback_may_write_wait_and_raise(
    buffer: tf2.Buffer, caplog: pytest.LogCaptureFixture
) -> None:
    over = threading.Event()
    found: list[Any] = []

    def write(*_: Any) -> None:
        store(buffer, 3)
        buffer.add_transformable_request(finish, "map", "base", seconds(4))
        found.append(buffer.lookup_transform("map", "base", seconds(3), FOREVER))
        store(buffer, 4)
        raise ValueError("a fault of the callback")

    def finish(*_: Any) -> None:
        over.set()

    buffer.add_transformable_request(write, "map", "base", seconds(2))
    store(buffer, 2)
    assert over.wait(FOREVER)
    assert plain(found[0])[2] == 3 * SECOND
    assert "a fault of the callback" in caplog.text


def test_requests_of_a_buffer_that_is_closed(buffer: tf2.Buffer) -> None:
    made, called, callback = calls()
    buffer.add_transformable_request(callback, "map", "base", seconds(2))
    buffer.close()
    assert called.wait(FOREVER)
    assert made[0][4] is tf2.TransformableResult.TransformFailure


# Named stores, service


def test_one_listens_and_others_look_up(thread: ThreadPoolExecutor, name: str) -> None:
    with tf2.Buffer(msgs.Duration(5), store=name) as writer, tf2.Buffer(store=name) as reader:
        assert reader.buffer.history == 5.0
        waits = thread.submit(reader.lookup_transform, "map", "base", seconds(2), FOREVER)
        store(writer, 2)
        assert plain(waits.result(FOREVER))[3] == pytest.approx(POSE)
        code = (
            "from tfdb import tf2; from tfdb.tf2 import msgs;"
            f"b = tf2.Buffer(store={name!r});"
            "print(b.lookup_transform('map', 'base', msgs.Time(2)).transform.translation.y)"
        )
        other = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        )
        assert other.stdout == "2.0\n"


def test_exclusive_arguments_are_refused() -> None:
    with pytest.raises(tf2.InvalidArgumentException, match="not both"):
        tf2.Buffer(store="one", buffer=tfdb.Buffer())


def test_the_tree_is_served(buffer: tf2.Buffer) -> None:
    for flavor, name in (("ros1", "~tf2_frames"), ("ros2", "tf2_frames")):
        node = LoopbackNode(flavor=flavor)  # type: ignore[arg-type]
        with tf2.Buffer(node=node) as served:
            assert served.flavor == flavor
            store(served, 1)
            data = node.services[name](b"")
            start = 4 if flavor == "ros1" else 8
            (length,) = struct.unpack_from("<I", data, start - 4)
            assert data[start:].rstrip(b"\0").decode() == served.all_frames_as_yaml()
            assert length == len(data) - start
        assert not node.services
        with tf2.Buffer(None, node, debug=False):
            assert not node.services


# Rare ends


def test_a_callback_that_exits_ends_no_other_wait(
    buffer: tf2.Buffer, caplog: pytest.LogCaptureFixture
) -> None:
    def leave(_: Any) -> None:
        raise SystemExit(3)

    first = buffer.wait_for_transform_async("map", "base", seconds(2))
    first.add_done_callback(leave)
    thread = threading.Thread(target=store, args=(buffer, 2))
    thread.start()
    thread.join(FOREVER)
    assert first.done()
    second = buffer.wait_for_transform_async("map", "base", seconds(3))
    store(buffer, 3)
    assert second.done()
    assert "SystemExit" in caplog.text


def test_waits_with_a_timeout_need_no_thread_each(buffer: tf2.Buffer) -> None:
    before = threading.active_count()
    futures = [
        buffer.wait_for_transform_async("map", "base", seconds(2), FOREVER) for _ in range(1000)
    ]
    late = buffer.wait_for_transform_async("map", "base", seconds(3), 0.01)
    assert threading.active_count() <= before + 2
    with pytest.raises(tf2.TimeoutException):
        late.result(FOREVER)
    store(buffer, 2)
    assert all(future.result(FOREVER) for future in futures)


def test_a_name_that_is_none_is_refused_in_all_ways(buffer: tf2.Buffer) -> None:
    for name in ("", "/map"):
        for ask in (
            lambda n: buffer.lookup_transform(n, "base", seconds(2), 0.01),
            lambda n: buffer.wait_for_transform(n, "base", seconds(2), 0.01),
            lambda n: buffer.wait_for_transform_async(n, "base", seconds(2)).result(0),
            lambda n: buffer.add_transformable_request(print, n, "base", seconds(2)),
        ):
            with pytest.raises(tf2.InvalidArgumentException):
                ask(name)
    with pytest.raises(TypeError, match="target_frame must be a str, got NoneType"):
        buffer.wait_for_transform_async(None, "base", seconds(2))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="callback must be callable"):
        buffer.add_transformable_request(5, "map", "base", seconds(2))  # type: ignore[arg-type]

"""Futures of tfdb.tf2 in programs of rclpy: real ones, completed by the storing thread."""

from __future__ import annotations

import asyncio
import threading
from typing import TYPE_CHECKING, Any

import pytest
import rclpy
import rclpy.time
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from tf2_msgs.msg import TFMessage

import tfdb
from ros.in_ros2.graph import connected, message
from tfdb import tf2

if TYPE_CHECKING:
    from geometry_msgs.msg import TransformStamped

    from ros.in_ros2.graph import Graph

FOREVER = 60.0
"""A timeout in seconds that is never reached here."""


def store(buffer: tf2.Buffer, number: int = 1) -> TransformStamped:
    """T[base<-frame0] at `stamp(number)`."""
    sent: TransformStamped = message(number).transforms[0]
    buffer.set_transform(sent, "test")
    return sent


def stamp(number: int = 1) -> rclpy.time.Time:
    return rclpy.time.Time.from_msg(message(number).transforms[0].header.stamp)


def begin(buffer: tf2.Buffer, full: bool, timeout: float | None = None) -> Any:
    if full:
        asked = ("base", stamp(), "frame0", stamp(), "base")
        return buffer.wait_for_transform_full_async(*asked, timeout=timeout)
    return buffer.wait_for_transform_async("base", "frame0", stamp(), timeout)


def waits(buffer: tf2.Buffer) -> int:
    """Return the number of active waits of a buffer."""
    tellers = tfdb.store.waiting._tellers.values()
    return sum(len(teller.waits) for teller in tellers if teller.buffer is buffer.buffer)


simple_and_full = pytest.mark.parametrize("full", [False, True], ids=["simple", "full"])


@simple_and_full
def test_a_future_is_rclpy_s_and_has_the_transform(full: bool) -> None:
    buffer = tf2.Buffer()
    future = begin(buffer, full)
    assert isinstance(future, Future)
    assert future.result() is None
    assert future.exception() is None
    settled: list[int] = []
    future.add_done_callback(lambda _: settled.append(threading.get_ident()))
    sent = store(buffer)
    assert future.done()
    assert settled == [threading.get_ident()]
    assert future.result() == sent
    at_once = begin(buffer, full)
    assert isinstance(at_once, Future)
    assert at_once.result() == sent


def test_a_spin_until_a_future_is_complete_ends_by_either(graph: Graph) -> None:
    node, buffer = graph.node("listener"), tf2.Buffer()
    tf2.TransformListener(buffer, node, spin_thread=True)
    publisher = graph.node("robot").create_publisher(TFMessage, "/tf", 10)
    connected(publisher)
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    future = begin(buffer, full=False)
    executor.spin_until_future_complete(future, timeout_sec=0.01)
    assert not future.done()
    assert future.result() is None
    publisher.publish(message(1))
    executor.spin_until_future_complete(future, timeout_sec=FOREVER)
    assert future.result().transform == message(1).transforms[0].transform
    executor.shutdown()


@simple_and_full
def test_a_coroutine_of_an_executor_goes_on(graph: Graph, full: bool) -> None:
    node = graph.node("listener", spin=True)
    buffer = tf2.Buffer(node=node)
    stamps = ("base", stamp(), "frame0", stamp(), "base")
    done = threading.Event()

    async def ask() -> Any:
        if full:
            return await buffer.lookup_transform_full_async(*stamps)
        return await buffer.lookup_transform_async("base", "frame0", stamp())

    task = node.executor.create_task(ask)
    task.add_done_callback(lambda _: done.set())
    sent = store(buffer)
    assert done.wait(FOREVER)
    assert task.result() == sent


@pytest.mark.parametrize("by", ["the loop", "another thread"])
def test_a_coroutine_of_asyncio_goes_on(by: str) -> None:
    buffer = tf2.Buffer()

    async def main() -> Any:
        simple = asyncio.create_task(buffer.lookup_transform_async("base", "frame0", stamp()))
        future = begin(buffer, full=True)
        assert isinstance(future, Future)
        await asyncio.sleep(0)
        if by == "the loop":
            store(buffer)
        else:
            await asyncio.to_thread(store, buffer)
        assert future.done()
        return await asyncio.wait_for(simple, FOREVER), await asyncio.wait_for(future, FOREVER)

    sent = message(1).transforms[0]
    assert asyncio.run(main()) == (sent, sent)
    assert asyncio.run(buffer.lookup_transform_async("base", "frame0", stamp())) == sent


def test_a_loop_of_asyncio_sleeps_while_a_future_is_awaited() -> None:
    """Upstream's futures keep the loop busy."""
    buffer = tf2.Buffer()
    rounds = 0

    async def main() -> None:
        loop = asyncio.get_running_loop()
        select = loop._selector.select  # type: ignore[attr-defined]

        def counting(timeout: float | None) -> Any:
            nonlocal rounds
            rounds += 1
            return select(timeout)

        loop._selector.select = counting  # type: ignore[attr-defined]
        task = asyncio.ensure_future(buffer.lookup_transform_async("base", "frame0", stamp()))
        loop.call_later(0.05, store, buffer)
        await task

    asyncio.run(main())
    assert rounds < 20


def test_cancelled_and_closed_futures_leave_no_wait() -> None:
    buffer = tf2.Buffer()
    future = begin(buffer, full=False)
    assert waits(buffer) == 1
    future.cancel()
    assert future.cancelled()
    assert waits(buffer) == 0

    async def main() -> None:
        task = asyncio.create_task(buffer.lookup_transform_async("base", "frame0", stamp()))
        await asyncio.sleep(0)
        assert waits(buffer) == 1
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task

    asyncio.run(main())
    assert waits(buffer) == 0
    coroutine = buffer.lookup_transform_async("base", "frame0", stamp())
    coroutine.send(None)
    coroutine.close()
    assert waits(buffer) == 0


@simple_and_full
def test_a_timeout_and_a_closed_buffer_end_a_future(full: bool) -> None:
    buffer = tf2.Buffer()
    for end, limit in (("TimeoutException", 0.001), ("BufferClosed", None)):
        future, over = begin(buffer, full, limit), threading.Event()
        future.add_done_callback(lambda _, over=over: over.set())
        if limit is None:
            buffer.close()
        assert over.wait(FOREVER)
        assert type(future.exception()).__name__ == end


def test_ten_thousand_futures_of_rclpy() -> None:
    buffer = tf2.Buffer()
    futures = [begin(buffer, full=False) for _ in range(10_000)]
    sent = store(buffer)
    assert all(future.result() == sent for future in futures)

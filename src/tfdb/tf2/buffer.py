"""`Buffer`: a `BufferCore` that waits, in threads, coroutines and callbacks."""

from __future__ import annotations

import threading
from time import monotonic_ns
from typing import TYPE_CHECKING, Any

from tfdb import _core
from tfdb._core import BufferCalls
from tfdb.data import errors
from tfdb.data.argument_checks import refuse_without
from tfdb.data.closable import Closable
from tfdb.ros import node_for
from tfdb.ros.choose_node import in_rospy
from tfdb.ros.times import SECOND, duration, flavor_of
from tfdb.store import waiting

from .buffer_core import DEFAULT_CACHE_TIME, LAST_STAMP, BufferCore
from .buffer_interface import BufferInterface
from .deadlines import deadline_in, stop_with, wait_until
from .exceptions import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
)
from .frame_graph import offer_frame_graph
from .futures import complete, future_of_caller
from .transformable_requests import TransformableRequests, TransformableResult

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb.ros import Flavor, Node

    from .buffer_core import Full, Question
    from .deadlines import Deadline

__all__ = ["Buffer"]

# Errors that a later transform may resolve.
NO_ANSWER_YET = (LookupException, ConnectivityException, ExtrapolationException)
_MOST_TRIES = 100
"""Largest number of successive lookups for a future, if another thread clears the buffer."""


class Buffer(BufferCalls, BufferCore, BufferInterface, Closable):
    """A store of transforms with the calls of `tf2_ros.Buffer`.

    Any number of threads may use it at once, and any thread may fill it. The missing transform
    wakes a wait, without polling. If the node ends, even by a signal, a wait ends with the error of
    its timeout. In ROS 2 a timeout is wall time, as upstream. In ROS 1 it is measured by `clock`,
    which may be simulated. A wait also ends if that clock jumps back by more than 3 s, as when a
    bag restarts.

    Parameters
    ----------
    cache_time
        A duration: how long samples are kept, relative to the newest of their edge. None: 10 s.
    node
        A node of rclpy or of `tfdb.ros`. It is the `clock`, and offers the service `tf2_frames` (in
        ROS 1 for its first buffer only). None: rospy's node in a program of rospy, otherwise none.
        A bool is ROS 1's `debug`.
    debug
        False: offer no service.
    store
        Name of a shared store: all processes can look up the transforms that one of them receives.
        A missing store is created; an existing one keeps its own history.
    flavor
        `ros1` or `ros2`: whose rules and texts to follow. None: detected from the node, from
        `cache_time`, from the first stamp, or from the installed ROS.
    buffer
        The store, in place of a new or named one.
    clock
        In ROS 1, the node whose clock measures timeouts. None: `node`, or the node of the listener
        that fills the buffer, otherwise the system's clock.

    Raises InvalidArgumentException for arguments that cannot be combined.
    """

    def __init__(
        self,
        cache_time: Any = None,
        node: Any = None,
        debug: bool = True,
        *,
        store: Any = None,
        flavor: Flavor | None = None,
        buffer: _core.Buffer | None = None,
        clock: Node | None = None,
    ) -> None:
        if isinstance(node, bool):
            node, debug = None, node
        if node is not None or in_rospy():
            node = node_for(node)
            flavor = flavor or node.flavor
        if store is not None:
            if buffer is not None:
                raise InvalidArgumentException("give the name of a store or a buffer, not both")
            flavor = flavor or flavor_of(cache_time)
            buffer, cache_time = _open_store(store, cache_time), None
        BufferCore.__init__(self, cache_time, flavor=flavor, buffer=buffer)
        BufferInterface.__init__(self)
        if clock is not None:
            refuse_without(clock, "clock", "a node of tfdb.ros", "now", "on_clock")
        self.clock = clock or node
        self._requests = TransformableRequests(self)
        self._service = offer_frame_graph(self, node) if debug and node is not None else None
        if self._service is not None and self._service.native is not None:
            # tf2's name in ROS 1 and ROS 2.
            name = "frame_server" if node.flavor == "ros1" else "srv"
            setattr(self, name, self._service.native)

    @property
    def clock(self) -> Node | None:
        """Node whose end, and in ROS 1 whose clock, ends waits; None until a listener sets it."""
        return self._clock

    @clock.setter
    def clock(self, node: Node | None) -> None:
        self._clock = node
        if node is not None:
            stop_with(node, self)

    # Lookups that wait

    def _lookup_transform(
        self, target_frame: str, source_frame: str, time: Any, timeout: Any
    ) -> Any:
        """`lookup_transform` for all arguments."""
        limit = self._limit(timeout)
        question = self._question(target_frame, source_frame, time)
        return self._wait_for_answer(
            lambda: self.lookup_transform_core(target_frame, source_frame, time), question, limit
        )

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Any = None,
    ) -> Any:
        """T[target_frame at target_time <- source_frame at source_time], as soon as it exists.

        `fixed_frame` does not move between the times. Otherwise as `lookup_transform`.
        """
        limit = self._limit(timeout)
        asked = (target_frame, target_time, source_frame, source_time, fixed_frame)
        return self._wait_for_answer(
            lambda: self.lookup_transform_full_core(*asked), self._full(*asked), limit
        )

    def _can_transform(
        self, target_frame: str, source_frame: str, time: Any, timeout: Any, return_debug_tuple: Any
    ) -> Any:
        """`can_transform` for all arguments."""
        limit = self._limit(timeout)
        question = self._question(target_frame, source_frame, time)
        found = self._wait_until_possible(
            lambda: self.can_transform_core(target_frame, source_frame, time), question, limit
        )
        return found if return_debug_tuple else found[0]

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Any = None,
        return_debug_tuple: bool = False,
    ) -> Any:
        """Whether `lookup_transform_full` succeeds within the timeout."""
        limit = self._limit(timeout)
        asked = (target_frame, target_time, source_frame, source_time, fixed_frame)
        found = self._wait_until_possible(
            lambda: self.can_transform_full_core(*asked), self._full(*asked), limit
        )
        return found if return_debug_tuple else found[0]

    def wait_for_transform(
        self, target_frame: str, source_frame: str, time: Any, timeout: Any = None
    ) -> Any:
        """T[target_frame<-source_frame] as `lookup_transform`, waiting without a limit.

        With a `timeout` it raises TimeoutException, whose cause names the missing data.
        """
        question = self._question(target_frame, source_frame, time)
        limit = None if timeout is None else self._limit(timeout)
        _check_possible(question)
        began = monotonic_ns()
        try:
            return self._wait_for_answer(
                lambda: self.lookup_transform_core(target_frame, source_frame, time),
                question,
                limit,
            )
        except NO_ANSWER_YET as error:
            raise self._late(question, limit, began, error) from error

    # Waits without a blocked thread

    def wait_for_transform_async(
        self, target_frame: str, source_frame: str, time: Any, timeout: Any = None
    ) -> Any:
        """Return a future that is done when `lookup_transform` succeeds.

        Its result is the transform. The thread that stores the transform completes it, so it is
        done when `set_transform` returns. Cancelling it ends the wait. With a `timeout`,
        TimeoutException may end it.

        In a program of rclpy it is an `rclpy.task.Future`: before it is done, its `result()` and
        `exception()` return None. In a loop of asyncio without rclpy it is an `asyncio.Future`.
        Elsewhere it is a `concurrent.futures.Future` whose `result()` raises InvalidStateError
        before it is done; `result(seconds)` waits. All of them can be awaited.
        """
        asked = (target_frame, source_frame, time)
        question = self._question(target_frame, source_frame, time)
        return self._future(question, lambda: self.lookup_transform_core(*asked), timeout)

    def wait_for_transform_full_async(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Any = None,
    ) -> Any:
        """As `wait_for_transform_async`, for `lookup_transform_full`."""
        asked = (target_frame, target_time, source_frame, source_time, fixed_frame)
        return self._future(
            self._full(*asked), lambda: self.lookup_transform_full_core(*asked), timeout
        )

    async def lookup_transform_async(
        self, target_frame: str, source_frame: str, time: Any, timeout: Any = None
    ) -> Any:
        """As `lookup_transform`, in a coroutine of asyncio or of rclpy."""
        return await _ended(
            self.wait_for_transform_async(target_frame, source_frame, time, timeout)
        )

    async def lookup_transform_full_async(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Any = None,
    ) -> Any:
        """As `lookup_transform_full`, in a coroutine of asyncio or of rclpy."""
        asked = (target_frame, target_time, source_frame, source_time, fixed_frame)
        return await _ended(self.wait_for_transform_full_async(*asked, timeout))

    def add_transformable_request(
        self,
        callback: Callable[[int, str, str, Any, Any], object],
        target_frame: str,
        source_frame: str,
        time: Any,
    ) -> int:
        """Call a function once a transform is available, or can no longer become available.

        Parameters
        ----------
        callback
            Called as `callback(handle, target_frame, source_frame, time, result)` with a
            `TransformableResult`, in a thread of the buffer and outside all locks. It may call
            anything.
        target_frame, source_frame, time
            As in `lookup_transform`.

        Returns
        -------
        int
            A handle. 0: the transform is available now. 2^64 - 1: `time` is before the cache, so
            the transform can never become available. In both cases the function is not called.

        Raises InvalidArgumentException for names and times that no transform can have.
        """
        if not callable(callback):
            raise TypeError(f"callback must be callable, got {type(callback).__name__}")
        _check_possible(self._question(target_frame, source_frame, time))
        return self._requests.add(callback, (target_frame, source_frame), time)

    def cancel_transformable_request(self, request_handle: int) -> None:
        """Cancel a request; one that has ended is ignored."""
        refuse_without(request_handle, "request_handle", "a handle, an integer", "__index__")
        self._requests.cancel(request_handle)

    def close(self) -> None:
        """End all waits and the service; later calls raise BufferClosed."""
        if self._service is not None:
            self._service.close()
        self.buffer.close()

    # The common parts of waits

    def _limit(self, timeout: Any) -> int:
        """Nanoseconds of a timeout."""
        if timeout is None:
            return 0
        return duration(timeout, self._flavor, "timeout")

    def _deadline(self, limit: int) -> Deadline:
        """Return the deadline after `limit` nanoseconds; ROS 2 uses wall time, as upstream."""
        return deadline_in(limit, self.clock if self.flavor == "ros1" else None)

    def _wait_for_answer(
        self, ask: Callable[[], Any], question: Question | Full, limit: int | None
    ) -> Any:
        """Repeat a lookup until it succeeds; raise its error after the limit, in nanoseconds."""
        deadline = None if limit is None else self._deadline(limit)
        while True:
            try:
                return ask()
            except NO_ANSWER_YET:
                if limit == 0 or not _is_possible(question):
                    raise
                if not self._block(question, deadline):
                    break
        return ask()

    def _wait_until_possible(
        self, ask: Callable[[], tuple[int, str]], question: Question | Full, limit: int
    ) -> tuple[int, str]:
        """Repeat a check until it is true or the limit is over."""
        found = ask()
        if limit <= 0 or not _is_possible(question):
            return found
        deadline = self._deadline(limit)
        while found[0] == 0:
            if not self._block(question, deadline):
                return ask()
            found = ask()
        return found

    def _block(self, question: Question | Full, deadline: Deadline | None) -> bool:
        """Wait until a lookup can succeed; False: the deadline has passed."""
        left = None if deadline is None else deadline.left()
        if left == 0:
            return False
        if len(question) == 3 and (deadline is None or left is not None):
            target, source, stamp = question
            seconds = None if left is None else left / SECOND
            try:
                self.buffer.wait_for_transform(target, source, stamp or None, seconds)
            except waiting.NO_ANSWER_YET:
                return False
            return True
        ends: list[waiting.End] = []
        over = threading.Event()

        def tell(how: waiting.End) -> None:
            ends.append(how)
            over.set()

        wait = self._begin(question, tell)
        if wait is None:
            return True
        try:
            wait_until(over, deadline)
        finally:
            wait.cancel()
        if not ends:
            return False
        waiting.check(self.buffer, ends[0])
        return ends[0] == waiting.CAME

    def _begin(
        self,
        question: Question | Full,
        tell: Callable[[waiting.End], None],
        loop: Any = None,
    ) -> waiting.Wait | None:
        """Begin a wait for a lookup; None: the lookup already succeeds."""
        store = self.buffer
        if len(question) == 3:
            target, source, stamp = question

            def ask() -> int:
                return store._begin_wait(target, source, stamp or None, None)
        else:
            target, stamp, source, source_stamp, fixed = question

            def ask() -> int:
                return store._begin_wait_full(
                    target, stamp or None, source, source_stamp or None, fixed
                )

        return waiting.begin(store, ask, tell, loop)

    def _begin_request(
        self,
        frames: tuple[str, str],
        stamp: int,
        tell: Callable[[TransformableResult | None], None],
        hold: Callable[[waiting.Wait], None],
    ) -> TransformableResult | None:
        """Begin waits until a transform is available or out of the cache; return the current state.

        `hold` is called with each wait. `tell` is called with the final state, or None if the
        buffer was closed.
        """
        available, failure = TransformableResult
        store = self.buffer

        def told(result: TransformableResult) -> Callable[[waiting.End], None]:
            return lambda how: tell(result if how == waiting.CAME else None)

        there = self._begin((*frames, stamp), told(available))
        if there is None:
            return available
        hold(there)
        if store.history is None or not 0 < stamp <= LAST_STAMP:
            return None  # the static transform stays forever
        gone_at = min(stamp + round(store.history * SECOND) + 1, LAST_STAMP)
        gone = waiting.begin(
            store, lambda: store._begin_wait_as_new(*frames, gone_at), told(failure)
        )
        if gone is None:
            return failure
        hold(gone)
        return None

    def _future(self, question: Question | Full, ask: Callable[[], Any], timeout: Any) -> Any:
        """Make a future for the result or error of a lookup, which `ask` makes."""
        limit = None if timeout is None else self._limit(timeout)
        held: list[Any] = []  # its waits, and the timer

        def release() -> None:
            for one in held:
                one.cancel()

        future, loop = future_of_caller(self.clock, release, ros2=self.flavor == "ros2")

        def hold(one: Any) -> None:
            held.append(one)
            if future.done():  # it ended before `held` had this one
                release()

        def answer_or_wait() -> Any:
            """Return the transform or an error. None: a wait has begun."""
            answer: Any = None
            for _ in range(_MOST_TRIES):
                try:
                    wait = self._begin(question, tell, loop)
                except errors.TfdbError as error:
                    return error
                if wait is not None:
                    hold(wait)
                    return None
                try:
                    return ask()
                except NO_ANSWER_YET as error:  # another thread has cleared the buffer since
                    answer = error
                except Exception as error:
                    return error
            return answer

        def tell(how: waiting.End) -> None:
            try:
                waiting.check(self.buffer, how)
                answer = ask()
            except NO_ANSWER_YET as error:
                answer = answer_or_wait() if how == waiting.CAME else error
            except Exception as error:
                answer = error
            finish(answer)

        def finish(answer: Any) -> None:
            if answer is not None:
                complete(future, answer)
                if len(held) > 1:
                    release()

        try:
            _check_possible(question)
        except errors.TfdbError as error:
            complete(future, error)
            return future
        finish(answer_or_wait())
        if limit is not None and not future.done():
            hold(self._timer(question, ask, limit, future, loop, release))
        return future

    def _timer(
        self,
        question: Question | Full,
        ask: Callable[[], Any],
        limit: int,
        future: Any,
        loop: Any,
        release: Callable[[], None],
    ) -> Any:
        """Let a future raise TimeoutException after that many nanoseconds."""
        began = monotonic_ns()

        def called() -> None:
            try:
                answer = ask()
            except Exception as error:
                answer = self._late(question, limit, began, error)
            complete(future, answer)
            release()

        def called_in_loop() -> None:
            loop.call_soon_threadsafe(called)

        return self._deadline(limit).call(called if loop is None else called_in_loop)

    def _late(
        self, question: Question | Full, limit: int | None, began: int, why: Exception
    ) -> TimeoutException:
        """Make the error of a wait without a result; `why` is the last lookup's error."""
        stopped = self.clock is not None and self.clock.closed
        waited = waiting.how_long(monotonic_ns() - began, stopped=stopped)
        target = question[0]
        source, stamp = (question[2], question[3]) if len(question) == 5 else question[1:]
        at = f"at {stamp // SECOND}.{stamp % SECOND:09d} s" if stamp else "at any common time"
        text = (
            f"Timed out waiting for transform from {source} to {target} {at}; {waited}: {why}; "
            "check that its publishers run, or wait longer"
        )
        return TimeoutException(text, target=target, source=source, stamp=stamp, limit=limit)


async def _ended(future: Any) -> Any:
    """Return a future's result; if the coroutine ends first, the future is cancelled."""
    try:
        return await future
    finally:
        future.cancel()


def _is_possible(question: Question | Full) -> bool:
    """Whether its stamps and names are valid, so that it can succeed later."""
    for part in question:
        if isinstance(part, int):
            if not 0 <= part <= LAST_STAMP:
                return False
        elif part[:1] == "/" or not _core.Buffer._may_be_frame(part):
            return False
    return True


def _check_possible(question: Question | Full) -> None:
    if not _is_possible(question):
        raise InvalidArgumentException(
            f"{question} can never succeed: names are neither empty nor begin with '/', "
            f"they have no control characters and at most 1024 bytes, stamps are from 0 to "
            f"{LAST_STAMP} ns",
            target=question[0],
        )


def _open_store(name: Any, cache_time: Any) -> _core.Buffer:
    length = DEFAULT_CACHE_TIME
    if cache_time is not None:
        length = duration(cache_time, role="cache_time")
    return _core.Buffer.open(name, history=max(length, 1) / SECOND)

"""`BufferServer`: answers lookups of other nodes from a buffer, as the action LookupTransform."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

from tfdb.data.argument_checks import refuse_without
from tfdb.data.closable import Closable
from tfdb.data.errors import TfdbError
from tfdb.ros import msgs, node_for

from .buffer import NO_ANSWER_YET
from .lookup_action import LookupResult, action_name, code_of, server_in

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb.ros import Node

    from .buffer import Buffer
    from .lookup_action import Goal, LookupGoal

__all__ = ["BufferServer"]


class BufferServer(Closable):
    """Answers the goals of the BufferClients of tfdb and tf2 from a buffer.

    If the transform is available, a goal is answered at once. Otherwise the goal waits for the
    commit of the transform, at most for its timeout, without polling. An error has tf2's code and
    text.

    Any thread may call it.

    Parameters
    ----------
    buffer
        A `tfdb.tf2.Buffer`, filled by a listener or by the program.
    ns
        Name of the action, such as `tf2_buffer_server`.
    auto_start
        True: accept goals at once. False: accept them after `start`.
    check_period
        Accepted as in tf2, without effect.
    node
        A node of rclpy or `tfdb.ros`. None: rospy's node; after `rclpy.init` a new rclpy node;
        otherwise a node without ROS.
    """

    def __init__(
        self,
        buffer: Buffer,
        ns: str,
        auto_start: bool = True,
        check_period: Any = None,  # noqa: ARG002 - tf2's
        *,
        node: Any = None,
    ) -> None:
        needed = ("lookup_transform_core", "wait_for_transform_async")
        refuse_without(buffer, "buffer", "a tfdb.tf2.Buffer", *needed)
        self.buffer = buffer
        self.node: Node = node_for(node)
        """The node of the server."""
        self._transport = server_in(self.node, action_name(ns))
        self._lock = threading.Lock()
        self._waiting: dict[Goal, Any] = {}
        self._started = self._closed = False
        if auto_start:
            self.start()

    def start(self) -> None:
        """Accept goals; a second call does nothing."""
        with self._lock:
            if self._started:
                return
            self._started = True
        self._transport.start(self._begin, self._cancel)

    def close(self) -> None:
        """Stop accepting goals; waiting goals are not answered."""
        with self._lock:
            self._closed = True
            waiting = list(self._waiting.values())
            self._waiting.clear()
        for future in waiting:
            future.cancel()
        if self._started:
            self._transport.close()

    def _begin(self, goal: Goal) -> None:
        """Answer a goal, now or once its transform is available."""
        question = goal.question
        try:
            found = LookupResult(self._look_up(question))
        except NO_ANSWER_YET as error:
            if question.timeout > 0:
                self._wait(goal)
                return
            found = _error(error)
        except TfdbError as error:
            found = _error(error)
        goal.succeed(found)

    def _wait(self, goal: Goal) -> None:
        asked = goal.question
        timeout = msgs.Duration.from_nanoseconds(asked.timeout)
        buffer = self.buffer
        wait: Callable[..., Any] = (
            buffer.wait_for_transform_full_async
            if asked.advanced
            else buffer.wait_for_transform_async
        )
        future = wait(*asked.arguments, timeout)
        with self._lock:
            if self._closed:
                future.cancel()
                return
            self._waiting[goal] = future
        future.add_done_callback(lambda ended: self._finish(goal, ended))

    def _finish(self, goal: Goal, ended: Any) -> None:
        """Answer a goal after its wait, by a transform, a timeout or an error."""
        if not ended.cancelled():
            ended.exception()  # rclpy prints exceptions that are never retrieved
        with self._lock:
            if self._waiting.pop(goal, None) is None:
                return
        try:
            found = LookupResult(self._look_up(goal.question))
        except TfdbError as error:
            found = _error(error)
        goal.succeed(found)

    def _cancel(self, goal: Goal) -> None:
        with self._lock:
            future = self._waiting.pop(goal, None)
        if future is not None:
            future.cancel()
            goal.cancel()

    def _look_up(self, asked: LookupGoal) -> Any:
        buffer = self.buffer
        look_up = (
            buffer.lookup_transform_full_core if asked.advanced else buffer.lookup_transform_core
        )
        return look_up(*asked.arguments)


def _error(error: TfdbError) -> LookupResult:
    return LookupResult(error=code_of(error), error_string=str(error))

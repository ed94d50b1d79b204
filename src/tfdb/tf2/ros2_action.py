"""The action LookupTransform in ROS 2, by rclpy's action server and client.

All calls happen in the executor of the node, which must spin. A callback of this executor must not
wait in a client, unless the executor runs several callbacks at once.
"""

from __future__ import annotations

import threading
from contextlib import suppress
from typing import TYPE_CHECKING, Any
from weakref import WeakSet

from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration, Time
from rclpy.action import ActionClient, ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.exceptions import InvalidHandle
from rclpy.impl.implementation_singleton import rclpy_implementation
from tf2_msgs.action import LookupTransform

from tfdb.ros.times import SECOND

from .exceptions import TimeoutException
from .lookup_action import NO_ERROR, LookupGoal, LookupResult, code_of

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb.ros.rclpy_node import RclpyNode

    from .lookup_action import Goal

__all__ = ["Ros2Client", "Ros2Server"]

NOT_ACCEPTED = (
    "The LookupTransform goal sent to the BufferServer did not come back with accepted status."
    " Something is likely wrong with the server."
)
CANCELLED = "The LookupTransform goal was cancelled."


class _ServerGoal:
    """A goal of a server. Threads: any."""

    def __init__(self, handle: Any) -> None:
        self.question = _question_of(handle.request)
        self._handle = handle
        self._lock = threading.Lock()
        self._is_over = False

    def succeed(self, result: LookupResult) -> None:
        """Send its result, which may be an error."""
        self._end(self._handle.succeed, result)

    def cancel(self) -> None:
        """Report the cancellation."""
        error = TimeoutException(CANCELLED)
        self._end(self._handle.canceled, LookupResult(None, code_of(error), CANCELLED))

    def _end(self, change_state: Callable[[], None], result: LookupResult) -> None:
        with self._lock:
            was_over, self._is_over = self._is_over, True
        if not was_over:
            self._change_state, self._result = change_state, result
            # rclpy calls `execute` in a task; until then the goal counts as accepted.
            self._handle.execute()

    def execute(self) -> Any:
        """Report its end."""
        self._change_state()
        return _message_of(self._result)


class Ros2Server:
    """Accepts goals of an action. Threads: any.

    Parameters
    ----------
    node
        A node of rclpy.
    name
        Name of the action, such as `tf2_buffer_server`.
    """

    def __init__(self, node: RclpyNode, name: str) -> None:
        self._node, self._name = node, name
        self._goals: dict[bytes, _ServerGoal] = {}
        self._opened: Any = None

    def start(self, on_goal: Callable[[Goal], None], on_cancel: Callable[[Goal], None]) -> None:
        """Accept goals from now on; `on_cancel` is called with a goal that its client cancels."""
        node = self._node.given

        def accept(handle: Any) -> None:
            goal = _ServerGoal(handle)
            self._goals[bytes(handle.goal_id.uuid)] = goal
            on_goal(goal)

        def execute(handle: Any) -> Any:
            return self._goals.pop(bytes(handle.goal_id.uuid)).execute()

        def cancel(handle: Any) -> Any:
            goal = self._goals.get(bytes(handle.goal_id.uuid))
            if goal is None:
                return CancelResponse.REJECT
            # After rclpy has processed the cancellation.
            node.executor.create_task(on_cancel, goal)
            return CancelResponse.ACCEPT

        server = ActionServer(
            node,
            LookupTransform,
            self._name,
            execute_callback=execute,
            callback_group=ReentrantCallbackGroup(),
            handle_accepted_callback=accept,
            cancel_callback=cancel,
        )
        self._opened = self._node.adopt(server.destroy)

    def close(self) -> None:
        """Stop accepting goals."""
        if self._opened is not None:
            self._opened.close()


class _SentGoal:
    """A goal of a client. Threads: any."""

    def __init__(self, on_result: Callable[[LookupResult | None], None]) -> None:
        self._on_result: Callable[[LookupResult | None], None] | None = on_result
        self._handle: Any = None
        self._lock = threading.Lock()

    @property
    def is_wanted(self) -> bool:
        """Whether its result has not come, and is waited for."""
        return self._on_result is not None

    def forget(self) -> None:
        """Stop waiting for the result, and cancel the goal at the server."""
        self._cancel()

    def end(self) -> None:
        """Cancel the goal at the server; it ends without a result."""
        if (on_result := self._cancel()) is not None:
            on_result(None)

    def _cancel(self) -> Callable[[LookupResult | None], None] | None:
        with self._lock:
            on_result, self._on_result = self._on_result, None
            handle = self._handle
        if on_result is not None and handle is not None:
            handle.cancel_goal_async()
        return on_result

    def answered(self, future: Any) -> None:
        """Process the server's response to the goal."""
        handle = future.result()
        if not handle.accepted:
            self._finish(LookupResult(None, code_of(TimeoutException()), NOT_ACCEPTED))
            return
        with self._lock:
            self._handle = handle
            is_wanted = self.is_wanted
        if is_wanted:
            handle.get_result_async().add_done_callback(self._ended)
        else:
            handle.cancel_goal_async()

    def _ended(self, future: Any) -> None:
        response = future.result()
        result = response.result
        error = int(result.error.error)
        if error != NO_ERROR:
            self._finish(LookupResult(None, error, result.error.error_string))
        elif response.status == GoalStatus.STATUS_SUCCEEDED:
            self._finish(LookupResult(result.transform))
        else:
            # tf2's server aborts with an empty transform and no error.
            self._finish(None)

    def _finish(self, result: LookupResult | None) -> None:
        with self._lock:
            on_result, self._on_result = self._on_result, None
        if on_result is not None:
            on_result(result)


class Ros2Client:
    """Sends goals of an action. Threads: any; parameters as in `Ros2Server`."""

    def __init__(self, node: RclpyNode, name: str) -> None:
        self._node = node.given
        self._client = ActionClient(
            self._node, LookupTransform, name, callback_group=ReentrantCallbackGroup()
        )
        self.native: Any = self._client
        self._opened = node.adopt(self._client.destroy)
        self._sent: WeakSet[_SentGoal] = WeakSet()
        self._never = threading.Event()

    def is_ready(self) -> bool:
        """Whether a server is connected in both directions."""
        with suppress(rclpy_implementation.RCLError, InvalidHandle):  # the context was shut down
            return bool(self._client.server_is_ready())
        return False

    def wait_ready(self, seconds: float) -> None:
        """Return after the given time: rclpy does not report new servers."""
        self._never.wait(seconds)

    def send(self, goal: LookupGoal, on_result: Callable[[LookupResult | None], None]) -> _SentGoal:
        """Send a goal; call `on_result` with its result, or with None if it ended without one."""
        message, sent = _goal_of(goal), _SentGoal(on_result)
        self._sent.add(sent)

        def send() -> None:
            try:
                future = self._client.send_goal_async(message)
            except (rclpy_implementation.RCLError, InvalidHandle):
                if sent.is_wanted:
                    raise
                return  # the client was destroyed before
            future.add_done_callback(sent.answered)

        executor = self._node.executor
        if executor is None:
            send()
        else:
            # Otherwise its thread might receive the answer before rclpy has stored the request.
            executor.create_task(send)
        return sent

    def close(self) -> None:
        """Cancel the goals, and destroy the client."""
        for sent in list(self._sent):
            sent.end()
        self._opened.close()


def _question_of(goal: Any) -> LookupGoal:
    return LookupGoal(
        goal.target_frame,
        goal.source_frame,
        _nanoseconds(goal.source_time),
        _nanoseconds(goal.timeout),
        _nanoseconds(goal.target_time),
        goal.fixed_frame,
        goal.advanced,
    )


def _goal_of(question: LookupGoal) -> Any:
    return LookupTransform.Goal(
        target_frame=question.target_frame,
        source_frame=question.source_frame,
        source_time=_time(Time, question.source_time),
        timeout=_time(Duration, question.timeout),
        target_time=_time(Time, question.target_time),
        fixed_frame=question.fixed_frame,
        advanced=question.advanced,
    )


def _message_of(result: LookupResult) -> Any:
    message = LookupTransform.Result()
    if result.transform is not None:
        message.transform = result.transform
    message.error.error = result.error
    message.error.error_string = result.error_string
    return message


def _nanoseconds(time: Any) -> int:
    return int(time.sec) * SECOND + int(time.nanosec)


def _time(kind: Any, nanoseconds: int) -> Any:
    seconds, rest = divmod(nanoseconds, SECOND)
    return kind(sec=seconds, nanosec=rest)

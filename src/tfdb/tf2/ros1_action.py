"""The action LookupTransform in ROS 1: actionlib's topics as bytes, through any ROS 1 node.

The protocol is that of https://wiki.ros.org/actionlib/DetailedDescription. Goals are accepted at
once, so each is ACTIVE until it ends as SUCCEEDED or PREEMPTED. If the cancellation comes before
the goal, the goal is RECALLED.
"""

from __future__ import annotations

import itertools
import logging
import threading
import time
from typing import TYPE_CHECKING, Any

from .lookup_action import LookupGoal, LookupResult
from .ros1_messages import (
    GoalId,
    Status,
    decode_goal,
    decode_goal_id,
    decode_result,
    encode_goal,
    encode_goal_id,
    encode_result,
    encode_status_list,
)
from .timers import call_at

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb.ros import Node

    from .lookup_action import Goal

__all__ = ["Ros1Client", "Ros1Server"]

LOGGER = logging.getLogger("tfdb.tf2")
ACTION = "tf2_msgs/LookupTransformAction"
GOAL_ID, STATUS_LIST = "actionlib_msgs/GoalID", "actionlib_msgs/GoalStatusArray"
ACTIVE, PREEMPTED, SUCCEEDED, RECALLING, RECALLED = 1, 2, 3, 7, 8
STATUS_PERIOD = 0.2  # seconds between statuses
KEPT = 5.0  # seconds for which an ended goal is listed
QUEUE = 50
# Least nanoseconds between a goal and its result. actionlib's Python client drops a result that
# arrives before its send_goal has returned, and then waits forever.
NOT_BEFORE = 10_000_000
BEFORE_CANCEL = (
    "This goal handle was canceled by the action server because its timestamp is before the"
    " timestamp of the last cancel request"
)
_numbers = itertools.count(1)


def _new_goal_id(node: Node) -> GoalId:
    """Make a unique id as actionlib does."""
    now = node.now()
    return GoalId(now, f"{node.name}-{next(_numbers)}-{now / 1e9:.9f}")


class _ServerGoal:
    """A goal of a server. Threads: any."""

    def __init__(self, server: Ros1Server, goal_id: GoalId, question: LookupGoal) -> None:
        self.question = question
        self.status: Status = Status(goal_id, ACTIVE)
        self.taken: int = time.monotonic_ns()
        """Time of its arrival, by the steady clock."""
        self.ended: float | None = None
        """Time of its end, by the steady clock."""
        self._server = server

    def succeed(self, result: LookupResult) -> None:
        """Send its result, which may be an error."""
        self._server.end(self, SUCCEEDED, result)

    def cancel(self) -> None:
        """Report the cancellation."""
        self._server.end(self, PREEMPTED, LookupResult())


NOTHING = LookupGoal("", "", 0, 0)


class Ros1Server:
    """Accepts goals from the topics of an action. Threads: any.

    Parameters
    ----------
    node
        A node of ROS 1.
    name
        Name of the action, such as `tf2_buffer_server`.
    """

    def __init__(self, node: Node, name: str) -> None:
        self._node, self._name = node, name
        self._lock = threading.Lock()
        self._goals: dict[str, _ServerGoal] = {}
        self._last_cancel = 0
        self._over = threading.Event()
        self._open: list[Any] = []

    def start(self, on_goal: Callable[[Goal], None], on_cancel: Callable[[Goal], None]) -> None:
        """Accept goals from now on; `on_cancel` is called with a goal that its client cancels."""
        node, name = self._node, self._name
        self._on_goal, self._on_cancel = on_goal, on_cancel
        self._results = node.advertise(f"{name}/result", f"{ACTION}Result", depth=QUEUE)
        self._statuses = node.advertise(f"{name}/status", STATUS_LIST, latched=True, depth=QUEUE)
        # This topic has no messages, but clients wait until it exists.
        feedback = node.advertise(f"{name}/feedback", f"{ACTION}Feedback", depth=QUEUE)
        self._open = [
            node.subscribe(f"{name}/goal", f"{ACTION}Goal", self._take_goal),
            node.subscribe(f"{name}/cancel", GOAL_ID, self._take_cancel),
            self._results,
            self._statuses,
            feedback,
        ]
        threading.Thread(target=self._run, name=f"tfdb action {name}", daemon=True).start()

    def close(self) -> None:
        """Stop accepting goals."""
        self._over.set()
        while self._open:
            self._open.pop(0).close()

    def end(self, goal: _ServerGoal, status: int, result: LookupResult, text: str = "") -> None:
        """Send the result of a goal, unless it was sent before."""
        with self._lock:
            if goal.ended is not None:
                return
            goal.ended = time.monotonic()
            goal.status = goal.status.with_status(status, text)
        due = goal.taken + NOT_BEFORE
        if due > time.monotonic_ns():
            call_at(due, lambda: self._send(goal, result))
        else:
            self._send(goal, result)

    def _send(self, goal: _ServerGoal, result: LookupResult) -> None:
        if not self._over.is_set() and not self._node.closed:
            self._results.publish(encode_result(self._node.now(), goal.status, result))
            self._publish_statuses()

    def _take_goal(self, data: bytes | memoryview, _: str) -> None:
        goal_id, question = decode_goal(data)
        if not goal_id.id:
            goal_id = _new_goal_id(self._node)
        goal = _ServerGoal(self, goal_id, question)
        with self._lock:
            there = self._goals.get(goal_id.id)
            if there is None:
                self._goals[goal_id.id] = goal
            cancelled = 0 < goal_id.stamp <= self._last_cancel
        if there is not None:
            # The goal came twice, or after its cancellation.
            if there.status.status == RECALLING:
                self.end(there, RECALLED, LookupResult())
        elif cancelled:
            self.end(goal, RECALLED, LookupResult(), BEFORE_CANCEL)
        else:
            self._on_goal(goal)
            if goal.ended is None:
                self._publish_statuses()

    def _take_cancel(self, data: bytes | memoryview, _: str) -> None:
        wanted = decode_goal_id(data)
        every = not wanted.id and wanted.stamp == 0
        with self._lock:
            goals = [
                goal
                for goal in self._goals.values()
                if every
                or goal.status.goal_id.id == wanted.id
                or 0 < goal.status.goal_id.stamp <= wanted.stamp
            ]
            if wanted.id and wanted.id not in self._goals:
                unknown = _ServerGoal(self, wanted, NOTHING)
                unknown.status = Status(wanted, RECALLING)
                self._goals[wanted.id] = unknown
            self._last_cancel = max(self._last_cancel, wanted.stamp)
        for goal in goals:
            if goal.status.status == ACTIVE:
                self._on_cancel(goal)

    def _run(self) -> None:
        while not self._node.closed:
            self._publish_statuses()
            if self._over.wait(STATUS_PERIOD):
                return

    def _publish_statuses(self) -> None:
        """Publish the statuses of all goals; drop goals that ended some time ago."""
        now = time.monotonic()
        with self._lock:
            for name, goal in list(self._goals.items()):
                if goal.status.status == RECALLING and goal.ended is None:
                    goal.ended = now
                if goal.ended is not None and goal.ended + KEPT < now:
                    del self._goals[name]
            statuses = [goal.status for goal in self._goals.values()]
        if not self._over.is_set() and not self._node.closed:
            self._statuses.publish(encode_status_list(self._node.now(), statuses))


class _SentGoal:
    """A goal of a client. Threads: any."""

    def __init__(self, client: Ros1Client, goal_id: GoalId) -> None:
        self._client, self._goal_id = client, goal_id

    def forget(self) -> None:
        """Stop waiting for its result, and cancel it at the server."""
        self._client.forget(self._goal_id.id)


class Ros1Client:
    """Sends goals to the topics of an action. Threads: any; parameters as in `Ros1Server`."""

    native = None

    def __init__(self, node: Node, name: str) -> None:
        self._node = node
        self._changed = threading.Condition()
        self._waiting: dict[str, Callable[[LookupResult | None], None]] = {}
        self._server = ""  # the node that sent the last status
        # ROS 1 nodes report their connected peers.
        self._goals: Any = node.advertise(f"{name}/goal", f"{ACTION}Goal", depth=QUEUE)
        self._cancels: Any = node.advertise(f"{name}/cancel", GOAL_ID, depth=QUEUE)
        self._results: Any = node.subscribe(f"{name}/result", f"{ACTION}Result", self._on_result)
        self._statuses = node.subscribe(f"{name}/status", STATUS_LIST, self._on_status)

    def is_ready(self) -> bool:
        """Whether a server is connected in both directions."""
        server = self._server
        return bool(server) and all(
            server in names
            for names in (
                self._goals.subscribers,
                self._cancels.subscribers,
                self._results.publishers,
            )
        )

    def wait_ready(self, seconds: float) -> None:
        """Return after a message of a server, or after the given time."""
        with self._changed:
            self._changed.wait(seconds)

    def send(self, goal: LookupGoal, on_result: Callable[[LookupResult | None], None]) -> _SentGoal:
        """Send a goal; call `on_result` with its result, or with None if it ended without one."""
        goal_id = _new_goal_id(self._node)
        with self._changed:
            self._waiting[goal_id.id] = on_result
        self._goals.publish(encode_goal(self._node.now(), goal_id, goal))
        return _SentGoal(self, goal_id)

    def forget(self, goal_id: str) -> Callable[[LookupResult | None], None] | None:
        """Stop waiting for a goal's result, and cancel it at the server. Return its callback."""
        with self._changed:
            waited = self._waiting.pop(goal_id, None)
        if waited is not None and not self._node.closed:
            self._cancels.publish(encode_goal_id(GoalId(0, goal_id)))
        return waited

    def close(self) -> None:
        """Cancel the goals, and close the topics."""
        for goal_id in tuple(self._waiting):
            if (on_result := self.forget(goal_id)) is not None:
                on_result(None)
        for opened in (self._statuses, self._results, self._cancels, self._goals):
            opened.close()

    def _on_status(self, _: bytes | memoryview, publisher: str) -> None:
        with self._changed:
            self._server = publisher
            self._changed.notify_all()

    def _on_result(self, data: bytes | memoryview, _: str) -> None:
        status, result = decode_result(data)
        with self._changed:
            on_result = self._waiting.pop(status.goal_id.id, None)
        if on_result is not None:
            on_result(result if status.status == SUCCEEDED else None)

"""`BufferClient`: lookups in another node's buffer, by the action LookupTransform."""

from __future__ import annotations

import logging
import threading
from functools import cached_property
from typing import TYPE_CHECKING, Any

from tfdb.data.argument_checks import check_name
from tfdb.data.stamps import shown
from tfdb.ros import node_for
from tfdb.ros.choose_node import in_rospy
from tfdb.ros.ros_messages import lookup_action_client
from tfdb.ros.times import SECOND, duration, nanoseconds

from .buffer_interface import BufferInterface
from .deadlines import deadline_in, wait_until
from .exceptions import InvalidArgumentException, TimeoutException, TransformException
from .handles import native_node
from .lookup_action import NO_ERROR, LookupGoal, action_name, client_in, exception_of

if TYPE_CHECKING:
    from tfdb.ros import Node

    from .deadlines import Deadline
    from .lookup_action import LookupResult

__all__ = ["BufferClient"]

LOGGER = logging.getLogger("tfdb.tf2")
PADDING = 2 * SECOND
LOOK_AGAIN = 0.01  # seconds between two checks of connections, as in actionlib
WRONG = "Something is likely wrong with the server."
LATE = (
    "The LookupTransform goal sent to the BufferServer did not come back in the specified time. "
    + WRONG
)
NOT_SUCCEEDED = (
    "The LookupTransform goal sent to the BufferServer did not come back with SUCCEEDED status. "
    + WRONG
)
NO_RESULT = f"The BufferServer returned None for result! {WRONG}"
NOT_READY = "The BufferServer is not ready."
DESTROYED = "The BufferClient is destroyed: make another."
SENDABLE = {"ros1": (0, (1 << 32) - 1), "ros2": (-(1 << 31), (1 << 31) - 1)}
"""The smallest and the largest seconds of a time in a message."""
PARAMETERS = ("ns", "check_frequency", "timeout_padding")


class BufferClient(BufferInterface):
    """Looks up transforms in the buffer of another node.

    `BufferClient(ns, check_frequency=None, timeout_padding=2 s)` as in ROS 1, or
    `BufferClient(node, ns, check_frequency=10.0, timeout_padding=2 s)` as in ROS 2.

    Any thread may call it, and several may wait at once.

    Parameters
    ----------
    node
        A node of rclpy or `tfdb.ros`. None: rospy's node; after `rclpy.init` a new rclpy node;
        otherwise a node without ROS.
    ns
        Name of the server's action, such as `tf2_buffer_server`.
    check_frequency
        Accepted as in tf2, without effect.
    timeout_padding
        A duration: how much longer than its timeout a lookup may take. None: 2 s.
    """

    def __init__(self, *given: Any, node: Any = None, **named: Any) -> None:
        super().__init__()
        if given and not isinstance(given[0], str):
            node, *rest = given
            if not rest and "ns" not in named:
                raise TypeError(f"the first argument is ns, a str, or a node, got {shown(node)}")
            given = tuple(rest)
        arguments = _arguments(given, named)
        self._node: Node = node_for(node)
        self.node: Any = native_node(self._node)
        """The node of rclpy or `tfdb.ros` that sends the lookups."""
        padding = arguments.get("timeout_padding")
        self.timeout_padding = padding
        """The argument of this name."""
        self._padding = PADDING if padding is None else duration(padding, None, "timeout_padding")
        if arguments.get("check_frequency") is not None and self._node.flavor == "ros1":
            LOGGER.warning("Argument check_frequency is deprecated and should not be used.")
        self.check_frequency: Any = arguments.get("check_frequency")
        """The argument of this name."""
        self._ns = action_name(arguments["ns"])
        self._transport = client_in(self._node, self._ns)
        self._is_destroyed = False
        if self._node.flavor == "ros2":
            self.action_client: Any = self._transport.native
            """In a node of rclpy: rclpy's ActionClient."""

    @cached_property
    def client(self) -> Any:
        """In rospy: actionlib's SimpleActionClient of the same server, created at the first use.

        Raises AttributeError unless the process is a node of rospy.
        """
        if not in_rospy():
            raise AttributeError("BufferClient.client is actionlib's: it needs a node of rospy")
        return lookup_action_client(self._ns)

    def wait_for_server(self, timeout: Any = None) -> bool:
        """Wait for a server; return whether one is connected.

        `timeout` is a duration; None or 0: no limit.
        """
        limit = self._nanoseconds(timeout)
        return self._wait_ready(self._deadline(limit) if limit else None)

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: Any, timeout: Any = None
    ) -> Any:
        """T[target_frame<-source_frame] at a time, as soon as the server has it.

        Parameters
        ----------
        target_frame, source_frame
            Frame names.
        time
            Time of the transform; 0: the latest common time.
        timeout
            A duration: how long the server may wait for it; None: no wait.

        Returns
        -------
        geometry_msgs.msg.TransformStamped
            Maps points of the source into the target: p_target = T p_source.

        Raises the exception of the server's lookup, TimeoutException without an answer, or
        InvalidArgumentException for a time that a message cannot hold.
        """
        goal = LookupGoal(
            check_name("target_frame", target_frame),
            check_name("source_frame", source_frame),
            self._time(time, "time"),
            self._nanoseconds(timeout),
        )
        return self._ask(goal)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Any = None,
    ) -> Any:
        """T[target_frame at target_time <- source_frame at source_time], through `fixed_frame`.

        Otherwise as `lookup_transform`.
        """
        goal = LookupGoal(
            check_name("target_frame", target_frame),
            check_name("source_frame", source_frame),
            self._time(source_time, "source_time"),
            self._nanoseconds(timeout),
            self._time(target_time, "target_time"),
            check_name("fixed_frame", fixed_frame),
            advanced=True,
        )
        return self._ask(goal)

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Any = None,
        return_debug_tuple: bool = False,
    ) -> Any:
        """Whether `lookup_transform` succeeds.

        With `return_debug_tuple`, return (success, reason).
        """
        try:
            self.lookup_transform(target_frame, source_frame, time, timeout)
        except TransformException as error:
            return (False, str(error)) if return_debug_tuple else False
        return (True, "") if return_debug_tuple else True

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
        """Whether `lookup_transform_full` succeeds."""
        asked = (target_frame, target_time, source_frame, source_time, fixed_frame)
        try:
            self.lookup_transform_full(*asked, timeout)
        except TransformException as error:
            return (False, str(error)) if return_debug_tuple else False
        return (True, "") if return_debug_tuple else True

    def destroy(self) -> None:
        """Close the client. Lookups that wait, and later ones, raise TransformException."""
        self._is_destroyed = True
        self._transport.close()

    def _time(self, time: Any, name: str) -> int:
        """Return the nanoseconds of a time that a message of this ROS can hold."""
        found = nanoseconds(time)
        first, last = SENDABLE[self._node.flavor]
        if not first <= found // SECOND <= last:
            said = f"{name} {found} ns cannot be sent: a time of {self._node.flavor.upper()} has "
            raise InvalidArgumentException(f"{said}{first} to {last} seconds", stamp=found)
        return found

    def _nanoseconds(self, timeout: Any) -> int:
        return 0 if timeout is None else duration(timeout, self._node.flavor, "timeout")

    def _deadline(self, limit: int) -> Deadline:
        """Return the deadline after `limit` nanoseconds; ROS 2 uses wall time, as upstream."""
        return deadline_in(limit, self._node if self._node.flavor == "ros1" else None)

    def _ask(self, goal: LookupGoal) -> Any:
        limit = goal.timeout + self._padding
        deadline = self._deadline(limit) if limit > 0 else None
        if not self._wait_ready(deadline):
            self._check_open(goal)
            text = LATE if self._node.flavor == "ros1" else NOT_READY
            raise TimeoutException(text, target=goal.target_frame, source=goal.source_frame)
        over = threading.Event()
        results: list[LookupResult | None] = []

        def take(result: LookupResult | None) -> None:
            results.append(result)
            over.set()

        sent = self._transport.send(goal, take)
        node = self._node
        watch = node.on_clock(lambda _: over.set() if node.closed else None)
        try:
            wait_until(over, deadline)
        finally:
            watch.close()
            sent.forget()
        self._check_open(goal)
        if not results:
            raise TimeoutException(LATE, target=goal.target_frame, source=goal.source_frame)
        return _transform_of(results[0])

    def _check_open(self, goal: LookupGoal) -> None:
        if self._is_destroyed:
            raise TransformException(DESTROYED, target=goal.target_frame, source=goal.source_frame)

    def _wait_ready(self, deadline: Deadline | None) -> bool:
        while not self._is_destroyed:
            if self._transport.is_ready():
                return True
            if self._node.closed or (deadline is not None and deadline.left() == 0):
                return False
            self._transport.wait_ready(LOOK_AGAIN)
        return False


def _arguments(given: tuple[Any, ...], named: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of a client by name. Raises TypeError."""
    unknown = [name for name in named if name not in PARAMETERS]
    twice = [name for name in PARAMETERS[: len(given)] if name in named]
    if unknown:
        wrong = f"it has no argument {unknown[0]!r}"
    elif len(given) > len(PARAMETERS):
        wrong = f"got {len(given)} arguments by position"
    elif twice:
        wrong = f"{twice[0]} is given twice"
    elif not given and "ns" not in named:
        wrong = "ns, the name of the server's action, is missing"
    else:
        return {**dict(zip(PARAMETERS, given, strict=False)), **named}
    raise TypeError(
        "BufferClient takes (ns, check_frequency, timeout_padding), or a node before these: "
        f"{wrong}"
    )


def _transform_of(result: LookupResult | None) -> Any:
    """Return the transform of a result, or raise its error."""
    if result is None:
        raise TimeoutException(NOT_SUCCEEDED)
    if result.error != NO_ERROR:
        raise exception_of(result)
    if result.transform is None:
        raise TransformException(NO_RESULT)
    return result.transform

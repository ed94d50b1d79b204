"""The action LookupTransform: goals and results, and their transport in ROS 1 and ROS 2.

`BufferServer` and `BufferClient` use only this file. `ros1_action.py` and `ros2_action.py`
implement the transports.
"""

# ruff: noqa: PLC0415  (they import this file, and a ROS)

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from tfdb.data.argument_checks import check_name
from tfdb.data.errors import NotSupported

from .exceptions import (
    BackwardExtrapolationException,
    ConnectivityException,
    ExtrapolationException,
    ForwardExtrapolationException,
    InvalidArgumentException,
    LookupException,
    NoDataForExtrapolationException,
    TimeoutException,
    TransformException,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb.data.errors import TfdbError
    from tfdb.ros import Node
    from tfdb.ros.rclpy_node import RclpyNode

__all__ = [
    "NO_ERROR",
    "ClientTransport",
    "Goal",
    "LookupGoal",
    "LookupResult",
    "SentGoal",
    "ServerTransport",
    "action_name",
    "client_in",
    "code_of",
    "exception_of",
    "server_in",
]

NO_ERROR, TRANSFORM_ERROR = 0, 6
CODES: dict[int, type[TransformException]] = {
    1: LookupException,
    2: ConnectivityException,
    3: ExtrapolationException,
    4: InvalidArgumentException,
    5: TimeoutException,
    TRANSFORM_ERROR: TransformException,
    # These codes exist only in ROS 2's C++, not in the message.
    7: BackwardExtrapolationException,
    8: ForwardExtrapolationException,
    9: NoDataForExtrapolationException,
}


@dataclass(frozen=True, slots=True)
class LookupGoal:
    """A goal: the fields of tf2_msgs/LookupTransformGoal, times in nanoseconds."""

    target_frame: str
    source_frame: str
    source_time: int
    """Time of the transform; 0: the latest common time."""
    timeout: int
    """How long the server may wait for an answer."""
    target_time: int = 0
    fixed_frame: str = ""
    advanced: bool = False
    """Whether `target_time` and `fixed_frame` are used."""

    @property
    def arguments(self) -> tuple[Any, ...]:
        """Arguments of `lookup_transform_full` if `advanced`, otherwise of `lookup_transform`."""
        source = self.source_frame, self.source_time
        if self.advanced:
            return self.target_frame, self.target_time, *source, self.fixed_frame
        return self.target_frame, *source


@dataclass(frozen=True, slots=True)
class LookupResult:
    """A result: the fields of tf2_msgs/LookupTransformResult."""

    transform: Any = None
    """A TransformStamped, T[target_frame<-source_frame]; None if there was an error."""
    error: int = NO_ERROR
    """A code of tf2_msgs/TF2Error."""
    error_string: str = ""


def action_name(ns: Any) -> str:
    """Return the name of an action. Raises TypeError, InvalidArgumentException."""
    if not check_name("ns", ns):
        text = "ns is the name of an action, such as tf2_buffer_server, got ''"
        raise InvalidArgumentException(text, value=ns)
    return str(ns)


def code_of(error: TfdbError) -> int:
    """Code of an exception, as tf2_msgs/TF2Error names them."""
    found = (code for code, kind in CODES.items() if code < TRANSFORM_ERROR)
    return next((code for code in found if isinstance(error, CODES[code])), TRANSFORM_ERROR)


def exception_of(result: LookupResult) -> TransformException:
    """Exception of a result that is an error."""
    return CODES.get(result.error, TransformException)(result.error_string)


class Goal(Protocol):
    """A goal that a server has accepted. Any thread may call it; the first call counts."""

    question: LookupGoal

    def succeed(self, result: LookupResult) -> None:
        """Send its result, which may be an error."""

    def cancel(self) -> None:
        """Report the cancellation."""


class ServerTransport(Protocol):
    """Receives goals. Any thread may call it."""

    def start(self, on_goal: Callable[[Goal], None], on_cancel: Callable[[Goal], None]) -> None:
        """Accept goals from now on; `on_cancel` is called with a goal that its client cancels.

        Both functions are called in threads of the transport, and must not wait.
        """

    def close(self) -> None:
        """Stop accepting goals."""


class SentGoal(Protocol):
    """A goal that a client has sent. Any thread may call it."""

    def forget(self) -> None:
        """Stop waiting for the result, and cancel the goal at the server."""


class ClientTransport(Protocol):
    """Sends goals. Any thread may call it."""

    native: Any
    """The action client of rclpy; None in ROS 1."""

    def is_ready(self) -> bool:
        """Whether a server is connected in both directions."""

    def wait_ready(self, seconds: float) -> None:
        """Return after a possible change of `is_ready`, or after the given time."""

    def send(self, goal: LookupGoal, on_result: Callable[[LookupResult | None], None]) -> SentGoal:
        """Send a goal; call `on_result` with its result, or with None if it ended without one."""

    def close(self) -> None:
        """Cancel the goals, which end without a result, and close the topics."""


def server_in(node: Node, ns: str) -> ServerTransport:
    """Return the server transport of an action in a node."""
    if node.flavor == "ros1":
        from .ros1_action import Ros1Server

        return Ros1Server(node, ns)
    ours = _of_rclpy(node)
    from .ros2_action import Ros2Server

    return Ros2Server(ours, ns)


def client_in(node: Node, ns: str) -> ClientTransport:
    """Return the client transport of an action in a node."""
    if node.flavor == "ros1":
        from .ros1_action import Ros1Client

        return Ros1Client(node, ns)
    ours = _of_rclpy(node)
    from .ros2_action import Ros2Client

    return Ros2Client(ours, ns)


def _of_rclpy(node: Node) -> RclpyNode:
    if not hasattr(node, "given"):
        raise NotSupported(
            f"an action of ROS 2 needs a node of rclpy, not {type(node).__name__} {node.name}"
        )
    from tfdb.ros.rclpy_node import RclpyNode

    if not isinstance(node, RclpyNode):
        raise NotSupported(
            f"an action of ROS 2 needs a node of rclpy, not {type(node).__name__} {node.name}"
        )
    return node

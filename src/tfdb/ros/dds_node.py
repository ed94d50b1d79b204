"""A ROS 2 node in a graph over DDS, without ROS packages."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.errors import NotSupported

from .names import anonymous
from .ros2_names import Ros2Names, domain_of
from .wire_node import WireNode

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["DdsNode"]


class DdsNode(WireNode):
    """A node in a graph over DDS, with topics and a clock. It uses the package cyclonedds.

    It sends and receives `tf2_msgs/TFMessage`, `rosgraph_msgs/Clock` and
    `diagnostic_msgs/DiagnosticArray`. Messages of publishers with another type hash are refused,
    counted and logged once. Callbacks get the publisher's gid in hexadecimal digits; for messages
    of this node, its name.

    Threads: any may call anything. Each subscription has a thread, which calls its callback.

    Parameters
    ----------
    name
        Name without namespace; None: a unique one.
    domain
        ROS domain; None: ROS_DOMAIN_ID, or 0.
    arguments
        Arguments of the program, for remappings after `--ros-args`; None: `sys.argv`.

    Raises NotSupported without cyclonedds, ConnectionError if DDS does not start, InvalidName,
    InvalidArgument, also for an invalid CYCLONEDDS_URI.
    """

    def __init__(
        self,
        name: str | None = None,
        *,
        domain: int | None = None,
        arguments: Sequence[str] | None = None,
    ) -> None:
        try:
            from .dds_graph import DdsGraph  # noqa: PLC0415 - an extra
        except ImportError as error:
            text = f"DDS without ROS needs cyclonedds: pip install 'tfdb[dds]' ({error});"
            text += " PyPI has it for Linux on x86_64"
            raise NotSupported(text, reason="cyclonedds") from error
        names = Ros2Names(anonymous("tfdb") if name is None else name, arguments)
        super().__init__(names, DdsGraph(names, domain_of("" if domain is None else str(domain))))

"""A ROS 2 node in a graph of rmw_zenoh, without ROS packages."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.errors import NotSupported

from .names import anonymous
from .ros2_names import Ros2Names, domain_of
from .wire_node import WireNode

if TYPE_CHECKING:
    from collections.abc import Sequence

__all__ = ["ZenohNode"]


class ZenohNode(WireNode):
    """A node in a graph of rmw_zenoh, with topics and a clock. It uses the package eclipse-zenoh.

    It sends and receives `tf2_msgs/TFMessage`, `rosgraph_msgs/Clock` and
    `diagnostic_msgs/DiagnosticArray`. Messages with an unexpected type hash or attachment are
    refused, counted and logged once.

    Threads: any may call anything. Each subscription has a thread, which calls its callback.

    Parameters
    ----------
    name
        Name without namespace; None: a unique one.
    domain
        ROS domain; None: ROS_DOMAIN_ID, or 0.
    router
        Endpoint of the Zenoh router, such as `tcp/10.0.0.1:7447`. None: the configuration in
        ZENOH_SESSION_CONFIG_URI, or the router at tcp/localhost:7447. ZENOH_CONFIG_OVERRIDE changes
        either.
    arguments
        Arguments of the program, for remappings after `--ros-args`; None: `sys.argv`.

    Raises NotSupported without eclipse-zenoh, ConnectionError without a router, InvalidName,
    InvalidArgument.
    """

    def __init__(
        self,
        name: str | None = None,
        *,
        domain: int | None = None,
        router: str | None = None,
        arguments: Sequence[str] | None = None,
    ) -> None:
        try:
            from .zenoh_graph import ZenohGraph  # noqa: PLC0415 - an extra
        except ImportError as error:
            text = f"rmw_zenoh without ROS needs eclipse-zenoh: pip install 'tfdb[net]' ({error})"
            raise NotSupported(text, reason="eclipse-zenoh") from error
        names = Ros2Names(anonymous("tfdb") if name is None else name, arguments)
        number = domain_of("" if domain is None else str(domain))
        super().__init__(names, ZenohGraph(names, number, router))

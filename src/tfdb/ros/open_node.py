"""Opens a node of ROS 1 or ROS 2 for a command."""

# ruff: noqa: PLC0415  (a ROS is imported only by those who use it)

from __future__ import annotations

import os
from contextlib import contextmanager
from typing import TYPE_CHECKING, Literal

from tfdb.data.errors import InvalidArgument, InvalidName, NotSupported

from .ros2_names import domain_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from .node import Flavor, Node

    Wire = Literal["zenoh", "dds"]

__all__ = ["open_node"]

ZENOH = "rmw_zenoh_cpp"
"""Value of RMW_IMPLEMENTATION for a graph over Zenoh."""


@contextmanager
def open_node(
    side: Flavor,
    name: str,
    *,
    where: str = "",
    arguments: Sequence[str] = (),
    without_ros: Wire | None = None,
) -> Iterator[Node]:
    """Open a node of ROS 1 or ROS 2 that ends with the context.

    Parameters
    ----------
    side
        `ros1`: a `TcprosNode`, which needs no ROS package. `ros2`: a `RclpyNode`, which receives
        messages in one thread and spins its rclpy node in another. If rclpy is not installed and
        RMW_IMPLEMENTATION is rmw_zenoh_cpp: a `ZenohNode`.
    name
        Name of the node, without namespace; `arguments` may replace it.
    where
        URI of the ROS 1 master, or ROS 2 domain; empty: that of the environment.
    arguments
        ROS arguments: `from:=to` and `__name:=x` in ROS 1, all after `--ros-args` in ROS 2.
    without_ros
        For `ros2`: `zenoh` opens a `ZenohNode`, `dds` a `DdsNode`.

    Raises NoMaster; ConnectionError without a Zenoh router; NotSupported without rclpy or tf2_msgs,
    or the package that `without_ros` needs; InvalidName; InvalidArgument for an invalid domain or
    argument.
    """
    if side == "ros1":
        from .tcpros_node import TcprosNode

        with TcprosNode(name, master=where or None, arguments=arguments) as ros1_node:
            yield ros1_node
    else:
        with _MAKERS[without_ros](name, where, arguments) as ros2_node:
            yield ros2_node


@contextmanager
def _zenoh_node(name: str, where: str, arguments: Sequence[str]) -> Iterator[Node]:
    from .zenoh_node import ZenohNode

    with ZenohNode(name, domain=domain_of(where), arguments=arguments) as node:
        yield node


@contextmanager
def _dds_node(name: str, where: str, arguments: Sequence[str]) -> Iterator[Node]:
    from .dds_node import DdsNode

    with DdsNode(name, domain=domain_of(where), arguments=arguments) as node:
        yield node


@contextmanager
def _ros2_node(name: str, where: str, arguments: Sequence[str]) -> Iterator[Node]:
    try:
        import rclpy
        import tf2_msgs.msg  # noqa: F401
        from rclpy.exceptions import InvalidNodeNameException
        from rclpy.signals import SignalHandlerOptions

        from .rclpy_node import RclpyNode
    except ImportError as error:
        if os.environ.get("RMW_IMPLEMENTATION") == ZENOH:
            with _zenoh_node(name, where, arguments) as node:
                yield node
            return
        raise NotSupported(
            f"ROS 2 needs rclpy and tf2_msgs, and this Python does not find them ({error}): source"
            " the setup.bash of a ROS 2 that has this Python's version. Without ROS, use ros2+dds:;"
            f" for a graph of rmw_zenoh use ros2+zenoh:, or set RMW_IMPLEMENTATION={ZENOH}"
        ) from error
    domain = domain_of(where) if where else None
    context = rclpy.Context()
    # The program handles Ctrl-C.
    signals = SignalHandlerOptions.NO
    try:
        rclpy.init(
            args=[*arguments],
            context=context,
            domain_id=domain,
            signal_handler_options=signals,
        )
    except (RuntimeError, ValueError) as error:
        raise InvalidArgument(f"ROS 2 does not start: {error}", value=where) from error
    try:
        try:
            theirs = rclpy.create_node(
                name, context=context, enable_rosout=False, start_parameter_services=False
            )
        except InvalidNodeNameException as error:
            raise InvalidName(f"{name!r} is not a valid node name: {error}", value=name) from error
        # The clock and the services of the node need an executor.
        node = RclpyNode(theirs, own_thread=True)
        spinning = node.spin()
        try:
            yield node
        finally:
            node.close()
            spinning.join()
            theirs.destroy_node()
    finally:
        context.try_shutdown()


_MAKERS = {None: _ros2_node, "zenoh": _zenoh_node, "dds": _dds_node}

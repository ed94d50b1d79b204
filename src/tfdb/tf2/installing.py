"""`install()`: programs that import tf2's packages get those of tfdb."""

from __future__ import annotations

import sys
from importlib import import_module
from importlib.machinery import ModuleSpec
from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING, Any

from tfdb.errors import InvalidArgument

from . import exceptions, msgs, ros_messages

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

__all__ = ["install"]

FILES_OF_TF2_ROS = (
    "buffer",
    "buffer_client",
    "buffer_interface",
    "static_transform_broadcaster",
    "transform_broadcaster",
    "transform_listener",
)
MESSAGE_PACKAGES = ("builtin_interfaces", "geometry_msgs", "sensor_msgs", "std_msgs", "tf2_msgs")
INSTALLED = "__tfdb__"


def install() -> None:
    """Let this process import tfdb where it asks for tf2.

    From then on `tf2_py`, `tf2_ros`, `tf2_geometry_msgs`, `tf2_sensor_msgs` and ROS 1's `tf`, with
    their submodules, are those of `tfdb.tf2`. Where no ROS is installed at all, the messages that
    they take and return can be imported too (`geometry_msgs.msg` and its kin, `rclpy.time`,
    `rclpy.duration`): they are those of `tfdb.tf2.msgs`. Calling it again does nothing.

    `python -m tfdb.tf2 PROGRAM` calls it and runs a program as it is.

    Raises
    ------
    InvalidArgument
        One of these packages has been imported before: it would be of two minds. Nothing was done.
    """
    if hasattr(sys.modules.get("tf2_ros"), INSTALLED):
        return
    modules = _modules()
    if not any(find_spec(name) for name in ("rospy", "rclpy", "geometry_msgs")):
        modules |= _stand_ins()
    taken = sorted(name for name in modules if name in sys.modules)
    if taken:
        raise InvalidArgument(
            f"{', '.join(taken)} was imported before: call tfdb.tf2.install() ahead of that",
            value=taken,
        )
    sys.modules.update(modules)
    # Whether there are messages of a ROS may have been looked at before.
    ros_messages.look_again()


def _module(name: str, members: Mapping[str, Any], *, package: bool = False) -> ModuleType:
    module = ModuleType(name, f"`{name}` by tfdb.")
    module.__spec__ = ModuleSpec(name, None, is_package=package)
    if package:
        module.__path__ = []
    vars(module).update(members)
    setattr(module, INSTALLED, True)
    module.__dict__["__all__"] = sorted(members)
    return module


def _members(of: Any, names: Iterable[str]) -> dict[str, Any]:
    return {name: getattr(of, name) for name in names}


def _modules() -> dict[str, ModuleType]:
    """Make the modules of tf2's packages, by name."""
    from . import tf1  # noqa: PLC0415 - few programs need it

    ours = import_module("tfdb.tf2")
    core = {"BufferCore": ours.BufferCore, **_members(exceptions, exceptions.__all__)}
    made = {
        "tf2_py": _module("tf2_py", core, package=True),
        "tf2_py._tf2": _module("tf2_py._tf2", core),
    }
    # Programs take it from any of tf2_ros' files, which import it.
    stamped = ros_messages.message_class("TransformStamped")
    everything = {**core, "TransformStamped": stamped}
    for file in FILES_OF_TF2_ROS:
        source = import_module(f"tfdb.tf2.{file}")
        members = _members(source, source.__all__)
        everything |= members
        members = {**members, "TransformStamped": stamped, "BufferInterface": ours.BufferInterface}
        made[f"tf2_ros.{file}"] = _module(f"tf2_ros.{file}", members)
    extra = ("BufferServer", "MessageFilter", "FilterFailureReason", "TransformableResult")
    everything |= _members(ours, extra)
    made["tf2_ros"] = _module("tf2_ros", everything, package=True)
    for name in ("tf2_geometry_msgs", "tf2_sensor_msgs"):
        source = import_module(f"tfdb.tf2.{name}")
        members = _members(source, source.__all__)
        made[name] = _module(name, members, package=True)
        made[f"{name}.{name}"] = _module(f"{name}.{name}", members)
        for each in (made[name], made[f"{name}.{name}"]):
            if hasattr(source, "__getattr__"):
                vars(each)["__getattr__"] = source.__getattr__
    made["tf"] = _module("tf", _members(tf1, tf1.__all__), package=True)
    vars(made["tf"])["__getattr__"] = tf1.__getattr__
    for file in ("listener", "broadcaster"):
        source = import_module(f"tfdb.tf2.tf1.{file}")
        made[f"tf.{file}"] = _module(f"tf.{file}", _members(source, source.__all__))
    if find_spec("transformations") is not None:
        made["tf.transformations"] = import_module("tfdb.tf2.tf1.transformations")
    for name, module in made.items():
        parent, _, child = name.rpartition(".")
        if parent:
            vars(made[parent]).setdefault(child, module)
    return made


def _stand_ins() -> dict[str, ModuleType]:
    """Make the modules of messages and times for a machine without any ROS, by name."""
    from . import stand_ins  # noqa: PLC0415 - most machines have a ROS, or need none

    made = {"rclpy": _module("rclpy", {}, package=True)}
    for name, kind in (("time", stand_ins.Time), ("duration", stand_ins.Duration)):
        made[f"rclpy.{name}"] = _module(f"rclpy.{name}", {kind.__name__: kind})
    of_package: dict[str, dict[str, Any]] = {package: {} for package in MESSAGE_PACKAGES}
    for kind in vars(msgs).values():
        package, _, name = getattr(kind, "_type", "").partition("/")
        if package in of_package:
            of_package[package][name] = kind
    for package, members in of_package.items():
        made[package] = _module(package, {}, package=True)
        made[f"{package}.msg"] = _module(f"{package}.msg", members)
    for name, module in made.items():
        parent, _, child = name.rpartition(".")
        if parent:
            setattr(made[parent], child, module)
    return made

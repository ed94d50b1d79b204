"""`install()`: imports of tf2's packages return modules of tfdb."""

from __future__ import annotations

import sys
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec
from types import ModuleType
from typing import TYPE_CHECKING, Any

from tfdb.data.errors import InvalidArgument
from tfdb.ros import msgs, ros_messages

from . import stand_ins
from .exports import import_all, statements_of

if TYPE_CHECKING:
    from collections.abc import Mapping

__all__ = ["install"]

MESSAGE_PACKAGES = ("builtin_interfaces", "geometry_msgs", "sensor_msgs", "std_msgs", "tf2_msgs")
INSTALLED = "__tfdb__"


def install() -> None:
    """Make this process import tfdb in place of tf2.

    After the call `tf2_py`, `tf2_ros`, `tf2_geometry_msgs`, `tf2_sensor_msgs`, `tf2_kdl` and ROS
    1's `tf`, with their submodules, are those of `tfdb.tf2`. They export all names of the real
    packages, including imported ones such as `tf2_ros.Duration`. `tf.msg` and `tf.srv` are the real
    ones if the package tf is installed. Without ROS, its messages can be imported as well:
    `geometry_msgs.msg` and the like, `rclpy.time` and `rclpy.duration` are those of
    `tfdb.tf2.msgs`. A second call does nothing.

    `python -m tfdb.tf2 PROGRAM` calls it and runs an unchanged program.

    Raises
    ------
    InvalidArgument
        One of these packages was already imported. Nothing is changed.
    """
    if any(isinstance(each, _Finder) for each in sys.meta_path):
        return
    without_ros = not any(find_spec(name) for name in ("rospy", "rclpy", "geometry_msgs"))
    made = _stand_ins() if without_ros else {}
    flavor = ros_messages.installed() or ("ros1" if find_spec("rospy") else "ros2")
    finder = _Finder(statements_of(flavor))
    taken = sorted(name for name in (*finder.statements, *made) if name in sys.modules)
    if taken:
        raise InvalidArgument(
            f"{', '.join(taken)} is already imported: call tfdb.tf2.install() before that import",
            value=taken,
        )
    sys.modules.update(made)
    sys.meta_path.insert(0, finder)
    # The search for installed ROS messages may be cached.
    ros_messages.clear_import_caches()


class _Finder(MetaPathFinder, Loader):
    """Makes the modules of tf2's packages when they are imported."""

    def __init__(self, statements: Mapping[str, str]) -> None:
        self.statements = dict(statements)
        """Import statements of each module, by its name."""
        real = PathFinder.find_spec("tf")
        # Other submodules, such as generated messages, are searched there.
        self._real_tf = list(real.submodule_search_locations or ()) if real else []
        if self._real_tf:
            del self.statements["tf.msg"]
            if find_spec("transformations") is None:
                del self.statements["tf.transformations"]

    def find_spec(self, fullname: str, *_: Any) -> ModuleSpec | None:
        """Return the import spec of a module that this finder makes, otherwise None."""
        if fullname not in self.statements:
            return None
        spec = ModuleSpec(fullname, self, is_package="." not in fullname)
        if fullname == "tf":
            spec.submodule_search_locations = self._real_tf
        return spec

    def exec_module(self, module: ModuleType) -> None:
        """Set the members of a module."""
        name = module.__name__
        found, missing = import_all(self.statements[name])
        vars(module).update(found)
        setattr(module, INSTALLED, True)
        module.__doc__ = f"`{name}` by tfdb."

        def find(given: str) -> Any:
            why = f": {missing[given]}" if given in missing else ""
            raise AttributeError(f"module {name!r} has no attribute {given!r}{why}")

        module.__dict__["__getattr__"] = find


def _module(name: str, members: Mapping[str, Any], *, package: bool = False) -> ModuleType:
    module = ModuleType(name, f"`{name}` by tfdb.")
    module.__spec__ = ModuleSpec(name, None, is_package=package)
    if package:
        module.__path__ = []
    vars(module).update(members)
    setattr(module, INSTALLED, True)
    module.__dict__["__all__"] = sorted(members)
    return module


def _stand_ins() -> dict[str, ModuleType]:
    """Make the modules of messages and times for a machine without ROS, by name."""
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

"""Names, arguments and types of ROS 2 for nodes without rclpy."""

from __future__ import annotations

import os
import re
import sys
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tfdb.data.argument_checks import check_name
from tfdb.data.errors import InvalidArgument, InvalidName

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["Kind", "Ros2Names", "domain_of", "kind_of"]

LAST_DOMAIN = 232  # the ports of a higher one would be above 65535
_TOKEN = r"[A-Za-z_][A-Za-z0-9_]*"  # noqa: S105 - of a name
_BASE = re.compile(_TOKEN, re.ASCII)
_NAME = re.compile(rf"(?:~/|/)?{_TOKEN}(?:/{_TOKEN})*", re.ASCII)
_NAMESPACE = re.compile(rf"/|(?:/{_TOKEN})+", re.ASCII)
_HASHES = {
    "tf2_msgs/TFMessage": "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    "rosgraph_msgs/Clock": "692f7a66e93a3c83e71765d033b60349ba68023a8c689a79e48078bcb5c58564",
    "diagnostic_msgs/DiagnosticArray": (
        "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e"
    ),
}


@dataclass(frozen=True)
class Kind:
    """A message type, as ROS 2 nodes describe it to each other."""

    name: str
    """Such as `tf2_msgs/TFMessage`."""
    wire: str
    """Such as `tf2_msgs::msg::dds_::TFMessage_`."""
    hash: str
    """Hash of its definition, as RIHS01."""


def kind_of(name: str) -> Kind:
    """Return the type `package/Name` or `package/msg/Name`. Raises InvalidArgument if unknown."""
    short = check_name("kind", name).replace("/msg/", "/")
    if short not in _HASHES:
        known = ", ".join(sorted(_HASHES))
        text = f"the type {name} is unknown without rclpy; known types are {known}"
        raise InvalidArgument(text, value=name)
    package, _, base = short.partition("/")
    return Kind(short, f"{package}::msg::dds_::{base}_", f"RIHS01_{_HASHES[short]}")


def domain_of(text: str) -> int:
    """Read a domain; empty: that of ROS_DOMAIN_ID, or 0. Raises InvalidArgument."""
    text = text or os.environ.get("ROS_DOMAIN_ID", "") or "0"
    if not (text.isascii() and text.isdecimal() and int(text) <= LAST_DOMAIN):
        raise InvalidArgument(
            f"{text!r} is not a ROS 2 domain: it must be 0 to {LAST_DOMAIN}", value=text
        )
    return int(text)


class Ros2Names:
    """Resolves the names of a ROS 2 node.

    Threads: any; it is immutable.

    Parameters
    ----------
    name
        Name of the node, without namespace.
    arguments
        Arguments of the program. From `--ros-args` to `--`, `-r` and `-p use_sim_time:=true` are
        used. None: `sys.argv`.
    """

    def __init__(self, name: str, arguments: Sequence[str] | None) -> None:
        found = _Arguments(sys.argv if arguments is None else arguments)
        name = found.remapped.pop("__node", name)
        if _BASE.fullmatch(check_name("name", name)) is None:
            raise InvalidName(
                f"{name!r} is not a valid node name: it must be a letter or _, then letters, "
                "digits and _",
                value=name,
            )
        self.namespace: str = found.remapped.pop("__ns", "/")
        """Namespace for relative names."""
        if _NAMESPACE.fullmatch(self.namespace) is None:
            raise InvalidName(
                f"{self.namespace!r} is not a valid namespace: it must begin with /, followed by "
                "names with / between them",
                value=self.namespace,
            )
        self.base: str = name
        """The node's name without its namespace."""
        self.node: str = f"{self.namespace.rstrip('/')}/{name}"
        """The node's full name."""
        self.use_sim_time: bool = found.use_sim_time
        """Whether its clock is /clock."""
        self._remapped: Mapping[str, str] = {}
        self._remapped = {self.resolve(key): self.resolve(to) for key, to in found.remapped.items()}

    def resolve(self, name: str) -> str:
        """Full name of a topic. Raises InvalidName."""
        if _NAME.fullmatch(name) is None:
            raise InvalidName(
                f"{name!r} is not a valid ROS 2 name: it must be names of letters, digits and _"
                " with / between them, without a digit at the beginning of one",
                value=name,
            )
        if name.startswith("~/"):
            full = f"{self.node}{name[1:]}"
        elif name.startswith("/"):
            full = name
        else:
            full = f"{self.namespace.rstrip('/')}/{name}"
        return self._remapped.get(full, full)


class _Arguments:
    """Settings of the node from the program's arguments. Raises InvalidArgument."""

    def __init__(self, arguments: Sequence[str]) -> None:
        self.remapped: dict[str, str] = {}
        self.use_sim_time = False
        ours, rest = False, iter(arguments)
        for argument in rest:
            if argument in {"--ros-args", "--"}:
                ours = argument == "--ros-args"
            elif ours and argument in {"-r", "--remap", "-p", "--param"}:
                key, assigned, value = next(rest, "").partition(":=")
                if not (key and assigned and value):
                    self._refuse(f"{argument} needs NAME:=VALUE")
                elif argument in {"-r", "--remap"}:
                    self.remapped[key] = value
                elif key == "use_sim_time":
                    if value.lower() not in {"true", "false"}:
                        self._refuse(f"use_sim_time must be true or false, got {value!r}")
                    self.use_sim_time = value.lower() == "true"
            elif ours:
                self._refuse(f"{argument} needs rclpy; known are -r and -p")

    def _refuse(self, text: str) -> None:
        raise InvalidArgument(f"ROS 2 does not start: {text}", value=text)

"""Names in a ROS 1 graph: validation, resolution, and a program's own name.

The rules are those of https://wiki.ros.org/Names and https://wiki.ros.org/Remapping%20Arguments.
"""

from __future__ import annotations

import os
import re
import socket
import sys
import time
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from tfdb.data.argument_checks import check_name
from tfdb.data.errors import InvalidArgument, InvalidName

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

__all__ = ["Names", "anonymous", "is_loopback", "own_host", "parse_arguments"]

LEGAL = re.compile(r"[~/A-Za-z][A-Za-z0-9_/]*", re.ASCII)
BASE = re.compile(r"[A-Za-z][A-Za-z0-9_]*", re.ASCII)
ARGUMENT = re.compile(r"([~/A-Za-z_][A-Za-z0-9_/]*):=(.*)", re.ASCII | re.DOTALL)
DEFAULT_MASTER = "http://localhost:11311"


def parse_arguments(arguments: Sequence[str]) -> dict[str, str]:
    """Return the remappings in a program's arguments: `from:=to`, and special ones (`__name:=x`).

    `_parameter:=value` is not a remapping; roslaunch puts these on the parameter server.
    """
    found = {}
    for argument in arguments:
        match = ARGUMENT.fullmatch(argument)
        if match is None:
            continue
        source, target = match[1].strip(), match[2].strip()
        parameter = source.startswith("_") and not source.startswith("__")
        if target and not parameter:
            found[source] = target
    return found


def anonymous(name: str) -> str:
    """Make a unique name."""
    return f"{name}_{os.getpid()}_{time.time_ns() // 1_000_000}"


class Names:
    """Resolves the names that a node's program uses.

    Threads: any; it is immutable.

    Parameters
    ----------
    name
        Name of the node, without namespace.
    arguments
        Arguments of the program. `from:=to`, `__name:=`, `__ns:=`, `__master:=`, `__ip:=` and
        `__hostname:=` are used.
    environment
        Environment variables. ROS_NAMESPACE, ROS_MASTER_URI, ROS_IP and ROS_HOSTNAME are used.
    """

    def __init__(
        self, name: str, arguments: Sequence[str] | None, environment: Mapping[str, str]
    ) -> None:
        given = parse_arguments(sys.argv if arguments is None else arguments)
        special = {key: given.pop(key) for key in list(given) if key.startswith("__")}
        name = special.get("__name", name)
        if BASE.fullmatch(check_name("name", name)) is None:
            raise InvalidName(
                f"{name!r} is not a valid ROS node name: it must be a letter, then letters, digits"
                " and _; the namespace comes from ROS_NAMESPACE or __ns:=",
                value=name,
            )
        namespace = special.get("__ns", environment.get("ROS_NAMESPACE", "/")) or "/"
        self.namespace: str = canonical(f"/{namespace}")
        """Namespace for relative names."""
        self.node: str = canonical(f"{self.namespace}/{name}")
        """The node's full name."""
        self.master: str = special.get(
            "__master", environment.get("ROS_MASTER_URI", DEFAULT_MASTER)
        )
        """URI of the master."""
        self.host: str = own_host(
            special.get("__hostname", environment.get("ROS_HOSTNAME", "")),
            special.get("__ip", environment.get("ROS_IP", "")),
        )
        """Host name of this node for others."""
        self._remapped: dict[str, str] = {}
        self._remapped = {self.resolve(key): self.resolve(to) for key, to in given.items()}

    def resolve(self, name: str) -> str:
        """Full name of a topic, a service or a parameter. Raises InvalidName."""
        if LEGAL.fullmatch(name) is None or "//" in name or "~" in name[1:]:
            raise InvalidName(
                f"{name!r} is not a valid ROS graph name: it must be a letter, / or ~, then"
                " letters, digits, _ and /",
                value=name,
            )
        if name.startswith("/"):
            full = name
        elif name.startswith("~"):
            full = f"{self.node}/{name[1:]}"
        else:
            full = f"{self.namespace}/{name}"
        full = canonical(full)
        return self._remapped.get(full, full)


def canonical(name: str) -> str:
    """Make a global name without doubled or trailing slashes."""
    return "/" + "/".join(part for part in name.split("/") if part)


def own_host(hostname: str, address: str) -> str:
    """Host name of this machine for others: ROS_HOSTNAME, ROS_IP, or its name if that resolves."""
    given = hostname or address
    if given:
        if "://" in given or (":" in given and hostname):
            raise InvalidArgument(
                f"ROS_HOSTNAME or ROS_IP must be a host name or address without protocol or port,"
                f" got {given!r}",
                value=given,
            )
        return given
    own = socket.gethostname()
    try:
        socket.getaddrinfo(own, None, socket.AF_INET)
    except OSError:
        return "127.0.0.1"
    return own


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach a host."""
    return host == "localhost" or host.startswith("127.")


def host_and_port(uri: str) -> tuple[str, int]:
    """Both parts of `http://host:port/` or `rosrpc://host:port`. Raises InvalidArgument."""
    check_name("the URI", uri)
    try:
        parts = urlsplit(uri)
        found = parts.hostname, parts.port
    except ValueError:
        found = None, None
    if not found[0] or not found[1]:
        raise InvalidArgument(f"{uri!r} is not a ROS URI such as http://host:port", value=uri)
    return found[0], found[1]

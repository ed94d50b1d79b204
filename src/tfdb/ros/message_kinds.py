"""Types that tfdb sends in ROS 1: their definitions, and the checksums that peers compare.

A checksum is the MD5 of a definition without comments, constants first, in which each type of a
message is replaced by its checksum (https://wiki.ros.org/ROS/Technical%20Overview).
"""

from __future__ import annotations

import hashlib
import re
from dataclasses import dataclass
from functools import cache

from tfdb.data.errors import InvalidArgument

__all__ = ["Kind", "kind_of", "known_kind", "service_kind"]

TRANSFORMS = "geometry_msgs/TransformStamped[] transforms"
OF_ACTIONS = {
    "Goal": "std_msgs/Header header\nactionlib_msgs/GoalID goal_id\ntf2_msgs/{0}Goal goal",
    "Result": "std_msgs/Header header\nactionlib_msgs/GoalStatus status\ntf2_msgs/{0}Result result",
    "Feedback": (
        "std_msgs/Header header\nactionlib_msgs/GoalStatus status\ntf2_msgs/{0}Feedback feedback"
    ),
}
MESSAGES = {
    "std_msgs/Header": "uint32 seq\ntime stamp\nstring frame_id",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    "geometry_msgs/Transform": (
        "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation"
    ),
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform"
    ),
    "tf2_msgs/TFMessage": TRANSFORMS,
    "tf/tfMessage": TRANSFORMS,
    "rosgraph_msgs/Clock": "time clock",
    "actionlib_msgs/GoalID": "time stamp\nstring id",
    "actionlib_msgs/GoalStatus": (
        "actionlib_msgs/GoalID goal_id\nuint8 status\n"
        "uint8 PENDING=0\nuint8 ACTIVE=1\nuint8 PREEMPTED=2\nuint8 SUCCEEDED=3\nuint8 ABORTED=4\n"
        "uint8 REJECTED=5\nuint8 PREEMPTING=6\nuint8 RECALLING=7\nuint8 RECALLED=8\nuint8 LOST=9\n"
        "string text"
    ),
    "actionlib_msgs/GoalStatusArray": (
        "std_msgs/Header header\nactionlib_msgs/GoalStatus[] status_list"
    ),
    "diagnostic_msgs/KeyValue": "string key\nstring value",
    "diagnostic_msgs/DiagnosticStatus": (
        "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\nbyte level\nstring name\n"
        "string message\nstring hardware_id\ndiagnostic_msgs/KeyValue[] values"
    ),
    "diagnostic_msgs/DiagnosticArray": (
        "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status"
    ),
    "tf2_msgs/TF2Error": (
        "uint8 NO_ERROR=0\nuint8 LOOKUP_ERROR=1\nuint8 CONNECTIVITY_ERROR=2\n"
        "uint8 EXTRAPOLATION_ERROR=3\nuint8 INVALID_ARGUMENT_ERROR=4\nuint8 TIMEOUT_ERROR=5\n"
        "uint8 TRANSFORM_ERROR=6\nuint8 error\nstring error_string"
    ),
    "tf2_msgs/LookupTransformGoal": (
        "string target_frame\nstring source_frame\ntime source_time\nduration timeout\n"
        "time target_time\nstring fixed_frame\nbool advanced"
    ),
    "tf2_msgs/LookupTransformResult": (
        "geometry_msgs/TransformStamped transform\ntf2_msgs/TF2Error error"
    ),
    "tf2_msgs/LookupTransformFeedback": "",
    **{
        f"tf2_msgs/LookupTransformAction{part}": text.format("LookupTransform")
        for part, text in OF_ACTIONS.items()
    },
}
SERVICES = {"tf2_msgs/FrameGraph": ("", "string frame_yaml")}
FIELD = re.compile(r"(?P<type>[\w/]+)(?P<array>\[\d*\])? (?P<rest>.+)")


@dataclass(frozen=True)
class Kind:
    """A message type, as nodes describe it to each other."""

    name: str
    """Such as `tf2_msgs/TFMessage`."""
    md5sum: str
    """Its checksum; `*` is any."""
    definition: str = ""
    """Its definition and those of the types in it."""


def known_kind(name: str) -> Kind:
    """Return a type for sending. Raises InvalidArgument if its definition is unknown."""
    if name not in MESSAGES:
        raise InvalidArgument(
            f"the message type {name!r} is unknown, so it cannot be sent; known types are"
            f" {', '.join(sorted(MESSAGES))}",
            value=name,
        )
    return kind_of(name)


@cache
def kind_of(name: str) -> Kind:
    """Return a type for receiving. If its definition is unknown, it matches any checksum."""
    if name not in MESSAGES:
        return Kind(name, "*")
    used = _types_in(name)
    texts = [MESSAGES[name], *(f"MSG: {each}\n{MESSAGES[each]}" for each in used)]
    return Kind(name, _md5(_checked(MESSAGES[name])), f"\n{'=' * 80}\n".join(texts))


@cache
def service_kind(name: str) -> Kind:
    """Return the type of a service. Raises InvalidArgument if its definition is unknown."""
    if name not in SERVICES:
        raise InvalidArgument(
            f"the service type {name!r} is unknown; known types are {', '.join(sorted(SERVICES))}",
            value=name,
        )
    request, response = SERVICES[name]
    return Kind(name, _md5(_checked(request) + _checked(response)), f"{request}\n---\n{response}")


def _md5(text: str) -> str:
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()


def _checked(definition: str) -> str:
    """Text whose MD5 is the checksum."""
    lines = definition.splitlines()
    constants = [line for line in lines if "=" in line]
    fields = [_checked_field(line) for line in lines if "=" not in line]
    return "\n".join([*constants, *fields])


def _checked_field(line: str) -> str:
    match = FIELD.fullmatch(line)
    if match is None or match["type"] not in MESSAGES:
        return line
    return f"{_md5(_checked(MESSAGES[match['type']]))} {match['rest']}"


def _types_in(name: str) -> list[str]:
    """Types of messages that a definition needs, each once, after those that need it."""
    found: dict[str, None] = {}
    for line in MESSAGES[name].splitlines():
        kind = line.split("[")[0].split(" ")[0]
        if kind in MESSAGES:
            found[kind] = None
            found.update(dict.fromkeys(_types_in(kind)))
    return list(found)

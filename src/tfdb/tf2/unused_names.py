"""Names that programs import from tf2's modules, but that tfdb does not use.

Names of annotations and defaults. MsgStamped, TransformableObject and tfMessage are made on demand.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, TypeVar, Union

from tfdb.ros import msgs
from tfdb.ros.ros_messages import installed, message_class

__all__ = [
    "DEFAULT_CAN_TRANSFORM_POLLING_SCALE",
    "DEFAULT_STATIC_TF_TOPIC",
    "DEFAULT_TF_TOPIC",
    "FrameGraphSrvRequest",
    "FrameGraphSrvResponse",
    "LookupTransformGoal",
    "LookupTransformResult",
    "PyKDLType",
    "TransformableObjectType",
]

DEFAULT_CAN_TRANSFORM_POLLING_SCALE = 0.01
"""Fraction of a timeout after which ROS 1's tf2 polls. tfdb does not poll."""
DEFAULT_TF_TOPIC = "/tf"
"""Topic of moving transforms."""
DEFAULT_STATIC_TF_TOPIC = "/tf_static"
"""Topic of static transforms."""

FrameGraphSrvRequest = TypeVar("FrameGraphSrvRequest")
FrameGraphSrvResponse = TypeVar("FrameGraphSrvResponse")
LookupTransformGoal = TypeVar("LookupTransformGoal")
LookupTransformResult = TypeVar("LookupTransformResult")
PyKDLType = TypeVar("PyKDLType")
TransformableObjectType = TypeVar("TransformableObjectType")

STAMPED = ("PointStamped", "PoseStamped", "PoseWithCovarianceStamped", "Vector3Stamped")


def __getattr__(name: str) -> Any:
    # Made on demand from installed messages, because their import takes long.
    if name == "MsgStamped":
        return Union[(*map(message_class, STAMPED), _installed_class("sensor_msgs", "PointCloud2"))]
    if name == "TransformableObject":
        return __getattr__("MsgStamped") | PyKDLType
    if name == "tfMessage":
        base = _installed_class("tf2_msgs", "TFMessage")
        return type(
            name, (base,), {"_type": "tf/tfMessage", "__slots__": (), "__module__": "tf.msg"}
        )
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def _installed_class(package: str, name: str) -> Any:
    """Message class of the installed ROS, or of tfdb."""
    if installed() is None:
        return getattr(msgs, name)
    return getattr(import_module(f"{package}.msg"), name)

"""The calls of tf2 on a store of tfdb, with and without ROS.

    >>> from tfdb import tf2
    >>> from tfdb.tf2 import msgs
    >>> core = tf2.BufferCore(flavor="ros2")
    >>> stamped = msgs.TransformStamped(msgs.Header(msgs.Time(12, 0), "map"), "base")
    >>> stamped.transform.translation.x = 1.5
    >>> core.set_transform(stamped, "odometry")
    >>> core.lookup_transform_core("map", "base", msgs.Time()).transform.translation.x
    1.5

A lookup of target and source returns T[target<-source]: p_target = T p_source.
`tfdb.tf2.differences` lists the intended differences from tf2.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from tfdb.data.lazy_names import belong_to
from tfdb.ros import msgs

# Clouds and geometry register their transform functions.
from . import clouds, geometry
from .buffer import Buffer
from .buffer_client import BufferClient
from .buffer_core import BufferCore
from .buffer_interface import (
    BufferInterface,
    ConvertRegistration,
    NotImplementedException,
    Stamped,
    TransformRegistration,
    TypeException,
    convert,
)
from .buffer_server import BufferServer
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
from .exports import find_export
from .installing import install
from .message_filter import FilterFailureReason, MessageFilter
from .static_transform_broadcaster import StaticTransformBroadcaster
from .transform_broadcaster import TransformBroadcaster
from .transform_listener import StaticTransformListener, TransformListener
from .transformable_requests import TransformableResult

__all__ = [
    "BackwardExtrapolationException",
    "Buffer",
    "BufferClient",
    "BufferCore",
    "BufferInterface",
    "BufferServer",
    "ConnectivityException",
    "ConvertRegistration",
    "ExtrapolationException",
    "FilterFailureReason",
    "ForwardExtrapolationException",
    "InvalidArgumentException",
    "LookupException",
    "MessageFilter",
    "NoDataForExtrapolationException",
    "NotImplementedException",
    "Stamped",
    "StaticTransformBroadcaster",
    "StaticTransformListener",
    "TimeoutException",
    "TransformBroadcaster",
    "TransformException",
    "TransformListener",
    "TransformRegistration",
    "TransformableResult",
    "TypeException",
    "clouds",
    "convert",
    "geometry",
    "install",
    "msgs",
]

_MODULES = ("differences", "tf1")
"""Modules that are imported at their first use."""

belong_to(__name__, globals(), __all__)

if not TYPE_CHECKING:  # otherwise every name would exist for type checkers

    def __getattr__(name: str) -> Any:
        if name in _MODULES:
            return import_module(f"{__name__}.{name}")
        # Names that tf2_ros imports from other packages, such as Duration and TFMessage.
        if name.startswith("__"):
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return find_export(name)

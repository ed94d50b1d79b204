"""The transform argument of a conversion, and the header of its result."""

from __future__ import annotations

from typing import Any

from tfdb import _core
from tfdb.data import errors
from tfdb.ros.ros_messages import fill_header, fill_stamp

from .exceptions import InvalidArgumentException, with_fields_of
from .message_checks import refuse_unlike

__all__ = ["fill_result_header", "rigid"]


def rigid(transform: Any) -> _core.Transform:
    """T[target<-source] of a TransformStamped, a Transform or a `tfdb.Transform`, checked."""
    if isinstance(transform, _core.Transform):
        return transform
    inside = getattr(transform, "transform", transform)
    what = "a TransformStamped, a Transform or a tfdb.Transform"
    refuse_unlike(inside, "transform", what, "translation", "rotation")
    try:
        return _core.Transform("target", "source", inside.translation, inside.rotation)
    except errors.InvalidTransform as error:
        text = f"cannot transform by this: {error}"
        raise with_fields_of(error, InvalidArgumentException, text) from error


def fill_result_header(made: Any, given: Any, transform: Any) -> None:
    """Set the header of a result: that of the transform, otherwise that of the message."""
    if isinstance(transform, _core.Transform):
        made.header.frame_id = transform.target
        fill_stamp(made.header, transform.stamp)
    else:
        fill_header(made.header, getattr(transform, "header", given.header))

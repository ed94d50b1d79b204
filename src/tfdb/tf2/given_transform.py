"""The transform that a conversion is given, and the header that it gives the result."""

from __future__ import annotations

from typing import Any

import tfdb

from .exceptions import InvalidArgumentException, with_fields_of
from .given_messages import refuse_unlike
from .ros_messages import fill_header, fill_stamp

__all__ = ["fill_result_header", "rigid"]


def rigid(transform: Any) -> tfdb.Transform:
    """T[target<-source] of a TransformStamped, a Transform or a `tfdb.Transform`, checked."""
    if isinstance(transform, tfdb.Transform):
        return transform
    inside = getattr(transform, "transform", transform)
    what = "a TransformStamped, a Transform or a tfdb.Transform"
    refuse_unlike(inside, "transform", what, "translation", "rotation")
    try:
        return tfdb.Transform("target", "source", inside.translation, inside.rotation)
    except tfdb.InvalidTransform as error:
        text = f"cannot transform by this: {error}"
        raise with_fields_of(error, InvalidArgumentException, text) from error


def fill_result_header(made: Any, given: Any, transform: Any) -> None:
    """Give a result its header: the transform's, or if that has none the given message's."""
    if isinstance(transform, tfdb.Transform):
        made.header.frame_id = transform.target
        fill_stamp(made.header, transform.stamp)
    else:
        fill_header(made.header, getattr(transform, "header", given.header))

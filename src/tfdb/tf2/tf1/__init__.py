"""The Python of tf, tf2's predecessor in ROS 1, on a store of tfdb.

    >>> from tfdb.tf2 import msgs, tf1
    >>> transformer = tf1.Transformer()
    >>> stamped = msgs.TransformStamped(msgs.Header(msgs.Time(12, 0), "map"), "base")
    >>> stamped.transform.translation.x = 1.5
    >>> transformer.setTransform(stamped)
    >>> transformer.lookupTransform("map", "base", msgs.Time())
    ([1.5, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0])

As tf: a lookup of target and source gives T[target<-source], and one leading '/' of a frame is
dropped. `tf1.transformations` needs the package `transformations` (`pip install 'tfdb[tf1]'`).
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

from tfdb.data.lazy_names import belong_to

from ..exceptions import ConnectivityException, ExtrapolationException, LookupException
from ..exceptions import TransformException as Exception  # noqa: A004 - tf's name
from .broadcaster import TransformBroadcaster
from .listener import Transformer, TransformerROS, TransformListener

__all__ = [
    "ConnectivityException",
    "Exception",
    "ExtrapolationException",
    "LookupException",
    "TransformBroadcaster",
    "TransformListener",
    "Transformer",
    "TransformerROS",
]

_OWN = ("TransformBroadcaster", "TransformListener", "Transformer", "TransformerROS")
belong_to(__name__, globals(), _OWN)


def __getattr__(name: str) -> Any:
    # `transformations` needs a package that may be missing.
    if name == "transformations":
        return import_module(".transformations", __name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

"""A transform database: time-stamped rigid transforms between named frames.

    >>> import tfdb
    >>> buf = tfdb.Buffer(history=10.0)
    >>> _ = buf.set_transform("map", "base", tfdb.stamp(12.0), (1, 2, 0), (0, 0, 0, 1))
    >>> _ = buf.set_static_transform("base", "camera", (0.2, 0, 1.1))
    >>> buf.lookup_transform("map", "camera", tfdb.stamp("12"))
    T[map<-camera] at 12 s: translation [1.2, 2, 1.1], rotation [0, 0, 0, 1]

A stored transform maps points of the child into the parent: p_parent = T[parent<-child] p_child.
Stamps are integer nanoseconds, poses are x y z qx qy qz qw.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

try:
    from ._core import (
        Clock,
        Transform,
        Watch,
        __version__,
        decode_tf_message,
        encode_tf_message,
        open,  # noqa: A004 - tfdb.open, as gzip.open
    )
except ModuleNotFoundError as _error:
    if _error.name != f"{__name__}._core":
        raise
    import sys

    raise ImportError(
        f"{__path__[0]} holds no extension for Python {sys.version.split()[0]} on this machine: it "
        "was installed for another, or lies in a zip file; use 'python -m pip install tfdb'",
        name=_error.name,
        path=__path__[0],
    ) from _error
from .buffer import Buffer, Snapshot, Transaction
from .data.errors import (
    Conflict,
    Disconnected,
    Extrapolation,
    InvalidArgument,
    InvalidStamp,
    TfdbError,
    TfdbWarning,
    UnknownFrame,
    WaitTimeout,
)
from .data.lazy_names import on_demand as _offer

if TYPE_CHECKING:
    from . import bridge as bridge
    from . import comparing as comparing
    from . import errors as errors
    from . import judging as judging
    from . import net as net
    from . import plot as plot
    from . import recorder as recorder
    from . import recordings as recordings
    from . import robots as robots
    from . import ros as ros
    from . import rules as rules
    from . import store as store
    from . import streams as streams
    from . import tf2 as tf2
    from . import trajectories as trajectories
    from . import types as types
    from .comparing import Comparison, compare
    from .data.policies import Exact, Extrapolate, Interpolate, Nearest, Previous
    from .data.stamps import stamp
    from .data.types import Columns, TransformStamped
    from .judging.expectations import Expectations
    from .recorder import Recorder, recorded_commits
    from .recordings.load import load
    from .trajectories.trajectory import Trajectory
    from .viewers.exporting import to_foxglove, to_rerun

__all__ = [
    "Buffer",
    "Clock",
    "Columns",
    "Comparison",
    "Conflict",
    "Disconnected",
    "Exact",
    "Expectations",
    "Extrapolate",
    "Extrapolation",
    "Interpolate",
    "InvalidArgument",
    "InvalidStamp",
    "Nearest",
    "Previous",
    "Recorder",
    "Snapshot",
    "TfdbError",
    "TfdbWarning",
    "Trajectory",
    "Transaction",
    "Transform",
    "TransformStamped",
    "UnknownFrame",
    "WaitTimeout",
    "Watch",
    "__version__",
    "compare",
    "decode_tf_message",
    "encode_tf_message",
    "load",
    "open",
    "recorded_commits",
    "stamp",
    "to_foxglove",
    "to_rerun",
]

if not TYPE_CHECKING:  # with `__getattr__`, type checkers would accept any name
    # Each import happens at first use: a program pays for what it uses.
    __getattr__, __dir__ = _offer(
        __name__,
        {
            "bridge": (),
            "comparing": ("Comparison", "compare"),
            "data.policies": ("Exact", "Extrapolate", "Interpolate", "Nearest", "Previous"),
            "data.stamps": ("stamp",),
            "data.types": ("Columns", "TransformStamped"),
            "errors": (),
            "judging": (),
            "judging.expectations": ("Expectations",),
            "net": (),
            "plot": (),
            "recorder": (),
            "recorder.commit_reader": ("recorded_commits",),
            "recorder.recorder": ("Recorder",),
            "recordings": (),
            "recordings.load": ("load",),
            "robots": (),
            "ros": (),
            "rules": (),
            "store": (),
            "streams": (),
            "tf2": (),
            "trajectories": (),
            "trajectories.trajectory": ("Trajectory",),
            "types": (),
            "viewers.exporting": ("to_foxglove", "to_rerun"),
        },
    )

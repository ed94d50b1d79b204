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
        Buffer,
        Reads,
        Snapshot,
        Transaction,
        Transform,
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
from ._on_demand import on_demand as _offer
from .errors import (
    BufferClosed,
    CapacityExceeded,
    Conflict,
    CorruptMessage,
    CorruptStore,
    CycleError,
    Disconnected,
    Extrapolation,
    FeedLapped,
    Forked,
    FrameInUse,
    GapTooLarge,
    HistoryError,
    InvalidArgument,
    InvalidArray,
    InvalidIndex,
    InvalidName,
    InvalidStamp,
    InvalidTransform,
    LockTimeout,
    MasterRefused,
    MixedSources,
    ModelError,
    NodeClosed,
    NoMaster,
    NoSampleNear,
    NoSuchStore,
    NotComparable,
    NotSupported,
    ReadOnly,
    RecordingError,
    RepeatedStamp,
    SnapshotClosed,
    SnapshotTooOld,
    Stale,
    StaticConflict,
    StoreExists,
    TfdbError,
    TfdbWarning,
    TooOld,
    TrajectoryError,
    TransactionActive,
    TransactionClosed,
    UnknownFrame,
    WaitTimeout,
    WrongThread,
)

if TYPE_CHECKING:
    from . import io as io
    from . import plot as plot
    from . import tf2 as tf2
    from .comparing import Comparison, compare
    from .explain import EdgeExplanation, Explanation
    from .exporting import to_foxglove, to_rerun
    from .loading import load
    from .policies import Exact, Extrapolate, Interpolate, Nearest, Policy, Previous
    from .report import EdgeUse, Report
    from .stamps import stamp
    from .trajectory import Trajectory
    from .types import (
        Changes,
        Columns,
        Counters,
        FrameInfo,
        IngestResult,
        MemoryUse,
        Refusal,
        Refused,
        RefusedEdge,
        Shared,
        TransformStamped,
        Twist,
    )

__all__ = [
    "Buffer",
    "BufferClosed",
    "CapacityExceeded",
    "Changes",
    "Columns",
    "Comparison",
    "Conflict",
    "CorruptMessage",
    "CorruptStore",
    "Counters",
    "CycleError",
    "Disconnected",
    "EdgeExplanation",
    "EdgeUse",
    "Exact",
    "Explanation",
    "Extrapolate",
    "Extrapolation",
    "FeedLapped",
    "Forked",
    "FrameInUse",
    "FrameInfo",
    "GapTooLarge",
    "HistoryError",
    "IngestResult",
    "Interpolate",
    "InvalidArgument",
    "InvalidArray",
    "InvalidIndex",
    "InvalidName",
    "InvalidStamp",
    "InvalidTransform",
    "LockTimeout",
    "MasterRefused",
    "MemoryUse",
    "MixedSources",
    "ModelError",
    "Nearest",
    "NoMaster",
    "NoSampleNear",
    "NoSuchStore",
    "NodeClosed",
    "NotComparable",
    "NotSupported",
    "Policy",
    "Previous",
    "ReadOnly",
    "Reads",
    "RecordingError",
    "Refusal",
    "Refused",
    "RefusedEdge",
    "RepeatedStamp",
    "Report",
    "Shared",
    "Snapshot",
    "SnapshotClosed",
    "SnapshotTooOld",
    "Stale",
    "StaticConflict",
    "StoreExists",
    "TfdbError",
    "TfdbWarning",
    "TooOld",
    "Trajectory",
    "TrajectoryError",
    "Transaction",
    "TransactionActive",
    "TransactionClosed",
    "Transform",
    "TransformStamped",
    "Twist",
    "UnknownFrame",
    "WaitTimeout",
    "WrongThread",
    "__version__",
    "compare",
    "decode_tf_message",
    "encode_tf_message",
    "load",
    "open",
    "stamp",
    "to_foxglove",
    "to_rerun",
]

if not TYPE_CHECKING:  # or every name would be there for type checkers
    # A program waits for what it uses; a store needs none of it.
    __getattr__, __dir__ = _offer(
        __name__,
        {
            "comparing": ("Comparison", "compare"),
            "explain": ("EdgeExplanation", "Explanation"),
            "exporting": ("to_foxglove", "to_rerun"),
            "io": (),
            "loading": ("load",),
            "plot": (),
            "policies": ("Exact", "Extrapolate", "Interpolate", "Nearest", "Policy", "Previous"),
            "report": ("EdgeUse", "Report"),
            "cache": (),
            "frozen": (),
            "shared": (),
            "stamps": ("stamp",),
            "summary": (),
            "tf2": (),
            "trajectory": ("Trajectory",),
            "types": (
                "Changes",
                "Columns",
                "Counters",
                "FrameInfo",
                "Frozen",
                "IngestResult",
                "MemoryUse",
                "Refusal",
                "Refused",
                "RefusedEdge",
                "Shared",
                "TransformStamped",
                "Twist",
            ),
        },
    )

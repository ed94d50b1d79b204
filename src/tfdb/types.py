"""The types of arguments and results that are not attributes of `tfdb` itself."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .data.policies import Policy
from .data.refused_transforms import Refusal, Refused, RefusedEdge
from .data.stamps import RosTime, StampLike, StampsLike
from .data.types import (
    AsQuat,
    Batch,
    BytesLike,
    Changes,
    Concurrency,
    Counters,
    Epoch,
    FrameInfo,
    Frozen,
    IngestResult,
    ListsOrIntegers,
    MemoryUse,
    Name,
    Paths,
    PoseLike,
    PoseTopics,
    Position,
    Progress,
    QuaternionLike,
    Sample,
    Shared,
    Topics,
    Touched,
    TrajectoryLike,
    TransformStampedLike,
    TreeColumns,
    Twist,
    VectorLike,
    WxyzLike,
)
from .store.explain import EdgeExplanation, Explanation
from .store.report import EdgeUse, Report

if TYPE_CHECKING:
    from .data.types import Float as Float  # noqa: PLC0414 - offered to type checkers

__all__ = [
    "AsQuat",
    "Batch",
    "BytesLike",
    "Changes",
    "Concurrency",
    "Counters",
    "EdgeExplanation",
    "EdgeUse",
    "Epoch",
    "Explanation",
    "FrameInfo",
    "Frozen",
    "IngestResult",
    "ListsOrIntegers",
    "MemoryUse",
    "Name",
    "Paths",
    "Policy",
    "PoseLike",
    "PoseTopics",
    "Position",
    "Progress",
    "QuaternionLike",
    "Refusal",
    "Refused",
    "RefusedEdge",
    "Report",
    "RosTime",
    "Sample",
    "Shared",
    "StampLike",
    "StampsLike",
    "Topics",
    "Touched",
    "TrajectoryLike",
    "TransformStampedLike",
    "TreeColumns",
    "Twist",
    "VectorLike",
    "WxyzLike",
]

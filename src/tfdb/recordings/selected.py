"""The fields of `Selection` as keywords. Written by tools/make_stubs.py."""

from __future__ import annotations

from typing import TYPE_CHECKING, TypedDict

if TYPE_CHECKING:
    import os
    from collections.abc import Iterable, Mapping
    from typing import Literal

    from tfdb.data.stamps import StampLike
    from tfdb.data.types import PoseTopics, Topics
    from tfdb.robots.robot_model import RobotModel


class Selected(TypedDict, total=False):
    """Keywords that make a `Selection`."""

    topics: Topics | None
    start: StampLike | str | None
    end: StampLike | str | None
    keep: float | None
    frames: str | Iterable[str] | None
    exclude: str | Iterable[str]
    rename: Mapping[str, str] | None
    pose_topics: PoseTopics | None
    urdf: str | os.PathLike[str] | RobotModel | None
    joint_topic: str | None
    stamp_unit: Literal["s", "ms", "us", "ns"] | None
    prefix: str
    by_namespace: bool
    mix: bool
    salvage: bool

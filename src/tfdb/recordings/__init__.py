"""Recordings: ROS 1 bags, ROS 2 databases, MCAP. Reading, loading, writing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.lazy_names import on_demand as _offer

if TYPE_CHECKING:
    from tfdb.data.loss import Loss

    from .containers import Source, Topic
    from .following import follow_recording
    from .joint_state_stores import load_joint_states
    from .load_report import LoadReport, TopicReport
    from .recording import Recording, Run
    from .recording_writer import RecordingWriter
    from .selection import Selection
    from .writing import write_recording, write_transforms

__all__ = [
    "LoadReport",
    "Loss",
    "Recording",
    "RecordingWriter",
    "Run",
    "Selection",
    "Source",
    "Topic",
    "TopicReport",
    "follow_recording",
    "load_joint_states",
    "write_recording",
    "write_transforms",
]

if not TYPE_CHECKING:  # with `__getattr__`, type checkers would accept any name
    __getattr__, __dir__ = _offer(
        __name__,
        {
            "containers": (
                "Loss",
                "Source",
                "Topic",
            ),
            "following": ("follow_recording",),
            "joint_state_stores": ("load_joint_states",),
            "load_report": ("LoadReport", "TopicReport"),
            "recording": (
                "Recording",
                "Run",
            ),
            "recording_writer": ("RecordingWriter",),
            "selection": ("Selection",),
            "writing": (
                "write_recording",
                "write_transforms",
            ),
        },
    )

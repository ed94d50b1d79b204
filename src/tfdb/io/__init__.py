"""Files in and out: recordings, trajectories, robot models.

Writing recordings needs `pip install 'tfdb[recordings]'`; all else comes with tfdb.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb._on_demand import on_demand as _offer

if TYPE_CHECKING:
    from .containers import Loss, Source, Topic
    from .joint_states import BeyondLimits, JointReport
    from .loading import LoadReport, TopicReport, follow_recording, load_recordings
    from .recordings import Recording, Run
    from .robot_model import Joint, JointLimits, Mimic, RobotModel
    from .rosbags_writer import RecordingWriter
    from .trajectories import into_buffer, read_trajectory
    from .trajectory_report import TrajectoryRows
    from .trajectory_writers import (
        write_csv,
        write_euroc,
        write_kitti,
        write_npz,
        write_parquet,
        write_trajectory,
        write_tum,
    )
    from .urdf import load_urdf, parse_urdf
    from .writers import write_recording, write_transforms

__all__ = [
    "BeyondLimits",
    "Joint",
    "JointLimits",
    "JointReport",
    "LoadReport",
    "Loss",
    "Mimic",
    "Recording",
    "RecordingWriter",
    "RobotModel",
    "Run",
    "Source",
    "Topic",
    "TopicReport",
    "TrajectoryRows",
    "follow_recording",
    "into_buffer",
    "load_recordings",
    "load_urdf",
    "parse_urdf",
    "read_trajectory",
    "write_csv",
    "write_euroc",
    "write_kitti",
    "write_npz",
    "write_parquet",
    "write_recording",
    "write_trajectory",
    "write_transforms",
    "write_tum",
]

if not TYPE_CHECKING:  # or every name would be there for type checkers
    # A shell that waits for a completion imports no more than it needs.
    __getattr__, __dir__ = _offer(
        __name__,
        {
            "containers": ("Loss", "Source", "Topic"),
            "joint_states": ("BeyondLimits", "JointReport"),
            "loading": ("LoadReport", "TopicReport", "follow_recording", "load_recordings"),
            "recordings": ("Recording", "Run"),
            "robot_model": ("Joint", "JointLimits", "Mimic", "RobotModel"),
            "rosbags_writer": ("RecordingWriter",),
            "trajectories": ("into_buffer", "read_trajectory"),
            "trajectory_report": ("TrajectoryRows",),
            "trajectory_writers": (
                "write_csv",
                "write_euroc",
                "write_kitti",
                "write_npz",
                "write_parquet",
                "write_trajectory",
                "write_tum",
            ),
            "urdf": ("load_urdf", "parse_urdf"),
            "writers": ("write_recording", "write_transforms"),
        },
    )

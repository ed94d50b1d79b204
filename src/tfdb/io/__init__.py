"""Files in and out: recordings, trajectories, robot models.

Recordings need `pip install 'tfdb[recordings]'`; the rest needs nothing but numpy.
"""

from __future__ import annotations

from .containers import Loss, Source, Topic
from .loading import LoadReport, TopicReport, load_recordings
from .recordings import Recording, Run
from .robot_model import Joint, JointLimits, Mimic, RobotModel
from .rosbags_writer import RecordingWriter
from .trajectories import into_buffer, read_trajectory
from .trajectory_writers import (
    write_csv,
    write_euroc,
    write_kitti,
    write_npz,
    write_trajectory,
    write_tum,
)
from .urdf import load_urdf, parse_urdf
from .writers import write_recording, write_transforms

__all__ = [
    "Joint",
    "JointLimits",
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
    "into_buffer",
    "load_recordings",
    "load_urdf",
    "parse_urdf",
    "read_trajectory",
    "write_csv",
    "write_euroc",
    "write_kitti",
    "write_npz",
    "write_recording",
    "write_trajectory",
    "write_transforms",
    "write_tum",
]

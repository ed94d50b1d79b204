"""Robot models: URDF, joints, forward kinematics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.lazy_names import on_demand as _offer

if TYPE_CHECKING:
    from .joint_states import BeyondLimits, JointReport
    from .robot_model import Joint, JointLimits, Mimic, RobotModel
    from .urdf import load_urdf, parse_urdf

__all__ = [
    "BeyondLimits",
    "Joint",
    "JointLimits",
    "JointReport",
    "Mimic",
    "RobotModel",
    "load_urdf",
    "parse_urdf",
]

if not TYPE_CHECKING:  # with `__getattr__`, type checkers would accept any name
    __getattr__, __dir__ = _offer(
        __name__,
        {
            "joint_states": (
                "BeyondLimits",
                "JointReport",
            ),
            "robot_model": (
                "Joint",
                "JointLimits",
                "Mimic",
                "RobotModel",
            ),
            "urdf": (
                "load_urdf",
                "parse_urdf",
            ),
        },
    )

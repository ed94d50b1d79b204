"""A store of the joint states of a recording."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING, Literal

from tfdb import _core
from tfdb.data.argument_checks import check_word
from tfdb.data.errors import RecordingError, TfdbWarning

from .load import load_into
from .selection import Selection

if TYPE_CHECKING:
    from collections.abc import Sequence

    from tfdb._core import Buffer
    from tfdb.robots.robot_model import RobotModel

    from .recording import PathLike


def load_joint_states(
    model: RobotModel,
    recording: PathLike | Sequence[PathLike],
    *,
    topic: str | None = None,
    limits: Literal["warn", "raise", "ignore"] = "warn",
) -> Buffer:
    """Make a store of the joint states of a recording: where each link is in its parent.

    Each message (sensor_msgs/JointState) is one commit, at its stamp, the fixed joints another.
    The recording's own transforms are not read: `tfdb.load(recording, urdf=model)` joins both.

    Parameters
    ----------
    model
        The robot.
    recording
        One or several, as in `tfdb.load`.
    topic
        That of the joint states; None: `/joint_states`, or the only one.
    limits
        What positions beyond a joint's limits are: a TfdbWarning, an error, or nothing.

    Returns
    -------
    Buffer
        It keeps everything.

    Raises
    ------
    RecordingError
        No such topic; nothing of it could be stored; with `limits="raise"`, a joint beyond its
        limits: all of them are named, with the furthest position and its stamp.
    InvalidArgument
        Another word for `limits`.

    And as `tfdb.load`.

    Warns
    -----
    TfdbWarning
        Joints of the model that no state names, joints that it does not have, positions that
        are not finite (they are left out) or beyond their limits, messages that were refused.
    """
    check_word("limits", limits, ("warn", "raise", "ignore"))
    buffer = _core.Buffer(history=None)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", TfdbWarning)
        selection = Selection(topics=(), urdf=model, joint_topic=topic)
        report = load_into(buffer, recording, selection)
    beyond = () if report.joints is None else report.joints.beyond
    if beyond and limits == "raise":
        raise RecordingError(", ".join(report.files), "joint " + "; ".join(map(str, beyond)))
    for each in caught:
        if limits == "warn" or "beyond its limits" not in str(each.message):
            warnings.warn(str(each.message), each.category, stacklevel=2)
    return buffer

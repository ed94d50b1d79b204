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
    """Make a store from the joint states of a recording: the pose of each link in its parent.

    Each message (sensor_msgs/JointState) is one commit, at its stamp; the fixed joints are another.
    Transforms in the recording are not read: `tfdb.load(recording, urdf=model)` reads both.

    Parameters
    ----------
    model
        The robot.
    recording
        One recording or several, as in `tfdb.load`.
    topic
        Topic of the joint states; None: `/joint_states`, or the only one.
    limits
        Effect of positions beyond a joint's limits: a TfdbWarning, an error, or none.

    Returns
    -------
    Buffer
        A store that keeps all samples.

    Raises
    ------
    RecordingError
        The topic is missing, or nothing of it could be stored. With `limits="raise"`: joints beyond
        their limits, each with its furthest position and stamp.
    InvalidArgument
        An unknown word for `limits`.

    Also the errors of `tfdb.load`.

    Warns
    -----
    TfdbWarning
        Joints of the model without a state, joints that the model lacks, positions that are not
        finite (they are skipped) or beyond their limits, refused messages.
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

"""`Transformer`, `TransformerROS` and `TransformListener` of tf."""

# ruff: noqa: N802  (tf's names)

from __future__ import annotations

from copy import deepcopy
from typing import TYPE_CHECKING, Any

from tfdb import _core
from tfdb.data.argument_checks import check_name
from tfdb.ros.ros_messages import fill_header

from .. import geometry, transform_listener
from ..buffer import Buffer
from ..exceptions import TransformException
from ..message_checks import refuse_unlike
from ..transform_argument import rigid

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    import numpy.typing as npt

    from ..buffer_core import Velocity

__all__ = [
    "TransformListener",
    "Transformer",
    "TransformerROS",
    "strip_leading_slash",
    "xyz_to_mat44",
    "xyzw_to_mat44",
]

Pose = tuple[list[float], list[float]]


def strip_leading_slash(s: str) -> str:
    """Drop one '/' before a frame's name."""
    return check_name("a frame's name", s).removeprefix("/")


def xyz_to_mat44(pos: Any) -> npt.NDArray[np.float64]:
    """Return the homogeneous matrix, float64 (4, 4), of a translation in metres."""
    return _matrix((pos.x, pos.y, pos.z), (0.0, 0.0, 0.0, 1.0))


def xyzw_to_mat44(ori: Any) -> npt.NDArray[np.float64]:
    """Return the homogeneous matrix, float64 (4, 4), of a quaternion of any length."""
    return _matrix((0.0, 0.0, 0.0), (ori.x, ori.y, ori.z, ori.w))


def _matrix(translation: Sequence[float], rotation: Sequence[float]) -> npt.NDArray[np.float64]:
    import numpy as np

    quaternion = np.asarray(rotation, dtype=np.float64)
    length = float(np.linalg.norm(quaternion))
    unit = quaternion / length if length else (0.0, 0.0, 0.0, 1.0)
    return _core.Transform("target", "source", translation, unit).matrix


def _numbers(found: Any) -> Pose:
    """Translation x, y, z and quaternion x, y, z, w of a TransformStamped."""
    t, r = found.transform.translation, found.transform.rotation
    return [t.x, t.y, t.z], [r.x, r.y, r.z, r.w]


class Transformer:
    """A store of transforms with the calls of `tf.Transformer`.

    Names may begin with one '/'. Times are those of any ROS library, or integer nanoseconds;
    time 0 is the latest common time.

    Parameters
    ----------
    interpolate
        Accepted as in tf, without effect: lookups interpolate.
    cache_time
        A duration: how long samples are kept. None: 10 s.
    """

    def __init__(self, interpolate: bool = True, cache_time: Any = None) -> None:  # noqa: ARG002
        self._buffer = Buffer(cache_time, debug=False, flavor="ros1")
        self._using_dedicated_thread = False

    def allFramesAsDot(self, current_time: Any = None) -> str:
        """Return the tree as a DOT graph; with a time, also the age of each edge."""
        return self._buffer._allFramesAsDot(current_time or None)

    def allFramesAsString(self) -> str:
        """All frames with their parents, one per line."""
        return self._buffer.all_frames_as_string()

    def setTransform(self, transform: Any, authority: str = "default_authority") -> None:
        """Store a TransformStamped; refusals are logged."""
        self._buffer.set_transform(transform, authority)

    def canTransform(self, target_frame: str, source_frame: str, time: Any) -> Any:
        """Whether `lookupTransform` succeeds."""
        target, source = _plain(target_frame, source_frame)
        return self._buffer.can_transform(target, source, time)

    def canTransformFull(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> Any:
        """Whether `lookupTransformFull` succeeds."""
        target, source, fixed = _plain(target_frame, source_frame, fixed_frame)
        return self._buffer.can_transform_full(target, target_time, source, source_time, fixed)

    def waitForTransform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Any,
        polling_sleep_duration: Any = None,  # noqa: ARG002 - nothing is polled
    ) -> None:
        """Wait until `lookupTransform` succeeds; `tf.Exception` after the timeout.

        The missing transform wakes it; any thread may store that.
        """
        target, source = _plain(target_frame, source_frame)
        found = self._buffer.can_transform(target, source, time, timeout, return_debug_tuple=True)
        _refuse_missing(found, target_frame, source_frame)

    def waitForTransformFull(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Any,
        polling_sleep_duration: Any = None,  # noqa: ARG002 - nothing is polled
    ) -> None:
        """Wait until `lookupTransformFull` succeeds; `tf.Exception` after the timeout."""
        target, source, fixed = _plain(target_frame, source_frame, fixed_frame)
        found = self._buffer.can_transform_full(
            target, target_time, source, source_time, fixed, timeout, return_debug_tuple=True
        )
        _refuse_missing(found, target_frame, source_frame)

    def chain(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> list[str]:
        """Frames on the path from the source through the fixed frame to the target."""
        target, source, fixed = _plain(target_frame, source_frame, fixed_frame)
        return self._buffer._chain(target, target_time, source, source_time, fixed)

    def clear(self) -> None:
        """Drop all moving samples; frames and static transforms stay."""
        self._buffer.clear()

    def frameExists(self, frame_id: str) -> bool:
        """Whether a frame of that name exists and has a parent."""
        return frame_id in self.getFrameStrings()

    def getFrameStrings(self) -> list[str]:
        """Names of all frames that have a parent, sorted."""
        return [info.name for info in self._buffer.buffer.tree() if info.parent is not None]

    def getLatestCommonTime(self, source_frame: str, dest_frame: str) -> Any:
        """Newest time at which every moving edge between two frames has data."""
        source, dest = _plain(source_frame, dest_frame)
        return self._buffer.get_latest_common_time(source, dest)

    def lookupTransform(self, target_frame: str, source_frame: str, time: Any) -> Pose:
        """T[target_frame<-source_frame] at a time: [x, y, z] in metres and [x, y, z, w].

        Raises LookupException, ConnectivityException, ExtrapolationException.
        """
        target, source = _plain(target_frame, source_frame)
        return _numbers(self._buffer.lookup_transform_core(target, source, time))

    def lookupTransformFull(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
    ) -> Pose:
        """T[target_frame at target_time <- source_frame at source_time], through fixed_frame."""
        target, source, fixed = _plain(target_frame, source_frame, fixed_frame)
        return _numbers(
            self._buffer.lookup_transform_full_core(target, target_time, source, source_time, fixed)
        )

    def lookupTwist(
        self, tracking_frame: str, observation_frame: str, time: Any, averaging_interval: Any
    ) -> Velocity:
        """Velocity of a frame as seen from and on the axes of another: m/s and rad/s."""
        tracking, observation = _plain(tracking_frame, observation_frame)
        return self._buffer.lookupVelocityCore(tracking, observation, time, averaging_interval)

    def lookupTwistFull(
        self,
        tracking_frame: str,
        observation_frame: str,
        reference_frame: str,
        ref_point: Sequence[float],
        reference_point_frame: str,
        time: Any,
        averaging_interval: Any,
    ) -> Velocity:
        """As `lookupTwist`, on the axes of `reference_frame`, of a point that moves along.

        `ref_point` is in coordinates of `reference_point_frame`, metres.
        """
        tracking, observation = _plain(tracking_frame, observation_frame)
        reference, point_frame = _plain(reference_frame, reference_point_frame)
        return self._buffer.lookupVelocityFullCore(
            tracking, observation, reference, ref_point, point_frame, time, averaging_interval
        )

    def setUsingDedicatedThread(self, value: Any) -> None:
        """Accepted as in tf, without effect: waits need no dedicated thread."""
        self._using_dedicated_thread = value

    def getTFPrefix(self) -> str:
        """Prefix of all frames: none."""
        return ""


class TransformerROS(Transformer):
    """A `Transformer` that transforms messages: the result has the message's stamp."""

    def asMatrix(self, target_frame: str, hdr: Any) -> npt.NDArray[np.float64]:
        """T[target_frame<-hdr.frame_id] at hdr.stamp: float64 array (4, 4)."""
        refuse_unlike(hdr, "hdr", "a Header", "frame_id", "stamp")
        return self.fromTranslationRotation(
            *self.lookupTransform(target_frame, hdr.frame_id, hdr.stamp)
        )

    def fromTranslationRotation(
        self, translation: Sequence[float], rotation: Sequence[float]
    ) -> npt.NDArray[np.float64]:
        """Return the homogeneous matrix, float64 (4, 4), of x, y, z and a quaternion x, y, z, w.

        The quaternion is normalised; one of length 0 is the identity.
        """
        return _matrix(translation, rotation)

    def _transformed(self, function: Any, target_frame: str, message: Any) -> Any:
        refuse_unlike(message, "the message", "one with a header", "header")
        header = message.header
        target, source = _plain(target_frame, header.frame_id)
        found = self._buffer.lookup_transform_core(target, source, header.stamp)
        made = function(message, found)
        fill_header(made.header, header)
        made.header.frame_id = target_frame
        return made

    def transformPoint(self, target_frame: str, ps: Any) -> Any:
        """Transform a PointStamped into a frame."""
        return self._transformed(geometry.do_transform_point, target_frame, ps)

    def transformVector3(self, target_frame: str, v3s: Any) -> Any:
        """Rotate a Vector3Stamped to the axes of a frame."""
        return self._transformed(geometry.do_transform_vector3, target_frame, v3s)

    def transformQuaternion(self, target_frame: str, ps: Any) -> Any:
        """Rotate a QuaternionStamped into a frame."""
        return self._transformed(geometry.do_transform_quaternion, target_frame, ps)

    def transformPose(self, target_frame: str, ps: Any) -> Any:
        """Transform a PoseStamped into a frame."""
        return self._transformed(geometry.do_transform_pose, target_frame, ps)

    def transformPointCloud(self, target_frame: str, point_cloud: Any) -> Any:
        """Transform the points of a sensor_msgs/PointCloud into a frame; channels are copied."""
        return self._transformed(_move_cloud, target_frame, point_cloud)


def _plain(*frames: str) -> list[str]:
    """Return names of frames without their leading slash."""
    return [strip_leading_slash(each) for each in frames]


def _refuse_missing(found: tuple[bool, str], target: str, source: str) -> None:
    """Raise the error of a wait whose transform is not there."""
    there, why = found
    if not there:
        raise TransformException(why or f'no such transformation: "{source}" -> "{target}"')


def _move_cloud(cloud: Any, transform: Any) -> Any:
    """Transform the points of a PointCloud."""
    made = type(cloud)()
    made.channels = deepcopy(cloud.channels)
    if cloud.points:
        rows = rigid(transform).apply([(point.x, point.y, point.z) for point in cloud.points])
        for given, row in zip(cloud.points, rows.tolist(), strict=True):
            point = type(given)()
            point.x, point.y, point.z = row
            made.points.append(point)
    return made


class TransformListener(TransformerROS):
    """A `TransformerROS` that is filled by the messages on /tf and /tf_static.

    Parameters
    ----------
    *args, **kwargs
        As for `Transformer`.
    node
        As in `tfdb.tf2.TransformListener`.
    """

    def __init__(self, *args: Any, node: Any = None, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._listener = transform_listener.TransformListener(self._buffer, node)
        self.setUsingDedicatedThread(True)

    def unregister(self) -> None:
        """Stop listening."""
        self._listener.unregister()

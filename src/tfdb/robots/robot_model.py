"""Robot models: links, joints, and the poses of the links in a joint state.

A joint's pose is `T[parent<-child]` of the two links it joins: it maps points of the child link
into the parent link, as the store's edges do.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from tfdb.data.argument_checks import check_name
from tfdb.data.errors import InvalidArgument, TfdbWarning
from tfdb.data.stamps import shown
from tfdb.data.types import Columns, TransformStamped

if TYPE_CHECKING:
    from collections.abc import Iterable

    from tfdb._core import Buffer
    from tfdb.data.stamps import StampLike, StampsLike

Array: TypeAlias = npt.NDArray[np.float64]

_WIDTHS = {"fixed": 0, "planar": 3, "floating": 7}


@dataclass(frozen=True)
class JointLimits:
    """Range of a joint's position (radians or metres), largest speed and effort; inf: no limit."""

    lower: float
    upper: float
    velocity: float
    effort: float


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another one: `multiplier * position(joint) + offset`."""

    joint: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class Joint:
    """One joint of a model.

    Parameters
    ----------
    name, kind
        `kind` is `fixed`, `revolute`, `continuous`, `prismatic`, `planar` or `floating`.
    parent, child
        The links.
    origin
        `T[parent<-child]` in the zero position, `[x y z qx qy qz qw]`.
    axis
        Unit vector in the child's frame: axis of rotation, direction of motion, or plane normal.
    limits, mimic
        None where the model has none.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: tuple[float, ...]
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    limits: JointLimits | None = None
    mimic: Mimic | None = None

    @property
    def width(self) -> int:
        """Number of values of its position: 0 fixed, 3 planar (x, y, angle), 7 floating, else 1."""
        return _WIDTHS.get(self.kind, 1)


def _checked_links(links: Any, joints: Any, root: str) -> tuple[str, ...]:
    """Return the links; raise InvalidArgument unless they and the joints form one tree."""
    if not isinstance(links, tuple | list) or not all(isinstance(link, str) for link in links):
        raise InvalidArgument(f"links must be names, got {shown(links)}", value=links)
    if not isinstance(joints, Mapping) or not all(isinstance(j, Joint) for j in joints.values()):
        reason = f"joints must map names to Joint objects, got {shown(joints)}"
        raise InvalidArgument(reason, value=joints)
    below: dict[str, list[str]] = {}
    for joint in joints.values():
        below.setdefault(joint.parent, []).append(joint.child)
    reached = [root]
    for link in reached:
        reached += below.pop(link, [])
    if below or len(reached) != len(links) or set(reached) != set(links):
        raise InvalidArgument(
            f"the joints must form one tree of the links {shown(links)} below {root!r}, but they "
            f"reach {shown(reached)}",
            value=root,
        )
    return tuple(links)


def describe_wide(joints: Iterable[Joint]) -> str:
    """Return the warning for floating and planar joints; empty without such a joint."""
    chosen = list(joints)
    if not chosen:
        return ""
    names = ", ".join(f"{joint.name!r} ({joint.kind})" for joint in chosen)
    edges = ", ".join(f"T[{joint.parent}<-{joint.child}]" for joint in chosen)
    return (
        f"no sensor_msgs/JointState moves joint {names}: {edges} must come from /tf, set_transform "
        "or set_joint_state"
    )


class RobotModel:
    """A tree of links, made by `load_urdf`. Immutable, so any thread may use it.

    A joint state maps joint names to positions:

    - revolute and continuous joints: radians
    - prismatic joints: metres
    - planar joints: `(x, y, angle)` in the plane whose normal is the axis; x and y are those of the
      joint, turned by the shortest rotation from z to the axis
    - floating joints: a pose `[x y z qx qy qz qw]`

    A mimic joint follows its leader unless the state names it. The position of a fixed leader is 0,
    so a joint that mimics it stays at its offset. Joints that the state does not determine are
    omitted, as in ROS's robot_state_publisher.

    Parameters
    ----------
    name
        The robot's name.
    links
        The links' names, in the file's order.
    joints
        The joints by name; together with the links they make one tree (`load_urdf` checks it).
    root
        The link without a parent.

    Raises
    ------
    InvalidArgument
        A link that is not a name, a joint of another type, or joints that do not form a tree.
    """

    def __init__(
        self, name: str, links: tuple[str, ...], joints: Mapping[str, Joint], root: str
    ) -> None:
        self.name: str = check_name("name", name)
        self.links: tuple[str, ...] = _checked_links(links, joints, check_name("root", root))
        self.joints: Mapping[str, Joint] = MappingProxyType(dict(joints))
        self.root = root
        self._single = _SingleJoints(joint for joint in joints.values() if joint.width == 1)

    def __reduce__(self) -> tuple[type[RobotModel], tuple[object, ...]]:
        return RobotModel, (self.name, self.links, dict(self.joints), self.root)

    def __repr__(self) -> str:
        return (
            f"RobotModel({self.name!r}, {len(self.links)} links, {len(self.joints)} joints, "
            f"root {self.root!r})"
        )

    @property
    def movable(self) -> tuple[str, ...]:
        """The joints that a joint state contains: neither fixed nor mimic joints."""
        return tuple(j.name for j in self.joints.values() if j.width and j.mimic is None)

    def forward_kinematics(self, positions: Mapping[str, npt.ArrayLike]) -> dict[str, Array]:
        """Compute `T[parent<-child]` of each joint that is fixed or in the joint state.

        Parameters
        ----------
        positions
            A joint state; or N of them, with N numbers (or rows) in place of each.

        Returns
        -------
        dict
            Joint name to pose `[x y z qx qy qz qw]`, shape (7,), or (N, 7) for N states. Each pose
            is that of the joint's child link in its parent link, not in the root: store them in a
            `Buffer` to look up longer paths.

        Raises
        ------
        InvalidArgument
            An unknown or fixed joint, a position of the wrong shape or not finite, or a joint state
            that is not a mapping.
        """
        moving = self._moving(positions)
        shape = np.broadcast_shapes(*(poses.shape for poses in moving.values()), (7,))
        found: dict[str, Array] = {}
        for name, joint in self.joints.items():
            if joint.kind == "fixed":
                found[name] = np.broadcast_to(np.array(joint.origin), shape).copy()
            elif name in moving:
                found[name] = np.broadcast_to(moving[name], shape).copy()
        return found

    def transforms(
        self, positions: Mapping[str, npt.ArrayLike], stamp: StampLike
    ) -> list[TransformStamped]:
        """Return the moving edges of one joint state at a stamp, for `set_transforms`."""
        found = []
        for name, pose in self._moving(positions).items():
            joint = self.joints[name]
            if pose.ndim != 1:
                raise InvalidArgument(f"joint {name!r}: it must be one position, got an array")
            values = tuple(pose.tolist())
            found.append(TransformStamped(joint.parent, joint.child, stamp, values[:3], values[3:]))
        return found

    def static_transforms(self) -> list[TransformStamped]:
        """Return the edges of the fixed joints, with stamp 0."""
        return [
            TransformStamped(joint.parent, joint.child, 0, joint.origin[:3], joint.origin[3:])
            for joint in self.joints.values()
            if joint.kind == "fixed"
        ]

    def set_static(self, buffer: Buffer, *, authority: str = "") -> int:
        """Store the fixed joints as static edges, in one commit; returns its number.

        Raises the errors of `Buffer.set_transforms`; then nothing was stored. Warns (TfdbWarning)
        of floating and planar joints: their transforms must come from another source.
        """
        text = describe_wide(joint for joint in self.joints.values() if joint.width > 1)
        if text:
            warnings.warn(f"robot {self.name!r}: {text}", TfdbWarning, stacklevel=2)
        return buffer.set_transforms(self.static_transforms(), static=True, authority=authority)

    def set_joint_state(
        self,
        buffer: Buffer,
        stamp: StampLike,
        positions: Mapping[str, npt.ArrayLike],
        *,
        authority: str = "",
    ) -> int:
        """Store the edges that a joint state determines, in one commit; returns its number.

        `positions` maps joint names to positions at the stamp (nanoseconds).

        Raises `InvalidArgument` as `forward_kinematics`, and the errors of `Buffer.set_transforms`;
        then nothing was stored.
        """
        batch = self.transforms(positions, stamp)
        if not batch:
            raise InvalidArgument("the joint state has no position of a moving joint of the model")
        return buffer.set_transforms(batch, authority=authority)

    def set_joint_states(
        self,
        buffer: Buffer,
        stamps: StampsLike,
        positions: Mapping[str, npt.ArrayLike],
        *,
        authority: str = "",
    ) -> int:
        """Store N joint states at N stamps (nanoseconds), all in one commit; returns its number.

        `positions` has an array of N for each joint. Raises as `set_joint_state` does.
        """
        when = np.asarray(stamps)
        if when.ndim != 1:
            raise InvalidArgument(f"stamps must be of shape (N,), not {when.shape}")
        moving = self._moving(positions)
        if not moving:
            raise InvalidArgument(
                "the joint states have no position of a moving joint of the model"
            )
        try:
            columns = [np.broadcast_to(pose, (len(when), 7)) for pose in moving.values()]
        except ValueError:
            raise InvalidArgument(f"positions do not match {len(when)} stamps") from None
        # Stamp by stamp, so that the batch grows in time order.
        poses = np.stack(columns, axis=1).reshape(-1, 7)
        joints = [self.joints[name] for name in moving]
        batch = Columns(
            [joint.parent for joint in joints] * len(when),
            [joint.child for joint in joints] * len(when),
            np.repeat(when, len(joints)),
            poses,
        )
        return buffer.set_transforms(batch, authority=authority)

    def _moving(self, positions: Mapping[str, npt.ArrayLike]) -> dict[str, Array]:
        """Return poses (7,) or (N, 7) of the joints that a state determines, in model order."""
        if not isinstance(positions, Mapping):
            raise InvalidArgument(
                f"a joint state must map joint names to positions, got {shown(positions)}",
                value=positions,
            )
        given: dict[str, Array] = {}
        for name, position in positions.items():
            joint = self.joints.get(name)
            if joint is None:
                raise InvalidArgument(f"the model {self.name!r} has no joint {name!r}")
            given[name] = _checked(joint, position)
        single = {n: value for n, value in given.items() if self.joints[n].width == 1}
        single |= {
            n: value for n in self._single.names if (value := self.follow(n, given)) is not None
        }
        try:
            poses = self._single.poses(single)
            for name, value in given.items():
                if name not in single:
                    poses[name] = _wide_pose(self.joints[name], value)
            np.broadcast_shapes(*(pose.shape for pose in poses.values()))
        except ValueError:
            shapes = {name: value.shape for name, value in given.items()}
            raise InvalidArgument(f"positions must have equal lengths, got {shapes}") from None
        return {name: poses[name] for name in self.joints if name in poses}

    def follow(self, name: str, given: Mapping[str, Any]) -> Any:
        """Return the position of a joint: as given, or computed from the joint that it mimics.

        None if neither is given.
        """
        scale, offset = 1.0, 0.0
        while name not in given:
            joint = self.joints[name]
            mimic = joint.mimic
            if mimic is None:
                return offset if joint.kind == "fixed" else None
            scale, offset = scale * mimic.multiplier, scale * mimic.offset + offset
            name = mimic.joint
        return scale * given[name] + offset


class _SingleJoints:
    """The joints with one position each, as arrays, so that all poses are computed at once.

    With q0 the origin's rotation and a the axis, q0 * (a sin h, cos h) is linear in sin h and
    cos h: cos h * q0 + sin h * (q0 * a), where h is half the angle, and 0 for prismatic joints.
    """

    def __init__(self, joints: Iterable[Joint]) -> None:
        chosen = list(joints)
        self.names = tuple(joint.name for joint in chosen)
        self._index = {name: index for index, name in enumerate(self.names)}
        origins = np.array([joint.origin for joint in chosen]).reshape(-1, 7)
        axes = np.array([joint.axis for joint in chosen]).reshape(-1, 3)
        slides = np.array([joint.kind == "prismatic" for joint in chosen], dtype=bool)
        self._start = origins[:, :3]
        self._slide = np.where(slides[:, np.newaxis], rotate(origins[:, 3:], axes), 0.0)
        self._half = np.where(slides, 0.0, 0.5)
        self._q0 = origins[:, 3:]
        self._q1 = multiply(origins[:, 3:], np.hstack((axes, np.zeros((len(axes), 1)))))

    def poses(self, positions: Mapping[str, Array]) -> dict[str, Array]:
        """Return `T[parent<-child]` by name; raises ``ValueError`` if the shapes do not match."""
        if not positions:
            return {}
        at = [self._index[name] for name in positions]
        values = np.stack(np.broadcast_arrays(*positions.values()), axis=-1)[..., np.newaxis]
        half = values * self._half[at, np.newaxis]
        moved = np.concatenate(
            (
                self._start[at] + values * self._slide[at],
                np.cos(half) * self._q0[at] + np.sin(half) * self._q1[at],
            ),
            axis=-1,
        )
        return {name: moved[..., index, :] for index, name in enumerate(positions)}


def _checked(joint: Joint, position: npt.ArrayLike) -> Array:
    """Return a position as an array: () or (N,) for one number, (k,) or (N, k) for k numbers."""
    if joint.kind == "fixed":
        raise InvalidArgument(f"joint {joint.name!r} is fixed and has no position")
    try:
        value = np.asarray(position, dtype=np.float64)
    except (TypeError, ValueError):
        raise InvalidArgument(f"joint {joint.name!r}: the position is not a number") from None
    inner = value.ndim if joint.width == 1 else value.ndim - 1
    if inner not in (0, 1) or (joint.width > 1 and value.shape[-1] != joint.width):
        raise InvalidArgument(
            f"joint {joint.name!r} ({joint.kind}) needs {joint.width} number(s) for each state, "
            f"got an array of shape {value.shape}"
        )
    if not np.isfinite(value).all():
        raise InvalidArgument(f"joint {joint.name!r}: the position is not finite")
    return value


def _wide_pose(joint: Joint, value: Array) -> Array:
    """Return `T[parent<-child]` of a planar or floating joint."""
    origin = np.array(joint.origin)
    if joint.kind == "planar":
        plane = np.array(_from_z(joint.axis))
        offset = np.concatenate((value[..., :2], np.zeros_like(value[..., :1])), axis=-1)
        half = value[..., 2:] / 2
        motion = np.concatenate(
            (rotate(plane, offset), np.sin(half) * np.array(joint.axis), np.cos(half)), axis=-1
        )
    else:
        motion = value
    return np.concatenate(
        (
            origin[:3] + rotate(origin[3:], motion[..., :3]),
            multiply(origin[3:], motion[..., 3:]),
        ),
        axis=-1,
    )


def _from_z(axis: tuple[float, float, float]) -> tuple[float, float, float, float]:
    """Return the shortest rotation from z to a unit axis; for -z, 180 degrees about x."""
    x, y, z = axis
    if z < -1 + 1e-12:
        return 1.0, 0.0, 0.0, 0.0
    norm = math.sqrt(2 * (1 + z))
    return -y / norm, x / norm, 0.0, norm / 2


def multiply(a: Array, b: Array) -> Array:
    """Return the quaternion products a * b of `[x y z w]` rows."""
    ax, ay, az, aw = np.moveaxis(a, -1, 0)
    bx, by, bz, bw = np.moveaxis(b, -1, 0)
    return np.stack(
        (
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ),
        axis=-1,
    )


def rotate(q: Array, v: Array) -> Array:
    """Rotate vectors by unit quaternions `[x y z w]`."""
    u, w = q[..., :3], q[..., 3:]
    t = 2 * np.cross(u, v)
    turned: Array = v + w * t + np.cross(u, t)
    return turned

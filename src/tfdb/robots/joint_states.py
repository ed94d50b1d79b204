"""Converts joint states to transforms by a robot model, and reports mismatches."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tfdb.data.counting import counted
from tfdb.data.stamps import format_seconds

from .robot_model import describe_wide

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping, Sequence

    from tfdb.data.types import TransformStamped

    from .robot_model import Joint, JointLimits, RobotModel

# Accuracy of encoders: a position that exceeds a limit by less counts as at the limit.
_SLACK = 1e-6


@dataclass(frozen=True)
class BeyondLimits:
    """A joint that was beyond its limits in `count` states, furthest at `position` and `stamp`."""

    joint: str
    limits: JointLimits
    count: int
    position: float
    stamp: int

    def __str__(self) -> str:
        low, high = self.limits.lower, self.limits.upper
        return (
            f"{self.joint!r} is beyond its limits, {low:g} to {high:g}, in "
            f"{counted(self.count, 'state')}; the furthest is {self.position:g} at "
            f"{format_seconds(self.stamp)}"
        )


@dataclass(frozen=True)
class JointReport:
    """Counts of read joint states, and their mismatches with the robot model.

    Parameters
    ----------
    states
        Number of messages of joint states.
    missing
        Moving joints that are in no message: their frames have no parent.
    wide
        Floating and planar joints without a transform: a joint state has one number for each joint,
        so it cannot place them.
    unknown
        Joints in the messages that the model does not have.
    beyond
        Joints beyond their limits (radians, metres), including mimic joints; their transforms are
        stored.
    not_finite
        Joints with infinite or NaN positions, and the number of such messages; these positions are
        skipped.
    """

    states: int
    missing: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    beyond: tuple[BeyondLimits, ...] = ()
    not_finite: Mapping[str, int] = field(default_factory=dict)
    wide: tuple[Joint, ...] = ()

    def __str__(self) -> str:
        """Write the number of states and the mismatches in one line."""
        return "; ".join([counted(self.states, "joint state"), *self.complaints()])

    def complaints(self) -> Iterator[str]:
        """Texts of warnings, one for each kind."""
        if self.missing:
            yield f"no joint state names {_few(self.missing)}: the links below have no parent"
        if self.wide:
            yield describe_wide(self.wide)
        if self.unknown:
            yield f"the joint states name {_few(self.unknown)}, which the model lacks"
        if self.beyond:
            yield "joint " + "; ".join(map(str, self.beyond))
        if self.not_finite:
            yield f"infinite or NaN positions are skipped, of {_few(tuple(self.not_finite))}"


class JointStates:
    """Makes transforms from joint states, one after the other.

    Parameters
    ----------
    model
        The robot.
    taken
        Frames whose transforms come from elsewhere: the model makes none for them.
    """

    def __init__(self, model: RobotModel, taken: Iterable[str] = ()) -> None:
        self._model = model
        self._taken = frozenset(taken)
        self.fixed: list[TransformStamped] = [
            each for each in model.static_transforms() if each.child not in self._taken
        ]
        self._mimics = {each.name: each.limits for each in model.joints.values() if each.mimic}
        self._states = 0
        self._named: set[str] = set()
        self._unknown: set[str] = set()
        self._not_finite: dict[str, int] = {}
        self._beyond: dict[str, BeyondLimits] = {}

    def again(self) -> JointStates:
        """Return a new converter with the same model and empty counts."""
        return JointStates(self._model, self._taken)

    def transforms(self, stamp: int, angles: Mapping[str, float]) -> list[TransformStamped]:
        """Return the moving edges that one state determines."""
        self._states += 1
        positions: dict[str, float] = {}
        for name, position in angles.items():
            joint = self._model.joints.get(name)
            if joint is None:
                self._unknown.add(name)
            elif joint.width == 1 and not math.isfinite(position):
                self._not_finite[name] = self._not_finite.get(name, 0) + 1
            elif joint.width == 1:
                positions[name] = position
                self._check(name, joint.limits, position, stamp)
        self._named |= positions.keys()
        for name, limits in self._mimics.items():
            if name not in positions and (led := self._model.follow(name, positions)) is not None:
                self._check(name, limits, led, stamp)
        made = self._model.transforms(positions, stamp)
        return [each for each in made if each.child not in self._taken]

    def _check(self, name: str, limits: JointLimits | None, position: float, stamp: int) -> None:
        if limits is None:
            return
        by = max(limits.lower - position, position - limits.upper)
        if by <= _SLACK:
            return
        before = self._beyond.get(name)
        count = 1 if before is None else before.count + 1
        if before is not None:
            worst = max(limits.lower - before.position, before.position - limits.upper)
            if by <= worst:
                position, stamp = before.position, before.stamp
        self._beyond[name] = BeyondLimits(name, limits, count, position, stamp)

    def report(self) -> JointReport:
        """Return the report of the states so far."""
        joints = self._model.joints
        missing = [
            name
            for name in self._model.movable
            if name not in self._named
            and joints[name].width == 1
            and joints[name].child not in self._taken
        ]
        wide = [
            joint for joint in joints.values() if joint.width > 1 and joint.child not in self._taken
        ]
        return JointReport(
            self._states,
            tuple(missing),
            tuple(sorted(self._unknown)),
            tuple(self._beyond.values()),
            dict(self._not_finite),
            tuple(wide),
        )


def _few(names: Sequence[str]) -> str:
    more = f" and {len(names) - 10} more" if len(names) > 10 else ""
    return ", ".join(map(repr, names[:10])) + more

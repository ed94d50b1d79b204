"""tf2's errors for writes and lookups that tfdb refuses."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

from tfdb.data import errors
from tfdb.ros import msgs

from . import phrases
from .exceptions import (
    BackwardExtrapolationException,
    ConnectivityException,
    ExtrapolationException,
    ForwardExtrapolationException,
    InvalidArgumentException,
    NoDataForExtrapolationException,
    TransformException,
    with_fields_of,
)
from .lookup_failures import Gap, TwoTrees
from .message_checks import WrongMessageError

if TYPE_CHECKING:
    from collections.abc import Callable

    from tfdb.ros.times import Flavor

LOGGER = logging.getLogger("tfdb.tf2")
CONTROL = "has a control character"
"""Reason in the error for a name with a control character."""
ROUNDING = 1e-9
"""Largest difference of a normalised quaternion's length from 1."""


@dataclass(frozen=True, slots=True)
class Write:
    """T[parent<-child] of a message."""

    parent: str
    child: str
    stamp: int
    translation: Any
    rotation: Any
    authority: str

    @property
    def finite(self) -> bool:
        """Whether all its numbers are finite."""
        move, turn = self.translation, self.rotation
        return all(map(math.isfinite, (move.x, move.y, move.z, turn.x, turn.y, turn.z, turn.w)))

    @property
    def length(self) -> float:
        """Length of its quaternion, whose numbers are readable."""
        turn = self.rotation
        return math.hypot(turn.x, turn.y, turn.z, turn.w)

    def normalized(self) -> Self | None:
        """Normalise its quaternion; None: it has unit length, or cannot be normalised."""
        turn, length = self.rotation, self.length
        if not 0 < length < math.inf or abs(length - 1) < ROUNDING:
            return None
        parts = (turn.x / length, turn.y / length, turn.z / length, turn.w / length)
        return replace(self, rotation=msgs.Quaternion(*parts))

    def check_members(self) -> None:
        """Raise TypeError with tf2's text, unless the numbers are readable."""
        for value, members, role in (
            (self.translation, "x, y, z", "translation"),
            (self.rotation, "x, y, z, w", "rotation"),
        ):
            for member in members.split(", "):
                if not hasattr(value, member):
                    raise TypeError(f"transform.{role} must have members {members}")
                number = getattr(value, member)
                if not hasattr(number, "__float__") and not hasattr(number, "__index__"):
                    text = f"transform.{role}.{member} must be a number, got {number!r}"
                    raise TypeError(text)

    @classmethod
    def of(cls, message: Any, authority: str, nanoseconds: Callable[[Any], int]) -> Self:
        """Read a TransformStamped; TypeError if it is none."""
        if not isinstance(authority, str):
            raise TypeError(f"authority must be a str, got {type(authority).__name__}")
        try:
            header, pose, child = message.header, message.transform, message.child_frame_id
            parent, stamp = header.frame_id, header.stamp
            translation, rotation = pose.translation, pose.rotation
        except AttributeError as missing:
            text = f"transform must be a TransformStamped, got {type(message).__name__}"
            raise WrongMessageError(f"{text}, which has no attribute {missing.name!r}") from None
        if not isinstance(parent, str) or not isinstance(child, str):
            raise TypeError("header.frame_id and child_frame_id must be str")
        names = (parent.removeprefix("/"), child.removeprefix("/"))
        write = cls(*names, nanoseconds(stamp), translation, rotation, authority)
        if rotation is None:  # a store reads a missing rotation as the identity
            write.check_members()
        return write


def phrase(write: Write, error: errors.TfdbError, flavor: Flavor) -> str | None:
    """Return tf2's text for a refused write, by tf2's order of checks; None: another error."""
    who, child = write.authority, write.child
    match error:
        case errors.InvalidTransform() | errors.InvalidName() | errors.InvalidStamp():
            if child == write.parent:
                return phrases.self_transform(who, child)
            if not child:
                return phrases.no_child(who)
            if not write.parent:
                return phrases.no_parent(who, child)
            if isinstance(error, errors.InvalidStamp):
                return phrases.bad_stamp(who, child, write.stamp)
            if isinstance(error, errors.InvalidName):
                return phrases.bad_frame(who, write.parent, child)
            if not write.finite:
                return phrases.no_number(who, child, write.translation, write.rotation)
            return phrases.denormalized(who, child, write.rotation)
        case errors.TooOld():
            return phrases.old_data(flavor, who, child, write.stamp)
        case errors.RepeatedStamp():
            return phrases.repeated_data(who, child, write.stamp)
        case errors.CycleError():
            return phrases.loop(who, write.parent, child)
        case _:
            return None


def log(text: str, error: errors.TfdbError) -> None:
    """Log a refusal; the record's `error` is tfdb's, with its fields."""
    LOGGER.warning("%s", text, extra={"error": error})


def log_unread(error: errors.TfdbError, authority: str) -> None:
    """Log why a transform of a message is unreadable, with tf2's text if it has one."""
    text = str(error)
    if isinstance(error, errors.InvalidStamp) and error.stamp is not None:
        text = phrases.bad_stamp(authority, error.edge or "", error.stamp)
    elif isinstance(error, errors.InvalidName) and error.reason == CONTROL:
        text = phrases.bad_frame(authority, error.parent or "", error.edge or "")
    log(text, error)


def reason(failure: Gap | TwoTrees, flavor: Flavor, target: str, source: str) -> str:
    """Return tf2's text for a failed lookup of T[target<-source]."""
    if isinstance(failure, TwoTrees):
        return phrases.two_trees(target, source)
    return phrases.extrapolation(
        flavor, failure.stamp, failure.oldest, failure.newest, target, source
    )


def extrapolation(
    gap: Gap, flavor: Flavor, target: str, source: str, cause: errors.TfdbError
) -> TransformException:
    """Make tf2's error for an edge without data at a stamp."""
    kind: type[ExtrapolationException] = NoDataForExtrapolationException
    what = "no data"
    if gap.oldest is not None and gap.newest is not None:
        what = "past" if gap.stamp < gap.oldest else "future"
        if gap.oldest < gap.newest:
            past = what == "past"
            kind = BackwardExtrapolationException if past else ForwardExtrapolationException
    text = reason(gap, flavor, target, source)
    fields = {"edge": gap.edge, "stamp": gap.stamp, "oldest": gap.oldest, "newest": gap.newest}
    return with_fields_of(cause, kind, text, **fields, reason=what, target=target, source=source)


def translated(
    cause: errors.TfdbError, flavor: Flavor, target: str, source: str
) -> TransformException:
    """Make tf2's error from one of tfdb, for a lookup that succeeds in tf2."""
    if isinstance(cause, errors.Extrapolation):
        stamp, oldest, newest = cause.stamp or 0, cause.oldest, cause.newest
        text = phrases.extrapolation(flavor, stamp, oldest, newest, target, source)
        return with_fields_of(cause, ExtrapolationException, text)
    if isinstance(cause, errors.Disconnected):
        text = phrases.two_trees(target, source)
        return with_fields_of(cause, ConnectivityException, text)
    if isinstance(cause, errors.InvalidArgument):
        return with_fields_of(cause, InvalidArgumentException, str(cause))
    return with_fields_of(cause, TransformException, str(cause))

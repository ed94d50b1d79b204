"""The texts of tf2, for which users search: equal to the letter, including odd blanks."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from tfdb.data.stamps import shown

if TYPE_CHECKING:
    from tfdb.ros.times import Flavor

SECOND = 1_000_000_000
UNITS = {3: 1_000_000, 6: 1_000, 9: 1}  # nanoseconds of the last digit, by number of digits
FORMS = {digits: f"%d.%0{digits}d" for digits in UNITS}
REASONS = "http://wiki.ros.org/tf/Errors%20explained"


def seconds(stamp: int, digits: int) -> str:
    """Write nanoseconds as seconds, without a float, so that all nine digits are exact."""
    if stamp < 0:
        return "-" + seconds(-stamp, digits)
    unit = UNITS[digits]
    whole, rest = divmod(stamp + unit // 2, SECOND)
    return FORMS[digits] % (whole, rest // unit)


def bad_name(flavor: Flavor, function: str, role: str, name: str) -> str:
    """Text for a name that is empty or starts with a slash.

    `function` is the name of tf2's function (canTransform returns the text, the others raise it).
    """
    where = f"{function} argument {role}" if role else function
    rule = "cannot be empty" if not name else "cannot start with a '/'"
    if flavor == "ros2":
        what = "frame ID" if function == "canTransform" else "argument"
        return f'Invalid {what} "{name}" passed to {where} - in tf2 frame_ids {rule}'
    if not name:
        return f"Invalid argument passed to {where} in tf2 frame_ids {rule}"
    return f'Invalid argument "{name}" passed to {where} in tf2 frame_ids {rule} like: '


def unknown(flavor: Flavor, function: str, role: str, name: str) -> str:
    """Text for a name without a frame."""
    if function == "canTransform":
        if flavor == "ros2":
            return (
                f'Invalid frame ID "{name}" passed to canTransform argument {role}'
                " - frame does not exist"
            )
        return f"canTransform: {role} {name} does not exist."
    where = f"{function} argument {role}" if role else function
    return f'"{name}" passed to {where} does not exist. '


def two_trees(target: str, source: str) -> str:
    """Text for two frames without a path."""
    return (
        f"Could not find a connection between '{target}' and '{source}' because they are not part "
        "of the same tree.Tf has two or more unconnected trees."
    )


def extrapolation(
    flavor: Flavor, stamp: int, oldest: int | None, newest: int | None, target: str, source: str
) -> str:
    """Text for an edge with data from `oldest` to `newest`, and none at `stamp`."""
    digits = 9 if flavor == "ros1" else 6
    asked = seconds(stamp, digits)
    if oldest is None or newest is None:
        what = (
            f"Lookup would require extrapolation at time {asked}, but only time "
            f"{seconds(0, digits)} is in the buffer"
        )
        what = "" if flavor == "ros1" else what
    elif oldest == newest:
        what = (
            f"Lookup would require extrapolation at time {asked}, but only time "
            f"{seconds(oldest, digits)} is in the buffer"
        )
    else:
        future = stamp > newest
        edge = newest if future else oldest
        amount = f"{seconds(abs(stamp - edge), digits)}s " if flavor == "ros1" else ""
        side, which = ("future", "latest") if future else ("past", "earliest")
        what = (
            f"Lookup would require extrapolation {amount}into the {side}.  Requested time {asked} "
            f"but the {which} data is at time {seconds(edge, digits)}"
        )
    return f"{what}, when looking up transform from frame [{source}] to frame [{target}]"


def self_transform(authority: str, frame: str) -> str:
    """Log text for a frame that is its own parent."""
    return (
        f'TF_SELF_TRANSFORM: Ignoring transform from authority "{authority}" with frame_id and '
        f'child_frame_id  "{frame}" because they are the same'
    )


def no_child(authority: str) -> str:
    """Log text for a transform without a child."""
    return (
        f'TF_NO_CHILD_FRAME_ID: Ignoring transform from authority "{authority}" because '
        "child_frame_id not set "
    )


def no_parent(authority: str, child: str) -> str:
    """Log text for a transform without a parent."""
    return (
        f'TF_NO_FRAME_ID: Ignoring transform with child_frame_id "{child}"  from authority '
        f'"{authority}" because frame_id not set'
    )


def no_number(authority: str, child: str, translation: Any, rotation: Any) -> str:
    """Log text for numbers that are not finite; tf2 logs NaN only."""
    t, q = translation, rotation
    return (
        f'TF_NAN_INPUT: Ignoring transform for child_frame_id "{child}" from authority '
        f'"{authority}" because of a nan value in the transform ({t.x:f} {t.y:f} {t.z:f}) '
        f"({q.x:f} {q.y:f} {q.z:f} {q.w:f})"
    )


def denormalized(authority: str, child: str, rotation: Any) -> str:
    """Log text for a quaternion without unit length."""
    q = rotation
    return (
        f'TF_DENORMALIZED_QUATERNION: Ignoring transform for child_frame_id "{child}" from '
        f'authority "{authority}" because of an invalid quaternion in the transform '
        f"({q.x:f} {q.y:f} {q.z:f} {q.w:f})"
    )


def normalized(authority: str, child: str, rotation: Any, length: float) -> str:
    """Log text for a normalised quaternion, once for each edge."""
    q = rotation
    return (
        f'TF_DENORMALIZED_QUATERNION: The quaternion of child_frame_id "{child}" from authority '
        f'"{authority}" has the length {length:g}, not 1 ({q.x:f} {q.y:f} {q.z:f} {q.w:f}). It is '
        "normalized, here and in later transforms of this frame"
    )


def old_data(flavor: Flavor, authority: str, child: str, stamp: int) -> str:
    """Log text for a sample older than the cache."""
    when = seconds(stamp, 6)
    if flavor == "ros1":
        return (
            f"TF_OLD_DATA ignoring data from the past (Possible reasons are listed at {REASONS}) "
            f"for frame {child} at time {when} according to authority {authority}"
        )
    return (
        f"TF_OLD_DATA ignoring data from the past for frame {child} at time {when} according to "
        f"authority {authority}\nPossible reasons are listed at {REASONS}"
    )


def repeated_data(authority: str, child: str, stamp: int) -> str:
    """Log text of ROS 1 for a repeated stamp."""
    return (
        f"TF_REPEATED_DATA ignoring data with redundant timestamp for frame {child} at time "
        f"{seconds(stamp, 6)} according to authority {authority}"
    )


def loop(authority: str, parent: str, child: str) -> str:
    """Log text for a transform that would close a loop; upstream stores it."""
    return (
        f'TF_LOOP: Ignoring transform from authority "{authority}" with frame_id "{parent}" and '
        f'child_frame_id "{child}" because they would close a loop'
    )


def future_data(authority: str, child: str, newest: int, ahead: int) -> str:
    """Log text for a stamp that makes all valid data of a frame too old; not in tf2."""
    return (
        f'TF_FUTURE_DATA: the newest transform of child_frame_id "{child}", from authority '
        f'"{authority}", has the time {seconds(newest, 6)}, {seconds(ahead, 6)} s ahead of this '
        "clock: transforms with the current time are now too old, until the buffer is cleared"
    )


def bad_stamp(authority: str, child: str, stamp: int) -> str:
    """Log text for an invalid stamp; ROS 2's tf2 stores it."""
    return (
        f'TF_BAD_STAMP: Ignoring transform for child_frame_id "{child}" from authority '
        f'"{authority}" because its time {seconds(stamp, 9)} is negative or too large'
    )


def bad_frame(authority: str, parent: str, child: str) -> str:
    """Log text for an invalid name; tf2 stores it."""
    return (
        f"TF_BAD_FRAME_ID: Ignoring transform with frame_id {shown(parent)} and child_frame_id "
        f'{shown(child)} from authority "{authority}" because of control characters or its length'
    )

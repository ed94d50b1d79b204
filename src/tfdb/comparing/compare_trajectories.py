"""`tfdb.compare`."""

from __future__ import annotations

import math
import warnings
from operator import index
from typing import TYPE_CHECKING, Any, Literal

from tfdb._core import Transform
from tfdb.data.argument_checks import check_flag, check_word
from tfdb.data.decimal_time import UNITS as STAMP_UNITS
from tfdb.data.errors import InvalidArgument, NotComparable, TfdbWarning
from tfdb.data.stamps import MAX_STAMP, shown
from tfdb.trajectories.trajectory import Trajectory

from .alignment import MODES, NEEDED, align
from .association import associate
from .comparison import Comparison, Errors
from .inputs import Reading, pairs_by_row, to_trajectory
from .pairs import UNITS, check_delta, find_pairs
from .poses import angles, distances, relative
from .quaternion_order import order_hint
from .time_offset import estimate_offset

if TYPE_CHECKING:
    from tfdb.data.decimal_time import Unit

    from .alignment import Align
    from .association import MatchedPoses
    from .inputs import Frames, TrajectoryLike
    from .pairs import DeltaUnit

_ASSOCIATIONS = ("interpolate", "nearest", "rows")
_PAIRS_FROM = ("estimate", "reference")


def compare(
    reference: TrajectoryLike,
    estimate: TrajectoryLike,
    *,
    frames: Frames | None = None,
    estimate_frames: Frames | None = None,
    association: Literal["interpolate", "nearest", "rows"] = "interpolate",
    max_diff: float | None = None,
    offset: float | Literal["estimate"] = 0.0,
    align: Align = "se3",
    align_poses: int | None = None,
    delta: float = 1.0,
    delta_unit: DeltaUnit = "frames",
    all_pairs: bool = False,
    delta_tolerance: float = 0.1,
    pairs_from: Literal["estimate", "reference"] = "estimate",
    salvage: bool = False,
    stamp_unit: Unit | None = None,
) -> Comparison:
    """Compute APE (ATE) and RPE of an estimated trajectory against a reference, as evo does.

    Parameters
    ----------
    reference, estimate
        A Trajectory; or the path of a TUM, KITTI, EuRoC, CSV or NPZ file; or a Buffer, a Snapshot
        or the path of a recording or frozen store, each with its `frames`. Rows with NaN hold no
        pose and are not matched.
    frames, estimate_frames
        Target and source: the trajectory is T[target<-source] at each stored stamp. The default for
        the estimate is the frames of the reference.
    association
        `interpolate`: the trajectory with more poses in the common time is interpolated at the
        stamps of the other (if equal: at those of the estimate). `nearest`: each pose of the
        trajectory with fewer poses is matched with the nearest of the other, evo's default; the
        motion between their stamps counts as error. `rows`: row by row, for trajectories of equal
        length, without regard to stamps. That is the default, as in evo, for two files of KITTI
        poses unless both have a file of times.
    max_diff
        Longest time in seconds between a stamp and the nearest pose of the other trajectory; other
        stamps are left out. Gaps of more than twice this time are not interpolated. None: 0.01 for
        `nearest`, 2.5 median periods of the interpolated trajectory for `interpolate`.
    offset
        Seconds to add to the estimate's stamps. `estimate` computes this offset from both motions;
        half of the shorter trajectory must overlap the longer one.
    align
        The transform that is fitted to align the estimate with the reference: `se3` (rotation and
        translation), `sim3` (also a scale), `scale` only, `yaw` (a rotation about z and a
        translation, for estimates with a known direction of gravity), `origin` (the first poses
        coincide), `none`. By Umeyama's method (IEEE TPAMI 13(4), 1991).
    align_poses
        Number of matched poses to fit, from the first. None: all.
    delta, delta_unit
        Interval of the relative error: `frames` (matched poses), metres of path (`m`), seconds
        (`s`), rotation in `deg` or `rad`.
    all_pairs
        Begin an interval at every pose, not only at the end of the previous interval.
    delta_tolerance
        Relative tolerance on `delta`, used with `all_pairs` unless `delta_unit` is `frames`.
    pairs_from
        The trajectory whose path and rotation define the intervals.
    salvage, stamp_unit
        How trajectory files are read, as in `Trajectory.read`. `salvage` also reads
        damaged recordings, as in `tfdb.load`.

    Returns
    -------
    Comparison
        The errors with their stamps, in metres and radians, their statistics, the matched and
        aligned trajectories, the alignment.

    Raises
    ------
    NotComparable
        No common time, too few matched poses, an undetermined alignment (positions in one place or
        on a straight line), no pair that is `delta` apart, an undetermined offset. Field: reason.
    InvalidArgument
        An option outside its range, or frames that are missing.
    InvalidTransform
        A row that is not a pose. Field: index.

    Also the errors of `Trajectory.read`, `tfdb.load` and `Buffer.trajectory`.

    Warns
    -----
    TfdbWarning
        The positions agree, but the rotations do not, and they would agree with the quaternions of
        one trajectory read as w x y z. Also the warnings of `Trajectory.read`.
    """
    if stamp_unit is not None:
        check_word("stamp_unit", stamp_unit, STAMP_UNITS)
    check_word("association", association, _ASSOCIATIONS)
    check_word("align", align, tuple(MODES))
    check_word("delta_unit", delta_unit, UNITS)
    check_word("pairs_from", pairs_from, _PAIRS_FROM)
    limit = None if max_diff is None else _nanoseconds("max_diff", max_diff)
    given_offset = _offset(offset)
    _number("delta", delta, above=0.0)
    _number("delta_tolerance", delta_tolerance)
    check_delta(delta, delta_unit)
    fitted = _fitted(align_poses, align)
    if association == "interpolate" and pairs_by_row(reference, estimate, delta_unit):
        association = "rows"
    if association == "rows" and (given_offset != 0 or limit is not None):
        reason = "association='rows' ignores stamps: give no offset and no max_diff"
        raise InvalidArgument(reason, value=offset if limit is None else max_diff)
    reading = Reading(check_flag("salvage", salvage), stamp_unit, association == "rows")
    ours = to_trajectory(reference, frames, "reference", "frames", reading)
    others = frames if estimate_frames is None else estimate_frames
    theirs = to_trajectory(estimate, others, "estimate", "estimate_frames", reading)
    if given_offset is None:
        given_offset = estimate_offset(ours, theirs, scaled=align in ("sim3", "scale"))
    matched = associate(ours, theirs, how=association, max_diff=limit, offset=given_offset)
    options: dict[str, Any] = {
        "offset": given_offset,
        "offset_estimated": isinstance(offset, str),
        "given": (len(ours), len(theirs)),
        "association": association,
        "align": align,
        "delta": float(delta),
        "delta_unit": delta_unit,
        "all_pairs": check_flag("all_pairs", all_pairs),
    }
    by_reference = pairs_from == "reference"
    given = ours, theirs
    return _judge(
        matched, given, fitted, options, tolerance=delta_tolerance, by_reference=by_reference
    )


def _judge(
    matched: MatchedPoses,
    given: tuple[Trajectory, Trajectory],
    fitted: int | None,
    options: dict[str, Any],
    *,
    tolerance: float,
    by_reference: bool,
) -> Comparison:
    """Align, and measure the remaining error."""
    ours, theirs = given
    how = options["align"]
    if len(matched.stamps) < NEEDED[how]:
        in_time = f"match in time, within {matched.max_diff / 1e9:g} s"
        by_row = options["association"] == "rows"
        raise NotComparable(
            f"only {len(matched.stamps)} of {min(options['given'])} poses "
            f"{'are in both' if by_row else in_time}: align={how!r} needs {NEEDED[how]}"
            f"{'' if by_row else '; give a larger max_diff (--max-diff), or an offset (--offset)'}",
            reason="too few matches",
            limit=matched.max_diff,
        )
    fit = align(matched.reference[:fitted], matched.estimate[:fitted], how)
    moved = fit.apply(matched.estimate)
    hint = order_hint(matched, fit)
    if hint:
        warnings.warn(hint, TfdbWarning, stacklevel=3)
    stamps = matched.stamps
    pairs = find_pairs(
        stamps,
        matched.reference if by_reference else moved,
        options["delta"],
        options["delta_unit"],
        all_pairs=options["all_pairs"],
        tolerance=tolerance,
    )
    absolute = relative(matched.reference, moved)
    first, second = pairs.T
    over = relative(
        relative(matched.reference[first], matched.reference[second]),
        relative(moved[first], moved[second]),
    )
    return Comparison(
        reference=Trajectory._made(ours.target, ours.source, stamps, matched.reference),
        estimate=Trajectory._made(ours.target, theirs.source, stamps, moved),
        ape_translation=Errors("APE translation", "m", stamps, distances(absolute)),
        ape_rotation=Errors("APE rotation", "rad", stamps, angles(absolute)),
        rpe_translation=Errors("RPE translation", "m", stamps[second], distances(over)),
        rpe_rotation=Errors("RPE rotation", "rad", stamps[second], angles(over)),
        pairs=pairs,
        alignment=Transform(ours.target, theirs.target, fit.translation, fit.quaternion),
        scale=fit.scale,
        max_diff=matched.max_diff,
        **options,
    )


def _offset(offset: Any) -> int | None:
    """Return an offset in nanoseconds; None if it must be estimated."""
    if isinstance(offset, str):
        check_word("offset", offset, ("estimate",), "a number of seconds")
        return None
    return _nanoseconds("offset", offset, signed=True)


def _number(name: str, value: Any, *, above: float | None = None, least: float = 0.0) -> None:
    """Refuse a value that is not a finite number above (or at least) a bound."""
    wanted = f"above {above:g}" if above is not None else f"of at least {least:g}"
    try:
        fine = not isinstance(value, bool | str) and math.isfinite(value)
        if fine and (value > above if above is not None else value >= least):
            return
    except (TypeError, ValueError, ArithmeticError):
        pass
    raise InvalidArgument(f"{name} must be a number {wanted}, got {shown(value)}", value=value)


def _nanoseconds(name: str, seconds: Any, *, signed: bool = False) -> int:
    most = MAX_STAMP / 1e9
    try:
        size = abs(seconds) if signed else seconds
        if not isinstance(seconds, bool | str) and 0 <= size <= most:
            return round(float(seconds) * 1e9)
    except (TypeError, ValueError, ArithmeticError):
        pass
    low = f"{-most:.0f}" if signed else "0"
    also = " or 'estimate'" if name == "offset" else ""
    raise InvalidArgument(
        f"{name} must be a number of seconds from {low} to {most:.0f}{also}, got {shown(seconds)}",
        value=seconds,
    )


def _fitted(count: Any, how: Align) -> int | None:
    if count is None:
        return None
    try:
        if not isinstance(count, bool) and index(count) >= NEEDED[how]:
            return index(count)
    except TypeError:
        pass
    message = f"align_poses must be None or a whole number >= {NEEDED[how]}"
    raise InvalidArgument(f"{message}, got {shown(count)}", value=count)

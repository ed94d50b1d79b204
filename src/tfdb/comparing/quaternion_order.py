"""Detects quaternions that were read in the wrong order."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from .poses import angles, distances, relative

if TYPE_CHECKING:
    from .alignment import Similarity
    from .association import MatchedPoses
    from .poses import Array

Role = Literal["reference", "estimate"]

_ORDERS = (("w x y z", (1, 2, 3, 0)), ("x y z w", (3, 0, 1, 2)))
"""Possible orders in a file, with the indices that convert them to x y z w."""
_OFF = np.deg2rad(10.0)
_PART = 0.2


def order_hint(matched: MatchedPoses, fit: Similarity) -> str:
    """Describe quaternions that seem to be in another order; empty if they do not.

    They seem so if the positions agree within a tenth of their extent, and another order of one
    trajectory's quaternions makes the rotations agree far better.
    """
    moved = fit.apply(matched.estimate)
    errors = relative(matched.reference, moved)
    before = float(np.median(angles(errors)))
    points = matched.reference[:, :3]
    extent = float(np.sqrt(np.mean(distances(matched.reference - _middle(points)) ** 2)))
    agree = float(np.sqrt(np.mean(distances(errors) ** 2))) <= 0.1 * extent
    if before < _OFF or not agree:
        return ""
    for order, places in _ORDERS:
        for role in ("estimate", "reference"):
            after = _reordered(matched, fit, role, places)
            if after <= _PART * before:
                names = " ".join(f"q{part}" for part in order.split())
                return (
                    f"the positions agree, but the rotations are {np.rad2deg(before):.3g} deg off; "
                    f"the quaternions of the {role} may be in the order {order}, with which they "
                    f"are {np.rad2deg(after):.3g} deg off: name the columns in the first line of "
                    f"the file, such as `timestamp x y z {names}`"
                )
    return ""


def _middle(points: Array) -> Array:
    middle = np.zeros((1, 7))
    middle[0, :3] = points.mean(axis=0)
    return middle


def _reordered(matched: MatchedPoses, fit: Similarity, role: str, places: tuple[int, ...]) -> float:
    """Return the median angle between the rotations, with the quaternions of one reordered."""
    given = {"reference": matched.reference, "estimate": matched.estimate}
    changed = given[role].copy()
    changed[:, 3:] = changed[:, [3 + place for place in places]]
    given[role] = changed
    return float(np.median(angles(relative(given["reference"], fit.apply(given["estimate"])))))

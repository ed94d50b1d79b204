"""The result of a comparison: errors with their stamps, statistics, the alignment."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Literal

import numpy as np

from tfdb.data.counting import counted
from tfdb.data.decimal_time import NS_PER_SECOND

from .alignment import MODES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tfdb._core import Transform
    from tfdb.trajectories.trajectory import Trajectory

    from .alignment import Align
    from .pairs import DeltaUnit
    from .poses import Array, Rows, Stamps

STATISTICS = ("rmse", "mean", "median", "std", "min", "max", "sse")


@dataclass(frozen=True, slots=True, eq=False)
class Errors:
    """Errors of one kind over time, and their statistics.

    The statistics are in `unit`, the sum of squares (sse) in its square.

    Parameters
    ----------
    name
        Name of the errors, such as `APE translation`.
    unit
        `m`, or `rad` for angles from 0 to pi.
    stamps
        (N,) nanoseconds on the reference's clock. The stamp of a relative error is that of the
        second pose of its pair.
    values
        (N,) errors, none of them negative.
    """

    name: str
    unit: Literal["m", "rad"]
    stamps: Stamps
    values: Array

    def __len__(self) -> int:
        return len(self.values)

    def __repr__(self) -> str:
        return (
            f"<tfdb.comparing.Errors {self.name}: {len(self)} from {self.min:.6g} to "
            f"{self.max:.6g} {self.unit}, rmse {self.rmse:.6g} {self.unit}>"
        )

    @property
    def rmse(self) -> float:
        """Root of the mean square."""
        return float(np.sqrt(np.mean(self.values**2)))

    @property
    def mean(self) -> float:
        """Mean."""
        return float(np.mean(self.values))

    @property
    def median(self) -> float:
        """Median."""
        return float(np.median(self.values))

    @property
    def std(self) -> float:
        """Population standard deviation."""
        return float(np.std(self.values))

    @property
    def min(self) -> float:
        """The smallest error."""
        return float(np.min(self.values))

    @property
    def max(self) -> float:
        """The largest error."""
        return float(np.max(self.values))

    @property
    def sse(self) -> float:
        """Sum of the squares."""
        return float(np.sum(self.values**2))

    @property
    def statistics(self) -> dict[str, float]:
        """All statistics by name."""
        return {name: getattr(self, name) for name in STATISTICS}

    def in_degrees(self) -> dict[str, float]:
        """All statistics by name, in degrees instead of radians."""
        factor = 180.0 / np.pi if self.unit == "rad" else 1.0
        return {
            name: value * (factor**2 if name == "sse" else factor)
            for name, value in self.statistics.items()
        }


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """The error of an estimated trajectory against a reference. `print` shows the table.

    The absolute pose error (APE, also ATE) is reference^-1 * estimate, for each pair of matched
    poses. The relative pose error (RPE) is the same for their motions over `delta`: J. Sturm et
    al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012. Both errors have a
    translation and a rotation.

    Parameters
    ----------
    reference
        The matched poses T[target<-source] of the reference.
    estimate
        The matched poses of the estimate, aligned. Row i belongs to row i of `reference`.
    ape_translation, rpe_translation
        Lengths of the errors' translations, metres.
    ape_rotation, rpe_rotation
        Angles of the errors' rotations, radians.
    pairs
        (M, 2) rows of the two matched poses of each relative error.
    alignment
        T[reference.target<-estimate.target]; applies to positions multiplied by `scale`.
    scale
        Scale of the estimate's positions.
    offset, offset_estimated
        Nanoseconds that were added to the estimate's stamps, and whether tfdb estimated them.
    given
        Number of poses of the reference and of the estimate, before matching.
    association, max_diff
        How poses were matched; the limit in nanoseconds, 0 for `rows`.
    align, delta, delta_unit, all_pairs
        As in `tfdb.compare`.
    """

    reference: Trajectory
    estimate: Trajectory
    ape_translation: Errors
    ape_rotation: Errors
    rpe_translation: Errors
    rpe_rotation: Errors
    pairs: Rows
    alignment: Transform
    scale: float
    offset: int
    offset_estimated: bool
    given: tuple[int, int]
    association: Literal["interpolate", "nearest", "rows"]
    max_diff: int
    align: Align
    delta: float
    delta_unit: DeltaUnit
    all_pairs: bool

    @property
    def has_stamps(self) -> bool:
        """False for KITTI poses without times: their stamps are row numbers, in seconds."""
        stamps = self.reference.stamps
        whole = bool((stamps % NS_PER_SECOND == 0).all())
        numbers = whole and int(stamps[-1]) < self.given[0] * NS_PER_SECOND
        return not (self.association == "rows" and numbers)

    def __len__(self) -> int:
        """Number of matched poses."""
        return len(self.reference)

    def __repr__(self) -> str:
        return (
            f"<tfdb.Comparison of {counted(len(self), 'pose')}: "
            f"APE {self.ape_translation.rmse:.6g} m, "
            f"{np.rad2deg(self.ape_rotation.rmse):.4g} deg rmse; RPE "
            f"{self.rpe_translation.rmse:.6g} m, {np.rad2deg(self.rpe_rotation.rmse):.4g} deg "
            f"per {self._per}>"
        )

    def __str__(self) -> str:
        facts = [f"{name:<10} {text}" for name, text in self._facts()]
        columns = self._columns()
        over = "APE (absolute)".rjust(26) + f"RPE (per {self._per})".rjust(26)
        heads = (("translation", "rotation") * 2, ("m", "deg") * 2)
        lines = [" " * 6 + over]
        lines += [" " * 6 + "".join(cell.rjust(13) for cell in head) for head in heads]
        for name in STATISTICS:
            cells = [_number(column[name]) for column in columns]
            lines.append(name.ljust(6) + "".join(cell.rjust(13) for cell in cells))
        return "\n".join([*facts, "", *lines])

    def _repr_html_(self) -> str:
        facts = "".join(
            f"<tr><td>{escape(name)}</td><td colspan=4>{escape(text)}</td></tr>"
            for name, text in self._facts()
        )
        heads = "<th>translation [m]</th><th>rotation [deg]</th>" * 2
        rows = "".join(
            f"<tr><th>{name}</th>"
            + "".join(f"<td>{_number(column[name])}</td>" for column in self._columns())
            + "</tr>"
            for name in STATISTICS
        )
        return (
            f"<table>{facts}<tr><th></th><th colspan=2>APE (absolute)</th>"
            f"<th colspan=2>RPE (per {escape(self._per)})</th></tr>"
            f"<tr><th></th>{heads}</tr>{rows}</table>"
        )

    def plot(self, *, title: str | None = None) -> Figure:
        """Draw both trajectories and the errors over time: `tfdb.plot.comparison`.

        Needs matplotlib (`pip install 'tfdb[plot]'`).
        """
        from tfdb.plot import comparison  # noqa: PLC0415 - it is an extra

        return comparison(self, title=title)

    @property
    def _per(self) -> str:
        if self.delta_unit == "frames":
            return f"{self.delta:.0f} frame{'' if self.delta == 1 else 's'}"
        return f"{self.delta:g} {self.delta_unit}"

    def _columns(self) -> list[dict[str, float]]:
        kinds = (self.ape_translation, self.ape_rotation, self.rpe_translation, self.rpe_rotation)
        return [errors.in_degrees() for errors in kinds]

    def _facts(self) -> list[tuple[str, str]]:
        """The lines above the table: how the numbers were computed."""
        ways = {"interpolate": "interpolated", "nearest": "nearest"}
        if self.association == "rows":
            within = "row by row"
        else:
            within = f"{ways[self.association]}, max_diff {self.max_diff / 1e6:.4g} ms"
        facts = [("matched", f"{counted(len(self), 'pose')}, {within}")]
        if self.offset or self.offset_estimated:
            how = ", estimated" if self.offset_estimated else ""
            facts.append(("offset", f"{self.offset / 1e9:+.9f} s{how}"))
        facts.append(("aligned", MODES[self.align]))
        if self.align in ("sim3", "scale"):
            facts.append(("scale", f"{self.scale:.9g}"))
        facts.append(("pairs", f"{len(self.pairs):,}{' (all)' if self.all_pairs else ''}"))
        return facts


def _number(value: float) -> str:
    """Write six decimals, as evo does, or an exponent for other magnitudes."""
    return f"{value:.6f}" if value == 0 or 1e-6 <= value < 1e6 else f"{value:.4e}"

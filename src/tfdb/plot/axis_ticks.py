"""Ticks of an axis: plain numbers without a common factor or offset, with room between them."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

from matplotlib.ticker import AutoLocator, Formatter

from . import label_fitting

if TYPE_CHECKING:
    from collections.abc import Sequence

_LARGE = 1e7
_SMALL = 1e-4
_SPARE = 6.0
"""Space between two numbers, in points."""


def number(value: float, digits: int = 2) -> str:
    """Write a number with `digits` decimals, or with an exponent if it is huge."""
    return f"{value:,.{digits}f}" if abs(value) < _LARGE else f"{value:.4g}"


class TickFormatter(Formatter):
    """Writes the ticks of an axis with equally many digits, enough to distinguish them."""

    def __call__(self, x: float, pos: int | None = None) -> str:  # noqa: ARG002 - matplotlib's
        """Write one number."""
        return self.format_ticks([x])[0]

    def format_ticks(self, values: Sequence[float]) -> list[str]:
        """Write all numbers of an axis."""
        given = [float(value) for value in values]
        steps = [abs(b - a) for a, b in pairwise(given) if b != a]
        largest = max(map(abs, given), default=0.0)
        slack = min(steps, default=largest) * 1e-3
        # UTM coordinates stay plain.
        plain = not largest or _SMALL <= largest < _LARGE
        form = "f" if plain else "e"
        found: list[str] = []
        for digits in range(16):
            found = [f"{value:.{digits}{form}}" for value in given]
            if all(
                abs(float(text) - value) <= slack for text, value in zip(found, given, strict=True)
            ):
                break
        return [self.fix_minus(_short(text)) for text in found]


def _short(text: str) -> str:
    """Write 5e7 for 5e+07, and no -0."""
    if not float(text):
        return text.lstrip("-").split("e")[0]
    head, _, power = text.partition("e")
    return f"{head}e{int(power)}" if power else head


class SparseLocator(AutoLocator):
    """Places as many ticks on the x axis as have room for their texts."""

    def tick_values(self, vmin: float, vmax: float) -> Any:
        """Return the positions of the ticks."""
        axis: Any = self.axis
        figure = axis.axes.get_figure(root=True)
        room = axis.axes.get_window_extent().width / figure.dpi * 72
        size = axis.get_tick_params().get("labelsize", 8.0)
        places: Any = ()
        for bins in range(max(min(axis.get_tick_space(), 9), 1), 0, -1):
            self.set_params(nbins=bins)
            places = super().tick_values(vmin, vmax)
            wide = max(
                label_fitting.width(text, size) for text in TickFormatter().format_ticks(places)
            )
            if (wide + _SPARE) * len(places) <= room:
                break
        return places

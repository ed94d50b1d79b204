"""Checks that a picture is readable: every text inside it, without overlaps."""

from __future__ import annotations

from itertools import combinations
from typing import TYPE_CHECKING, Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

if TYPE_CHECKING:
    import pytest
    from matplotlib.figure import Figure
    from matplotlib.transforms import Bbox


def drawn_texts(
    figure: Figure, monkeypatch: pytest.MonkeyPatch, dpi: float | None = None
) -> list[tuple[str, Bbox]]:
    """Return every text that is drawn, with its box in pixels."""
    found: list[tuple[str, Bbox]] = []
    draw = Text.draw

    def noted(self: Text, renderer: Any) -> None:
        if self.get_visible() and self.get_text().strip():
            found.append((self.get_text(), self.get_window_extent(renderer)))
        draw(self, renderer)

    if dpi is not None:
        figure.set_dpi(dpi)
    with monkeypatch.context() as patch:
        patch.setattr(Text, "draw", noted)
        FigureCanvasAgg(figure).draw()
    return found


def assert_legible(
    figure: Figure, monkeypatch: pytest.MonkeyPatch, dpi: float | None = None
) -> list[str]:
    """Fail where a text leaves the figure or meets another; return all texts."""
    texts = drawn_texts(figure, monkeypatch, dpi)
    assert texts
    width, height = figure.bbox.width, figure.bbox.height
    for text, box in texts:
        inside = box.x0 >= -1 and box.y0 >= -1 and box.x1 <= width + 1 and box.y1 <= height + 1
        assert inside, f"{text!r} leaves the picture: {box} of {width} x {height}"
    # Half a pixel is what rounding moves a letter by.
    for (one, a), (other, b) in combinations(texts, 2):
        apart = a.x1 <= b.x0 + 0.5 or b.x1 <= a.x0 + 0.5 or a.y1 <= b.y0 + 0.5 or b.y1 <= a.y0 + 0.5
        assert apart, f"{one!r} and {other!r} overlap: {a} and {b}"
    return [text for text, _ in texts]

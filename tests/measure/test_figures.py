"""The pictures of the evaluation, drawn from invented figures, are readable."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

pytest.importorskip("matplotlib")
from tests.plot.legible import assert_legible
from tfdb_measure import figures, pages
from tfdb_measure.points import ENGINES, SWEEPS
from tfdb_measure.results import Results

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE_WIDTH = 880
"""Pixels that a page of documentation gives a picture."""
SMALLEST = 10.0
"""Pixels from the top of a letter to the foot of one that reaches below the line."""


@pytest.fixture(scope="module")
def drawn() -> dict[str, Figure]:
    """Every picture, with lines that end closely together."""
    rng = np.random.default_rng(3)
    results = Results()
    for sweep, what in SWEEPS.items():
        for label, settings in what.varied.items():
            for engine in ENGINES:
                level = 10 ** rng.uniform(4, 4.4)
                for turn in (1, 2):
                    row = {
                        "threads": 2,
                        "joints": 1000,
                        "read_length": 16,
                        "write_length": 16,
                        "reads_done": 1000,
                        "writes_done": 1000,
                        "retries": int(rng.integers(0, 900)),
                        "lapped_reads": 0,
                        "reads_lost": 0,
                        "writes_lost": 0,
                        "reads_deadlines_met": 0.97,
                        "edges_per_read": 16,
                    }
                    for lane in ("reads", "writes", "operations", "age"):
                        row[f"{lane}_per_s"] = level * rng.uniform(0.8, 1.2)
                        row[f"{lane}_edges_per_s"] = level * 16
                        for i, share in enumerate(("p50", "p90", "p99", "p999", "max")):
                            row[f"{lane}_{share}_ns"] = level * 10 ** (i + rng.uniform(0, 0.2))
                    row["threads"] = int(settings.get("threads", 2))
                    results.add(sweep, label, turn, engine, row)
    return figures.draw(results)


def test_every_picture_is_there(drawn: dict[str, Figure]) -> None:
    assert set(SWEEPS) | {"aborts", "prediction"} == set(drawn)


@pytest.mark.parametrize("name", [*SWEEPS, "aborts", "prediction"])
def test_pictures_can_be_read(
    name: str, drawn: dict[str, Figure], monkeypatch: pytest.MonkeyPatch
) -> None:
    figure = drawn[name]
    shown = assert_legible(figure, monkeypatch, pages.DPI)
    assert set(ENGINES[:1]) <= set(shown)
    assert not [text for text in shown if "…" in text]
    # As wide as the page, no text is smaller than this.
    shrunk = min(1.0, PAGE_WIDTH / (figure.get_figwidth() * pages.DPI))
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        if text.get_visible() and text.get_text().strip():
            height = text.get_fontsize() / 72 * pages.DPI * shrunk
            assert height >= SMALLEST, f"{text.get_text()!r}: {height:.1f} pixels"

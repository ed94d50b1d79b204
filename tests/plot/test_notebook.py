"""Pictures in a notebook: each cell is run by a real kernel."""

from __future__ import annotations

import asyncio
import base64
from pathlib import Path

import pytest

pytest.importorskip("matplotlib")
nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")

BAG = Path(__file__).resolve().parents[2] / "examples" / "data" / "pr2.bag"
PNG = b"\x89PNG\r\n\x1a\n"
MAKE = f"""
import tfdb
buf = tfdb.load({str(BAG)!r})
path = buf.trajectory("map", "base_footprint")
"""
DRAWS = [
    "path.plot()",
    "tfdb.compare(path, path).plot()",
    "tfdb.plot.trajectory(path)",
    "tfdb.plot.frame_tree(buf)",
    "tfdb.plot.timeline(buf)",
    "tfdb.plot.show(path.plot())",
]


def pictures_of(before: str, *cells: str) -> list[list[dict[str, str]]]:
    """Run a notebook; for each of `cells` return the outputs that hold a picture or are text."""
    book = nbformat.v4.new_notebook(
        cells=[nbformat.v4.new_code_cell(text) for text in (before, *cells)]
    )
    client = nbclient.NotebookClient(book, timeout=120, kernel_name="python3")
    asyncio.run(client.async_execute())
    return [
        [
            output.get("data", {"text/plain": output.get("text", "")})
            for output in cell.outputs
            if output.output_type != "error"
        ]
        for cell in book.cells[1:]
    ]


@pytest.mark.parametrize("inline", [False, True], ids=["plain", "inline"])
def test_the_last_line_of_a_cell_shows_its_figure_once(inline: bool) -> None:
    before = MAKE + ("\n%matplotlib inline" if inline else "")
    for text, shown in zip(DRAWS, pictures_of(before, *DRAWS), strict=True):
        pictures = [data["image/png"] for data in shown if "image/png" in data]
        assert len(pictures) == len(shown) == 1, (text, [sorted(data) for data in shown])
        assert base64.b64decode(pictures[0]).startswith(PNG), text
        assert len(pictures[0]) > 10_000, text


def test_a_figure_that_is_not_the_last_line_is_not_shown() -> None:
    (shown,) = pictures_of(MAKE, "figure = path.plot()\nfigure.get_size_inches()[0] > 1")
    assert [sorted(data) for data in shown] == [["text/plain"]]

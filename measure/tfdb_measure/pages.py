"""The pages in docs/: what stands between their markers is written from results alone."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from PIL import Image

from tfdb.plot import style

from . import claims, goals
from .figure_parts import COLOURS
from .points import SWEEPS
from .report import COLUMNS, USUAL, rows
from .results import number

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Mapping
    from pathlib import Path

    from matplotlib.figure import Figure

    from .results import Results

BENCHMARKS, EVALUATION, SWEPT = "benchmarks.md", "evaluation.md", "sweeps.md"
PICTURES = "evaluation"
DPI = 130  # more than a page shows, so that screens of many pixels have them
SHADES = (1.0, 0.6, 0.3, 0.1)  # of a colour on white, as smooth edges and bands have


def between(text: str, name: str, lines: Iterable[str]) -> str:
    """Replace what stands between the page's markers of that name."""
    begin, end = f"<!-- {name}: begin -->", f"<!-- {name}: end -->"
    before, found, rest = text.partition(begin)
    _, closed, after = rest.partition(end)
    if not found or not closed:
        raise ValueError(f"the page has no markers for {name!r}")
    return "\n".join([before + begin, "", *lines, "", end + after])


def parts(results: Results, about: Mapping[str, str]) -> dict[str, dict[str, list[str]]]:
    """Return every generated part of every page: page, name of the markers, lines."""
    head = [f"{about['text']} Measured at commit {about['commit']}, {about['date']}."]
    made: dict[str, dict[str, list[str]]] = {
        page: {"about": head} for page in (BENCHMARKS, EVALUATION, SWEPT)
    }
    ours, engines = goals.judge(goals.ROWS, results), goals.judge(goals.ENGINES, results)
    if any(verdict.figures for verdict in ours):
        made[BENCHMARKS]["felt"] = list(goals.felt(results))
        made[BENCHMARKS]["goals"] = list(goals.table(ours))
        made[BENCHMARKS]["rows"] = list(_rows(results))
    if any(verdict.figures for verdict in engines):
        made[EVALUATION]["goals"] = list(goals.table(engines))
    swept = [name for name in results.sweeps() if name in SWEEPS]
    if swept:
        made[EVALUATION] |= {
            "claims": list(claims.claims(results)),
            "losses": list(claims.losses(results)),
        }
        made[SWEPT]["prediction"] = list(claims.prediction(results))
        made[SWEPT] |= {f"sweep {name}": list(_sweep(results, name)) for name in swept}
    return made


def write(
    folder: Path, made: Mapping[str, Mapping[str, list[str]]], drawn: Mapping[str, Figure]
) -> list[Path]:
    """Write the parts into the pages of a folder, and the pictures beside them."""
    written = []
    for name, of_page in made.items():
        if set(of_page) == {"about"}:
            continue  # nothing of it was measured
        page = folder / name
        text = page.read_text(encoding="utf-8")
        for marker, lines in of_page.items():
            text = between(text, marker, lines)
        page.write_text(text, encoding="utf-8")
        written.append(page)
    for name, figure in drawn.items():
        _picture(figure, folder / PICTURES / f"{name}.png")
    return written


def _rows(results: Results) -> Iterator[str]:
    """Write every row of contenders."""
    yield "| of | row | unit | medians |"
    yield "|---|---|---|---|"
    for sweep in results.sweeps():
        for label in results.labels(sweep):
            unit = results.unit(sweep, label)
            if unit:
                yield f"| {sweep} | {label} | {unit} | {results.shown(sweep, label)} |"


def _sweep(results: Results, name: str) -> Iterator[str]:
    columns = COLUMNS.get(name, USUAL)
    yield f"![{SWEEPS[name].title}]({PICTURES}/{name}.png)"
    yield ""
    yield "<details><summary>Table (medians)</summary>"
    yield ""
    yield (
        "| " + " | ".join([SWEEPS[name].axis or "case", "engine", *(c[0] for c in columns)]) + " |"
    )
    yield "|---|---" + "|---:" * len(columns) + "|"
    for label, engine, cells in rows(results, name):
        shown = ["" if s is None else number(s.median * factor) for s, factor in cells]
        yield "| " + " | ".join([label, engine, *shown]) + " |"
    yield ""
    yield "</details>"


def _picture(figure: Figure, path: Path) -> None:
    """Draw a small PNG."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=DPI)
    whole = Image.open(file).convert("RGB")
    path.parent.mkdir(exist_ok=True)
    whole.quantize(palette=_palette(), dither=Image.Dither.NONE).save(path, optimize=True)


def _palette() -> Image.Image:
    """The pictures' own colours: one found by counting pixels would give engines each other's."""
    used = [*COLOURS.values(), style.INK, style.MUTED, style.FAINT]
    colours = [
        round(255 - shade * (255 - int(colour[place : place + 2], 16)))
        for colour in used
        for shade in SHADES
        for place in (1, 3, 5)
    ]
    image = Image.new("P", (1, 1))
    image.putpalette([255, 255, 255, *colours])
    return image

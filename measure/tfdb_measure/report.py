"""The one-page report: head, figures, and a table of each sweep; one file that needs no other."""

from __future__ import annotations

import base64
import html
import io
from typing import TYPE_CHECKING

from tfdb.data.new_file import new_file

from .points import SWEEPS
from .results import number

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from .results import Results, Spread

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #22303c; margin: 2rem auto; max-width: 72rem;
       padding: 0 1rem; }
h1 { margin-bottom: .2rem; }
dl { display: grid; grid-template-columns: max-content auto; gap: .1rem 1rem; }
dt { color: #74818d; } dd { margin: 0; }
code { background: #f2f5f7; padding: .1rem .3rem; overflow-wrap: anywhere; }
img { max-width: 100%; height: auto; } figure { margin: 2.6rem 0 0; }
table { border-collapse: collapse; font-size: 13px; margin-top: .6rem; }
th, td { padding: .15rem .7rem; text-align: right; border-bottom: 1px solid #d9dfe4; }
th:first-child, td:first-child { text-align: left; }
.note { color: #74818d; } .warning { color: #cf3d2e; }
details { margin-top: .4rem; }
"""

COLUMNS: dict[str, tuple[tuple[str, str, float], ...]] = {
    "cars": (
        ("lookup 99.9 % [us]", "reads_p999_ns", 1e-3),
        ("write 99.9 % [us]", "writes_p999_ns", 1e-3),
        ("lookups in time [%]", "reads_deadlines_met", 100.0),
        ("writes in time [%]", "writes_deadlines_met", 100.0),
    ),
    "age": (
        ("age, median [ms]", "age_p50_ns", 1e-6),
        ("age, 99 % [ms]", "age_p99_ns", 1e-6),
        ("spread, median [ms]", "spread_p50_ns", 1e-6),
        ("writes/s", "writes_per_s", 1.0),
    ),
    "latency": tuple(
        (f"{lane[:-1]} {name} [us]", f"{lane}_{share}_ns", 1e-3)
        for lane in ("reads", "writes")
        for share, name in (("p50", "50 %"), ("p99", "99 %"), ("p999", "99.9 %"), ("max", "max"))
    ),
    "starvation": (
        ("lookups/s", "reads_per_s", 1.0),
        ("longest lookup [ms]", "reads_max_ns", 1e-6),
        ("writes/s", "writes_per_s", 1.0),
        ("longest write [ms]", "writes_max_ns", 1e-6),
        ("aborts per operation", "aborts_per_operation", 1.0),
    ),
}
"""What a sweep's table shows, where it is not the usual: title, column, factor."""

USUAL = (
    ("lookups/s", "reads_per_s", 1.0),
    ("writes/s", "writes_per_s", 1.0),
    ("lookup 99 % [us]", "reads_p99_ns", 1e-3),
    ("write 99 % [us]", "writes_p99_ns", 1e-3),
    ("aborts per operation", "aborts_per_operation", 1.0),
)


def write(
    folder: Path,
    results: Results,
    head: Mapping[str, str],
    figures: Mapping[str, Figure],
    failures: Sequence[str],
    doubts: Sequence[str] = (),
) -> Path:
    """Write ``report.html`` and one PNG per figure; return the page's path."""
    pictures = {}
    for name, figure in figures.items():
        file = io.BytesIO()
        figure.savefig(file, format="png", dpi=144)
        (folder / f"{name}.png").write_bytes(file.getvalue())
        pictures[name] = base64.b64encode(file.getvalue()).decode("ascii")
    page = folder / "report.html"
    lines = _page(results, head, pictures, failures, doubts)
    with new_file(page, overwrite=True) as made:
        made.write_text("\n".join(lines), encoding="utf-8")
    return page


def _page(
    results: Results,
    head: Mapping[str, str],
    pictures: Mapping[str, str],
    failures: Sequence[str],
    doubts: Sequence[str],
) -> Iterator[str]:
    title = "tfdb bench"
    yield '<!doctype html><html lang="en"><head><meta charset="utf-8">'
    yield '<meta name="viewport" content="width=device-width, initial-scale=1">'
    yield f"<title>{title}</title><style>{_STYLE}</style></head><body>"
    yield f"<h1>{title}</h1><dl>"
    for name, text in head.items():
        shown = f"<code>{html.escape(text)}</code>" if name == "command" else html.escape(text)
        yield f"<dt>{html.escape(name)}</dt><dd>{shown}</dd>"
    yield "</dl>"
    yield (
        '<p class="note">One colour for each engine throughout. The engine <code>tf2</code> is '
        "asked for time 0, the latest common time, and writes a batch edge by edge: it has "
        "neither a newest-of-each-edge lookup nor atomic writes.</p>"
    )
    yield from (f'<p class="warning">{html.escape(text)}</p>' for text in doubts)
    if failures:
        yield f'<p class="warning">{len(failures)} of the runs failed:</p><ul>'
        yield from (f"<li>{html.escape(text)}</li>" for text in failures)
        yield "</ul>"
    for name, picture in pictures.items():
        heading = SWEEPS[name].title if name in SWEEPS else name.capitalize()
        yield (
            f'<figure id="{name}"><img alt="{html.escape(heading)}" '
            f'src="data:image/png;base64,{picture}"></figure>'
        )
        if name in SWEEPS:
            yield "<details><summary>Table: median (smallest to largest round)</summary>"
            yield from _table(results, name)
            yield "</details>"
    yield "</body></html>"


def _table(results: Results, sweep: str) -> Iterator[str]:
    columns = COLUMNS.get(sweep, USUAL)
    heads = "".join(f"<th>{html.escape(title)}</th>" for title, _, _ in columns)
    yield f"<table><tr><th>{html.escape(SWEEPS[sweep].axis)}</th><th>engine</th>{heads}</tr>"
    for label, engine, cells in rows(results, sweep):
        shown = "".join(f"<td>{_cell(spread, factor)}</td>" for spread, factor in cells)
        yield f"<tr><td>{html.escape(label)}</td><td>{html.escape(engine)}</td>{shown}</tr>"
    yield "</table>"


def rows(
    results: Results, sweep: str
) -> Iterator[tuple[str, str, list[tuple[Spread | None, float]]]]:
    """Return label, engine and (spread, factor) of each column of the sweep's table."""
    for label in results.labels(sweep):
        for engine in results.engines(sweep):
            cells = [
                (results.get(sweep, label, engine, column), factor)
                for _, column, factor in COLUMNS.get(sweep, USUAL)
            ]
            if any(spread is not None for spread, _ in cells):
                yield label, engine, cells


def _cell(spread: Spread | None, factor: float) -> str:
    if spread is None:
        return ""
    middle, low, high = (
        number(value * factor) for value in (spread.median, spread.low, spread.high)
    )
    return middle if low == high else f"{middle} ({low} to {high})"

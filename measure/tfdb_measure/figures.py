"""The pictures of a report: one for each sweep, one colour for each engine in all of them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from matplotlib.ticker import (
    FixedLocator,
    FuncFormatter,
    NullFormatter,
    NullLocator,
)

from tfdb.plot import style

from . import figure_parts as parts
from . import model
from .points import SWEEPS, TF2

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .results import Results, Spread

SHARES = (
    ("p50", "median"),
    ("p90", "90 %"),
    ("p99", "99 %"),
    ("p999", "99.9 %"),
    ("max", "longest"),
)


_READS = parts.Panel("reads_per_s", "lookups per second")
_WRITES = parts.Panel("writes_per_s", "writes per second")
_ABORTS = parts.Panel("aborts_per_operation", "aborts per operation")
_PANELS: dict[str, tuple[parts.Panel, ...]] = {
    "readers": (_READS, parts.Panel("reads_p99_ns", "lookup, 99th percentile [us]", 1e-3)),
    "writers": (_WRITES, parts.Panel("writes_p99_ns", "write, 99th percentile [us]", 1e-3)),
    "read-ratio": (parts.Panel("operations_per_s", "operations per second"), _ABORTS),
    "read-length": (_READS, parts.Panel("reads_edges_per_s", "edges looked up per second")),
    "write-length": (_WRITES, parts.Panel("writes_edges_per_s", "edges written per second")),
    "age": (
        parts.Panel("age_p50_ns", "age of the oldest sample used, median [ms]", 1e-6),
        parts.Panel("age_p99_ns", "the same, 99th percentile [ms]", 1e-6),
    ),
    "cars": (
        parts.Panel("reads_p999_ns", "lookup, 99.9th percentile [us]", 1e-3),
        parts.Panel("writes_p999_ns", "write, 99.9th percentile [us]", 1e-3),
        parts.Panel("reads_deadlines_met", "lookups within 8.3 ms [%]", 100.0, log=False),
    ),
    "starvation": (
        _READS,
        parts.Panel("reads_max_ns", "longest lookup [ms]", 1e-6),
        _WRITES,
    ),
}
_ONE_VALUE = ("cars", "starvation")
_COUNTED = ("threads", "skew", "joints", "write-length")  # where aborts are shown, two at most


def draw(results: Results) -> dict[str, Figure]:
    """Return one figure for each sweep that has results, and that of the aborts."""
    made: dict[str, Figure] = {}
    for sweep in results.sweeps():
        if sweep == "latency":
            made[sweep] = _latency(results)
        elif sweep in _ONE_VALUE:
            made[sweep] = _one_value(results, sweep)
        elif SWEEPS[sweep].numeric:
            made[sweep] = _lines(results, sweep, _PANELS.get(sweep, (_READS, _WRITES)))
        else:
            made[sweep] = _categories(results, sweep)
    counted: list[str] = [name for name in _COUNTED if name in made]
    if counted:
        made["aborts"] = _aborts(results, counted[:2])
    if model.costs(results):
        made["prediction"] = _prediction(results)
    return made


def _under(results: Results, sweep: str) -> str:
    rounds = max(row["round"] for row in results.rows if row["sweep"] == sweep)
    row = next(row for row in results.rows if row["sweep"] == sweep)
    varied = {name for settings in SWEEPS[sweep].varied.values() for name in settings}
    parts = [
        text for names, text in _fixed(row) if len(SWEEPS[sweep].varied) == 1 or not names & varied
    ]
    rest = ", ".join(parts)
    return f"median of {rounds} round{'' if rounds == 1 else 's'}, band: all rounds; {rest}"


def _fixed(row: dict[str, Any]) -> list[tuple[set[str], str]]:
    """What the points of a sweep have in common; with the parameters that would change it."""
    threads = f"{row['threads']} thread{'' if row['threads'] == 1 else 's'}"
    return [
        ({"joints"}, f"{row['joints']:,} frames"),
        ({"threads"}, threads),
        ({"read-length", "tree"}, f"{row['read_length']} edges read"),
        ({"write-length"}, f"{row['write_length']} written"),
    ]


def _lines(results: Results, sweep: str, panels: Sequence[parts.Panel]) -> Figure:
    what = SWEEPS[sweep]
    figure, all_axes = parts.frame(len(panels), what.title, _under(results, sweep))
    for axes, panel in zip(all_axes, panels, strict=True):
        style.label(axes, what.axis, panel.label)
        _line_panel(axes, results, sweep, panel)
    return figure


def _line_panel(axes: Axes, results: Results, sweep: str, panel: parts.Panel) -> None:
    labels = results.labels(sweep)
    values = sorted(float(label) for label in labels)
    names = {float(label): label for label in labels}
    ends = []
    if SWEEPS[sweep].log:
        axes.set_xscale("log")
    for engine in results.engines(sweep):
        points = [(x, results.get(sweep, names[x], engine, panel.column)) for x in values]
        known = [(x, spread) for x, spread in points if spread is not None]
        known = [(x, spread) for x, spread in known if spread.median > 0 or not panel.log]
        if known:
            parts.line(axes, engine, known, panel)
            ends.append((engine, known[-1][0], known[-1][1].median * panel.scale))
    if not ends:
        parts.nothing(axes)
        return
    parts.name_values(axes, values)
    parts.scale(axes, log=panel.log)
    parts.direct_labels(axes, ends)


def _latency(results: Results) -> Figure:
    title = "Latency of one reader beside one writer, both without pause"
    figure, all_axes = parts.frame(2, title, _under(results, "latency"))
    (label,) = results.labels("latency")
    for axes, lane, what in zip(
        all_axes, ("reads", "writes"), ("lookup", "atomic write"), strict=True
    ):
        ends = []
        for engine in results.engines("latency"):
            found = [
                (i, results.get("latency", label, engine, f"{lane}_{share}_ns"))
                for i, (share, _) in enumerate(SHARES)
            ]
            known = [(float(i), spread) for i, spread in found if spread and spread.median > 0]
            if known:
                parts.line(axes, engine, known, parts.Panel("", "", 1e-3))
                ends.append((engine, known[-1][0], known[-1][1].median * 1e-3))
        axes.set_xticks(range(len(SHARES)), [name for _, name in SHARES])
        style.label(axes, "share of the operations that took no longer", f"{what} [us]")
        if ends:
            parts.scale(axes, log=True)
            parts.direct_labels(axes, ends)
        else:
            parts.nothing(axes)
    return figure


def _one_value(results: Results, sweep: str) -> Figure:
    """One row per engine: dots with their numbers, all rounds as a stroke."""
    panels = _PANELS[sweep]
    figure, all_axes = parts.frame(
        len(panels), SWEEPS[sweep].title, _under(results, sweep), narrow=True
    )
    (label,) = results.labels(sweep)
    engines = results.engines(sweep)
    for axes, panel in zip(all_axes, panels, strict=True):
        known = [
            (row, engine, spread)
            for row, engine in enumerate(engines)
            for spread in [results.get(sweep, label, engine, panel.column)]
            if spread is not None and (spread.median > 0 or not panel.log)
        ]
        for row, engine, spread in known:
            _dot(axes, row, engine, spread, panel.scale)
        # The names once, at the left of all panels.
        names = engines if axes is all_axes[0] else [""] * len(engines)
        axes.set_yticks(range(len(engines)), names)
        axes.set_ylim(len(engines) - 0.4, -0.6)
        axes.tick_params(axis="y", labelcolor=style.INK, length=0)
        style.label(axes, panel.label, "")
        if panel.log and known:
            _decades(axes, known, panel.scale)
        elif known:
            axes.set_xlim(0, 105)
    _make_room(figure, all_axes)
    return figure


def _dot(axes: Axes, row: int, engine: str, spread: Spread, scale: float) -> None:
    colour = parts.COLOURS[engine]
    ends = [spread.low * scale, spread.high * scale]
    axes.plot(ends, [row, row], color=colour, linewidth=1.6, alpha=0.35)
    axes.plot(
        [spread.median * scale], [row], color=colour, marker=parts.MARKERS[engine], markersize=6
    )
    axes.annotate(
        parts.short(spread.median * scale),
        (1.02, row),
        xycoords=("axes fraction", "data"),
        fontsize=parts.TEXT_SIZE,
        color=colour,
        va="center",
    )


def _decades(axes: Axes, known: list[tuple[int, str, Spread]], scale: float) -> None:
    low = min(max(spread.low, 1e-3 * spread.median) for _, _, spread in known) * scale
    high = max(spread.high for _, _, spread in known) * scale
    axes.set_xscale("log")
    axes.set_xlim(10 ** math.floor(math.log10(low)), 10 ** math.ceil(math.log10(high * 1.01)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: parts.short(x)))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _make_room(figure: Figure, all_axes: list[Axes]) -> None:
    """Move axes to the right: engines' names stand at their left."""
    for axes in all_axes:
        box = axes.get_position()
        shift = 0.4 / figure.get_figwidth()
        axes.set_position((box.x0 + shift, box.y0, box.width - shift, box.height))


def _categories(results: Results, sweep: str) -> Figure:
    """Values without an order: dots side by side in each."""
    what = SWEEPS[sweep]
    figure, all_axes = parts.frame(2, what.title, _under(results, sweep), legend=True)
    labels = results.labels(sweep)
    engines = results.engines(sweep)
    for axes, panel in zip(all_axes, (_READS, _WRITES), strict=True):
        for i, engine in enumerate(engines):
            offset = 0.72 * ((i + 0.5) / len(engines) - 0.5)
            for at, label in enumerate(labels):
                spread = results.get(sweep, label, engine, panel.column)
                if spread is None or spread.median <= 0:
                    continue
                x = at + offset
                colour = parts.COLOURS[engine]
                axes.plot([x, x], [spread.low, spread.high], color=colour, alpha=0.35)
                axes.plot(
                    [x], [spread.median], color=colour, marker=parts.MARKERS[engine], markersize=5
                )
        axes.set_xticks(range(len(labels)), [label.replace(", ", ",\n") for label in labels])
        axes.set_xlim(-0.5, len(labels) - 0.5)
        axes.grid(visible=False, axis="x")
        style.label(axes, "" if sweep == "direction" else what.axis, panel.label)
        parts.scale(axes, log=True)
    parts.legend(figure, engines)
    return figure


def _aborts(results: Results, sweeps: list[str]) -> Figure:
    title = "Attempts that came to nothing, per operation"
    under = "retries of the engine, lapped lookups and lost transactions"
    figure, all_axes = parts.frame(len(sweeps), title, under)
    for axes, sweep in zip(all_axes, sweeps, strict=True):
        style.label(axes, SWEEPS[sweep].axis, "aborts per operation")
        ends = _abort_lines(axes, results, sweep)
        axes.set_yscale("symlog", linthresh=1e-6, linscale=0.3)
        axes.set_ylim(-2e-7, max(axes.get_ylim()[1] * 1.5, 1e-5))
        axes.yaxis.set_major_locator(FixedLocator([0.0, *(10.0**k for k in range(-6, 3))]))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: "0" if y == 0 else f"{y:g}"))
        if ends:
            parts.direct_labels(axes, ends)
    return figure


def _abort_lines(axes: Axes, results: Results, sweep: str) -> list[tuple[str, float, float]]:
    names = {float(label): label for label in results.labels(sweep)}
    ends = []
    if SWEEPS[sweep].log:
        axes.set_xscale("log")
    for engine in results.engines(sweep):
        if engine == TF2:  # it counts nothing, and has nothing to abort
            continue
        points = [
            (x, results.median(sweep, names[x], engine, "aborts_per_operation"))
            for x in sorted(names)
        ]
        known = [(x, y) for x, y in points if y is not None]
        axes.plot(
            [x for x, _ in known],
            [y for _, y in known],
            color=parts.COLOURS[engine],
            marker=parts.MARKERS[engine],
            markersize=4,
            linewidth=2.2 if engine == "snapshot" else 1.2,
        )
        if known:
            ends.append((engine, *known[-1]))
    parts.name_values(axes, sorted(names))
    return ends


def _prediction(results: Results) -> Figure:
    """Lines of the model, and the measured points that it was fitted to."""
    title = "A prediction, not a measurement: what a core for each thread would bring"
    under = "fitted to the marked points of one and two threads, see measure/tfdb_measure/model.py"
    figure, (reading, half) = parts.frame(2, title, under)
    even = [threads for threads in model.THREADS if threads % 2 == 0]
    ends: dict[str, list[tuple[str, float, float]]] = {"reading": [], "half": []}
    for found in model.costs(results):
        look: dict[str, Any] = {
            "color": parts.COLOURS[found.engine],
            "linestyle": "--" if found.engine == TF2 else "-",
        }
        all_read = [found.reads(threads) for threads in model.THREADS]
        reading.plot(model.THREADS, all_read, linewidth=1.2, **look)
        reading.plot([1, 2], all_read[:2], linestyle="", marker="o", color=look["color"])
        ends["reading"].append((found.engine, float(model.THREADS[-1]), all_read[-1]))
        mixed = [pair[0] for threads in even for pair in [found.half_and_half(threads)] if pair]
        if mixed:
            half.plot(even, mixed, linewidth=1.2, **look)
            half.plot([2], mixed[:1], linestyle="", marker="o", color=look["color"])
            ends["half"].append((found.engine, float(even[-1]), mixed[-1]))
    style.label(reading, "threads, each with a core; all read", "lookups per second")
    style.label(half, "threads, each with a core; half of them write", "lookups per second")
    for axes, name in ((reading, "reading"), (half, "half")):
        axes.xaxis.set_major_locator(FixedLocator([1, 2, 4, 8, 12, 16]))
        if ends[name]:
            parts.scale(axes, log=True)
            parts.direct_labels(axes, ends[name])
        else:
            parts.nothing(axes)
    return figure

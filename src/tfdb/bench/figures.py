"""The pictures of a report: one for each sweep, one colour for each engine in all of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from matplotlib.lines import Line2D
from matplotlib.ticker import (
    FixedLocator,
    FuncFormatter,
    LogLocator,
    NullFormatter,
    NullLocator,
)

from ..plot import style
from .points import ENGINES, SWEEPS, TF2

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .results import Results, Spread

COLOURS = dict(
    zip(
        ENGINES,
        (
            "#1f6fb2",  # snapshot
            "#6b7780",  # giant
            "#c79a1b",  # fine
            "#2c8c4b",  # 2pl-no-wait
            "#8b5fbf",  # 2pl-wait-die
            "#cf3d2e",  # 2pl-wound-wait
            "#e0812f",  # silo
            "#111111",  # tf2
        ),
        strict=True,
    )
)
MARKERS = dict(zip(ENGINES, "osD^v<>X", strict=True))

_PANEL_INCHES = 4.1
_LABEL_INCHES = 1.4
_HEAD_INCHES = 0.86
_PLOT_INCHES = 2.75
_FOOT_INCHES = 0.55
_LEFT_INCHES = 0.72
_LABEL_GAP = 0.058  # of the axes' height
SHARES = (
    ("p50", "median"),
    ("p90", "90 %"),
    ("p99", "99 %"),
    ("p999", "99.9 %"),
    ("max", "longest"),
)


@dataclass(frozen=True)
class Panel:
    """One pair of axes: which column, in which unit."""

    column: str
    label: str
    scale: float = 1.0  # what the column is multiplied with
    log: bool = True


_READS = Panel("reads_per_s", "lookups per second")
_WRITES = Panel("writes_per_s", "writes per second")
_ABORTS = Panel("aborts_per_operation", "aborts per operation")
_PANELS: dict[str, tuple[Panel, ...]] = {
    "readers": (_READS, Panel("reads_p99_ns", "lookup, 99th percentile [us]", 1e-3)),
    "writers": (_WRITES, Panel("writes_p99_ns", "write, 99th percentile [us]", 1e-3)),
    "read-ratio": (Panel("operations_per_s", "operations per second"), _ABORTS),
    "read-length": (_READS, Panel("reads_edges_per_s", "edges looked up per second")),
    "write-length": (_WRITES, Panel("writes_edges_per_s", "edges written per second")),
    "age": (
        Panel("age_p50_ns", "age of the oldest sample used, median [ms]", 1e-6),
        Panel("age_p99_ns", "the same, 99th percentile [ms]", 1e-6),
    ),
    "cars": (
        Panel("reads_p999_ns", "lookup, 99.9th percentile [us]", 1e-3),
        Panel("writes_p999_ns", "write, 99.9th percentile [us]", 1e-3),
        Panel("reads_deadlines_met", "lookups within 8.3 ms [%]", 100.0, log=False),
    ),
    "starvation": (
        _READS,
        Panel("reads_max_ns", "longest lookup [ms]", 1e-6),
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
    return made


def _frame(panels: int, title: str, under: str) -> tuple[Figure, list[Axes]]:
    width = _LEFT_INCHES + panels * (_PANEL_INCHES + _LABEL_INCHES)
    height = _HEAD_INCHES + _PLOT_INCHES + _FOOT_INCHES
    figure = style.new_figure(width, height)
    style.title(figure, title, under, x=0.15 / width)
    axes = []
    for i in range(panels):
        left = _LEFT_INCHES + i * (_PANEL_INCHES + _LABEL_INCHES)
        box = (
            left / width,
            _FOOT_INCHES / height,
            (_PANEL_INCHES - 0.35) / width,
            _PLOT_INCHES / height,
        )
        made = figure.add_axes(box)
        style.tidy(made)
        axes.append(made)
    return figure, axes


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


def _lines(results: Results, sweep: str, panels: Sequence[Panel]) -> Figure:
    what = SWEEPS[sweep]
    figure, all_axes = _frame(len(panels), what.title, _under(results, sweep))
    for axes, panel in zip(all_axes, panels, strict=True):
        style.label(axes, what.axis, panel.label)
        _line_panel(axes, results, sweep, panel)
    return figure


def _line_panel(axes: Axes, results: Results, sweep: str, panel: Panel) -> None:
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
            _line(axes, engine, known, panel)
            ends.append((engine, known[-1][0], known[-1][1].median * panel.scale))
    if not ends:
        _nothing(axes)
        return
    axes.xaxis.set_major_locator(FixedLocator(values))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: short(x)))
    _scale(axes, log=panel.log)
    _direct_labels(axes, ends)


def _line(axes: Axes, engine: str, known: list[tuple[float, Spread]], panel: Panel) -> None:
    x = [at for at, _ in known]
    scale = panel.scale
    floor = 1e-12 if panel.log else 0.0
    axes.fill_between(
        x,
        [max(spread.low * scale, floor) for _, spread in known],
        [max(spread.high * scale, floor) for _, spread in known],
        color=COLOURS[engine],
        alpha=0.10,
        linewidth=0,
    )
    axes.plot(
        x,
        [spread.median * scale for _, spread in known],
        color=COLOURS[engine],
        marker=MARKERS[engine],
        markersize=4.5 if engine in ("snapshot", TF2) else 3.5,
        linewidth=2.2 if engine in ("snapshot", TF2) else 1.2,
        linestyle="--" if engine == TF2 else "-",
        zorder=4 if engine == "snapshot" else 3,
    )


def _scale(axes: Axes, *, log: bool) -> None:
    if log:
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        if high / low < 20:  # a decade at the least, so that a tick is labelled
            middle = math.sqrt(low * high)
            axes.set_ylim(min(low, middle / 4), max(high, middle * 4))
        few = high / low < 300
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if few else (1.0,)))
        axes.yaxis.set_minor_formatter(NullFormatter())
    else:
        axes.set_ylim(bottom=0)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: short(y)))


def short(value: float) -> str:
    """Write a number for an axis: 1.5k, 2M, 0.1."""
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= size * 0.9999:
            return f"{value / size:.3g}{letter}"
    return f"{value:.3g}"


def _direct_labels(axes: Axes, ends: list[tuple[str, float, float]]) -> None:
    """Name each line where it ends; names that would meet are pushed apart."""
    to_axes = axes.transData + axes.transAxes.inverted()
    placed = sorted(
        (float(to_axes.transform((x, y))[1]), float(to_axes.transform((x, y))[0]), engine)
        for engine, x, y in ends
    )
    heights = spread_out([height for height, _, _ in placed], _LABEL_GAP)
    for (height, x, engine), label in zip(placed, heights, strict=True):
        axes.plot(
            [x, 1.035],
            [height, label],
            transform=axes.transAxes,
            color=COLOURS[engine],
            linewidth=0.6,
            alpha=0.7,
            clip_on=False,
        )
        axes.text(
            1.045,
            label,
            engine,
            transform=axes.transAxes,
            color=COLOURS[engine],
            fontsize=style.SMALL_SIZE,
            fontweight="bold" if engine in ("snapshot", TF2) else "normal",
            va="center",
        )


def spread_out(heights: Sequence[float], gap: float) -> list[float]:
    """Move sorted heights as little as keeps them `gap` apart, within 0 and 1 where they fit."""
    count = len(heights)
    placed = list(heights)
    for i in range(1, count):
        placed[i] = max(placed[i], placed[i - 1] + gap)
    over = max(0.0, placed[-1] - 1.0) if placed else 0.0
    for i in reversed(range(count)):
        ceiling = 1.0 if i == count - 1 else placed[i + 1] - gap
        placed[i] = min(placed[i], ceiling) if over else placed[i]
    return placed


def _legend(figure: Figure, engines: Sequence[str]) -> None:
    figure.legend(
        handles=[
            Line2D(
                [],
                [],
                color=COLOURS[engine],
                marker=MARKERS[engine],
                linewidth=0,
                markersize=5,
                label=engine,
            )
            for engine in engines
        ],
        loc="upper right",
        bbox_to_anchor=(0.995, 1 - 0.12 / figure.get_figheight()),
        ncols=4,
        fontsize=style.SMALL_SIZE,
        frameon=False,
        labelcolor=style.INK,
        columnspacing=1.0,
        handletextpad=0.2,
    )


def _latency(results: Results) -> Figure:
    title = "Latency of one reader beside one writer, both without pause"
    figure, all_axes = _frame(2, title, _under(results, "latency"))
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
                _line(axes, engine, known, Panel("", "", 1e-3))
                ends.append((engine, known[-1][0], known[-1][1].median * 1e-3))
        axes.set_xticks(range(len(SHARES)), [name for _, name in SHARES])
        style.label(axes, "share of the operations that took no longer", f"{what} [us]")
        if ends:
            _scale(axes, log=True)
            _direct_labels(axes, ends)
        else:
            _nothing(axes)
    return figure


def _one_value(results: Results, sweep: str) -> Figure:
    """One row per engine: dots with their numbers, all rounds as a stroke."""
    panels = _PANELS[sweep]
    figure, all_axes = _frame(len(panels), SWEEPS[sweep].title, _under(results, sweep))
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
        axes.set_yticks(range(len(engines)), engines)
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
    colour = COLOURS[engine]
    ends = [spread.low * scale, spread.high * scale]
    axes.plot(ends, [row, row], color=colour, linewidth=1.6, alpha=0.35)
    axes.plot([spread.median * scale], [row], color=colour, marker=MARKERS[engine], markersize=6)
    axes.annotate(
        short(spread.median * scale),
        (1.02, row),
        xycoords=("axes fraction", "data"),
        fontsize=style.SMALL_SIZE,
        color=colour,
        va="center",
    )


def _decades(axes: Axes, known: list[tuple[int, str, Spread]], scale: float) -> None:
    low = min(max(spread.low, 1e-3 * spread.median) for _, _, spread in known) * scale
    high = max(spread.high for _, _, spread in known) * scale
    axes.set_xscale("log")
    axes.set_xlim(10 ** math.floor(math.log10(low)), 10 ** math.ceil(math.log10(high * 1.01)))
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: short(x)))
    axes.xaxis.set_minor_formatter(NullFormatter())


def _make_room(figure: Figure, all_axes: list[Axes]) -> None:
    """Move axes to the right: engines' names stand at their left."""
    for axes in all_axes:
        box = axes.get_position()
        shift = 0.32 / figure.get_figwidth()
        axes.set_position((box.x0 + shift, box.y0, box.width - shift, box.height))


def _categories(results: Results, sweep: str) -> Figure:
    """Values without an order: dots side by side in each."""
    what = SWEEPS[sweep]
    figure, all_axes = _frame(2, what.title, _under(results, sweep))
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
                colour = COLOURS[engine]
                axes.plot([x, x], [spread.low, spread.high], color=colour, alpha=0.35)
                axes.plot([x], [spread.median], color=colour, marker=MARKERS[engine], markersize=5)
        axes.set_xticks(range(len(labels)), [label.replace(", ", ",\n") for label in labels])
        axes.set_xlim(-0.5, len(labels) - 0.5)
        axes.grid(visible=False, axis="x")
        style.label(axes, "" if sweep == "direction" else what.axis, panel.label)
        _scale(axes, log=True)
    _legend(figure, engines)
    return figure


def _aborts(results: Results, sweeps: list[str]) -> Figure:
    title = "Attempts that came to nothing, per operation"
    under = (
        "retries of the engine, lapped lookups, lost transactions; lines at the foot: none at all"
    )
    figure, all_axes = _frame(len(sweeps), title, under)
    for axes, sweep in zip(all_axes, sweeps, strict=True):
        style.label(axes, SWEEPS[sweep].axis, "aborts per operation")
        ends = _abort_lines(axes, results, sweep)
        axes.set_yscale("symlog", linthresh=1e-6, linscale=0.3)
        axes.set_ylim(-2e-7, max(axes.get_ylim()[1] * 1.5, 1e-5))
        axes.yaxis.set_major_locator(FixedLocator([0.0, *(10.0**k for k in range(-6, 3))]))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_formatter(FuncFormatter(lambda y, _: "0" if y == 0 else f"{y:g}"))
        if ends:
            _direct_labels(axes, ends)
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
            color=COLOURS[engine],
            marker=MARKERS[engine],
            markersize=4,
            linewidth=2.2 if engine == "snapshot" else 1.2,
        )
        if known:
            ends.append((engine, *known[-1]))
    axes.xaxis.set_major_locator(FixedLocator(sorted(names)))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda x, _: short(x)))
    return ends


def _nothing(axes: Axes) -> None:
    axes.text(0.5, 0.5, "nothing to show", transform=axes.transAxes, color=style.MUTED, ha="center")

"""``tfdb bench``: the paper's evaluation on this machine."""

from __future__ import annotations

import importlib.util
import math
import shlex
import sys
import time
import warnings
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.progress import MofNCompleteColumn, TimeRemainingColumn

import tfdb
from tfdb.cli import common, layout, output

from . import machine, points, programs, report, session
from .results import Results, number

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from .session import Plan, Turn


class _Real(click.FloatRange):
    """Finite numbers: click's range lets NaN through."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> float:
        number = float(super().convert(value, param, ctx))
        if not math.isfinite(number):
            self.fail(f"{value} is not a finite number", param, ctx)
        return number


_NUMBER = _Real(min=0)
_QUICK = {"seconds": 0.2, "rounds": 1}


def _parameter(*names: str, **settings: Any) -> Callable[[Any], Any]:
    """Make an option of the driver's; without a value the driver's own default holds."""
    return click.option(*names, default=None, **settings)


_MANY = click.IntRange(1, points.MOST_JOINTS)
_DRIVER_OPTIONS = (
    _parameter(
        "--threads",
        type=click.IntRange(1, points.MOST_THREADS),
        help="Number of threads.  [default: 2]",
    ),
    _parameter(
        "--joints",
        type=click.IntRange(2, points.MOST_JOINTS),
        help="Number of moving frames.  [default: 1000]",
    ),
    _parameter(
        "--read-ratio",
        type=_Real(0, 1),
        help="Share of readers, 0 to 1.  [default: 0.5]",
    ),
    _parameter(
        "--share",
        type=click.Choice(["threads", "operations"]),
        help="Apply --read-ratio to threads or to operations.  [default: threads]",
    ),
    _parameter("--read-length", type=_MANY, help="Number of edges in a lookup.  [default: 16]"),
    _parameter("--write-length", type=_MANY, help="Number of edges in a write.  [default: 16]"),
    _parameter(
        "--frequency",
        type=_NUMBER,
        help="Operations per second and thread; 0: no pause.  [default: 0]",
    ),
    _parameter(
        "--read-frequency",
        type=_NUMBER,
        help="Reads per second and thread.  [default: --frequency]",
    ),
    _parameter(
        "--write-frequency",
        type=_NUMBER,
        help="Writes per second and thread.  [default: --frequency]",
    ),
    _parameter(
        "--iterations",
        type=click.IntRange(0, 10**9),
        help="Operations per thread, instead of --seconds.",
    ),
    _parameter(
        "--skew",
        type=_Real(0, 5),
        help="Theta of the Zipf distribution of frames; 0: uniform.  [default: 0]",
    ),
    _parameter(
        "--tree",
        type=click.Choice(["chain", "star", "humanoid", "random"]),
        help="Shape of the frame tree.  [default: chain]",
    ),
    _parameter(
        "--time",
        type=click.Choice(["latest", "common"]),
        help="Read each edge's newest sample, or interpolate at the latest common time.  "
        "[default: latest]",
    ),
    _parameter(
        "--reads",
        type=click.Choice(["lookup", "transaction"]),
        help="Read by a lookup or in a transaction.  [default: lookup]",
    ),
    _parameter(
        "--writes",
        type=click.Choice(["batch", "single", "modify"]),
        help="Write a batch atomically, one edge at a time, or in a transaction that reads the "
        "edges first.  [default: batch]",
    ),
    _parameter(
        "--direction",
        type=click.Choice(["opposite", "same"]),
        help="Order of the edges of a batch relative to a lookup.  [default: opposite]",
    ),
    _parameter(
        "--lookup-from",
        type=click.Choice(["high", "low"]),
        help="End of the chain that is the source of a lookup.  [default: high]",
    ),
    _parameter(
        "--deadline-ms",
        type=_NUMBER,
        help="Deadline of an operation under --frequency.  [default: one period]",
    ),
    _parameter(
        "--history",
        type=_NUMBER,
        help="Seconds of history that a store keeps; 0: chosen.  [default: 0]",
    ),
    _parameter(
        "--warmup", type=_NUMBER, help="Seconds of warm-up before each run.  [default: 0.1]"
    ),
    _parameter(
        "--seed", type=click.IntRange(min=0), help="Seed of all random choices.  [default: 1]"
    ),
    click.option(
        "--no-batch", is_flag=True, help="Write one edge at a time, like --writes single."
    ),
    click.option("--no-pin", is_flag=True, help="Do not pin threads to cores."),
)


def _driver_options(command: Any) -> Any:
    for option in reversed(_DRIVER_OPTIONS):
        command = option(command)
    return command


@click.command("bench", short_help="Benchmark the engines and tf2 as in 'Transactional TF'.")
@click.option(
    "--engines",
    default="all",
    metavar="LIST",
    show_default=True,
    help=f"Comma-separated engines: {', '.join(points.ENGINES)}; or all.",
)
@click.option(
    "--sweep",
    "sweeps",
    default="all",
    metavar="LIST",
    show_default=True,
    help=f"Comma-separated sweeps: {', '.join(points.SWEEPS)}; or all.",
)
@click.option(
    "--rounds", type=click.IntRange(1, 1000), help="Rounds of each point.  [default: 3, --quick: 1]"
)
@click.option(
    "--seconds",
    type=_Real(0.001, 3600),
    help="Seconds of one run.  [default: 1, --quick: 0.2]",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("bench-report"),
    show_default=True,
    help="Folder for results.csv, report.html and the pictures.",
)
@click.option("--quick", is_flag=True, help="Measure fewer values, in short runs and one round.")
@click.option("--csv-only", is_flag=True, help="Write results.csv alone; matplotlib is not needed.")
@_driver_options
@common.json_option
def command(
    *,
    engines: str,
    sweeps: str,
    rounds: int | None,
    seconds: float | None,
    out: Path,
    quick: bool,
    csv_only: bool,
    as_json: bool,
    **parameters: Any,
) -> None:
    """Benchmark engines and tf2 as in 'Transactional TF': CSV files and a report.

    Example: tfdb bench --quick

    'Transactional TF' is the paper of Ogiwara et al., IEICE Trans. E106-D(12), 2023. The engines
    run in turn in each round. Each figure is the median of its rounds. Ctrl-C ends the run and
    reports the finished points.

    \b
    tfdb bench --quick
    tfdb bench --sweep threads,skew --engines snapshot,silo,tf2 --rounds 5
    tfdb bench --sweep readers --read-length 100 --out long-paths
    """  # noqa: D301, click wants the character
    base = _base(parameters, seconds or (_QUICK["seconds"] if quick else 1.0))
    plan = session.plan(
        points.choose_engines(engines),
        points.choose_sweeps(sweeps),
        base,
        rounds=rounds or (int(_QUICK["rounds"]) if quick else 3),
        quick=quick,
    )
    plan.check()
    if not csv_only and importlib.util.find_spec("matplotlib") is None:
        message = "the report needs matplotlib: pip install 'tfdb[plot]', or give --csv-only"
        raise MatplotlibMissing(message, value="matplotlib")
    out.mkdir(parents=True, exist_ok=True)
    results = Results(out / "results.csv")
    head = _head(plan)
    busy = machine.busy()
    started = time.monotonic()
    stopped = False
    try:
        with _progress(plan) as update:
            plan.run(results, update)
    except KeyboardInterrupt:
        stopped = True
    head["measured"] = f"{len(results.rows)} of {plan.count()} runs"
    head["took"] = f"{time.monotonic() - started:.0f} s" + (", stopped early" if stopped else "")
    doubts = [text for text in (busy, _single(results)) if text]
    for text in doubts:
        warnings.warn(text, tfdb.TfdbWarning, stacklevel=1)
    page = None
    if results.rows and not csv_only:
        from . import figures  # noqa: PLC0415, needs matplotlib

        page = report.write(out, results, head, figures.draw(results), plan.failures, doubts)
    _say(results, plan, out, page, doubts, as_json=as_json)
    if stopped:
        raise KeyboardInterrupt
    if plan.failures:
        count = len(plan.failures)
        message = f"{count} of {plan.count()} runs failed, the first: {plan.failures[0]}"
        raise programs.DriverFailed(message, value=count, reason=plan.failures[0])


class MatplotlibMissing(tfdb.TfdbError):
    """The pictures of the report need matplotlib. Fields: value."""


def _base(parameters: dict[str, Any], seconds: float) -> dict[str, points.Value]:
    base: dict[str, points.Value] = {"seconds": seconds}
    for name, value in parameters.items():
        if value is not None and value is not False:
            base[name.replace("_", "-")] = value
    return base


def _head(plan: Plan) -> dict[str, str]:
    return {
        "machine": machine.machine(),
        "versions": machine.versions(tf2=points.TF2 in plan.engines),
        "date": time.strftime("%Y-%m-%d %H:%M %Z"),
        "command": shlex.join(["tfdb", *sys.argv[1:]]),
        "rounds": f"{plan.rounds}, engines in turns; {plan.base['seconds']} s each",
    }


def _single(results: Results) -> str | None:
    """Say which points have no spread."""
    count = results.single_rounds()
    if not count:
        return None
    points_ = "1 point has" if count == 1 else f"{count} points have"
    return f"{points_} one round only, so the scatter of its figures is unknown: give --rounds 3"


@contextmanager
def _progress(plan: Plan) -> Iterator[Callable[[int, Turn], None] | None]:
    """Show a bar on stderr with what is being measured; nothing where that is no terminal."""
    with common.bar_on_stderr(lambda: (MofNCompleteColumn(), TimeRemainingColumn())) as bar:
        if bar is None:
            yield None
            return
        task = bar.add_task("measuring", total=plan.count())
        yield lambda done, turn: bar.update(
            task,
            completed=done,
            description=f"{turn.sweep} {turn.label}, round {turn.round}: {turn.point.engine}",
        )


def _say(
    results: Results,
    plan: Plan,
    out: Path,
    page: Path | None,
    doubts: list[str],
    *,
    as_json: bool,
) -> None:
    files = {"csv": str(out / "results.csv"), "report": None if page is None else str(page)}
    if as_json:
        body = {
            "runs": len(results.rows),
            "planned": plan.count(),
            "failures": plan.failures,
            "warnings": doubts,
            **files,
            "points": [
                {
                    "sweep": sweep,
                    "label": label,
                    "engine": engine,
                    **{
                        column: None if spread is None else spread.median
                        for (_, column, _), (spread, _) in zip(
                            report.COLUMNS.get(sweep, report.USUAL), cells, strict=True
                        )
                    },
                }
                for sweep in results.sweeps()
                for label, engine, cells in report.rows(results, sweep)
            ],
        }
        output.emit_json("bench", body)
        return
    console = layout.console()
    for sweep in results.sweeps():
        columns = [title for title, _, _ in report.COLUMNS.get(sweep, report.USUAL)]
        console.print(points.SWEEPS[sweep].title, style="bold")
        lines = [
            [
                label,
                engine,
                *("" if s is None else number(s.median * factor) for s, factor in cells),
            ]
            for label, engine, cells in report.rows(results, sweep)
        ]
        shown = [layout.Column("sweep"), layout.Column("engine")]
        shown += [layout.Column(title, rank, right=True) for rank, title in enumerate(columns, 1)]
        console.print(layout.table(shown, lines))
        console.print()
    for name, path in files.items():
        if path is not None and results.rows:
            console.print(f"{name}: {path}")

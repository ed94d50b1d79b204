"""Measure everything, and remake docs/benchmarks.md, docs/evaluation.md and docs/sweeps.md from it.

    measure/contenders/install              # once: tf2 by apt, the rest into an environment
    make measure                            # everything, about an hour on a quiet machine
    make measure MEASURE="--only engines"   # a part; the others' rows stay those of the last run
    make measure MEASURE="--only pages"     # nothing new: the pages again
    make measure MEASURE="--quick"          # all parts in minutes, pages in out/measure alone

Figures are in out/measure/: rows.csv, engines.csv, sweeps.csv; all of one commit on one machine. A
part that is measured at another commit, or on another machine, throws the older ones away.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from . import figures, goals, machine, pages, points, programs, report, rivals, session
from .results import Results

if TYPE_CHECKING:
    from collections.abc import Collection

ROOT = Path(__file__).resolve().parents[2]
PAGES = (pages.BENCHMARKS, pages.EVALUATION, pages.SWEPT)

# Values of each sweep that two cores can tell apart, or that the paper is about.
KEPT = {
    "threads": ("1", "2", "4", "8"),
    "readers": ("1", "2", "4", "8"),
    "writers": ("1", "2", "8"),
    "joints": ("20", "100", "1000", "10000", "100000"),
    "iterations": ("1000", "10000", "100000"),
    "read-ratio": ("0", "0.1", "0.5", "0.9", "0.99", "1"),
    "read-length": ("1", "4", "16", "64", "256"),
    "write-length": ("1", "4", "16", "64", "256"),
    "skew": ("0", "0.5", "0.8", "0.99", "1.2"),
    "tree": ("chain", "star", "humanoid", "random"),
    "direction": tuple(points.SWEEPS["direction"].varied),
    "age": ("100", "1000", "10000"),
    "latency": ("1 + 1",),
    "cars": ("200 cars",),
    "starvation": ("1 + 4",),
}
SETS = {
    "rows": tuple(rivals.GROUPS),
    "engines": ("goals",),
    "sweeps": tuple(KEPT),
}
"""The files of figures, and what is measured into each."""

QUICK = rivals.Effort(rounds=2, messages=500, samples=50_000, chains=(1, 4), seconds=0.3)


def parse(words: list[str] | None = None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(
        prog="make measure", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument(
        "--only",
        action="append",
        choices=[*rivals.GROUPS, "rows", "engines", "sweeps", "pages"],
        help="a part; may be repeated",
    )
    parser.add_argument("--quick", action="store_true", help="small sizes, and no page in docs")
    parser.add_argument("--rounds", type=int, help="of the rows and the engines' goals")
    parser.add_argument("--env", type=Path, default=rivals.Effort.env, help="the rivals'")
    parser.add_argument("--no-install", action="store_true", help="the tfdb of --env is up to date")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "measure")
    parser.add_argument("--docs", type=Path, help="folder of the pages  [docs, --quick: --out]")
    return parser.parse_args(words)


def say(text: str) -> None:
    """Print with the time of day."""
    print(f"{time.strftime('%H:%M:%S')} {text}", flush=True)


def about() -> dict[str, str]:
    """Say where and of what the figures are."""
    return {
        "text": f"Machine: {machine.machine()}; {machine.versions(tf2=True)}.",
        "commit": machine.commit(ROOT),
    }


def kept(folder: Path, now: dict[str, str]) -> None:
    """Throw away earlier figures unless they are of this commit and this machine."""
    noted = folder / "about.json"
    if noted.exists() and json.loads(noted.read_text(encoding="utf-8")) != now:
        say("the figures in the folder are of another commit or machine: they are thrown away")
        for name in SETS:
            (folder / f"{name}.csv").unlink(missing_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    noted.write_text(json.dumps(now, indent=1), encoding="utf-8")


def measure_rows(results: Results, options: argparse.Namespace, groups: Collection[str]) -> None:
    """Measure tfdb and its rivals, operation by operation."""
    effort = QUICK if options.quick else rivals.Effort()
    effort = replace(effort, env=options.env, rounds=options.rounds or effort.rounds)
    if set(groups) & set(rivals.NEED_PYTHON) and not options.no_install:
        say(f"installing this tfdb into {options.env}")
        rivals.install(options.env)
    for name in rivals.GROUPS:
        if name in groups:
            say(f"rows: {name}")
            rivals.GROUPS[name](results, effort)


def measure_engines(results: Results, options: argparse.Namespace) -> None:
    """Measure the points of the engines' goals, in turns."""
    rounds = options.rounds or (2 if options.quick else 7)
    seconds = 0.1 if options.quick else 0.6
    for turn in range(1, rounds + 1):
        say(f"engines: round {turn} of {rounds}")
        for label, point in goals.POINTS.items():
            parameters = {"seconds": seconds, **point.parameters}
            found = programs.run(replace(point, parameters=parameters), limit=120)
            results.add("goals", label, turn, point.engine, found)


def shortened(name: str) -> points.Sweep:
    """Return a sweep with the values that are kept."""
    sweep = points.SWEEPS[name]
    return replace(sweep, varied={label: sweep.varied[label] for label in KEPT[name]})


def measure_sweeps(results: Results, options: argparse.Namespace) -> list[str]:
    """Measure the paper's sweeps, shortened; return what failed."""
    base: dict[str, points.Value] = {"seconds": 0.2, "warmup": 0.05}
    sweeps, rounds = [shortened(name) for name in KEPT], 3
    if options.quick:
        sweeps, rounds = [sweep.quick() for sweep in points.SWEEPS.values()], 1
        base = {"seconds": 0.02, "warmup": 0.01}
    plan = session.Plan(points.ENGINES, sweeps, base, rounds)
    plan.check()
    at = ""

    def progress(done: int, turn: session.Turn) -> None:
        nonlocal at
        if turn.sweep != at:
            at = turn.sweep
            say(f"sweep {at}: run {done + 1} of {plan.count()}")

    plan.run(results, progress)
    return plan.failures


def write_pages(options: argparse.Namespace, results: Results, failures: list[str]) -> None:
    """Write the pages, and the report of the sweeps."""
    docs = options.docs or (options.out if options.quick else ROOT / "docs")
    if docs != ROOT / "docs":
        docs.mkdir(parents=True, exist_ok=True)
        for name in PAGES:
            shutil.copy(ROOT / "docs" / name, docs)
    head = {**about(), "date": measured_on(options.out)}
    swept = Results(rows=[row for row in results.rows if row["sweep"] in points.SWEEPS])
    drawn = figures.draw(swept) if swept.rows else {}
    if drawn:
        report.write(options.out, swept, {**head, "command": "make measure"}, drawn, failures)
    for page in pages.write(docs, pages.parts(results, head), drawn):
        say(f"written: {page}")


def measured_on(folder: Path) -> str:
    """Return the day of the newest figures."""
    times = [path.stat().st_mtime for path in folder.glob("*.csv")]
    return time.strftime("%Y-%m-%d", time.localtime(max(times, default=None)))


def main() -> int:
    """Measure, judge, write."""
    options = parse()
    wanted = options.only or [*SETS]
    parts = {part for name in wanted for part in SETS.get(name, (name,))}
    try:
        for name in ("tfdb_against_tf2", "tfdb_costs", "tfdb_driver", "tfdb_driver_tf2"):
            programs.find(name)
    except programs.DriverMissing as error:
        sys.exit(str(error))
    text = {name: (ROOT / "docs" / name).read_text(encoding="utf-8") for name in PAGES}
    for page, marker in markers():
        pages.between(text[page], marker, [])  # an hour later would be late to miss a marker
    busy = machine.busy()
    if busy:
        say(f"warning: {busy}")
    kept(options.out, about())
    started = time.monotonic()
    measured = {
        name: Results.read(options.out / f"{name}.csv", without=_sweeps_of(name, parts))
        for name in SETS
    }
    failures: list[str] = []
    if parts & set(rivals.GROUPS):
        measure_rows(measured["rows"], options, parts)
    if "goals" in parts:
        measure_engines(measured["engines"], options)
    if parts & set(KEPT):
        failures = measure_sweeps(measured["sweeps"], options)
    results = Results(rows=[row for each in measured.values() for row in each.rows])
    for line in goals.table(goals.judge([*goals.ROWS, *goals.ENGINES], results)):
        print(line)
    write_pages(options, results, failures)
    say(f"done in {time.monotonic() - started:.0f} s; {len(failures)} runs failed")
    for failure in failures:
        say(failure)
    return 1 if failures else 0


def markers() -> list[tuple[str, str]]:
    """Return what every page must have markers for."""
    return [
        *((page, "about") for page in PAGES),
        *((pages.BENCHMARKS, name) for name in ("felt", "goals", "rows")),
        *((pages.EVALUATION, name) for name in ("goals", "claims", "losses")),
        *((pages.SWEPT, name) for name in ("prediction", *(f"sweep {name}" for name in KEPT))),
    ]


def _sweeps_of(name: str, parts: Collection[str]) -> set[str]:
    """Return which sweeps of a file are measured again."""
    return set(SETS[name]) & set(parts)


if __name__ == "__main__":
    os.environ.setdefault("PYTHONHASHSEED", "0")
    sys.exit(main())

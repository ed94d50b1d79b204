#!/usr/bin/env python3
"""The goals and a shortened form of the paper's sweeps, for docs/evaluation.md.

    make evaluation                              # all of it, about ten minutes
    .venv/bin/python benchmarks/evaluation.py --only goals

Everything is measured by the drivers of `tfdb bench`, contenders in turns. What is written: the
parts of docs/evaluation.md between markers, its pictures in docs/evaluation/, and in
out/evaluation/ the rows (goals.csv, results.csv) and the whole report.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path.insert(0, str(HERE / "python"))

import evaluation_goals as goals  # noqa: E402 - the modules of this folder
import evaluation_page as page  # noqa: E402

from tfdb.bench import drivers, figures, machine, points, report, session  # noqa: E402
from tfdb.bench.results import Results  # noqa: E402

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


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--only", choices=["goals", "sweeps"])
    parser.add_argument("--goal-rounds", type=int, default=7)
    parser.add_argument("--goal-seconds", type=float, default=0.6)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=0.2)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "evaluation")
    parser.add_argument("--page", type=Path, default=ROOT / "docs" / "evaluation.md")
    return parser.parse_args()


def say(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", flush=True)


def measure_goals(options: argparse.Namespace) -> Results:
    """All points of the goals in turns."""
    results = Results(options.out / "goals.csv")
    for turn in range(1, options.goal_rounds + 1):
        say(f"goals, round {turn} of {options.goal_rounds}")
        for label, point in goals.POINTS.items():
            parameters = {"seconds": options.goal_seconds, **point.parameters}
            found = drivers.run(replace(point, parameters=parameters), limit=120)
            results.add("goals", label, turn, point.engine, found)
    return results


def measure_sweeps(options: argparse.Namespace) -> tuple[Results, session.Plan]:
    sweeps = [
        replace(sweep, varied={label: sweep.varied[label] for label in KEPT[name]})
        for name, sweep in points.SWEEPS.items()
    ]
    base = {"seconds": options.seconds, "warmup": 0.05}
    plan = session.Plan(points.ENGINES, sweeps, base, options.rounds)
    plan.check()
    results = Results(options.out / "results.csv")
    at = ""

    def progress(done: int, turn: session.Turn) -> None:
        nonlocal at
        if turn.sweep != at:
            at = turn.sweep
            say(f"sweep {at}: run {done + 1} of {plan.count()}")

    plan.run(results, progress)
    return results, plan


def main() -> int:
    options = parse()
    try:
        for engine in points.ENGINES:
            drivers.find(engine)
    except drivers.DriverMissing as error:
        sys.exit(str(error))
    options.out.mkdir(parents=True, exist_ok=True)
    started = time.monotonic()
    head = {
        "machine": machine.machine(),
        "versions": machine.versions(tf2=True),
        "date": time.strftime("%Y-%m-%d"),
        "command": "make evaluation",
    }
    text = options.page.read_text(encoding="utf-8")
    for name in ("about", "goals", "claims", "losses", "prediction", *(f"sweep {k}" for k in KEPT)):
        page.between(text, name, [])  # ten minutes later would be late to miss a marker
    if options.only != "sweeps":
        found = measure_goals(options)
        text = page.between(text, "goals", goals.table(found, head))
        print("\n".join(goals.table(found, head)))
    failures: list[str] = []
    if options.only != "goals":
        results, plan = measure_sweeps(options)
        failures = plan.failures
        drawn = figures.draw(results)
        report.write(options.out, results, head, drawn, failures)
        page.pictures(drawn, options.page.parent / "evaluation")
        for name, lines in page.parts(results, head, plan).items():
            text = page.between(text, name, lines)
    options.page.write_text(text, encoding="utf-8")
    say(f"done in {time.monotonic() - started:.0f} s; {len(failures)} runs failed")
    for failure in failures:
        say(failure)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())

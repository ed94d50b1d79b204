"""The goals of transactions and concurrency controls, as ratios of one interleaved run."""

from __future__ import annotations

import statistics
from dataclasses import dataclass
from typing import TYPE_CHECKING

from tfdb.bench.points import Point

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from tfdb.bench.results import Results

READ_ONLY = {"read-ratio": 1}
# A history that a thread which the scheduler leaves out for a while does not lose, and time to fill
# it: a ring that still grows turns its readers back.
CROWDED = {"threads": 8, "history": 0.3, "warmup": 1.5}
STARVED = {"threads": 5, "read-ratio": 0.2, "read-length": 1_000, "history": 0.3, "warmup": 0.6}

POINTS = {
    "reader": Point("snapshot", {"threads": 1, **READ_ONLY}),
    "readers": Point("snapshot", {"threads": 2, **READ_ONLY}),
    "readers, common time": Point("snapshot", {"threads": 2, **READ_ONLY, "time": "common"}),
    "tf2 reader": Point("tf2", {"threads": 1, **READ_ONLY}),
    "tf2 readers": Point("tf2", {"threads": 2, **READ_ONLY}),
    "beside": Point("snapshot", {"threads": 2}),
    "tf2 beside": Point("tf2", {"threads": 2}),
    "beside, single": Point("snapshot", {"threads": 2, "write-length": 1}),
    "tf2 beside, single": Point("tf2", {"threads": 2, "write-length": 1}),
    "crowded": Point("snapshot", CROWDED),
    "crowded no-wait": Point("2pl-no-wait", CROWDED),
    "writer": Point("snapshot", {"threads": 1, "read-ratio": 0, "joints": 100}),
    "writer, 1000": Point("snapshot", {"threads": 1, "read-ratio": 0}),
    "starved": Point("snapshot", STARVED),
    "starved silo": Point("silo", STARVED),
}


@dataclass(frozen=True)
class Goal:
    """One row. `measure` gives the figure of one round from the rows of that round."""

    text: str
    measure: Callable[[Mapping[str, dict[str, float]]], float]
    goal: float | None = None  # None: shown for what it says beside a goal
    at_least: bool = True
    unit: str = "x"


def _ratio(one: str, other: str, column: str) -> Callable[[Mapping[str, dict[str, float]]], float]:
    return lambda rows: rows[one][column] / rows[other][column]


def _in_one(point: str, column: str, scale: float) -> Callable[..., float]:
    return lambda rows: rows[point][column] * scale


def _per(point: str, columns: tuple[str, ...], of: str) -> Callable[..., float]:
    return lambda rows: sum(rows[point][column] for column in columns) / max(rows[point][of], 1)


READS, P999 = "reads_per_s", "reads_p999_ns"
GOALS = [
    Goal(
        "`snapshot`, read only, 16 edges: 2 threads against 1",
        _ratio("readers", "reader", READS),
        1.8,
    ),
    Goal(
        "`snapshot` against tf2, read only, 16 edges, 2 threads: each edge's newest against time 0",
        _ratio("readers", "tf2 readers", READS),
        8,
    ),
    Goal(
        "the same, both at the latest common time",
        _ratio("readers, common time", "tf2 readers", READS),
    ),
    Goal(
        "the same, one thread each (newest against time 0)", _ratio("reader", "tf2 reader", READS)
    ),
    Goal(
        "a reader's 99.9th percentile beside a writer flat out (16 edges each): share of tf2's",
        _ratio("beside", "tf2 beside", P999),
        1 / 20,
        at_least=False,
    ),
    Goal(
        "the same, beside a writer of single edges: share of tf2's",
        _ratio("beside, single", "tf2 beside, single", P999),
    ),
    Goal(
        "the same: `snapshot`, in microseconds",
        _in_one("beside", P999, 1e-3),
        unit="us",
    ),
    Goal(
        "YCSB-A, 1000 frames, 8 threads: aborts per read in `snapshot`",
        _per("crowded", ("retries", "lapped_reads", "reads_lost"), "reads_done"),
        0,
        at_least=False,
        unit="",
    ),
    Goal(
        "the same: retries per write in `2pl-no-wait`",
        _per("crowded no-wait", ("retries",), "writes_done"),
        0.3,
        at_least=False,
        unit="",
    ),
    Goal(
        "atomic write of 16 edges, nobody else there, 100 frames, median",
        _in_one("writer", "writes_p50_ns", 1e-3),
        27 / 20,
        at_least=False,
        unit="us",
    ),
    Goal(
        "the same, 1000 frames",
        _in_one("writer, 1000", "writes_p50_ns", 1e-3),
        unit="us",
    ),
    Goal(
        "a reader of 1000 edges beside 4 writers flat out: lookups per second, all answered",
        _in_one("starved", READS, 1.0),
        1,
        unit="per s",
    ),
    Goal(
        "the same: its longest lookup",
        _in_one("starved", "reads_max_ns", 1e-6),
        unit="ms",
    ),
    Goal(
        "the same: lookups that took the commit lock (after 16 snapshots that were overtaken)",
        _in_one("starved", "pinned_reads", 1.0),
        unit="",
    ),
    Goal(
        "the same reader in `silo`: lookups per second",
        _in_one("starved silo", READS, 1.0),
        unit="per s",
    ),
]


def number(value: float) -> str:
    if value == 0:
        return "0"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def table(results: Results, head: Mapping[str, str]) -> list[str]:
    """The goals, median of the rounds with the smallest and the largest."""
    rounds: dict[int, dict[str, dict[str, float]]] = {}
    for row in results.rows:
        rounds.setdefault(row["round"], {})[row["label"]] = row
    lines = [
        f"Machine: {head['machine']}; {head['versions']}; {head['date']}.",
        f"Median of {len(rounds)} rounds, all contenders in turns; `{head['command']}`.",
        "",
        "| what | goal | measured | all rounds | reached |",
        "|---|---|---|---|---|",
    ]
    return lines + [_line(goal, [goal.measure(rows) for rows in rounds.values()]) for goal in GOALS]


def _line(goal: Goal, values: list[float]) -> str:
    middle = statistics.median(values)
    unit = "x" if goal.unit == "x" else f" {goal.unit}".rstrip()
    wanted = verdict = ""
    if goal.goal is not None:
        wanted = f"{'≥' if goal.at_least else '≤'} {number(goal.goal)}{unit}"
        reached = middle >= goal.goal if goal.at_least else middle <= goal.goal
        verdict = "yes" if reached else "**no**"
    span = f"{number(min(values))} to {number(max(values))}"
    return f"| {goal.text} | {wanted} | {number(middle)}{unit} | {span} | {verdict} |"

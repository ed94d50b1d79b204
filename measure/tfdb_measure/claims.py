"""What docs/evaluation.md says of the paper: its claims judged, and where `snapshot` loses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from . import model
from .points import OURS, SWEEPS
from .results import number

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from .results import Results


@dataclass(frozen=True)
class Claim:
    """What the paper or the thesis says, and what to look at here."""

    text: str
    what: str  # that is computed here
    measure: Callable[[Results], float | None]
    holds: Callable[[float], bool]
    why: str  # where it may not hold here


def _share(
    above: tuple[str, str, str, str], below: tuple[str, str, str, str]
) -> Callable[[Results], float | None]:
    def measure(results: Results) -> float | None:
        one, other = results.median(*above), results.median(*below)
        return None if one is None or not other else one / other

    return measure


READS, WRITES, AGE = "reads_per_s", "writes_per_s", "age_p50_ns"
CLAIMS = [
    Claim(
        "The old library gets slower with more threads, because of its one mutex",
        "tf2, read only, 2 threads over 1",
        _share(("readers", "2", "tf2", READS), ("readers", "1", "tf2", READS)),
        lambda value: value < 1,
        "two cores on one chip hand over a mutex faster than four sockets",
    ),
    Claim(
        "With locks per frame, lookups run in parallel (x39 at 14 threads, x243 to x257 at most)",
        "`2pl-no-wait` over tf2, read only, 2 threads",
        _share(("readers", "2", "2pl-no-wait", READS), ("readers", "2", "tf2", READS)),
        lambda value: value > 1,
        "the ratio grows with the number of cores; here are two",
    ),
    Claim(
        "Without writers, two-phase locking costs no more than locks without isolation (0.96 to "
        "1.6)",
        "`2pl-no-wait` over `fine`, read only, 2 threads",
        _share(("readers", "2", "2pl-no-wait", READS), ("readers", "2", "fine", READS)),
        lambda value: value > 0.85,
        "",
    ),
    Claim(
        "With half of the operations writing, two-phase locking is much faster than locks without "
        "isolation (x4.5)",
        "`2pl-no-wait` over `fine`, YCSB-A, 8 threads, lookups",
        _share(("threads", "8", "2pl-no-wait", READS), ("threads", "8", "fine", READS)),
        lambda value: value > 1.5,
        "the thesis had 224 cores; with two, threads rarely wait",
    ),
    Claim(
        "In the old library, readers starve writers",
        "tf2, YCSB-A, 2 threads: writes over lookups, both without pauses (alone, a write costs as "
        "much as a few lookups)",
        _share(("threads", "2", "tf2", WRITES), ("threads", "2", "tf2", READS)),
        lambda value: value < 0.1,
        "the scheduler decides which of two threads gets a mutex",
    ),
    Claim(
        "... so its data is old (30.3 s against 230 ms: x132)",
        "age of the oldest sample used, YCSB-A, 2 threads: tf2 over `2pl-no-wait`",
        _share(("threads", "2", "tf2", AGE), ("threads", "2", "2pl-no-wait", AGE)),
        lambda value: value > 3,
        "the ratio grows with the length of the run, and this run is short",
    ),
    Claim(
        "At a fixed writer rate, the data of a fast enough store is as old as the rate implies",
        "age, 1000 writes/s and writer: tf2 over `snapshot`",
        _share(("age", "1000", "tf2", AGE), ("age", "1000", "snapshot", AGE)),
        lambda value: value > 1,
        "not measured in the paper, whose writers do not pause",
    ),
    Claim(
        "With more frames, aborts are rare (0.313 with 1000, 0.024 with 1 M)",
        "`2pl-no-wait`, aborts per operation: 100,000 frames over 100",
        _share(
            ("joints", "100000", "2pl-no-wait", "aborts_per_operation"),
            ("joints", "100", "2pl-no-wait", "aborts_per_operation"),
        ),
        lambda value: value < 0.5,
        "",
    ),
    Claim(
        "With long atomic writes, the throughput of No-Wait drops suddenly",
        "`2pl-no-wait`, edges written per second: 256 edges per write over 16",
        _share(
            ("write-length", "256", "2pl-no-wait", "writes_edges_per_s"),
            ("write-length", "16", "2pl-no-wait", "writes_edges_per_s"),
        ),
        lambda value: value < 0.5,
        "here bounded backoff replaces the sleep of 1 ms",
    ),
    Claim(
        "Cars in an edge cloud: 16 ms before, 0.24 ms after (x67)",
        "99.9th percentile of a lookup: tf2 over `snapshot`",
        _share(
            ("cars", "200 cars", "tf2", "reads_p999_ns"),
            ("cars", "200 cars", "snapshot", "reads_p999_ns"),
        ),
        lambda value: value > 3,
        "200 cars at 120 Hz load two cores less than the paper's 224 threads loaded its machine",
    ),
]


def claims(results: Results) -> Iterator[str]:
    """Write each claim with what was measured here."""
    yield "| the paper | here | measured | agrees | reasons for differences |"
    yield "|---|---|---:|---|---|"
    for claim in CLAIMS:
        value = claim.measure(results)
        if value is None:
            yield f"| {claim.text} | {claim.what} | | not measurable | {claim.why} |"
            continue
        verdict = "yes" if claim.holds(value) else "**no**"
        yield f"| {claim.text} | {claim.what} | {number(value)} | {verdict} | {claim.why} |"


# Figure, column, whether more is better.
COMPARED = (
    ("lookups/s", READS, True),
    ("writes/s", WRITES, True),
    ("lookup 99.9 %", "reads_p999_ns", False),
    ("write 99.9 %", "writes_p999_ns", False),
)
LOSSES_SHOWN = 30


@dataclass(frozen=True, order=True)
class Loss:
    """A point at which every round of another engine was better than every one of snapshot's."""

    factor: float
    sweep: str
    label: str
    figure: str
    engine: str


def _losses_at(results: Results, sweep: str, label: str) -> Iterator[Loss]:
    for title, column, more in COMPARED:
        ours = results.get(sweep, label, "snapshot", column)
        if ours is None or ours.median <= 0:
            continue
        found = []
        for engine in (*OURS[1:], "tf2"):
            theirs = results.get(sweep, label, engine, column)
            if theirs is None or theirs.median <= 0:
                continue
            apart = theirs.low > ours.high if more else theirs.high < ours.low
            factor = theirs.median / ours.median if more else ours.median / theirs.median
            if apart and factor > 1.05:
                found.append(Loss(factor, sweep, label, title, engine))
        if found:
            yield max(found)


def losses(results: Results) -> Iterator[str]:
    """Write where another engine, or tf2, was better in every round."""
    found = [
        loss
        for sweep in results.sweeps()
        if sweep in SWEEPS and sweep not in ("cars", "age")  # their threads work at a fixed rate
        for label in results.labels(sweep)
        for loss in _losses_at(results, sweep, label)
    ]
    yield (
        "Points at which every round of another engine was better than every round of `snapshot`, "
        f"by 5 % or more in the median: {len(found)}"
        + (f"; the {LOSSES_SHOWN} largest:" if len(found) > LOSSES_SHOWN else ".")
    )
    yield ""
    yield "| sweep | point | figure | best engine | times better |"
    yield "|---|---|---|---|---:|"
    for loss in sorted(found, reverse=True)[:LOSSES_SHOWN]:
        title = SWEEPS[loss.sweep].title
        yield (
            f"| {title} | {loss.label} | {loss.figure} | `{loss.engine}` | {number(loss.factor)} |"
        )


PREDICTED = (1, 2, 4, 8, 12, 16)


def prediction(results: Results) -> Iterator[str]:
    """Write what more cores would bring, as the model has it."""
    found = {costs.engine: costs for costs in model.costs(results)}
    heads = [f"{n} thread{'' if n == 1 else 's'}" for n in PREDICTED]
    yield "![A prediction](evaluation/prediction.png)"
    yield ""
    yield "Lookups of 16 edges per second, read only, in millions. **Only the columns of one and"
    yield "two threads were measured; the rest is predicted.**"
    yield ""
    yield "| engine | shared data | parameter | " + " | ".join(heads) + " | over tf2 at 8 |"
    yield "|---|---|---|" + "---:|" * (len(PREDICTED) + 1)
    for engine, costs in found.items():
        values = [number(costs.reads(n) / 1e6) for n in PREDICTED]
        over = number(costs.reads(8) / found["tf2"].reads(8)) + "x" if "tf2" in found else ""
        line = [f"`{engine}`", costs.kind, costs.parameter(), *values, over]
        yield "| " + " | ".join(line) + " |"
    busy = [
        f"`{e}`" for e, c in found.items() if c.kind == "no shared writes" and c.serial_share > 0.4
    ]
    if busy:
        yield ""
        yield (
            f"**Two threads brought {' and '.join(busy)} so little that the machine must have been "
            "busy with something else: repeat this run on a quiet one.**"
        )

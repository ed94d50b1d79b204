"""Points and sweeps: which parameters there are, and what each sweep varies."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from tfdb import InvalidArgument
from tfdb.data.argument_checks import refuse_word

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

Value = str | int | float

OURS = (
    "snapshot",
    "giant",
    "fine",
    "2pl-no-wait",
    "2pl-wait-die",
    "2pl-wound-wait",
    "silo",
)
TF2 = "tf2"
ENGINES = (*OURS, TF2)

MOST_JOINTS = 1_000_000
MOST_THREADS = 1_024


@dataclass(frozen=True)
class Point:
    """One engine under one set of parameters; the keys are the driver's options without dashes."""

    engine: str
    parameters: Mapping[str, Value]

    def arguments(self) -> list[str]:
        """Return the driver's command line."""
        words = [] if self.engine == TF2 else ["--engine", self.engine]
        for name, value in self.parameters.items():
            if value is True or value is False:
                words += [f"--{name}"] if value else []
            else:
                words += [f"--{name}", str(value)]
        return words


@dataclass(frozen=True)
class Sweep:
    """A list of points that differ in one thing."""

    name: str
    title: str
    axis: str  # of the thing that is varied, with its unit
    varied: Mapping[str, Mapping[str, Value]]  # label of each value -> parameters that it sets
    short: Sequence[str] = ()  # labels that --quick keeps; empty: all
    fixed: Mapping[str, Value] = field(default_factory=dict)  # over what the user asks for
    log: bool = False
    left_out: tuple[str, ...] = ()  # engines that cannot take part

    @property
    def numeric(self) -> bool:
        """Whether the labels are numbers, to be drawn on a scale."""
        return all(label.replace(".", "", 1).isdigit() for label in self.varied)

    def quick(self) -> Sweep:
        """Return the same with fewer values."""
        kept = self.short or tuple(self.varied)
        return replace(self, varied={label: self.varied[label] for label in kept})

    def points(self, engines: Sequence[str], base: Mapping[str, Value]) -> list[tuple[str, Point]]:
        """Return (label, point) for each value and engine, engines side by side."""
        return [
            (label, Point(engine, {**base, **self.fixed, **settings}))
            for label, settings in self.varied.items()
            for engine in engines
            if engine not in self.left_out
        ]


def _over(name: str, *values: Value) -> dict[str, dict[str, Value]]:
    return {str(value): {name: value} for value in values}


def _threads(*counts: int) -> dict[str, dict[str, Value]]:
    return _over("threads", *counts)


_DIRECTIONS: dict[str, dict[str, Value]] = {
    f"{order}, from {end}": {"direction": order, "lookup-from": end}
    for end in ("high", "low")
    for order in ("opposite", "same")
}

SWEEPS: dict[str, Sweep] = {
    sweep.name: sweep
    for sweep in (
        Sweep(
            "threads",
            "Threads, half of them reading (YCSB-A)",
            "threads",
            _threads(1, 2, 4, 8, 16),
            ("1", "2", "4", "8"),
            log=True,
        ),
        Sweep(
            "readers",
            "Threads that all read (YCSB-C)",
            "threads",
            _threads(1, 2, 4, 8, 16),
            ("1", "2", "8"),
            fixed={"read-ratio": 1},
            log=True,
        ),
        Sweep(
            "writers",
            "Threads that all write",
            "threads",
            _threads(1, 2, 4, 8, 16),
            ("1", "2", "8"),
            fixed={"read-ratio": 0},
            log=True,
        ),
        Sweep(
            "joints",
            "Frames in the tree",
            "frames",
            _over("joints", 20, 100, 1_000, 10_000, 100_000, 1_000_000),
            ("20", "1000", "100000"),
            log=True,
        ),
        Sweep(
            "iterations",
            "Operations per thread",
            "operations per thread",
            _over("iterations", 1_000, 10_000, 100_000, 1_000_000),
            ("1000", "10000"),
            log=True,
        ),
        Sweep(
            "read-ratio",
            "Share of operations that read",
            "share of reads",
            _over("read-ratio", 0, 0.1, 0.5, 0.9, 0.95, 0.99, 1),
            ("0", "0.5", "0.95", "1"),
            fixed={"share": "operations"},
        ),
        Sweep(
            "read-length",
            "Edges of a lookup",
            "edges per lookup",
            _over("read-length", 1, 4, 16, 64, 256, 1_000),
            ("1", "16", "256"),
            log=True,
        ),
        Sweep(
            "write-length",
            "Edges of an atomic write",
            "edges per write",
            _over("write-length", 1, 4, 16, 64, 256),
            ("1", "16", "256"),
            log=True,
        ),
        Sweep(
            "skew",
            "Skew of what is read and written",
            "Zipf's theta",
            _over("skew", 0, 0.5, 0.8, 0.99, 1.2),
            ("0", "0.99"),
        ),
        Sweep(
            "tree",
            "Shape of the tree",
            "shape",
            _over("tree", "chain", "star", "humanoid", "random"),
        ),
        Sweep(
            "direction",
            "Order of a batch against a lookup's, and the end that is looked up from",
            "order of the batch, source of the lookup",
            _DIRECTIONS,
            ("opposite, from high", "same, from high"),
        ),
        Sweep(
            "age",
            "Age of the data at fixed writer rates",
            "writes per second and writer",
            _over("write-frequency", 100, 300, 1_000, 3_000, 10_000),
            ("100", "1000"),
            # 100 frames: 16 of them per write, so that the writers' rate and not chance decides.
            fixed={"threads": 4, "joints": 100, "warmup": 0.3},
            log=True,
        ),
        Sweep(
            "latency",
            "Latency, one reader beside one writer",
            "",
            {"1 + 1": {"threads": 2}},
        ),
        Sweep(
            "cars",
            "Cars in an edge cloud: 200 at 120 Hz, 100 edges read, 20 written, 8.3 ms allowed",
            "",
            {
                "200 cars": {
                    "threads": 200,
                    "joints": 1_000,
                    "read-length": 100,
                    "write-length": 20,
                    "frequency": 120,
                    "deadline-ms": 8.3,
                    "history": 10,
                }
            },
        ),
        Sweep(
            "starvation",
            "A lookup of 1000 edges beside four writers without pause",
            "",
            {
                "1 + 4": {
                    "threads": 5,
                    "read-ratio": 0.2,
                    "joints": 1_000,
                    "read-length": 1_000,
                }
            },
        ),
    )
}


def choose_engines(text: str) -> tuple[str, ...]:
    """Return the engines of a list with commas; ``all`` means all. Raises `InvalidArgument`."""
    return _choose(text, ENGINES, "engine")


def choose_sweeps(text: str) -> tuple[str, ...]:
    """Return the sweeps of a list with commas; ``all`` means all. Raises `InvalidArgument`."""
    return _choose(text, tuple(SWEEPS), "sweep")


def _choose(text: str, known: tuple[str, ...], what: str) -> tuple[str, ...]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    if names == ["all"]:
        return known
    for name in names:
        if name not in known:
            refuse_word(what, name, known, "all")
    if not names:
        raise InvalidArgument(f"name at least one {what}: {', '.join(known)}, or all", value=text)
    return tuple(dict.fromkeys(names))

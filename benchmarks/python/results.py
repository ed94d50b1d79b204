"""What was measured, and what it means against the goals."""

from __future__ import annotations

import platform
import statistics
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from processes import Rounds


@dataclass
class Results:
    """Medians and rounds of all rows, by (source, row, chain)."""

    machine: str
    rows: dict[tuple[str, str, int], Rounds] = field(default_factory=dict)
    units: dict[tuple[str, str, int], str] = field(default_factory=dict)

    def add(self, source: str, row: str, chain: int, unit: str, rounds: Rounds) -> None:
        self.rows[source, row, chain] = rounds
        self.units[source, row, chain] = unit
        medians = "  ".join(f"{k} {statistics.median(v):,.4g}" for k, v in rounds.items())
        print(f"{source:>7} | {row}, chain {chain}: {medians} {unit}", flush=True)

    def median(self, source: str, row: str, chain: int, contender: str) -> float:
        return statistics.median(self.rows[source, row, chain][contender])

    def to_json(self) -> dict[str, Any]:
        return {
            "machine": self.machine,
            "rows": [
                {"source": s, "row": r, "chain": c, "unit": self.units[s, r, c], "rounds": rounds}
                for (s, r, c), rounds in self.rows.items()
            ],
        }

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> Results:
        results = cls(data["machine"])
        for row in data["rows"]:
            key = row["source"], row["row"], row["chain"]
            results.rows[key] = row["rounds"]
            results.units[key] = row["unit"]
        return results


def machine() -> str:
    """CPU model, cores, system and compiler, for the head of the table."""
    text = Path("/proc/cpuinfo").read_text()
    values: dict[str, str] = {}
    for line in text.splitlines():
        name, _, value = line.partition(":")
        values[name.strip()] = value.strip()
    model = values.get("model name", platform.machine())
    family = f"family {values.get('cpu family', '?')} model {values.get('model', '?')}"
    cores = text.count("processor\t")
    system = platform.freedesktop_os_release()["PRETTY_NAME"]
    return f"{model} ({family}), {cores} virtual cores, {system}"


@dataclass
class Goal:
    """A row of the table of goals. `at_least`: the ratio must reach it; else it must stay below."""

    text: str
    rival: str
    at_least: bool
    goal: float | None  # None: shown without one
    ours: tuple[str, str, int, str]
    theirs: tuple[str, str, int, str] | None
    unit: str = "x"
    per_second: bool = False  # greater is better: the ratio is ours to theirs

    def measured(self, results: Results) -> tuple[float, float, float | None] | None:
        """The figure that the goal is about, our median and theirs; None where not measured."""
        try:
            ours = results.median(*self.ours)
            theirs = results.median(*self.theirs) if self.theirs else None
        except KeyError:
            return None
        if theirs is None:
            return ours, ours, None
        return (ours / theirs if self.per_second else theirs / ours), ours, theirs

    def reached(self, figure: float) -> bool | None:
        if self.goal is None:
            return None
        return figure >= self.goal if self.at_least else figure <= self.goal


def speed(
    text: str,
    rival: str,
    goal: float | None,
    ours: tuple[str, str, int, str],
    theirs: tuple[str, str, int, str],
) -> Goal:
    """A goal of the kind "at least so many times faster"."""
    return Goal(text, rival, at_least=True, goal=goal, ours=ours, theirs=theirs)


def cpp(row: str, chain: int, contender: str) -> tuple[str, str, int, str]:
    return "C++", row, chain, contender


def python(row: str, chain: int, contender: str) -> tuple[str, str, int, str]:
    return "Python", row, chain, contender


TF2, TF2_ROS, TREE = "tf2 (C++)", "python3-tf2-ros", "transform-tree"
LONG = "1.15 M inserts and 308,471 lookups"
DEPTH = "lookup at random in n samples"

GOALS = [
    speed(
        "C++ lookup, chain of 4, interpolated",
        TF2,
        4.5,
        cpp("lookup mid", 4, "tfdb"),
        cpp("lookup mid", 4, "tf2"),
    ),
    speed(
        "C++ lookup, chain of 10, interpolated",
        TF2,
        5,
        cpp("lookup mid", 10, "tfdb"),
        cpp("lookup mid", 10, "tf2"),
    ),
    *(
        speed(
            f"C++ latest, chain of {chain}: each edge's newest, against time 0",
            TF2,
            6,
            cpp("lookup latest", chain, "tfdb newest of each edge"),
            cpp("lookup latest", chain, "tf2"),
        )
        for chain in (4, 10)
    ),
    *(
        speed(
            f"C++ latest common time, chain of {chain}",
            TF2,
            None,
            cpp("lookup latest", chain, "tfdb"),
            cpp("lookup latest", chain, "tf2"),
        )
        for chain in (4, 10)
    ),
    speed(
        "C++ `set_transform`, 10 edges in turns",
        TF2,
        4,
        cpp("set_transform", 10, "tfdb"),
        cpp("set_transform", 10, "tf2"),
    ),
    Goal(
        "allocations per C++ `set_transform` in steady state",
        TF2,
        at_least=False,
        goal=0,
        ours=cpp("allocations per set_transform", 10, "tfdb"),
        theirs=None,
        unit="",
    ),
    speed(
        "Python `lookup_transform` by name, chain of 4, interpolated",
        TF2_ROS,
        30,
        python("lookup mid", 4, "tfdb"),
        python("lookup mid", 4, "tf2_ros"),
    ),
    speed(
        "Python latest, chain of 4: each edge's newest, against time 0",
        TF2_ROS,
        60,
        python("lookup latest", 4, "tfdb, newest of each edge"),
        python("lookup latest", 4, "tf2_ros"),
    ),
    speed(
        "Python latest common time, chain of 4",
        TF2_ROS,
        None,
        python("lookup latest", 4, "tfdb"),
        python("lookup latest", 4, "tf2_ros"),
    ),
    speed(
        "our Python lookup against their C++ lookup, chain of 4",
        TF2,
        2,
        python("lookup mid", 4, "tfdb"),
        cpp("lookup mid", 4, "tf2"),
    ),
    speed(
        "Python lookup by name against a compiled `plan.at`, chain of 4",
        TREE,
        2.5,
        python("lookup mid", 4, "tfdb"),
        python("lookup mid", 4, "transform-tree plan.at"),
    ),
    speed(
        "the same with `.matrix`, which `plan.at` returns",
        TREE,
        1.8,
        python("lookup mid", 4, "tfdb, as a matrix"),
        python("lookup mid", 4, "transform-tree plan.at"),
    ),
    speed(
        "Python latest with `.matrix` against a compiled `plan.latest`, chain of 4",
        TREE,
        1,
        python("lookup latest", 4, "tfdb, newest of each edge, as a matrix"),
        python("lookup latest", 4, "transform-tree plan.latest"),
    ),
    # 250 ns where plan.at takes 680: stated as a ratio, so that it holds on any machine.
    speed(
        "Python `set_transform` against `plan.at` (250 ns where that takes 680)",
        TREE,
        680 / 250,
        python("set_transform", 4, "tfdb"),
        python("lookup mid", 4, "transform-tree plan.at"),
    ),
    *(
        speed(
            f"batch of 100,000 {order} stamps over {span}, chain of {chain}",
            TREE,
            goal,
            python(f"batch {order}{scan}", chain, "tfdb"),
            python(f"batch {order}{scan}", chain, "transform-tree"),
        )
        for order, chain, goal in (
            ("sorted", 1, 8),
            ("sorted", 4, 6),
            ("unsorted", 1, 5),
            ("unsorted", 4, 5),
        )
        for span, scan in (("0.1 s", ", 0.1 s scan"), ("10 s", ""))
    ),
    speed(
        "batch against a Python loop over tf2, per stamp, chain of 4",
        TF2_ROS,
        200,
        python("batch sorted", 4, "tfdb"),
        python("lookup mid", 4, "tf2_ros"),
    ),
    Goal(
        f"{LONG}, chain of 10, seconds",
        TF2,
        at_least=False,
        goal=1,
        ours=cpp(LONG, 10, "tfdb"),
        theirs=None,
        unit="s",
    ),
    Goal(
        "random lookup in 3.6 M samples against one in 1,000",
        "itself",
        at_least=False,
        goal=4,
        ours=cpp(DEPTH, 1, "tfdb, 3600000 samples"),
        theirs=cpp(DEPTH, 1, "tfdb, 1000 samples"),
        per_second=True,
    ),
    Goal(
        "two reader threads against one",
        "itself",
        at_least=True,
        goal=1.8,
        ours=cpp("readers, 2 threads", 10, "tfdb"),
        theirs=cpp("readers, 1 threads", 10, "tfdb"),
        per_second=True,
    ),
    speed(
        "loading 1 M transforms (`.mcap`), against rosbags and tf2 inserts",
        "rosbags + tf2",
        20,
        python("load, mcap", 10, "tfdb"),
        python("load, mcap", 10, "rosbags + tf2"),
    ),
    Goal(
        "bytes per stored sample, resident",
        TF2,
        at_least=False,
        goal=80,
        ours=cpp("memory per stored sample", 10, "tfdb"),
        theirs=None,
        unit="B",
    ),
]

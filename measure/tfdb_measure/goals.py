"""What tfdb is to reach: each goal a figure of the run, and how it is judged."""

from __future__ import annotations

import statistics
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from .points import Point
from .results import Cell, number

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from .results import Results


@dataclass(frozen=True)
class Goal:
    """One line: `of`, or `of` / `over` in each round; the median of the rounds is judged."""

    text: str
    rival: str
    of: Cell
    over: Cell | None = None
    goal: float | None = None  # None: shown for what it says beside a goal
    at_least: bool = True
    unit: str = "x"
    scale: float = 1.0

    def figures(self, results: Results) -> list[float]:
        """Return the figure of each round in which both cells were measured."""
        of = results.rounds(self.of)
        if self.over is None:
            return [self.scale * value for value in of.values()]
        over = results.rounds(self.over)
        return [self.scale * of[turn] / over[turn] for turn in of if over.get(turn)]

    def wanted(self) -> str:
        """Write the goal."""
        if self.goal is None:
            return ""
        return f"{'≥' if self.at_least else '≤'} {self.shown(self.goal)}"

    def shown(self, value: float) -> str:
        """Write a figure with its unit."""
        return number(value) + ("x" if self.unit == "x" else f" {self.unit}".rstrip())

    def reached(self, figure: float) -> bool | None:
        """Say whether a figure is good enough; None where there is no goal."""
        if self.goal is None:
            return None
        return figure >= self.goal if self.at_least else figure <= self.goal


@dataclass(frozen=True)
class Verdict:
    """A goal and what was measured for it; no figures: nothing was."""

    goal: Goal
    figures: Sequence[float]

    @property
    def figure(self) -> float:
        """The median of the rounds."""
        return statistics.median(self.figures)

    @property
    def missed(self) -> bool:
        """Whether it was measured and not reached."""
        return bool(self.figures) and self.goal.reached(self.figure) is False

    def line(self) -> str:
        """Write the row of the table."""
        goal = self.goal
        if not self.figures:
            return f"| {goal.text} | {goal.rival} | {goal.wanted()} | not measured | | |"
        low, high = (number(pick(self.figures)) for pick in (min, max))
        spread = "" if len(self.figures) == 1 else f"{low} to {high}"
        verdict = {True: "yes", False: "**no**", None: ""}[goal.reached(self.figure)]
        return (
            f"| {goal.text} | {goal.rival} | {goal.wanted()} | {goal.shown(self.figure)} "
            f"| {spread} | {verdict} |"
        )


def judge(goals: Sequence[Goal], results: Results) -> list[Verdict]:
    """Judge each goal by what was measured."""
    return [Verdict(goal, goal.figures(results)) for goal in goals]


def table(verdicts: Sequence[Verdict]) -> Iterator[str]:
    """Write all goals, then those that were missed, by how much."""
    yield "| what | against | goal | measured | all rounds | reached |"
    yield "|---|---|---|---|---|---|"
    yield from (verdict.line() for verdict in verdicts)
    yield ""
    judged = [verdict for verdict in verdicts if verdict.goal.goal is not None]
    unknown = sum(not verdict.figures for verdict in judged)
    missed = [verdict for verdict in judged if verdict.missed]
    yield (
        f"Goals: {len(judged)}; reached: {len(judged) - len(missed) - unknown}; "
        f"missed: {len(missed)}; not measured: {unknown}."
    )
    if missed:
        yield ""
    for verdict in missed:
        goal = verdict.goal
        yield f"- missed: {goal.text}: {goal.shown(verdict.figure)}, wanted {goal.wanted()}"


@dataclass(frozen=True)
class Felt:
    """One line of what a user notices: what people use today, and tfdb."""

    text: str
    today: str
    theirs: Cell
    ours: Cell
    unit: str
    scale: float = 1.0

    def line(self, results: Results) -> str | None:
        """Write the row of the table; None: one of them was not measured."""
        both = [
            [self.scale * value for value in results.rounds(cell).values()]
            for cell in (self.theirs, self.ours)
        ]
        if not all(both):
            return None
        theirs, ours = (statistics.median(values) for values in both)
        factor = f"{number(theirs / ours)}x" if ours else "to 0"
        shown = " | ".join(f"{number(value)} {self.unit}" for value in (theirs, ours))
        return f"| {self.text} | {self.today} | {shown} | {factor} |"


def felt(results: Results) -> Iterator[str]:
    """Write the table of what a user notices."""
    yield "| what | compared with | theirs | tfdb | factor |"
    yield "|---|---|---|---|---|"
    yield from filter(None, (each.line(results) for each in FELT))


# -- rows of contenders ---------------------------------------------------------------------------

TF2, TF2_ROS, TREE, ITSELF = "tf2 (C++)", "python3-tf2-ros", "transform-tree", "itself"
TF2_ROS2 = "tf2_ros of ROS 2, by hand"


def cpp(row: str, chain: int, contender: str) -> Cell:
    """Name a contender of a row of the C++ program."""
    return Cell("C++", f"{row}, chain of {chain}", contender)


def python(row: str, chain: int, contender: str) -> Cell:
    """Name a contender of a row of Python."""
    return Cell("Python", f"{row}, chain of {chain}" if chain else row, contender)


def cost(row: str, contender: str) -> Cell:
    """Name a case of a row of costs."""
    return Cell("cost", row, contender)


def faster(text: str, rival: str, goal: float | None, ours: Cell, theirs: Cell) -> Goal:
    """At least so many times faster, where the cells are times."""
    return Goal(text, rival, of=theirs, over=ours, goal=goal)


def at_most(
    text: str, goal: float | None, of: Cell, over: Cell | None = None, unit: str = "x"
) -> Goal:
    """At most so many times another case of our own, or so much of a unit."""
    return Goal(text, ITSELF, of=of, over=over, goal=goal, at_least=False, unit=unit)


_TORN = "torn reads of a pair of static edges"
_LONG = "1.15 M inserts and 308,471 lookups"
_ORDERS, _HELD = "write, n samples of one edge", "lookup in a held snapshot of n samples"
_DEPTH = "lookup at random, one edge"
_NEWEST, _AT = "tfdb, newest of each edge", "transform-tree plan.at"


def _lookups() -> Iterator[Goal]:
    mid, latest = "lookup mid", "lookup latest"
    for chain in (4, 10):
        text = f"C++ lookup, chain of {chain}, interpolated"
        yield faster(text, TF2, None, cpp(mid, chain, "tfdb"), cpp(mid, chain, "tf2"))
    for chain in (4, 10):
        text = f"C++ latest, chain of {chain}: each edge's newest, against time 0"
        ours = cpp(latest, chain, "tfdb newest of each edge")
        yield faster(text, TF2, None, ours, cpp(latest, chain, "tf2"))
        text = f"C++ latest common time, chain of {chain}"
        yield faster(text, TF2, None, cpp(latest, chain, "tfdb"), cpp(latest, chain, "tf2"))
    text = "Python `lookup_transform` by name, chain of 4, interpolated"
    yield faster(text, TF2_ROS, 30, python(mid, 4, "tfdb"), python(mid, 4, "tf2_ros"))
    text = "Python latest, chain of 4: each edge's newest, against time 0"
    yield faster(text, TF2_ROS, 60, python(latest, 4, _NEWEST), python(latest, 4, "tf2_ros"))
    text = "Python latest common time, chain of 4"
    yield faster(text, TF2_ROS, None, python(latest, 4, "tfdb"), python(latest, 4, "tf2_ros"))
    yield from _calls_of_tf2()
    text = "our Python lookup against their C++ lookup, chain of 4"
    yield faster(text, TF2, 2, python(mid, 4, "tfdb"), cpp(mid, 4, "tf2"))
    text = "Python lookup by name against a compiled `plan.at`, chain of 4"
    yield faster(text, TREE, 2.6, python(mid, 4, "tfdb"), python(mid, 4, _AT))
    text = "the same with `.matrix`, which `plan.at` returns"
    yield faster(text, TREE, 1.8, python(mid, 4, "tfdb, as a matrix"), python(mid, 4, _AT))
    text = "Python latest with `.matrix` against a compiled `plan.latest`, chain of 4"
    ours = python(latest, 4, f"{_NEWEST}, as a matrix")
    yield faster(text, TREE, 1, ours, python(latest, 4, "transform-tree plan.latest"))


def _calls_of_tf2() -> Iterator[Goal]:
    """Judge the drop-in: the same call of the same program, message out and message in."""
    for row, call, goal in (
        ("lookup mid", "`lookup_transform`, interpolated", 6),
        ("can_transform", "`can_transform`", 8),
        ("can_transform, no answer", "`can_transform` without an answer", None),
        ("set_transform", "`set_transform`, the making of the message included", 2),
    ):
        ours, theirs = python(row, 4, "tfdb.tf2"), python(row, 4, "tf2_ros")
        yield faster(f"`tfdb.tf2.Buffer`: {call}, chain of 4", TF2_ROS, goal, ours, theirs)
    row = "message of all edges from bytes"
    text = (
        "a message on /tf of 10 transforms, from bytes into the store, against rospy and `tf2_ros`"
    )
    ours, theirs = python(row, 10, "tfdb.tf2"), python(row, 10, "tf2_ros")
    yield faster(text, TF2_ROS, 50, ours, theirs)


def _writes() -> Iterator[Goal]:
    one = "C++ `set_transform`, 10 edges one after the other"
    ten = "C++ batch of 10 edges, per transform"
    theirs = cpp("set_transform", 10, "tf2")
    yield faster(one, TF2, None, cpp("set_transform", 10, "tfdb"), theirs)
    yield faster(ten, TF2, None, cpp("set_transform", 10, "tfdb batch"), theirs)
    allocated = cpp("allocations per set_transform", 10, "tfdb")
    yield at_most("allocations per C++ `set_transform` in steady state", 0, allocated, unit="")
    # 250 ns where plan.at takes 680: stated as a ratio, so that it holds on any machine.
    text = "Python `set_transform` against `plan.at` (250 ns where that takes 680)"
    yield faster(text, TREE, 2.72, python("set_transform", 4, "tfdb"), python("lookup mid", 4, _AT))
    text = "samples of one edge from arrays: `set_transforms(Columns)` against `push_many`"
    row = "samples of one edge from arrays"
    push_many = python(row, 4, "transform-tree push_many")
    yield faster(text, TREE, None, python(row, 4, "tfdb"), push_many)
    text, row = "longest of 1 M writes while an edge grows, against the median", "one write of n"
    longest, median = (cost(f"{row}, in order", name) for name in ("longest", "median"))
    yield at_most(text, None, longest, median)
    for name in ("each older than the last", "in random order"):
        yield Goal(
            f"longest commit of 1 M samples {name}", ITSELF, cost(f"{row}, {name}", "longest"),
            goal=1.0, at_least=False, unit="ms", scale=1e-6,
        )  # fmt: skip
    for name, limit in (("each older than the last", 3.0), ("in random order", 15.0)):
        text = f"1 M samples {name}, against in order"
        yield at_most(text, limit, cost(_ORDERS, name), cost(_ORDERS, "in order"))
        quarter = cost(_ORDERS, f"{name}, a quarter of them")
        yield at_most(
            "the same: a write, against one of 250,000", 1.5, cost(_ORDERS, name), quarter
        )
    for row, what in (("lookup near the newest", "lookup"), ("write", "write")):
        late = cost(f"{row}, few late", "1 of 100 late")
        in_order = cost(f"{row}, few late", "in order")
        yield at_most(f"1 % late samples: {what}, against in order", 1.3, late, in_order)


def _batches() -> Iterator[Goal]:
    for order, chain, goal in (
        ("sorted", 1, 6.0), ("sorted", 4, 6.0), ("unsorted", 1, 5.0), ("unsorted", 4, 5.0),
    ):  # fmt: skip
        for span, scan in (("0.1 s", ", 0.1 s scan"), ("10 s", "")):
            text = f"batch of 100,000 {order} stamps over {span}, chain of {chain}"
            row = f"batch {order}{scan}"
            theirs = python(row, chain, "transform-tree")
            yield faster(text, TREE, goal, python(row, chain, "tfdb"), theirs)
    text = "batch against a Python loop over tf2, per stamp, chain of 4"
    theirs = python("lookup mid", 4, "tf2_ros")
    yield faster(text, TF2_ROS, 200, python("batch sorted", 4, "tfdb"), theirs)
    row = "batch sorted over n samples"
    text = "batch of 100,000 sorted stamps over 1 M samples, per stamp, against 10 s of them"
    yield at_most(text, None, python(row, 0, "tfdb"), python(row, 0, "tfdb, 10 s"))
    for count in (1, 4, 16, 64):
        for span, scan in (("10 s", ""), ("0.1 s", ", 0.1 s scan")):
            row = f"{count} stamps in one call{scan}"
            ours = python(row, 4, "tfdb")
            text = f"{count} stamps over {span} in one call, chain of 4"
            single = python(row, 4, "tfdb, one by one")
            yield at_most(f"{text}, against so many lookups", 1.2, ours, single)
            yield faster(text, TREE, 1, ours, python(row, 4, "transform-tree"))
    for name in ("100,000 stamps", "as many stamps as samples"):
        cell = python("working memory of a batch over n samples", 0, name)
        yield Goal(
            f"working memory of a batch over 1 M samples: {name}", ITSELF, cell,
            goal=8.0, at_least=False, unit="MiB", scale=2.0**-20,
        )  # fmt: skip


def _history() -> Iterator[Goal]:
    text, long = f"{_LONG}, chain of 10, seconds", cpp(_LONG, 10, "tfdb")
    yield Goal(text, TF2, long, goal=1.0, at_least=False, unit="s")
    fresh = cost(_HELD, "before")
    for name in ("after clear()", "after re-parenting", "after n later samples"):
        text = f"lookup in a held snapshot {name}, against before"
        yield at_most(text, None, cost(_HELD, name), fresh)
    for name, limit in (("spread", 1.0), ("in one gap", 50.0)):
        cell = cost(_HELD, f"after n late samples, {name}")
        yield Goal(
            f"the same after 1 M late samples, {name}", ITSELF, cell,
            goal=limit, at_least=False, unit="us", scale=1e-3,
        )  # fmt: skip
    text = "lookup at random in 10,000 samples, one edge, against 1,000"
    yield Goal(text, ITSELF, cost(_DEPTH, "10000 samples"), cost(_DEPTH, "1000 samples"))
    misses = cost("lookup at random, in dependent misses", "3.6 n samples over 1000")
    text = "the same in 3.6 M samples, over one in 1,000: dependent misses"
    yield at_most(text, None, misses, unit="misses")
    for call in ("tree()", "frame_info"):
        row = f"{call} of n samples"
        text = f"`{call}` of 1 M samples, against 125,000"
        yield at_most(text, 1.5, cost(row, "n"), cost(row, "an eighth of n"))
    yield at_most(
        "entries looked at per name, `prefixN`, 10 to 100,000 frames, the worst of five prefixes",
        1.5, cost("entries looked at per name, prefixN", "worst"), unit="",
    )  # fmt: skip
    memory = cpp("memory per stored sample", 10, "tfdb")
    yield at_most("bytes per stored sample, resident", None, memory, unit="B")


def _bytes() -> Iterator[Goal]:
    row = "a commit of ten, in samples of 64"
    yield at_most(
        "`commits_bytes` of a commit of ten, in samples of 64", 3,
        cost(row, "commits_bytes"), unit="us",
    )  # fmt: skip
    text = "`apply` of a commit of ten, against storing the same TFMessage"
    yield at_most(text, 1.3, cost(row, "apply"), cost(row, "a TFMessage"))
    size = cost("bytes a transform, in samples of 64 commits of ten", "bytes a transform")
    yield at_most("bytes a transform, in samples of 64 commits of ten", 62, size, unit="B")
    state = "a state of 10,000 frames of ten samples"
    for name, goal in (("encode", 50), ("apply", 40)):
        yield at_most(f"{state}: {name}", goal, cost(state, name), unit="ms")
    text = "a commit of ten beside 1,000 watches on other frames, against none"
    row = "a commit of ten, watched"
    yield at_most(text, 1.03, cost(row, "1,000 watches on other frames"), cost(row, "no watch"))


def _rest() -> Iterator[Goal]:
    text = "loading 1 M transforms (`.mcap`), against rosbags and tf2 inserts"
    ours = Cell("loading", "load, mcap, chain of 10", "tfdb")
    yield faster(text, "rosbags + tf2", 40, ours, replace(ours, engine="rosbags + tf2"))
    ten = replace(ours, label="load, mcap of ten times as many, chain of 10")
    yield at_most("loading 10 M transforms, against 1 M", 11, ten, ours)
    row = "memory per sample after that load, chain of 10"
    text = "memory per sample after loading 10 M, against samples of `push_many`"
    theirs = Cell("loading", row, "transform-tree")
    yield Goal(text, TREE, replace(theirs, engine="tfdb"), theirs, goal=1.1, at_least=False)
    text = "`import tfdb` against `import numpy`"
    numpy = Cell("start", "import", "numpy")
    yield Goal(text, "numpy", replace(numpy, engine="tfdb"), numpy, goal=1.05, at_least=False)
    text, row = "two reader threads against one", "readers, {} threads"
    two, one = (cpp(row.format(threads), 10, "tfdb") for threads in (2, 1))
    yield Goal(text, ITSELF, two, one, goal=1.8)
    yield at_most("torn reads of a pair of edges", 0, Cell("torn", _TORN, "tfdb"), unit="%")


def shared(row: str, contender: str) -> Cell:
    """Name a contender of a row of stores that processes share."""
    return Cell("sharing", row, contender)


def _sharing() -> Iterator[Goal]:
    row = "lookup mid, chain of 4"
    private = shared(row, "private")
    text = "Python lookup, chain of 4, in a store that processes share, against a private one"
    yield at_most(text, 1.05, shared(row, "shared"), private)
    text = "the same in another process than the writer"
    yield at_most(text, 1.05, shared(row, "another process"), private)
    row = "lookups of reader processes together"
    text = "lookups of two reader processes, against one"
    yield Goal(text, ITSELF, shared(row, "2 processes"), shared(row, "1 process"), 1.9)
    row = "CPU of a commit beside processes that read every change"
    text = "commits per CPU second beside 16 processes that read every change, against none"
    yield Goal(text, ITSELF, shared(row, "none"), shared(row, "16 processes"), 0.9)
    row = "CPU of a commit beside coroutines that wait for other frames"
    text = "a commit beside 10,000 coroutines that wait for other frames: CPU time"
    yield at_most(text, 1.1, shared(row, "10,000 waits"), shared(row, "none"))
    row = "CPU of a process that follows 100,000 transforms/s of another"
    for how, most in (("batches", None), ("samples", 20)):
        cell = shared(row, how)
        yield Goal(f"{row}: {how}", ITSELF, cell, goal=most, at_least=False, unit="%")
    for per_s in ("1,000", "5,000"):
        row = f"CPU of a process that mirrors {per_s} commits/s of ten"
        text = f"{row}, against an empty callback of Zenoh"
        yield at_most(text, 1.2, shared(row, "mirror"), shared(row, "empty callback"))
    row = "from a commit to another process, {}"
    for name, factor in (("p50", 1.6), ("p99", 2.0)):
        text = f"from a commit until a mirror has it, 1,000 commits/s: {name}, against Zenoh alone"
        mirrored, alone = (shared(row.format(each), name) for each in ("mirror", "Zenoh alone"))
        yield at_most(text, factor, mirrored, alone)
    yield from _mirrors()
    row = "CPU of the page's server, 2,000 moving frames at 30 Hz"
    for viewers, most in (("1 viewer", 5), ("10 viewers", 10)):
        cell = shared(row, viewers)
        yield Goal(f"{row}: {viewers}", ITSELF, cell, goal=most, at_least=False, unit="%")
    row = "CPU of a recorder of 100,000 transforms/s of another process"
    yield at_most(row, 35, shared(row, "tfdb"), unit="%")
    row = "the file of a recorder, the same messages"
    text = "bytes of a recorder's file, against mcap's own writer of the same messages"
    yield at_most(text, 1.05, shared(row, "tfdb"), shared(row, "mcap's own writer"))
    row = "a commit of ten beside rules on other frames"
    text = "a commit of ten beside 1,000 rules on other frames, against none"
    yield at_most(text, 1.05, shared(row, "1,000 rules"), shared(row, "none"))
    for row, p50, p99 in (
        ("from a commit to a rule's action", 0.2, 1.5),
        ("from a commit to a rule's action in another process", 0.2, 0.5),
        ("from the time of a played message to its commit, 1,000 messages/s", None, 1.0),
        ("a jump in a recording of 1,000 transforms/s, history of 10 s", 30.0, None),
        ("a jump in ten minutes of 1,000 transforms/s as `tfdb record` writes them", 30.0, None),
        ("opening a shared store and first answer", 1.0, None),
        ("from a commit to a waiting thread of another process", 0.06, 0.4),
        ("from a commit to a waiting coroutine of another process", 0.15, 0.6),
        ("from a writer's death to the next commit, 10,000 frames", 0.3, 5.0),
        ("from a writer's death amid a commit to the next commit, 10,000 frames", None, None),
    ):
        for name, limit in (("p50", p50), ("p99", p99)):
            yield Goal(
                f"{row}: {name}", ITSELF, shared(row, name),
                goal=limit, at_least=False, unit="ms",
            )  # fmt: skip


def _mirrors() -> Iterator[Goal]:
    row = "commits of ten per second of a mirror that gets them as fast as it can"
    for name, goal in (("one a message", 90_000), ("20 a message", 150_000)):
        yield Goal(f"{row}: {name}", ITSELF, shared(row, name), goal=goal, unit="/s")
    row = "transforms per second into one store from 1,000 homes of 20 edges"
    yield Goal(
        f"{row}: ten commits a message", ITSELF, shared(row, "ten commits a message"),
        goal=2.0, unit="M/s", scale=1e-6,
    )  # fmt: skip
    yield Goal(
        "messages per second from 1,000 homes of 20 edges: one commit a message", ITSELF,
        shared(row, "one commit a message"), goal=45_000, unit="/s", scale=1 / 20,
    )  # fmt: skip
    row = "commits of ten per second of a home, beside a writer of another process"
    text = "commits that a home sends of those of a writer at full speed"
    yield Goal(text, ITSELF, shared(row, "sent"), shared(row, "written"), 0.95)
    row = "a new mirror of 10,000 frames of ten samples, until it is live"
    yield at_most(row, 0.5, shared(row, "tfdb"), unit="s")
    row = "a new session, until it knows 1,000 homes"
    yield at_most(row, 0.2, shared(row, "tfdb"), unit="s")


def _processes() -> Iterator[Goal]:
    for what, row in (
        ("lookup by name against a compiled `plan.at`, beside a writer's process",
         "lookup mid beside a writer's process"),
        ("one sample of each edge in turn, beside readers' processes",
         "set_transform beside readers' processes"),
        ("opening it and first answer", "opening and first answer, beside readers"),
    ):  # fmt: skip
        ours, theirs = (shared(f"{row}, chain of 10", who) for who in ("tfdb", "transform-tree"))
        yield faster(f"shared memory, chain of 10: {what}", TREE, 1, ours, theirs)
    row = "CPU of a process with 100 lookups/s, chain of 10"
    each = shared(row, "tfdb, each of 16")
    text = (
        "CPU of each of 16 Python readers of one store, 100 lookups/s, 5,000 transforms/s written"
    )
    yield at_most(text, 0.5, each, unit="%")
    text = "the same of processes that do nothing 100 times/s: what it costs to be woken"
    yield Goal(text, ITSELF, shared(row, "only woken so often, each of 16"), unit="%")
    for title in ("alone", "each of 2"):
        theirs = shared(row, f"tf2_ros listener, {title}")
        text = f"CPU of such a reader, against a `tf2_ros` listener's over roscore, {title}"
        yield faster(text, TF2_ROS, 50 if title == "alone" else None, each, theirs)
    row = "memory of a store, the shares of its writer and readers together, chain of 10"
    text = "memory of a store in all its processes together, 16 readers against 1"
    yield at_most(text, 1.05, shared(row, "16 readers"), shared(row, "1 reader"))


def _live() -> Iterator[Goal]:
    for what in ("500 messages/s of 10 transforms", "50 messages/s of 100 transforms"):
        row = f"CPU of a node of ROS 1 that listens to {what}"
        theirs = Cell("live", row, "tf2_ros")
        for text, title, limit in (
            ("without any package of ROS", "tfdb", 0.35),
            ("within rospy", "tfdb in rospy", 0.5),
        ):
            yield Goal(
                f"{row}: {text}", TF2_ROS, Cell("live", row, title), theirs, limit,
                at_least=False,
            )  # fmt: skip
    for what, alone, inside in (
        ("500 messages/s of 10 transforms", 0.22, 0.5),
        ("50 messages/s of 100 transforms", 0.12, 0.4),
    ):
        row = f"CPU of a node of ROS 2 that listens to {what}"
        late = f"ROS 2, publish to stored, {what}, p50"
        for text, title, limit in (
            ("in a thread of its own", "tfdb", alone),
            ("in the executor", "tfdb in the executor", inside),
        ):
            of, over = Cell("live", row, title), Cell("live", row, "tf2_ros")
            yield Goal(f"{row}: {text}", TF2_ROS2, of, over, limit, at_least=False)
            of, over = Cell("live", late, title), Cell("live", late, "tf2_ros")
            yield Goal(f"{late}: {text}", TF2_ROS2, of, over, 1.0, at_least=False)
        for text, rival, most in (
            ("tfdb without rclpy", "tf2_ros", 0.2),
            ("tfdb without rclpy, against a callback that does nothing", "deserialised", 0.25),
        ):
            of, over = (Cell("live", row, each) for each in ("tfdb without rclpy", rival))
            yield Goal(f"{row}: {text}", TF2_ROS2, of, over, most, at_least=False)
    delay = "publish to return of a waiting lookup: "
    for name, most in (("p50", 0.3), ("p99", 2.0)):
        theirs = Cell("live", f"{delay}tf2_ros", name)
        yield Goal(f"{delay}tf2_ros, timeout of 1 s, {name}", TF2_ROS, theirs, unit="ms")
        yield at_most(f"{delay}tfdb, {name}", most, Cell("live", f"{delay}tfdb", name), unit="ms")
    for row, most, unit in (
        ("a write of other frames beside 10,000 futures", 10.0, "us"),
        ("a write that ends 10,000 futures, until all have their results", 20.0, "ms"),
    ):
        yield at_most(row, most, Cell("live", row, "tfdb"), unit=unit)
    nodes = "20 nodes with 100 lookups/s each, 50 messages/s of 10 transforms"
    for what, goal in (("CPU", 1 / 30), ("memory", 1 / 10)):
        row = f"{what} of {nodes}"
        text = f"{row}: one listens for all, against a `tf2_ros` listener in each"
        ours, theirs = Cell("live", row, "tfdb"), Cell("live", row, "tf2_ros")
        yield Goal(text, TF2_ROS, ours, theirs, goal, at_least=False)


def _felt() -> Iterator[Felt]:
    mid, stream = "lookup mid", "listens to 500 messages/s of 10 transforms"
    ros, us = "`tf2_ros`", 1e-3
    theirs = python(mid, 4, "tf2_ros")
    text = "a lookup in Python, through 4 edges"
    yield Felt(text, ros, theirs, python(mid, 4, "tfdb"), "us", us)
    text = "the same in a tf2 program that imports `tfdb.tf2`"
    yield Felt(text, ros, theirs, python(mid, 4, "tfdb.tf2"), "us", us)
    text = "a lookup of 100,000 stamps in Python, per stamp"
    yield Felt(text, ros, theirs, python("batch sorted", 4, "tfdb"), "us", us)
    text = "a lookup in C++, through 4 edges"
    yield Felt(text, "tf2", cpp(mid, 4, "tf2"), cpp(mid, 4, "tfdb"), "us", us)
    text, row = (
        "a message on /tf of 10 transforms, into the store",
        "message of all edges from bytes",
    )
    ours = python(row, 10, "tfdb.tf2")
    yield Felt(text, f"rospy, {ros}", python(row, 10, "tf2_ros"), ours, "us", us)
    row = "load, mcap, chain of 10"
    theirs, ours = (Cell("loading", row, name) for name in ("rosbags + tf2", "tfdb"))
    yield Felt("loading a recording of 1 M transforms", "rosbags, tf2", theirs, ours, "s")
    for version in (1, 2):
        row = f"CPU of a node of ROS {version} that {stream}"
        theirs, ours = (Cell("live", row, name) for name in ("tf2_ros", "tfdb"))
        yield Felt(row, ros, theirs, ours, "% of a core")
    delay = "publish to return of a waiting lookup: "
    theirs, ours = (Cell("live", f"{delay}{name}", "p50") for name in ("tf2_ros", "tfdb"))
    yield Felt("from a message to a lookup that waits for it", ros, theirs, ours, "ms")
    theirs, ours = (Cell("torn", _TORN, name) for name in ("tf2", "tfdb"))
    text = "lookups of two edges that mix two writes, beside a fast writer"
    yield Felt(text, "tf2", theirs, ours, "%")


FELT = [*_felt()]
"""What a user notices, for the top of docs/benchmarks.md."""

ROWS = [
    *_lookups(),
    *_writes(),
    *_batches(),
    *_history(),
    *_bytes(),
    *_sharing(),
    *_processes(),
    *_live(),
    *_rest(),
]
"""Goals of the rows, for docs/benchmarks.md."""


# -- points of a workload -------------------------------------------------------------------------

_READ_ONLY = {"read-ratio": 1}
# A history that a thread which the scheduler leaves out does not lose, and time to fill it.
_CROWDED = {"threads": 8, "history": 0.3, "warmup": 1.5}
_STARVED = {"threads": 5, "read-ratio": 0.2, "read-length": 1_000, "history": 0.3, "warmup": 0.6}

POINTS = {
    "reader": Point("snapshot", {"threads": 1, **_READ_ONLY}),
    "readers": Point("snapshot", {"threads": 2, **_READ_ONLY}),
    "readers, common time": Point("snapshot", {"threads": 2, **_READ_ONLY, "time": "common"}),
    "tf2 reader": Point("tf2", {"threads": 1, **_READ_ONLY}),
    "tf2 readers": Point("tf2", {"threads": 2, **_READ_ONLY}),
    "beside": Point("snapshot", {"threads": 2}),
    "tf2 beside": Point("tf2", {"threads": 2}),
    "beside, single": Point("snapshot", {"threads": 2, "write-length": 1}),
    "tf2 beside, single": Point("tf2", {"threads": 2, "write-length": 1}),
    "crowded": Point("snapshot", _CROWDED),
    "crowded no-wait": Point("2pl-no-wait", _CROWDED),
    "writer": Point("snapshot", {"threads": 1, "read-ratio": 0, "joints": 100}),
    "writer, 1000": Point("snapshot", {"threads": 1, "read-ratio": 0}),
    "starved": Point("snapshot", _STARVED),
    "starved giant": Point("giant", _STARVED),
    "starved silo": Point("silo", _STARVED),
}
"""Points that are measured for goals alone, in turns."""

_READS, _P999 = "reads_per_s", "reads_p999_ns"


def at(point: str, column: str) -> Cell:
    """Name a column of one of the points."""
    return Cell("goals", point, POINTS[point].engine, column)


ENGINES = [
    Goal(
        "`snapshot`, read only, 16 edges: 2 threads against 1",
        ITSELF,
        at("readers", _READS),
        at("reader", _READS),
        1.8,
    ),
    Goal(
        "`snapshot`, read only, 16 edges, 2 threads: each edge's newest against time 0",
        TF2,
        at("readers", _READS),
        at("tf2 readers", _READS),
        8,
    ),
    Goal(
        "the same, both at the latest common time",
        TF2,
        at("readers, common time", _READS),
        at("tf2 readers", _READS),
    ),
    Goal(
        "the same, one thread each (newest against time 0)",
        TF2,
        at("reader", _READS),
        at("tf2 reader", _READS),
    ),
    Goal(
        "99.9th percentile of a reader beside a writer at full speed (16 edges): share of tf2's",
        TF2,
        at("beside", _P999),
        at("tf2 beside", _P999),
        1 / 20,
        at_least=False,
    ),
    Goal(
        "the same, beside a writer of single edges: share of tf2's",
        TF2,
        at("beside, single", _P999),
        at("tf2 beside, single", _P999),
    ),
    Goal(
        "the same: `snapshot`, in microseconds",
        ITSELF,
        at("beside", _P999),
        unit="us",
        scale=1e-3,
    ),
    Goal(
        "YCSB-A, 1000 frames, 8 threads: aborts per read in `snapshot`",
        ITSELF,
        at("crowded", "aborts_per_read"),
        goal=0,
        at_least=False,
        unit="",
    ),
    Goal(
        "the same: retries per write in `2pl-no-wait`",
        ITSELF,
        at("crowded no-wait", "retries_per_write"),
        goal=0.3,
        at_least=False,
        unit="",
    ),
    Goal(
        "atomic write of 16 edges, no other thread, 100 frames, median",
        ITSELF,
        at("writer", "writes_p50_ns"),
        goal=27 / 20,
        at_least=False,
        unit="us",
        scale=1e-3,
    ),
    Goal(
        "the same, 1000 frames",
        ITSELF,
        at("writer, 1000", "writes_p50_ns"),
        unit="us",
        scale=1e-3,
    ),
    Goal(
        "a reader of 1000 edges beside 4 writers at full speed: lookups per second, all answered",
        ITSELF,
        at("starved", _READS),
        goal=1,
        unit="per s",
    ),
    Goal(
        "the same: its 99.9th percentile, against `giant`'s",
        "`giant`",
        at("starved", _P999),
        at("starved giant", _P999),
        1,
        at_least=False,
    ),
    Goal(
        "the same: its longest lookup",
        ITSELF,
        at("starved", "reads_max_ns"),
        unit="ms",
        scale=1e-6,
    ),
    Goal(
        "the same: lookups that pinned their state, after being overtaken four times",
        ITSELF,
        at("starved", "pinned_reads"),
        unit="",
    ),
    Goal(
        "the same reader in `silo`: lookups per second",
        "`silo`",
        at("starved silo", _READS),
        unit="per s",
    ),
]
"""Goals of the points, for docs/evaluation.md."""

"""Cycles of the graph, by the names that they have in the literature."""

from __future__ import annotations

from collections import defaultdict, deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .graph import Dependency, Graph, components, precedes

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from .history import Value

MEANINGS = {
    "garbage_read": "a read of a value that no transaction wrote to that edge",
    "dirty_read": "a read of an aborted value, or of one that its own writer replaced (G1)",
    "own_write_missed": "a transaction that did not see its own write",
    "torn_batch": "a reader that saw some writes of a commit, but not all",
    "torn_path": "a lookup computed from two states",
    "non_repeatable_read": "two reads of one edge in one transaction, with different results",
    "lost_update": "a value that was overwritten by one computed from an older value",
    "write_skew": "two transactions that each overwrote data read by the other",
    "read_skew": "a transaction that saw a part of another's writes and missed the rest",
    "phantom_sample": "a new sample that would have changed the result of a read",
    "phantom_frame": "a new or removed frame that would have changed the result of a read",
    "phantom_reparent": "a new parent that would have changed the result of a read",
    "long_fork": "two readers that saw two commits in opposite orders",
    "stale_read": "a read of an old value after its replacement had been committed",
    "real_time_order": "a transaction that saw or replaced a write which began after its own end",
    "circular_read": "transactions that saw each other's writes in a cycle",
    "write_cycle": "commits that replaced each other's writes in opposite orders",
    "not_serializable": "no order of the transactions explains what they read",
}

_PHANTOMS = {
    "parent": "phantom_reparent",
    "frame": "phantom_frame",
    "sample": "phantom_sample",
}
_SEARCHES = 60
_SEARCH_NODES = 20_000

Step = tuple[int, Dependency]


@dataclass
class Anomaly:
    """One kind of anomaly: its smallest example, and how many were found."""

    name: str
    transactions: tuple[Value, ...]
    steps: tuple[str, ...]
    count: int = 1

    @property
    def meaning(self) -> str:
        """What the name means."""
        return MEANINGS[self.name]


class Found:
    """Anomalies by name; keeps the smallest example of each."""

    def __init__(self) -> None:
        self._best: dict[str, Anomaly] = {}
        self._size: dict[str, tuple[int, ...]] = {}
        self._counted: set[tuple[str, frozenset[Value]]] = set()

    def add(self, anomaly: Anomaly, size: tuple[int, ...]) -> None:
        """Count the anomaly, once for the same transactions."""
        name = anomaly.name
        key = (name, frozenset(anomaly.transactions))
        if key in self._counted:
            return
        self._counted.add(key)
        known = self._best.get(name)
        if known is None:
            self._best[name], self._size[name] = anomaly, size
            return
        if size < self._size[name]:
            anomaly.count = known.count
            self._best[name], self._size[name] = anomaly, size
        self._best[name].count += 1

    def __bool__(self) -> bool:
        return bool(self._best)

    def all(self) -> list[Anomaly]:
        """One anomaly for each name, in the order of `MEANINGS`."""
        return [self._best[name] for name in MEANINGS if name in self._best]


def find_cycles(graph: Graph, tangled: set[int], found: Found) -> None:
    """Name the cycles among the nodes that could not be put in order."""
    for component in components(graph, tangled, real_time=True):
        finder = _Finder(graph, set(component), found)
        finder.pairs()
        finder.readers()
        finder.searches()


class _Finder:
    """Looks for cycles within one strongly connected component."""

    def __init__(self, graph: Graph, members: set[int], found: Found) -> None:
        self._graph = graph
        self._members = members
        self._found = found
        count = len(graph.transactions)
        self._nodes = sorted(node for node in members if node < count)
        self._out: dict[int, dict[int, list[Dependency]]] = {}
        self._writers: dict[int, set[int]] = defaultdict(set)  # of what a node read
        for node in self._nodes:
            targets: dict[int, list[Dependency]] = defaultdict(list)
            for dependency in graph.out[node]:
                if dependency.target in members:
                    targets[dependency.target].append(dependency)
                    if dependency.kind == "wr":
                        self._writers[dependency.target].add(node)
            self._out[node] = targets
        self._any = False

    def pairs(self) -> None:
        """Cycles of two: by dependencies, or by one and real time."""
        transactions = self._graph.transactions
        for node in self._nodes:
            for other, there in self._out[node].items():
                back = self._out[other].get(node, [])
                if node < other:
                    for step, answer in self._sharpest(node, there, other, back):
                        self._report([step, answer])
                if precedes(transactions[other], transactions[node]):
                    worst = min(there, key=lambda d: d.kind != "rw")
                    self._report([(node, worst), (other, Dependency(node, "rt"))])

    def _sharpest(
        self, node: int, there: list[Dependency], other: int, back: list[Dependency]
    ) -> Iterator[tuple[Step, Step]]:
        """For each name the two dependencies that show it; a pair can show several."""
        names = set()
        for step in there:
            for answer in back:
                steps: list[Step] = [(node, step), (other, answer)]
                name = self._name(steps)
                if name not in names:
                    names.add(name)
                    yield steps[0], steps[1]

    def readers(self) -> None:
        """Lookups that saw a later commit and missed an earlier one."""
        transactions = self._graph.transactions
        for reader in self._nodes:
            if transactions[reader].writes:
                continue
            for missed, there in self._out[reader].items():
                missing = next((d for d in there if d.kind == "rw"), None)
                if missing is None:
                    continue
                for writer in self._writers[reader]:
                    if writer == missed:
                        continue
                    between = self._out[missed].get(writer)
                    if between is None and precedes(transactions[missed], transactions[writer]):
                        between = [Dependency(writer, "rt")]
                    if between:
                        seen = next(d for d in self._out[writer][reader] if d.kind == "wr")
                        self._report([(reader, missing), (missed, between[0]), (writer, seen)])
                        break

    def searches(self) -> None:
        """The shortest cycles through some of the nodes, first without real time."""
        count = len(self._graph.transactions)
        for real_time in (False, True):
            if real_time and self._any:
                return
            tangles = components(self._graph, self._members, real_time=real_time)
            for tangle in tangles:
                nodes = sorted(node for node in tangle if node < count)
                inside = set(tangle)
                starts = nodes[:: max(1, len(nodes) // _SEARCHES)]
                for position, start in enumerate(starts):
                    limit = len(inside) if position == 0 else _SEARCH_NODES
                    steps = self._shortest(start, inside, limit, real_time)
                    if steps:
                        self._report(steps)

    def _shortest(self, start: int, inside: set[int], limit: int, real_time: bool) -> list[Step]:
        before: dict[int, int] = {}
        waiting = deque([start])
        while waiting and len(before) <= limit:
            node = waiting.popleft()
            for other in self._graph.next_of(node, real_time=real_time):
                if other == start:
                    return self._steps(start, node, before)
                if other in inside and other not in before:
                    before[other] = node
                    waiting.append(other)
        return []

    def _steps(self, start: int, last: int, before: dict[int, int]) -> list[Step]:
        nodes = [start]
        while last != start:
            nodes.append(last)
            last = before[last]
        nodes = [nodes[0], *reversed(nodes[1:])]
        real = [node for node in nodes if node < len(self._graph.transactions)]
        steps: list[Step] = []
        for node, other in zip(real, [*real[1:], real[0]], strict=True):
            direct = self._out[node].get(other, [Dependency(other, "rt")])
            steps.append((node, direct[0]))
        return steps

    def _name(self, steps: list[Step]) -> str:
        return _name_of(steps, self._graph)

    def _report(self, steps: list[Step]) -> None:
        self._any = True
        transactions = self._graph.transactions
        # Begin at the reader that was overtaken: so the steps read as a story.
        first = next((i for i, (_, d) in enumerate(steps) if d.kind == "rw"), 0)
        steps = steps[first:] + steps[:first]
        nodes = [transactions[node] for node, _ in steps]
        size = (
            len(nodes),
            sum(len(t.reads) + len(t.writes) for t in nodes),
            min(t.begin for t in nodes),
        )
        told = tuple(tell(transactions[node].id, transactions[d.target].id, d) for node, d in steps)
        ids = tuple(t.id for t in nodes)
        self._found.add(Anomaly(self._name(steps), ids, told), size)


def tell(source: Value, target: Value, dependency: Dependency) -> str:
    """One step of a cycle in words."""
    _, kind, edge, seen, written, flavour, _ = dependency
    shown = "nothing" if seen is None else f"{seen!r}"
    if kind == "rt":
        return f"{source} had ended before {target} began"
    if kind == "wr":
        return f"{target} saw {shown} of {edge}, written by {source}"
    if kind == "ww":
        return f"{target} wrote {written!r} to {edge} after {source} had written {shown}"
    how = {"parent": " under another parent", "sample": " beside it"}.get(flavour, "")
    return f"{source} saw {shown} of {edge}, not {written!r}, which {target} wrote{how}"


def _name_of(steps: list[Step], graph: Graph) -> str:
    kinds = [d.kind for _, d in steps]
    overtaken = [(node, d) for node, d in steps if d.kind == "rw"]
    if not overtaken:
        if "rt" in kinds:
            return "real_time_order"
        return "circular_read" if "wr" in kinds else "write_cycle"
    if len(steps) == 2 and "rt" not in kinds:
        return _name_of_two(steps, overtaken)
    (reader, _), *more = overtaken
    into = {d.target: d.kind for _, d in steps}
    alone = not graph.transactions[reader].writes
    if not more and alone and into[reader] == "wr":
        return "torn_path"
    if "rt" in kinds:
        return "stale_read"
    if more and all(
        not graph.transactions[node].writes and into[node] == "wr" for node, _ in overtaken
    ):
        return "long_fork"
    phantom = _phantom(d for _, d in overtaken)
    return phantom or ("write_skew" if more else "read_skew")


def _name_of_two(steps: list[Step], overtaken: list[Step]) -> str:
    (_, one), (_, two) = steps
    if len(overtaken) == 2:
        if one.edge == two.edge and not (one.flavour or two.flavour):
            return "lost_update"
        return _phantom([one, two]) or "write_skew"
    missing = one if one.kind == "rw" else two
    other = two if one.kind == "rw" else one
    if other.kind == "ww":
        plain = "lost_update" if missing.edge == other.edge else "read_skew"
        return _phantom([missing]) or plain
    if missing.edge != other.edge or missing.read == other.read:
        return "torn_batch"
    return _phantom([missing]) or "non_repeatable_read"


def _phantom(dependencies: Iterable[Dependency]) -> str | None:
    flavours = {d.flavour for d in dependencies}
    return next((name for flavour, name in _PHANTOMS.items() if flavour in flavours), None)

"""Who must come before whom: the direct serialization graph, and the order of real time."""

from __future__ import annotations

import itertools
from collections import defaultdict
from typing import TYPE_CHECKING, NamedTuple

from .versions import EdgeVersions, Span, Version, final_writes, stamp_of

if TYPE_CHECKING:
    from collections.abc import Collection, Iterable, Iterator, Sequence

    from .history import Read, Transaction, Value, Write


class Dependency(NamedTuple):
    """An edge of the graph, kept at its source.

    `kind`: `wr` the target read what the source wrote; `ww` the target replaced it; `rw` the target
    replaced what the source had read; `rt` the source had ended before the target began.
    `flavour` of `rw`: `parent`, `frame` or `sample` where it was no plain replacement.
    """

    target: int
    kind: str
    edge: str = ""
    seen: Value | None = None
    written: Value | None = None
    flavour: str = ""
    read: int = -1


def order_versions(
    transactions: Sequence[Transaction],
) -> tuple[dict[str, EdgeVersions], set[str]]:
    """Order the versions of each edge; also the edges whose order is only a guess."""
    guessed = set()
    ordered = {}
    for edge, given in versions_in_order(transactions).items():
        versions = list(given.versions)
        if _by_commit(versions, transactions):
            versions.sort(key=lambda v: transactions[v.writer].commit or 0)
        else:
            versions.sort(key=lambda v: (transactions[v.writer].end, v.writer))
            if not _forced(edge, versions, transactions):
                guessed.add(edge)
        ordered[edge] = EdgeVersions(versions)
    return ordered, guessed


def versions_in_order(transactions: Sequence[Transaction]) -> dict[str, EdgeVersions]:
    """Take the transactions to have written in the order in which they are given."""
    found: dict[str, list[Version]] = defaultdict(list)
    for number, one in enumerate(transactions):
        for write in final_writes(one):
            found[write.edge].append(Version(number, write))
    return {edge: EdgeVersions(versions) for edge, versions in found.items()}


def _by_commit(versions: list[Version], transactions: Sequence[Transaction]) -> bool:
    """Tell whether commit numbers order all writers: each has one, no two the same."""
    owners: dict[int, int] = {}
    for version in versions:
        commit = transactions[version.writer].commit
        if commit is None or owners.setdefault(commit, version.writer) != version.writer:
            return False
    return True


def _forced(edge: str, versions: list[Version], transactions: Sequence[Transaction]) -> bool:
    """Tell whether each version had to come after the one before it."""
    for old, new in itertools.pairwise(versions):
        if old.writer == new.writer:
            continue
        first, second = transactions[old.writer], transactions[new.writer]
        replaced = stamp_of(old.write) == stamp_of(new.write) and any(
            read.edge == edge and read.stamp is None and read.before == old.write.value
            for read in second.reads
        )
        if not (precedes(first, second) or replaced):
            return False
    return True


def precedes(first: Transaction, second: Transaction) -> bool:
    """Tell whether real time orders the two."""
    if first.end < second.begin:
        return True
    same = (first.process, first.thread) == (second.process, second.thread)
    return same and first.end == second.begin and first is not second and first.begin < first.end


def thread_order(
    transactions: Sequence[Transaction], by_begin: Iterable[int]
) -> Iterator[tuple[int, int]]:
    """Give each one with the one before it in its thread, where that had ended."""
    last_of: dict[tuple[int, int], int] = {}
    for node in by_begin:
        one = transactions[node]
        before = last_of.get((one.process, one.thread))
        if before is not None and precedes(transactions[before], one):
            yield before, node
        last_of[one.process, one.thread] = node


class Graph:
    """The dependencies among transactions, given the order of versions.

    `unsure` names the edges that somebody may have removed, which nobody can tell.
    `definite`: leave out what rests on a guess.
    """

    def __init__(
        self,
        transactions: Sequence[Transaction],
        versions: dict[str, EdgeVersions],
        guessed: set[str],
        unsure: Collection[str] = (),
        *,
        definite: bool = False,
    ) -> None:
        self.transactions = transactions
        self.out: list[list[Dependency]] = [[] for _ in transactions]
        self.guesses: bool = bool(guessed)
        self._versions = versions
        self._guessed = guessed
        self._unsure = unsure
        self._definite = definite
        for edge, of_edge in versions.items():
            self._add_replacements(edge, of_edge)
        for number, one in enumerate(transactions):
            for position, read in enumerate(one.reads):
                self._add_read(number, position, read)
        self.later: list[list[int]] = _real_time(transactions)

    def _add_replacements(self, edge: str, of_edge: EdgeVersions) -> None:
        if self._definite and edge in self._guessed:
            return
        versions = of_edge.versions
        for old, new in itertools.pairwise(versions):
            if old.writer != new.writer:
                dependency = Dependency(new.writer, "ww", edge, old.write.value, new.write.value)
                self.out[old.writer].append(dependency)

    def _add_read(self, reader: int, position: int, read: Read) -> None:
        of_edge = self._versions.get(read.edge)
        if of_edge is None:
            return
        ordered = not (self._definite and read.edge in self._guessed)
        for spans in of_edge.spans(read):
            if not spans:
                continue
            span, sure = spans[0], True
            if len(spans) > 1 or read.edge in self._unsure:
                span, sure = self._choose(reader, read, of_edge, spans)
            self.guesses |= not sure
            # Whose removal a read of nothing saw rests on the order, too.
            known = sure and (ordered or of_edge.is_value(span.after))
            if known or not self._definite:
                self._add_span(reader, position, read, of_edge.versions, span, ordered)

    def _add_span(
        self,
        reader: int,
        position: int,
        read: Read,
        versions: Sequence[Version],
        span: Span,
        ordered: bool,
    ) -> None:
        seen = versions[span.after].write if span.after >= 0 else None
        if seen is not None and versions[span.after].writer != reader:
            self.out[versions[span.after].writer].append(
                Dependency(reader, "wr", read.edge, seen.value, seen.value, "", position)
            )
        if not ordered:
            return
        for index in (span.before, span.broken):
            if index is not None and versions[index].writer != reader:
                write = versions[index].write
                value = None if seen is None or seen.remove else seen.value
                flavour = _flavour(read, seen, write)
                self.out[reader].append(
                    Dependency(
                        versions[index].writer,
                        "rw",
                        read.edge,
                        value,
                        write.value,
                        flavour,
                        position,
                    )
                )

    def _choose(
        self, reader: int, read: Read, of_edge: EdgeVersions, spans: list[Span]
    ) -> tuple[Span, bool]:
        """Say which span a read belongs to, and whether no other is possible."""
        one = self.transactions[reader]
        if of_edge.is_value(spans[0].after):
            return spans[0], True
        foreign = []
        possible = []
        for span in spans:
            first = None if span.after < 0 else self._writer(of_edge, span.after)
            last = None if span.before is None else self._writer(of_edge, span.before)
            if first is one:
                if of_edge.versions[span.after].write in one.writes[: read.own]:
                    return span, True
                continue
            foreign.append(span)
            early = first is not None and precedes(one, first)
            late = last is not None and last is not one and precedes(last, one)
            if not early and not late:
                possible.append(span)
        if len(possible) <= 1:
            return (possible or foreign)[-1], read.edge not in self._unsure
        if one.as_of is not None:
            for span in reversed(possible):
                first = None if span.after < 0 else self._writer(of_edge, span.after)
                if first is None or (first.commit is not None and first.commit <= one.as_of):
                    return span, False
        return possible[-1], False

    def _writer(self, of_edge: EdgeVersions, index: int) -> Transaction:
        return self.transactions[of_edge.versions[index].writer]

    def tangled(self) -> set[int]:
        """Every node that cannot be put in order: empty if the graph has no cycle."""
        count = len(self.transactions)
        incoming = [0] * len(self.later)
        for later in self.later:
            for node in later:
                incoming[node] += 1
        for dependencies in self.out:
            for dependency in dependencies:
                incoming[dependency.target] += 1
        ready = [node for node, number in enumerate(incoming) if number == 0]
        done = 0
        while ready:
            node = ready.pop()
            done += 1
            for other in self.later[node]:
                incoming[other] -= 1
                if incoming[other] == 0:
                    ready.append(other)
            if node < count:
                for dependency in self.out[node]:
                    other = dependency.target
                    incoming[other] -= 1
                    if incoming[other] == 0:
                        ready.append(other)
        if done == len(incoming):
            return set()
        return {node for node, number in enumerate(incoming) if number > 0}

    def next_of(self, node: int, *, real_time: bool) -> Iterable[int]:
        """The nodes right after one."""
        if node < len(self.transactions):
            yield from (dependency.target for dependency in self.out[node])
        if real_time:
            yield from self.later[node]


def _flavour(read: Read, seen: Write | None, write: Write) -> str:
    if write.remove or (read.stamp is None and (seen is None or seen.remove)):
        return "frame"
    if seen is None or seen.remove:
        return "sample"
    if seen.parent is not None and write.parent is not None and seen.parent != write.parent:
        return "parent"
    return "sample" if read.stamp is not None and seen.stamp != write.stamp else ""


def _real_time(transactions: Sequence[Transaction]) -> list[list[int]]:
    """Edges of real time, through nodes of their own so that there are few: after each pause.

    The first nodes are the transactions.
    """
    count = len(transactions)
    later: list[list[int]] = [[] for _ in range(count)]
    by_begin = sorted(range(count), key=lambda t: transactions[t].begin)
    by_end = sorted(range(count), key=lambda t: transactions[t].end)
    ended = 0
    barrier = -1
    for node in by_begin:
        begin = transactions[node].begin
        fresh = ended
        while ended < count and transactions[by_end[ended]].end < begin:
            ended += 1
        if ended > fresh:
            later.append([])
            if barrier >= 0:
                later[barrier].append(len(later) - 1)
            barrier = len(later) - 1
            for other in by_end[fresh:ended]:
                later[other].append(barrier)
        if barrier >= 0:
            later[barrier].append(node)
    for before, node in thread_order(transactions, by_begin):
        later[before].append(node)
    return later


def components(graph: Graph, nodes: set[int], *, real_time: bool) -> list[list[int]]:
    """Tarjan's strongly connected components of two or more nodes, without recursion."""
    order: dict[int, int] = {}
    low: dict[int, int] = {}
    on_stack: set[int] = set()
    stack: list[int] = []
    found: list[list[int]] = []
    for root in nodes:
        if root in order:
            continue
        work = [(root, iter(list(graph.next_of(root, real_time=real_time))))]
        order[root] = low[root] = len(order)
        stack.append(root)
        on_stack.add(root)
        while work:
            node, rest = work[-1]
            for other in rest:
                if other not in nodes:
                    continue
                if other not in order:
                    order[other] = low[other] = len(order)
                    stack.append(other)
                    on_stack.add(other)
                    work.append((other, iter(list(graph.next_of(other, real_time=real_time)))))
                    break
                if other in on_stack:
                    low[node] = min(low[node], order[other])
            else:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[node])
                if low[node] == order[node]:
                    found.append(_pop_component(stack, on_stack, node))
    return [component for component in found if len(component) > 1]


def _pop_component(stack: list[int], on_stack: set[int], root: int) -> list[int]:
    component: list[int] = []
    while not component or component[-1] != root:
        component.append(stack.pop())
        on_stack.discard(component[-1])
    return component

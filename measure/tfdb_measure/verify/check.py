"""The verdict on a history."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

from tfdb.data.argument_checks import refuse_without

from .anomalies import Anomaly, Found, find_cycles
from .graph import Graph, order_versions, versions_in_order
from .history import UNSEEN, History, Read, Transaction, Unseen, Value, Write
from .search import Search
from .versions import final_writes, stamp_of

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

STEPS = 500_000


@dataclass
class Verdict:
    """What became of a history.

    `serializable`: True, False, or None: could not be decided, `undecided` then says why.
    """

    serializable: bool | None
    anomalies: list[Anomaly] = field(default_factory=list)
    undecided: str | None = None
    counts: dict[str, int] = field(default_factory=dict)

    @property
    def names(self) -> set[str]:
        """The names of the anomalies."""
        return {anomaly.name for anomaly in self.anomalies}


def check(history: History, *, steps: int = STEPS) -> Verdict:
    """Decide whether some order of the committed transactions explains all that they read.

    The order has to respect real time: who had ended before another began comes first. Where the
    history gives the order of writes (commit numbers, or no two writers of an edge at once), the
    answer is certain and quick; else an order is searched for, trying `steps` transactions.
    """
    refuse_without(history, "history", "a History", "transactions", "path")
    judged, found = _direct(history)
    counts = _counts(history.transactions)
    maybe = _unattributed(history, judged)
    unsure = {write.edge for one in maybe for write in one.writes if write.remove}
    versions, guessed = order_versions(judged)
    graph = Graph(judged, versions, guessed, unsure)
    tangled = graph.tangled()
    if not tangled:
        return Verdict(serializable=not found, anomalies=found.all(), counts=counts)
    if not graph.guesses:
        find_cycles(graph, tangled, found)
        return Verdict(serializable=False, anomalies=found.all(), counts=counts)
    sure = Graph(judged, versions, guessed, unsure, definite=True)
    certain = sure.tangled()
    if certain:
        find_cycles(sure, certain, found)
    if found:
        return Verdict(serializable=False, anomalies=found.all(), counts=counts)
    search = Search([*judged, *maybe], steps, len(maybe)).run()
    if search.order is not None:
        return Verdict(serializable=True, counts=counts)
    if search.exhausted:
        _name_the_knot(judged, search, found)
        return Verdict(serializable=False, anomalies=found.all(), counts=counts)
    reason = (
        f"the order of writes to {', '.join(sorted(guessed)[:3]) or 'removed frames'} is not "
        f"recorded, and {steps:,} steps found none that explains the reads"
    )
    return Verdict(serializable=None, undecided=reason, counts=counts)


def _unattributed(history: History, judged: list[Transaction]) -> list[Transaction]:
    """Who may have committed unnoticed, if a removal among them may explain reads of nothing."""
    known = {id(one) for one in judged}
    rest = [t for t in history.transactions if t.status == "unknown" and id(t) not in known]
    return rest if any(write.remove for one in rest for write in one.writes) else []


def _name_the_knot(judged: list[Transaction], search: Search, found: Found) -> None:
    """Name what nothing explains: the transactions around the place where the search got stuck."""
    placed = [node for node in search.deepest if node < len(judged)]
    stuck = [node for node in search.stuck if node < len(judged)]
    part = [judged[node] for node in (*placed, *stuck)]
    versions = versions_in_order(part)
    graph = Graph(part, versions, set())
    tangled = graph.tangled()
    if tangled:
        find_cycles(graph, tangled, found)
    if not found:
        ids = tuple(judged[node].id for node in stuck)
        told = tuple(f"{name} cannot be next, whatever the order before it" for name in ids)
        found.add(Anomaly("not_serializable", ids, told), (len(ids),))


def _counts(transactions: Sequence[Transaction]) -> dict[str, int]:
    statuses = Counter(t.status for t in transactions)
    return {
        "transactions": len(transactions),
        **{status: statuses[status] for status in ("committed", "aborted", "unknown")},
        "reads": sum(len(t.reads) for t in transactions),
        "writes": sum(len(t.writes) for t in transactions),
    }


class _Origin(NamedTuple):
    writer: Transaction
    write: Write
    final: bool


def _direct(history: History) -> tuple[list[Transaction], Found]:
    """Find what single reads show, and who counts: the committed, and whose writes were seen."""
    origins: dict[Value, _Origin] = {}
    for one in history.transactions:
        last = {write.value for write in final_writes(one)} if len(one.writes) > 1 else None
        for write in one.writes:
            origins[write.value] = _Origin(one, write, last is None or write.value in last)
    found = Found()
    judged = [t for t in history.transactions if t.status == "committed"]
    included = {id(t) for t in judged}
    for one in judged:  # grows meanwhile
        for read in one.reads:
            for value, name, told in _judge(one, read, origins):
                size = (2, len(one.reads) + len(one.writes), one.begin)
                if name is not None:
                    origin = origins.get(value)
                    ids = (one.id,) if origin is None else (one.id, origin.writer.id)
                    found.add(Anomaly(name, ids, (told,)), size)
                    continue
                writer = origins[value].writer
                if id(writer) not in included:
                    included.add(id(writer))
                    judged.append(writer)
            if read.own and _missed_own(one, read, origins):
                told = f"{one.id} saw {_shown(read)} of {read.edge}, not what it had written"
                size = (1, len(one.reads), one.begin)
                found.add(Anomaly("own_write_missed", (one.id,), (told,)), size)
    return judged, found


def _judge(
    one: Transaction, read: Read, origins: dict[Value, _Origin]
) -> Iterator[tuple[Value, str | None, str]]:
    """For each value seen what is wrong with it, None if nothing by itself."""
    for value, is_after in ((read.before, False), (read.after, True)):
        if value is None or isinstance(value, Unseen):
            continue
        told = f"{one.id} saw {value!r} of {read.edge}"
        origin = origins.get(value)
        if origin is None:
            yield value, "garbage_read", f"{told}, which no transaction wrote"
            continue
        writer, write, final = origin
        if write.edge != read.edge or write.remove:
            yield value, "garbage_read", f"{told}, which {writer.id} did not write there"
        elif read.stamp is not None and not _on_side(stamp_of(write), read.stamp, is_after):
            yield value, "garbage_read", f"{told} at {read.stamp}, stored at {write.stamp}"
        elif writer is one and write not in one.writes[: read.own]:
            yield value, "garbage_read", f"{told} before it had written it"
        elif writer.status == "aborted":
            yield value, "dirty_read", f"{told}, written by {writer.id}, which was aborted"
        elif not final and writer is not one:
            yield value, "dirty_read", f"{told}, which {writer.id} itself replaced"
        else:
            yield value, None, told


def _on_side(stored: int, asked: int, is_after: bool) -> bool:
    return stored >= asked if is_after else stored <= asked


def _shown(read: Read) -> str:
    seen = read.before if read.before is not UNSEEN else read.after
    return "nothing" if seen is None else repr(seen)


def _missed_own(one: Transaction, read: Read, origins: dict[Value, _Origin]) -> bool:
    """Tell whether the read disagrees with the transaction's own writes before it."""
    own: dict[int, Value] = {}
    removed = False
    for write in one.writes[: read.own]:
        if write.edge != read.edge:
            continue
        if write.remove:
            own.clear()
            removed = True
        else:
            own[stamp_of(write)] = write.value
    if not own and not removed:
        return False
    sides = [(read.before, True, read.stamp)]
    if read.stamp is not None:
        sides.append((read.after, False, read.stamp))
    for seen, backward, asked in sides:
        if isinstance(seen, Unseen):
            continue
        fitting = [stamp for stamp in own if asked is None or _on_side(stamp, asked, not backward)]
        nearest = (max if backward else min)(fitting, default=None)
        if seen is None or seen not in origins:
            if seen is None and nearest is not None:
                return True
        elif origins[seen].writer is one:
            if nearest is None or own[nearest] != seen:
                return True
        elif removed:
            return True
        elif nearest is not None:
            stored = stamp_of(origins[seen].write)
            if nearest >= stored if backward else nearest <= stored:
                return True
    return False

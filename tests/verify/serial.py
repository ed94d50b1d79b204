"""Histories that are serializable by construction, and the judge that tries every order.

Nothing here is shared with the checker but the records: the store below is a second one.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from tfdb_measure.verify import Read, Transaction, Unseen, Write

if TYPE_CHECKING:
    import random

UNSEEN = Unseen.UNSEEN


class NaiveStore:
    """Samples by edge and stamp; a static edge has one sample, at no stamp."""

    def __init__(self) -> None:
        self.samples: dict[str, dict[int, Any]] = {}

    def run(self, one: Transaction) -> list[Read]:
        """Carry the transaction out; return its reads with what they see."""
        reads = []
        for position in range(len(one.writes) + 1):
            reads += [self.see(read) for read in one.reads if read.own == position]
            if position < len(one.writes):
                self.write(one.writes[position])
        return reads

    def write(self, write: Write) -> None:
        samples = self.samples.setdefault(write.edge, {})
        if write.remove:
            samples.clear()
        else:
            samples[-1 if write.stamp is None else write.stamp] = write.value

    def see(self, read: Read) -> Read:
        samples = self.samples.get(read.edge, {})
        if read.stamp is None:
            return read._replace(before=samples[max(samples)] if samples else None)
        past = [stamp for stamp in samples if stamp <= read.stamp]
        future = [stamp for stamp in samples if stamp >= read.stamp]
        seen = read
        if read.before is not UNSEEN:
            seen = seen._replace(before=samples[max(past)] if past else None)
        if read.after is not UNSEEN:
            seen = seen._replace(after=samples[min(future)] if future else None)
        return seen


def explained(order: tuple[Transaction, ...]) -> bool:
    """Does this order explain every read?"""
    store = NaiveStore()
    return all(sorted(store.run(one), key=repr) == sorted(one.reads, key=repr) for one in order)


def in_time(order: tuple[Transaction, ...]) -> bool:
    """Does it respect real time, the threads, and the commit numbers of each edge?"""
    for i, late in enumerate(order):
        for early in order[:i]:
            if late.end < early.begin:
                return False
            same = (late.process, late.thread) == (early.process, early.thread)
            if same and (late.begin, late.end) < (early.begin, early.end):
                return False
            shared = {w.edge for w in late.writes} & {w.edge for w in early.writes}
            numbered = late.commit is not None and early.commit is not None
            if shared and numbered and late.commit < early.commit:
                return False
    return True


def any_order(transactions: list[Transaction]) -> bool:
    """Try every order of what committed, with or without what may have."""
    sure = [t for t in transactions if t.status == "committed"]
    maybe = [t for t in transactions if t.status == "unknown"]
    for count in range(len(maybe) + 1):
        for some in itertools.combinations(maybe, count):
            for order in itertools.permutations([*sure, *some]):
                if in_time(order) and explained(order):
                    return True
    return False


@dataclass
class Shape:
    """What a random history is made of."""

    transactions: int
    threads: int = 3
    edges: int = 3
    reads: int = 3
    writes: int = 2
    stamps: int | None = None  # None: static edges
    removals: float = 0.0
    at: float = 0.0
    own: float = 0.0
    commits: bool = True


def random_history(rng: random.Random, shape: Shape) -> list[Transaction]:
    """Threads whose transactions happen at one moment between their begin and end."""
    store = NaiveStore()
    values = itertools.count(1)
    clock = itertools.count(1)
    commits = itertools.count(1)
    done: list[Transaction] = []
    state: list[tuple[int, Transaction | None]] = [(0, None)] * shape.threads
    while len(done) < shape.transactions or any(phase for phase, _ in state):
        thread = rng.randrange(shape.threads)
        phase, one = state[thread]
        if one is None:
            if len(done) + sum(busy > 0 for busy, _ in state) >= shape.transactions:
                continue
            started = _plan(rng, shape, values, thread)
            state[thread] = (1, replace(started, begin=next(clock)))
        elif phase == 1:
            number = next(commits) if one.writes and shape.commits else None
            reads = tuple(store.run(one))
            state[thread] = (2, replace(one, reads=reads, commit=number))
        else:
            done.append(replace(one, id=len(done) + 1, end=next(clock)))
            state[thread] = (0, None)
    return done


def _plan(rng: random.Random, shape: Shape, values: Any, thread: int) -> Transaction:
    edges = [f"e{i}" for i in range(shape.edges)]
    writes = []
    for _ in range(rng.randint(0, shape.writes)):
        stamp = None if shape.stamps is None else rng.randrange(shape.stamps)
        gone = rng.random() < shape.removals
        writes.append(Write(rng.choice(edges), next(values), None if gone else stamp, None, gone))
    reads = []
    for _ in range(rng.randint(0 if writes else 1, shape.reads)):
        own = rng.randint(0, len(writes)) if rng.random() < shape.own else 0
        edge = rng.choice(edges)
        if shape.stamps is not None and rng.random() < shape.at:
            sides = rng.choice([(None, None), (None, UNSEEN), (UNSEEN, None)])
            reads.append(Read(edge, rng.randrange(shape.stamps), *sides, own))
        else:
            reads.append(Read(edge, None, None, UNSEEN, own))
    return Transaction(0, 0, 0, tuple(reads), tuple(writes), thread=thread)


def corrupt(rng: random.Random, transactions: list[Transaction]) -> list[Transaction] | None:
    """One read that saw another value of its edge, or nothing; None: no read is left."""
    seen = [
        (i, j, side)
        for i, one in enumerate(transactions)
        for j, read in enumerate(one.reads)
        for side in ("before", "after")
        if getattr(read, side) is not UNSEEN
    ]
    if not seen:
        return None
    i, j, side = rng.choice(seen)
    read = transactions[i].reads[j]
    others = [w.value for t in transactions for w in t.writes if w.edge == read.edge]
    choices: list[Any] = [v for v in [*others, None] if v != getattr(read, side)]
    if not choices:
        return None
    reads = list(transactions[i].reads)
    reads[j] = read._replace(**{side: rng.choice(choices)})
    spoiled = list(transactions)
    spoiled[i] = replace(transactions[i], reads=tuple(reads))
    return spoiled

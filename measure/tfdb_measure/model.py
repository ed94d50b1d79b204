"""What more cores would bring: a prediction from points of one and two threads.

No machine with many cores took part. The model knows three ways in which threads hinder each other
and takes every cost from measurements of one and two threads (sweeps ``readers`` and ``threads``):

*one at a time* (``giant``, ``tf2``): every operation holds one lock from its start to its end.
Two threads already keep the lock busy, hand-offs included, so more threads bring nothing:

    X(N) = X(2)                                  for N >= 2

*lines move* (``fine``, the three ``2pl``): a lookup of L edges takes and releases L frame locks,
and so writes L cache lines that other threads write too. With N threads on the same frames, the
last to write such a line was another thread with probability (N - 1) / N; then it must be fetched:

    t(N) = t(1) + L c (N - 1) / N,   X(N) = N / t(N),   c = 2 (t(2) - t(1)) / L

*nothing moves* (``snapshot``, ``silo``): a lookup writes no line that another thread touches. What
two threads lose all the same (memory, caches, the machine's neighbours) is taken for a share s
that cannot go in parallel, as Amdahl's law has it:

    X(N) = N X(1) / (1 + s (N - 1)),   s = 2 X(1) / X(2) - 1, at least 0

Half reading, half writing, N even: an engine of the first kind does the same sum of operations
whatever N; `snapshot` has N / 2 times the lookups of one reader beside one writer, and the writes
of one writer, as commits take turns; for the others N / 2 times both.

Limits: threads have a core each; one socket, where a line costs the same from everywhere; no bound
by memory; no conflicts beyond those of two threads. A mutex with many waiters gets slower, not
faster (the thesis: 0.063 M/s with 14 threads, 0.048 with 112), so what is predicted for `giant`
and `tf2` is too high, and the others' lead over them too small. `silo` retries more the more
writers there are, so its half-and-half prediction is too high as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from .results import Results

Kind = Literal["one at a time", "lines move", "nothing moves"]

KINDS: dict[str, Kind] = {
    "snapshot": "nothing moves",
    "giant": "one at a time",
    "fine": "lines move",
    "2pl-no-wait": "lines move",
    "2pl-wait-die": "lines move",
    "2pl-wound-wait": "lines move",
    "silo": "nothing moves",
    "tf2": "one at a time",
}
THREADS = tuple(range(1, 17))


@dataclass(frozen=True)
class Costs:
    """What was measured of one engine, in operations per second, and what follows from it."""

    engine: str
    alone: float  # lookups of one thread
    pair: float  # lookups of two threads together
    edges: float  # of a lookup
    beside_reads: float | None = None  # lookups of one reader beside one writer
    beside_writes: float | None = None  # writes of that writer

    @property
    def kind(self) -> Kind:
        """How threads hinder each other."""
        return KINDS[self.engine]

    @property
    def line_ns(self) -> float:
        """What it costs to fetch a line that another core has written, in nanoseconds."""
        return max(0.0, 2e9 * (2.0 / self.pair - 1.0 / self.alone) / self.edges)

    @property
    def serial_share(self) -> float:
        """The share of the work that two threads cannot do at once."""
        return max(0.0, 2.0 * self.alone / self.pair - 1.0)

    def reads(self, threads: int) -> float:
        """Predict the lookups per second of so many threads that all read."""
        if threads == 1:
            return self.alone
        if self.kind == "one at a time":
            return self.pair
        if self.kind == "lines move":
            moved = self.edges * self.line_ns * (threads - 1) / threads
            return threads / (1.0 / self.alone + 1e-9 * moved)
        return threads * self.alone / (1.0 + self.serial_share * (threads - 1))

    def half_and_half(self, threads: int) -> tuple[float, float] | None:
        """Predict lookups and writes per second of so many threads, half of which write."""
        if self.beside_reads is None or self.beside_writes is None:
            return None
        pairs = threads / 2
        if self.kind == "one at a time":
            return self.beside_reads, self.beside_writes
        if self.engine == "snapshot":
            return pairs * self.beside_reads, self.beside_writes
        return pairs * self.beside_reads, pairs * self.beside_writes

    def parameter(self) -> str:
        """Name the one parameter that the engine's kind has, with its value."""
        if self.kind == "one at a time":
            return f"X(2) = {self.pair / 1e6:.3g} M/s"
        if self.kind == "lines move":
            return f"c = {self.line_ns:.3g} ns a line"
        return f"s = {self.serial_share:.3g}"


def costs(results: Results) -> list[Costs]:
    """Take the costs from the sweeps; engines without both points are left out."""
    found = []
    for engine in results.engines("readers"):
        alone = results.median("readers", "1", engine, "reads_per_s")
        pair = results.median("readers", "2", engine, "reads_per_s")
        edges = results.median("readers", "1", engine, "edges_per_read")
        if alone and pair and edges:
            beside = [
                results.median("threads", "2", engine, column)
                for column in ("reads_per_s", "writes_per_s")
            ]
            found.append(Costs(engine, alone, pair, edges, *beside))
    return found

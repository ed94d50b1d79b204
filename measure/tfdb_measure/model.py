"""What more cores would bring: a prediction from points of one and two threads.

No machine with many cores was available. The model has three kinds of engines. All costs come from
measurements with one and two threads (sweeps ``readers`` and ``threads``):

*one at a time* (``giant``, ``tf2``): every operation holds one lock from its start to its end.
Two threads already keep the lock busy, so more threads add nothing:

    X(N) = X(2)                                  for N >= 2

*lock words move* (``fine``, the three ``2pl``): a lookup of L edges takes and releases L frame
locks, so it writes L cache lines that other threads also write. With N threads on the same frames,
another thread wrote such a line last with probability (N - 1) / N. The line must then be loaded:

    t(N) = t(1) + L c (N - 1) / N,   X(N) = N / t(N),   c = 2 (t(2) - t(1)) / L

*no shared writes* (``snapshot``, ``silo``): a lookup writes no line that another thread uses. The
loss of two threads (memory, caches, other programs) counts as a serial share s, as in Amdahl's law:

    X(N) = N X(1) / (1 + s (N - 1)),   s = 2 X(1) / X(2) - 1, at least 0

With half of the operations writing, and N even, the first kind does the same number of operations
for any N. `snapshot` has N / 2 times the lookups of one reader beside one writer, and the writes of
one writer, because commits take turns. The others have N / 2 times both.

Limits: the model assumes one core per thread, one socket with equal costs of all lines, enough
memory bandwidth, and no more conflicts than between two threads. A mutex with many waiting threads
gets slower (the thesis: 0.063 M/s with 14 threads, 0.048 with 112). So the predictions for `giant`
and `tf2` are too high, and the ratios to them too small. `silo` retries more often with more
writers, so its prediction with half writing is also too high.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from .results import Results

Kind = Literal["one at a time", "lock words move", "no shared writes"]

KINDS: dict[str, Kind] = {
    "snapshot": "no shared writes",
    "giant": "one at a time",
    "fine": "lock words move",
    "2pl-no-wait": "lock words move",
    "2pl-wait-die": "lock words move",
    "2pl-wound-wait": "lock words move",
    "silo": "no shared writes",
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
        if self.kind == "lock words move":
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
        if self.kind == "lock words move":
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

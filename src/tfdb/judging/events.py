"""Kinds of events, and the class Event: an expectation is broken, or met again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from tfdb.data.decimal_time import NS_PER_SECOND
from tfdb.data.lazy_names import belong_to
from tfdb.data.time_text import format_duration, format_when

ANOTHER_CLOCK = 3600 * NS_PER_SECOND
"""A stamp that is further than this from its arrival comes from another clock."""
TIMELY = 10 * NS_PER_SECOND
"""If even the nearest stamp is further than this from its arrival, all stamps come from another
clock.
"""

Severity: TypeAlias = Literal["ok", "warning", "error", "stale"]

# kind -> (severity, meaning), in the order of tables. The documentation lists the same.
EVENT_KINDS: dict[str, tuple[Severity, str]] = {
    "two-clocks": ("error", "stamps of another clock than the arrivals"),
    "time-jump": ("error", "stamps that jump relative to the time of arrival"),
    "missing": ("error", "an expected edge without any sample"),
    "lifespan": ("stale", "an edge whose newest stamp is too old"),
    "liveliness": ("error", "an authority that stopped writing"),
    "foreign-authority": ("error", "an authority that may not write the edge"),
    "deadline": ("warning", "an edge without a new sample for too long"),
    "step": ("error", "a sample too far from the one before"),
    "speed": ("error", "a sample that implies too high a speed"),
    "turn": ("error", "a sample rotated too far from the one before"),
    "failover": ("warning", "an authority that replaces a stronger one"),
    "late": ("warning", "a sample too far behind the newest stamp of its edge"),
}
CLOCKS = ("two-clocks", "time-jump")
"""The kinds that concern all edges."""
BROKEN: tuple[Severity, ...] = ("error", "stale")
"""The severities that make `tfdb watch` exit with 1."""
_RANKS: dict[str, int] = {"stale": 0, "error": 1, "warning": 2, "ok": 3}
_UNITS = {"step": "m", "speed": "m/s", "turn": "rad"}


@dataclass(frozen=True, slots=True)
class Event:
    """An event: an expectation is broken from now on, or met again. Times are nanoseconds.

    An expectation that stays broken is one event. Samples that break a limit within a second are
    one event.
    """

    kind: str
    """One of `deadline`, `lifespan`, ...: docs/howto/expectations.md lists all."""
    severity: Severity
    """As in diagnostic_msgs; `ok` if the expectation is met again."""
    begins: bool
    """True: the expectation is broken from now on. False: it is met again."""
    time: int
    """Time of the begin or end, by the clock of the arrivals."""
    since: int
    """Time of the begin."""
    parent: str = ""
    """Parent of the edge; for `two-clocks` and `time-jump` of the first edge; for `liveliness`
    empty.
    """
    child: str = ""
    """Child of that edge."""
    authority: str = ""
    """The silent authority, or the writer of the sample that broke the limit; empty if unknown."""
    value: float | None = None
    """The worst value since it began, in seconds, metres or radians."""
    limit: float | None = None
    """The limit, in the same unit."""
    count: int = 1
    """Number of missed deadlines or of samples over the limit so far."""
    commit: int | None = None
    """In a store, the commit of the sample that began or ended the event."""

    @property
    def subject(self) -> str:
        """The edge, the authority, or `clock`."""
        if self.kind in CLOCKS:
            return "clock"
        return f"{self.parent} -> {self.child}" if self.child else self.authority

    @property
    def rank(self) -> tuple[int, int, int]:
        """Sorts the worst first, then by kind and time."""
        return _RANKS[self.severity], list(EVENT_KINDS).index(self.kind), self.since

    def __str__(self) -> str:
        """Describe the event in one line."""
        what = f"{self.kind} {self.measured}".rstrip()
        by = ""
        if self.kind in CLOCKS and self.child:
            by = f", first on {self.parent} -> {self.child}"
        by += f" by {self.authority}" if self.child and self.authority else ""
        if self.begins:
            return f"{format_when(self.time)} {self.severity}: {self.subject}: {what}{by}"
        after = format_duration(self.time - self.since)
        return f"{format_when(self.time)} ok: {self.subject}: {what}{by}, ended after {after}"

    @property
    def measured(self) -> str:
        """The value and the limit as text; empty without a value."""
        if self.value is None or self.limit is None:
            return ""
        return f"{self._text(self.value)} (limit {self._text(self.limit)})"

    def _text(self, value: float) -> str:
        unit = _UNITS.get(self.kind)
        return f"{value:.4g} {unit}" if unit else format_duration(round(value * 1e9))


belong_to("tfdb.judging", globals(), ("Event",))

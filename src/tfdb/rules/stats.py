"""Counts of a rule, and of all rules of a buffer."""

from __future__ import annotations

from dataclasses import dataclass, field

from tfdb.data.lazy_names import belong_to

__all__ = ["RuleStats"]


@dataclass(slots=True)
class RuleStats:
    """Counts of a rule since its installation. Those of `Buffer.rules` are of all rules so far."""

    scheduled: int = 0
    """Events that were passed to an action."""
    invoked: int = 0
    """Actions that began, retries included."""
    pending: int = 0
    """Events whose action has not begun."""
    dropped: int = 0
    """Events that were dropped: by `max_pending`, by `max_depth`, or because the rule ended."""
    merged: int = 0
    """Events that a later one replaced, by `debounce` or `max_rate`."""
    abandoned: int = 0
    """Actions whose last retry also had a conflict."""
    retried: int = 0
    """Actions that ran again after a Conflict."""
    exceptions: int = 0
    """Conditions and actions that raised."""
    unseen: int = 0
    """Commits that were not evaluated."""
    latency_mean: float = 0.0
    """Mean of the seconds from reading the commit to the begin of the action."""
    latency_max: float = 0.0
    execution_mean: float = 0.0
    """Mean duration of an action in seconds, including retries."""
    execution_max: float = 0.0
    begun: int = field(default=0, repr=False)
    """Events whose action has begun."""
    ended: int = field(default=0, repr=False)
    """Events whose action has ended."""

    def began(self, latency: float) -> None:
        """Count the first attempt of an action."""
        self.pending -= 1
        self.begun += 1
        self.latency_mean += (latency - self.latency_mean) / self.begun
        self.latency_max = max(self.latency_max, latency)

    def ended_after(self, seconds: float) -> None:
        """Count the end of an action."""
        self.ended += 1
        self.execution_mean += (seconds - self.execution_mean) / self.ended
        self.execution_max = max(self.execution_max, seconds)


belong_to("tfdb.rules", globals(), __all__)

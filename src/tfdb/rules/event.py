"""The argument of an action."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tfdb.data.lazy_names import belong_to

if TYPE_CHECKING:
    from tfdb._core import Snapshot, Transform
    from tfdb.data.types import Changes

    from .rule import Rule

__all__ = ["Event"]


@dataclass(slots=True, eq=False)
class Event:
    """One firing of a rule, for its action."""

    rule: Rule
    """The rule."""
    on: str | tuple[str, str]
    """The frame or the pair (target, source) that the commit touched; `"*"` for any commit."""
    commit: int
    """The commit that fired it."""
    transform: Transform | None
    """The pair's transform in the state of that commit; None: it has none, or the rule is on a
    frame.
    """
    before: Transform | None
    """The pair's transform at the previous evaluation."""
    changes: Changes | None
    """The changes of the frame, or for `"*"` of all frames; None for a pair, or after skipped
    commits.
    """
    snapshot: Snapshot
    """The state of the commit, until the action returns."""
    scheduled: int
    """The time at which the event was scheduled, by `time.monotonic_ns`."""
    chain: tuple[str, ...] = ()
    """Names of the rules whose commits led to this event, the first one first."""
    merged: int = 0
    """Number of earlier events that this one replaced, by `debounce` or `max_rate`."""
    unseen: int = 0
    """Number of commits before this one that were not evaluated, because they left the feed."""
    _due: float = field(default=0.0, repr=False)  # of time.monotonic

    @property
    def depth(self) -> int:
        """Number of rules whose commits led to this event."""
        return len(self.chain)


belong_to("tfdb.rules", globals(), __all__)

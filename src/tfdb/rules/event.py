"""What an action gets."""

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
    """The answer for the pair in that commit's state; None: it has none, or a frame fired it."""
    before: Transform | None
    """The answer at the evaluation before."""
    changes: Changes | None
    """What the commit did to a frame, or for `"*"`; None for a pair, or if commits are unseen."""
    snapshot: Snapshot
    """The state of the commit, until the action returns."""
    scheduled: int
    """When it was scheduled: nanoseconds of `time.monotonic_ns`."""
    chain: tuple[str, ...] = ()
    """Names of the rules whose commits led to this one, the first cause first."""
    merged: int = 0
    """How many earlier events of the rule it replaced: `debounce` or `max_rate`."""
    unseen: int = 0
    """How many commits before this one were not evaluated: the evaluation had fallen behind."""
    _due: float = field(default=0.0, repr=False)  # of time.monotonic
    _dropped: bool = field(default=False, repr=False)

    @property
    def depth(self) -> int:
        """How many rules' commits led to this one."""
        return len(self.chain)


belong_to("tfdb.rules", globals(), __all__)

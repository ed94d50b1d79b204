"""Rules: functions that a buffer calls when commits make a condition true."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.lazy_names import on_demand as _offer

if TYPE_CHECKING:
    from .event import Event
    from .rule import Rule, RuleOptions
    from .rules import Rules
    from .stats import RuleStats

__all__ = ["Event", "Rule", "RuleOptions", "RuleStats", "Rules"]

if not TYPE_CHECKING:  # type checkers would find every name in a module with `__getattr__`
    __getattr__, __dir__ = _offer(
        __name__,
        {
            "event": ("Event",),
            "rule": ("Rule", "RuleOptions"),
            "rules": ("Rules",),
            "stats": ("RuleStats",),
        },
    )

"""Judgement of recordings and live stores: findings, rates, expectations and events."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.lazy_names import on_demand as _offer

if TYPE_CHECKING:
    from .events import Event
    from .expectations import AuthorityExpectation, Expectation
    from .proposing import propose

__all__ = ["AuthorityExpectation", "Event", "Expectation", "propose"]

if not TYPE_CHECKING:  # type checkers would find every name in a module with `__getattr__`
    __getattr__, __dir__ = _offer(
        __name__,
        {
            "events": ("Event",),
            "expectations": ("AuthorityExpectation", "Expectation"),
            "proposing": ("propose",),
        },
    )

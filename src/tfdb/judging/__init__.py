"""Checks of recordings and live stores: findings, rates, expectations and events."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.lazy_names import on_demand as _offer

if TYPE_CHECKING:
    from .buffer_expectations import BufferExpectations
    from .event_stream import EventStream
    from .events import Event
    from .expectations import AuthorityExpectation, Expectation, Limits
    from .installed import Installed
    from .proposing import propose

__all__ = [
    "AuthorityExpectation",
    "BufferExpectations",
    "Event",
    "EventStream",
    "Expectation",
    "Installed",
    "Limits",
    "propose",
]

if not TYPE_CHECKING:  # type checkers would find every name in a module with `__getattr__`
    __getattr__, __dir__ = _offer(
        __name__,
        {
            "buffer_expectations": ("BufferExpectations",),
            "event_stream": ("EventStream",),
            "events": ("Event",),
            "expectations": ("AuthorityExpectation", "Expectation", "Limits"),
            "installed": ("Installed",),
            "proposing": ("propose",),
        },
    )

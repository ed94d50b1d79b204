"""Stores on several machines: one home publishes its commits, mirrors apply them.

It needs PyPI's eclipse-zenoh: `pip install 'tfdb[net]'`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.lazy_names import on_demand as _offer

if TYPE_CHECKING:
    from .events import Event, NetEvents
    from .home import Home, HomeStats, publish
    from .mirroring import Mirror, MirrorStats, mirror
    from .security import Access, secure
    from .session import Session
    from .status import Status, status

__all__ = [
    "Access",
    "Event",
    "Home",
    "HomeStats",
    "Mirror",
    "MirrorStats",
    "NetEvents",
    "Session",
    "Status",
    "mirror",
    "publish",
    "secure",
    "status",
]

if not TYPE_CHECKING:  # type checkers would find every name in a module with `__getattr__`
    __getattr__, __dir__ = _offer(
        __name__,
        {
            "events": ("Event", "NetEvents"),
            "home": ("Home", "HomeStats", "publish"),
            "mirroring": ("Mirror", "MirrorStats", "mirror"),
            "security": ("Access", "secure"),
            "session": ("Session",),
            "status": ("Status", "status"),
        },
    )

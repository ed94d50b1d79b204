"""Copies transforms between a store and a live ROS graph, in both directions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.lazy_names import on_demand as _offer

if TYPE_CHECKING:
    from .bridge import Bridge
    from .sending import BridgeStats

__all__ = ["Bridge", "BridgeStats"]

if not TYPE_CHECKING:  # type checkers would find every name in a module with `__getattr__`
    __getattr__, __dir__ = _offer(__name__, {"bridge": ("Bridge",), "sending": ("BridgeStats",)})

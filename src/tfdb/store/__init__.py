"""Python parts of Buffer and Snapshot: explanations, reports, waits, files."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.lazy_names import on_demand as _offer

if TYPE_CHECKING:
    from . import summary as summary

if not TYPE_CHECKING:  # with `__getattr__`, type checkers would accept any name
    __getattr__, __dir__ = _offer(__name__, {"summary": ()})

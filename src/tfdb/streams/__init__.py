"""Streams: the samples that a buffer's commits store, each once and in order."""

from __future__ import annotations

from typing import TYPE_CHECKING

from tfdb.data.lazy_names import on_demand as _offer

if TYPE_CHECKING:
    from .answers import AnswerStream
    from .stream import Stream

__all__ = ["AnswerStream", "Stream"]

if not TYPE_CHECKING:  # type checkers would find every name in a module with `__getattr__`
    __getattr__, __dir__ = _offer(__name__, {"answers": ("AnswerStream",), "stream": ("Stream",)})

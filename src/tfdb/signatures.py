"""Signatures of the extension's methods, for `inspect.signature` and `help`."""

from __future__ import annotations
import __future__

import inspect
from typing import Any

__all__ = ["signature_of"]


def signature_of(written: str) -> inspect.Signature:
    """Read a signature as the bindings spell it."""
    code = compile(f"{written}: ...", "<tfdb>", "exec", __future__.annotations.compiler_flag)
    made: dict[str, Any] = {}
    exec(code, {}, made)  # noqa: S102 - our own text
    (function,) = made.values()
    return inspect.signature(function)

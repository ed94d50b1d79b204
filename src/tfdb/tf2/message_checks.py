"""Checks of message arguments: errors name the argument."""

from __future__ import annotations

from typing import Any

from tfdb.data.stamps import shown

__all__ = ["WrongMessageError", "refuse_unlike"]


class WrongMessageError(TypeError, AttributeError):
    """An argument lacks members of a message. Upstream raises one of the two base classes."""


def refuse_unlike(value: Any, name: str, what: str, *members: str) -> None:
    """Raise WrongMessageError for an object without these members: `name` must be `what`."""
    if not all(hasattr(value, member) for member in members):
        raise WrongMessageError(f"{name} must be {what}, got {shown(value)}")

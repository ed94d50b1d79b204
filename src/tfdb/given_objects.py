"""Arguments that callers give: refused, in our words, where they are nothing of what is wanted."""

from __future__ import annotations

from types import ModuleType
from typing import Any

from .errors import InvalidArgument
from .stamps import shown


def given_flag(name: str, value: Any) -> bool:
    """Return whether something is true. Raises InvalidArgument for what is neither."""
    try:
        return bool(value)
    except Exception as error:
        raise InvalidArgument(
            f"{name} is True or False, got {shown(value)}", value=value
        ) from error


def given_name(name: str, value: Any) -> str:
    """Return a name. Raises TypeError for anything but a str."""
    if not isinstance(value, str):
        raise TypeError(f"{name} must be a str, got {type(value).__name__}")
    return value


def refuse_without(value: Any, name: str, what: str, *attributes: str) -> None:
    """Raise TypeError for an object without these attributes: it is not `what` was asked for."""
    if isinstance(value, ModuleType) or not all(hasattr(value, each) for each in attributes):
        raise TypeError(f"{name} is {what}, got {shown(value)}")

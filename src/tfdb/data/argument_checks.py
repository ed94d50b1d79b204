"""Checks of arguments, with tfdb's errors."""

from __future__ import annotations

from operator import index
from pathlib import PurePath
from types import ModuleType
from typing import TYPE_CHECKING, Any, NoReturn

from .errors import InvalidArgument
from .stamps import shown
from .suggestions import near_names

if TYPE_CHECKING:
    from collections.abc import Collection

_LISTED = 12
"""Valid words that an error lists beside the nearest one; more of them hide it."""


def check_flag(name: str, value: Any) -> bool:
    """Return a flag as a bool. Raises InvalidArgument for text and for values without a truth."""
    cause = None
    if not isinstance(value, str):  # "no" would be true
        try:
            return bool(value)
        except Exception as error:
            cause = error
    raise InvalidArgument(
        f"{name} must be True or False, got {shown(value)}", value=value
    ) from cause


def check_callable(role: str, function: object) -> None:
    """Raise TypeError for an object that cannot be called."""
    if not callable(function):
        raise TypeError(f"{role} must be callable, got {type(function).__name__}")


def check_count(name: str, value: Any) -> int:
    """Return an integer above 0. Raises InvalidArgument for anything else."""
    try:
        count = None if isinstance(value, bool) else index(value)
    except TypeError:
        count = None
    if count is None or count < 1:
        raise InvalidArgument(
            f"{name} must be an integer of at least 1, got {shown(value)}", value=value
        )
    return count


def check_name(name: str, value: Any) -> str:
    """Return a name. Raises TypeError for anything but a str."""
    if not isinstance(value, str):
        raise TypeError(f"{name} must be a str, got {type(value).__name__}")
    return value


def check_word(name: str, value: Any, words: Collection[str], more: str = "") -> Any:
    """Return one of the valid words. The InvalidArgument for another value names the nearest."""
    if not isinstance(value, str) or value not in words:
        refuse_word(name, value, words, more)
    return value


def refuse_word(name: str, value: Any, words: Collection[str], more: str = "") -> NoReturn:
    """Raise InvalidArgument: `name` must be one of the words; `more` names other valid values."""
    raise InvalidArgument(not_one_of(name, value, words, more), value=value)


def not_one_of(name: str, value: Any, words: Collection[str], more: str = "") -> str:
    """Return the text of the error that `name` must be one of the words, with the nearest."""
    valid = [*map(repr, words), *([more] if more else [])]
    return f"{name} must be {_alternatives(valid)}, got {shown(value)}{_question(value, words)}"


def unknown_word(value: str, words: Collection[str]) -> str:
    """Return the text, as click words it, that a value is not a valid word, with the nearest.

    Many words are listed only if none of them is near.
    """
    near = _question(value, words)
    if near and len(words) > _LISTED:
        return f"{value!r} is unknown{near}"
    return f"{value!r} is not one of {', '.join(map(repr, words))}{near}"


def unknown_ending(path: str, endings: Collection[str]) -> str:
    """Return the text of the error for an unknown file extension, with the nearest."""
    ending = PurePath(path).suffix
    return f"{path!r} must end in {_alternatives([*endings])}{_question(ending, endings)}"


def _alternatives(words: list[str]) -> str:
    return " or ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _question(value: Any, words: Collection[str]) -> str:
    near = near_names(value, words, most=1, cutoff=0.6) if isinstance(value, str) else []
    return f"; did you mean {near[0]!r}?" if near else ""


def refuse_without(value: Any, name: str, what: str, *attributes: str) -> None:
    """Raise TypeError for an object without these attributes; `what` is expected."""
    if isinstance(value, ModuleType) or not all(hasattr(value, each) for each in attributes):
        raise TypeError(f"{name} must be {what}, got {shown(value)}")

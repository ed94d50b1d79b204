"""Signatures of functions, and error texts for calls that do not match them."""

from __future__ import annotations
import __future__

import functools
import inspect
from importlib import import_module
from typing import TYPE_CHECKING, Any

from tfdb._core import Transaction

from .suggestions import near_names

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

__all__ = ["describe_misfit", "misfit", "read_signature", "refusal", "signature_of"]

_BY_PLACE = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
_BY_NAME = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)

FOREIGN = {
    "authority": ("node", "publisher", "caller", "who"),
    "child": ("child_frame", "child_frame_id", "frame"),
    "end": ("end_time", "stop", "until", "to_time"),
    "fixed_frame": ("fixed",),
    "history": ("cache_time", "cache_size", "cache_duration", "buffer_length", "buffer_size"),
    "max_age": ("tolerance", "timeout", "max_delay"),
    "max_gap": ("tolerance", "gap"),
    "name": ("frame", "frame_id", "store"),
    "names": ("frames", "frame_ids"),
    "parent": ("parent_frame", "header_frame_id", "frame_id", "frame"),
    "path": ("file", "filename", "file_name", "filepath", "bag", "fname"),
    "paths": ("file", "files", "filename", "bag", "bags"),
    "policy": ("interpolation", "method", "mode", "advanced"),
    "rate": ("hz", "frequency", "freq", "fps"),
    "rotation": ("quaternion", "quat", "orientation", "rot", "q"),
    "rpy": ("euler", "roll_pitch_yaw", "angles"),
    "source": ("source_frame", "from_frame", "frame_from", "src", "child_frame", "frame_id"),
    "stamp": ("time", "timestamp", "t", "at", "when"),
    "stamps": ("times", "timestamps", "time", "stamp"),
    "start": ("start_time", "begin", "since", "from_time"),
    "target": ("target_frame", "to_frame", "frame_to", "dst", "parent_frame", "reference_frame"),
    "timeout": ("duration", "wait", "timeout_sec", "timeout_s"),
    "tolerance": ("max_gap", "max_age"),
    "topics": ("topic",),
    "translation": ("position", "xyz", "trans", "t"),
    "wxyz": ("quaternion_wxyz", "quat_wxyz"),
}
"""Names of the arguments in other libraries, mainly tf2, and tfdb's names for them."""

_TYPES: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "bool": ("a bool", lambda value: isinstance(value, bool)),
    "bytes": ("bytes", lambda value: isinstance(value, bytes)),
    "float": ("a number", lambda value: hasattr(value, "__float__") or hasattr(value, "__index__")),
    "int": ("an integer", lambda value: hasattr(value, "__index__")),
    "None": ("None", lambda value: value is None),
    "str": ("a str", lambda value: isinstance(value, str)),
}


def signature_of(written: str) -> inspect.Signature:
    """Parse a signature in the form that the bindings write."""
    code = compile(f"{written}: ...", "<tfdb>", "exec", __future__.annotations.compiler_flag)
    made: dict[str, Any] = {}
    exec(code, {}, made)  # noqa: S102 - our own text
    (function,) = made.values()
    return inspect.signature(function)


def describe_misfit(
    function: str, parameters: Sequence[inspect.Parameter], count: int, keywords: Sequence[str]
) -> str | None:
    """Describe why a call does not match the parameters; None if it matches."""
    placed = [each for each in parameters if each.kind in _BY_PLACE]
    named = {each.name: each for each in parameters if each.kind in _BY_NAME}
    kinds = {each.kind for each in parameters}
    if inspect.Parameter.VAR_KEYWORD not in kinds:
        for name in keywords:
            if name not in named:
                return f"{function}() got an unexpected keyword argument {_suggested(name, named)}"
    if count > len(placed) and inspect.Parameter.VAR_POSITIONAL not in kinds:
        return _too_many(function, parameters, len(placed), count)
    taken = placed[:count]
    for each in taken:
        if each.name in keywords and each.kind in _BY_NAME:
            return f"{function}() got multiple values for argument {each.name!r}"
    missing = [
        each.name
        for each in parameters
        if each.default is inspect.Parameter.empty
        and each.kind in (*_BY_PLACE, *_BY_NAME)
        and each not in taken
        and each.name not in keywords
    ]
    if not missing:
        return None
    some = "argument" if len(missing) == 1 else "arguments"
    return f"{function}() is missing the {some} {', '.join(map(repr, missing))}"


def _suggested(name: str, known: dict[str, inspect.Parameter]) -> str:
    """Suggest the nearest argument, or list all."""
    meant = [ours for ours in known if name.casefold() in FOREIGN.get(ours, ())]
    near = near_names(name, known, most=1, cutoff=0.6)
    for each in meant[:1] or near:
        return f"{name!r}; did you mean {each!r}?"
    return f"{name!r}; it takes {', '.join(known) or 'none'}"


def _too_many(function: str, parameters: Sequence[inspect.Parameter], most: int, count: int) -> str:
    names = [each.name for each in parameters if each.kind in _BY_PLACE]
    only = [each.name for each in parameters if each.kind is inspect.Parameter.KEYWORD_ONLY]
    if not most and not only:
        return f"{function}() takes no arguments, got {count}"
    listed = f" ({', '.join(names)})" if names else ""
    some = "argument" if most == 1 else "arguments"
    named = f"; by name only: {', '.join(only)}" if only else ""
    return f"{function}() takes at most {most} positional {some}{listed}, got {count}{named}"


def refusal(
    function: str, names: Sequence[str], required: int, positional: int, given: tuple[int, Any]
) -> str:
    """Describe why a call of an extension function does not match; `given`: count and keywords."""
    parameters = [
        inspect.Parameter(
            name,
            _BY_NAME[0] if i < positional else _BY_NAME[1],
            default=inspect.Parameter.empty if i < required else None,
        )
        for i, name in enumerate(names)
    ]
    return describe_misfit(function, parameters, *given) or f"{function}() got wrong arguments"


def misfit(made: Any, args: tuple[Any, ...], keywords: tuple[str, ...], said: str) -> str | None:
    """Describe why a call does not match a function; None if `said` came from within the function.

    `args` are the positional values, then those by name; `keywords` has the names.
    """
    signature = read_signature(made)
    count = len(args) - len(keywords)
    parameters = list(signature.parameters.values())
    name = made.__name__
    owner, _, _ = made.__qualname__.rpartition(".")
    if parameters and parameters[0].name in ("self", "cls", "_cls"):
        subject = args[0] if count else None
        kinds = subject if isinstance(subject, type) else type(subject)
        shared = getattr(getattr(kinds, name, None), "__qualname__", None) == made.__qualname__
        classes = [each.__name__ for each in kinds.__mro__]
        if not count or (owner and owner not in classes and not shared):
            got = f", got {type(subject).__name__}" if count else ""
            return f"{name}() is a method: call it on {_receivers(owner, name)}{got}"
        if name in ("__init__", "__new__"):
            name = kinds.__name__  # such as a subclass
        parameters, args, count = parameters[1:], args[1:], count - 1
    refused = "incompatible function arguments" in said
    if made.__name__ == "__init__" and hasattr(made, "__nb_signature__") and not refused:
        return None  # the function parses its arguments itself
    text = describe_misfit(name, parameters, count, keywords)
    if text is not None or not refused:
        return text
    placed = [each for each in parameters if each.kind in _BY_PLACE]
    given = [*zip((each.name for each in placed), args[:count], strict=False)]
    given += zip(keywords, args[count:], strict=True)
    for each, value in given:
        wanted = _wanted(str(signature.parameters[each].annotation), value)
        if wanted:
            return f"{each} must be {wanted}, got {type(value).__name__}"
    types = ", ".join(f"{each} {type(value).__name__}" for each, value in given)
    return f"{name}() does not take arguments of these types: {types}"


def _receivers(owner: str, method: str) -> str:
    """Name the classes that have a method."""
    if owner in ("Freezable", "StoreReader", "SharedReads"):
        shared = hasattr(Transaction, method)
        return "a Buffer, a Snapshot or a Transaction" if shared else "a Buffer or a Snapshot"
    return "an object" if owner.startswith("_") else f"a {owner}"


def _wanted(annotation: str, value: Any) -> str:
    """Name the plain types of an annotation if `value` has none of them; otherwise empty."""
    literal = annotation.removeprefix("typing.")
    if literal.startswith("Literal[") and not isinstance(value, str):
        return " or ".join(literal[8:-1].split(", "))
    kinds = [_TYPES.get(each) for each in annotation.split(" | ")]
    if None in kinds or any(kind and kind[1](value) for kind in kinds):
        return ""
    return " or ".join(kind[0] for kind in kinds if kind)


@functools.cache
def read_signature(made: Any) -> inspect.Signature:
    """Read the signature of a function; `**selection` becomes the fields of `Selection`."""
    written = getattr(made, "__nb_signature__", None)
    if written is not None:
        return signature_of(written[0][0])
    signature = inspect.signature(made)
    *others, last = signature.parameters.values() or [None]
    if last is None or last.annotation != "Unpack[Selected]":
        return signature
    selection = import_module("tfdb.recordings.selection").Selection
    keywords = list(inspect.signature(selection).parameters.values())
    return signature.replace(parameters=[*others, *keywords])

"""The public API: every class, method, property and function, with its parameter names."""

from __future__ import annotations

import functools
import inspect
from dataclasses import dataclass
from types import FunctionType, MemberDescriptorType
from typing import Any

import tfdb

ELSEWHERE = {"compare", "freeze", "load", "open", "unlink"}
ELSEWHERE |= {"read", "save", "write", "plot", "Recorder", "recorded_commits"}
ELSEWHERE |= {"count", "index"}  # of tuples with names
ELSEWHERE |= {"AsQuat", "Concurrency"}  # types for annotations
ELSEWHERE |= {"count", "index"}  # of tuples with names
"""What reads files, or makes and removes them, or draws: it has fuzzers and tests of its own."""
WAITING = {"wait_for_transform", "wait_for_commit", "_ended_waits", "_await_ended_waits"}
WAITING |= {"wait_for_transform_async", "wait_for_commit_async", "next", "sleep", "sleep_until"}
WAITING |= {"_sleep_unless_set"}
"""What may wait for ever; the parameter `timeout` is left out elsewhere."""
OTHERS = {("Transform", "to_msg")}
"""What returns objects of another face, some under names of this one."""
ENDING = OTHERS | {("Buffer", "close"), ("Buffer", "__exit__")}
"""What would leave nothing to call."""
CREATING = {"__init__", "__new__", "__init_subclass__"}
"""What a call of the class calls."""

OFFERED = {
    name: getattr(module, name)
    for module, names in (
        (tfdb._core, ("Policy", "StoreReader")),
        (tfdb.types, tfdb.types.__all__),
        (tfdb, tfdb.__all__),
    )
    for name in names
}
"""All that programs get in hand, and the bases of it."""
ANSWERS = {"EdgeExplanation", "EdgeUse", "Explanation", "FrameInfo", "IngestResult", "MemoryUse"}
ANSWERS |= {
    "Changes",
    "Comparison",
    "Counters",
    "Errors",
    "Frozen",
    "Refusal",
    "Refused",
    "Report",
    "Shared",
    "Twist",
}
"""Plain records that only we make: what is written into them by hand is not checked."""


@dataclass(frozen=True)
class Call:
    """Something that can be called: a function, a method of `owner`, or a property of it."""

    owner: str | None
    name: str
    positional: tuple[str, ...] = ()
    keywords: tuple[str, ...] = ()
    is_property: bool = False


NATIVE = {tfdb._core.Policy, tfdb._core.StoreReader, tfdb.Transform}
NATIVE |= {tfdb.Buffer, tfdb.Snapshot, tfdb.Transaction}


def _call(owner: str | None, name: str, function: Any) -> Call:
    try:
        found = [*inspect.signature(function).parameters.values()]
    except (TypeError, ValueError):  # of C, without a signature
        return Call(owner, name)
    found = [each for each in found if each.name not in ("self", "timeout")]
    named = tuple(each.name for each in found if each.kind is each.KEYWORD_ONLY)
    placed = tuple(each.name for each in found if each.kind <= each.POSITIONAL_OR_KEYWORD)
    return Call(owner, name, placed, named)


def _members(name: str, cls: type) -> list[Call]:
    """Methods and properties of the class and its bases; of native classes hidden ones as well."""
    calls = []
    for attribute, member in {
        each: value for base in reversed(cls.__mro__[:-1]) for each, value in vars(base).items()
    }.items():
        if attribute in ELSEWHERE | WAITING | CREATING or (name, attribute) in ENDING:
            continue
        helper = isinstance(member, FunctionType | staticmethod) and not attribute.endswith("_")
        if attribute.startswith("_") and (helper or cls not in NATIVE):
            continue
        if isinstance(member, MemberDescriptorType):  # of __slots__
            continue
        if inspect.isdatadescriptor(member):
            calls.append(Call(name, attribute, is_property=True))
        elif callable(getattr(cls, attribute)):
            calls.append(_call(name, attribute, getattr(cls, attribute)))
    return calls


@functools.cache
def everything() -> list[Call]:
    """Find all there is, in an order that stays the same."""
    found = []
    for name, thing in OFFERED.items():
        if name in ELSEWHERE or not callable(thing):
            continue
        if isinstance(thing, type) and issubclass(thing, BaseException):
            continue
        if name not in ANSWERS:
            found.append(_call(None, name, thing))
        if isinstance(thing, type):
            found += _members(name, thing)
    return sorted(found, key=lambda call: (call.owner or "", call.name, call.positional))

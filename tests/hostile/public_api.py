"""The public API: every class, method, property and function, with its parameter names."""

from __future__ import annotations

import ast
import functools
import inspect
from dataclasses import dataclass
from pathlib import Path

import tfdb

STUB = Path(tfdb.__file__).with_name("_core.pyi")
ELSEWHERE = {"compare", "freeze", "load", "open", "unlink"}
ELSEWHERE |= {"read", "save", "plot"}
ELSEWHERE |= {"AsQuat", "Concurrency"}  # types for annotations
"""What reads files, or makes and removes them, or draws: it has fuzzers and tests of its own."""
WAITING = {"wait_for_transform", "wait_for_commit", "_ended_waits", "_await_ended_waits"}
"""What may wait for ever; the parameter `timeout` is left out elsewhere."""
OTHERS = {("Transform", "to_msg")}
"""What returns objects of another face, some under names of this one."""
ENDING = OTHERS | {("Buffer", "close"), ("Buffer", "__exit__")}
"""What would leave nothing to call."""


OFFERED = {
    name: getattr(module, name)
    for module, names in (
        (tfdb._core, ("Policy", "Reads")),
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


def _parameters(node: ast.FunctionDef) -> tuple[tuple[str, ...], tuple[str, ...]]:
    positional = tuple(arg.arg for arg in node.args.posonlyargs + node.args.args)
    keywords = tuple(arg.arg for arg in node.args.kwonlyargs if arg.arg != "timeout")
    return positional[1:], keywords


def _methods(stub: ast.Module) -> list[Call]:
    found: dict[tuple[str, str], Call] = {}
    bases: dict[str, list[str]] = {}
    for cls in stub.body:
        if not isinstance(cls, ast.ClassDef):
            continue
        bases[cls.name] = [base.id for base in cls.bases if isinstance(base, ast.Name)]
        for node in cls.body:
            if not isinstance(node, ast.FunctionDef) or node.name in ELSEWHERE | WAITING:
                continue
            if (cls.name, node.name) in ENDING:
                continue
            marks = {mark.id for mark in node.decorator_list if isinstance(mark, ast.Name)}
            positional, keywords = _parameters(node)
            call = Call(cls.name, node.name, positional, keywords, "property" in marks)
            if node.name in ("__init__", "__new__"):
                call = Call(None, cls.name, positional, keywords)
            found[cls.name, node.name] = call
    for cls, parents in bases.items():
        for (owner, name), call in list(found.items()):
            if owner in parents and call.owner is not None and (cls, name) not in found:
                found[cls, name] = Call(cls, name, call.positional, call.keywords, call.is_property)
    return [call for call in found.values() if (call.owner or call.name) in OFFERED]


def _plain(stub: ast.Module) -> list[Call]:
    """Everything that is written in Python, and the constructors."""
    calls = []
    compiled = {node.name for node in stub.body if isinstance(node, ast.ClassDef)}
    for name, thing in OFFERED.items():
        if name in ELSEWHERE or not callable(thing) or thing in (tfdb.Buffer, tfdb.Transform):
            continue
        if isinstance(thing, type) and issubclass(thing, BaseException):
            continue
        try:
            names = list(inspect.signature(thing).parameters)
        except (TypeError, ValueError):
            names = []
        if name not in ANSWERS:
            names = [n for n in names if n not in ("args", "kwargs")]
            calls.append(Call(None, name, tuple(names)))
        if isinstance(thing, type) and name not in compiled:
            for attribute in vars(thing):
                if attribute.startswith("_") or attribute in ELSEWHERE:
                    continue
                member = getattr(thing, attribute)
                is_property = not callable(member)
                given = [] if is_property else [*inspect.signature(member).parameters]
                wanted = tuple(each for each in given if each not in ("self", "others"))
                calls.append(Call(name, attribute, wanted, (), is_property))
    return calls


@functools.cache
def everything() -> list[Call]:
    """Find all there is, in an order that stays the same."""
    stub = ast.parse(STUB.read_text(encoding="utf-8"))
    functions = [
        Call(None, node.name, *_function(node))
        for node in stub.body
        if isinstance(node, ast.FunctionDef) and node.name in OFFERED and node.name not in ELSEWHERE
    ]
    found = dict.fromkeys(functions + _methods(stub) + _plain(stub))
    return sorted(found, key=lambda call: (call.owner or "", call.name, call.positional))


def _function(node: ast.FunctionDef) -> tuple[tuple[str, ...], tuple[str, ...]]:
    positional = tuple(arg.arg for arg in node.args.args)
    return positional, tuple(arg.arg for arg in node.args.kwonlyargs)

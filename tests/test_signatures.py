"""Signature, module and help of every public name, as Python's tools show them."""

from __future__ import annotations

import ast
import copy
import importlib
import inspect
import pickle
import pydoc
import re
from pathlib import Path
from typing import Any
from unittest.mock import ANY

import pytest

import tfdb

STUB = ast.parse(Path(tfdb.__file__).with_name("_core.pyi").read_text(encoding="utf-8"))
PACKAGES = [
    "tfdb",
    "tfdb.recordings",
    "tfdb.robots",
    "tfdb.trajectories",
    "tfdb.tf2",
    "tfdb_measure.verify",
    "tfdb.ros",
    "tfdb.judging",
    "tfdb.rules",
    "tfdb.streams",
]
NEEDS_ROS = {"RospyNode", "RclpyNode"}


def public(package: str) -> list[tuple[str, Any]]:
    """Find the public classes and functions of a package."""
    module = importlib.import_module(package)
    found = [(name, getattr(module, name)) for name in module.__all__ if name not in NEEDS_ROS]
    plain = (bool, int, str, dict)
    return [
        (name, value)
        for name, value in found
        if not inspect.ismodule(value)
        and not isinstance(value, plain)
        and callable(value)
        # A Literal or another alias is not a class.
        and type(value).__module__ != "typing"
    ]


ALL = [(package, name, value) for package in PACKAGES for name, value in public(package)]
CLASSES = [each for each in ALL if isinstance(each[2], type)]


@pytest.mark.parametrize(("package", "name", "value"), ALL, ids=lambda each: str(each)[:40])
def test_every_public_name_has_a_signature_and_is_where_it_is_offered(
    package: str, name: str, value: Any
) -> None:
    inspect.signature(value)
    assert value.__module__ == package
    assert value.__qualname__ == name
    if package == "tfdb":
        assert "tfdb._core" not in pydoc.plain(pydoc.render_doc(value))


@pytest.mark.parametrize(("package", "name", "value"), CLASSES, ids=lambda each: str(each)[:40])
def test_every_public_method_has_a_signature(package: str, name: str, value: type) -> None:
    assert package.startswith("tfdb"), name
    for attribute in dir(value):
        method = getattr(value, attribute)
        inherited = hasattr(BaseException, attribute) or hasattr(int, attribute)
        if attribute.startswith("_") or not callable(method) or inherited:
            continue
        inspect.signature(method)
        assert str(method.__doc__ or "").partition("\n")[0].strip(), f"{name}.{attribute}"
        assert "tfdb._core" not in str(getattr(method, "__module__", ""))


Parameters = list[tuple[str, Any, Any]]


def told(signature: inspect.Signature) -> Parameters:
    """Name, kind and default of each parameter; `self` has no name for callers."""
    return [
        (each.name, ANY if each.name == "self" else each.kind, each.default)
        for each in signature.parameters.values()
    ]


def written(node: ast.FunctionDef | ast.AsyncFunctionDef) -> Parameters:
    """Read the same from the stub."""
    kinds, args = inspect.Parameter, node.args
    listed = [(each.arg, kinds.POSITIONAL_ONLY) for each in args.posonlyargs]
    listed += [(each.arg, kinds.POSITIONAL_OR_KEYWORD) for each in args.args]
    defaults: list[Any] = [kinds.empty] * (len(listed) - len(args.defaults))
    defaults += [ast.literal_eval(each) for each in args.defaults]
    for each, value in zip(args.kwonlyargs, args.kw_defaults, strict=True):
        listed.append((each.arg, kinds.KEYWORD_ONLY))
        defaults.append(kinds.empty if value is None else ast.literal_eval(value))
    return [(name, kind, value) for (name, kind), value in zip(listed, defaults, strict=True)]


def stub_methods(name: str) -> dict[str, ast.FunctionDef | ast.AsyncFunctionDef]:
    """Find the methods of a class in the stub; of overloads the last, which takes all."""
    (found,) = (each for each in STUB.body if isinstance(each, ast.ClassDef) and each.name == name)
    return {
        each.name: each
        for each in found.body
        if isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef)
        and not any(isinstance(mark, ast.Name) and mark.id == "property"
                    for mark in each.decorator_list)
    }  # fmt: skip


NATIVE = ["NativeBuffer", "NativeSnapshot", "NativeTransaction"]
OFFERED = ["Policy", "StoreReader", "Transform", *NATIVE]
CALLS = {"CoreCalls": tfdb.tf2.BufferCore, "BufferCalls": tfdb.tf2.Buffer}


@pytest.mark.parametrize("name", [*OFFERED, *CALLS])
def test_methods_match_the_stub(name: str) -> None:
    if name in CALLS:
        kind = next(each for each in CALLS[name].__mro__ if each.__name__ == name)
    else:
        kind = getattr(tfdb._core, name)
    assert "tfdb._core" not in kind.__module__
    methods = stub_methods(name)
    assert methods
    made = methods.pop("__init__", None) or methods.pop("__new__", None)
    if name in OFFERED:
        assert told(inspect.signature(kind)) == (written(made)[1:] if made else [])
    for method, node in methods.items():
        if method.startswith("__") or method == "_answer_by":
            continue
        own = any(getattr(mark, "id", "") == "classmethod" for mark in node.decorator_list)
        assert told(inspect.signature(getattr(kind, method))) == written(node)[own:], method


@pytest.mark.parametrize("name", ["open", "encode_tf_message", "decode_tf_message"])
def test_functions_match_the_stub(name: str) -> None:
    (node,) = (
        each for each in STUB.body if isinstance(each, ast.FunctionDef) and each.name == name
    )
    assert told(inspect.signature(getattr(tfdb, name))) == written(node)


def test_a_method_of_an_object_has_no_self() -> None:
    buf = tfdb.Buffer()
    for name in ("set_static_transform", "set_transform", "load", "snapshot", "lookup_transform"):
        unbound = told(inspect.signature(getattr(tfdb.Buffer, name)))
        assert told(inspect.signature(getattr(buf, name))) == unbound[1:]
    assert inspect.signature(buf.remove_frames).return_annotation == "int"
    assert (buf.remove_frames.__doc__ or "").startswith("Remove a frame")


def test_help_shows_signature_and_docstring_once() -> None:
    shown = pydoc.plain(pydoc.render_doc(tfdb.Buffer.remove_frames))
    assert shown.count("recursive: 'bool' = False") == 1
    assert shown.count("Remove a frame, or several") == 1
    assert "open(path, *, verify=False, clock=None)" in pydoc.plain(pydoc.render_doc(tfdb.open))


@pytest.mark.parametrize("options", [tfdb.rules.RuleOptions, tfdb.judging.Limits])
def test_help_explains_each_key_of_a_typed_dict(options: Any) -> None:
    explained = re.findall(r"^(\w+)\n    \S", inspect.getdoc(options) or "", re.MULTILINE)
    assert explained == list(options.__annotations__)


def test_no_private_module_in_errors_and_pickles() -> None:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0.6, 0.8))
    found = buf.lookup_transform("map", "base", 5)
    for made in (found, found.report, tfdb.Interpolate(1.0), buf.tree()[0], tfdb.open):
        assert b"tfdb._core" not in pickle.dumps(made)
        assert pickle.loads(pickle.dumps(made)) == made == copy.copy(made)
    with pytest.raises(tfdb.UnknownFrame) as error:
        buf.lookup_transform("map", "nowhere")
    assert b"tfdb._core" not in pickle.dumps(error.value)
    wrong: Any = object()
    for call in (
        lambda: buf.remove_frames(wrong),
        lambda: tfdb.Buffer.snapshot(wrong),
        lambda: tfdb._core.StoreReader.frames(wrong),
        lambda: tfdb.Buffer.__new__(tfdb.Buffer).frames(),
        tfdb.Snapshot,
    ):
        with pytest.raises(TypeError) as refused:
            call()
        assert "tfdb._core" not in str(refused.value)

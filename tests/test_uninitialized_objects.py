"""Methods of uninitialised objects and of other classes; text without UTF-8."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable

SURROGATE = "\ud800"


class Hollow(tfdb.Buffer):
    """Does not call our __init__."""

    def __init__(self) -> None:
        pass


def hollows() -> list[Any]:
    """Make one object of each class without its __init__."""
    classes = [Hollow, tfdb.Buffer, tfdb.Snapshot, tfdb.Transaction, tfdb._core.StoreReader]
    return [cls.__new__(cls) for cls in classes]


def methods(cls: type) -> dict[str, Callable[..., Any]]:
    """Find all that can be called on an object of the class."""
    own = {name: getattr(cls, name) for name in dir(cls) if not name.startswith("__")}
    own |= {name: getattr(cls, name) for name in ("__enter__", "__exit__") if hasattr(cls, name)}
    return {name: method for name, method in own.items() if callable(method)}


# Arguments that each method would take.
ARGUMENTS: dict[str, tuple[Any, ...]] = {
    "lookup_transforms": ("map", "base", [5]),
    "transform_points": ("map", "base", np.ones((1, 3)), 5),
    "lookup_transform_full": ("map", 5, "base", 5, "map"),
    "can_transform_full": ("map", 5, "base", 5, "map"),
    "_path_stamps": ("map", "base", None, None),
    "frame_exists": ("map",),
    "frame_info": ("map",),
    "children": ("map",),
    "descendants": ("map",),
    "parent_of": ("map",),
    "samples": ("map",),
    "set_transform": ("map", "base", 5, (1, 2, 3), (0, 0, 0, 1)),
    "set_static_transform": ("map", "base", (1, 2, 3)),
    "set_transforms": ([],),
    "remove_frames": (["map"],),
    "reparent": ("map", "base"),
    "ingest": (b"",),
    "run": (lambda tx: tx,),
    "load": ("nowhere.mcap",),
    "_attempt": (0, False, 0),
    "__exit__": (None, None, None),
    "add_rule": (print, "map"),
    "apply": (b"",),
    "at": (1,),
    "changes": (0,),
    "commits_bytes": (0,),
    "follow": ("map",),
    "forget_source": ("robot",),
    "lookup_edges": (["base"],),
    "lookup_latest_transform": ("map", "base"),
    "next": (0, 0),
    "rule": ("map",),
    "wait_for_commit": (0, 0),
    "watch": ("map",),
}
NONE = {"compact", "events", "positions", "state_bytes", "tree_columns"}
NONE |= {"frames", "tree", "snapshot", "memory", "counters", "clear", "close", "abort"}
NONE |= {"transaction", "__enter__", "_repr_html_"}


@pytest.mark.parametrize("name", sorted(ARGUMENTS.keys() | NONE))
def test_arguments_fit_the_methods(name: str) -> None:
    """A wrong argument would be refused before a wrong object is."""
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0.6, 0.8))
    held, watch, other = buf.snapshot(), buf.watch("map"), tfdb.Buffer()
    with buf.transaction() as tx:
        owners: list[Any] = [held, watch, tx, other]
        for owner in owners:
            if name.startswith("__") or not callable(getattr(type(owner), name, None)):
                continue
            try:
                call(getattr(type(owner), name), name, owner)
            except (tfdb.TfdbError, OSError):
                continue
        tx.abort()


def call(method: Callable[..., Any], name: str, obj: Any) -> Any:
    """Call a method with arguments that are right."""
    if name == "ingest_many":
        return method(obj, [], encoding="cdr")
    arguments = ARGUMENTS.get(name, () if name in NONE else ("map", "base"))
    return method(obj, *arguments)


@pytest.mark.parametrize("hollow", hollows(), ids=lambda obj: type(obj).__name__)
@pytest.mark.filterwarnings("ignore:nanobind. attempted to access an uninitialized instance")
def test_objects_without_init_raise(hollow: Any) -> None:
    for name, method in methods(type(hollow)).items():
        if name == "load":
            continue  # looks at its file first
        with pytest.raises(TypeError):
            call(method, name, hollow)


@pytest.mark.parametrize("cls", [tfdb.types.Policy, tfdb.Interpolate, tfdb.Exact, tfdb.Nearest])
def test_policies_without_init_raise(cls: type) -> None:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0.6, 0.8))
    hollow = cls.__new__(cls)
    calls: list[Callable[[], Any]] = [
        lambda: buf.lookup_transform("map", "base", 5, hollow),
        lambda: buf.lookup_transforms("map", "base", [5], hollow),
        lambda: buf.transform_points("map", "base", np.ones((1, 3)), 5, hollow),
        lambda: buf.can_transform("map", "base", 5, hollow),
        lambda: hollow.kind,
        lambda: hollow.limit_ns,
    ]
    for refused in calls:
        with pytest.raises(TypeError, match=rf"{cls.__name__}.*__init__"):
            refused()


@pytest.mark.parametrize(
    "cls", [tfdb.Buffer, tfdb.Snapshot, tfdb.Transaction, tfdb._core.StoreReader]
)
def test_methods_on_objects_of_another_class(cls: type) -> None:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0.6, 0.8))
    others = [5, "map", None, object(), tfdb.Interpolate(), buf, buf.snapshot(), buf.transaction()]
    python = {"explain", "trajectory", "run", "load"}  # they take what behaves alike
    shared = {"children", "descendants", "path", "_repr_html_"}  # one function for all reads
    for name in methods(cls).keys() - python:
        owner = next(base for base in cls.__mro__ if name in vars(base))
        method = getattr(owner, name)
        for other in others:
            if isinstance(other, owner):
                continue
            if name in shared and isinstance(other, tfdb._core.StoreReader | tfdb.Transaction):
                continue
            with pytest.raises(TypeError):
                call(method, name, other)
    assert buf.frames() == ["base", "map"]


class Unprintable:
    """Its repr and its attributes have no UTF-8."""

    dtype = SURROGATE
    shape = SURROGATE

    def __repr__(self) -> str:
        return SURROGATE


class Kindless:
    """Its dtype says what no array says."""

    dtype = type("dtype", (), {"kind": SURROGATE, "__repr__": lambda _: SURROGATE})()
    shape = SURROGATE


def test_text_without_utf8() -> None:
    buf = tfdb.Buffer()
    buf.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0.6, 0.8))
    made = tfdb.Transform("a", "b", (1, 2, 3))
    odd: dict[str, Any] = {SURROGATE: 1}
    calls: list[Callable[[], Any]] = [
        lambda: buf.lookup_transform("map", "base", **odd),
        lambda: buf.lookup_transforms("map", "base", [5], **odd),
        lambda: buf.set_transform("map", "base", 5, (1, 2, 3), (0, 0, 0, 1), **odd),
        lambda: buf.set_transforms([], **odd),
        lambda: buf.snapshot(**odd),
        lambda: tfdb.Buffer(**odd),
        lambda: tfdb.Transform("a", "b", (1, 2, 3), **odd),
        lambda: made @ tfdb.Transform("c", SURROGATE, (1, 2, 3)),
        lambda: made @ tfdb.Transform(SURROGATE, "c", (1, 2, 3)),
        lambda: buf.lookup_transform("map", "base", Unprintable()),  # type: ignore[arg-type]
        lambda: buf.lookup_transforms("map", "base", Unprintable()),  # type: ignore[arg-type]
        lambda: buf.lookup_transforms("map", "base", Kindless()),  # type: ignore[arg-type]
        lambda: buf.lookup_transform("map", SURROGATE),
        lambda: buf.set_transforms([], authority=SURROGATE),
        lambda: buf.remove_frames(SURROGATE),
        lambda: tfdb.Buffer(concurrency=SURROGATE),  # type: ignore[arg-type]
        lambda: tfdb.encode_tf_message([], SURROGATE),
    ]
    for refused in calls:
        with pytest.raises((tfdb.TfdbError, TypeError)):
            refused()

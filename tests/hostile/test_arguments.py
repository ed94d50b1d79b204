"""Every public callable says in our words which argument of a call does not fit.

All signatures are found by introspection: wrong counts, unknown and mistyped names, and a wrong
type at each place.
"""

from __future__ import annotations

import enum
import inspect
from types import MethodDescriptorType
from typing import TYPE_CHECKING, Any

import pytest

import tfdb

pytest.importorskip("matplotlib")

import tfdb.plot
import tfdb.ros

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

P = inspect.Parameter
PACKAGES = (
    *(tfdb, tfdb.errors, tfdb.plot, tfdb.recordings, tfdb.robots, tfdb.ros),
    *(tfdb.trajectories, tfdb.types),
    *(tfdb.tf2, tfdb.tf2.tf1, tfdb.tf2.msgs),
    *(tfdb.tf2.geometry, tfdb.tf2.clouds, tfdb.tf2.covariance),
)
NEEDS_ROS = {"RospyNode", "RclpyNode"}
FOREIGN_WORDS = (
    *(
        "incompatible function arguments",
        "Invoked with",
        "nanobind",
        "StoreReader",
        "._core",
        "_Span",
    ),
    *("__init__", "required positional", "positional arguments but", "object has no attribute"),
)
BY_PLACE = (P.POSITIONAL_ONLY, P.POSITIONAL_OR_KEYWORD)

SECOND = 10**9


def made() -> dict[type, Any]:
    store = tfdb.Buffer()
    for i in range(3):
        store.set_transform("map", "base", i * SECOND, (i, 2, 3), (0, 0, 0.6, 0.8))
    return {
        tfdb.Buffer: store,
        tfdb.Snapshot: store.snapshot(),
        tfdb.Transform: store.lookup_transform("map", "base"),
        tfdb.Trajectory: store.trajectory("map", "base"),
        tfdb.tf2.Buffer: tfdb.tf2.Buffer(buffer=store),
        tfdb.tf2.BufferCore: tfdb.tf2.BufferCore(buffer=store),
        tfdb.tf2.tf1.Transformer: tfdb.tf2.tf1.Transformer(),
        tfdb.tf2.tf1.TransformerROS: tfdb.tf2.tf1.TransformerROS(),
        tfdb.tf2.msgs.Time: tfdb.tf2.msgs.Time(12, 5),
        tfdb.tf2.ConvertRegistration: tfdb.tf2.ConvertRegistration(),
        tfdb.tf2.TransformRegistration: tfdb.tf2.TransformRegistration(),
    }


def public() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Find each function, constructor and method, of an object where there is one."""
    objects = made()
    with objects[tfdb.Buffer].transaction() as transaction:
        transaction.frame_exists("map")
    objects[tfdb.Transaction] = transaction
    for package in PACKAGES:
        for name in package.__all__:
            if name in NEEDS_ROS:
                continue
            thing = getattr(package, name)
            if not callable(thing) or type(thing).__module__ == "typing":
                continue
            if not isinstance(thing, type):
                yield f"{package.__name__}.{name}", thing
                continue
            if issubclass(thing, BaseException | enum.Enum) or hasattr(thing, "_is_protocol"):
                continue
            yield f"{package.__name__}.{name}", thing
            for attribute in dir(thing):
                if attribute.startswith("_") or hasattr(int, attribute):
                    continue
                member = getattr(objects.get(thing, thing), attribute, None)
                # Of methods in C without an object, Python speaks before we can.
                spoken = isinstance(member, MethodDescriptorType)
                if inspect.isroutine(member) and callable(member) and not spoken:
                    yield f"{package.__name__}.{name}.{attribute}", member


ALL = dict(public())
EMPTY = {"tfdb._core.StoreReader", "tfdb.Clock", "tfdb.Snapshot", "tfdb.Transaction", "tfdb.Watch"}
"""What is not called: a method of a Buffer makes it."""
AMID = {"tfdb.Buffer.close", "tfdb.Snapshot.close", "tfdb.plot.show", "tfdb.tf2.Buffer.close"}


def parameters_of(call: Callable[..., Any]) -> list[inspect.Parameter]:
    found = list(inspect.signature(call).parameters.values())
    return found[1:] if found and found[0].name in ("self", "cls") else found


def is_unbound(call: Callable[..., Any]) -> bool:
    """Whether its first argument is the object, of which there is none at hand."""
    found = list(inspect.signature(call).parameters)
    return bool(found) and found[0] in ("self", "cls")


def refusal_of(call: Callable[..., Any], *args: Any, **named: Any) -> str:
    """Call with what does not fit: it is a TypeError, in none of the words that are not ours."""
    with pytest.raises(TypeError) as refused:
        call(*args, **named)
    said = str(refused.value)
    for word in FOREIGN_WORDS:
        assert word not in said, said
    return said


BOUND = {name: call for name, call in ALL.items() if not is_unbound(call) and name not in EMPTY}


def test_the_fuzzer_covers_the_public_api() -> None:
    for name in ("tfdb.Buffer", "tfdb.Buffer.frames", "tfdb.Buffer.load", "tfdb.Buffer.open",
                 "tfdb.Transform.inverse", "tfdb.Trajectory.plot", "tfdb.Transaction.reparent",
                 "tfdb.Trajectory.read", "tfdb.plot.trajectory", "tfdb.load",
                 "tfdb.Buffer.lookup_transform", "tfdb.Interpolate"):  # fmt: skip
        assert name in BOUND, name
    assert len(BOUND) > 150


@pytest.mark.parametrize("name", ALL)
def test_an_argument_that_there_is_not(name: str) -> None:
    if name in EMPTY:
        assert "make" in refusal_of(ALL[name], no_such=1)
        return
    call = ALL[name]
    given = parameters_of(call)
    if is_unbound(call):
        assert "is a method: call it on " in refusal_of(call, no_such=1)
        return
    if any(each.kind is P.VAR_KEYWORD for each in given):
        return
    said = refusal_of(call, no_such=1)
    if not given and isinstance(call, type) and call.__init__ is object.__init__:
        assert said.endswith("() takes no arguments")
        return
    assert "got an unexpected keyword argument 'no_such'; it takes " in said
    for each in given:
        if each.kind in (P.POSITIONAL_OR_KEYWORD, P.KEYWORD_ONLY):
            assert each.name in said


@pytest.mark.parametrize("name", BOUND)
def test_a_name_that_is_mistyped_gets_the_nearest(name: str) -> None:
    given = parameters_of(BOUND[name])
    if any(each.kind is P.VAR_KEYWORD for each in given):
        return
    names = [each.name for each in given if each.kind in (P.POSITIONAL_OR_KEYWORD, P.KEYWORD_ONLY)]
    for right in names:
        wrong = right[:-2] + right[-1] + right[-2] if len(right) > 3 else right + "x"
        wrong = right + "_" if wrong == right else wrong
        said = refusal_of(BOUND[name], **{wrong: 1})
        assert f"got an unexpected keyword argument {wrong!r}; did you mean " in said
        if len(right) > 4 and not any(other != right and other[:3] == right[:3] for other in names):
            assert said.endswith(f"did you mean {right!r}?")


@pytest.mark.parametrize("name", BOUND)
def test_too_many_arguments(name: str) -> None:
    given = parameters_of(BOUND[name])
    if any(each.kind is P.VAR_POSITIONAL for each in given):
        return
    placed = [each.name for each in given if each.kind in BY_PLACE]
    said = refusal_of(BOUND[name], *range(len(placed) + 1))
    if not placed:
        assert "takes no arguments" in said or "by name only" in said or "at most 0" in said
        return
    assert f"got {len(placed) + 1}" in said
    assert ", ".join(placed) in said


@pytest.mark.parametrize("name", BOUND)
def test_too_few_arguments(name: str) -> None:
    given = parameters_of(BOUND[name])
    needed = [
        each.name
        for each in given
        if each.default is P.empty and each.kind not in (P.VAR_POSITIONAL, P.VAR_KEYWORD)
    ]
    if needed:
        said = refusal_of(BOUND[name])
        for each in needed:
            assert repr(each) in said
        assert said.partition("()")[0] == name.rpartition(".")[2]


@pytest.mark.parametrize("name", BOUND)
def test_an_argument_twice(name: str) -> None:
    for each in parameters_of(BOUND[name]):
        if each.kind is P.POSITIONAL_OR_KEYWORD:
            said = refusal_of(BOUND[name], 1, **{each.name: 1})
            assert f"got multiple values for argument {each.name!r}" in said
        return


class Nothing:
    """It is nothing of what any argument may be."""

    def __repr__(self) -> str:
        return "<nothing>"


@pytest.mark.parametrize("name", sorted(set(ALL) - EMPTY - AMID))
def test_a_wrong_type_at_each_place(name: str) -> None:
    call = ALL[name]
    if is_unbound(call):
        return
    given = [
        each for each in parameters_of(call) if each.kind not in (P.VAR_KEYWORD, P.VAR_POSITIONAL)
    ]
    right: dict[str, Any] = {"target": "map", "source": "base", "parent": "map", "child": "base"}
    right |= {"stamp": SECOND, "translation": (1, 2, 3), "timeout": 0.0, "name": "base"}
    for place, each in enumerate(given):
        for wrong in (Nothing(), 1.5j):
            filled = [right.get(other.name, wrong) for other in given[:place]] + [wrong]
            needed = [other for other in given[place + 1 :] if other.default is P.empty]
            named = {other.name: right.get(other.name, wrong) for other in needed}
            if each.kind is P.KEYWORD_ONLY:
                named[each.name] = wrong
                filled = [right.get(o.name, wrong) for o in given if o.kind in BY_PLACE]
                filled = filled[: sum(o.default is P.empty for o in given if o.kind in BY_PLACE)]
                named = {key: value for key, value in named.items() if key not in
                         [o.name for o in given[: len(filled)]]}  # fmt: skip
            elif any(other.kind is P.POSITIONAL_ONLY for other in needed):
                filled += [wrong] * len(needed)
                named = {}
            try:
                answer = call(*filled, **named)
                if inspect.iscoroutine(answer):
                    answer.close()
            except (TypeError, ValueError, AttributeError, tfdb.TfdbError, OSError) as error:
                for word in FOREIGN_WORDS:
                    assert word not in str(error), (each.name, str(error))


PLAIN = {
    ("tfdb.Buffer.remove_frames", "recursive"): (("base",), "a bool"),
    ("tfdb.Buffer.set_transforms", "static"): (([],), "a bool"),
    ("tfdb.Buffer.set_static_transform", "change_kind"): (("map", "x", (1, 2, 3)), "a bool"),
}


@pytest.mark.parametrize(("name", "argument"), PLAIN)
def test_the_argument_of_a_wrong_type_is_named(name: str, argument: str) -> None:
    args, kind = PLAIN[name, argument]
    said = refusal_of(BOUND[name], *args, **{argument: "yes"})
    assert said == f"{argument} must be {kind}, got str"


def test_none_for_a_word_is_named() -> None:
    said = refusal_of(
        BOUND["tfdb.Buffer.transform_points"], "map", "base", [[1, 2, 3]], 5, missing=None
    )
    assert said == "missing must be 'raise' or 'nan', got NoneType"


@pytest.mark.parametrize(
    ("name", "foreign", "ours"),
    [
        ("tfdb.Buffer", "cache_time", "history"),
        ("tfdb.Buffer.lookup_transform", "target_frame", "target"),
        ("tfdb.Buffer.lookup_transform", "source_frame", "source"),
        ("tfdb.Buffer.lookup_transform", "time", "stamp"),
        ("tfdb.Buffer.lookup_transform", "duration", "timeout"),
        ("tfdb.Buffer.set_transform", "child_frame_id", "child"),
        ("tfdb.Buffer.set_transform", "frame_id", "parent"),
        ("tfdb.Buffer.set_transform", "quaternion", "rotation"),
        ("tfdb.Buffer.trajectory", "hz", "rate"),
        ("tfdb.Buffer.trajectory", "end_time", "end"),
        ("tfdb.Transform", "position", "translation"),
        ("tfdb.load", "filename", "path"),
        ("tfdb.Interpolate", "tolerance", "max_gap"),
    ],
)
def test_words_of_tf2_and_others_name_ours(name: str, foreign: str, ours: str) -> None:
    said = refusal_of(BOUND[name], **{foreign: 1})
    assert said.endswith(f"got an unexpected keyword argument {foreign!r}; did you mean {ours!r}?")


def test_a_method_of_a_class_asks_for_an_object() -> None:
    said = refusal_of(tfdb.Buffer.load, "drive.bag")
    assert said == "load() is a method: call it on a Buffer, got str"
    shared = "is a method: call it on a Buffer, a Snapshot or a Transaction"
    assert refusal_of(tfdb.Buffer.frames) == f"frames() {shared}"
    assert refusal_of(tfdb.Buffer.trajectory, "map") == f"trajectory() {shared}, got str"
    assert (
        refusal_of(tfdb.Buffer.freeze) == "freeze() is a method: call it on a Buffer or a Snapshot"
    )


def test_an_error_from_within_stays_as_it_is() -> None:
    def fails(_: object) -> None:
        raise TypeError("incompatible function arguments of mine")

    with pytest.raises(TypeError, match=r"^incompatible function arguments of mine$"):
        tfdb.Buffer().run(fails)
    with pytest.raises(TypeError, match=r"^target must be a str, got int$"):
        tfdb.Buffer().lookup_transform(1, "base")

"""Expectations of edges and authorities: their limits, and the text of their file."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal, Self, TypedDict, get_args

from tfdb.data.argument_checks import check_word
from tfdb.data.errors import ExpectationError, InvalidArgument
from tfdb.data.lazy_names import belong_to
from tfdb.data.new_file import new_file
from tfdb.data.path_checks import check_path
from tfdb.data.stamps import shown

from .events import CLOCKS, EVENT_KINDS, Severity
from .expectation_file import TIME, UNITS, ExpectationFile, text_of

if TYPE_CHECKING:
    import os
    from collections.abc import Callable

__all__ = ["AuthorityExpectation", "Expectation", "Expectations", "Limits"]

_QUANTITY = re.compile(r"([0-9.eE+-]+)\s*([a-z/]+)")
_GREATEST = 1e9
_NO_END = 2**63 - 1  # a lifespan, nanoseconds


@dataclass(frozen=True)
class Expectation:
    """An expectation of all edges that match two names; each name may contain `*`.

    Durations are in seconds. A limit of None is not checked.
    """

    parent: str = "*"
    """Name of the parent."""
    child: str = "*"
    """Name of the child."""
    deadline: float | None = None
    """Longest time between two arrivals."""
    lifespan: float | None = None
    """Greatest age of the newest stamp."""
    liveliness: float | None = None
    """Longest time between two commits of each of these authorities, on any edge."""
    authority: Sequence[str] = ()
    """The authorities that may write the edge, the preferred one first; empty: any."""
    max_step: float | None = None
    """Longest distance between two samples, metres."""
    max_speed: float | None = None
    """Highest speed between two samples, metres per second."""
    max_turn: float | None = None
    """Largest rotation between two samples, radians."""
    max_late: float | None = None
    """Largest distance of a sample behind the newest stamp, seconds."""
    severity: Mapping[str, Severity] = field(default_factory=dict)
    """Severities by kind of event, where they differ from the default."""

    def __post_init__(self) -> None:
        for name in ("parent", "child"):
            _check_name(name, getattr(self, name))
        if self.is_exact and self.parent == self.child:
            raise InvalidArgument(f"parent and child are both {self.parent!r}; name two frames")
        if not isinstance(self.authority, Iterable):
            raise TypeError(f"authority must be a name or several, got {shown(self.authority)}")
        names = (self.authority,) if isinstance(self.authority, str) else tuple(self.authority)
        object.__setattr__(self, "authority", names)
        for each in names:
            _check_name("authority", each)
        if len(set(names)) < len(names):
            raise InvalidArgument(f"authority names {_first_twice(names)!r} twice", value=names)
        for name, units in UNITS.items():
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _quantity(name, value, units))
        _check_severity(self.severity)

    @property
    def is_exact(self) -> bool:
        """Whether it names one edge."""
        return "*" not in self.parent + self.child

    def over(self, other: Expectation) -> Expectation:
        """Return this expectation, with its missing limits taken from another."""
        lacking: dict[str, Any] = {
            name: getattr(other, name)
            for name in (*UNITS, "authority")
            if getattr(self, name) in (None, ())
        }
        if not other.severity and not any(lacking.values()):
            return self
        return replace(self, severity={**other.severity, **self.severity}, **lacking)


class Limits(TypedDict, total=False):
    """The limits of `Expectation`, for `Buffer.expect`.

    A limit is a number in the given unit, or text with a unit, such as `"50 ms"`.

    Parameters
    ----------
    deadline
        Longest time between two arrivals, seconds.
    lifespan
        Greatest age of the newest stamp, seconds.
    liveliness
        Longest time between two commits of each authority in `authority`, on any edge, seconds.
    authority
        The authorities that may write the edge, the preferred one first.
    max_step
        Longest distance between two samples, metres.
    max_speed
        Highest speed between two samples, metres per second.
    max_turn
        Largest rotation between two samples, radians.
    max_late
        Largest distance of a sample behind the newest stamp, seconds.
    severity
        Severities by kind of event, where they differ from the default: `ok`, `warning`, `error` or
        `stale`.
    """

    deadline: float | str
    lifespan: float | str
    liveliness: float | str
    authority: str | Sequence[str]
    max_step: float | str
    max_speed: float | str
    max_turn: float | str
    max_late: float | str
    severity: Mapping[str, Severity]


@dataclass(frozen=True)
class AuthorityExpectation:
    """An expectation of all authorities that match a name, which may contain `*`."""

    name: str
    """Name of the authority."""
    liveliness: float
    """Longest time between two of its commits, on any edge, seconds."""
    severity: Mapping[str, Severity] = field(default_factory=dict)
    """The severity of `liveliness`, if it differs from the default."""

    def __post_init__(self) -> None:
        _check_name("name", self.name)
        value = _quantity("liveliness", self.liveliness, TIME)
        object.__setattr__(self, "liveliness", value)
        _check_severity(self.severity)


@dataclass(frozen=True)
class Expectations:
    """All expectations of a store or recording.

    Each limit of an edge comes from the first expectation that sets it: first the one that names
    both frames, then those with `*` in their order, then the default.

    >>> import tfdb
    >>> from tfdb.judging import Expectation
    >>> one = Expectation("odom", "base", deadline=0.05, authority=["ekf", "wheels"])
    >>> print(tfdb.Expectations([one]))
    version = 1
    clock = "stamps"
    <BLANKLINE>
    [[edge]]
    parent = "odom"
    child = "base"
    deadline = 0.05
    authority = ["ekf", "wheels"]
    <BLANKLINE>
    """

    edges: Sequence[Expectation] = ()
    """Expectations of edges."""
    authorities: Sequence[AuthorityExpectation] = ()
    """Expectations of authorities."""
    default: Expectation = field(default_factory=Expectation)
    """Limits for edges without limits of their own."""
    clock: Literal["stamps", "arrival"] = "stamps"
    """The start of an age: the newest stamp, or its arrival if stamps come from another clock."""

    def __post_init__(self) -> None:
        check_word("clock", self.clock, ("stamps", "arrival"))
        if not isinstance(self.default, Expectation):
            raise TypeError(f"default must be an Expectation, got {shown(self.default)}")
        for name, kind in (("edges", Expectation), ("authorities", AuthorityExpectation)):
            given = tuple(getattr(self, name))
            for each in given:
                if not isinstance(each, kind):
                    raise TypeError(f"{name} must contain only {kind.__name__}, got {shown(each)}")
            object.__setattr__(self, name, given)
        _check_contradictions(self.edges, self.authorities)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """Read a TOML file.

        Raises
        ------
        ExpectationError
            The file is missing or not TOML, or a key or value is not valid. Field: line.
        """
        kinds = {"edge": Expectation, "authority": AuthorityExpectation, "default": Expectation}
        return ExpectationFile(check_path(path), kinds).read(cls)

    def write(self, path: str | os.PathLike[str], *, overwrite: bool = False) -> None:
        """Write a TOML file; with `overwrite`, replace an existing one."""
        with new_file(path, overwrite=overwrite, refusal=ExpectationError) as made:
            made.write_text(str(self), encoding="utf-8")

    def __str__(self) -> str:
        """The text of the TOML file."""
        return text_of(self)


def joined(parts: Sequence[Expectations]) -> Expectations:
    """Merge these into one. Refuse two expectations of one subject."""
    clocks = {each.clock for each in parts}
    defaults = [each.default for each in parts if each.default != Expectation()]
    if len(clocks) > 1:
        text = "clock is 'stamps' of some expectations and 'arrival' of others; give one to all"
        raise InvalidArgument(text)
    if len(defaults) > 1:
        raise InvalidArgument("two of the Expectations have a default; combine them, or name edges")
    return Expectations(
        [edge for each in parts for edge in each.edges],
        [authority for each in parts for authority in each.authorities],
        defaults[0] if defaults else Expectation(),
        parts[0].clock,
    )


def edge_limits(expectations: Expectations) -> Callable[[str, str], Expectation]:
    """Return a function from parent and child to the expectation of the edge."""
    exact = {(each.parent, each.child): each for each in expectations.edges if each.is_exact}
    patterns = [each for each in expectations.edges if not each.is_exact]

    def limits(parent: str, child: str) -> Expectation:
        found = exact.get((parent, child)) or Expectation(parent, child)
        for each in patterns:
            if matches(each.parent, parent) and matches(each.child, child):
                found = found.over(each)
        return found.over(expectations.default)

    return limits


def lifespans(
    parts: Sequence[tuple[Expectations, bool]],
) -> list[tuple[str, str, int, str]]:
    """Return parent, child, nanoseconds and name of each lifespan, in order of precedence.

    Each input has a flag whether it is enforced. A lifespan that is not enforced is infinite in the
    result, because the first match counts.
    """
    edges = [(edge, enforced) for each, enforced in parts for edge in each.edges]
    edges.sort(key=lambda edge: not edge[0].is_exact)
    edges += [(each.default, enforced) for each, enforced in parts]
    return [
        (
            each.parent,
            each.child,
            round(each.lifespan * 1e9) if enforced else _NO_END,
            f"{each.parent} -> {each.child}",
        )
        for each, enforced in edges
        if each.lifespan is not None
    ]


def limits_of_authority(expectations: Expectations, name: str) -> AuthorityExpectation | None:
    """Return the expectation of one authority, or None."""
    named = [each for each in expectations.authorities if matches(each.name, name)]
    named.sort(key=lambda each: "*" in each.name)
    found = [(each.liveliness, each.severity) for each in named]
    edges = [each for each in expectations.edges if any(matches(a, name) for a in each.authority)]
    edges.sort(key=lambda each: each.liveliness or 0)
    found += [(e.liveliness, e.severity) for e in (*edges, expectations.default) if e.liveliness]
    return AuthorityExpectation(name, *found[0]) if found else None


def expected_authorities(expectations: Expectations) -> Iterable[str]:
    """Return the authorities that are named without `*` and have a liveliness."""
    listed = [each.name for each in expectations.authorities]
    for each in expectations.edges:
        listed += each.authority if each.liveliness else ()
    return dict.fromkeys(name for name in listed if "*" not in name)


def matches(pattern: str, name: str) -> bool:
    """Whether a name matches a pattern, in which `*` stands for any text."""
    if "*" not in pattern:
        return pattern == name
    parts = ".*".join(map(re.escape, pattern.split("*")))
    return re.fullmatch(parts, name, re.DOTALL) is not None


def _check_name(what: str, name: object) -> None:
    if not isinstance(name, str) or not name or not _has_utf8(name):
        raise InvalidArgument(
            f"{what} is {shown(name)}; give a name, which may contain *", value=name
        )


def _has_utf8(name: str) -> bool:
    try:
        name.encode()
    except UnicodeEncodeError:
        return False
    return True


def _quantity(name: str, value: object, units: Mapping[str, float]) -> float:
    """Return a limit as a number in its first unit."""
    if isinstance(value, str):
        match = _QUANTITY.fullmatch(value.strip())
        known = ", ".join(units)
        try:
            number, factor = float(match[1]), units[match[2]]  # type: ignore[index]
        except (TypeError, ValueError, KeyError):
            raise InvalidArgument(
                f"{name} is {value!r}; give a number, or text with one of the units {known}",
                value=value,
            ) from None
        found = number * factor
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        found = float(value) if abs(value) < _GREATEST else math.inf
    else:
        raise InvalidArgument(f"{name} is {shown(value)}; give a number or text", value=value)
    if not 0 < found < _GREATEST:
        raise InvalidArgument(
            f"{name} is {value!r}; it must be positive and below 1e9", value=value
        )
    if units is TIME and found < 1e-9:
        raise InvalidArgument(f"{name} is {value!r}; the shortest is 1 ns", value=value)
    return found


def _check_severity(given: Mapping[str, Severity]) -> None:
    if not isinstance(given, Mapping):
        raise TypeError(f"severity must map event kinds to severities, got {shown(given)}")
    for kind, severity in given.items():
        check_word("severity", kind, EVENT_KINDS)
        check_word("severity", severity, get_args(Severity))


def _check_contradictions(
    edges: Sequence[Expectation], authorities: Sequence[AuthorityExpectation]
) -> None:
    """Refuse two expectations of one subject. The error's `index` is that of the second."""
    parents: dict[str, str] = {}
    pairs: set[tuple[str, str]] = set()
    for index, each in enumerate(edges):
        if each.liveliness and not each.authority:
            text = f"liveliness of {each.parent} -> {each.child} needs an authority; name one"
            raise InvalidArgument(text, index=index)
        for kind in CLOCKS:
            if kind in each.severity:
                text = f"{kind} is an event of all edges; set its severity in the default"
                raise InvalidArgument(text, index=index)
        if (each.parent, each.child) in pairs:
            text = f"edge {each.parent} -> {each.child} has two expectations; combine them"
            raise InvalidArgument(text, index=index)
        pairs.add((each.parent, each.child))
        if each.is_exact and parents.setdefault(each.child, each.parent) != each.parent:
            text = (
                f"{each.child} is expected with two parents, {parents[each.child]} and "
                f"{each.parent}; a frame has one parent"
            )
            raise InvalidArgument(text, index=index)
    names = [each.name for each in authorities]
    if len(set(names)) < len(names):
        twice = _first_twice(names)
        index = names.index(twice, names.index(twice) + 1)
        raise InvalidArgument(f"authority {twice} has two expectations; combine them", index=index)


def _first_twice(names: Sequence[str]) -> str:
    return next(name for name in names if names.count(name) > 1)


belong_to("tfdb", globals(), ("Expectations",))
belong_to("tfdb.judging", globals(), ("AuthorityExpectation", "Expectation", "Limits"))

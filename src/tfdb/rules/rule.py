"""The class Rule: its subjects, its condition, and its action."""

from __future__ import annotations

import inspect
from threading import TIMEOUT_MAX
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypedDict, TypeVar, cast

from tfdb._core import duration_to_nanoseconds, to_nanoseconds
from tfdb.data.argument_checks import (
    check_callable,
    check_count,
    check_flag,
    check_name,
    check_word,
)
from tfdb.data.errors import InvalidArgument
from tfdb.data.lazy_names import belong_to
from tfdb.data.stamps import shown

from .stats import RuleStats

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from tfdb._core import Policy, Transform
    from tfdb.data.stamps import StampLike

__all__ = ["Rule", "RuleOptions"]

Subject: TypeAlias = str | tuple[str, str]
"""A frame, a pair (target, source), or `"*"`."""

Fires: TypeAlias = Literal["rises", "falls", "changes", "always"]
Action = TypeVar("Action", bound="Callable[..., object]")

EVERY = "*"


class RuleOptions(TypedDict, total=False):
    """Options of a rule: when it fires, and how its action runs.

    Parameters
    ----------
    name
        Name in logs and in `Event.chain`. Default: the name of the function.
    fires
        `rises` (default for pairs): the condition was False at the previous evaluation, and is
        True. `falls`: the reverse. `changes`: it is True, and the pair's transform differs from the
        previous one. `always` (default for frames): it is True.
    policy
        Policy for the lookup of the pair.
    at
        Stamp for the lookup of the pair; None: the latest common time.
    initial
        Whether the rule fires if the condition of a pair is True at installation. Default: False.
    retries
        How often an action with a transaction runs again after a Conflict. Default: 3.
    serial
        Rules with the same name here run one at a time, in the order of commits, then of
        installation.
    overlap
        Whether the action may run several times at once, in any order. Default: one at a time, in
        commit order.
    max_depth
        Longest chain of rules that may lead to an event. Default: 16. A longer one is a RuleCycle.
    max_pending
        Largest number of events that wait for the action. Default: 1000.
    keep
        Which events stay if more than `max_pending` wait. Default: `newest`.
    debounce
        The action begins with the newest event, once no event has come for this many seconds.
    max_rate
        Largest number of actions per second, each with the newest event.
    """

    name: str
    fires: Fires
    policy: Policy | None
    at: StampLike | None
    initial: bool
    retries: int
    serial: str
    overlap: bool
    max_depth: int
    max_pending: int
    keep: Literal["newest", "oldest"]
    debounce: float
    max_rate: float


class Rule:
    """A rule of a buffer, from `Buffer.rule` or `Buffer.add_rule`."""

    def __init__(
        self,
        action: Callable[..., object],
        on: Subject | Iterable[Subject],
        when: Callable[[Any], object] | None = None,
        *,
        name: str | None = None,
        fires: Fires | None = None,
        policy: Policy | None = None,
        at: StampLike | None = None,
        initial: bool = False,
        retries: int = 3,
        serial: str | None = None,
        overlap: bool = False,
        max_depth: int = 16,
        max_pending: int = 1000,
        keep: str = "newest",
        debounce: float | None = None,
        max_rate: float | None = None,
    ) -> None:
        check_callable("a rule's action", action)
        if when is not None:
            check_callable("when", when)
        self.on: tuple[Subject, ...] = subjects_of(on)
        """The pairs, the frames, or `"*"`."""
        self.name: str = _name_of(action, name)
        """Its name in logs and in `Event.chain`."""
        self.fires: Fires = _fires_of(fires, is_of_pairs=isinstance(self.on[0], tuple))
        """When it fires."""
        self.stats: RuleStats = RuleStats()
        """Its counts and durations."""
        self._action = action
        self._wants_transaction = _takes_transaction(action)
        self._when = when
        self._policy = policy
        self._at = None if at is None else to_nanoseconds(at)
        self._initial = check_flag("initial", initial)
        if isinstance(self.on[0], str) and (initial or at is not None or policy is not None):
            raise InvalidArgument("policy, at and initial are valid for pairs only", value=on)
        self._retries = _count_from_0("retries", retries)
        self._serial = None if serial is None else check_name("serial", serial)
        self._overlap = check_flag("overlap", overlap)
        if self._overlap and serial is not None:
            raise InvalidArgument("give serial or overlap, not both", value=serial)
        self._max_depth = _count_from_0("max_depth", max_depth)
        self._max_pending = check_count("max_pending", max_pending)
        self._keeps_newest = check_word("keep", keep, ("newest", "oldest")) == "newest"
        self._debounce = (
            0.0 if debounce is None else duration_to_nanoseconds(debounce, "debounce") / 1e9
        )
        # Threads can wait no longer than TIMEOUT_MAX.
        self._interval = min(0.0 if max_rate is None else 1 / _rate(max_rate), TIMEOUT_MAX)
        self._merges = debounce is not None or max_rate is not None
        self._remove: Callable[[Rule], None] | None = None  # set while the rule is installed
        self._order = 0  # number of the installation
        self._seen = 0  # the commit up to which it was evaluated
        self._truths: dict[Subject, bool] = {}
        self._answers: dict[Subject, Transform | None] = {}
        self._began = float("-inf")  # time of the last action, by time.monotonic

    @property
    def removed(self) -> bool:
        """Whether the rule was removed, or its buffer closed."""
        return self._remove is None

    def remove(self) -> None:
        """Remove the rule. After this call, no action of it begins.

        A running action continues; it may call this method itself. A second call does nothing.
        """
        if (remove := self._remove) is not None:
            remove(self)

    def __repr__(self) -> str:
        ended = ", removed" if self.removed else ""
        return f"<tfdb.rules.Rule {self.name!r} on {', '.join(map(str, self.on))}{ended}>"


def _fires_of(fires: Fires | None, *, is_of_pairs: bool) -> Fires:
    if fires is None:
        return "rises" if is_of_pairs else "always"
    if fires == "changes" and not is_of_pairs:
        raise InvalidArgument(
            'fires="changes" is valid for pairs only: for frames, every commit is a change'
        )
    checked: Fires = check_word("fires", fires, ("rises", "falls", "changes", "always"))
    return checked


def _name_of(action: Callable[..., object], name: str | None) -> str:
    if name is not None:
        return check_name("name", name)
    return str(getattr(action, "__name__", "rule"))


def subjects_of(on: object) -> tuple[Subject, ...]:
    """Return the pairs, or the frames, without duplicates."""
    if isinstance(on, str) or _is_pair(on):
        return (cast("Subject", on),)
    try:
        subjects = tuple(dict.fromkeys(on))  # type: ignore[call-overload]
    except TypeError:
        subjects = ()
    frames = all(isinstance(subject, str) for subject in subjects)
    alone = EVERY not in subjects or len(subjects) == 1
    if subjects and alone and (frames or all(map(_is_pair, subjects))):
        return subjects
    raise InvalidArgument(
        f"on must be a pair (target, source), a frame, a list of either, or '*', got {shown(on)}",
        value=on,
    )


def _is_pair(subject: object) -> bool:
    return (
        isinstance(subject, tuple)
        and len(subject) == 2
        and all(isinstance(name, str) for name in subject)
    )


def _takes_transaction(action: Callable[..., object]) -> bool:
    """Whether the action has a second required parameter, so that it gets a transaction."""
    is_later = (
        inspect.iscoroutinefunction,
        inspect.isgeneratorfunction,
        inspect.isasyncgenfunction,
    )
    if any(kind(action) for kind in is_later):
        raise TypeError(
            "a rule's action must be a plain function, neither async def nor a generator"
        )
    try:
        signature = inspect.signature(action)
    except (TypeError, ValueError):
        return False
    for given in (1, 2):
        try:
            signature.bind(*range(given))
        except TypeError:
            continue
        return given == 2
    raise InvalidArgument(
        "a rule's action takes an event, or an event and a transaction: fn(event), fn(event, tx)",
        value=action,
    )


def _count_from_0(name: str, value: Any) -> int:
    if isinstance(value, bool | float) or (isinstance(value, int) and value < 0):
        raise InvalidArgument(
            f"{name} must be an integer of at least 0, got {shown(value)}", value=value
        )
    return 0 if value == 0 else check_count(name, value)


def _rate(value: Any) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not 0 < value < float("inf"):
        raise InvalidArgument(
            f"max_rate must be above 0, in firings per second, got {shown(value)}", value=value
        )
    return float(value)


belong_to("tfdb.rules", globals(), __all__)

"""Running many points in turns: all engines of one round, then the next round."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from tfdb import InvalidArgument

from . import programs
from .points import SWEEPS, TF2, Point

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

    from .points import Sweep, Value
    from .results import Results

_HUMANOID = 32
_SLACK = 90.0  # seconds that filling, checking and starving threads may take on top


@dataclass(frozen=True)
class Turn:
    """One run to be made."""

    sweep: str
    label: str
    round: int
    point: Point


@dataclass
class Plan:
    """What is to be measured, in which order."""

    engines: Sequence[str]
    sweeps: Sequence[Sweep]
    base: Mapping[str, Value]
    rounds: int
    failures: list[str] = field(default_factory=list)

    def turns(self) -> Iterator[Turn]:
        """Return every run; the rounds of a sweep follow each other, so that it ends complete."""
        for sweep in self.sweeps:
            points = sweep.points(self.engines, self.base)
            for number in range(1, self.rounds + 1):
                for label, point in points:
                    yield Turn(sweep.name, label, number, point)

    def count(self) -> int:
        """Return how many runs there are."""
        return sum(1 for _ in self.turns())

    def check(self) -> None:
        """Raise `DriverMissing` or `InvalidArgument` before anything is measured or written."""
        for engine in self.engines:
            programs.driver(engine)
        for turn in self.turns():
            _check_point(turn)

    def run(self, results: Results, progress: Callable[[int, Turn], None] | None = None) -> None:
        """Measure; a point that fails is noted in `failures` and the rest goes on."""
        for done, turn in enumerate(self.turns()):
            if progress is not None:
                progress(done, turn)
            try:
                found = programs.run(turn.point, limit=_limit(turn.point))
                results.add(turn.sweep, turn.label, turn.round, turn.point.engine, found)
            except programs.DriverFailed as error:
                self.failures.append(f"{turn.sweep} {turn.label}, {turn.point.engine}: {error}")
            if progress is not None:
                progress(done + 1, turn)


def _check_point(turn: Turn) -> None:
    """Refuse what does not go together; what the options alone can tell is refused before."""
    given = turn.point.parameters
    joints = int(given.get("joints", 1_000))
    for name in ("read-length", "write-length"):
        length = int(given.get(name, 16))
        if length > joints:
            message = (
                f"sweep {turn.sweep}, {turn.label}: --{name} {length} needs --joints {length} or "
                f"more, not {joints}"
            )
            raise InvalidArgument(message, value=length, limit=joints)
    if given.get("tree") == "humanoid" and joints < _HUMANOID:
        message = f"sweep {turn.sweep}: a humanoid has {_HUMANOID} joints, --joints gives {joints}"
        raise InvalidArgument(message, value=joints, limit=_HUMANOID)
    transactions = given.get("reads") == "transaction" or given.get("writes") == "modify"
    if turn.point.engine == TF2 and transactions:
        message = "tf2 has no transactions: leave it out of --engines, or give --reads lookup and "
        raise InvalidArgument(f"{message}--writes batch or single", value=TF2)


def _limit(point: Point) -> float:
    seconds = float(point.parameters.get("seconds", 1.0))
    return seconds + float(point.parameters.get("warmup", 0.1)) + _SLACK


def plan(
    engines: Sequence[str],
    sweeps: Sequence[str],
    base: Mapping[str, Value],
    *,
    rounds: int,
    quick: bool,
) -> Plan:
    """Make a plan of named sweeps."""
    chosen = [SWEEPS[name].quick() if quick else SWEEPS[name] for name in sweeps]
    return Plan(engines, chosen, base, rounds)

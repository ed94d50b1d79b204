"""Rates and delays of columns against those counted one by one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tfdb.judging.events import ANOTHER_CLOCK, TIMELY
from tfdb.judging.expectations import AuthorityExpectation, Expectation, Expectations
from tfdb.judging.judge import Judge, Rows
from tfdb.judging.rates import Delays, Frame, Rates

if TYPE_CHECKING:
    from collections.abc import Sequence

S = 10**9
Sample = tuple[str, str, str, int, int, bool]
"""Parent, child, authority, stamp, arrival, and whether it is static."""


def rows_of(judge: Judge, samples: Sequence[Sample]) -> Rows:
    parents, children, authorities, stamps, arrivals, static = zip(*samples, strict=True)
    return Rows(
        np.array(arrivals),
        judge.number_edges(parents, children),
        judge.number_authorities(authorities),
        np.array(stamps),
        np.zeros((len(samples), 7)),
        np.array(static),
    )


def delays_of(samples: Sequence[Sample], gap: int, *, apart: bool) -> Delays:
    """Those of some samples, counted one by one."""
    moving = [each[4] - each[3] for each in samples if not each[5]]
    timed = [delay for delay in moving if abs(delay) < ANOTHER_CLOCK]
    nearest = min(moving, key=abs, default=None)
    if apart or not timed:
        return Delays(len(samples), None, None, gap, nearest)
    return Delays(len(samples), sum(timed) // len(timed), max(timed), gap, nearest)


def gap_of(samples: Sequence[Sample], counted: int) -> int:
    """The longest gap before one of the last `counted` samples."""
    newest, gaps = -1, [0]
    for number, (_, _, _, stamp, _, static) in enumerate(samples):
        if not static:
            if newest >= 0 and number >= len(samples) - counted:
                gaps.append(stamp - newest)
            newest = max(newest, stamp)
    return max(gaps)


def random_samples(rng: np.random.Generator, offset: int) -> list[Sample]:
    made = []
    for arrival in (100 * S + np.sort(rng.integers(0, 60 * S, 300))).tolist():
        child = str(rng.choice(["base", "arm", "camera"]))
        late = 15 * S if rng.random() < 0.1 else 0
        stamp = arrival - int(rng.integers(-S, 2 * S)) - late + S - offset
        parent, authority = str(rng.choice(["map", "odom"])), str(rng.choice(["/a", "/b", ""]))
        made.append((parent, child, authority, stamp, arrival, child == "camera"))
    return made


@pytest.mark.parametrize("offset", [0, 2 * 3600 * S], ids=["one clock", "another clock"])
@pytest.mark.parametrize("seed", range(5))
def test_columns_count_as_their_rows(seed: int, offset: int) -> None:
    rng = np.random.default_rng(seed)
    samples = random_samples(rng, offset)
    judge = Judge(Expectations(), 0)
    rates, at, starts = Rates(judge, 0, 3), 0, [0]
    while at < len(samples):
        beyond = at + int(rng.integers(1, 60))
        rates.add(rows_of(judge, samples[at:beyond]))
        at = min(beyond, len(samples))
        inside = samples[starts[0] : at]
        near = [abs(each[4] - each[3]) for each in inside if not each[5]]
        apart = min(near) > TIMELY
        found = {name: (frame, delays) for name, frame, delays in rates.of_frames()}
        for child in {each[1] for each in samples[:at]}:
            before = [each for each in samples[:at] if each[1] == child]
            mine = [each for each in inside if each[1] == child]
            gap = gap_of(before, len(mine))
            frame, delays = found[child]
            assert delays == delays_of(mine, gap, apart=apart)
            assert (frame.parent, frame.static) == (before[-1][0], child == "camera")
            assert frame.authors == tuple(sorted({each[2] for each in before}))
        for name, delays in rates.of_authors():
            mine = [each for each in inside if each[2] == name]
            assert delays == delays_of(mine, 0, apart=apart)
        if rng.random() < 0.5:
            rates.next_period(at)
            starts = [*starts, at][-3:]
    assert len(starts) == 3


def test_rates_drop_old_samples() -> None:
    judge = Judge(Expectations(), 0)
    rates = Rates(judge, 0, 2)
    for second in range(5):
        stamps = [second * S + part for part in range(second + 1)]
        some: list[Any] = [
            ("map", "base", "it", stamp, stamp + second * 10, False) for stamp in stamps
        ]
        rates.add(rows_of(judge, some))
        ((_, _, delays),) = rates.of_frames()
        assert delays.count == (second + 1) + (second if second else 0)
        assert delays.longest == 10 * second
        assert rates.seconds((second + 1) * S) == (2 if second else 1)
        rates.next_period((second + 1) * S)
    rates.add(rows_of(judge, [("map", "base", "other", 2**60, 0, False)]))
    ((_, of_it), (_, of_other)) = rates.of_authors()
    assert (of_it.count, of_other.count, of_other.mean) == (5, 1, None)


def test_expected_edges_without_samples_have_no_rate() -> None:
    edges = [Expectation("map", "base"), Expectation("map", "arm")]
    judge = Judge(Expectations(edges, [AuthorityExpectation("ekf", 1.0)]), 0)
    rates = Rates(judge, 0, 2)
    assert (list(rates.of_frames()), rates.of_authors()) == ([], [])
    rates.add(rows_of(judge, [("map", "arm", "it", 3, 7, False)]))
    ((name, frame, delays),) = rates.of_frames()
    assert (name, frame, delays.mean) == ("arm", Frame("map", False, ("it",)), 4)
    assert rates.of_authors() == [("it", delays)]


def test_sums_of_delays_do_not_overflow() -> None:
    judge = Judge(Expectations(), 0)
    one = rows_of(judge, [("map", "base", "", 401 * S, 4000 * S, False)])
    rates = Rates(judge, 0, 1)
    rates.add(one.at(np.zeros(3_000_000, dtype=np.int64)))
    rates.add(rows_of(judge, [("map", "timely", "", 4000 * S, 4000 * S, False)]))
    (_, _, delays), _ = rates.of_frames()
    assert delays.count * 3599 * S > 2**63
    assert delays.mean == pytest.approx(3599 * S, rel=1e-9)

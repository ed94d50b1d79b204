"""The judge against a naive one, and each kind of event by a simulated clock."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from tfdb.errors import InvalidArray
from tfdb.judging.events import EVENT_KINDS, Event
from tfdb.judging.expectations import AuthorityExpectation, Expectation, Expectations
from tfdb.judging.judge import Judge, Rows

from .naive_judge import NaiveJudge, Row, S

if TYPE_CHECKING:
    from collections.abc import Sequence

EDGE = ("odom", "base")
START = 1_000_000 * S


def rows_of(judge: Judge, rows: Sequence[Row]) -> Rows:
    return Rows(
        np.array([row.arrival for row in rows], dtype=np.int64),
        judge.number_edges([r.edge[0] for r in rows], [r.edge[1] for r in rows]),
        judge.number_authorities([row.authority for row in rows]),
        np.array([row.stamp for row in rows], dtype=np.int64),
        np.array([row.pose for row in rows]).reshape(len(rows), 7),
        np.array([row.static for row in rows], dtype=bool),
        np.arange(len(rows)),
    )


def row(seconds: float, lag: float = 0.0, x: float = 0.0, **more: Any) -> Row:
    """A sample of EDGE at START and so many seconds."""
    arrival = START + round(seconds * S)
    authority, angle = more.get("authority", "ekf"), more.get("angle", 0.0)
    pose = (x, 0.0, 0.0, 0.0, 0.0, math.sin(angle / 2), math.cos(angle / 2))
    edge = more.get("edge", EDGE)
    return Row(arrival, edge, authority, arrival - round(lag * S), pose, more.get("static", False))


def judged(
    rows: Sequence[Row], until: float, *, clock: str = "stamps", **limits: Any
) -> list[tuple[str, str, float]]:
    """The events of EDGE: kind, severity and seconds after START."""
    expected = Expectations([Expectation(*EDGE, **limits)], clock=clock)  # type: ignore[arg-type]
    judge = Judge(expected, START)
    events = judge.feed(rows_of(judge, rows)) + judge.advance(START + round(until * S))
    return [(e.kind, e.severity, round((e.time - START) / S, 9)) for e in events]


def regular(*times: float, **more: Any) -> list[Row]:
    return [row(time, **more) for time in times]


def test_a_deadline_is_missed_when_it_has_passed() -> None:
    rows = regular(0, 0.1, 0.2)
    assert judged(rows, 0.7, deadline=0.5) == []
    assert judged(rows, 0.700000001, deadline=0.5) == [("deadline", "warning", 0.7)]
    rows = regular(0, 0.1, 1.0, 1.1, 9.0)
    assert judged(rows, 9.0, deadline=0.5) == [
        ("deadline", "warning", 0.6),
        ("deadline", "ok", 1.0),
        ("deadline", "warning", 1.6),
        ("deadline", "ok", 9.0),
    ]


def test_events_count_and_measure() -> None:
    judge = Judge(Expectations([Expectation(*EDGE, deadline=0.5)]), START)
    first, second = judge.feed(rows_of(judge, regular(0, 2.0)))
    assert (first.begins, first.value, first.limit, first.count) == (True, 0.5, 0.5, 1)
    assert (second.begins, second.value, second.since) == (False, 2.0, first.time)
    assert (first.commit, second.commit) == (None, 1)
    (third,) = judge.advance(START + 3 * S)
    assert third.count == 2
    assert list(judge.active.values()) == [third]
    assert str(third) == ("1000002.500000000 warning: odom -> base: deadline 500 ms (limit 500 ms)")
    assert str(second).endswith("ok: odom -> base: deadline 2 s (limit 500 ms), ended after 1.5 s")


def test_an_expected_edge_is_missing_until_it_comes() -> None:
    assert judged([], 1.0) == []
    assert judged([], 1.1) == [("missing", "error", 1.0)]
    assert judged([], 2.1, deadline=2) == [("missing", "error", 2)]
    late = [row(3, static=True)]
    assert judged(late, 99, deadline=0.2) == [("missing", "error", 1), ("missing", "ok", 3)]


def test_an_edge_of_a_pattern_is_not_missing() -> None:
    judge = Judge(Expectations([Expectation("*", "base", deadline=0.1)]), START)
    assert judge.advance(START + 9 * S) == []
    (event,) = judge.feed(rows_of(judge, regular(10, 10.05))) + judge.advance(START + 11 * S)
    assert (event.kind, event.parent, event.child) == ("deadline", *EDGE)


def test_the_age_of_the_newest_stamp_is_the_lifespan() -> None:
    rows = [row(0, 0.1), row(0.1, 0.1), row(0.5, 0.3), row(2.0, 0.1)]
    assert judged(rows, 2.4, lifespan=0.5) == [
        ("lifespan", "stale", 0.7),
        ("lifespan", "ok", 2.0),
    ]
    assert judged([row(0, 0.8), row(0.5, 0.1)], 0.9, lifespan=0.5) == [
        ("lifespan", "stale", 0),
        ("lifespan", "ok", 0.5),
    ]
    assert judged(rows, 2.4, lifespan=0.5, clock="arrival") == [
        ("lifespan", "stale", 1.0),
        ("lifespan", "ok", 2.0),
    ]


@pytest.mark.parametrize("clock", ["stamps", "arrival"])
def test_a_sample_far_behind_does_not_end_the_lifespan(clock: str) -> None:
    rows = [row(0), row(2.0, 3.5), row(2.9, 4.5), row(4.0)]
    assert judged(rows, 4.0, lifespan=0.5, clock=clock) == [
        ("lifespan", "stale", 0.5),
        ("lifespan", "ok", 4.0),
    ]


def test_the_end_of_an_event_has_its_worst_value() -> None:
    rows = [row(0), row(1, 0.9), row(3, 0.9), row(3.2, 0.8), row(3.3)]
    for cut in range(1, 6):
        judge = Judge(Expectations([Expectation(*EDGE, lifespan=0.5)]), START)
        began, ended = (
            judge.feed(rows_of(judge, rows[:cut]))
            + judge.feed(rows_of(judge, rows[cut:]))
            + judge.advance(START + round(3.4 * S))
        )
        assert (began.value, ended.value) == (0.5, 2.9)


def test_a_jump_is_measured_against_the_arrivals() -> None:
    judge = Judge(Expectations(), START)
    rows = regular(0, 1) + regular(20, 20.1, lag=-5)
    assert [event.value for event in judge.feed(rows_of(judge, rows))] == [5.0]


@pytest.mark.parametrize(("ahead", "kinds"), [(1.0, []), (1.000000001, ["time-jump"])])
def test_stamps_may_run_ahead_by_one_second(ahead: float, kinds: list[str]) -> None:
    judge = Judge(Expectations(), START)
    rows = [row(0), row(1), row(3, -ahead)]
    assert [event.kind for event in judge.feed(rows_of(judge, rows))] == kinds


def test_an_edge_that_becomes_static_is_not_waited_for() -> None:
    limits: dict[str, Any] = {"deadline": 0.5, "lifespan": 0.8}
    still = row(0.4, static=True)
    assert judged([row(0), still], 9, **limits) == []
    late = row(2.0, static=True)
    assert judged([row(0), late], 9, **limits) == [
        ("deadline", "warning", 0.5),
        ("lifespan", "stale", 0.8),
        ("lifespan", "ok", 2.0),
        ("deadline", "ok", 2.0),
    ]
    assert judged([row(0), still, row(0.6)], 1.2, **limits) == [("deadline", "warning", 1.1)]
    assert judged([still, row(0.6), row(0.7, static=True)], 9, **limits) == []


@pytest.mark.parametrize("longer_first", [False, True])
def test_an_authority_of_two_edges_is_alive_by_the_shorter_limit(longer_first: bool) -> None:
    edges = [
        Expectation("map", "odom", authority="ekf", liveliness=1),
        Expectation(*EDGE, authority="ekf", liveliness=3, severity={"liveliness": "ok"}),
    ]
    judge = Judge(Expectations(edges[::-1] if longer_first else edges), START)
    events = judge.feed(rows_of(judge, regular(0))) + judge.advance(START + 2 * S)
    alive = [event for event in events if event.kind == "liveliness"]
    assert [(e.time - START, e.severity) for e in alive] == [(S, "error")]


def test_an_authority_is_alive_by_its_commits_on_any_edge() -> None:
    other = ("map", "odom")
    rows = [row(0), row(0.8, edge=other), row(1.6), row(4, edge=other), row(4.1, authority="x")]
    assert judged(rows, 4.5, liveliness=1.0, authority="ekf") == [
        ("liveliness", "error", 2.6),
        ("liveliness", "ok", 4.0),
        ("foreign-authority", "error", 4.1),
    ]
    never = Judge(Expectations((), [AuthorityExpectation("ekf", 2.0)]), START)
    (event,) = never.advance(START + 5 * S)
    assert (event.kind, event.authority, event.time) == ("liveliness", "ekf", START + 2 * S)


def test_authorities_by_strength() -> None:
    rows = [row(0), row(0.1, authority="wheels"), row(0.2, authority="wheels"), row(0.3)]
    assert judged(rows, 1.3, authority=["ekf", "wheels"]) == [
        ("failover", "warning", 0.1),
        ("failover", "ok", 1.2),
    ]
    assert judged([row(0, authority="")], 9, authority=["ekf"]) == []


@pytest.mark.parametrize(
    ("limits", "kind", "value"),
    [
        ({"max_step": 0.3}, "step", 1.0),
        ({"max_speed": 2.0}, "speed", 10.0),
        ({"max_turn": "30deg"}, "turn", 1.5),
    ],
)
def test_a_motion_beyond_a_limit(limits: dict[str, Any], kind: str, value: float) -> None:
    judge = Judge(Expectations([Expectation(*EDGE, **limits)]), START)
    rows = [row(0), row(0.1, x=1.0, angle=1.5), row(0.2, x=1.01, angle=1.51)]
    began, ended = judge.feed(rows_of(judge, rows)) + judge.advance(START + 2 * S)
    assert (began.kind, ended.kind) == (kind, kind)
    assert (began.time - START, ended.time - START) == (S // 10, S // 10 + S)
    assert began.value == pytest.approx(value)


def test_samples_that_keep_breaking_a_limit_are_one_event() -> None:
    rows = [row(i / 10, x=i % 2) for i in range(100)]
    assert judged(rows, 20, max_step=0.5) == [("step", "error", 0.1), ("step", "ok", 10.9)]


def test_late_samples() -> None:
    rows = [row(0), row(0.1), row(0.2, 0.15), row(0.3)]
    assert judged(rows, 0.3, max_late=0.04) == [("late", "warning", 0.2)]
    assert judged(rows, 0.3, max_late=0.05) == []
    # Far behind, it may be a jump of the clock: reported with the next sample that is on time.
    far = [row(9.0), row(9.1), row(9.2, 3), row(9.3), row(9.4, 3), row(9.5)]
    assert judged(far, 9.5)[2:] == []  # one on time between two: no jump
    rows = [row(9.0), row(9.1), row(9.2, 3), row(9.3, 3), row(9.4)]
    assert judged(rows, 9.4, max_late=0.5) == [
        ("missing", "error", 1),
        ("missing", "ok", 9),
        ("late", "warning", 9.4),
    ]


def test_a_clock_that_jumps_is_one_event() -> None:
    edges = [("map", f"frame{i}") for i in range(200)]
    limits = {"max_late": 0.1, "max_speed": 5.0, "lifespan": 1.0, "deadline": 0.5}
    judge = Judge(Expectations(default=Expectation(**limits)), START)
    rows = []
    for i in range(100):
        lag = 0.02 if i < 50 else -30.0 if i < 60 else 20.0
        rows += [row(20 + i / 20, lag, x=lag, edge=edge) for edge in edges]
    began, ended = judge.feed(rows_of(judge, rows)) + judge.advance(START + 25 * S)
    assert (began.kind, began.severity, began.count) == ("time-jump", "error", 1)
    assert began.time == START + round(22.5 * S)
    # Backwards, the third sample tells a jump from late ones.
    assert (ended.kind, ended.time, ended.count) == ("time-jump", START + round(24.1 * S), 400)


def test_stamps_of_another_clock_are_one_event() -> None:
    rows = [row(i / 10, 900_000, edge=("map", str(k))) for i in range(9) for k in range(50)]
    judge = Judge(Expectations(default=Expectation(lifespan=0.5, max_late=0.1)), START)
    (event,) = judge.feed(rows_of(judge, rows))
    assert (event.kind, event.subject, event.child) == ("two-clocks", "clock", "0")
    assert event.value == 900_000


def test_time_that_goes_back_is_a_time_jump() -> None:
    judge = Judge(Expectations(default=Expectation(deadline=0.5)), START)
    assert judge.feed(rows_of(judge, regular(100, 100.1))) == []
    (event,) = judge.advance(START + 50 * S)
    assert (event.kind, event.value) == ("time-jump", 50.1)
    (missed,) = judge.advance(START + round(50.6 * S))
    assert (missed.kind, missed.time) == ("deadline", START + round(50.5 * S))


@pytest.mark.parametrize(("back", "kinds"), [(S, []), (S + 1, ["time-jump"])])
def test_only_more_than_one_second_back_is_a_time_jump(back: int, kinds: list[str]) -> None:
    judge = Judge(Expectations(), START)
    judge.advance(START + 9 * S)
    assert [event.kind for event in judge.advance(START + 9 * S - back)] == kinds


def test_a_cleared_frame_begins_anew() -> None:
    for forget, kinds in ((True, []), (False, ["time-jump"])):
        judge = Judge(Expectations(), START)
        judge.feed(rows_of(judge, regular(100, 100.1)))
        if forget:
            judge.forget({"base"})
        events = judge.feed(rows_of(judge, [row(100.2 + i / 10, 90) for i in range(4)]))
        assert [event.kind for event in events] == kinds


def test_the_worst_events_come_first() -> None:
    """By severity, then by kind, then by time."""
    made = [
        Event("late", "stale", True, 9, 9),
        Event("missing", "error", True, 5, 5),
        Event("deadline", "error", True, 3, 3),
        Event("deadline", "error", True, 4, 4),
        Event("lifespan", "warning", True, 2, 2),
        Event("time-jump", "ok", True, 1, 1),
    ]
    backwards = made[::-1]
    assert sorted(backwards, key=lambda event: event.rank) == made


@pytest.mark.parametrize(("lag", "times"), [(0.0, [0.5]), (0.4, [0.2]), (900_000.0, [])])
def test_a_later_lifespan_counts_from_the_newest_stamp(lag: float, times: list[float]) -> None:
    """It counts from the change if it ended before, and not at all by another clock."""
    judge = Judge(Expectations(), START)
    judge.feed(rows_of(judge, [row(0, lag)]))
    judge.change(Expectations([Expectation(*EDGE, lifespan=0.5)]), START + S // 5)
    events = judge.advance(START + S)
    found = [(e.time - START) / S for e in events if e.kind == "lifespan"]
    assert found == times


def test_severities() -> None:
    rows = regular(0, 2)
    assert judged(rows, 2, deadline=1, severity={"deadline": "stale"})[0][1] == "stale"


def test_a_batch_out_of_order_is_refused() -> None:
    judge = Judge(Expectations(), START)
    with pytest.raises(InvalidArray, match="sort the rows by arrival"):
        judge.feed(rows_of(judge, regular(1, 0)))


def random_expectations(rng: np.random.Generator) -> Expectations:
    def maybe(value: float) -> float | None:
        return value if rng.random() < 0.7 else None

    def limits() -> dict[str, Any]:
        return {
            "deadline": maybe(0.2),
            "lifespan": maybe(0.3),
            "max_step": maybe(0.5),
            "max_speed": maybe(5.0),
            "max_turn": maybe(0.5),
            "max_late": maybe(0.1),
            "authority": ["a", "b"] if rng.random() < 0.5 else (),
        }

    edges = [Expectation("map", "0", **limits()), Expectation("map", "*", **limits())]
    alive = [AuthorityExpectation("a", 0.2), AuthorityExpectation("*", 1.0)]
    clock = "stamps" if rng.random() < 0.7 else "arrival"
    return Expectations(edges, alive, Expectation(**limits()), clock)  # type: ignore[arg-type]


def random_rows(rng: np.random.Generator, count: int) -> list[Row]:
    """Samples of a few edges that are late, stall, jump, and go back in time."""
    now, offset, made = 0.0, 0.0, []
    for _ in range(count):
        now += float(
            rng.choice([0, 0.01, 0.05, 0.1, 0.4, 3.0], p=[0.3, 0.3, 0.2, 0.15, 0.04, 0.01])
        )
        if rng.random() < 0.005:
            offset = float(rng.choice([0, 5, -5, 7200]))
        lag = offset + float(rng.choice([0, 0.05, 0.15, 1.5], p=[0.7, 0.2, 0.08, 0.02]))
        edge = str(rng.choice(["map", "odom"], p=[0.9, 0.1])), str(rng.integers(0, 4))
        x = float(rng.choice([0, 0.1, 1.0], p=[0.6, 0.3, 0.1]))
        angle = float(rng.choice([0, 0.1, 1.0], p=[0.6, 0.3, 0.1]))
        authority = str(rng.choice(["a", "b", "c", ""], p=[0.7, 0.1, 0.1, 0.1]))
        static = bool(rng.random() < 0.05)
        made.append(row(now, lag, x, angle=angle, edge=edge, authority=authority, static=static))
    return made


def told(judge: Judge, events: Sequence[Event]) -> list[tuple[Any, ...]]:
    made = []
    for e in events:
        edge = (e.parent, e.child) if e.child else e.authority
        subject: Any = "clock" if e.subject == "clock" else edge
        value = 0.0 if e.value is None else round(e.value, 9)
        made.append((e.time, e.kind, e.begins, subject, value, e.count))
    return made


@pytest.mark.parametrize("seed", range(60))
def test_events_are_those_of_a_naive_judge(seed: int) -> None:
    print(f"seed {seed}")
    rng = np.random.default_rng(seed)
    expected, rows = random_expectations(rng), random_rows(rng, 400)
    naive = NaiveJudge(expected, START)
    for each in rows:
        naive.feed(each)
    end = rows[-1].arrival + 5 * S
    naive.advance(end)
    wanted = [(t, k, b, s, round(v, 9), c) for t, k, b, s, v, c in naive.events]
    judge = Judge(expected, START)
    found = judge.feed(rows_of(judge, rows)) + judge.advance(end)
    assert told(judge, found) == wanted
    assert len(wanted) > 20
    # Cut anywhere, with the time told in between.
    judge, parts, at = Judge(expected, START), [], 0
    while at < len(rows):
        beyond = at + int(rng.choice([1, 2, 7, 50]))
        parts += judge.feed(rows_of(judge, rows[at:beyond]))
        if beyond < len(rows) and rng.random() < 0.5:
            between = int(rng.integers(rows[beyond - 1].arrival, rows[beyond].arrival + 1))
            parts += judge.advance(between)
        at = beyond
    parts += judge.advance(end)
    assert told(judge, parts) == wanted


def test_random_streams_have_every_kind_of_event() -> None:
    kinds = set()
    for seed in range(20):
        rng = np.random.default_rng(seed)
        judge = Judge(random_expectations(rng), START)
        kinds |= {event.kind for event in judge.feed(rows_of(judge, random_rows(rng, 400)))}
    assert kinds == set(EVENT_KINDS)

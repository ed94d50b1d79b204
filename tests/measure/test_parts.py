"""Parts of `tfdb bench` whose faults would stay unnoticed."""

from __future__ import annotations

from itertools import pairwise

import pytest

import tfdb
from tfdb_measure import model, points, report
from tfdb_measure.model import Costs
from tfdb_measure.results import Results

RESULT = {
    "reads_done": 10,
    "writes_done": 5,
    "retries": 2,
    "lapped_reads": 1,
    "reads_lost": 0,
    "writes_lost": 0,
    "reads_per_s": 100.0,
    "writes_per_s": 50.0,
}


def test_points_of_a_sweep_override_the_base_and_not_the_other_way_round() -> None:
    sweep = points.SWEEPS["readers"]
    made = sweep.points(["giant"], {"threads": 99, "read-ratio": 0.1, "joints": 7})
    assert [label for label, _ in made] == ["1", "2", "4", "8", "16"]
    words = made[2][1].arguments()
    pairs = dict(zip(words[::2], words[1::2], strict=True))
    assert pairs == {"--engine": "giant", "--threads": "4", "--read-ratio": "1", "--joints": "7"}


def test_flags_have_no_value_and_tf2_no_engine() -> None:
    assert points.Point("tf2", {"no-pin": True, "no-batch": False}).arguments() == ["--no-pin"]


def test_quick_keeps_known_labels() -> None:
    for sweep in points.SWEEPS.values():
        assert set(sweep.short) <= set(sweep.varied)
        assert set(sweep.quick().varied) <= set(sweep.varied)


def test_choices() -> None:
    assert points.choose_engines("all") == points.ENGINES
    assert points.choose_engines(" silo, tf2,silo") == ("silo", "tf2")
    with pytest.raises(tfdb.InvalidArgument, match="2pl-wait-die"):
        points.choose_engines("2pl")


def test_medians_and_derived_columns() -> None:
    results = Results()
    for turn, reads in enumerate((300.0, 100.0, 200.0), start=1):
        results.add("threads", "2", turn, "silo", {**RESULT, "reads_per_s": reads})
    spread = results.get("threads", "2", "silo", "reads_per_s")
    assert spread is not None
    assert (spread.median, spread.low, spread.high) == (200.0, 100.0, 300.0)
    assert results.median("threads", "2", "silo", "aborts_per_operation") == 3 / 15
    assert results.median("threads", "2", "silo", "aborts_per_write") == 3 / 5
    assert results.median("threads", "2", "silo", "nonsense") is None
    assert results.get("threads", "4", "silo", "reads_per_s") is None


def test_a_rate_without_operations_is_missing() -> None:
    results = Results()
    nothing = {**RESULT, "reads_done": 0, "writes_done": 0}
    results.add("threads", "2", 1, "silo", nothing)
    assert results.get("threads", "2", "silo", "aborts_per_operation") is None


@pytest.mark.parametrize(
    ("value", "text"),
    [(0, "0"), (1234567, "1.23 M"), (1234, "1,234"), (1.234, "1.23"), (1e-5, "1.0e-05")],
)
def test_numbers_keep_three_digits(value: float, text: str) -> None:
    assert report.number(value) == text


def test_labels_are_spread_out_and_stay_in_order() -> None:
    figures = pytest.importorskip("tfdb_measure.figure_parts")
    for heights in ([0.5] * 8, [0.0, 0.01, 0.5, 0.98, 0.99, 1.0], [0.3], []):
        placed = figures.spread_out(heights, 0.06)
        assert all(b - a >= 0.06 - 1e-9 for a, b in pairwise(placed))
        assert all(height <= 1.0 + 1e-9 for height in placed)
    assert figures.spread_out([0.1, 0.5], 0.06) == [0.1, 0.5]


@pytest.mark.parametrize(
    ("value", "text"), [(1e6, "1M"), (999.99, "1k"), (1500, "1.5k"), (0.05, "0.05")]
)
def test_short_numbers(value: float, text: str) -> None:
    figures = pytest.importorskip("tfdb_measure.figure_parts")
    assert figures.short(value) == text


def measured(engine: str, alone: float, pair: float) -> Costs:
    return Costs(engine, alone, pair, edges=16, beside_reads=1e6, beside_writes=2e5)


def test_model_passes_through_the_points_that_it_was_fitted_to() -> None:
    for engine in points.ENGINES:
        costs = measured(engine, 4e6, 6e6)
        assert costs.reads(1) == pytest.approx(4e6)
        assert costs.reads(2) == pytest.approx(6e6)
        assert costs.half_and_half(2) == pytest.approx((1e6, 2e5))


def test_the_model_has_a_serial_share() -> None:
    serial = measured("tf2", 1e6, 0.8e6)
    assert {serial.reads(threads) for threads in range(2, 17)} == {0.8e6}
    free = measured("snapshot", 4e6, 8e6)
    assert free.serial_share == 0
    assert free.reads(16) == pytest.approx(64e6)
    assert free.half_and_half(16) == pytest.approx((8e6, 2e5))
    lines = measured("2pl-no-wait", 4e6, 4e6)
    # t(1) = 250 ns, t(2) = 500 ns: half of 16 lines moved in 250 ns.
    assert lines.line_ns == pytest.approx(2 * 250 / 16)
    assert lines.reads(16) == pytest.approx(16 / (250e-9 + 16 * 31.25e-9 * 15 / 16))


def test_model_takes_no_gain_from_noise() -> None:
    for engine in ("snapshot", "fine"):
        lucky = measured(engine, 4e6, 9e6)
        assert lucky.reads(16) == pytest.approx(64e6)


def test_the_model_omits_unmeasured_points() -> None:
    results = Results()
    results.add("readers", "1", 1, "silo", {**RESULT, "edges_per_read": 16})
    assert model.costs(results) == []
    results.add("readers", "2", 1, "silo", {**RESULT, "edges_per_read": 16})
    (found,) = model.costs(results)
    assert found.half_and_half(4) is None

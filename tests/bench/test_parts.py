"""The parts under `tfdb bench` that can be wrong without anybody noticing."""

from __future__ import annotations

from itertools import pairwise

import pytest

import tfdb
from tfdb.bench import points, report
from tfdb.bench.results import Results

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


def test_medians_and_what_is_made_of_columns() -> None:
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


def test_nothing_done_is_no_number() -> None:
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
    figures = pytest.importorskip("tfdb.bench.figures")
    for heights in ([0.5] * 8, [0.0, 0.01, 0.5, 0.98, 0.99, 1.0], [0.3], []):
        placed = figures.spread_out(heights, 0.06)
        assert all(b - a >= 0.06 - 1e-9 for a, b in pairwise(placed))
        assert all(height <= 1.0 + 1e-9 for height in placed)
    assert figures.spread_out([0.1, 0.5], 0.06) == [0.1, 0.5]


@pytest.mark.parametrize(
    ("value", "text"), [(1e6, "1M"), (999.99, "1k"), (1500, "1.5k"), (0.05, "0.05")]
)
def test_short_numbers(value: float, text: str) -> None:
    figures = pytest.importorskip("tfdb.bench.figures")
    assert figures.short(value) == text

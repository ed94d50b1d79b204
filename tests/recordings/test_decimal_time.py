"""Conversion of stamps from and to decimal text."""

from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tfdb.data.decimal_time import MAX_STAMP, integer_ns, ns_to_seconds, seconds_to_ns

stamps = st.integers(0, MAX_STAMP)


@pytest.mark.parametrize(
    ("text", "stamp"),
    [
        ("0", 0),
        ("12", 12_000_000_000),
        ("12.5", 12_500_000_000),
        (".5", 500_000_000),
        ("7.", 7_000_000_000),
        ("+1.25", 1_250_000_000),
        ("1311868163.8697", 1_311_868_163_869_700_000),
        ("1.037359e-01", 103_735_900),
        ("1.403636579763555584e+09", 1_403_636_579_763_555_584),
        ("2305843009.213693951", MAX_STAMP),
        ("-0.0", 0),
        ("1e-40", 0),
        # Digits below a nanosecond, as floats print them: rounded to nearest, ties to even.
        ("0.0000000014999", 1),
        ("0.0000000025", 2),
        ("0.0000000035", 4),
    ],
)
def test_seconds(text: str, stamp: int) -> None:
    assert seconds_to_ns(text) == stamp


@pytest.mark.parametrize(
    "text",
    ["", ".", "-1", "-0.1", "nan", "inf", "1_0", "1,5", "0x10", "1e", "12 ", "٣", "1.²", "--1"],
)
def test_no_seconds(text: str) -> None:
    with pytest.raises(ValueError, match=r"not a number|negative"):
        seconds_to_ns(text)


@pytest.mark.parametrize("text", ["2305843009.213693952", "1e999999999", "9" * 5000, "1e400"])
def test_too_many_seconds(text: str) -> None:
    with pytest.raises(ValueError, match="beyond the greatest stamp"):
        seconds_to_ns(text)


@pytest.mark.parametrize("text", ["", "1.0", "-1", "1e3", "1_0", "²", str(2**61), "9" * 5000])
def test_no_integer(text: str) -> None:
    with pytest.raises(ValueError, match=r"not an integer|beyond"):
        integer_ns(text)


@given(stamps)
def test_round_trip(stamp: int) -> None:
    assert seconds_to_ns(ns_to_seconds(stamp)) == stamp
    assert integer_ns(str(stamp)) == stamp


@given(stamps, st.integers(0, 12))
def test_every_notation_of_a_number_means_the_same(stamp: int, shift: int) -> None:
    shifted = Decimal(stamp).scaleb(-9 - shift)
    assert seconds_to_ns(f"{shifted:f}e{shift}") == stamp


@given(st.decimals(0, 2_300_000_000, places=15))
def test_nearest_nanosecond(seconds: Decimal) -> None:
    assert abs(Decimal(seconds_to_ns(str(seconds))) - seconds * 10**9) <= Decimal("0.5")

"""Times from text: exact, or refused with a hint."""

from __future__ import annotations

import re

import click
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tfdb
from tfdb.cli.times import (
    LATEST,
    TimeSpec,
    duration_option,
    offset_option,
    read_stamps,
    time_option,
)
from tfdb.data.decimal_time import parse_stamp
from tfdb.data.time_text import format_duration, format_ns

CONTEXT = click.Context(click.Command("test"))
PARAMETER = click.Argument(["time"])


def parse(text: str) -> TimeSpec:
    spec = time_option(CONTEXT, PARAMETER, text)
    assert spec is not None
    return spec


@given(st.integers(min_value=0, max_value=2**61 - 1))
def test_seconds_and_back(ns: int) -> None:
    assert parse_stamp(format_ns(ns)) == ns
    assert parse_stamp(f"{ns}ns") == ns


@pytest.mark.parametrize(
    ("text", "ns"),
    [
        ("0", 0),
        ("1.5", 1_500_000_000),
        (".5", 500_000_000),
        ("1700000000.123456789", 1_700_000_000_123_456_789),
        ("7ns", 7),
    ],
)
def test_absolute(text: str, ns: int) -> None:
    assert parse(text) == TimeSpec(text, ns)
    assert parse(text).resolve(None) == ns


def test_latest() -> None:
    assert parse("latest") == LATEST
    assert LATEST.resolve((12, 34)) is None


def test_relative_counts_from_the_start_or_the_end() -> None:
    span = (10, 7_000_000_000)
    assert parse("+1.5").resolve(span) == 1_500_000_010
    assert parse("+20ns").resolve(span) == 30
    assert parse("+1s").resolve(span) == parse("+1").resolve(span)
    assert parse("-1s").resolve(span) == parse("-1").resolve(span)
    assert parse("-1.5").resolve(span) == 5_500_000_000
    assert parse("-7").resolve(span) == 0
    for text in ("+1", "-1"):
        with pytest.raises(tfdb.InvalidArgument, match="no moving transform"):
            parse(text).resolve(None)
    with pytest.raises(tfdb.InvalidStamp, match="before time 0"):
        parse("-7.1").resolve(span)


@pytest.mark.parametrize(
    "text",
    ["", "noon", "1.5s", "1.5ns", "+", "-", "+-1", "--1", "+1x", "-9e9", "nan", "1e99"],
)
def test_refused(text: str) -> None:
    with pytest.raises(
        click.BadParameter, match=rf"^'{re.escape(text.removesuffix('ns'))}' is .*; write"
    ):
        parse(text)


@pytest.mark.parametrize("text", ["1_000", "\uff11\uff12", "+1_000", "2026-11-2\uff11"])
def test_digits_are_ascii_without_separators(text: str) -> None:
    with pytest.raises(click.BadParameter):
        parse(text)
    with pytest.raises(tfdb.InvalidStamp):
        tfdb.stamp(text)


@pytest.mark.parametrize(
    ("ns", "text"),
    [
        (0, "0 ns"),
        (999, "999 ns"),
        (1_500, "1.5 us"),
        (33_366_700, "33.4 ms"),
        (100_000_000, "100 ms"),
        (1_250_000_000, "1.25 s"),
        (-3_900_000_000, "-3.9 s"),
        (123_000_000_000, "2 min 3 s"),
        (3_600_000_000_000, "60 min"),
        (-7_200_000_000_000, "-2 h"),
        (7_500_000_000_000, "2 h 5 min"),
    ],
)
def test_durations_for_people(ns: int, text: str) -> None:
    assert format_duration(ns) == text


def test_negative_seconds() -> None:
    assert format_ns(-1_500_000_000) == "-1.500000000"


def test_stamps_of_a_text() -> None:
    text = "# a comment\n\n1.5\n2500000000ns\n1700000000123456789\n"
    assert read_stamps(text, "f") == [1_500_000_000, 2_500_000_000, 1_700_000_000_123_456_789]


def test_stamps_of_a_trajectory() -> None:
    assert read_stamps("1.5 0 0 0 0 0 0 1\n2.5 0 0 0 0 0 0 1\n", "f.tum") == [
        15 * 10**8,
        25 * 10**8,
    ]
    csv = "stamp_ns,x,y\n1700000000123456789,1,2\n"
    assert read_stamps(csv, "f.csv") == [1_700_000_000_123_456_789]


@pytest.mark.parametrize(("text", "words"), [("", "no stamp"), ("1.5\nsoon\n", "line 2")])
def test_stamps_refused(text: str, words: str) -> None:
    with pytest.raises(tfdb.InvalidStamp, match=words):
        read_stamps(text, "stamps.txt")


@pytest.mark.parametrize(
    ("text", "ns"),
    [
        ("2026-11-21 05:53:03.720 UTC", 1_795_240_383_720_000_000),
        ("2026-11-21T05:53:03.720679283Z", 1_795_240_383_720_679_283),
        ("2026-11-21T06:53:03+01:00", 1_795_240_383_000_000_000),
        ("2026-11-21T05:53:03", 1_795_240_383_000_000_000),
        ("2026-11-21", 1_795_219_200_000_000_000),
        ("2026-11-21t05:53:03z", 1_795_240_383_000_000_000),
    ],
)
def test_dates_as_they_are_printed(text: str, ns: int) -> None:
    assert parse(text).resolve(None) == ns


@pytest.mark.parametrize("text", ["2", "2s", "2.0s", "2000000000ns", " 2s "])
def test_lengths_may_have_their_unit(text: str) -> None:
    assert duration_option(CONTEXT, PARAMETER, text) == 2_000_000_000


@pytest.mark.parametrize("text", ["s", "2ms", "2 s", "2m", "-2", "+2"])
def test_invalid_durations_are_refused(text: str) -> None:
    with pytest.raises(click.BadParameter):
        duration_option(CONTEXT, PARAMETER, text)


def test_offsets_may_have_a_sign() -> None:
    for text, ns in {"2": 2, "+2s": 2, "-2": -2, "-0.5s": -0.5}.items():
        assert offset_option(CONTEXT, PARAMETER, text) == ns * 10**9
    for text in ("+", "+-2", "-x", "", "--2"):
        with pytest.raises(click.BadParameter, match=rf"^{re.escape(repr(text))} is not an offset"):
            offset_option(CONTEXT, PARAMETER, text)

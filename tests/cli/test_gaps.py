"""`tfdb gaps`: lists each gap with its time, length and publishers."""

from __future__ import annotations

from itertools import pairwise
from statistics import median_low
from typing import TYPE_CHECKING

import pytest

import tfdb
from tfdb.data.time_text import format_date, format_dates, format_when
from tfdb.recordings import RecordingWriter
from tfdb.store.summary import edge_summaries

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool

S = 1_000_000_000
TURN = (0.0, 0.6, 0.0, 0.8)


def record(path: Path, samples: list[tuple[float, str, str, str]], start: int = 0) -> Path:
    """Record samples given as (seconds, parent, child, publisher)."""
    with RecordingWriter(path) as writer:
        for seconds, parent, child, who in samples:
            stamp = start + round(seconds * S)
            one = tfdb.TransformStamped(parent, child, stamp, (seconds, 0, 0), TURN)
            data = tfdb.encode_tf_message([one], writer.encoding)
            writer.write(data, stamp, topic="/tf", static=False, authority=who)
    return path


def test_gaps_name_time_length_and_both_publishers(tool: Tool, tmp_path: Path) -> None:
    steps = [i / 10 for i in (*range(1, 20), *range(40, 60), *range(90, 99))]
    samples = [(t, "odom", "base", "/first" if t < 9 else "/second") for t in steps]
    samples += [(i / 4, "map", "odom", "/map") for i in range(1, 40) if not 10 <= i < 18]
    path = record(tmp_path / "a.bag", sorted(samples))
    body = tool("gaps", path, "--json").json
    assert body["command"] == "gaps"
    found = [
        (g["frame"], g["parent"], g["before_ns"], g["after_ns"], g["length_ns"])
        for g in body["gaps"]
    ]
    assert found == [
        ("odom", "map", 9 * S // 4, 18 * S // 4, 9 * S // 4),
        ("base", "odom", 19 * S // 10, 4 * S, 21 * S // 10),
        ("base", "odom", 59 * S // 10, 9 * S, 31 * S // 10),
    ]
    assert [(g["publisher_before"], g["publisher_after"]) for g in body["gaps"]] == [
        ("/map", "/map"),
        ("/first", "/first"),
        ("/first", "/second"),
    ]
    assert [g["period_ns"] for g in body["gaps"]] == [S // 4, S // 10, S // 10]
    rows = tool("gaps", path).out.splitlines()[2:]
    assert rows[2].split() == [
        *("base", "odom", "5.900000000", "3.1", "s", "100", "ms", "/first", "/second")
    ]


def test_gaps_against_a_loop_over_real_samples(tool: Tool, bag: Path) -> None:
    store = tfdb.load(bag)
    for limit in ("0.02", "0.1", "0.0405"):
        expected = sorted(
            (info.name, before, after)
            for info in store.tree()
            if not info.is_static
            for before, after in pairwise(store.samples(info.name)[0].tolist())
            if after - before > round(float(limit) * S)
        )
        found = tool("gaps", bag, "--max-gap", limit, "--json").json["gaps"]
        assert sorted((g["frame"], g["before_ns"], g["after_ns"]) for g in found) == expected
        assert expected
        for gap in found:
            steps = [b - a for a, b in pairwise(store.samples(gap["frame"])[0].tolist())]
            assert abs(gap["period_ns"] - median_low(steps)) <= max(steps) - min(steps)
            assert gap["publisher_before"] == store.frame_info(gap["frame"]).authority


def test_gaps_are_those_that_check_counts(tool: Tool, tmp_path: Path) -> None:
    """A jump of the clock is not a gap, and a late sample does not close one."""
    times = [*(i / 10 for i in range(30)), *(i / 10 for i in range(60, 90))]
    samples = [(t, "map", "base", "/who") for t in times]
    path = record(tmp_path / "jump.bag", samples)
    checked = tool("check", path, "--json", code=1).json["findings"]
    (finding,) = [each for each in checked if each["kind"] == "gap"]
    listed = tool("gaps", path, "--json").json["gaps"]
    assert [[gap["before_ns"], gap["after_ns"]] for gap in listed] == finding["details"]["gaps"]


@pytest.mark.parametrize("limit", [None, 0.3, 0.15])
def test_every_command_counts_the_same_gaps(
    tool: Tool, tmp_path: Path, limit: float | None
) -> None:
    """Late samples and repeated stamps do not count; a gap is longer than 5 periods of 0.1 s."""
    tenths = [*range(20), *range(25, 40), *range(46, 60), 58, 59, *range(62, 80)]
    samples = [(t / 10, "map", "base", "/who") for t in tenths]
    path = record(tmp_path / "holes.bag", samples)
    wide = S // 2 if limit is None else round(limit * S)
    stamps = sorted({t * S // 10 for t in tenths})
    expected = [[a, b] for a, b in pairwise(stamps) if b - a > wide]
    assert len(expected) == {None: 2, 0.3: 2, 0.15: 3}[limit]
    options = () if limit is None else ("--max-gap", str(limit))

    store = tfdb.load(path)
    (edge,) = edge_summaries(store, None if limit is None else wide)  # the gaps of `plot timeline`
    assert [[gap.before, gap.after] for gap in edge.gaps] == expected
    listed = tool("gaps", path, *options, "--json").json["gaps"]
    assert [[gap["before_ns"], gap["after_ns"]] for gap in listed] == expected
    assert {gap["period_ns"] for gap in listed} == {edge.period}
    findings = tool("check", path, *options, "--json", code=1).json["findings"]
    (found,) = [each for each in findings if each["kind"] == "gap"]
    assert found["details"]["gaps"] == expected
    assert found["details"]["period_ns"] == edge.period
    (told,) = [e for e in tool("info", path, "--json").json["edges"] if e["frame"] == "base"]
    longest = max(b - a for a, b in expected)
    assert told["longest_gap_ns"] == store.frame_info("base").longest_gap == longest
    assert found["details"]["longest_ns"] == longest
    assert told["rate_hz"] == store.frame_info("base").rate
    if limit is None:
        assert told["gaps"] == len(expected)


def test_no_gaps(tool: Tool, mcap: Path) -> None:
    assert tool("gaps", mcap).out == "no gaps in 7,180 transforms of 85 frames\n"
    assert tool("gaps", mcap, "--json").json["gaps"] == []
    assert "write seconds" in tool("gaps", mcap, "--max-gap", "long", code=2).error
    assert "--for is valid for live stores" in tool("gaps", mcap, "--for", "1", code=2).error


@pytest.mark.parametrize(
    ("stamp", "date"),
    [
        (1_700_000_000_123_456_789, "2023-11-14 22:13:20.123"),
        (951_782_399_999_999_999, "2000-02-28 23:59:59.999"),
        (951_782_400_000_000_000, "2000-02-29 00:00:00.000"),
        (2**61 - 1, "2043-01-25 23:56:49.213"),
        (0, ""),
        (302 * S, ""),
        (-5 * S, ""),
    ],
)
def test_dates_are_of_stamps_since_1970_only(stamp: int, date: str) -> None:
    assert format_date(stamp) == date
    assert format_when(stamp).endswith(f"({date} UTC)" if date else "0")


def test_the_day_is_printed_once() -> None:
    first = 1_700_000_000 * S
    assert format_dates(first, first + 5 * S) == "2023-11-14 22:13:20.000 to 22:13:25.000 UTC"
    assert format_dates(first, first + 86_400 * S).endswith("to 2023-11-15 22:13:20.000 UTC")
    assert format_dates(0, first) == ""


def test_simulated_time_has_no_date(tool: Tool, tmp_path: Path) -> None:
    samples = [(i / 10, "map", "base", "/who") for i in range(30)]
    assert "UTC" not in tool("info", record(tmp_path / "sim.bag", samples)).out
    real = record(tmp_path / "real.bag", samples, 1_700_000_000 * S)
    assert "2023-11-14 22:13:20.000 to 22:13:22.900 UTC" in tool("info", real).out


@pytest.mark.parametrize("command", ["check", "gaps"])
@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--exclude", "basse"), "exclude: no frame, topic or node of {} matches 'basse'; did"),
        (("--exclude", "/basse"), "exclude: no frame, topic or node of {} matches '/basse'; did"),
        (("--rename", "basse:=b"), "rename: no frame of {} is called 'basse'; did"),
        (
            ("--start", "100"),
            "{}: no moving transform from 100 s; the stamps run from 0 s to 0.4 s",
        ),
    ],
)
def test_options_that_do_nothing_warn(
    tool: Tool, tmp_path: Path, command: str, options: tuple[str, ...], words: str
) -> None:
    path = record(tmp_path / "a.bag", [(i / 10, "map", "base", "/a") for i in range(5)])
    with RecordingWriter(tmp_path / "b.bag") as writer:
        still = tfdb.TransformStamped("base", "cam", 0, (1, 2, 3), TURN)
        data = tfdb.encode_tf_message([still], writer.encoding)
        writer.write(data, 1, topic="/tf_static")
    files = (path, tmp_path / "b.bag")
    found = tool(command, *files, *options).err
    assert f"tfdb: warning: {words.format(', '.join(map(str, files)))}" in found


def test_a_gap_just_over_the_limit_gets_all_its_digits(tool: Tool, tmp_path: Path) -> None:
    samples = [(t, "map", "base", "/who") for t in (0.0, 0.100003, 0.2, 0.4)]
    out = tool("gaps", record(tmp_path / "a.bag", samples), "--max-gap", "0.1").out
    first, second = out.splitlines()[2:]
    assert " 0.100003000 s " in first
    assert " 200 ms " in second

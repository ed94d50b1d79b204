"""The pages that `make measure` fills: markers, pictures, sentences about figures."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from tfdb_measure import __main__ as measure
from tfdb_measure import claims, goals, pages, points
from tfdb_measure.results import Cell, Results

DOCS = Path(__file__).resolve().parents[2] / "docs"
ABOUT = {"text": "A machine.", "commit": "0123456789ab", "date": "2026-01-02"}


def row(**values: float) -> dict[str, float]:
    columns = (
        *(f"{lane}_{what}" for lane in ("reads", "writes") for what in ("done", "per_s", "lost")),
        *(f"{lane}_{what}_ns" for lane in ("reads", "writes") for what in ("p50", "p99", "p999")),
        *("reads_max_ns", "retries", "lapped_reads", "pinned_reads"),
    )
    return {**dict.fromkeys(columns, 1.0), **values}


def test_pages_have_a_marker_and_a_picture_for_each_part() -> None:
    texts = {name: (DOCS / name).read_text(encoding="utf-8") for name in measure.PAGES}
    for page, name in measure.markers():
        begun, ended = (texts[page].count(f"<!-- {name}: {end} -->") for end in ("begin", "end"))
        assert (begun, ended) == (1, 1), (page, name)
    assert {*measure.KEPT} == {*points.SWEEPS}
    for text in texts.values():
        for picture in re.findall(r"\]\((evaluation/[^)]+)\)", text):
            assert (DOCS / picture).stat().st_size > 1_000
    assert sum(file.stat().st_size for file in (DOCS / "evaluation").iterdir()) < 600_000


def test_between_replaces_only_its_part() -> None:
    rest = "b <!-- y: begin --><!-- y: end -->"
    text = f"a\n<!-- x: begin -->\nold\n<!-- x: end -->\n{rest}"
    new = pages.between(text, "x", ["new"])
    assert new == f"a\n<!-- x: begin -->\n\nnew\n\n<!-- x: end -->\n{rest}"
    with pytest.raises(ValueError, match="'z'"):
        pages.between(text, "z", [])


def test_pages_get_figures_and_commit_between_markers_only(tmp_path: Path) -> None:
    for name in measure.PAGES:
        shutil.copy(DOCS / name, tmp_path)
    results = Results()
    times = {"tf2_ros": [6000.0, 5000.0, 9000.0], "tfdb": [100.0, 100.0, 100.0]}
    results.add_rounds("Python", "lookup mid, chain of 4", "ns", times)
    assert pages.write(tmp_path, pages.parts(results, ABOUT), {}) == [tmp_path / "benchmarks.md"]
    text = (tmp_path / "benchmarks.md").read_text(encoding="utf-8")
    assert "A machine. Measured at commit 0123456789ab, 2026-01-02." in text
    assert "| ≥ 30x | 60x | 50 to 90 | yes |" in text
    assert "| Python | lookup mid, chain of 4 | ns | tf2_ros 6,000, tfdb 100 ns |" in text
    felt = "| a lookup in Python, through 4 edges | `tf2_ros` | 6 us | 0.1 us | 60x |"
    assert text.partition(felt)[0].count("\n|") == 2, "what was not measured is left out"
    assert "Goals: 1;" not in text
    assert "reached: 1; missed: 0; not measured:" in text
    before = (DOCS / "benchmarks.md").read_text(encoding="utf-8")
    for begin, end in (("", "<!-- felt: begin"), ("<!-- felt: end", "<!-- about")):
        kept = [whole[whole.index(begin) :].partition(end)[0] for whole in (text, before)]
        assert kept[0] == kept[1]


def test_rows_of_contenders_stand_beside_those_of_engines() -> None:
    results = Results()
    results.add("threads", "2", 1, "silo", row())
    results.add_rounds("C++", "lookup mid, chain of 4", "ns", {"tf2": [600.0], "tfdb": [100.0]})
    shown = pages.parts(results, ABOUT)["benchmarks.md"]["rows"]
    assert shown[2:] == ["| C++ | lookup mid, chain of 4 | ns | tf2 600, tfdb 100 ns |"]


def test_losses_list_engines_that_win_every_round() -> None:
    results = Results()
    for turn, (ours, silo, fine) in enumerate([(10, 20, 30), (12, 24, 9)], start=1):
        for engine, reads in (("snapshot", ours), ("silo", silo), ("fine", fine)):
            results.add("threads", "2", turn, engine, row(reads_per_s=reads))
    lines = [line for line in claims.losses(results) if "Threads" in line]
    assert len(lines) == 1
    assert "`silo` | 2 |" in lines[0]


def test_goals_are_judged_by_the_median_of_ratios_within_rounds() -> None:
    results = Results()
    for turn, pair in enumerate((19.0, 18.5, 10.0), start=1):
        for label, point in goals.POINTS.items():
            reads = {"reader": 10.0, "readers": pair}.get(label, 1.0)
            results.add("goals", label, turn, point.engine, row(reads_per_s=reads))
    lines = list(goals.table(goals.judge(goals.ENGINES, results)))
    (scaling,) = [line for line in lines if "2 threads against 1" in line]
    assert "| ≥ 1.8x | 1.85x | 1 to 1.9 | yes |" in scaling
    missed = [line for line in lines if "at full speed" in line and "share of tf2's" in line]
    assert "**no**" in missed[0]  # equal to tf2's is not a twentieth
    assert missed[1].startswith("- missed: ")
    assert missed[1].endswith(": 1x, wanted ≤ 0.05x")


def test_unmeasured_goals_are_neither_reached_nor_missed() -> None:
    goal = goals.at_most(
        "a cost", 2.0, Cell("cost", "a row", "late"), Cell("cost", "a row", "first")
    )
    table = list(goals.table(goals.judge([goal], Results())))
    assert "| not measured | | |" in table[2]
    assert "reached: 0; missed: 0; not measured: 1." in table[-1]


def test_every_goal_has_another_text() -> None:
    texts = [goal.text for goal in (*goals.ROWS, *goals.ENGINES) if "the same" not in goal.text]
    rivals = {(goal.text, goal.rival) for goal in (*goals.ROWS, *goals.ENGINES)}
    assert len(texts) == len({*texts})
    assert len(rivals) >= len(texts)


def test_a_part_that_is_measured_again_replaces_its_rows_alone(tmp_path: Path) -> None:
    path = tmp_path / "rows.csv"
    first = Results(path)
    first.add_rounds("C++", "a", "ns", {"tf2": [3.0, 5.0], "tfdb": [1.0]})
    first.add_rounds("cost", "b", "ms", {"n": [0.25]})
    second = Results.read(path, without={"C++"})
    assert second.sweeps() == ["cost"]
    second.add_rounds("C++", "a", "ns", {"tfdb": [2.0]})
    third = Results.read(path)
    assert third.rows == second.rows
    assert third.shown("cost", "b") == "n 0.25 ms"
    assert third.rounds(Cell("C++", "a", "tfdb")) == {1: 2.0}
    assert third.rounds(Cell("C++", "a", "tf2")) == {}


def test_figures_of_another_commit_are_thrown_away(tmp_path: Path) -> None:
    now = {"text": "this machine", "commit": "one"}
    measure.kept(tmp_path, now)
    Results(tmp_path / "rows.csv").add_rounds("C++", "a", "ns", {"tfdb": [1.0]})
    measure.kept(tmp_path, now)
    assert Results.read(tmp_path / "rows.csv").rows
    measure.kept(tmp_path, {**now, "commit": "two"})
    assert not (tmp_path / "rows.csv").exists()

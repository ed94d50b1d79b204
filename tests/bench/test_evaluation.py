"""The page that `make evaluation` fills: its markers, its pictures, what is said of figures."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import pytest

from tfdb.bench import points
from tfdb.bench.results import Results

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "evaluation.md"

pytest.importorskip("PIL", reason="pillow comes with matplotlib")
sys.path.insert(0, str(ROOT / "benchmarks" / "python"))
evaluation_page = pytest.importorskip("evaluation_page")
evaluation_goals = pytest.importorskip("evaluation_goals")
sys.path.pop(0)


def row(**values: float) -> dict[str, float]:
    columns = (
        *(f"{lane}_{what}" for lane in ("reads", "writes") for what in ("done", "per_s", "lost")),
        *(f"{lane}_{what}_ns" for lane in ("reads", "writes") for what in ("p50", "p99", "p999")),
        *("reads_max_ns", "retries", "lapped_reads", "pinned_reads"),
    )
    return {**dict.fromkeys(columns, 1.0), **values}


def test_page_has_a_marker_and_a_picture_for_each_sweep() -> None:
    text = PAGE.read_text(encoding="utf-8")
    for name in ("about", "goals", "claims", "losses", "prediction"):
        assert text.count(f"<!-- {name}: begin -->") == text.count(f"<!-- {name}: end -->") == 1
    for name in points.SWEEPS:
        assert f"<!-- sweep {name}: begin -->" in text
    for picture in re.findall(r"\]\((evaluation/[^)]+)\)", text):
        assert (PAGE.parent / picture).stat().st_size > 1_000
    assert sum(file.stat().st_size for file in (PAGE.parent / "evaluation").iterdir()) < 300_000


def test_between_replaces_only_its_part() -> None:
    rest = "b <!-- y: begin --><!-- y: end -->"
    text = f"a\n<!-- x: begin -->\nold\n<!-- x: end -->\n{rest}"
    new = evaluation_page.between(text, "x", ["new"])
    assert (
        new == "a\n<!-- x: begin -->\n\nnew\n\n<!-- x: end -->\nb <!-- y: begin --><!-- y: end -->"
    )
    with pytest.raises(ValueError, match="'z'"):
        evaluation_page.between(text, "z", [])


def test_losses_name_what_beats_snapshot_in_every_round_and_nothing_else() -> None:
    results = Results()
    for turn, (ours, silo, fine) in enumerate([(10, 20, 30), (12, 24, 9)], start=1):
        for engine, reads in (("snapshot", ours), ("silo", silo), ("fine", fine)):
            results.add("threads", "2", turn, engine, row(reads_per_s=reads))
    lines = [line for line in evaluation_page._losses(results) if "Threads" in line]
    assert len(lines) == 1
    assert "`silo` | 2 |" in lines[0]


def test_goals_are_judged_by_the_median_of_ratios_within_rounds() -> None:
    results = Results()
    for turn, pair in enumerate((19.0, 18.5, 10.0), start=1):
        for label, point in evaluation_goals.POINTS.items():
            reads = {"reader": 10.0, "readers": pair}.get(label, 1.0)
            results.add("goals", label, turn, point.engine, row(reads_per_s=reads))
    head = {"machine": "m", "versions": "v", "date": "d", "command": "c"}
    lines = evaluation_goals.table(results, head)
    (scaling,) = [line for line in lines if "2 threads against 1" in line]
    assert "| 1.85x | 1 to 1.9 | yes |" in scaling
    (latency,) = [line for line in lines if "share of tf2's" in line and "flat out" in line]
    assert "**no**" in latency  # equal to tf2's is not a twentieth

"""The tables of docs/benchmarks.md, written between its markers."""

from __future__ import annotations

import statistics
from typing import TYPE_CHECKING

from results import GOALS, Goal, Results

if TYPE_CHECKING:
    from pathlib import Path

BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"


def number(value: float) -> str:
    """Three digits that matter."""
    if value == 0:
        return "0"
    return f"{value:,.0f}" if abs(value) >= 100 else f"{value:.3g}"


def goal_text(goal: Goal) -> str:
    if goal.goal is None:
        return ""
    sign = "≥" if goal.at_least else "≤"
    return f"{sign} {number(goal.goal)}{'x' if goal.unit == 'x' else ' ' + goal.unit}".strip()


def goal_line(goal: Goal, results: Results) -> str:
    """One row of the table of goals."""
    measured = goal.measured(results)
    if measured is None:
        return f"| {goal.text} | {goal.rival} | {goal_text(goal)} | not measured | | | |"
    figure, ours, theirs = measured
    unit = results.units[goal.ours[:3]]
    verdict = {True: "yes", False: "**no**", None: ""}[goal.reached(figure)]
    shown = number(figure) + ("x" if goal.unit == "x" else f" {goal.unit}".rstrip())
    their_text = "" if theirs is None else f"{number(theirs)} {unit}"
    return (
        f"| {goal.text} | {goal.rival} | {goal_text(goal)} | {shown} | {verdict} "
        f"| {number(ours)} {unit} | {their_text} |"
    )


def goals_table(results: Results) -> list[str]:
    head = "| what | against | goal | measured | reached | tfdb | rival |"
    return [head, "|---|---|---|---|---|---|---|", *(goal_line(goal, results) for goal in GOALS)]


def all_rows(results: Results) -> list[str]:
    lines = ["| language | row | chain | unit | medians |", "|---|---|---|---|---|"]
    for (source, row, chain), rounds in results.rows.items():
        medians = ", ".join(f"{who} {number(statistics.median(v))}" for who, v in rounds.items())
        unit = results.units[source, row, chain]
        lines.append(f"| {source} | {row} | {chain} | {unit} | {medians} |")
    return lines


def write(results: Results, page: Path) -> None:
    """Replaces what stands between the markers of the page."""
    before, _, rest = page.read_text().partition(BEGIN)
    _, _, after = rest.partition(END)
    text = [
        BEGIN,
        "",
        f"Machine: {results.machine}.",
        "",
        *goals_table(results),
        "",
        "### Every row",
        "",
        *all_rows(results),
        "",
        END,
    ]
    page.write_text(before + "\n".join(text) + after)

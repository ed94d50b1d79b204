"""``tfdb verify``: the verdict on a recorded history."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from tfdb.cli import common, layout, output
from tfdb.cli.groups import SuggestingCommand
from tfdb.data.counting import counted

from .verify import check, load_history
from .verify.check import STEPS

if TYPE_CHECKING:
    from .verify import History, Verdict


@click.command("verify", cls=SuggestingCommand)
@click.argument("history", type=click.Path())
@click.option(
    "--steps",
    default=STEPS,
    show_default=True,
    type=click.IntRange(min=1),
    help="Steps of the search for an order of writes that the history does not record.",
)
@common.json_option
def command(*, history: str, steps: int, as_json: bool) -> None:
    """Check whether a recorded history of a store is strictly serializable.

    Example: tfdb verify history.jsonl --steps 20

    Anomalies are named. Exit code: 0 serializable, 1 not or undecided, 2 an unreadable HISTORY.

    HISTORY holds one JSON object per line; docs/howto/verify_a_history.md describes it.
    """
    (path,) = common.find_paths([history])
    loaded = load_history(path)
    verdict = check(loaded, steps=steps)
    if as_json:
        output.emit_json("verify", _body(loaded, verdict))
    else:
        _show(loaded, verdict)
    if verdict.serializable is not True:
        click.get_current_context().exit(1)


def _body(history: History, verdict: Verdict) -> dict[str, Any]:
    return {
        "file": history.path,
        "header": history.header,
        **verdict.counts,
        "serializable": verdict.serializable,
        "undecided": verdict.undecided,
        "anomalies": [
            {
                "name": anomaly.name,
                "meaning": anomaly.meaning,
                "count": anomaly.count,
                "transactions": list(anomaly.transactions),
                "steps": list(anomaly.steps),
            }
            for anomaly in verdict.anomalies
        ],
    }


def _show(history: History, verdict: Verdict) -> None:
    out = layout.console()
    out.print(history.path, style="bold")
    for anomaly in verdict.anomalies:
        out.print(layout.loud(anomaly.name), f"({anomaly.count:,}):", anomaly.meaning)
        for step in anomaly.steps:
            out.print(f"    {step}")
    counts = verdict.counts
    transactions = counted(counts["transactions"], "transaction")
    what = f"{transactions}, {counts['committed']:,} of them committed"
    if verdict.serializable:
        out.print(f"strictly serializable: {what}")
    elif verdict.undecided:
        out.print(f"undecided: {what}; {verdict.undecided}")
    else:
        out.print(f"not strictly serializable: {what}")

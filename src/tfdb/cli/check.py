"""``tfdb check``: finds faults of a recording."""

from __future__ import annotations

import warnings
from collections import Counter, defaultdict
from typing import TYPE_CHECKING, Any

import click

import tfdb
from tfdb.data.counting import counted
from tfdb.data.time_text import format_date, format_ns, format_when
from tfdb.judging.arrivals import Arrivals
from tfdb.judging.doctor import (
    KINDS,
    Finding,
    Limits,
    disconnected,
    examine,
    leading_slashes,
    sort_key,
)
from tfdb.judging.events import BROKEN, CLOCKS, EVENT_KINDS
from tfdb.recordings.arrivals import ArrivalReader
from tfdb.recordings.containers import prefix_of_topic
from tfdb.recordings.load_report import describe_refused
from tfdb.recordings.rewriter import describe_untimed
from tfdb.store.summary import Forest

from . import common, layout, output
from .expect import expect_option
from .graph import LISTENS, Live, is_graph, listening, node_option, open_live
from .groups import OneOf, SuggestingCommand
from .info import mixed_body, rows_body, say_rows
from .selecting import refuse_selection, selection_options
from .times import NS, seconds_option

if TYPE_CHECKING:
    from collections.abc import Iterator

    from rich.console import Console

    from tfdb.judging.expectations import Expectations
    from tfdb.recordings.load_report import LoadReport


_ERRORS, _WARNINGS = (
    [kind for kind, (severity, _) in KINDS.items() if severity == level]
    for level in ("error", "warning")
)
_EXPECTED = [kind for kind in EVENT_KINDS if kind not in KINDS]


@click.command("check", cls=SuggestingCommand)
@common.files_argument
@common.max_gap_option
@seconds_option(
    "--jump", default="1", help="Largest allowed change of the delay from stamp to arrival."
)
@seconds_option(
    "--coverage",
    default="1",
    help="Seconds that an edge may start later, or stop earlier, than the recording.",
)
@expect_option
@click.option(
    "--ignore",
    multiple=True,
    metavar="KIND",
    type=OneOf([*_ERRORS, *_WARNINGS, *_EXPECTED]),
    help="Do not report findings of this kind; repeatable. "
    f"Errors: {', '.join(_ERRORS)}. Warnings: {', '.join(_WARNINGS)}. "
    f"With --expect also: {', '.join(_EXPECTED)}.",
)
@seconds_option(
    "--for",
    "length",
    help="Watch a shared store (shm:NAME) or graph (ros1:, ros2:) for this long, and check the new "
    "data.  [default of a graph: 5]",
)
@node_option
@selection_options
@layout.wide_option
@common.json_option
def command(
    *,
    files: tuple[str, ...],
    max_gap: int | None,
    jump: int | None,
    coverage: int | None,
    expect: str | None,
    ignore: tuple[str, ...],
    length: int | None,
    as_json: bool,
) -> None:
    """Find faults of a recording: gaps, late data, double publishers, time jumps.

    Example: tfdb check drive.mcap --ignore coverage

    Exit code: 0 without findings, 1 with findings, 2 for an unreadable FILE.

    Several FILEs are parts of one recording. A live graph (ros1:, ros2:) is watched and its new
    data checked. A shared store (shm:NAME) is checked as it is, or watched with --for. A frozen
    store (FILE.tfdb) is compared with its checksum first.

    With --expect, each broken expectation is a finding. The deadline of an edge replaces its
    findings 'gap' and 'coverage'. The limit max_late of an edge replaces its finding 'late'.
    """
    limits = Limits(max_gap, NS if jump is None else jump, NS if coverage is None else coverage)
    expected = None if expect is None else tfdb.Expectations.read(expect)
    loaded, arrivals = examined(files, length)
    found = examine(arrivals.log, limits)
    if expected is not None:
        found = judge_expectations(arrivals, expected, found)
    found += [
        *(() if loaded.report is None else _reported(loaded.report)),
        *_mixed(loaded),
        *_trees(loaded),
        *leading_slashes(arrivals.mixed),
    ]
    kept = sorted((f for f in found if f.kind not in ignore), key=sort_key)
    if as_json:
        output.emit_json("check", _body(loaded, arrivals, kept))
    else:
        _show(loaded, arrivals, kept)
    if kept:
        click.get_current_context().exit(1)


def judge_expectations(
    arrivals: Arrivals, expected: Expectations, found: list[Finding]
) -> list[Finding]:
    """Return the findings; broken expectations replace the findings on the same property."""
    from tfdb.judging.expectations import edge_limits  # noqa: PLC0415 - with --expect alone
    from tfdb.judging.proposing import broken_expectations, judge_recording  # noqa: PLC0415

    names = arrivals.log.names
    limits_of = edge_limits(expected)
    limits = {
        edge.name: limits_of(names[edge.parents[-1]], edge.name) for edge in arrivals.log.edges()
    }
    judged = {"gap": "deadline", "coverage": "deadline", "late": "max_late"}
    kept = [
        finding
        for finding in found
        if finding.kind not in judged
        or getattr(limits[finding.frames[0]], judged[finding.kind]) is None
    ]
    events = judge_recording(arrivals, expected)
    return kept + [each for each in broken_expectations(events) if each.kind not in CLOCKS]


def examined(names: tuple[str, ...], length: int | None) -> tuple[common.Loaded, Arrivals]:
    """Load the data to examine, with their arrivals. Warns only of options without effect."""
    if length is not None and not common.is_live(names[0]):
        raise click.UsageError(
            "--for is valid for live stores and graphs only: give shm:NAME, ros1: or ros2:"
        )
    reader = ArrivalReader()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tfdb.TfdbWarning)  # they are findings
        found = _examined(names, length, reader)
    if reader.found is not None:
        reader.found.rewriter.warn(", ".join(names), 2, untimed=False)
    return found


def _examined(
    names: tuple[str, ...], length: int | None, reader: ArrivalReader
) -> tuple[common.Loaded, Arrivals]:
    from tfdb.judging.follower import stored_arrivals, watch_arrivals  # noqa: PLC0415 - for what is live alone

    if any(is_graph(name) for name in names):
        refuse_selection(names, "a graph", "ros1: or ros2:")
        seconds = (LISTENS if length is None else length) / NS
        with listening(names[0], history=None) as live, common.progress_bar("watching") as update:
            arrivals = watch_arrivals(live, seconds, update)
            return common.Loaded(live.store.snapshot(), None, names), arrivals
    loaded = common.load(names, verify=True, apart=True, arrivals=reader)
    if reader.found is not None:
        return loaded, Arrivals.of(reader.found)
    if length is None:
        return loaded, stored_arrivals(loaded.store)
    with common.progress_bar("watching") as update:
        found = watch_arrivals(Live(open_live(names[0])), length / NS, update)
    return loaded, found


def _trees(loaded: common.Loaded) -> list[Finding]:
    forest = Forest(loaded.store.tree())
    sizes = [(root, sum(1 for _ in forest.walk(root))) for root in forest.roots]
    if loaded.report is None or not loaded.selection.by_namespace:
        return disconnected(sizes)
    # Each group of topics with its own prefix is a separate tree.
    topics = [topic.name for topic in loaded.report.topics]
    before = loaded.selection.choice.prefix
    prefixes = {before + prefix_of_topic(name, transforms=True) for name in topics}
    apart: dict[str, list[tuple[str, int]]] = defaultdict(list)
    for root, size in sizes:
        group = max((prefix for prefix in prefixes if root.startswith(prefix)), default="")
        apart[group].append((root, size))
    return [finding for each in apart.values() for finding in disconnected(each)]


def _reported(report: LoadReport) -> Iterator[Finding]:
    """Yield the findings that a load report holds."""
    for each in sorted(report.refused_edges, key=lambda each: (each.error, each.edge)):
        frames = (each.edge,) if each.edge else ()
        details = {"error": each.error}
        yield Finding("refused", frames, describe_refused(each), None, each.count, details)
    for loss in report.lost:
        yield Finding("lost", (), str(loss), None, loss.messages, {"bytes": loss.bytes})
    for note in report.notes:
        yield Finding("container", (), note)
    for rows in report.trajectories:  # rows that a later row with another pose replaces
        if rows.differing:
            yield Finding("repeated", (), f"{rows.path}: {rows.summary}", None, rows.differing)
    for topic, count in report.untimed.items():
        yield Finding("no-time", (), describe_untimed(topic, count), None, count)


def _mixed(loaded: common.Loaded) -> list[Finding]:
    error = loaded.mixed
    if error is None:
        return []
    body = mixed_body(error)
    groups = body["groups"]
    if groups.keys() <= set(loaded.names):
        what = f"{counted(len(groups), 'file')} state different transforms: {'; '.join(groups)}"
    else:
        listed = "; ".join(" with ".join(topics) for topics in groups.values())
        what = f"{len(groups)} groups of topics state different transforms: {listed}"
    message = f"{what}; examined here {loaded.shown}"
    return [Finding("mixed-sources", error.frames or (), message, None, len(body["frames"]), body)]


def _body(loaded: common.Loaded, arrivals: Arrivals, found: list[Finding]) -> dict[str, Any]:
    severities = Counter(finding.severity for finding in found)
    return {
        "files": list(loaded.names),
        "messages": loaded.report and loaded.report.messages,
        "transforms": loaded.report.transforms if loaded.report else arrivals.log.count,
        "publishers_known": arrivals.publishers_known,
        "missed_commits": arrivals.missed,
        **rows_body(loaded.report),
        "findings": [
            {
                "kind": finding.kind,
                "severity": finding.severity,
                "frames": list(finding.frames),
                "message": finding.message,
                "stamp_ns": finding.stamp,
                "count": finding.count,
                "details": finding.details,
            }
            for finding in found
        ],
        "errors": severities["error"] + severities["stale"],
        "warnings": severities["warning"],
    }


_COLUMNS = tuple(
    layout.Column(name) for name in ("", "finding", "frames", "since", "date (UTC)", "what")
)


def _show(loaded: common.Loaded, arrivals: Arrivals, found: list[Finding]) -> None:
    out = layout.console()
    out.print(layout.prose(", ".join(loaded.names), *loaded.names), style="bold")
    rows = [_row(finding) for finding in found]
    made = layout.table(_COLUMNS, rows)
    if rows and layout.fits(made):
        out.print(made)
    else:
        for finding in found:
            _show_narrow(out, finding)
    if loaded.report:
        say_rows(out, loaded.report.trajectories)
        for note in (note for rows in loaded.report.trajectories for note in rows.notes):
            out.print(layout.prose(note))
    if not arrivals.publishers_known:
        text = "the recording does not name publishers: double publishers cannot be found"
        out.print(layout.prose(text), style="dim")
    if arrivals.missed:
        text = (
            f"{counted(arrivals.missed, 'commit')} were missed: the store is written faster than "
            "it is watched, and some gaps may be false"
        )
        out.print(layout.prose(text))
    count = Counter(finding.severity for finding in found)
    if found:
        errors = counted(count["error"] + count["stale"], "error")
        out.print(f"{errors}, {counted(count['warning'], 'warning')}")
    else:
        transforms = loaded.report.transforms if loaded.report else arrivals.log.count
        frames = counted(len(loaded.store.frames()), "frame")
        text = f"nothing wrong with {counted(transforms, 'transform')} of {frames}"
        out.print(layout.prose(text))


def _show_narrow(out: Console, finding: Finding) -> None:
    """Print a finding on several lines, because it does not fit into one."""
    frames = "".join(f" {name}," for name in _frames(finding)).rstrip(",")
    names = [layout.safe(name) for name in finding.frames]
    heading = [finding.severity, f" {finding.kind}:", *layout.words(frames, *names)]
    style = "bold red" if finding.severity in BROKEN else "bold"
    out.print(layout.wrap(heading), style=style)
    since = "" if finding.stamp is None else f", since {format_when(finding.stamp)}"
    out.print(layout.wrap([" ", *layout.words(f" {finding.message}{since}", *names)]))


def _frames(finding: Finding) -> list[str]:
    """List the frames of a finding; of more than three, the first ones and a count."""
    frames = [layout.safe(name) for name in finding.frames[:3]]
    if len(finding.frames) > 3:
        frames[-1] += f" and {len(finding.frames) - 3} more"
    return frames


def _row(finding: Finding) -> tuple[Any, ...]:
    stamp = finding.stamp
    times = ("", "") if stamp is None else (format_ns(stamp), format_date(stamp))
    frames = ", ".join(_frames(finding))
    loud = finding.severity in BROKEN
    mark = layout.loud(finding.severity) if loud else finding.severity
    return (mark, finding.kind, frames, *times, finding.message)

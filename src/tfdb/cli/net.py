"""``tfdb net``: shows the homes and mirrors of a network."""

from __future__ import annotations

import time
from contextlib import closing, suppress
from typing import TYPE_CHECKING, Any

import click

from tfdb.data.counting import counted
from tfdb.data.time_text import format_duration

from . import common, layout, output
from .connecting import connected, network_options
from .groups import SuggestingCommand, SuggestingGroup
from .in_place import InPlace
from .times import NS, seconds_option

if TYPE_CHECKING:
    from collections.abc import Iterable

    from rich.console import RenderableType

    from tfdb.net import Status

    Row = tuple[Status, float | None]
    """A home or mirror, and its bytes per second since the previous update."""

_COLUMNS = (
    layout.Column("namespace"),
    layout.Column("role"),
    layout.Column("state"),
    layout.Column("epoch", rank=2),
    layout.Column("commit", right=True),
    layout.Column("lag", right=True),
    layout.Column("behind", right=True),
    layout.Column("gaps", rank=3, right=True),
    layout.Column("resyncs", rank=4, right=True),
    layout.Column("kB/s", rank=1, right=True),
)


@click.group("net", cls=SuggestingGroup)
def command() -> None:
    """Show the homes and mirrors of a network, their lag, gaps and traffic.

    Example: tfdb net top

    A home publishes a store ('tfdb publish'). A mirror copies it into another store ('tfdb
    mirror'). In Python, tfdb.net makes both.
    """


@command.command("top", cls=SuggestingCommand)
@click.argument("name", required=False, metavar="[NAME]")
@seconds_option("--period", default="1", help="Seconds between two updates.")
@click.option("--once", is_flag=True, help="Show one update, and end.")
@network_options
@layout.wide_option
@common.json_lines_option
def top(
    *,
    name: str | None,
    period: int,
    once: bool,
    connect: tuple[str, ...],
    listen: tuple[str, ...],
    config: str | None,
    as_json: bool,
) -> None:
    """Show all homes and mirrors with their lag, gaps and traffic, until Ctrl-C.

    Example: tfdb net top --connect tcp/10.0.0.7:7447

    With NAME, only this namespace is shown. On a terminal the table is updated in place. --json
    prints one object per update. The command waits for a missing router, except with --once or
    --listen.

    \b
      epoch     first digits of the store's id; equal for a home and its live mirrors
      lag       commits that a home has not sent yet, or that a mirror lacks
      behind    time since a mirror was last live
      gaps      times that a mirror found commits missing
      resyncs   times that a mirror copied a whole state
      kB/s      bytes that a home sends or a mirror receives

    Exit code: 0 (also after Ctrl-C), 2 on an error, 130 after Ctrl-C during the wait for a router.
    """  # noqa: D301, click wants the character
    from tfdb.net import status  # noqa: PLC0415 - Zenoh is an extra
    from tfdb.net.link import check_network_name  # noqa: PLC0415 - as above

    if period <= 0:
        raise click.UsageError("--period must be positive")
    if name is not None:
        check_network_name(name)
    before: dict[object, tuple[float, int]] = {}
    with (
        connected(connect, listen, config, wait=0.0 if once else None) as session,
        closing(InPlace(as_json=as_json)) as place,
        suppress(KeyboardInterrupt),  # the usual end
    ):
        while True:
            began = time.monotonic()
            rows = _with_rates(status(name, session=session), before)
            if as_json:
                body = {"time_ns": time.time_ns(), "found": [_body(*row) for row in rows]}
                output.emit_json_line("net top", body)
            else:
                place.show(_table(rows))
            if once:
                return
            time.sleep(max(began + period / NS - time.monotonic(), 0.0))


def _with_rates(found: list[Status], before: dict[object, tuple[float, int]]) -> list[Row]:
    """Add the bytes per second since the previous update, and store the counts for the next."""
    now = time.monotonic()
    rows: list[Row] = []
    for each in found:
        if each.stats is None:
            rows.append((each, None))
            continue
        place = each.name, each.role, each.owner or each.epoch
        since, count = before.get(place, (now, 0))
        rows.append((each, (each.stats.bytes - count) / (now - since) if now > since else None))
        before[place] = now, each.stats.bytes
    return rows


def _body(each: Status, rate: float | None) -> dict[str, Any]:
    epoch = each.epoch
    return {
        "name": each.name,
        "role": each.role,
        "owner": each.owner,
        "state": each.state,
        "epoch": None if epoch is None else {"number": epoch.number, "id": epoch.id.hex()},
        "commit": each.commit,
        "lag": each.lag,
        "behind_ns": None if each.behind is None else round(each.behind * NS),
        "bytes_per_second": rate,
        "stats": None if each.stats is None else each.stats._asdict(),
    }


def _table(rows: Iterable[Row]) -> RenderableType:
    cells = [_row(*row) for row in rows]
    if not cells:
        return layout.quiet("no home and no mirror answers")
    made = layout.table(_COLUMNS, cells)
    homes = sum(row[1] == "home" for row in cells)
    made.title = f"{counted(homes, 'home')}, {counted(len(cells) - homes, 'mirror')}"
    made.title_justify = "left"
    return made


def _row(each: Status, rate: float | None) -> list[str]:
    stats = each.stats
    epoch = "" if each.epoch is None else each.epoch.id.hex()[:8]
    behind = "" if not each.behind else format_duration(round(each.behind * NS))
    own = {} if stats is None or each.role == "home" else stats._asdict()
    counts = [each.commit, each.lag, own.get("gaps"), own.get("states")]
    commit, lag, gaps, resyncs = ("" if count is None else f"{count:,}" for count in counts)
    speed = "" if rate is None else f"{rate / 1e3:,.1f}"
    return [each.name, each.role, each.state, epoch, commit, lag, behind, gaps, resyncs, speed]

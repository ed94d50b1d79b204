"""``tfdb record``: writes the commits of a live store or graph into an MCAP file."""

from __future__ import annotations

import math
import re
import time
from contextlib import suppress
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from tfdb.data.counting import counted
from tfdb.data.time_text import format_duration
from tfdb.recordings.selection import Selection
from tfdb_command import signals_held

from . import common, output
from .graph import STORE, live_source, node_option
from .groups import SuggestingCommand
from .selecting import given, selection_options
from .times import NS, seconds_option

if TYPE_CHECKING:
    from tfdb.recorder import Recorder

    from .graph import Live

_LOOK = 0.2
"""Seconds between two checks whether the source still exists."""
_SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*(?:([kMGT]?)(i?)B)?", re.IGNORECASE)
_rename_option = partial(
    selection_options, without=[each.name for each in fields(Selection) if each.name != "rename"]
)


def size_option(ctx: click.Context, param: click.Parameter, value: str | None) -> int | None:
    """Convert an option's text to bytes: `1000`, `256MB`, `1.5GiB`."""
    if value is None or ctx.resilient_parsing:
        return None
    match = _SIZE.fullmatch(value.strip())
    size = 0
    if match is not None:
        base = 1024 if match[3] else 1000
        size = round(float(match[1]) * base ** " kmgt".index((match[2] or " ").lower()))
    if not 0 < size < 2**63:
        text = f"{value!r} is not a size: write 1000000, 256MB or 1GiB"
        raise click.BadParameter(text, ctx, param)
    return size


@click.command("record", cls=SuggestingCommand)
@click.argument("source", metavar="STORE|ros1:|ros2:")
@common.output_option(
    "OUT.mcap",
    "Write this file. It is called OUT.mcap.part until it is complete.",
    required=True,
)
@common.stop_option
@seconds_option(
    "--flush",
    default="0.5",
    help="Write recorded commits to the file this often. Written commits survive a kill of the "
    "process.",
)
@click.option(
    "--sync",
    is_flag=True,
    help="At each flush, also sync the file to the disk, so that it survives a power cut.",
)
@click.option(
    "--split-size",
    metavar="SIZE",
    callback=size_option,
    help="Start a new file beyond this size: OUT_0.mcap, OUT_1.mcap and so on.",
)
@seconds_option("--split-time", help="Start a new file after this long.")
@click.option(
    "--queue",
    metavar="SIZE",
    default="256MB",
    callback=size_option,
    help="Buffer at most this much while the disk is slow. Commits beyond it are lost.",
)
@click.option(
    "--frame",
    "frames",
    multiple=True,
    metavar="NAME",
    help="Record only the edge from this frame to its parent; repeatable.",
)
@click.option(
    "--exclude",
    multiple=True,
    metavar="NAME",
    help="Leave out the edge from this frame to its parent; * and ? as in a shell. Repeatable.",
)
@_rename_option
@node_option
@common.json_option
def command(
    *,
    source: str,
    out: str,
    length: int | None,
    flush: int,
    sync: bool,
    split_size: int | None,
    split_time: int | None,
    queue: int,
    frames: tuple[str, ...],
    exclude: tuple[str, ...],
    as_json: bool,
) -> None:
    """Record each commit of a live store or graph into an .mcap, until Ctrl-C.

    Example: tfdb record robot1 -o drive.mcap

    STORE is the name of a shared store: robot1 or shm:robot1. Every reader of MCAP finds the
    transforms on /tf and /tf_static. tfdb.recorded_commits restores each commit from /tfdb/commits
    and /tfdb/state. If the process is killed or the disk is full, OUT.mcap.part keeps the flushed
    part; --salvage reads it.

    Exit code: 0 (also after Ctrl-C), 1 if commits were lost, 2 on an error.
    """
    from tfdb.recorder import Recorder  # noqa: PLC0415 - with its room

    if not common.is_live(source) and Path(source).exists():
        raise click.UsageError(
            f"{source} is a file: give a live store or graph; 'tfdb convert' rewrites a recording"
        )
    began = time.monotonic()
    until = math.inf if length is None else began + length / NS
    with live_source(source) as live, signals_held() as release:  # a stopped start leaves no file
        recorder = Recorder(
            live.store,
            out,
            frames=frames or None,
            exclude=exclude,
            flush=flush / NS,
            sync=sync,
            split_size=split_size,
            split_time=None if split_time is None else split_time / NS,
            queue=queue,
            **given(),
        )
        with recorder, suppress(KeyboardInterrupt):  # the usual end
            release()
            if not as_json:
                output.say_wrapped(f"{source} into {out}; Ctrl-C ends it", source, out)
            _wait(live, recorder, until)
        _show(recorder, source, time.monotonic() - began, as_json=as_json)
    if recorder.lost:
        click.get_current_context().exit(1)


def _wait(live: Live, recorder: Recorder, until: float) -> None:
    """Wait for the end of the recording."""
    while (left := until - time.monotonic()) > 0 and not recorder.wait(min(left, _LOOK)):
        live.check()


def _show(recorder: Recorder, source: str, seconds: float, *, as_json: bool) -> None:
    files = [str(path) for path in recorder.files]
    if as_json:
        body: dict[str, Any] = {
            "source": source.removeprefix(STORE),
            "files": files,
            "commits": recorder.commits,
            "lost": recorder.lost,
            "bytes": recorder.size,
            "seconds": round(seconds, 3),
        }
        output.emit_json("record", body)
        return
    text = f"{', '.join(files)}: {counted(recorder.commits, 'commit')}"
    text += f", {recorder.size / 1e6:,.1f} MB, recorded in {format_duration(round(seconds * NS))}"
    output.say_wrapped(text, *files)

"""``tfdb expect``: proposes expectations. Also the option `--expect` of other commands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from tfdb.data.counting import counted

from . import common, layout, output
from .graph import node_option
from .groups import SuggestingCommand
from .selecting import selection_options

if TYPE_CHECKING:
    from collections.abc import Callable

    from click.decorators import FC


def expect_option_of(*, required: bool) -> Callable[[FC], FC]:
    """Return a decorator that adds the option `--expect` to a command."""
    return click.option(
        "--expect",
        metavar="EXPECTATIONS.toml",
        type=click.Path(),
        required=required,
        help="Check the data against the expectations in this file. 'tfdb expect' writes one.",
    )


expect_option: Callable[[FC], FC] = expect_option_of(required=False)


@click.command("expect", cls=SuggestingCommand)
@common.files_argument
@common.output_option("OUT.toml", "Write this file.  [default: print the expectations]")
@common.overwrite_option
@common.watch_option
@node_option
@selection_options
@common.json_option
def command(
    *, files: tuple[str, ...], out: str | None, overwrite: bool, length: int | None, as_json: bool
) -> None:
    """Propose expectations from a good recording: deadlines, ages, steps.

    Example: tfdb expect drive.mcap -o expectations.toml

    The deadline of an edge comes from the intervals between its samples: the longest one, or twice
    their 99.9th percentile if that is greater. Every other limit is twice the largest measured
    value. The recording meets all limits. To check other data, give OUT to --expect of 'tfdb
    check', 'tfdb watch' or 'tfdb monitor'.
    """
    from tfdb.judging.proposing import judge_recording, propose_for  # noqa: PLC0415 - with numpy

    from .check import examined  # noqa: PLC0415 - it has the option of this module

    if out is not None:
        common.check_output(out, common.find_files(files), overwrite=overwrite)
    _, arrivals = examined(files, length)
    proposed = propose_for(arrivals)
    broken = sorted({each.kind for each in judge_recording(arrivals, proposed)})
    if broken:
        text = f"{', '.join(files)} is not a good recording: it has {', '.join(broken)}"
        output.warn(f"{layout.safe(text)}; 'tfdb check' lists them")
    if out is not None:
        proposed.write(out, overwrite=overwrite)
    if as_json:
        body = {"files": list(files), "output": out, "edges": len(proposed.edges)}
        body |= {"authorities": len(proposed.authorities), "events": broken}
        output.emit_json("expect", body | {"text": str(proposed)})
    elif out is None:
        output.say(str(proposed).rstrip())
    else:
        text = f"{out}: expectations of {counted(len(proposed.edges), 'edge')}"
        text += f" and {len(proposed.authorities)} authorities"
        output.say_wrapped(text, out)

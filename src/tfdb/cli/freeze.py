"""``tfdb freeze``: writes a recording into a frozen store."""

from __future__ import annotations

from typing import Any

import click

import tfdb
from tfdb.data.argument_checks import unknown_ending
from tfdb.data.counting import counted
from tfdb.data.path_checks import check_path
from tfdb.store.frozen import SUFFIX

from . import common, output
from .graph import listen_option
from .groups import SuggestingCommand
from .selecting import selection_options


@click.command("freeze", cls=SuggestingCommand)
@common.files_argument
@common.output_option("OUT.tfdb", "Write this file.  [default: NAME.tfdb beside the first FILE]")
@common.overwrite_option
@listen_option
@selection_options
@common.json_option
def command(
    *,
    files: tuple[str, ...],
    out: str | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Write a recording into a .tfdb file, which opens in constant time.

    Example: tfdb freeze drive.mcap -o drive.tfdb

    tfdb.open and most commands, such as 'tfdb lookup', read OUT. Several FILEs are parts of one
    recording. For a shared store (shm:NAME), OUT gets its newest state. For a live graph (ros1:,
    ros2:), OUT gets the transforms that the command receives. Keep the recording: other versions of
    tfdb and other kinds of machines cannot read OUT.
    """
    inputs = common.find_files(files)
    if out is None:
        if len(inputs) < len(files):
            raise click.UsageError(f"{files[0]} has no folder: give -o OUT.tfdb")
        first = check_path(files[0])
        first = first if first.name.strip(".") else first.resolve()
        out = str(first.with_name(first.name if first.is_dir() else first.stem)) + SUFFIX
    if not out.endswith(SUFFIX):
        raise click.UsageError(unknown_ending(out, (SUFFIX,)))
    common.check_output(out, inputs, overwrite=overwrite)
    loaded = common.load(files)
    loaded.store.freeze(out, overwrite=overwrite)
    body = _body(loaded, out)
    if as_json:
        output.emit_json("freeze", body)
        return
    text = f"{out}: {counted(body['samples'], 'sample')} of {counted(body['frames'], 'frame')}, "
    text += f"{body['bytes'] / (1 << 20):,.1f} MiB"
    output.say_wrapped(text, out)


def _body(loaded: common.Loaded, out: str) -> dict[str, Any]:
    infos = loaded.store.tree()
    start, end = loaded.span or (None, None)
    frozen = tfdb.open(out).frozen
    return {
        "files": list(loaded.names),
        "output": out,
        "frames": len(infos),
        "samples": sum(info.samples for info in infos),
        "bytes": frozen.size if frozen is not None else 0,
        "start_ns": start,
        "end_ns": end,
    }

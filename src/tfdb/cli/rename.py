"""``tfdb rename``: copies a recording with other frame names."""

from __future__ import annotations

import click

from . import common
from .convert import recording_writer, show_written, write_selected
from .groups import SuggestingCommand
from .selecting import given, selection_options


@click.command("rename", cls=SuggestingCommand)
@common.file_argument
@common.out_option
@common.compress_option
@common.overwrite_option
@selection_options
@common.json_option
def command(
    *,
    file: str,
    out: str,
    compress: bool,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Copy a recording with new names for its frames.

    Example: tfdb rename drive.mcap -o robot1.mcap --rename map:=world

    FILE stays unchanged; OUT is a .bag, .mcap or .db3. --rename is applied before --prefix. A frame
    of --rename must exist. Two frames must not get the same name.
    """
    if not given().keys() & {"rename", "prefix", "by_namespace"}:
        raise click.UsageError(
            "nothing to rename: give --rename FROM:=TO, --prefix TEXT or --by-namespace; "
            "'tfdb convert' writes a part of a recording under the same names"
        )
    inputs = common.find_paths((file,))
    writer = recording_writer(out, inputs, compress=compress, overwrite=overwrite)
    written = write_selected(inputs, writer, strict=True)
    show_written("rename", inputs, out, written, as_json=as_json)

"""Picture files: names and atomic writing."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

import click

from tfdb.data.argument_checks import not_one_of
from tfdb.data.new_file import new_file
from tfdb.data.path_checks import check_path

from . import common

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

FORMATS = ("png", "svg", "pdf")


def picture_files(
    saved: Sequence[str], file: str, kind: str, read: Sequence[str], *, overwrite: bool
) -> list[Path]:
    """Return the files to write, checked; a format means FILE_KIND.FORMAT in the current folder.

    `read`: names of what the command reads; none of these is written.
    """
    found: list[Path] = []
    for text in saved:
        form = text.lower()
        if form in FORMATS:
            stem = file if common.is_live(file) else check_path(file).stem
            stem = re.sub(r"[^\w.-]+", "_", stem).strip("_.") or "tfdb"
            path = check_path(f"{stem}_{kind}.{form}")
        else:
            path = check_path(text)
            if path.suffix.lower()[1:] not in FORMATS:
                more = "a path that ends in one of them"
                raise click.UsageError(not_one_of("--save", text, FORMATS, more))
        if path in found:
            raise click.UsageError(f"--save names {path} twice")
        found.append(path)
    inputs = common.find_files(read)
    for path in found:
        common.check_output(str(path), inputs, overwrite=overwrite)
    return found


def need_matplotlib() -> None:
    """Raise an error with the install command if matplotlib is missing."""
    try:
        import tfdb.plot  # noqa: F401, PLC0415 - an extra
    except ImportError as error:
        raise click.ClickException(str(error)) from error


def write_pictures(figure: Any, outs: Sequence[Path], *, overwrite: bool) -> None:
    """Write a figure to all its files."""
    for path in outs:
        with new_file(path, overwrite=overwrite) as made:
            figure.savefig(made, format=path.suffix[1:].lower())

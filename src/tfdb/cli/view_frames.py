"""``tfdb view-frames``: draws the frame tree."""

from __future__ import annotations

import shutil
import subprocess
import time
from typing import TYPE_CHECKING

import click

from tfdb.data.counting import counted
from tfdb.data.new_file import new_file
from tfdb.data.path_checks import check_path
from tfdb.data.stamps import format_seconds
from tfdb.data.time_text import format_duration
from tfdb.judging.events import ANOTHER_CLOCK
from tfdb.store.summary import Forest
from tfdb.tf2.all_frames import in_dot

from . import common, output
from .graph import listen_option
from .groups import SuggestingCommand
from .selecting import selection_options

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    from tfdb.data.types import FrameInfo

_DOT = (".dot", ".gv")
_PICTURES = (".svg", ".pdf", ".png")


@click.command("view-frames", cls=SuggestingCommand)
@common.files_argument
@common.output_option(
    "OUT",
    "Write this .pdf, .svg, .png, .dot or .gv file. '-' writes DOT to stdout. With any other "
    "extension, OUT.gv and OUT.pdf are written.  [default: frames_DATE_TIME]",
)
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
    """Draw the frame tree as PDF, SVG or DOT, like tf2's view_frames.

    Example: tfdb view-frames drive.mcap -o tree.svg

    From a live graph (ros1:, ros2:) the command listens for five seconds first. Graphviz draws the
    tree if it is installed, otherwise matplotlib.
    """
    outs = _outputs(out, files, overwrite=overwrite)
    if as_json and out == "-":
        raise click.UsageError("--json needs an output file: give -o OUT")
    loaded = common.load(files, apart=True)
    infos = loaded.store.tree()
    dot = "\n".join(_dot(infos, loaded.now)) + "\n"
    if out == "-":
        output.say(dot, nl=False)
        return
    for path in outs:
        with new_file(path, overwrite=overwrite) as made:
            _draw(made, dot, infos)
    if as_json:
        outputs = [str(path) for path in outs]
        body = {"files": list(loaded.names), "outputs": outputs, "frames": len(infos)}
        output.emit_json("view-frames", body)
    else:
        output.say(f"{', '.join(map(str, outs))}: {counted(len(infos), 'frame')}")


def _outputs(out: str | None, files: Sequence[str], *, overwrite: bool) -> list[Path]:
    """Return the files to write. Invalid ones are refused before the input is read."""
    if out == "-":
        return []
    if out is None:
        out = time.strftime("frames_%Y-%m-%d_%H.%M.%S")
    path = check_path(out)
    single = path.suffix.lower() in (*_DOT, *_PICTURES)
    # Append the extension: the name may have a dot, as the default does.
    found = [path] if single else [path.with_name(path.name + end) for end in (".gv", ".pdf")]
    read = common.find_files(files)
    for each in found:
        common.check_output(str(each), read, overwrite=overwrite)
    return found


def _draw(path: Path, dot: str, infos: Sequence[FrameInfo]) -> None:
    """Write one file, in the format of its extension."""
    kind = path.suffix.lower()
    if kind in _DOT:
        path.write_text(dot, encoding="utf-8")
        return
    program = shutil.which("dot")
    if program is None:
        try:
            from tfdb import plot  # noqa: PLC0415 - it is an extra
        except ImportError as error:
            raise click.ClickException(
                f"{error}; or install graphviz, or write DOT with -o OUT.dot"
            ) from error
        plot.frame_tree(infos).savefig(path)
        return
    command = [program, f"-T{kind[1:]}", "-o", str(path)]
    # The command is fixed; frame names are only in its input.
    done = subprocess.run(  # noqa: S603
        command, input=dot, capture_output=True, encoding="utf-8", errors="replace", check=False
    )
    if done.returncode != 0:
        raise click.ClickException(f"{program} failed: {done.stderr.strip()}")


def _dot(infos: Sequence[FrameInfo], now: int | None) -> Iterator[str]:
    """Return the tree as DOT lines; `now`, by the clock of the stamps, gives the ages."""
    yield "digraph frames {"
    yield '  node [shape=box, style=rounded, fontname="sans-serif"];'
    yield '  edge [fontname="sans-serif", fontsize=9];'
    if not infos:
        yield '  "no transforms" [shape=plaintext];'
    for row in Forest(infos).rows():
        info = row.info
        yield f"  {in_dot(info.name)};"
        if info.parent is not None:
            label = in_dot(*_facts(info, now))
            style = ', style=dashed, color="gray50"' if info.is_static else ""
            yield f"  {in_dot(info.parent)} -> {in_dot(info.name)} [label={label}{style}];"
    yield "}"


def _facts(info: FrameInfo, now: int | None) -> Iterator[str]:
    """Return the label of an edge."""
    yield info.authority or "publisher unknown"
    if info.is_static:
        yield "static"
        return
    if info.rate is not None:
        yield f"{info.rate:.4g} Hz"
    if info.oldest is None or info.newest is None:
        return
    newest = f"newest {format_seconds(info.newest)}"
    if now is not None and abs(now - info.newest) < ANOTHER_CLOCK:
        newest += f", {format_duration(now - info.newest)} old"
    yield newest
    yield f"{format_duration(info.newest - info.oldest)} kept"

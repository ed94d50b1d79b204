"""``tfdb convert``: writes the transforms of a recording in another format."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

import tfdb
from tfdb.data.argument_checks import unknown_ending
from tfdb.data.counting import counted
from tfdb.data.path_checks import check_path
from tfdb.recordings.containers import TRAJECTORIES
from tfdb.recordings.recording_writer import RecordingWriter
from tfdb.recordings.rewriting import Written, rewrite
from tfdb.recordings.selection import absolute

from . import common, output
from .groups import SuggestingCommand
from .selecting import selection_options

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from tfdb._core import StoreReader
    from tfdb.trajectories.file_formats import Format

RECORDINGS = (".bag", ".mcap", ".db3")
RERUN = ".rrd"
_FEW = 5
"""Largest number of frames that an error lists."""


@click.command("convert", cls=SuggestingCommand)
@click.argument("files", nargs=-1, required=True, metavar="IN...", type=click.Path())
@click.argument("out", type=click.Path())
@click.option(
    "--frames",
    nargs=2,
    metavar="TARGET SOURCE",
    help="Frames of a written trajectory: T[TARGET<-SOURCE] at each stored stamp.  [default: those "
    "of the only edge]",
)
@click.option("--foxglove", is_flag=True, help="Write an .mcap with messages that Foxglove draws.")
@common.compress_option
@common.format_option
@common.overwrite_option
@selection_options
@common.json_option
def command(
    *,
    files: tuple[str, ...],
    out: str,
    frames: tuple[str, str] | None,
    foxglove: bool,
    compress: bool,
    kind: Format | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Rewrite the transforms of a recording as .bag, .mcap, .db3 or a trajectory.

    Example: tfdb convert drive.bag drive.mcap

    Example of a part: tfdb convert drive.bag part.bag --start +2 --end +5 --exclude 'l_*'

    For viewers, write an .rrd for Rerun, or an .mcap with --foxglove for Foxglove.

    Between recordings each message keeps its topic, its receive time and, if OUT can hold it, its
    publisher. Topics of other messages, such as images, are dropped. Several INs become one OUT.
    """
    path = check_path(out)
    suffix = path.suffix.lower()
    known = (*RECORDINGS, RERUN, *TRAJECTORIES)
    is_trajectory = kind is not None or suffix in TRAJECTORIES
    if suffix not in known and not is_trajectory:
        common.refuse_format_ending(out)
        raise click.UsageError(unknown_ending(out, known))
    if kind is not None and suffix in (*RECORDINGS, RERUN):
        raise click.UsageError(
            f"--format is valid for trajectories, and {out!r} is a recording by its extension"
        )
    if foxglove and suffix != ".mcap":
        raise click.UsageError(f"--foxglove writes .mcap, not {out!r}")
    if compress and (foxglove or suffix == RERUN or is_trajectory):
        raise click.UsageError("--compress is valid for recordings only: .mcap, .bag")
    if frames is not None and not is_trajectory:
        endings = ", ".join(TRAJECTORIES)
        raise click.UsageError(f"--frames TARGET SOURCE is valid for trajectories only: {endings}")
    inputs = common.find_paths(files)
    common.check_output(out, inputs, overwrite=overwrite)
    if is_trajectory:
        loaded = common.load(files)
        frames = frames or _only_edge(loaded.store, out)
        target, source = common.find_frames(loaded.store, *frames)
        poses = loaded.store.trajectory(target, source)
        poses.save(out, kind, overwrite=overwrite)
        messages = loaded.report.messages if loaded.report else 0
        written = Written(messages, len(poses.stamps))
    elif foxglove or suffix == RERUN:
        loaded = common.load(files)
        export = tfdb.to_foxglove if foxglove else tfdb.to_rerun
        messages = loaded.report.messages if loaded.report else 0
        written = Written(messages, export(loaded.store, out, overwrite=overwrite))
    else:
        writer = RecordingWriter(path, compress=compress, overwrite=overwrite)
        written = write_selected(inputs, writer)
    show_written("convert", inputs, out, written, frames=frames or (), as_json=as_json)


def _only_edge(store: StoreReader, out: str) -> tuple[str, str]:
    """Return the frames of a store with one edge, the parent first; refuse other stores."""
    edges = [(info.parent, info.name) for info in store.tree() if info.parent is not None]
    if len(edges) == 1:
        return edges[0]
    frames = sorted(store.frames())
    listed = f"; the frames are {', '.join(map(repr, frames))}" if len(frames) <= _FEW else ""
    raise click.UsageError(f"{out!r} is a trajectory: name its --frames TARGET SOURCE{listed}")


def recording_writer(
    out: str, inputs: Sequence[Path], *, compress: bool, overwrite: bool
) -> RecordingWriter:
    """Check the path of a recording to write, and return its writer."""
    path = check_path(out)
    if path.suffix.lower() not in RECORDINGS:
        raise click.UsageError(unknown_ending(out, RECORDINGS))
    common.check_output(out, inputs, overwrite=overwrite)
    return RecordingWriter(path, compress=compress, overwrite=overwrite)


def show_written(
    command: str,
    inputs: Sequence[Path],
    out: str,
    written: Written,
    *,
    frames: Sequence[str] = (),
    as_json: bool,
) -> None:
    """Print what was written: transforms, or the poses of T[frames[0]<-frames[1]]."""
    if as_json:
        body = {
            "files": [str(path) for path in inputs],
            "output": out,
            "messages": written.messages,
            "transforms": written.transforms,
            "refused_transforms": written.refused,
            "skipped": written.skipped,
        }
        output.emit_json(command, body)
        return
    if frames:
        text = f"{counted(written.transforms, 'pose')} of {frames[1]} in {frames[0]}"
    else:
        transforms = counted(written.transforms, "transform")
        text = f"{transforms} in {counted(written.messages, 'message')}"
        text += f", {counted(written.refused, 'transform')} refused" if written.refused else ""
        text += f", {written.skipped:,} broken" if written.skipped else ""
    output.say_wrapped(f"{out}: {text}", out, *frames)


def write_selected(
    inputs: Sequence[Path], writer: RecordingWriter, *, strict: bool = False
) -> Written:
    """Write the selected part of recordings; `strict`: each frame to rename must exist."""
    with common.open_selected(inputs) as recordings:
        rewriter = recordings.rewriter(one_tree=False)
        if not recordings.count:
            topics = sorted({absolute(source.topic) for source in recordings.sources})
            text = f"nothing to convert: no message of {', '.join(topics)} could be read"
            raise click.ClickException(text)
        with writer, common.progress_bar("converting") as update:
            written = rewrite(recordings, [rewriter] * len(inputs), writer, update)
            if strict:
                rewriter.check_renamed()
            if not written.messages and rewriter.left_out:
                raise click.ClickException(f"nothing to convert: {rewriter.reason()}")
        rewriter.warn(recordings.names, 2)
    return written

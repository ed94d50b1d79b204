"""``tfdb merge``: merges several recordings into one."""

from __future__ import annotations

import warnings
from functools import partial
from typing import TYPE_CHECKING

import click

import tfdb
from tfdb.recordings.open_recordings import each_once, survey_edges
from tfdb.recordings.rewriter import warn_of_names
from tfdb.recordings.rewriting import Written, rewrite

from . import common, layout
from .convert import recording_writer, show_written
from .groups import SuggestingCommand
from .selecting import selection_options

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence
    from pathlib import Path

    from tfdb.recordings.open_recordings import OpenRecordings
    from tfdb.recordings.recording import Recording
    from tfdb.recordings.recording_writer import RecordingWriter
    from tfdb.recordings.rewriter import Rewriter


@click.command("merge", cls=SuggestingCommand)
@common.files_argument
@common.out_option
@click.option(
    "--prefix",
    "prefixes",
    multiple=True,
    metavar="TEXT",
    help="Put TEXT before the frame names of one FILE. Give the option once for each FILE, in the "
    "order of the FILEs; '' adds nothing.",
)
@common.compress_option
@common.overwrite_option
@partial(selection_options, without=("prefix",))
@common.json_option
def command(
    *,
    files: tuple[str, ...],
    out: str,
    prefixes: tuple[str, ...],
    compress: bool,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Merge several recordings into one, sorted by time.

    Example: tfdb merge a.bag b.bag -o both.mcap --prefix a/ --prefix b/

    Each message keeps its topic, its receive time and, if OUT can hold it, its publisher. Files
    that contradict each other on an edge are refused: give each its own --prefix, or use --mix.
    Consecutive parts of one recording do not contradict each other.
    """
    if len(files) < 2:
        raise click.UsageError("nothing to merge: give two files or more; 'tfdb rename' copies one")
    if prefixes and len(prefixes) != len(files):
        raise click.UsageError(
            f"give --prefix once per FILE: got {len(prefixes)} for {len(files)} files"
        )
    inputs = common.find_paths(files)
    writer = recording_writer(out, inputs, compress=compress, overwrite=overwrite)
    written = _merge(inputs, prefixes, writer)
    show_written("merge", inputs, out, written, as_json=as_json)


def _merge(inputs: Sequence[Path], prefixes: Sequence[str], writer: RecordingWriter) -> Written:
    with common.open_selected(inputs) as recordings:
        rewriters = _rewriters(recordings, prefixes or [recordings.choice.prefix] * len(inputs))
        _check(recordings, rewriters)
        again = {rewriter: rewriter.again() for rewriter in rewriters}
        with writer, common.progress_bar("merging") as update:
            rewriters = [again[rewriter] for rewriter in rewriters]
            return rewrite(recordings, rewriters, writer, update, by_time=True)


def _rewriters(recordings: OpenRecordings, prefixes: Sequence[str]) -> list[Rewriter]:
    """Make one rewriter for each prefix: the files of one prefix are parts of one recording."""
    names = [prefix.removeprefix("/") for prefix in prefixes]
    robots: dict[str, list[Recording]] = {}
    pairs = zip(names, recordings.given, strict=True)
    for name, recording in sorted(pairs, key=lambda pair: pair[1].start):
        robots.setdefault(name, []).append(recording)
    for files in robots.values():
        each_once([recording.path for recording in files])
    made = dict(zip(robots, recordings.rewriters(list(robots.items())), strict=True))
    return [made[name] for name in names]


def _check(recordings: OpenRecordings, rewriters: Sequence[Rewriter]) -> None:
    """Warn of files without a merged transform; refuse files whose edges form a cycle."""
    parents = [
        _parents(recordings, *each) for each in zip(recordings.given, rewriters, strict=True)
    ]
    if not any(parents):
        reasons = [rewriter.reason() for rewriter in rewriters if rewriter.left_out]
        raise click.ClickException(": ".join(["nothing to merge", *reasons[:1]]))
    for recording, found in zip(recordings.given, parents, strict=True):
        if not found:
            text = f"{recording.path}: none of its transforms is merged"
            warnings.warn(text, tfdb.TfdbWarning, stacklevel=2)
    robots = list(dict.fromkeys(rewriters))
    warn_of_names(robots, recordings.names, 2)
    for rewriter in robots:
        named = [
            r.path for r, each in zip(recordings.given, rewriters, strict=True) if each is rewriter
        ]
        rewriter.warn_of_data(", ".join(map(str, named)), 2)
    if recordings.choice.mix:
        return
    _refuse_collisions(recordings, rewriters, parents)
    by_start = sorted(zip(recordings.given, parents, strict=True), key=lambda pair: pair[0].start)
    edges = {child: parent for _, found in by_start for child, parent in found.items()}
    at, turn = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
    try:
        tfdb.Buffer().set_transforms(
            [tfdb.TransformStamped(parent, child, 0, at, turn) for child, parent in edges.items()],
            static=True,
        )
    except tfdb.errors.CycleError as error:
        frames = " <- ".join(layout.safe(name) for name in error.frames or ())
        raise click.ClickException(
            f"{recordings.names} together make a cycle, {frames}: --prefix keeps their frames "
            "apart, --exclude leaves frames out, --mix merges them"
        ) from None


def _refuse_collisions(
    recordings: OpenRecordings, rewriters: Sequence[Rewriter], parents: Sequence[Iterable[str]]
) -> None:
    """Refuse prefixes with which child frames of different files get one name."""
    owners: dict[str, tuple[Rewriter, Recording]] = {}
    for recording, rewriter, children in zip(recordings.given, rewriters, parents, strict=True):
        for child in children:
            owner, other = owners.setdefault(child, (rewriter, recording))
            if owner is not rewriter:
                raise click.ClickException(
                    f"the prefixes give frames of {other.path} and of {recording.path} one name, "
                    f"{layout.safe(child)!r}: give another --prefix, or --mix them"
                )


def _parents(
    recordings: OpenRecordings, recording: Recording, rewriter: Rewriter
) -> dict[str, str]:
    """Return the newest parent of each merged child frame of a file."""
    found = survey_edges(recordings, [recording], rewriter)
    fixed = {joint.child: joint.parent for joint in rewriter.fixed_joints()}
    if found is not None:
        return fixed | {child: parent for child, (parent,) in found.parents.items()}
    store, judge = tfdb.Buffer(history=None), rewriter.again()
    for run in recordings.read_one(recording):
        judge.ingest(run, store, *recordings.choice.kind(run.source))
    return fixed | {info.name: info.parent for info in store.tree() if info.parent is not None}

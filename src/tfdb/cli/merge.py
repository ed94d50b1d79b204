"""``tfdb merge``: several recordings in one."""

from __future__ import annotations

import warnings
from contextlib import ExitStack
from functools import partial
from itertools import combinations
from typing import TYPE_CHECKING

import click

import tfdb
from tfdb.data.counting import counted
from tfdb.data.time_text import format_when
from tfdb.recordings.choice import Choice
from tfdb.recordings.loading import Selection
from tfdb.recordings.recording_writer import RecordingWriter
from tfdb.recordings.rewriting import Rewriting, Written, merged
from tfdb.store.summary import span

from . import common, layout, output
from .convert import body, describe, recording_path
from .groups import SuggestingCommand

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence
    from pathlib import Path

    from tfdb import Buffer
    from tfdb.data.types import FrameInfo
    from tfdb.recordings.choice import Rewriter
    from tfdb.recordings.recording import Recording


@click.command("merge", cls=SuggestingCommand)
@common.files_argument
@common.out_option
@click.option(
    "--prefix",
    "prefixes",
    multiple=True,
    metavar="TEXT",
    help="Put TEXT before the frame names of one FILE. Give it once per FILE, in their order; '' "
    "adds nothing.",
)
@click.option("--compress", is_flag=True, help="Compress OUT: zstd for .mcap, bz2 for .bag.")
@common.overwrite_option
@partial(common.topic_option, prefix=False)
@common.json_option
def command(
    *,
    files: tuple[str, ...],
    out: str,
    prefixes: tuple[str, ...],
    compress: bool,
    overwrite: bool,
    topics: tuple[str, ...],
    as_json: bool,
) -> None:
    """Merge several recordings into one, sorted by time.

    Example: tfdb merge a.bag b.bag -o both.mcap --prefix a/ --prefix b/

    Each message keeps its topic, its receive time and, if OUT can hold it, its publisher. Files
    that write the same edge at the same time are refused: give each its own --prefix, or rename
    frames by 'tfdb rename'. Consecutive parts of one recording do not conflict.
    """
    if len(files) < 2:
        raise click.UsageError("one file is nothing to merge: give two or more")
    if prefixes and len(prefixes) != len(files):
        raise click.UsageError(
            f"--prefix is given once for each FILE: {len(files)} files, {len(prefixes)} prefixes"
        )
    inputs = common.find_paths(files)
    path = recording_path(out, inputs, overwrite=overwrite)
    writer = RecordingWriter(path, compress=compress, overwrite=overwrite)
    written = _merge(inputs, prefixes, writer, common.parse_topics(topics))
    if as_json:
        output.emit_json("merge", body(inputs, out, written))
    else:
        output.say(layout.wrap(layout.words(f"{out}: {describe(written)}", out)))


def _merge(
    inputs: Sequence[Path],
    prefixes: Sequence[str],
    writer: RecordingWriter,
    renamed: Mapping[str, str] | None,
) -> Written:
    with ExitStack() as stack:
        recordings = common.opened(stack, inputs)
        choice = Choice(**common.chosen())
        selection = Selection(renamed, choice)
        selection.check(recordings)

        def resolve() -> list[Rewriter]:
            """The rewriter of each file; without prefixes they are parts of one recording."""
            if not prefixes:
                rewriter = choice.resolve(recordings, selection.wants, selection.kind)
                selection.refuse_groups(recordings, rewriter)
                for recording in recordings:
                    selection.refuse_parts([recording], rewriter)
                return [rewriter] * len(recordings)
            robots = [(prefix, [each]) for prefix, each in zip(prefixes, recordings, strict=True)]
            made = choice.resolve_apart(robots, selection.wants, selection.kind)
            for rewriter, recording in zip(made, recordings, strict=True):
                selection.refuse_mixture([recording], rewriter)
            return made

        _refuse_conflicts(recordings, resolve(), selection)
        rewriters = resolve()
        total = selection.count(recordings)
        stack.enter_context(writer)
        update = stack.enter_context(common.progress_bar("merging"))
        rewriting = Rewriting(writer, selection, renamed or {})
        start = min(recording.start for recording in recordings)
        rewriting.write_fixed_joints(dict.fromkeys(rewriters), start)
        total += rewriting.written.messages
        streams = list(map(rewriting.messages, recordings, rewriters))
        for part in merged(streams):
            writer.write_messages(part)
            if update is not None:
                update(rewriting.written.read, total)
    rewriting.warn_of_refused(inputs, dict.fromkeys(rewriters))
    return rewriting.written


def _refuse_conflicts(
    recordings: Sequence[Recording], rewriters: Sequence[Rewriter], selection: Selection
) -> None:
    """Refuse files that write one edge at the same time, or whose edges make a cycle."""
    inputs = [recording.path for recording in recordings]
    stores = []
    received = []
    for recording, rewriter in zip(recordings, rewriters, strict=True):
        store = tfdb.Buffer(history=None)
        store.set_transforms(rewriter.fixed_joints(), static=True)
        times = []
        for run in recording.read(selection.wants, selection.kind):
            kind, is_static = selection.kind(run.source)
            rewriter.ingest(run, store, kind, is_static)
            if not is_static:
                times += [run.start, run.end]
        stores.append(store)
        received.append((min(times, default=0), max(times, default=0)))
    if not any(store.frames() for store in stores):
        reasons = [rewriter.reason() for rewriter in rewriters if rewriter.left_out]
        raise click.ClickException(": ".join(["nothing to merge", *reasons[:1]]))
    for path, store in zip(inputs, stores, strict=True):
        if not store.frames():
            warnings.warn(f"{path}: nothing of it is merged", tfdb.TfdbWarning, 2)
    for rewriter in dict.fromkeys(rewriters):
        named = [path for path, each in zip(inputs, rewriters, strict=True) if each is rewriter]
        rewriter.warn(", ".join(map(str, named)), 2)
    files = zip(inputs, stores, received, strict=True)
    for (one, ours, first), (other, theirs, second) in combinations(files, 2):
        # Parts received one after the other may share stamps: samples come late.
        beside = max(first[0], second[0]) <= min(first[1], second[1])
        found = list(_conflicts(ours, theirs, beside=beside))
        if found:
            more = f", and {counted(len(found) - 1, 'more edge')}" if len(found) > 1 else ""
            raise click.ClickException(
                f"{one} and {other} {found[0]}{more}: --prefix keeps their frames apart, "
                "'tfdb rename' gives one of them other names, --exclude leaves frames out"
            )
    edges = {}
    for store in sorted(stores, key=lambda store: span(store.tree()) or (0, 0)):
        for info in store.tree():
            if info.parent is not None:
                edges[info.name] = tfdb.TransformStamped(
                    info.parent, info.name, 0, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)
                )
    try:
        tfdb.Buffer().set_transforms(list(edges.values()), static=True)
    except tfdb.errors.CycleError as error:
        frames = " <- ".join(layout.safe(name) for name in error.frames or ())
        raise click.ClickException(
            f"{', '.join(map(str, inputs))} together make a cycle, {frames}: --prefix keeps their "
            "frames apart, --exclude leaves frames out"
        ) from None


def _conflicts(one: Buffer, other: Buffer, *, beside: bool) -> Iterator[str]:
    """Say of each edge in both stores how they contradict each other, if they do.

    `beside`: the files were received at the same time.
    """
    theirs = {info.name: info for info in other.tree() if info.parent is not None}
    for info in one.tree():
        edge = theirs.get(info.name)
        if info.parent is None or edge is None:
            continue
        name = "".join(layout.transform_name(info.parent, info.name))
        if info.is_static != edge.is_static:
            yield f"write {name} as static and as moving"
        elif info.is_static:
            if _static(one, info) != _static(other, edge):
                yield f"have another static {name}"
        elif beside and info.oldest is not None and edge.oldest is not None:
            first = max(info.oldest, edge.oldest)
            last = min(info.newest or 0, edge.newest or 0)
            if first <= last:
                times = f"from {format_when(first)} to {format_when(last)}"
                yield f"both write {name} {times}"


def _static(store: Buffer, info: FrameInfo) -> tuple[str | None, list[float]]:
    return info.parent, store.samples(info.name)[1][0].tolist()

"""Common code of commands: options, loading with a progress bar, errors with remedies."""

from __future__ import annotations

import errno
import sys
import warnings
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import chain, islice
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

import click

import tfdb
from tfdb.data.argument_checks import unknown_word
from tfdb.data.decimal_time import parse_stamp
from tfdb.data.path_checks import check_path, first_missing, missing_file
from tfdb.data.suggestions import near_names
from tfdb.data.time_text import format_dates, format_ns
from tfdb.recordings.selection import Selection
from tfdb.store.frozen import is_frozen
from tfdb.store.summary import Forest

from . import output
from .graph import STORE, is_graph, listen_once, open_live
from .groups import OneOf
from .selecting import given, refuse_selection, selected, time_bounds
from .times import seconds_option, warn_of_bounds

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from pathlib import Path

    from click.decorators import FC
    from rich.progress import Progress as Bar
    from rich.progress import ProgressColumn

    from tfdb import Buffer, Snapshot
    from tfdb._core import StoreReader
    from tfdb.data.loss import Loss
    from tfdb.data.types import Progress
    from tfdb.recordings.arrivals import ArrivalReader
    from tfdb.recordings.load_report import LoadReport
    from tfdb.recordings.open_recordings import OpenRecordings

_COMPLETION_MESSAGES = 200
"""Messages of each kind that completion reads: few, so that the shell responds at once."""

files_argument: Callable[[FC], FC] = click.argument(
    "files", nargs=-1, required=True, metavar="FILE...", type=click.Path()
)
file_argument: Callable[[FC], FC] = click.argument("file", type=click.Path())
json_option: Callable[[FC], FC] = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON object instead of text."
)
json_lines_option: Callable[[FC], FC] = click.option(
    "--json", "as_json", is_flag=True, help="Print one JSON object per line instead of text."
)


def open_selected(paths: Sequence[Path]) -> OpenRecordings:
    """Open recordings to read the part that the options select; report their losses."""
    from tfdb.recordings.open_recordings import OpenRecordings  # noqa: PLC0415 - not for frozen stores
    from tfdb.trajectories.reading_report import warn_of_rows  # noqa: PLC0415

    refuse_frozen(paths)
    opened = OpenRecordings(paths, selected())
    for recording in opened.files:
        for note in recording.notes:
            warnings.warn(note, tfdb.TfdbWarning, stacklevel=2)
        if recording.rows is None:
            report_losses(recording.losses)
        else:
            warn_of_rows(recording.rows, 2)
    return opened


def refuse_frozen(paths: Iterable[Path], lacks: str = "messages") -> None:
    """Refuse frozen stores, because they have no messages or no arrival times."""
    for path in paths:
        if is_frozen(path):
            raise click.UsageError(
                f"{path} is a frozen store, which has no {lacks}; give the recording that it was "
                "made from"
            )


def report_losses(losses: Iterable[Loss]) -> None:
    """Print the losses of salvaged files on stderr."""
    for loss in losses:
        output.say(f"tfdb: salvaged {loss}", err=True)


max_gap_option: Callable[[FC], FC] = seconds_option(
    "--max-gap",
    help="Report only gaps longer than this.  [default: five median periods of each edge]",
)
stop_option: Callable[[FC], FC] = seconds_option("--for", "length", help="Stop after this long.")
watch_option: Callable[[FC], FC] = seconds_option(
    "--for",
    "length",
    help="Watch a shared store (shm:NAME) or graph (ros1:, ros2:) for this long.  "
    "[default of a graph: 5]",
)
more_option: Callable[[FC], FC] = click.option(
    "--with",
    "more",
    multiple=True,
    type=click.Path(),
    metavar="FILE",
    help="Read another file of the same recording; repeatable.",
)


def output_option(
    metavar: str,
    help: str,  # noqa: A002 - as click calls it
    *,
    required: bool = False,
) -> Callable[[FC], FC]:
    """Make the option for the file that a command writes."""
    return click.option(
        "-o", "--output", "out", required=required, type=click.Path(), metavar=metavar, help=help
    )


out_option: Callable[[FC], FC] = output_option(
    "OUT", "Write this .bag, .mcap or .db3.", required=True
)
format_option: Callable[[FC], FC] = click.option(
    "--format",
    "kind",
    type=OneOf(["tum", "kitti", "euroc", "csv", "npz", "parquet"]),
    help="Format of a written trajectory.  [default: by the extension of OUT; .txt is TUM]",
)
_BY_FORMAT = {".kitti": ".txt", ".euroc": ".csv"}
"""Endings that name a format of --format, and the extension of its files."""


def refuse_format_ending(out: str) -> None:
    """Refuse a file that ends in the name of a format which only --format selects."""
    path = PurePath(out)
    ending = path.suffix.lower()
    if ending in _BY_FORMAT:
        name = path.with_suffix(_BY_FORMAT[ending])
        raise click.UsageError(
            f"{out!r} ends in the name of a format: give --format {ending[1:]} and a name that "
            f"ends in {name.suffix}, such as {str(name)!r}"
        )


compress_option: Callable[[FC], FC] = click.option(
    "--compress", is_flag=True, help="Compress OUT: zstd for .mcap, bz2 for .bag."
)
overwrite_option: Callable[[FC], FC] = click.option(
    "--overwrite", is_flag=True, help="Replace the output file if it exists."
)


@dataclass(frozen=True)
class Loaded:
    """The data that a command reads.

    `store` holds a recording, the transforms received from a graph, a frozen store, or the newest
    state of a live store. Only a recording has a `report`.
    """

    store: Buffer | Snapshot
    report: LoadReport | None
    names: tuple[str, ...]
    selection: Selection = field(default_factory=Selection)
    """The part that was read; if sources disagree, as it is shown."""
    now: int | None = None
    """Time of the state of a live graph or store, by its clock."""
    mixed: tfdb.errors.MixedSources | None = None
    """The disagreement for which prefixes were added, or sources mixed, without such an option."""
    shown: str = ""
    """How sources that disagree were loaded, as text."""

    def warn_of_mixture(self) -> None:
        """Warn of sources that disagree; the warning describes how they are shown."""
        if self.mixed is not None:
            text = f"{self.mixed}. Shown here: {self.shown}"
            warnings.warn(text, tfdb.TfdbWarning, stacklevel=3)

    @property
    def live(self) -> bool:
        """Whether the data come from a live store or graph."""
        return is_live(self.names[0])

    @property
    def span(self) -> tuple[int, int] | None:
        """The first and the last moving stamp in nanoseconds; None if no edge moves."""
        return self.store._span()


def is_live(name: str) -> bool:
    """Return whether a name is that of a live store or graph."""
    return name.startswith(STORE) or is_graph(name)


def find_paths(names: Sequence[str]) -> tuple[Path, ...]:
    """Check that the files exist. The error for a missing one names the most similar file."""
    paths = tuple(check_path(name) for name in names)
    for name in names:
        if is_live(name):
            what = "graph" if is_graph(name) else "store"
            raise click.UsageError(f"{name} is a live {what}; this command reads files only")
    for name, path in zip(names, paths, strict=True):
        if not path.exists():
            raise _missing(name, path)
    return paths


def find_files(names: Sequence[str]) -> tuple[Path, ...]:
    """Check that those of the names exist that are files, not live stores or graphs."""
    return find_paths([name for name in names if not is_live(name)])


def _missing(name: str, path: Path) -> FileNotFoundError:
    """Make the error of a missing file, whose name may be meant as a shared store or a graph."""
    from tfdb.store.shared import path_of  # noqa: PLC0415 - only for this error

    with suppress(tfdb.TfdbError):  # a name cannot be a path
        if path_of(name).exists():
            text = f"no such file; the shared store of this name is {STORE}{name}"
            return FileNotFoundError(errno.ENOENT, text, name)
    if name.startswith("ros") and ":" in name:
        text = "no such graph; give ros1:, ros2:, ros2+zenoh: or ros2+dds:"
        return FileNotFoundError(errno.ENOENT, text, name)
    return missing_file(path)


def check_output(out: str, inputs: Sequence[Path], *, overwrite: bool) -> None:
    """Refuse an output in a missing folder, one that is an input, and one that exists."""
    from tfdb.data.new_file import is_one_of, refuse_existing  # noqa: PLC0415 - for what is written

    path = check_path(out)
    if not path.parent.is_dir():
        missing = first_missing(path.parent)
        what = "is not a folder" if missing.exists() else "the folder is missing; make it first"
        raise FileNotFoundError(errno.ENOENT, what, str(missing))
    if is_one_of(path, inputs):
        raise click.ClickException(f"{out} is also an input; choose another name")
    hint = "exists already; --overwrite replaces it"
    refuse_existing(path, overwrite=overwrite, refusal=_refusal, hint=hint)


def _refusal(path: Path, reason: str) -> click.ClickException:
    return click.ClickException(f"{path}: {reason}")


def load(
    names: Sequence[str],
    *,
    verify: bool = False,
    there: Callable[[Buffer], bool] | None = None,
    apart: bool = False,
    arrivals: ArrivalReader | None = None,
) -> Loaded:
    """Load the selected data into one store that keeps everything.

    `apart`: if sources disagree, warn and return the error in `mixed`. Groups of topics then get
    prefixes, as by `--by-namespace`. Files, and groups whose prefixed names are equal, are mixed,
    as by `--mix`. `arrivals` gets each message of recordings.

    A live or frozen store is read as it is; `verify` compares a frozen one with its checksum. From
    a graph the command receives until `there` holds for the store, or the time is over.
    """
    if any(is_graph(name) for name in names):
        refuse_selection(names, "a graph", "ros1: or ros2:")
        heard, now = listen_once(names[0], there)
        return Loaded(heard, None, tuple(names), now=now)
    if any(name.startswith(STORE) for name in names):
        refuse_selection(names, "a live store", "shm:NAME")
        store = open_live(names[0])
        return Loaded(store.snapshot(), None, tuple(names), now=store.clock.now())
    paths = find_paths(names)
    if any(is_frozen(path) for path in paths):
        refuse_selection(names, "a frozen store", "FILE.tfdb")
        return Loaded(tfdb.open(paths[0], verify=verify), None, (str(paths[0]),))
    with progress_bar("reading") as update:
        loaded = _load(paths, update, arrivals, apart=apart)
    if loaded.report is not None:
        told = {rows.path for rows in loaded.report.trajectories}  # their warnings count it
        report_losses(loss for loss in loaded.report.lost if loss.path not in told)
    warn_of_bounds(loaded.span, **time_bounds())
    loaded.warn_of_mixture()
    return loaded


def _load(
    paths: Sequence[Path],
    update: Progress | None,
    arrivals: ArrivalReader | None,
    *,
    apart: bool,
) -> Loaded:
    """Load recordings; `apart` as in `load`."""
    from tfdb.recordings.load import load_into  # noqa: PLC0415 - not for frozen stores

    store, selection, names = tfdb.Buffer(history=None), selected(), tuple(map(str, paths))
    # Prefixes would change the meaning of options that name frames.
    apart = apart and not given().keys() & {"frames", "exclude", "rename", "urdf"}
    mixed, shown = None, ""
    while True:
        try:
            report = load_into(store, paths, selection, update, arrivals)
            return Loaded(store, report, names, selection, mixed=mixed, shown=shown)
        except tfdb.errors.MixedSources as error:
            if not apart or selection.mix:
                raise
            mixed = mixed or error
            was_apart = selection.by_namespace
            selection = replace(selection, by_namespace=not was_apart, mix=was_apart)
            shown = "each group under its own prefix, as by --by-namespace"
            if was_apart:
                shown = "all in one tree, as by --mix"


@contextmanager
def bar_on_stderr(columns: Callable[[], Sequence[ProgressColumn]]) -> Iterator[Bar | None]:
    """Yield a progress bar on stderr that vanishes at the end; None without a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console  # noqa: PLC0415 - see `output`
    from rich.progress import BarColumn, Progress, TextColumn  # noqa: PLC0415

    with Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        *columns(),
        console=Console(stderr=True),
        transient=True,
    ) as bar:
        yield bar


@contextmanager
def progress_bar(what: str) -> Iterator[Callable[[int, int], None] | None]:
    """Yield a callback (done, total) that moves a progress bar; None without a terminal."""

    def columns() -> Sequence[ProgressColumn]:
        from rich.progress import TextColumn, TimeElapsedColumn  # noqa: PLC0415 - see `output`

        return TextColumn("{task.percentage:>3.0f} %"), TimeElapsedColumn()

    with bar_on_stderr(columns) as bar:
        if bar is None:
            yield None
            return
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def find_frames(store: StoreReader, *names: str) -> tuple[str, ...]:
    """Return the names as the recording has them. The error for others suggests similar names.

    A name may begin with a slash: messages may have it, and loading drops it.
    """
    known = store.frames()
    return tuple(_find_frame(name, known) for name in names)


def _find_frame(name: str, known: Sequence[str]) -> str:
    for written in (name, name.removeprefix("/")):
        if written in known:
            return written
    near = near_names(name, known)
    near += [other for other in known if name.strip("/") in other and other not in near]
    listed = ", ".join(repr(other) for other in near[:3])
    hint = f"did you mean {listed}?" if listed else "'tfdb tree FILE' lists all frames"
    message = f"frame {name!r} does not exist; {hint}"
    raise tfdb.UnknownFrame(message, frame=name)


def explain_range(store: StoreReader, target: str, source: str) -> str:
    """Describe the stamps at which a path has data; empty if no edge of it moves."""
    common = common_range(store, target, source)
    if common is None:
        return ""
    first, last = common
    if first > last:
        return "the moving edges between them have no time in common"
    dates = format_dates(first, last)
    text = f"the path is valid from {format_ns(first)} to {format_ns(last)}"
    return f"{text} ({dates})" if dates else text


def add_range(
    error: tfdb.TfdbError, store: StoreReader, target: str, source: str, hint: str, offset: str
) -> None:
    """Add the stamps at which a path has data to the text of a lookup's error.

    `hint` is a remedy. `offset` asks whether an offset was meant; then only the stamp, the range
    and this question are left.
    """
    text = str(error)
    if offset and isinstance(error, tfdb.Extrapolation) and error.stamp is not None:
        text, hint = f"T[{target}<-{source}] has no data at {format_ns(error.stamp)} s", ""
    parts = text, explain_range(store, target, source), hint, offset
    error.args = ("; ".join(filter(None, parts)),)


def common_range(store: StoreReader, target: str, source: str) -> tuple[int, int] | None:
    """Return the first and last stamp at which all moving edges of a path have data."""
    forest = Forest(store.tree())
    ours, theirs = forest.chain(target), forest.chain(source)
    while ours and theirs and ours[-1].name == theirs[-1].name:
        ours.pop()
        theirs.pop()
    moving = [
        (info.oldest, info.newest)
        for info in (*ours, *theirs)
        if info.oldest is not None and info.newest is not None
    ]
    if not moving:
        return None
    return max(first for first, _ in moving), min(last for _, last in moving)


def parse_policy(ctx: click.Context, param: click.Parameter, value: str | None) -> Any:
    """Make a policy from the text ``name[:seconds]``; None without a text."""
    if value is None or ctx.resilient_parsing:
        return None
    name, colon, limit = value.partition(":")
    makers: dict[str, tuple[Callable[..., Any], str | None, bool]] = {
        "interpolate": (tfdb.Interpolate, "max_gap_ns", False),
        "exact": (tfdb.Exact, None, False),
        "previous": (tfdb.Previous, "max_age_ns", False),
        "nearest": (tfdb.Nearest, "tolerance_ns", False),
        "extrapolate": (tfdb.Extrapolate, "max_ns", True),
    }
    if name not in makers:
        raise click.BadParameter(unknown_word(name, makers), ctx, param)
    maker, field, needed = makers[name]
    if not colon:
        if needed:
            raise click.BadParameter("write extrapolate:SECONDS, e.g. extrapolate:0.1", ctx, param)
        return maker()
    if field is None:
        raise click.BadParameter("'exact' takes no limit", ctx, param)
    try:
        return maker(**{field: parse_stamp(limit)})
    except ValueError as error:
        raise click.BadParameter(str(error), ctx, param) from None


policy_option: Callable[[FC], FC] = click.option(
    "--policy",
    metavar="POLICY",
    callback=parse_policy,
    help="Use of the samples around a time: interpolate[:MAX_GAP], exact, previous[:MAX_AGE], "
    "nearest[:TOLERANCE] or extrapolate:MAX. Limits are in seconds.  [default: interpolate]",
)


def complete_frames(ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[str]:
    """Complete a frame name; without candidates if the recording cannot be read."""
    try:
        return sorted(f for f in _example_frames(ctx.params["file"]) if f.startswith(incomplete))
    except (tfdb.TfdbError, OSError, KeyError, TypeError):
        return []


def _example_frames(path: str) -> set[str]:
    """Return the frames of the first static and the first moving transforms."""
    if is_graph(path):
        return set()  # a shell does not wait for it
    if path.startswith(STORE):
        return set(open_live(path).frames())
    if is_frozen(check_path(path)):
        return set(tfdb.open(path).frames())
    from tfdb.recordings.recording import Recording  # noqa: PLC0415 - not for frozen stores
    from tfdb.recordings.rewriter import Rewriter  # noqa: PLC0415

    names: set[str] = set()
    rewriter = Rewriter(Selection().choice, (None, None), None)
    with Recording(path) as recording:
        messages = chain.from_iterable(
            islice(recording.messages(wanted), _COMPLETION_MESSAGES)
            for wanted in (
                lambda source: source.is_static,
                lambda source: source.holds_transforms and not source.is_static,
            )
        )
        for source, received, data in messages:
            for transform in rewriter.decoded(data, source, received, static=True):
                names |= {transform.parent, transform.child}
    return names


target_argument: Callable[[FC], FC] = click.argument("target", shell_complete=complete_frames)
source_argument: Callable[[FC], FC] = click.argument("source", shell_complete=complete_frames)

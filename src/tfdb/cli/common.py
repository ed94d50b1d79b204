"""What the commands share: options, loading with a progress bar, errors that say what to do."""

from __future__ import annotations

import errno
import sys
import time
import warnings
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import chain, islice
from typing import TYPE_CHECKING, Any

import click

import tfdb
from tfdb.data.argument_checks import unknown_word
from tfdb.data.decimal_time import parse_stamp
from tfdb.data.new_file import is_one_of, refuse_existing
from tfdb.data.path_checks import first_missing, given_path, missing_file
from tfdb.data.suggestions import near_names
from tfdb.data.time_text import format_dates, format_ns
from tfdb.store.frozen import is_frozen
from tfdb.store.summary import Forest, span
from tfdb.trajectories.reading_report import warn_of_rows

from . import output
from .graph import STORE, is_graph, listen_once
from .groups import OneOf
from .times import NS, duration_option, time_option, warn_of_bounds

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Sequence
    from contextlib import ExitStack
    from pathlib import Path

    from click.decorators import FC
    from rich.progress import Progress, ProgressColumn

    from tfdb import Buffer, Snapshot
    from tfdb._core import Reads
    from tfdb.data.loss import Loss
    from tfdb.recordings.choice import LoadOptions
    from tfdb.recordings.containers import Source
    from tfdb.recordings.loading import LoadReport
    from tfdb.recordings.recording import Recording

_COMPLETION_MESSAGES = 200
"""So many messages of each kind does completion read: a shell must not seem to hang."""

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
_topic_option = click.option(
    "--topic",
    "topics",
    multiple=True,
    metavar="FROM[:TO]",
    help="Read only the topic FROM (as TO, whose last part is tf or tf_static); repeatable.  "
    "[default: every topic of transforms]",
)
_SALVAGE = "tfdb.salvage"


def _salvage(ctx: click.Context, _param: click.Parameter, value: bool) -> None:
    ctx.meta[_SALVAGE] = value


_salvage_option = click.option(
    "--salvage",
    is_flag=True,
    expose_value=False,
    callback=_salvage,
    help="Read damaged, cut and unindexed files as far as they go; sort rows of trajectories and "
    "skip bad ones. Print what is lost.",
)


_CHOSEN = "tfdb.chosen"
_BOUNDS = "tfdb.bounds"


def _choose(ctx: click.Context, param: click.Parameter, value: Any) -> None:
    """Keep what was given of an option for `chosen`."""
    if value not in (None, ()) and param.name is not None:
        # `convert` and others have a parameter `frames` of their own.
        ctx.meta.setdefault(_CHOSEN, {})[param.name.removeprefix("chosen_")] = value


def _choose_time(ctx: click.Context, param: click.Parameter, value: str | None) -> None:
    time = time_option(ctx, param, value)
    if time is not None and time.ns is None:
        raise click.BadParameter("'latest' is not a bound", ctx, param)
    if time is not None:
        ctx.meta.setdefault(_BOUNDS, {})[param.name] = time
    _choose(ctx, param, None if time is None else time.text)


def _choose_seconds(ctx: click.Context, param: click.Parameter, value: str | None) -> None:
    length = duration_option(ctx, param, value)
    _choose(ctx, param, None if length is None else length / NS)


def _choose_names(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> None:
    pairs: dict[str, str] = {}
    for text in value:
        old, colon, new = text.partition(":=")
        if not (old and colon and new):
            raise click.BadParameter(f"{text!r} is not FROM:=TO", ctx, param)
        if pairs.setdefault(old, new) != new:
            raise click.BadParameter(f"{old!r} is given two names", ctx, param)
    _choose(ctx, param, pairs or None)


def _choose_poses(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> None:
    topics: dict[str, str | None] = {}
    for text in value:
        topic, equals, child = text.partition("=")
        if not topic or (equals and not child):
            raise click.BadParameter(f"{text!r} is not TOPIC or TOPIC=CHILD", ctx, param)
        if topics.setdefault(topic, child or None) != (child or None):
            raise click.BadParameter(f"{topic!r} is given two frames", ctx, param)
    _choose(ctx, param, topics or None)


def _choose_file(ctx: click.Context, param: click.Parameter, value: str | None) -> None:
    if value is not None and not ctx.resilient_parsing:
        find_paths([value])
    _choose(ctx, param, value)


def _chooses(
    flag: str, metavar: str, help_: str, keep: Callable[..., None] = _choose, **more: Any
) -> Any:
    return click.option(
        flag, metavar=metavar, help=help_, callback=keep, expose_value=False, **more
    )


_time_options = (
    _chooses("--start", "TIME", "Read no moving transform before this time.", _choose_time),
    _chooses("--end", "TIME", "Read no moving transform after this time.", _choose_time),
)
_choice_options = (
    _chooses("--keep", "SECONDS", "Read only the last seconds.", _choose_seconds),
    click.option(
        "--frame",
        "chosen_frames",
        multiple=True,
        metavar="NAME",
        callback=_choose,
        expose_value=False,
        help="Read only the edges between these frames; repeatable.",
    ),
    _chooses(
        "--exclude",
        "NAME",
        "Leave out this frame, topic or node (* and ? as in a shell), or the edge of a frame on a "
        "topic, TOPIC:FRAME; repeatable.",
        multiple=True,
    ),
    _chooses(
        "--rename",
        "FROM:=TO",
        "Rename the frame FROM to TO; repeatable.",
        _choose_names,
        multiple=True,
    ),
    click.option(
        "--pose-topic",
        "pose_topics",
        multiple=True,
        metavar="TOPIC[=CHILD]",
        callback=_choose_poses,
        expose_value=False,
        help="Also read the poses on TOPIC (Odometry, PoseStamped, Path ...) as poses of the frame "
        "CHILD; repeatable.",
    ),
    _chooses(
        "--urdf",
        "FILE",
        "Make transforms of joint states with this robot model.",
        _choose_file,
        type=click.Path(),
    ),
    _chooses(
        "--joint-topic", "TOPIC", "Topic of the joint states for --urdf.  [default: /joint_states]"
    ),
    _chooses(
        "--stamp-unit",
        "s|ms|us|ns",
        "Unit of the stamps in trajectory files.  [default: from the header or the numbers]",
        type=OneOf(("s", "ms", "us", "ns")),
    ),
)
_prefix_option = _chooses("--prefix", "TEXT", "Put TEXT before the name of each frame.")


def _group_option(flag: str, help_: str) -> Any:
    """Make a flag that says what becomes of several groups of topics."""

    def keep(ctx: click.Context, param: click.Parameter, value: bool) -> None:
        _choose(ctx, param, value or None)

    return click.option(flag, is_flag=True, help=help_, callback=keep, expose_value=False)


_group_options = (
    _group_option(
        "--by-namespace",
        "Load each group of topics under its own prefix: the frames of /robot1/tf under robot1/.",
    ),
    _group_option(
        "--mix", "Load all into one tree, although groups of topics, or files, disagree on an edge."
    ),
)


def topic_option(command: Any, *, times: bool = True, prefix: bool = True) -> Any:
    """Give a command that reads recordings the options that say what to read of them.

    Without `times` it has a start and an end of its own, without `prefix` prefixes of its own.
    """
    chosen = (*(_time_options if times else ()), *_choice_options)
    chosen += ((_prefix_option,) if prefix else ()) + _group_options
    for option in reversed((_topic_option, *chosen, _salvage_option)):
        command = option(command)
    return command


def groups_option(command: Any) -> Any:
    """Give a command the options that choose among several groups of topics, and no others."""
    for option in reversed((_topic_option, *_group_options)):
        command = option(command)
    return command


def chosen() -> LoadOptions:
    """What the command was told to read, as `Buffer.load` takes it."""
    context = click.get_current_context(silent=True)
    found: LoadOptions = {} if context is None else context.meta.get(_CHOSEN, {})
    return found


def choose(**options: Any) -> None:
    """Read in another way than the command was told to."""
    click.get_current_context().meta.setdefault(_CHOSEN, {}).update(options)


def take(name: str) -> Any:
    """Return an option that the command reads itself, and choose nothing by it; None without it."""
    return click.get_current_context().meta.get(_CHOSEN, {}).pop(name, None)


def salvages() -> bool:
    """Whether the command was called with `--salvage`."""
    context = click.get_current_context(silent=True)
    return bool(context is not None and context.meta.get(_SALVAGE))


def opened(stack: ExitStack, paths: Sequence[Path]) -> list[Recording]:
    """Open recordings, as `--salvage` says, until the stack ends; say what is lost of them."""
    from tfdb.recordings.recording import Recording  # noqa: PLC0415 - not for frozen stores

    refuse_frozen(paths)
    salvage = salvages()
    unit = chosen().get("stamp_unit")
    recordings = [
        stack.enter_context(Recording(path, salvage=salvage, stamp_unit=unit)) for path in paths
    ]
    for recording in recordings:
        for note in recording.notes:
            warnings.warn(note, tfdb.TfdbWarning, stacklevel=2)
        if recording.rows is None:
            report_losses(recording.losses)
        else:
            warn_of_rows(recording.rows, 2)
    return recordings


def refuse_frozen(paths: Iterable[Path]) -> None:
    """Refuse frozen stores where messages are wanted."""
    for path in paths:
        if is_frozen(path):
            raise click.UsageError(
                f"{path} is a frozen store: it holds no messages; give the recording that it was "
                "made of"
            )


def report_losses(losses: Iterable[Loss]) -> None:
    """Say on stderr what salvaging could not save."""
    for loss in losses:
        output.say(f"tfdb: salvaged {loss}", err=True)


max_gap_option: Callable[[FC], FC] = click.option(
    "--max-gap",
    metavar="SECONDS",
    callback=duration_option,
    help="Report only gaps longer than this.  [default: five median periods of each edge]",
)
more_option: Callable[[FC], FC] = click.option(
    "--with",
    "more",
    multiple=True,
    type=click.Path(),
    metavar="FILE",
    help="Read another file of the same recording; repeatable.",
)
out_option: Callable[[FC], FC] = click.option(
    "-o",
    "--output",
    "out",
    required=True,
    type=click.Path(),
    metavar="OUT",
    help="Write this .bag, .mcap or .db3.",
)
format_option: Callable[[FC], FC] = click.option(
    "--format",
    "kind",
    type=OneOf(["tum", "kitti", "euroc", "csv", "npz", "parquet"]),
    help="Format of a written trajectory.  [default: by the ending of OUT; .txt is TUM]",
)
overwrite_option: Callable[[FC], FC] = click.option(
    "--overwrite", is_flag=True, help="Replace OUT if it exists."
)


_NAMING = {"frames", "exclude", "rename", "urdf"}
"""Options with names of frames, which differ where groups of topics are kept apart."""


@dataclass(frozen=True)
class Loaded:
    """What a command reads, and how it got there.

    `store` is a recording in memory, what was heard of a graph, a frozen store, or the state in
    which a live store was found: only the first has a `report`.
    """

    store: Buffer | Snapshot
    report: LoadReport | None
    names: tuple[str, ...]
    now: int | None = None
    """When what is live was found so, by the clock of the graph or of the machine."""
    mixed: tfdb.errors.MixedSources | None = None
    """Why groups of topics have prefixes, or sources that disagree are mixed, unasked."""
    shown: str = ""
    """How sources that disagree were loaded."""

    def warn_of_mixture(self) -> None:
        """Warn of sources that disagree, and say how they are shown."""
        if self.mixed is not None:
            text = f"{self.mixed}. Shown here: {self.shown}"
            warnings.warn(text, tfdb.TfdbWarning, stacklevel=3)

    @property
    def live(self) -> bool:
        """Whether it is a live store or graph."""
        return is_live(self.names[0])

    @property
    def span(self) -> tuple[int, int] | None:
        """The first and the last moving stamp in nanoseconds; None where nothing moves."""
        return span(self.store.tree())


def is_live(name: str) -> bool:
    """Whether a name is that of a live store or graph."""
    return name.startswith(STORE) or is_graph(name)


def find_paths(names: Sequence[str]) -> tuple[Path, ...]:
    """Check that the files exist; where one does not, name the nearest that does."""
    paths = tuple(given_path(name) for name in names)
    for name in names:
        if is_live(name):
            what = "graph" if is_graph(name) else "store"
            raise click.UsageError(f"{name} is a live {what}; here only files can be read")
    for path in paths:
        if not path.exists():
            raise missing_file(path)
    return paths


def check_output(out: str, inputs: Sequence[Path], *, overwrite: bool) -> None:
    """Refuse an output without a folder, one of the inputs, or one that exists already."""
    path = given_path(out)
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


def parse_topics(texts: Sequence[str]) -> dict[str, str] | None:
    """``FROM[:TO]`` of each ``--topic``, as `Buffer.load` wants it; None without any."""
    if not texts:
        return None
    from tfdb.recordings.choice import absolute  # noqa: PLC0415 - not for frozen stores
    from tfdb.recordings.loading import role_of  # noqa: PLC0415

    pairs: dict[str, str] = {}
    for text in texts:
        source, colon, target = text.partition(":")
        if not source or (colon and not target):
            raise click.UsageError(f"--topic {text!r} is not FROM or FROM:TO")
        pairs[absolute(source)] = role_of(source, target or source)
    return pairs


def load(
    names: Sequence[str],
    topics: Sequence[str] = (),
    *,
    verify: bool = False,
    there: Callable[[Buffer], bool] | None = None,
    apart: bool = False,
) -> Loaded:
    """Load the recordings into one store that keeps everything.

    `apart`: where sources disagree, warn and return the error in `mixed`. Groups of topics are then
    loaded each under its own prefix, as by `--by-namespace`. Groups whose prefixes make one name,
    and files, are mixed, as by `--mix`.

    A live or a frozen store is read as it is; `verify`: the latter is compared with its checksum. A
    graph is listened to, until `there` holds of what was heard or the time is over.
    """
    if any(is_graph(name) for name in names):
        refuse_parts(names, topics, "a graph", "ros1: or ros2:")
        heard, now = listen_once(names[0], there)
        return Loaded(heard, None, tuple(names), now)
    if any(name.startswith(STORE) for name in names):
        refuse_parts(names, topics, "a live store", "shm:NAME")
        return Loaded(open_live(names[0]).snapshot(), None, tuple(names), time.time_ns())
    paths = find_paths(names)
    if any(is_frozen(path) for path in paths):
        refuse_parts(names, topics, "a frozen store", "FILE.tfdb")
        return Loaded(tfdb.open(paths[0], verify=verify), None, (str(paths[0]),))
    store, mixed, shown = tfdb.Buffer(history=None), None, ""
    with progress_bar("reading") as update:

        def read() -> LoadReport:
            return store.load(
                list(paths),
                topics=parse_topics(topics),
                progress=update,
                salvage=salvages(),
                **chosen(),
            )

        try:
            report = read()
        except tfdb.errors.MixedSources as error:
            if not apart or _NAMING & set(chosen()):
                raise
            mixed = error
            report, shown = _read_mixed(read)
    told = {rows.path for rows in report.trajectories}  # their warnings count it
    report_losses(loss for loss in report.lost if loss.path not in told)
    context = click.get_current_context(silent=True)
    bounds = {} if context is None else context.meta.get(_BOUNDS, {})
    warn_of_bounds(span(store.tree()), **bounds)
    names = tuple(str(path) for path in paths)
    loaded = Loaded(store, report, names, mixed=mixed, shown=shown)
    loaded.warn_of_mixture()
    return loaded


def _read_mixed(read: Callable[[], LoadReport]) -> tuple[LoadReport, str]:
    """Load sources that disagree, and say how."""
    if not chosen().get("by_namespace"):
        choose(by_namespace=True)
        with suppress(tfdb.errors.MixedSources):
            return read(), "each group under its own prefix, as by --by-namespace"
    choose(by_namespace=False, mix=True)
    return read(), "all in one tree, as by --mix"


def open_live(name: str) -> Buffer:
    """Open the store of `shm:NAME` to read it."""
    return tfdb.Buffer.open(name.removeprefix(STORE), create=False, mode="r")


def refuse_parts(names: Sequence[str], topics: Sequence[str], what: str, how: str) -> None:
    """Refuse what goes with recordings only."""
    if len(names) > 1:
        raise click.UsageError(f"{what} is read alone: give {how} without other files")
    if topics or salvages():
        raise click.UsageError(f"{names[0]} is {what}: it has no topics, nothing to salvage")
    given = ", ".join(sorted(f"--{flag_of(name)}" for name in chosen()))
    if given:
        raise click.UsageError(f"{names[0]} is {what}, read as it is: {given} goes with recordings")


def flag_of(name: str) -> str:
    """Return the name of the option that chooses `name` of `Buffer.load`."""
    return name.removesuffix("s").replace("_", "-")


@contextmanager
def bar_on_stderr(columns: Callable[[], Sequence[ProgressColumn]]) -> Iterator[Progress | None]:
    """Give a bar on stderr that vanishes at the end; None where that is not a terminal."""
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
    """Give a callback (done, total) that moves a bar on stderr; None without a terminal."""

    def columns() -> Sequence[ProgressColumn]:
        from rich.progress import TextColumn, TimeElapsedColumn  # noqa: PLC0415 - see `output`

        return TextColumn("{task.percentage:>3.0f} %"), TimeElapsedColumn()

    with bar_on_stderr(columns) as bar:
        if bar is None:
            yield None
            return
        task = bar.add_task(what, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def find_frames(store: Reads, *names: str) -> tuple[str, ...]:
    """Return the names as the recording has them; refuse others, and say which are near.

    A name may begin with the slash that messages may have, and loading drops.
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


def explain_range(store: Reads, target: str, source: str) -> str:
    """Say where the two frames have data in common; empty when nothing moves between them."""
    common = common_range(store, target, source)
    if common is None:
        return ""
    first, last = common
    if first > last:
        return "the moving edges between them have no time in common"
    dates = format_dates(first, last)
    text = f"the path is valid from {format_ns(first)} to {format_ns(last)}"
    return f"{text} ({dates})" if dates else text


def common_range(store: Reads, target: str, source: str) -> tuple[int, int] | None:
    """Find the first and last stamp at which all moving edges between two frames have data."""
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
    """Make the policy of ``name[:seconds]``, None without one."""
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
    help="How samples answer a time: interpolate[:MAX_GAP], exact, previous[:MAX_AGE], "
    "nearest[:TOLERANCE] or extrapolate:MAX; limits in seconds.  [default: interpolate]",
)


def complete_frames(ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[str]:
    """Offer frames of the recording to the shell; none where it cannot be read."""
    try:
        return sorted(f for f in _some_frames(ctx.params["file"]) if f.startswith(incomplete))
    except (tfdb.TfdbError, OSError, KeyError, TypeError):
        return []


def _some_frames(path: str) -> set[str]:
    """Frames of the first static and of the first moving transforms."""
    if is_graph(path):
        return set()  # a shell does not wait for it
    if path.startswith(STORE):
        return set(open_live(path).frames())
    if is_frozen(given_path(path)):
        return set(tfdb.open(path).frames())
    from tfdb.recordings.choice import Choice  # noqa: PLC0415 - not for frozen stores
    from tfdb.recordings.recording import Recording  # noqa: PLC0415

    names: set[str] = set()
    rewriter = Choice().without_survey()
    with Recording(path) as recording:
        messages = chain.from_iterable(
            islice(recording.messages(wanted), _COMPLETION_MESSAGES)
            for wanted in (_is_static, _is_moving)
        )
        for source, received, data in messages:
            for transform in rewriter.decoded(data, source, received, static=True):
                names |= {transform.parent, transform.child}
    return names


def _is_static(source: Source) -> bool:
    return source.is_static


def _is_moving(source: Source) -> bool:
    return source.holds_transforms and not source.is_static


target_argument: Callable[[FC], FC] = click.argument("target", shell_complete=complete_frames)
source_argument: Callable[[FC], FC] = click.argument("source", shell_complete=complete_frames)

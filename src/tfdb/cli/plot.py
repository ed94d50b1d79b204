"""``tfdb plot``: draws a recording's frame tree, samples and trajectories."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

import tfdb

from . import common, output
from .compare import comparison_options, find, title_of
from .graph import listen_option
from .groups import OneOf, SuggestingCommand
from .pictures import need_matplotlib, picture_files, write_pictures
from .selecting import selection_options
from .times import NS, seconds_option

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from tfdb.recordings.arrivals import RecordedArrivals

KINDS = ("tree", "timeline", "trajectory", "compare")
_KINDS_OF = {
    "axes": ("trajectory",),
    "color": ("trajectory",),
    "max_gap": ("timeline",),
    "rows": ("tree", "timeline"),
}
"""Options of some pictures only, without those of a comparison."""


def _complete(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[str]:
    """Complete frame names."""
    if ctx.params.get("kind") != "trajectory":
        return []
    return common.complete_frames(ctx, param, incomplete)


@click.command("plot", cls=SuggestingCommand)
@common.file_argument
@click.argument("kind", type=OneOf(KINDS), default="tree")
@click.argument(
    "frames",
    nargs=-1,
    metavar="[TARGET SOURCE... | ESTIMATE [TARGET SOURCE]]",
    shell_complete=_complete,
)
@click.option(
    "--save",
    "saved",
    multiple=True,
    metavar="FORMAT|PATH",
    help="A FORMAT (png, svg, pdf) writes FILE_KIND.FORMAT into the current folder, a PATH writes "
    "that file. Repeatable.  [default: png, unless --show is given]",
)
@click.option("--show", is_flag=True, help="Open a window with the picture.")
@click.option(
    "--axes",
    type=OneOf(("xy", "xz", "yz", "xyz")),
    help="Draw a trajectory in this plane, or in 3D (xyz).  [default: its axes of largest extent]",
)
@click.option(
    "--color",
    type=OneOf(("time", "speed")),
    help="Color a trajectory by time or speed.",
)
@seconds_option(
    "--max-gap", help="Mark gaps longer than this in a timeline.  [default: five median periods]"
)
@click.option(
    "--rows",
    type=click.IntRange(min=0),
    default=100,
    help="Largest number of rows of a tree or timeline. Beyond it, subtrees are folded into single "
    "rows. 0: no limit.",
)
@comparison_options
@click.option("--title", help="Title of the picture.  [default: made from FILE and frames]")
@common.more_option
@common.overwrite_option
@listen_option
@selection_options
@common.json_option
def command(
    *,
    file: str,
    kind: str,
    frames: tuple[str, ...],
    saved: tuple[str, ...],
    show: bool,
    axes: Any,
    color: Any,
    max_gap: int | None,
    rows: int,
    title: str | None,
    more: tuple[str, ...],
    overwrite: bool,
    as_json: bool,
    **comparing: Any,
) -> None:
    """Draw the frame tree, the samples over time, trajectories or a comparison.

    Example: tfdb plot drive.mcap trajectory map base_link camera --color speed

    'trajectory' draws T[TARGET<-SOURCE] at each stored stamp; several SOURCEs share one picture.
    TARGET and SOURCE may be omitted if FILE has only one moving edge, like a .tum file. 'timeline'
    draws the samples of each edge. 'compare' draws the result of 'tfdb compare FILE ESTIMATE', with
    the same options.
    """
    _check_options(kind, comparing)
    _check_frames(kind, frames, more)
    names = (file, *more, *(frames[:1] if kind == "compare" else ()))
    saved = saved or (() if show else ("png",))
    outs = picture_files(saved, file, kind, names, overwrite=overwrite)
    need_matplotlib()
    from tfdb import plot  # noqa: PLC0415 - an extra

    if kind == "compare":
        found, _, _ = find(file, frames[0], frames[1:] or None, "after ESTIMATE:", comparing)
        figure = found.plot(title=title or title_of(file, frames[0]))
    else:
        from tfdb.recordings.arrivals import ArrivalReader  # noqa: PLC0415 - for recordings

        reader = ArrivalReader()
        loaded = common.load(
            names, apart=kind != "trajectory", arrivals=reader if kind == "timeline" else None
        )
        if kind == "trajectory":
            figure = _trajectory(loaded, frames, axes, color, title)
        elif kind == "timeline":
            figure = _timeline(loaded, reader.found, max_gap, rows, title)
        else:
            figure = plot.frame_tree(loaded.store, title=title, rows=rows or None)
    write_pictures(figure, outs, overwrite=overwrite)
    if as_json:
        body = {"files": list(names), "kind": kind, "outputs": [str(path) for path in outs]}
        output.emit_json("plot", body)
    elif outs:
        said = "comparison" if kind == "compare" else kind
        output.say_wrapped(f"{', '.join(map(str, outs))}: the {said} of {file}")
    if show:
        _show(figure)


def _check_options(kind: str, comparing: Iterable[str]) -> None:
    """Refuse options without effect on this kind of picture."""
    ctx = click.get_current_context()
    kinds = _KINDS_OF | dict.fromkeys(comparing, ("compare",))
    for param in ctx.command.params:
        given = ctx.get_parameter_source(str(param.name)) is ParameterSource.COMMANDLINE
        fits = kinds.get(str(param.name), KINDS)
        if given and kind not in fits:
            raise click.UsageError(
                f"{param.opts[0]} is valid with {' and '.join(fits)}, not with {kind}"
            )


def _check_frames(kind: str, frames: Sequence[str], more: Sequence[str]) -> None:
    """Refuse frames that do not fit the kind of picture."""
    if kind == "trajectory":
        if len(frames) == 1:
            raise click.UsageError(
                "name TARGET and SOURCE: tfdb plot FILE trajectory TARGET SOURCE [SOURCE ...]"
            )
    elif kind == "compare":
        if len(frames) not in (1, 3):
            raise click.UsageError(
                "name the second trajectory: tfdb plot FILE compare ESTIMATE [TARGET SOURCE]"
            )
        if more:
            raise click.UsageError("--with applies to pictures of one recording, not to compare")
    elif frames:
        raise click.UsageError(
            f"{kind} takes no frames, got {' '.join(frames)}; for two files use 'compare'"
        )


def _trajectory(
    loaded: common.Loaded, frames: tuple[str, ...], axes: Any, color: Any, title: str | None
) -> Any:
    from tfdb import plot  # noqa: PLC0415 - an extra

    moving = [info for info in loaded.store.tree() if info.parent and not info.is_static]
    if not frames and len(moving) == 1:
        frames = (str(moving[0].parent), moving[0].name)
    if not frames:
        raise click.UsageError(
            f"{loaded.names[0]} has {len(moving)} moving edges: name TARGET and SOURCE"
        )
    target, *sources = common.find_frames(loaded.store, *frames)
    paths = [
        loaded.store.trajectory(target, source, missing="nan") for source in dict.fromkeys(sources)
    ]
    return plot.trajectory(*paths, axes=axes, color=color, title=title)


def _timeline(
    loaded: common.Loaded,
    came: RecordedArrivals | None,
    max_gap: int | None,
    rows: int,
    title: str | None,
) -> Any:
    from tfdb import plot  # noqa: PLC0415 - an extra
    from tfdb.judging.doctor import Log  # noqa: PLC0415 - needs numpy

    arrivals = None
    if came is not None:
        log = Log.of(came)
        arrivals = {
            edge.name: plot.Arrivals(edge.stamps, [log.names[number] for number in edge.publishers])
            for edge in (each.moving if len(each.moving.stamps) else each for each in log.edges())
        }
    seconds = None if max_gap is None else max_gap / NS
    return plot.timeline(
        loaded.store, title=title, max_gap=seconds, arrivals=arrivals, rows=rows or None
    )


def _show(figure: Any) -> None:
    """Open a window and wait until it is closed."""
    from tfdb import plot  # noqa: PLC0415 - an extra

    try:
        plot.show(figure)
    except tfdb.errors.NotSupported as error:
        raise click.ClickException(f"{error}; --save png writes a file") from error

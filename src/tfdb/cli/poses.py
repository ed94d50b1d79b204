"""``tfdb poses``: writes many poses of one frame in another to a file."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import click

import tfdb
from tfdb.data.argument_checks import unknown_ending
from tfdb.data.counting import counted
from tfdb.data.path_checks import errors_name
from tfdb.data.stamps import format_seconds
from tfdb.data.time_text import format_duration, format_ns
from tfdb.recordings.containers import TRAJECTORIES

from . import common, output
from .graph import listen_option
from .groups import SuggestingCommand
from .selecting import selection_options
from .times import TimeSpec, ask_of_offsets, read_stamps, time_option, warn_of_bounds

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from tfdb.trajectories.file_formats import Format


_NO_POSE = (
    tfdb.Extrapolation,
    tfdb.errors.NoSampleNear,
    tfdb.errors.GapTooLarge,
    tfdb.errors.Stale,
)


@dataclass(frozen=True)
class Poses:
    """T[target<-source] at each stamp that has a pose."""

    target: str
    source: str
    stamps: npt.NDArray[np.int64]
    poses: npt.NDArray[np.float64]
    missing: int


@click.command("poses", cls=SuggestingCommand)
@common.file_argument
@common.target_argument
@common.source_argument
@click.option(
    "--at",
    "stamps_file",
    type=click.Path(),
    metavar="STAMPS",
    help="Read stamps from the first column of this file, such as a TUM or CSV file. '-' is stdin.",
)
@click.option(
    "--rate",
    type=click.FloatRange(min=0, min_open=True),
    metavar="HZ",
    help="Poses per second, from the first to the last time at which all edges have data.",
)
@click.option("--start", metavar="TIME", callback=time_option, help="Earliest time of a pose.")
@click.option("--end", metavar="TIME", callback=time_option, help="Latest time of a pose.")
@common.output_option(
    "OUT",
    "Write this .tum, .csv, .npz or .parquet file. For other formats see --format.  [default: "
    "TUM to stdout]",
)
@click.option(
    "--skip-missing",
    is_flag=True,
    help="Skip stamps without a pose instead of stopping with an error.",
)
@common.format_option
@common.overwrite_option
@common.policy_option
@common.more_option
@listen_option
@partial(selection_options, without=("start", "end"))
@common.json_option
def command(
    *,
    file: str,
    target: str,
    source: str,
    stamps_file: str | None,
    rate: float | None,
    start: TimeSpec | None,
    end: TimeSpec | None,
    out: str | None,
    kind: Format | None,
    skip_missing: bool,
    overwrite: bool,
    policy: Any,
    more: tuple[str, ...],
    as_json: bool,
) -> None:
    """Write many poses of SOURCE in TARGET to a .tum, .csv, .npz or Parquet file.

    Example: tfdb poses drive.mcap map camera --rate 100 -o camera.tum

    Each pose is T[TARGET<-SOURCE], all from one snapshot. Without --at and --rate, one pose is
    written for each stored stamp of the edges between the two frames.
    """
    if stamps_file is not None and rate is not None:
        raise click.UsageError("--at and --rate exclude each other")
    _check_format(out, kind)
    wanted = None if stamps_file is None else _stamps(stamps_file)
    if out is not None:
        read = (file, *more, *([] if stamps_file in (None, "-") else [stamps_file]))
        common.check_output(out, common.find_files(read), overwrite=overwrite)
    loaded = common.load((file, *more))
    store = loaded.store
    target, source = common.find_frames(store, target, source)
    first = None if start is None else start.resolve(loaded.span)
    last = None if end is None else end.resolve(loaded.span)
    missing: Literal["nan", "raise"] = "nan" if skip_missing else "raise"
    try:
        if wanted is None:
            path = store.trajectory(target, source, rate, first, last, policy, missing=missing)
            stamps, poses = path.stamps, path.poses
        else:
            stamps = _between(wanted, first, last)
            poses = store.lookup_transforms(target, source, stamps, policy, missing=missing)
    except (*_NO_POSE, tfdb.InvalidArgument) as error:
        hint = "--skip-missing leaves such stamps out" if isinstance(error, _NO_POSE) else ""
        offset = ask_of_offsets(loaded.span, start, end)
        common.add_range(error, store, target, source, hint, offset)
        raise
    warn_of_bounds(loaded.span, start=start, end=end)
    import numpy as np

    kept: npt.NDArray[np.bool_] = np.asarray(np.isfinite(poses).all(axis=1))
    made = Poses(target, source, stamps[kept], poses[kept], int(len(kept) - kept.sum()))
    if out is not None:
        _check_order(made.stamps, out, kind, stamps_file)
    if out is not None or not as_json:
        _write(out, made, kind, overwrite=overwrite)
    if as_json:
        output.emit_json("poses", _body(loaded, made, out))
    elif out is not None:
        output.say_wrapped(f"{out}: {_describe(made)}", out, target, source)


def _check_format(out: str | None, kind: Format | None) -> None:
    """Refuse a file whose format is unknown."""
    if out == "-":
        raise click.UsageError("'-' is not a file: without -o, TUM lines go to stdout")
    if out is not None and kind is None and not out.lower().endswith(TRAJECTORIES):
        common.refuse_format_ending(out)
        raise click.UsageError(f"{unknown_ending(out, TRAJECTORIES)}; --format names the format")
    if kind is not None and out is None:
        raise click.UsageError("--format needs an output file: give -o OUT")


def _stamps(name: str) -> npt.NDArray[np.int64]:
    if name == "-":
        name = "standard input"
        text = sys.stdin.buffer.read().decode(errors="replace")
    else:
        (path,) = common.find_paths([name])
        with errors_name(path):
            text = path.read_text("utf-8", errors="replace")
    import numpy as np

    return np.array(read_stamps(text.removeprefix("\ufeff"), name), dtype=np.int64)


def _between(
    stamps: npt.NDArray[np.int64], first: int | None, last: int | None
) -> npt.NDArray[np.int64]:
    import numpy as np

    inside = np.ones(len(stamps), dtype=bool)
    if first is not None:
        inside &= stamps >= first
    if last is not None:
        inside &= stamps <= last
    return stamps[inside]


def _check_order(
    stamps: npt.NDArray[np.int64], out: str, kind: Format | None, stamps_file: str | None
) -> None:
    """Refuse stamps that `Trajectory.read` refuses: decreasing ones, in .npz and Parquet repeated.

    Only the stamps of `--at` can be such.
    """
    import numpy as np

    no_repeats = (kind or out.lower().rpartition(".")[2]) in ("npz", "parquet")
    wrong = np.flatnonzero(np.diff(stamps) < int(no_repeats))
    if len(wrong):
        before, stamp = map(int, stamps[wrong[0] : wrong[0] + 2])
        name = "standard input" if stamps_file == "-" else stamps_file
        hint = "sort the stamps" if stamp < before else "give each stamp once"
        raise tfdb.InvalidStamp(
            f"{name}: stamp {format_seconds(stamp)} follows {format_seconds(before)}, but "
            f"the stamps of {out} must increase: {hint}",
            path=name,
            value=stamp,
        )


def _write(out: str | None, made: Poses, kind: Format | None, *, overwrite: bool) -> None:
    if out is not None:
        from tfdb.trajectories.writing import write_trajectory  # noqa: PLC0415 - needs numpy

        write_trajectory(out, made, kind, overwrite=overwrite)
        return
    for stamp, pose in zip(made.stamps.tolist(), made.poses.tolist(), strict=True):
        output.say(f"{format_ns(stamp)} {' '.join(map(repr, pose))}")


def _body(loaded: common.Loaded, made: Poses, out: str | None) -> dict[str, Any]:
    body: dict[str, Any] = {
        "files": list(loaded.names),
        "target": made.target,
        "source": made.source,
        "output": out,
        "poses": len(made.stamps),
        "missing": made.missing,
        "start_ns": int(made.stamps.min()) if len(made.stamps) else None,
        "end_ns": int(made.stamps.max()) if len(made.stamps) else None,
    }
    if out is None:
        body["stamps_ns"] = made.stamps.tolist()
        body["xyz_xyzw"] = made.poses.tolist()
    return body


def _describe(made: Poses) -> str:
    text = f"{counted(len(made.stamps), 'pose')} of {made.source} in {made.target}"
    if len(made.stamps) > 1:
        text += f" over {format_duration(int(made.stamps[-1] - made.stamps[0]))}"
    if made.missing:
        text += f"; {counted(made.missing, 'stamp')} without a pose left out"
    return text

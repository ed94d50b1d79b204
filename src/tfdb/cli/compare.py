"""``tfdb compare``: measures an estimated trajectory against a reference."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

import tfdb
from tfdb.data.counting import counted
from tfdb.data.path_checks import check_path
from tfdb.store.frozen import is_frozen

from . import common, layout, output
from .groups import OneOf, SuggestingCommand
from .pictures import need_matplotlib, picture_files, write_pictures
from .selecting import given, selection_options
from .times import NS, offset_option, seconds_option

if TYPE_CHECKING:
    from collections.abc import Sequence

    from click.decorators import FC

    from tfdb import Comparison, Trajectory
    from tfdb.comparing import Errors
    from tfdb.comparing.inputs import Reading

_ALIGN = ("se3", "sim3", "scale", "yaw", "origin", "none")
_UNITS = ("frames", "m", "s", "deg", "rad")


def _offset(ctx: click.Context, param: click.Parameter, value: str | None) -> Any:
    """Convert an option's text: a signed number of seconds, or `estimate`."""
    if value == "estimate":
        return value
    found = offset_option(ctx, param, value)
    return None if found is None else found / NS


_OPTIONS = (
    click.option(
        "--estimate-frames",
        nargs=2,
        metavar="TARGET SOURCE",
        help="Frames of ESTIMATE, if they differ from those of the reference.",
    ),
    click.option(
        "--association",
        type=OneOf(("interpolate", "nearest", "rows")),
        default="interpolate",
        help="interpolate: interpolate the trajectory with more poses at the stamps of the other. "
        "nearest: match the nearest pose, as evo does. rows: match row by row, the default for two "
        "KITTI files without times.",
    ),
    seconds_option(
        "--max-diff",
        help="Largest time between two matched poses.  [default: 0.01; for interpolation, 2.5 "
        "median periods]",
    ),
    click.option(
        "--offset",
        metavar="SECONDS|estimate",
        callback=_offset,
        default="0",
        help="Clock offset to add to the stamps of ESTIMATE. 'estimate' computes it from the "
        "motions of both trajectories; their drift biases it by milliseconds.",
    ),
    click.option(
        "--align",
        type=OneOf(_ALIGN),
        default="se3",
        help="Transform to fit before the comparison. se3: rotation and translation. sim3: also a "
        "scale. scale: only a scale. yaw: yaw angle and translation. origin: make the first poses "
        "equal.",
    ),
    click.option(
        "--align-poses",
        type=click.IntRange(min=1),
        metavar="N",
        help="Fit the first N matched poses only.",
    ),
    click.option(
        "--delta",
        type=click.FloatRange(min=0, min_open=True),
        default=1.0,
        help="Length of the segments of the relative error (RPE).",
    ),
    click.option(
        "--delta-unit",
        type=OneOf(_UNITS),
        default="frames",
        help="Unit of --delta: matched poses, metres, seconds, degrees, radians.",
    ),
    click.option(
        "--all-pairs", is_flag=True, help="Start a segment of the relative error at every pose."
    ),
    click.option(
        "--delta-tolerance",
        type=click.FloatRange(min=0),
        default=0.1,
        help="With --all-pairs: relative tolerance on --delta.",
    ),
    click.option(
        "--pairs-from",
        type=OneOf(("estimate", "reference")),
        default="estimate",
        help="Trajectory whose path defines the segments.",
    ),
)


def comparison_options(command: FC) -> FC:
    """Add all options of a comparison to a command."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


@click.command("compare", cls=SuggestingCommand)
@click.argument("reference", type=click.Path())
@click.argument("estimate", type=click.Path())
@click.option(
    "--frames",
    nargs=2,
    metavar="TARGET SOURCE",
    help="Compare T[TARGET<-SOURCE] of a recording or store.",
)
@comparison_options
@click.option(
    "--save",
    "saved",
    multiple=True,
    metavar="FORMAT|PATH",
    help="Draw both trajectories and the errors over time. A FORMAT (png, svg, pdf) writes "
    "ESTIMATE_compare.FORMAT into the current folder. Repeatable.",
)
@common.overwrite_option
@selection_options
@common.json_option
def command(
    *,
    reference: str,
    estimate: str,
    frames: tuple[str, str] | None,
    saved: tuple[str, ...],
    overwrite: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Measure the error of a trajectory: APE (ATE) and RPE, equal to evo's.

    Example: tfdb compare truth.tum drive.mcap --frames map base_link --save png

    REFERENCE and ESTIMATE are TUM, KITTI, EuRoC, CSV or NPZ files. With --frames they may also be
    recordings, FILE.tfdb, shm:NAME or a live graph (ros1:, ros2:), heard for 5 s. Translations are
    in metres, rotations in degrees.
    """
    read = reference, estimate
    outs = picture_files(saved, estimate, "compare", read, overwrite=overwrite)
    if outs:
        need_matplotlib()
    found, ours, theirs = find(reference, estimate, frames, "with --frames", options)
    if outs:
        figure = found.plot(title=title_of(reference, estimate))
        write_pictures(figure, outs, overwrite=overwrite)
    if as_json:
        body = _body(found, [str(path) for path in outs])
        output.emit_json("compare", {"files": [reference, estimate], **body})
        return
    for role, name, trajectory in (("reference", reference, ours), ("estimate", estimate, theirs)):
        output.say(_given(role, name, trajectory, named=_has_frames(name)))
    output.say(str(found))
    if outs:
        output.say()
    for path in outs:
        output.say_wrapped(f"{path}: the comparison", str(path))


def _has_frames(name: str) -> bool:
    """Return whether a name is that of a store or recording, which need `--frames`."""
    from tfdb.comparing.inputs import is_recording  # noqa: PLC0415 - brings numpy

    if common.is_live(name):
        return True
    path = check_path(name)
    return is_frozen(path) or is_recording(path)


def title_of(reference: str, estimate: str) -> str | None:
    """Return a title with the file names of trajectories; None if frames name the picture."""
    if any(map(_has_frames, (reference, estimate))):
        return None
    return f"{check_path(estimate).name} against {check_path(reference).name}"


def find(
    reference: str,
    estimate: str,
    frames: Sequence[str] | None,
    how: str,
    options: dict[str, Any],
) -> tuple[Comparison, Trajectory, Trajectory]:
    """Read and compare both, with the options of `comparison_options`.

    `how` is the command's syntax for the frames, for errors.
    """
    chosen = given()
    unit = chosen.pop("stamp_unit", None)
    named = any(_has_frames(name) for name in (reference, estimate))
    if chosen.keys() - {"salvage"} and not named:
        raise click.UsageError(
            "options that select parts of a recording do not apply to trajectory files"
        )
    from tfdb.comparing.inputs import Reading, pairs_by_row  # noqa: PLC0415 - brings numpy

    options = dict(options)
    live = common.is_live(reference) or common.is_live(estimate)
    by_default = options["association"] == "interpolate" and not live
    if by_default and pairs_by_row(reference, estimate, options["delta_unit"]):
        options["association"] = "rows"
    reading = Reading("salvage" in chosen, unit, options["association"] == "rows")
    others = options.pop("estimate_frames") or frames
    limit = options.pop("max_diff")
    ours = _read(reference, frames, how, reading)
    theirs = _read(estimate, others, "with --estimate-frames", reading)
    found = tfdb.compare(ours, theirs, max_diff=None if limit is None else limit / NS, **options)
    return found, ours, theirs


def _read(name: str, frames: Sequence[str] | None, how: str, reading: Reading) -> Trajectory:
    """Read the reference or the estimate."""
    if not _has_frames(name):
        from tfdb.comparing.inputs import to_trajectory  # noqa: PLC0415 - brings numpy

        return to_trajectory(name, None, "trajectory", "frames", reading)
    if frames is None:
        raise click.UsageError(f"{name} has many frames: name two {how} TARGET SOURCE")
    store = common.load((name,)).store
    target, source = common.find_frames(store, *frames)
    return store.trajectory(target, source, missing="skip")


def _given(role: str, name: str, trajectory: Trajectory, *, named: bool) -> str:
    """Describe the reference or the estimate."""
    chunks = layout.words(f"{role:<10} {name}", name)
    if named:
        first, *rest = layout.transform_name(trajectory.target, trajectory.source)
        chunks += [f" {first}", *rest]
    return layout.wrap([*chunks, *layout.words(f", {counted(len(trajectory), 'pose')}")], " " * 11)


def _body(found: Comparison, outputs: list[str]) -> dict[str, Any]:
    stamps = found.reference.stamps
    return {
        "poses": list(found.given),
        "matched": len(found),
        "start_ns": int(stamps[0]) if found.has_stamps else None,
        "end_ns": int(stamps[-1]) if found.has_stamps else None,
        "association": found.association,
        "max_diff_ns": found.max_diff,
        "offset_ns": found.offset,
        "offset_estimated": found.offset_estimated,
        "align": found.align,
        "scale": found.scale,
        "translation": found.alignment.translation.tolist(),
        "rotation_xyzw": found.alignment.rotation.tolist(),
        "ape": _errors(found.ape_translation, found.ape_rotation),
        "rpe": {
            "delta": found.delta,
            "delta_unit": found.delta_unit,
            "all_pairs": found.all_pairs,
            "pairs": len(found.pairs),
            **_errors(found.rpe_translation, found.rpe_rotation),
        },
        "outputs": outputs,
    }


def _errors(translation: Errors, rotation: Errors) -> dict[str, Any]:
    return {"translation_m": translation.in_degrees(), "rotation_deg": rotation.in_degrees()}

"""``tfdb static-publisher``: publishes static transforms."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import click

import tfdb
from tfdb.data.path_checks import errors_name
from tfdb.robots.urdf import load_urdf
from tfdb.store.summary import static_edges

from . import common, output, selecting
from .angles import quaternion_of
from .graph import STORE, is_graph, node_option, open_graph, wait_for_end
from .groups import SuggestingCommand

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from tfdb.ros import Node

_FORMS = "X Y Z QX QY QZ QW FRAME CHILD, or X Y Z YAW PITCH ROLL FRAME CHILD"
_MODELS = (".urdf", ".xml")
_KEYS = {"parent", "child", "translation", "rotation_xyzw", "rpy_deg"}


def _numbers(command: Any) -> Any:
    """Add the flags of ROS 2's static_transform_publisher to a command."""
    helps = {
        "x": "x of the translation, in metres",
        "y": "y of the translation, in metres",
        "z": "z of the translation, in metres",
        "qx": "x of the quaternion",
        "qy": "y of the quaternion",
        "qz": "z of the quaternion",
        "qw": "w of the quaternion",
        "roll": "Radians about the fixed x axis",
        "pitch": "Radians about the fixed y axis",
        "yaw": "Radians about the fixed z axis",
    }
    for name, text in reversed(helps.items()):
        command = click.option(f"--{name}", type=float, help=f"{text}.")(command)
    return command


@click.command("static-publisher", cls=SuggestingCommand)
@click.argument("where")
@click.argument("values", nargs=-1, metavar="[" + _FORMS.replace(", or ", "] | [") + "]")
@click.option("--frame-id", "frame", metavar="FRAME", help="Name of the parent frame.")
@click.option("--child-frame-id", "child", metavar="CHILD", help="Name of the child frame.")
@_numbers
@click.option(
    "--from",
    "sources",
    multiple=True,
    type=click.Path(),
    metavar="FILE",
    help="Publish the fixed joints of a .urdf, the transforms of a .json, or the static transforms "
    "of a recording or store; repeatable.",
)
@node_option
@selecting.groups_options
@common.json_option
def command(
    *,
    where: str,
    values: tuple[str, ...],
    frame: str | None,
    child: str | None,
    sources: tuple[str, ...],
    as_json: bool,
    **numbers: float | None,
) -> None:
    """Publish static transforms from arguments, a URDF or a recording.

    Example: tfdb static-publisher ros1: 0.1 0 0.3 0 0 0 1 base_link camera

    In a graph (ros1:, ros2:) T[FRAME<-CHILD] is latched on /tf_static until Ctrl-C. In a shared
    store (shm:NAME) it stays after the command ends.

    The arguments are those of ROS 1's and ROS 2's static_transform_publisher: by position, or by
    --x ... --yaw, --frame-id and --child-frame-id. Angles are in radians.

    A .json is a list of {"parent", "child", "translation": [x, y, z], "rotation_xyzw": [x, y, z, w]
    or "rpy_deg": [roll, pitch, yaw]}.
    """
    given = {name: value for name, value in numbers.items() if value is not None}
    if selecting.given() and not sources:
        raise click.UsageError("--topic, --by-namespace and --mix need --from")
    transforms = [one for name in sources for one in _read(name)]
    if values:
        if given or frame or child:
            raise click.UsageError("give the transform by arguments or by options, not both")
        transforms.append(_by_place(values))
    elif given or frame or child or not sources:
        transforms.append(_by_flags(given, frame, child))
    if not transforms:
        raise click.UsageError(f"{', '.join(sources)}: no static transforms found")
    # A private store checks the transforms before they are published.
    tfdb.Buffer().set_transforms(transforms, static=True)
    if is_graph(where):
        with open_graph(where) as (node, ended):
            _publish(node, transforms)
            _show_published(where, node.name, transforms, as_json=as_json)
            wait_for_end(node, ended)
    if not where.startswith(STORE):
        raise click.UsageError(f"{where!r} is neither a graph, ros1: or ros2:, nor shm:NAME")
    with tfdb.Buffer.open(where.removeprefix(STORE)) as store:
        store.set_transforms(transforms, static=True, authority="tfdb static-publisher")
    _show_published(where, "", transforms, as_json=as_json)


def _publish(node: Node, transforms: Sequence[tfdb.TransformStamped]) -> None:
    stamped = [replace(one, stamp=node.now()) for one in transforms]
    publisher = node.advertise("/tf_static", "tf2_msgs/TFMessage", latched=True, depth=1)
    publisher.publish(tfdb.encode_tf_message(stamped, node.encoding))


def _show_published(
    where: str, node: str, transforms: Sequence[tfdb.TransformStamped], *, as_json: bool
) -> None:
    if as_json:
        edges = [{"parent": one.parent, "child": one.child} for one in transforms]
        body = {"files": [where], "node": node or None, "transforms": edges}
        output.emit_json("static-publisher", body)
        return
    listed = ", ".join(f"{one.parent} -> {one.child}" for one in transforms[:5])
    more = f" and {len(transforms) - 5} more" if len(transforms) > 5 else ""
    by = f" as {node}; Ctrl-C ends it" if node else ""
    names = [name for one in transforms[:5] for name in (one.parent, one.child)]
    output.say_wrapped(f"{where}{by}: {listed}{more}", *names)


def _by_place(values: Sequence[str]) -> tfdb.TransformStamped:
    """Make the transform of ROS 1's positional arguments."""
    if len(values) not in (8, 9):
        raise click.UsageError(f"{len(values)} values: give {_FORMS}")
    *texts, frame, child = values
    try:
        numbers = [float(text) for text in texts]
    except ValueError as error:
        raise click.UsageError(f"{error}: give {_FORMS}") from None
    turn = numbers[3:] if len(numbers) == 7 else quaternion_of(*reversed(numbers[3:]))
    return tfdb.TransformStamped(frame, child, 0, tuple(numbers[:3]), tuple(turn))


def _by_flags(
    given: dict[str, float], frame: str | None, child: str | None
) -> tfdb.TransformStamped:
    """Make the transform of ROS 2's flags."""
    if not frame or not child:
        raise click.UsageError(f"give {_FORMS}; or --frame-id and --child-frame-id; or --from FILE")
    quaternion = [name for name in ("qx", "qy", "qz", "qw") if name in given]
    angles = [name for name in ("roll", "pitch", "yaw") if name in given]
    if quaternion and angles:
        raise click.UsageError(f"--{quaternion[0]} and --{angles[0]} exclude each other")
    place = tuple(given.get(name, 0.0) for name in ("x", "y", "z"))
    if quaternion:
        turn = [given.get(name, float(name == "qw")) for name in ("qx", "qy", "qz", "qw")]
    else:
        turn = quaternion_of(*(given.get(name, 0.0) for name in ("roll", "pitch", "yaw")))
    return tfdb.TransformStamped(frame, child, 0, place, tuple(turn))


def _read(name: str) -> Iterator[tfdb.TransformStamped]:
    """Read the static transforms of a file or store."""
    if name.lower().endswith(_MODELS):
        (path,) = common.find_paths((name,))
        yield from load_urdf(path).static_transforms()
    elif name.lower().endswith(".json"):
        yield from _of_json(name)
    else:
        store = common.load((name,)).store
        for info, parent, pose in static_edges(store):
            yield tfdb.TransformStamped(parent, info.name, 0, pose[:3], pose[3:])


def _of_json(name: str) -> Iterator[tfdb.TransformStamped]:
    (path,) = common.find_paths((name,))
    with errors_name(path):
        text = path.read_text(encoding="utf-8", errors="replace")
    try:
        found = json.loads(text)
    except ValueError as error:
        raise tfdb.errors.ModelError(name, f"no JSON: {error}", line=None) from None
    for number, one in enumerate(found if isinstance(found, list) else [found], start=1):
        try:
            yield _of_object(one)
        except ValueError as error:
            raise tfdb.errors.ModelError(name, f"transform {number}: {error}", line=None) from None


def _of_object(one: Any) -> tfdb.TransformStamped:
    """Make the transform of a JSON object. Raises ValueError."""
    if not isinstance(one, dict) or not {"parent", "child"} <= set(one) <= _KEYS:
        raise ValueError(
            f"an object must have parent and child; valid keys are {', '.join(sorted(_KEYS))}"
        )
    if not all(isinstance(one[key], str) for key in ("parent", "child")):
        raise ValueError("parent and child must be strings")
    if "rotation_xyzw" in one and "rpy_deg" in one:
        raise ValueError("rotation_xyzw and rpy_deg exclude each other")
    place = _list_of(one, "translation", [0.0, 0.0, 0.0])
    if "rpy_deg" in one:
        turn = quaternion_of(*map(math.radians, _list_of(one, "rpy_deg", [0.0, 0.0, 0.0])))
    else:
        turn = _list_of(one, "rotation_xyzw", [0.0, 0.0, 0.0, 1.0])
    return tfdb.TransformStamped(one["parent"], one["child"], 0, place, turn)


def _list_of(one: dict[str, Any], key: str, default: list[float]) -> list[float]:
    found = one.get(key, default)
    numbers = found if isinstance(found, list) else []
    if len(numbers) != len(default) or not all(isinstance(each, int | float) for each in numbers):
        raise ValueError(f"{key} must be a list of {len(default)} numbers")
    return numbers

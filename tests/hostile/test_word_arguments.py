"""Every argument that takes one of a few words names them, and the nearest where one is mistyped.

The arguments are found by their annotations, so that a new one is tested as well.
"""

from __future__ import annotations

import inspect
import re
import typing
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tfdb.recordings import load_joint_states

pytest.importorskip("matplotlib")
import tfdb.plot
from tfdb.data.types import Concurrency
from tfdb.tf2 import clouds, msgs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

SECOND = 10**9
BAG = Path(__file__).parents[2] / "examples" / "data" / "pr2.bag"
WORDS: dict[str, tuple[str, ...]] = {
    "align": ("se3", "sim3", "scale", "yaw", "origin", "none"),
    "association": ("interpolate", "nearest", "rows"),
    "axes": ("xy", "xz", "yz", "xyz"),
    "clock": ("stamps", "arrival"),
    "color": ("time", "speed"),
    "concurrency": typing.get_args(Concurrency),
    "delta_unit": ("frames", "deg", "rad", "m", "s"),
    "encoding": ("ros1", "cdr", "cdr_le", "cdr_be", "cdr2_le", "cdr2_be"),
    "flavor": ("ros1", "ros2"),
    "format": ("tum", "kitti", "euroc", "csv", "npz", "parquet"),
    "lapped": ("raise", "skip"),
    "layout": ("pose", "matrix"),
    "limits": ("warn", "raise", "ignore"),
    "missing": ("raise", "nan"),
    "mode": ("r", "rw"),
    "offset": ("estimate",),
    "pairs_from": ("estimate", "reference"),
    "since": ("header", "epoch"),
    "stamp_unit": ("s", "ms", "us", "ns"),
    "unit": ("s", "ms", "us", "ns"),
}
ALIAS = re.compile("Concurrency|Flavor|Encoding|str|Format|Align|Unit|Missing|_empty")
ROOMS = (tfdb.recordings, tfdb.robots, tfdb.trajectories)
RECORDS = {"Comparison", "JointReport", "Shared", "Snapshot", "Source", "Trouble"}
"""Classes that the package makes itself: their fields are results, their methods a Buffer's."""


def store() -> tfdb.Buffer:
    made = tfdb.Buffer()
    for i in range(3):
        made.set_transform("map", "base", i * SECOND, (i, 2, 3), (0, 0, 0.6, 0.8))
    return made


def cloud() -> Any:
    fields = [
        msgs.PointField(name, 4 * i, msgs.PointField.FLOAT32, 1) for i, name in enumerate("xyzt")
    ]
    header = msgs.Header(msgs.Time(1), "base")
    return msgs.PointCloud2(header, 1, 1, fields, False, 16, 16, np.zeros(4, np.float32).tobytes())


def calls(tmp_path: Path) -> dict[tuple[str, str], Callable[..., Any]]:
    """Each function with such an argument, with all others given."""
    buf = store()
    path = buf.trajectory("map", "base")
    robot = tfdb.robots.parse_urdf(
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="fixed">'
        '<parent link="a"/><child link="b"/></joint></robot>'
    )
    stamps, points = path.stamps, np.ones((3, 3))
    sample = tfdb.TransformStamped("map", "base", SECOND, (1, 2, 3), (0, 0, 0.6, 0.8))

    def many(**more: Any) -> Any:
        return buf.lookup_transforms("map", "base", stamps, **more)

    def in_transaction(read: str, *arguments: Any) -> Callable[..., Any]:
        def ask(**more: Any) -> Any:
            with buf.transaction() as transaction:
                return getattr(transaction, read)("map", "base", *arguments, **more)

        return ask

    def deskewed(**more: Any) -> Any:
        return clouds.deskew_cloud(cloud(), buf, "map", time_field="t", **more)

    return of_trajectories(path, tmp_path) | {
        ("Buffer", "concurrency"): tfdb.Buffer,
        ("Buffer.load", "stamp_unit"): lambda **more: tfdb.Buffer().load(BAG, **more),
        ("load", "stamp_unit"): lambda **more: tfdb.load(BAG, **more),
        ("recordings.Selection", "stamp_unit"): tfdb.recordings.Selection,
        ("recordings.follow_recording", "stamp_unit"): lambda **more: (
            tfdb.recordings.follow_recording(tfdb.Buffer(), BAG, **more)
        ),
        ("Buffer.follow", "lapped"): buf.follow,
        ("Buffer.open", "mode"): lambda **more: tfdb.Buffer.open("words", **more),
        ("Buffer.ingest", "encoding"): lambda **more: buf.ingest(b"", **more),
        ("Buffer.ingest_many", "encoding"): lambda **more: buf.ingest_many([b""], **more),
        ("Buffer.lookup_transforms", "layout"): many,
        ("Buffer.lookup_transforms", "missing"): many,
        ("StoreReader.lookup_transforms", "layout"): many,
        ("StoreReader.lookup_transforms", "missing"): many,
        ("Transaction.lookup_transforms", "layout"): in_transaction("lookup_transforms", stamps),
        ("Transaction.lookup_transforms", "missing"): in_transaction("lookup_transforms", stamps),
        ("Transaction.transform_points", "missing"): in_transaction(
            "transform_points", points, stamps
        ),
        ("Transaction.trajectory", "missing"): in_transaction("trajectory"),
        ("StoreReader.transform_points", "missing"): lambda **more: buf.transform_points(
            "map", "base", points, stamps, **more
        ),
        ("StoreReader.trajectory", "missing"): lambda **more: buf.trajectory("map", "base", **more),
        ("Expectations", "clock"): tfdb.Expectations,
        ("decode_tf_message", "encoding"): lambda **more: tfdb.decode_tf_message(b"", **more),
        ("encode_tf_message", "encoding"): lambda **more: tfdb.encode_tf_message([sample], **more),
        ("recordings.load_joint_states", "limits"): lambda **more: load_joint_states(
            robot, BAG, topic="/joint_states", **more
        ),
        ("tf2.Buffer", "flavor"): tfdb.tf2.Buffer,
        ("tf2.BufferCore", "flavor"): tfdb.tf2.BufferCore,
        ("tf2.clouds.deskew_cloud", "unit"): deskewed,
        ("tf2.clouds.deskew_cloud", "since"): deskewed,
    }


def of_trajectories(
    path: tfdb.Trajectory, tmp_path: Path
) -> dict[tuple[str, str], Callable[..., Any]]:
    """Those that take a trajectory, or a file of one."""
    stamps, file = path.stamps, tmp_path / "a.tum"
    path.save(file, overwrite=True)

    def compared(**more: Any) -> Any:
        return tfdb.compare(path, path, **more)

    return {
        ("Trajectory.at", "missing"): lambda **more: path.at(stamps, **more),
        ("Trajectory.resample", "missing"): lambda **more: path.resample(rate=5.0, **more),
        ("Trajectory.plot", "axes"): path.plot,
        ("Trajectory.plot", "color"): path.plot,
        ("plot.trajectory", "axes"): lambda **more: tfdb.plot.trajectory(path, **more),
        ("plot.trajectory", "color"): lambda **more: tfdb.plot.trajectory(path, **more),
        **{
            ("compare", each): compared
            for each in ("association", "offset", "align", "delta_unit", "pairs_from", "stamp_unit")
        },
        ("recordings.Recording", "stamp_unit"): lambda **more: tfdb.recordings.Recording(
            file, **more
        ),
        ("Trajectory.read", "format"): lambda **more: tfdb.Trajectory.read(file, **more),
        ("Trajectory.read", "stamp_unit"): lambda **more: tfdb.Trajectory.read(file, **more),
        ("Trajectory.save", "format"): lambda **more: path.save(tmp_path / "b.x", **more),
    }


def found() -> Iterator[tuple[str, str]]:
    """Find every public argument whose annotation is of words, or that is called as one that is."""
    packages = (tfdb, *ROOMS, tfdb.plot, tfdb.tf2, clouds)
    for package in packages:
        place = package.__name__.removeprefix("tfdb").lstrip(".")
        for name in package.__all__:
            thing = getattr(package, name)
            if not callable(thing) or name in RECORDS:
                continue
            members = [(name, thing)]
            if isinstance(thing, type):
                if issubclass(thing, BaseException):
                    continue
                mine = [each for each in vars(thing) if each[:1] != "_"]
                members += [(f"{name}.{each}", getattr(thing, each)) for each in mine]
            for full, member in members:
                for argument in arguments(member):
                    if (full, argument) == ("open", "clock"):  # a function, without annotation
                        continue
                    yield ".".join(filter(None, (place, full))), argument


def arguments(function: Any) -> Iterator[str]:
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return
    for each in parameters:
        written = str(each.annotation)
        if "Literal[" in written or (each.name in WORDS and ALIAS.search(written)):
            yield each.name


def test_each_argument_that_takes_a_word_is_tried(tmp_path: Path) -> None:
    tried = set(calls(tmp_path))
    assert len(tried) > 30
    # A commit number as well: tests/streams has it.
    assert {each for each in found() if each not in tried} == {("Buffer.follow", "since")}


@pytest.mark.parametrize("argument", WORDS)
def test_a_word_that_is_mistyped_gets_the_nearest(argument: str, tmp_path: Path) -> None:
    tried = [call for (_, name), call in calls(tmp_path).items() if name == argument]
    assert tried
    for call in tried:
        for right in WORDS[argument]:
            wrong = right + "x" if len(right) < 3 else right[:-2] + right[-1] + right[-2]
            wrong = right + "x" if wrong == right else wrong
            said = refused(call, **{argument: wrong})
            assert f"{argument} must be " in said, said
            assert repr(right) in said, said
            if len(right) > 2:
                assert f"got {wrong!r}; did you mean '" in said, said
        said = refused(call, **{argument: "zzzzzz"})
        assert said.endswith("got 'zzzzzz'"), said
        if argument != "offset":  # numbers are offsets
            assert f"{argument} must be " in refused(call, **{argument: 5}), said


def refused(call: Callable[..., Any], **given: Any) -> str:
    """Call it with a word that is none of them: the error is one of tfdb, or a TypeError."""
    with pytest.raises((tfdb.TfdbError, TypeError)) as error:
        call(**given)
    return str(error.value)

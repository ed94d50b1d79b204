"""Functions written in Python refuse every wrong type with an error of tfdb."""

from __future__ import annotations

import inspect
import operator
import shutil
import traceback
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb

if TYPE_CHECKING:
    from collections.abc import Callable

HOME = Path(tfdb.__file__).parent
BAG = Path(__file__).resolve().parents[2] / "examples" / "data" / "pr2.mcap"
WRONG: list[Any] = [
    *(None, 1, -1, 0, 2.5, float("nan"), float("inf"), True, 10**30, -(2**63), 1j),
    *("", "x", "map", "\ud800", b"x", [], [1], ["a"], {}, {"a": 1}, (), (1, 2, 3), set(), range(3)),
    *(object(), np.array([1.0]), np.zeros((2, 2)), np.array(["a"]), lambda: 0, Path("none"), tfdb),
]
EXTENSION = ("policy must be an object such as tfdb.", "Transform() argument")
"""What the extension says of wrong types, in our words."""
UNDER = {"progress", "show"}
"""A callback is the caller's own; a window is nothing to test here."""


@pytest.fixture(scope="module")
def buffer() -> tfdb.Buffer:
    return tfdb.load(BAG)


@pytest.fixture(scope="module")
def path(buffer: tfdb.Buffer) -> tfdb.Trajectory:
    return buffer.trajectory("map", "base_link", 10.0)


def leak(call: Callable[..., object], given: list[Any], named: dict[str, Any]) -> str | None:
    """What came out that is not ours to say, and where; None where all is well.

    A TypeError is ours where a `raise` of ours made it; that of a call which does not fit a
    signature is Python's or the extension's, and as good.
    """
    try:
        call(*given, **named)
    except (tfdb.TfdbError, OSError):
        return None
    except Exception as error:
        last = traceback.extract_tb(error.__traceback__)[-1]
        ours = last.filename.startswith(str(HOME)) and (last.line or "").startswith("raise ")
        text = str(error).startswith(EXTENSION)
        if isinstance(error, TypeError) and (ours or text or last.filename == __file__):
            return None
        return f"{type(error).__name__}: {error}, of {given} {named} at {last}"
    return None


def leaks(call: Callable[..., object], good: list[Any]) -> list[str]:
    """Put each wrong thing in each place, one at a time."""
    trials = [([*good[:i], wrong, *good[i + 1 :]], {}) for i in range(len(good)) for wrong in WRONG]
    kinds = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    for parameter in list(inspect.signature(call).parameters.values())[len(good) :]:
        if parameter.kind in kinds and parameter.name not in UNDER:
            trials += [(good, {parameter.name: wrong}) for wrong in WRONG]
    found = (leak(call, given, named) for given, named in trials)
    return [each for each in found if each is not None]


@pytest.mark.parametrize(
    "name",
    [
        *("Interpolate", "Previous", "Nearest", "Extrapolate", "Exact", "load", "compare"),
        *(
            "Trajectory.read",
            "trajectories.write_tum",
            "trajectories.write_csv",
        ),
        *(
            "trajectories.write_euroc",
            "trajectories.write_kitti",
            "trajectories.write_npz",
            "recordings.write_recording",
        ),
        *(
            "recordings.write_transforms",
            "robots.parse_urdf",
            "recordings.follow_recording",
            "trajectories.write_parquet",
        ),
        *("robots.RobotModel", "open"),
    ],
)
def test_a_wrong_type_is_refused_in_our_words(
    buffer: tfdb.Buffer,
    path: tfdb.Trajectory,
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    bag = Path(shutil.copy(BAG, tmp_path))  # what is true as `cache` writes beside it
    good: dict[str, list[Any]] = {
        "load": [bag],
        "compare": [path, path],
        "Trajectory.read": ["none.tum"],
        "recordings.write_recording": ["out.mcap", tfdb.Buffer()],
        "recordings.write_transforms": [
            "out.mcap",
            [tfdb.TransformStamped("a", "b", 5, (1, 2, 3))],
        ],
        "robots.parse_urdf": ["<robot name='x'><link name='a'/></robot>"],
        "recordings.follow_recording": [tfdb.Buffer(history=None), "none.mcap"],
        "robots.RobotModel": ["arm", ("base",), {}, "base"],
        "open": ["none.tfdb"],
        "Extrapolate": [1.0],
        "Nearest": [1.0],
    }
    call = operator.attrgetter(name)(tfdb)
    if name.startswith("trajectories.write_") and name not in good:
        good[name] = ["out.tum", path]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tfdb.TfdbWarning)
        assert leaks(call, good.get(name, [])) == []


def test_trajectories_refuse_wrong_types(
    path: tfdb.Trajectory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    good: dict[str, list[Any]] = {
        "at": [int(path.stamps[1])],
        "resample": [5.0],
        "simplify": [0.01],
        "save": ["out.parquet"],
        "read": ["out.parquet"],
    }
    for wrong in WRONG:
        assert leak(operator.getitem, [path, wrong], {}) is None
    for name in dir(path):
        if not name.startswith("_") and name != "plot" and callable(method := getattr(path, name)):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", tfdb.TfdbWarning)
                assert leaks(method, good.get(name, [])) == [], name


def test_pictures_refuse_wrong_types(buffer: tfdb.Buffer, path: tfdb.Trajectory) -> None:
    plot = pytest.importorskip("tfdb.plot")
    for call, good in ((plot.timeline, [buffer]), (plot.frame_tree, [buffer])):
        for title in WRONG[1:]:
            assert leak(call, good, {"title": title}) is None
    for wrong in WRONG:
        assert leak(plot.comparison, [wrong], {}) is None


def test_paths_that_no_store_can_have() -> None:
    for wrong in ("\ud800", "a\0b", "", None, b"x"):
        with pytest.raises(tfdb.InvalidArgument):
            tfdb.open(wrong)  # type: ignore[arg-type]
    assert "\ud800" not in tfdb.Buffer()


def test_type_errors_name_the_called_function(buffer: tfdb.Buffer) -> None:
    for call in (
        lambda: buffer.children(1),  # type: ignore[arg-type]
        lambda: buffer.path("map", None),  # type: ignore[arg-type]
        lambda: buffer.trajectory(1, "map"),  # type: ignore[arg-type]
    ):
        with pytest.raises(TypeError, match="must be a str, got"):
            call()
    core = tfdb.tf2.BufferCore(flavor="ros1")
    for wrong in (1, [1], np.zeros(3)):
        with pytest.raises(TypeError, match="must be a str, got"):
            core._frameExists(wrong)  # type: ignore[arg-type]
        with pytest.raises(TypeError, match="must be a str, got"):
            core.can_transform_full_core("a", 0, wrong, 0, "b")  # type: ignore[arg-type]
        with pytest.raises(TypeError, match="must be a str, got"):
            core._chain(wrong, 0, "a", 0, "b")  # type: ignore[arg-type]

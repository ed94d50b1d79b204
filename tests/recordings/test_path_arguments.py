"""Path arguments: other types are refused, and errors name the file."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tfdb.recordings import Recording, write_transforms
from tfdb.robots.urdf import load_urdf
from tfdb.trajectories import write_kitti
from tfdb.trajectories.writing import write_trajectory
from tfdb_measure.verify.history import load_history

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

READERS: list[Callable[[Any], Any]] = [
    tfdb.load,
    lambda path: tfdb.load([path]),
    Recording,
    tfdb.Trajectory.read,
    load_urdf,
    load_history,
]
MOVED = tfdb.TransformStamped("map", "odom", 5, (1, 2, 3), (0, 0, 0.6, 0.8))
DRIVEN = tfdb.Trajectory("map", "odom", np.array([5]), np.array([[1, 2, 3, 0, 0, 0.6, 0.8]]))
WRITERS: list[Callable[[Any], Any]] = [
    lambda path: write_transforms(path, [MOVED]),
    lambda path: write_trajectory(path, DRIVEN, "tum"),
    lambda path: write_kitti(path, DRIVEN),
]
UNREADABLE = "/proc/self/mem"
"""A file that opens but fails when it is read."""


class Named:
    """A path object with bytes, which all readers refuse."""

    def __fspath__(self) -> bytes:
        return b"drive.bag"


@pytest.mark.parametrize("call", [*READERS, *WRITERS])
def test_an_empty_path_is_not_the_current_folder(call: Callable[[Any], Any]) -> None:
    with pytest.raises(tfdb.InvalidArgument, match="the path is empty"):
        call("")


@pytest.mark.parametrize("call", [*READERS, *WRITERS])
@pytest.mark.parametrize("path", [object(), 5, None, b"drive.bag", Named()])
def test_other_types_of_paths_are_refused_by_type(call: Callable[[Any], Any], path: Any) -> None:
    with pytest.raises(
        tfdb.InvalidArgument, match=r"a path must be a str or an os\.PathLike of str"
    ):
        call(path)


@pytest.mark.parametrize("call", READERS)
def test_errors_of_reading_name_the_file(call: Callable[[Any], Any]) -> None:
    with pytest.raises(OSError, match=UNREADABLE) as caught:
        call(UNREADABLE)
    assert caught.value.filename == UNREADABLE


def test_the_file_of_times_of_kitti_poses(tmp_path: Path) -> None:
    write_kitti(tmp_path / "poses.txt", DRIVEN)
    for times, match in (("", "the path is empty"), (5, "a path must be a str")):
        given: Any = times
        with pytest.raises(tfdb.InvalidArgument, match=match):
            tfdb.Trajectory.read(tmp_path / "poses.txt", times=given)
        with pytest.raises(tfdb.InvalidArgument, match=match):
            write_kitti(tmp_path / "others.txt", DRIVEN, times=given)
    with pytest.raises(OSError, match=UNREADABLE):
        tfdb.Trajectory.read(tmp_path / "poses.txt", times=UNREADABLE)


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_errors_amid_a_recording_name_it(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"a.{kind}"
    write_transforms(path, [MOVED])
    reads: list[int] = []
    real = os.pread

    def pread(descriptor: int, count: int, at: int) -> bytes:
        reads.append(at)
        if len(reads) == fails:
            raise OSError(5, "Input/output error")
        return real(descriptor, count, at)

    monkeypatch.setattr(os, "pread", pread)
    fails = 0
    tfdb.load(path)
    count = len(reads)
    assert count > 3
    for number in range(1, count + 1):
        reads.clear()
        fails = number
        with pytest.raises(OSError, match="Input/output error") as caught:
            tfdb.load(path)
        assert caught.value.filename == str(path)

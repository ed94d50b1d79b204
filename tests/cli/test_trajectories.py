"""Trajectory files as what commands read, and as what they write."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tfdb.io import read_trajectory, write_trajectory

if TYPE_CHECKING:
    from pathlib import Path

KINDS = {"tum": "a.tum", "kitti": "a.txt", "euroc": "e.csv", "csv": "a.csv", "npz": "a.npz"}
KINDS["parquet"] = "a.parquet"


@pytest.fixture
def path() -> tfdb.Trajectory:
    """A motion of which no two poses are alike, at uneven stamps."""
    rng = np.random.default_rng(3)
    stamps = np.cumsum(rng.integers(10**7, 10**8, 50)) + 1_700_000_000 * 10**9
    turns = rng.normal(size=(50, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    poses = np.hstack((rng.normal(size=(50, 3)), turns))
    return tfdb.Trajectory("world", "body", stamps.astype(np.int64), poses)


def check(found: tfdb.Trajectory, expected: tfdb.Trajectory) -> None:
    assert found.stamps.tolist() == expected.stamps.tolist()
    assert np.abs(found.translations - expected.translations).max() < 1e-12
    same = np.abs(np.sum(found.rotations * expected.rotations, axis=1))
    assert same.min() > 1 - 1e-12


@pytest.mark.parametrize("kind", KINDS)
def test_every_command_reads_them(
    tool: Any, kind: str, path: tfdb.Trajectory, tmp_path: Path
) -> None:
    file = tmp_path / KINDS[kind]
    write_trajectory(file, path, kind)
    check(tfdb.load(file).trajectory("world", "body"), path)
    renamed = ("--rename", "world:=map", "--rename", "body:=base")
    (edge,) = tool("info", file, *renamed, "--json").json["edges"]
    assert (edge["parent"], edge["frame"], edge["samples"]) == ("map", "base", 50)
    assert "└── body" in tool("tree", file).out
    found = tool("lookup", file, "world", "body", f"{path.stamps[7]}ns", "--json").json
    assert found["translation"] == pytest.approx(path.translations[7].tolist())
    part = tool("poses", file, "map", "base", *renamed, "--start", "+0.5").out.splitlines()
    assert len(part) == np.count_nonzero(path.stamps - path.stamps[0] >= 5 * 10**8)
    tool("check", file)
    bag = tmp_path / "made.bag"
    tool("convert", file, bag, *renamed)
    check(tfdb.load(bag).trajectory("map", "base"), path)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("command", ["poses", "convert"])
def test_they_are_written(
    tool: Any, kind: str, command: str, path: tfdb.Trajectory, tmp_path: Path
) -> None:
    given, out = tmp_path / "in.npz", tmp_path / KINDS[kind]
    write_trajectory(given, path)
    if command == "poses":
        tool("poses", given, "world", "body", "-o", out, "--format", kind)
    else:
        tool("convert", given, out, "--frames", "world", "body", "--format", kind)
    check(read_trajectory(out, kind), path)


def test_parquet_keeps_the_names_of_frames(
    tool: Any, path: tfdb.Trajectory, tmp_path: Path
) -> None:
    import polars as pl

    named, nameless = tmp_path / "named.parquet", tmp_path / "nameless.parquet"
    tfdb.Trajectory("map", "base", path.stamps, path.poses).to_parquet(named)
    path.to_polars().write_parquet(nameless)
    assert tfdb.load(named).frames() == ["base", "map"]
    assert tfdb.load(nameless).frames() == ["body", "world"]
    check(read_trajectory(named), path)
    assert read_trajectory(nameless, target="a").target == "a"
    out = tmp_path / "out.parquet"
    tool("poses", named, "map", "base", "-o", out)
    assert tfdb.Trajectory.from_parquet(out).source == "base"
    assert "exists already" in tool("poses", named, "map", "base", "-o", out, code=2).error
    with pytest.raises(tfdb.TrajectoryError, match="exists already"):
        write_trajectory(out, path)
    pl.DataFrame({"x": [1.0]}).write_parquet(nameless)
    out.write_bytes(named.read_bytes()[:-50])
    for bad, words in ((nameless, "no column 'stamp_ns'"), (out, "no Parquet file, or damaged")):
        with pytest.raises(tfdb.TrajectoryError, match=words):
            tfdb.load(bad)


def test_what_is_no_trajectory(tool: Any, path: tfdb.Trajectory, tmp_path: Path) -> None:
    file = tmp_path / "list.txt"
    file.write_text("1 2 3\n")
    assert "3 columns are neither TUM" in tool("tree", file, code=2).error
    file.write_text("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 7\n")
    assert "list.txt:2: " in tool("info", file, code=2).error
    with pytest.raises(tfdb.TrajectoryError, match="not of unit length: 7"):
        tfdb.load(file)
    (tmp_path / "notes.md").write_text("# Notes\n")
    assert "neither a ROS 1 bag" in tool("tree", tmp_path / "notes.md", code=2).error
    file.write_text("1 0 0 0 0 0 0 1\n")
    for given, words in (
        (("poses", file, "world", "body", "-o", "x.xyz"), "--format says what it is to be"),
        (("poses", file, "world", "body", "--format", "tum"), "give it -o OUT"),
        (("convert", file, "x.bag", "--format", "tum"), "--format goes with trajectories"),
    ):
        assert words in tool(*given, code=2).error

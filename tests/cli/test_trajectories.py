"""Trajectory files as input and output of commands."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

import tfdb
from tfdb.trajectories.writing import write_trajectory

if TYPE_CHECKING:
    from pathlib import Path

KINDS = {"tum": "a.tum", "kitti": "a.txt", "euroc": "e.csv", "csv": "a.csv", "npz": "a.npz"}
KINDS["parquet"] = "a.parquet"


@pytest.fixture
def path() -> tfdb.Trajectory:
    """A trajectory without equal poses, at uneven stamps."""
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
    check(tfdb.Trajectory.read(out, kind), path)


def test_parquet_keeps_the_names_of_frames(
    tool: Any, path: tfdb.Trajectory, tmp_path: Path
) -> None:
    import polars as pl

    named, nameless = tmp_path / "named.parquet", tmp_path / "nameless.parquet"
    tfdb.Trajectory("map", "base", path.stamps, path.poses).save(named)
    path.to_polars().write_parquet(nameless)
    assert tfdb.load(named).frames() == ["base", "map"]
    assert tfdb.load(nameless).frames() == ["body", "world"]
    check(tfdb.Trajectory.read(named), path)
    assert tfdb.Trajectory.read(nameless, target="a").target == "a"
    out = tmp_path / "out.parquet"
    tool("poses", named, "map", "base", "-o", out)
    assert tfdb.Trajectory.read(out).source == "base"
    assert "exists already" in tool("poses", named, "map", "base", "-o", out, code=2).error
    with pytest.raises(tfdb.errors.TrajectoryError, match="exists already"):
        write_trajectory(out, path)
    pl.DataFrame({"x": [1.0]}).write_parquet(nameless)
    out.write_bytes(named.read_bytes()[:-50])
    for bad, words in ((nameless, "no column 'stamp_ns'"), (out, "no Parquet file, or damaged")):
        with pytest.raises(tfdb.errors.TrajectoryError, match=words):
            tfdb.load(bad)


def test_other_text_files_are_refused(tool: Any, path: tfdb.Trajectory, tmp_path: Path) -> None:
    file = tmp_path / "list.txt"
    file.write_text("1 2 3\n")
    assert "no known format has 3 columns" in tool("tree", file, code=2).error
    file.write_text("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 7\n")
    assert "list.txt:2: " in tool("info", file, code=2).error
    with pytest.raises(tfdb.errors.TrajectoryError, match="the quaternion has length 7, not 1"):
        tfdb.load(file)
    (tmp_path / "notes.md").write_text("# Notes\n")
    assert "neither a ROS 1 bag" in tool("tree", tmp_path / "notes.md", code=2).error
    file.write_text("1 0 0 0 0 0 0 1\n")
    for given, words in (
        (("poses", file, "world", "body", "-o", "x.xyz"), "--format names the format"),
        (("poses", file, "world", "body", "--format", "tum"), "give -o OUT"),
        (("convert", file, "x.bag", "--format", "tum"), "--format is valid for trajectories"),
    ):
        assert words in tool(*given, code=2).error


def tum(path: tfdb.Trajectory, file: Path, change: Any = None) -> Path:
    lines = [
        " ".join([f"{stamp / 10**9:.2f}", *map(repr, pose)])
        for stamp, pose in zip(path.stamps.tolist(), path.poses.tolist(), strict=True)
    ]
    file.write_text("\n".join(lines if change is None else change(lines)) + "\n")
    return file


def test_a_trajectory_has_no_topics(
    tool: Any, path: tfdb.Trajectory, bag: Path, tmp_path: Path
) -> None:
    file = tum(path, tmp_path / "a.tum")
    found = tool("info", file).out
    assert "/tf" not in found
    assert "50 transforms, 2 frames, 1 moving and 0 static edges" in found
    assert "message" not in found
    assert "/tf" not in tool("tree", file).out
    body = tool("info", file, "--json").json
    assert body["topics"] == []
    assert body["messages"] == body["transforms"] == 50
    assert body["edges"][0]["authority"] == ""
    counts = {each["name"]: each["messages"] for each in tool("info", bag, "--json").json["topics"]}
    both = tool("info", bag, file, "--json").json
    assert {each["name"]: each["messages"] for each in both["topics"]} == counts
    assert f"\n{sum(counts.values())} messages, " in tool("info", bag, file).out


def test_repeated_stamps_are_counted(tool: Any, path: tfdb.Trajectory, tmp_path: Path) -> None:
    again = tum(path, tmp_path / "again.tum", lambda lines: [*lines[:9], *lines[8:]])
    found = tool("info", again)
    assert "51 rows, 1 with a repeated stamp (the last row counts)" in found.out
    assert "again.tum: 51 rows, 1 with a repeated stamp" in found.err
    (told,) = tool("info", again, "--json").json["trajectories"]
    assert (told["rows"], told["repeated"], told["differing"]) == (51, 1, 0)
    assert "51 rows, 1 with a repeated stamp" in tool("check", again).out
    other = tum(
        path,
        tmp_path / "other.tum",
        lambda lines: [*lines[:9], f"{lines[8].split()[0]} 99 0 0 0 0.6 0 0.8", *lines[9:]],
    )
    body = tool("check", other, "--json", "--ignore", "coverage", code=1).json
    (finding,) = [each for each in body["findings"] if each["kind"] == "repeated"]
    assert "51 rows, 1 with a repeated stamp, 1 with another pose" in finding["message"]
    assert finding["count"] == 1
    assert body["trajectories"][0]["rows"] == 51


def swapped(lines: list[str]) -> list[str]:
    return [*lines[:7], lines[8], lines[7], "[WARN] lost track", *lines[9:]]


def test_salvage_reads_trajectories(tool: Any, path: tfdb.Trajectory, tmp_path: Path) -> None:
    file = tum(path, tmp_path / "swapped.tum", swapped)
    assert "--salvage" in tool("info", file, code=2).error
    said = "51 rows, 1 out of order, sorted, 1 skipped (line 10: 3 columns"
    found = tool("info", file, "--salvage")
    assert said in found.out
    assert said in found.err
    assert found.err.count("swapped.tum") == 1
    body = tool("info", file, "--salvage", "--json").json
    assert body["edges"][0]["samples"] == 50
    assert body["lost"][0]["messages"] == 1
    kinds = tool("check", file, "--salvage", "--json", code=1).json["findings"]
    assert [each["count"] for each in kinds if each["kind"] == "lost"] == [1]
    assert said in tool("check", file, "--salvage", code=1).out
    for command in (
        ("poses", file, "world", "body", "-o", tmp_path / "out.csv", "--salvage"),
        ("convert", file, tmp_path / "out.bag", "--salvage"),
        ("convert", file, tmp_path / "out.npz", "--frames", "world", "body", "--salvage"),
        ("tree", file, "--salvage"),
    ):
        assert said in tool(*command).err
    assert len(tfdb.Trajectory.read(tmp_path / "out.csv")) == 50
    assert len(tfdb.Trajectory.read(tmp_path / "out.npz")) == 50
    assert len(tfdb.load(tmp_path / "out.bag").trajectory("world", "body")) == 50


def test_units_of_stamps(tool: Any, path: tfdb.Trajectory, tmp_path: Path) -> None:
    file = tum(
        path,
        tmp_path / "ns.tum",
        lambda lines: [
            f"{stamp}.000000 {line.split(' ', 1)[1]}"
            for stamp, line in zip(path.stamps.tolist(), lines, strict=True)
        ],
    )
    said = "stamps taken as nanoseconds, by their size; stamp_unit='ns' (--stamp-unit ns)"
    assert said in tool("info", file).err
    assert "taken as nanoseconds" in tool("check", file).out
    for command in (
        ("info", file),
        ("check", file),
        ("poses", file, "world", "body", "-o", tmp_path / "out.tum"),
        ("convert", file, tmp_path / "out.bag"),
    ):
        found = tool(*command, "--stamp-unit", "ns")
        assert "taken as nanoseconds" not in found.err + found.out
    check(tfdb.Trajectory.read(tmp_path / "out.tum"), path)
    check(tfdb.load(tmp_path / "out.bag").trajectory("world", "body"), path)
    assert "beyond the greatest stamp" in tool("info", file, "--stamp-unit", "s", code=2).error
    bag = tmp_path / "out.bag"
    refused = tool("info", bag, "--stamp-unit", "s", code=2).error
    assert "stamp_unit is valid for text trajectories only" in refused

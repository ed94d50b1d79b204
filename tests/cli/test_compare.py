"""`tfdb compare`: the same numbers as in Python, text width, files, errors."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

import tfdb
from tfdb.trajectories.writing import write_trajectory

if TYPE_CHECKING:
    from pathlib import Path

    from conftest import Tool

KEYS = {
    "tfdb",
    "command",
    "files",
    "poses",
    "matched",
    "start_ns",
    "end_ns",
    "association",
    "max_diff_ns",
    "offset_ns",
    "offset_estimated",
    "align",
    "scale",
    "translation",
    "rotation_xyzw",
    "ape",
    "rpe",
    "outputs",
}
LONG = "trajectory of the robot that carries a very long name through every hall.tum"


def trajectory(count: int, rate: float, *, shift: float = 0.0, noise: float = 0.0) -> object:
    rng = np.random.default_rng(count)
    seconds = np.arange(count) / rate + 1.0
    poses = np.zeros((count, 7))
    poses[:, 0] = 3 * np.sin(0.5 * seconds + np.sin(1.3 * seconds))
    poses[:, 1] = np.cos(0.9 * seconds)
    poses[:, 2] = 0.3 * np.sin(2.1 * seconds)
    poses[:, :3] += rng.normal(0, noise, (count, 3))
    half = 0.4 * np.sin(0.7 * seconds) + rng.normal(0, noise, count)
    poses[:, 5], poses[:, 6] = np.sin(half), np.cos(half)
    stamps = np.rint((seconds + shift) * 1e9).astype(np.int64)
    return tfdb.Trajectory("world", "body", stamps, poses)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("trajectories")
    write_trajectory(made / "truth.tum", trajectory(600, 30.0))
    write_trajectory(made / "slam.csv", trajectory(190, 10.0, shift=0.25, noise=0.01))
    write_trajectory(made / LONG, trajectory(190, 10.0, noise=0.01))
    return made


def test_json_equals_python(tool: Tool, folder: Path) -> None:
    files = folder / "truth.tum", folder / "slam.csv"
    options = ("--align", "sim3", "--delta", "0.5", "--delta-unit", "m", "--all-pairs")
    more = ("--max-diff", "0.04", "--offset", "-0.25", "--delta-tolerance", "0.2")
    body = tool("compare", *files, *options, *more, "--json").json
    expected = tfdb.compare(
        *files,
        align="sim3",
        delta=0.5,
        delta_unit="m",
        all_pairs=True,
        max_diff=0.04,
        offset=-0.25,
        delta_tolerance=0.2,
    )
    assert set(body) == KEYS
    assert body["files"] == list(map(str, files))
    assert body["poses"] == [600, 190]
    assert body["matched"] == len(expected) == 190
    assert (body["offset_ns"], body["offset_estimated"]) == (-250_000_000, False)
    assert body["max_diff_ns"] == 40_000_000
    assert body["scale"] == expected.scale != 1
    assert body["translation"] == expected.alignment.translation.tolist()
    assert body["ape"]["translation_m"] == expected.ape_translation.statistics
    assert body["rpe"]["translation_m"] == expected.rpe_translation.statistics
    assert body["rpe"]["pairs"] == len(expected.pairs) > 50
    assert body["ape"]["rotation_deg"]["max"] == math.degrees(expected.ape_rotation.max)
    assert (body["rpe"]["delta"], body["rpe"]["delta_unit"], body["rpe"]["all_pairs"]) == (
        0.5,
        "m",
        True,
    )
    assert body["outputs"] == []


def test_text(tool: Tool, folder: Path) -> None:
    files = folder / "truth.tum", folder / "slam.csv"
    shown = tool("compare", *files, "--offset", "estimate", "--association", "nearest").out
    found = tfdb.compare(*files, offset="estimate", association="nearest")
    assert shown.endswith(f"\n{found}\n")
    assert found.offset == pytest.approx(-250_000_000, abs=5_000_000)
    assert shown.splitlines()[0] == f"reference  {files[0]}, 600 poses"
    assert ", estimated" in shown


@pytest.mark.parametrize("width", [60, 80, 200])
def test_nothing_is_broken(
    width: int, tool: Tool, folder: Path, bag: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    monkeypatch.chdir(folder)
    frames = (
        "--frames",
        "map",
        "base_link",
        "--estimate-frames",
        "odom_combined",
        "base_footprint",
    )
    for arguments, names in (
        (("truth.tum", LONG, "--save", folder / f"{width}.svg"), (LONG,)),
        (
            (bag, bag, *frames[:3], "--estimate-frames", "odom", "base_link"),
            ("T[map", "<-base_link]"),
        ),
    ):
        shown = tool("compare", *arguments).out
        for line in shown.splitlines():
            if len(line) > width:  # only one frame name
                assert any(name in line for name in (LONG, str(bag), str(folder)))
        for name in names:
            assert name in shown


def test_recordings(tool: Tool, bag: Path, mcap: Path, tmp_path: Path) -> None:
    frames = ("--frames", "map", "/base_link")
    body = tool("compare", bag, mcap, *frames, "--json").json
    assert body["ape"]["translation_m"]["max"] < 1e-9
    path = tmp_path / "path.tum"
    tool("poses", mcap, "map", "base_link", "--rate", "20", "-o", path)
    found = tool("compare", path, bag, "--estimate-frames", "odom", "base_link", "--json").json
    expected = tfdb.compare(path, bag, estimate_frames=("odom", "base_link"))
    assert found["ape"]["translation_m"] == expected.ape_translation.statistics
    part = tool("compare", path, bag, *frames, "--end", "+4", "--json").json
    assert part["matched"] < 100


def test_pictures(
    tool: Tool, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.chdir(tmp_path)
    files = folder / "truth.tum", folder / "slam.csv"
    body = tool("compare", *files, "--save", "svg", "--save", "a.png", "--json").json
    assert body["outputs"] == ["slam_compare.svg", "a.png"]
    assert all((tmp_path / name).stat().st_size > 5000 for name in body["outputs"])
    said = tool("compare", *files, "--save", "a.png", code=2).error
    assert "a.png: exists already; --overwrite replaces it" in said
    shown = tool("compare", *files, "--save", "a.png", "--overwrite").out
    assert shown.endswith("\n\na.png: the comparison\n")
    said = tool("compare", *files, "--save", files[0], "--overwrite", code=2).error
    assert "or a path that ends in one of them" in said


def test_refusals(tool: Tool, folder: Path, bag: Path) -> None:
    truth, slam = folder / "truth.tum", folder / "slam.csv"
    said = tool("compare", truth, bag, code=2).error
    assert "has many frames: name two with --estimate-frames TARGET SOURCE" in said
    said = tool("compare", bag, truth, "--frames", "map", "base_lonk", code=2).error
    assert "did you mean 'base_link'" in said
    assert "no such file" in tool("compare", truth, folder / "slom.csv", code=2).error
    said = tool("compare", truth, slam, "--keep", "5", code=2).error
    assert "do not apply to trajectory files" in said
    said = tool("compare", truth, slam, "--offset", "guess", code=2).error
    assert "write seconds" in said
    said = tool("compare", truth, slam, "--offset", "500", code=2).error
    assert "no time in common" in said
    assert "(--offset SECONDS), or offset='estimate' (--offset estimate)" in said
    body = tool(
        "compare", truth, slam, "--delta", "1e6", "--delta-unit", "m", "--json", code=2
    ).json
    assert body["error"]["type"] == "NotComparable"
    assert body["error"]["fields"]["reason"] == "no pairs"
    assert "(--all-pairs) a larger delta_tolerance (--delta-tolerance)" in body["error"]["message"]


def test_kitti_row_by_row(tool: Tool, tmp_path: Path) -> None:
    for name, noise in (("truth", 0.0), ("slam", 0.02)):
        made = trajectory(50, 10.0, noise=noise)
        write_trajectory(tmp_path / f"{name}.txt", made, "kitti")  # type: ignore[arg-type]
        (tmp_path / f"{name}_times.txt").unlink()
    truth, slam = tmp_path / "truth.txt", tmp_path / "slam.txt"
    assert "matched    50 poses, row by row" in tool("compare", truth, slam).out
    body = tool("compare", truth, slam, "--json").json
    assert (body["association"], body["start_ns"], body["end_ns"]) == ("rows", None, None)
    python = tfdb.compare(truth, slam)
    assert body["ape"]["translation_m"]["rmse"] == python.ape_translation.rmse
    assert "needs stamps" in tool("compare", truth, slam, "--delta-unit", "s", code=2).error
    assert "ignores stamps" in tool("compare", truth, slam, "--offset", "1", code=2).error
    tool("plot", truth, "compare", slam, "--save", tmp_path / "rows.png")


def test_salvage_and_units(tool: Tool, tmp_path: Path) -> None:
    made = trajectory(50, 10.0)
    truth, slam = tmp_path / "truth.tum", tmp_path / "slam.tum"
    write_trajectory(truth, made)  # type: ignore[arg-type]
    lines = truth.read_text().splitlines()
    slam.write_text("\n".join([lines[0], lines[2], lines[1], "lost", *lines[3:]]) + "\n")
    assert "--salvage" in tool("compare", truth, slam, code=2).error
    done = tool("compare", truth, slam, "--salvage")
    assert "slam.tum: 51 rows, 1 out of order, sorted, 1 skipped" in done.err
    assert "matched    50 poses" in done.out
    ms = [f"{float(line.split()[0]) * 1000:.0f} {line.split(' ', 1)[1]}" for line in lines[1:]]
    for file in (truth, slam):
        file.write_text("\n".join(ms))
    body = tool("compare", truth, slam, "--stamp-unit", "ms", "--json").json
    assert (body["start_ns"], body["matched"]) == (10**9, 50)
    assert (
        "do not apply to trajectory files"
        in tool("compare", truth, slam, "--frame", "a", code=2).error
    )


def test_a_suspected_order_of_quaternions(tool: Tool, tmp_path: Path) -> None:
    truth, slam = tmp_path / "truth.tum", tmp_path / "slam.tum"
    write_trajectory(truth, trajectory(50, 10.0))  # type: ignore[arg-type]
    rows = [line.split() for line in truth.read_text().splitlines()[1:]]
    slam.write_text("\n".join(" ".join([*row[:4], row[7], *row[4:7]]) for row in rows))
    done = tool("compare", truth, slam)
    assert "quaternions of the estimate may be in the order w x y z" in done.err
    slam.write_text("timestamp x y z qw qx qy qz\n" + slam.read_text())
    assert not tool("compare", truth, slam).err
